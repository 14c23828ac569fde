"""The benchmark runs, compares before it measures, and says what it lacks."""

import itertools
import json
import re
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import robodyn as rd
from robodyn.cli import main
from robodyn.report import KINDS, Contest, Row, Settings, Subject, Timing, bench, chain_rows, dynamics, rows, trajectories
from robodyn.report.accuracy import condition, error
from robodyn.report.timing import fresh, interleaved

ROBOTS = Path(__file__).parents[2] / "robots"
ARM = ROBOTS / "ur5e.urdf"
QUICK = Settings.quick()
EPS = np.finfo(float).eps


@pytest.fixture
def command(capsys, monkeypatch, tmp_path):
    """`robodyn bench --quick …` in an empty folder: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        code = main(["bench", "--quick", *map(str, arguments)])
        return code, *capsys.readouterr()

    return run


def test_quick_run_of_everything(command, tmp_path):
    pytest.importorskip("pinocchio")
    pytest.importorskip("mujoco")
    code, out, err = command(ARM, "--chains", 3, "--json", "found.json")
    assert (code, err) == (0, "")
    record = json.loads((tmp_path / "found.json").read_text())
    arm, chains = record["robots"]
    assert [row["kind"] for row in arm["rows"]] == [
        "batch",
        "reactions",
        "reactions",
        "call",
        "rk4",
        "dop853",
        "crowd",
        "first",
        "first",
        "import",
        "peak",
    ]
    for row in arm["rows"] + chains["rows"]:
        assert row["work"] in out
        assert 0 < row["ours"]["low"] <= row["ours"]["median"] <= row["ours"]["high"]
    # Each with its errors against 50 digits: ours 50 κ eps; abaInParallel works in world coordinates, where it is the usual condition
    # number of M̂, up to 1e5 for this arm, that carries rounding into accelerations. Trajectories of one method have one error.
    found = {row["kind"]: row for row in arm["rows"]}
    for kind in ("batch", "reactions", "call"):
        assert found[kind]["error"] < 50 * arm["condition"] * EPS
        assert found[kind]["peer_error"] < 100 * 1e5 * EPS
    for kind in ("rk4", "crowd"):
        assert found[kind]["error"] == pytest.approx(found[kind]["peer_error"], rel=0.01)
        assert found[kind]["error"] < 1e-7
    assert max(found["dop853"]["error"], found["dop853"]["peer_error"]) < 1e-8
    assert 0 < found["peak"]["ratio"] < 1
    assert chains["rows"][0]["error"] < 1e-12
    assert re.search(r"first call [\d.]+ s, cached [\d.]+ s", chains["rows"][0]["note"])


def test_only_and_missing_peers(command, monkeypatch):
    """Without its peers each kind of work is measured alone, and says what to install."""
    for library in ("pinocchio", "mujoco"):
        monkeypatch.setitem(sys.modules, library, None)
        monkeypatch.delitem(sys.modules, f"robodyn.report.peers.{library}", raising=False)
    found = list(rows(Subject(ARM, QUICK), ["batch", "reactions", "call", "rk4", "dop853", "crowd"]))
    assert len(found) == 7  # reactions of moving joints, and of all
    for row in found:
        assert row.ours
        assert row.theirs is None
        assert "is not installed: pip install 'robodyn[bench]'" in row.note
    code, out, _ = command("--only", "call", ARM)  # before or behind
    assert code == 0
    assert "one call" in out
    assert "batch" not in out
    with pytest.raises(SystemExit):
        command(ARM, "--only", "call,butch")


def test_mimic_and_locked_joints(command):
    """A hand whose fingers are coupled is measured; what its peers move instead is said, and locking reaches the peers too."""
    pytest.importorskip("pinocchio")
    pytest.importorskip("mujoco")
    found = {row.kind: row for row in rows(Subject(ROBOTS / "panda.urdf", QUICK), ["batch", "call", "rk4", "dop853"])}
    assert found["batch"].note == "Pinocchio moves mimic joints freely: 9 dof"
    assert found["call"].peer_error < 1e-12
    assert "no rigid mimic joint" in found["rk4"].note
    assert "pin.crba and rnea" in found["dop853"].peer
    fingers = dict.fromkeys(("panda_finger_joint1", "panda_finger_joint2"), 0.01)
    locked = list(rows(Subject(ROBOTS / "panda.urdf", QUICK, {"locked": fingers}), ["batch", "rk4"]))
    for row in locked:
        assert row.error == pytest.approx(row.peer_error, rel=0.01, abs=1e-11)
    half = {"panda_finger_joint1": 0.01}
    (row,) = rows(Subject(ROBOTS / "panda.urdf", QUICK, {"locked": half}), ["batch"])
    assert "lock it by name too, with --lock panda_finger_joint2=VALUE" in row.note


def test_wrong_usage(command, tmp_path):
    for arguments, message in [
        ([], "nothing to measure"),
        ([ARM, "--rounds", 0], "--rounds 0: must be at least 1"),
        ([ARM, "--chains", -1], "--chains -1: must be at least 1"),
        ([ARM, "--yardstick", "none.py"], "no such file"),
        ([ARM, "--json", "none/found.json"], "there is no folder"),
    ]:
        code, out, err = command(*arguments)
        assert (code, out) == (1, "")
        assert message in err
    rigid = tmp_path / "rigid.urdf"
    rigid.write_text('<robot name="stone"><link name="a"/></robot>')
    assert "'stone' has no degree of freedom" in command(rigid)[2]
    with pytest.raises(rd.InputError, match="no kind of work named nonsense"):
        list(rows(Subject(ARM, QUICK), ["nonsense"]))


def test_interrupted_it_prints_what_there_is(command, monkeypatch, tmp_path):
    def interrupt(subject):
        raise KeyboardInterrupt

    monkeypatch.setitem(bench.KINDS, "reactions", interrupt)
    code, out, err = command(ARM, "--only", "call,reactions", "--json", "found.json")
    assert code == 130
    assert "interrupted" in err
    assert "one call" in out
    assert [row["kind"] for row in json.loads((tmp_path / "found.json").read_text())["robots"][0]["rows"]] == ["call"]


def test_jobs_take_turns():
    log = []

    def job(name, seconds):
        return lambda: (log.append(name), time.sleep(seconds))

    times = interleaved([job("a", 0.03), job("b", 0.001)], rounds=3, tick=log.append)
    assert [len(t) for t in times] == [3, 3]
    assert min(times[0]) >= 0.03
    assert 0.001 <= min(times[1]) <= max(times[1]) < 0.03  # per run
    # First runs; then, in an order that changes from round to round, each warmed up by one run and run for about as long as the other.
    assert [key for key, _ in itertools.groupby(log)] == ["a", "b", 0, "a", "b", 1, "b", "a", 2, "a", "b"]
    rounds = [list(group) for key, group in itertools.groupby(log, lambda entry: isinstance(entry, int)) if not key][1:]
    assert all(names.count("a") == 2 for names in rounds)
    assert all(5 < names.count("b") <= 31 for names in rounds)


def test_slow_jobs_get_fewer_rounds(monkeypatch):
    monkeypatch.setattr("robodyn.report.timing.PATIENCE", 0.0)
    assert [len(t) for t in interleaved([lambda: None], rounds=9)] == [3]


def test_timing():
    timing = Timing.of([4e-3, 1e-3, 2e-3, 3e-3, 100.0], units=2)
    assert (timing.median, timing.low, timing.high) == pytest.approx((1.5e-3, 1e-3, 2e-3))
    assert str(timing) == "1.5 (1…2) ms"
    assert str(Timing(2e-10, 1e-10, 3e-10)) == "0.2 (0.1…0.3) ns"
    assert Row("k", "w", Timing(1.0, 1.0, 1.0), "p", Timing(3.0, 3.0, 3.0)).ratio == 3.0


def test_a_process_that_fails_says_why():
    with pytest.raises(rd.RobodynError, match="no more"):
        fresh("raise SystemExit('no more')")
    assert fresh("import sys, json; print('noise'); print(json.dumps(sys.argv[1:]))", 1, "b") == ["1", "b"]


def test_errors_and_conditions():
    exact = np.array([[1.0, -4.0], [1e-9, 0.0]])
    assert error(exact + np.array([[0.0, 0.4], [0.0, 1e-9]]), exact) == pytest.approx(1.0)
    # Skeel's number of a pendulum is 1 whatever its inertia; it never exceeds the usual condition number.
    pendulum = rd.load(ROBOTS / "pendulum.urdf")
    assert condition(pendulum, np.array([0.3]), np.array([2.0])) == pytest.approx(1.0)
    arm, rng = rd.load(ARM), np.random.default_rng(0)
    q, v = arm.random_state(rng)
    assert 1 <= condition(arm, q, arm.forward_dynamics(q, v)) <= np.linalg.cond(arm.mass_matrix(q), np.inf)


def test_another_robot_in_mujoco_is_noticed(monkeypatch):
    """No time is taken where the peer does other work."""
    twins = pytest.importorskip("robodyn.report.peers.mujoco")
    pytest.importorskip("pinocchio")
    subject = Subject(ARM, QUICK)
    heavy = twins.Twin(subject.robot, QUICK.dt, (0.0, 0.0, -9.81))
    heavy.model.body_mass[3] *= 1 + 1e-6
    monkeypatch.setitem(subject.__dict__, "mujoco", heavy)
    (row,) = rows(subject, ["rk4"])
    assert row.theirs is None
    assert "does not have the same robot" in row.note


def test_chaos_is_noticed():
    """A double pendulum released upside down: errors are taken while two computations still agree."""
    pytest.importorskip("pinocchio")
    settings = replace(QUICK, t_end=60.0, dt=1e-2)
    subject = Subject(ROBOTS / "double_pendulum.urdf", settings)
    subject.states[0][0] = [3.0, 0.1]
    reference = trajectories._reference(subject)
    assert isinstance(reference, trajectories.Reference)
    assert 0 < reference.t < 60.0
    assert reference.agreement < trajectories.AGREEMENT * max(1.0, abs(reference.state).max())


def test_rk4_steps_alone_end_where_simulate_does():
    subject = Subject(ARM, QUICK)
    trajectories.steps_alone(subject, 3)()  # raises where a state is not finite
    (contest,) = dynamics.peak(subject)
    assert isinstance(contest, Contest)
    operations = min(subject.scene.evaluator.routes.operations.values())
    assert str(operations) in contest.work
    # The saving that base inertial parameters make is counted, not claimed.
    about = bench.facts(subject)
    assert about["unreduced"] > about["operations"]["nonrecursive"]


def test_yardstick(tmp_path):
    script = tmp_path / "stick.py"
    script.write_text("print('a, batch in 4 lanes, per state   20.0 ns  3 x\\nb, batch in 4 lanes, per state  10.0 ns  3 x')\n")
    (row,) = rows(Subject(ARM, QUICK), [], script=str(script))
    assert "no figures" in row.note
    with open(script, "a") as file:
        file.write("print('a, one chained evaluation, scalar   100.0 ns')\n")
    batch, step = rows(Subject(ARM, QUICK), [], script=str(script))
    assert batch.theirs
    assert step.theirs
    assert (batch.theirs.median, step.theirs.median) == pytest.approx((1e-8, 1e-7))


def test_chains_that_fail_leave_a_remark(monkeypatch):
    monkeypatch.setattr("robodyn.report.chains.fresh", lambda *_, **__: fresh("raise SystemExit('too long')"))
    (row,) = chain_rows([5], QUICK)
    assert row.note == "too long"
    assert row.ours is None


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux for the peak memory")
def test_memory_is_the_process_own():
    """A child's peak is not that of a parent who had more, as Linux's ru_maxrss would have it."""
    ballast = np.ones(60_000_000)  # 480 MB
    peak = fresh("from robodyn.report.chains import _most_memory; print(_most_memory())")
    assert 10e6 < peak < ballast.nbytes


def test_every_kind_is_documented():
    assert all(kind.__doc__ for kind in KINDS.values())
