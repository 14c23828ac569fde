"""Elementary functions of the kernels, against 60 digits."""

import mpmath
import numpy as np
import pytest

from robodyn import arithmetic
from robodyn.engine.graph import Graph
from robodyn.engine.kernel import Kernel
from robodyn.engine.program import program


def kernel(function):
    graph = Graph()
    x = graph.inputs("x", (1,))
    return Kernel(program(graph, {"x": 1}, {"y": function(x)}))


def ulps(values, references):
    """Errors in units of the last place of the reference."""
    units = [np.spacing(abs(float(r))) for r in references]
    return np.array(
        [abs(float((mpmath.mpf(float(y)) - r) / mpmath.mpf(float(u)))) for y, r, u in zip(values, references, units, strict=True)]
    )


def arguments(rng):
    """Ordinary ones, large ones, tiny ones, and those all but a multiple of π/2, where the reduction is hardest."""
    return np.concatenate(
        [
            rng.uniform(-4, 4, 4000),
            rng.uniform(-1e5, 1e5, 4000),
            rng.integers(-63000, 63000, 4000) * (np.pi / 2),
            10.0 ** rng.uniform(-300, 5, 1000),
            rng.uniform(-1, 1, 500) * 10.0 ** rng.uniform(5, 300, 500),
            [0.0, 1e5, -1e5, np.nextafter(1e5, np.inf), 1e22, 1.7e308, 22 / 7, 355 / 113],
        ]
    )


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sin_and_cos_within_one_ulp_everywhere(name):
    xs = arguments(np.random.default_rng(1))
    found, bad = kernel(getattr(arithmetic, name))((len(xs),), {"x": xs[:, None]})
    assert bad == -1
    with mpmath.workdps(350):  # 1.7e308 needs that many to be reduced
        references = [getattr(mpmath, name)(mpmath.mpf(float(x))) for x in xs]
    assert ulps(found["y"][:, 0], references).max() <= 1.0


@pytest.mark.parametrize("name", ["sin", "cos", "sqrt", "exp", "log", "tanh"])
def test_scalar_and_vector_code_give_the_same_bits(name):
    rng = np.random.default_rng(2)
    xs = rng.uniform(0.01, 20, 101) if name in ("sqrt", "log") else rng.uniform(-20, 20, 101)
    k = kernel(getattr(np, name))
    together, _ = k((101,), {"x": xs[:, None]})
    alone = [k((1,), {"x": np.array([x])})[0]["y"].item() for x in xs]
    assert np.array_equal(together["y"][:, 0], alone)
    assert np.allclose(alone, getattr(np, name)(xs), rtol=4e-16, atol=0)


def test_large_arguments_change_nothing_about_the_others():
    """Arguments of one state share the test for large ones: those that are not keep their bits, alone and side by side."""
    rng, n = np.random.default_rng(3), 11  # more than share one test
    graph = Graph()
    x = graph.inputs("x", (n,))
    y = np.concatenate([arithmetic.sin(x), arithmetic.cos(x), arithmetic.sin(arithmetic.cos(x))])
    together = Kernel(program(graph, {"x": n}, {"y": y}))
    xs = rng.uniform(-4, 4, (40, n))
    plain, _ = together((40,), {"x": xs})
    large = rng.random((40, n)) < 0.2
    mixed = np.where(large, 1e7 * xs, xs)
    found, bad = together((40,), {"x": mixed})
    assert bad == -1
    unchanged = np.tile(~large, 3)
    assert np.array_equal(found["y"][unchanged], plain["y"][unchanged])
    assert np.allclose(found["y"], np.concatenate([np.sin(mixed), np.cos(mixed), np.sin(np.cos(mixed))], axis=-1), rtol=0, atol=3e-16)
    assert np.array_equal(found["y"], np.stack([together((1,), {"x": x[None]})[0]["y"][0] for x in mixed]))
