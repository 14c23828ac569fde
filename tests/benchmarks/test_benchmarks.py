"""The benchmark's kinds of work under pytest-benchmark. Not collected by default:

    pytest -n 0 tests/benchmarks --benchmark-group-by=group

Each contender is one benchmark, times per run of the job; results are compared before any is timed.
"""

import os
import warnings
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import robodyn as rd
from robodyn.arithmetic import EPS
from robodyn.report import KINDS, Contest, Settings, Subject
from robodyn.report.accuracy import condition, error
from robodyn.report.processes import FIRST, IMPORT
from robodyn.report.timing import fresh

FILES = os.environ.get("ROBODYN_BENCH", str(Path(__file__).parents[2] / "robots" / "ur5e.urdf")).split(os.pathsep)
CONTESTS = ("batch", "reactions", "call", "rk4", "dop853", "crowd", "peak")


@lru_cache(maxsize=1)
def subject(file):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rd.RobodynWarning)
        found = Subject(file, Settings())
        assert found.robot.nv
    return found


@lru_cache(maxsize=1)
def contest(file, kind) -> Contest:
    (found,) = KINDS[kind](subject(file))
    return found


@pytest.mark.parametrize("side", ["robodyn", "peer"])
@pytest.mark.parametrize("kind", CONTESTS)
@pytest.mark.parametrize("file", FILES, ids=lambda file: Path(file).stem)
def test_work(benchmark, file, kind, side):
    found, robot = contest(file, kind), subject(file)
    if found.theirs is None and side == "peer":
        pytest.skip(found.note)
    # Forward dynamics against 50 digits; a trajectory is no less accurate than the peer's by the same method, 3 sharing what is chance.
    if kind in ("batch", "reactions", "call"):
        kappa = max(condition(robot.robot, q, a) for q, a in zip(robot.few[0], robot.exact, strict=True))
        assert found.error is not None
        assert found.error <= 50 * kappa * EPS
    elif found.error is not None and found.peer_error is not None:
        assert found.error <= 3 * found.peer_error
    benchmark.group = f"{Path(file).stem}: {found.work}"
    benchmark.extra_info.update(units=found.units, error=found.error, peer=found.peer, peer_error=found.peer_error, note=found.note)
    benchmark(found.ours if side == "robodyn" else found.theirs)


@pytest.mark.parametrize("file", FILES, ids=lambda file: Path(file).stem)
@pytest.mark.parametrize("cached", [False, True], ids=["nothing cached", "cached"])
def test_first_call(benchmark, file, cached, tmp_path):
    """Processes that import, load and answer once; what they themselves measured from the loaded robot on is in extra_info."""
    inner, folders = [], iter(range(1000))

    def process():
        folder = tmp_path / ("cache" if cached else str(next(folders)))
        inner.append(fresh(FIRST, file, "{}", ROBODYN_CACHE=str(folder)))

    benchmark.group = "first call"
    benchmark.pedantic(process, rounds=3, warmup_rounds=int(cached))
    benchmark.extra_info["seconds from the loaded robot to its first answer"] = sorted(inner)[len(inner) // 2]


def test_import(benchmark):
    benchmark.group = "import"
    benchmark.pedantic(fresh, args=(IMPORT,), rounds=5, warmup_rounds=1)


def test_chain(benchmark):
    """A chain of 100 joints, one call; `robodyn bench --chains` measures longer ones, and memory, each in a process of its own."""
    rng = np.random.default_rng(100)
    robot = rd.random_robot(rng, 100, branching=0.0, joint_types=("revolute",))
    q, v = robot.random_state(rng)
    exact = robot.forward_dynamics(q, v, backend="mpmath", formalism="recursive")
    assert error(robot.forward_dynamics(q, v)[None], exact[None]) <= 50 * condition(robot, q, exact) * EPS
    benchmark.group = "chain of 100 joints"
    benchmark(robot.forward_dynamics, q, v)
