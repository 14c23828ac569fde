"""Tracing, folding and fusing."""

from collections import Counter

import numpy as np
import pytest

from robodyn.engine.run.kernel import Kernel
from robodyn.engine.trace.graph import Graph, Scalar
from robodyn.engine.trace.program import FAR, NEAR, program


@pytest.fixture
def xy():
    graph = Graph()
    return graph, *graph.inputs("x", (2,))


def test_the_same_operation_is_one_node(xy):
    _, x, y = xy
    assert (x + y).number == (y + x).number
    assert (x * y).number == (y * x).number
    assert (x - y).number == (-(y - x)).number
    assert (x * -2.0).number == (-(x * 2.0)).number
    assert (x - y).number != (y - x).number


@pytest.mark.parametrize(
    "fold",
    [
        lambda x, y: (x + 0.0, x),
        lambda x, y: (0.0 + x, x),
        lambda x, y: (x - 0.0, x),
        lambda x, y: (0.0 - x, -x),
        lambda x, y: (x * 1.0, x),
        lambda x, y: (x * -1.0, -x),
        lambda x, y: (x / 1.0, x),
        lambda x, y: (x - x, 0.0),
        lambda x, y: (x * 0.0, 0.0),
        lambda x, y: (0.0 / x, 0.0),
        lambda x, y: ((-x).__neg__(), x),
        lambda x, y: (x + (-y), x - y),
        lambda x, y: ((-x) + y, y - x),
        lambda x, y: (x - (-y), x + y),
        lambda x, y: ((-x) - y, -(x + y)),
        lambda x, y: ((-x) * y, -(x * y)),
        lambda x, y: ((-x) * (-y), x * y),
        lambda x, y: ((-x) / (-y), x / y),
        lambda x, y: ((-x).sin(), -(x.sin())),
        lambda x, y: ((-x).cos(), x.cos()),
        lambda x, y: (abs(-x), abs(x)),
        lambda x, y: (np.tanh(-x), -np.tanh(x)),
        lambda x, y: (np.minimum(x, x), x),
        lambda x, y: (np.maximum(x, y), np.maximum(y, x)),
        lambda x, y: (np.where(x > y, x, x), x),
        lambda x, y: (np.where(y < x, x, y), np.where(x > y, x, y)),
        lambda x, y: (np.where(~(x > y), x, y), np.where(x > y, y, x)),
        lambda x, y: (np.where(x < x, x, y), y),
        lambda x, y: (np.where((x < y) & True, x, y), np.where(x < y, x, y)),
        lambda x, y: (np.where((x < y) | (x * 0.0 < 1.0), x, y), x),
        lambda x, y: (np.where((x < y) & (y < y), x, y), y),
        lambda x, y: (np.where((x == y) & (y == x), x, y), np.where(x == y, x, y)),
        lambda x, y: (np.where(x != y, x, y), np.where(x == y, y, x)),
        lambda x, y: (x**3, x * (x * x)),
        lambda x, y: (x**-2, 1.0 / (x * x)),
        lambda x, y: (x**0, 1.0),
        lambda x, y: (x**0.5, np.sqrt(x)),
        lambda x, y: (np.power(x, 2), x * x),
    ],
)
def test_folds(xy, fold):
    graph, x, y = xy
    found, expected = fold(x, y)
    assert graph.lift(found).number == graph.lift(expected).number


def test_what_does_not_fold(xy):
    """A NaN is not ≤ itself, and −0 is another number than 0."""
    graph, x, _ = xy
    for kept in (np.where(x <= x, 1.0, 0.0), np.where(x == x, 1.0, 0.0), np.where(x > 0.0, 0.0, -0.0)):
        assert graph.lift(kept).node[0] == "select"
    assert graph.constant(0.0).number != graph.constant(-0.0).number


def test_folds_are_true_of_numbers():
    """Random expressions of the foldable operations: the traced kernel computes what floats compute, up to fused roundings."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        graph = Graph()
        values = rng.normal(size=3)
        traced, floats = list(graph.inputs("x", (3,))), list(values)
        traced += [0.0, 1.0, -1.0, -0.0]
        floats += [0.0, 1.0, -1.0, -0.0]
        for _ in range(30):
            i, j = rng.integers(len(traced), size=2)
            operation = rng.integers(5)
            if operation == 4 and not isinstance(traced[i], Scalar):
                continue
            results = []
            for pool in (traced, floats):
                a, b = pool[i], pool[j]
                results.append((a + b, a - b, a * b, -a, np.sin(a) if isinstance(a, float) else a.sin())[operation])
            traced.append(results[0])
            floats.append(float(results[1]))
        kernel = Kernel(program(graph, {"x": 3}, {"y": np.array(traced, dtype=object)}))
        found, bad = kernel((1,), {"x": values})
        assert bad == -1
        assert np.allclose(found["y"][0], floats, rtol=1e-13, atol=1e-13 * max(1, max(map(abs, floats))))


def test_products_are_fused_where_they_vanish(xy):
    graph, x, y = xy
    product = x * y
    code = program(graph, {"x": 2}, {"z": np.array([product + x, product - y, x - product], dtype=object)}).instructions
    assert Counter(op for op, *_ in code)["mul"] == 0
    assert {op for op, *_ in code} == {"in", "fma", "fms", "fnma"}
    # A product that is needed itself stays, and is not computed twice.
    code = program(graph, {"x": 2}, {"z": np.array([product + x, product], dtype=object)}).instructions
    assert Counter(op for op, *_ in code) == {"in": 2, "mul": 1, "add": 1}


def test_a_product_added_to_itself_stays(xy):
    """p + p cannot absorb p: its other operand is p."""
    graph, x, y = xy
    product = x * y
    kernel = Kernel(program(graph, {"x": 2}, {"z": np.array([product + product, product + x], dtype=object)}))
    assert kernel((1,), {"x": np.array([3.0, 5.0])})[0]["z"].tolist() == [[30.0, 18.0]]


def test_what_no_output_needs_is_gone(xy):
    graph, x, y = xy
    (x * y).sin()
    assert len(program(graph, {"x": 2}, {"z": np.array([x + y], dtype=object)}).instructions) == 3


def test_a_branch_on_a_traced_number_is_refused(xy):
    _, x, _ = xy
    with pytest.raises(TypeError, match="truth value"):
        bool(x)


@pytest.mark.parametrize("n", [100, 300])
def test_what_waits_long_costs_more_than_its_operations(n):
    """n sums are made, then used in their order: of more than the first-level cache holds, the first have left it by then."""
    graph = Graph()
    x = graph.inputs("x", (n,))
    sums = [a + b for a, b in zip(x, np.roll(x, 1), strict=True)]
    code = program(graph, {"x": n}, {"y": np.array([*sums, sum((s * s for s in sums[1:]), sums[0] * sums[0])])})
    assert code.operations == 3 * n - 1
    far = (code.cost - code.operations) / FAR
    assert far == 0 if n < NEAR else n - NEAR < far <= n


def test_guards_and_what_is_not_finite_are_reported():
    graph = Graph()
    x = graph.inputs("x", (1,))
    kernel = Kernel(program(graph, {"x": 1}, {"y": 1.0 / x}, [x[0]]))
    xs = np.ones((100, 1))
    assert kernel((100,), {"x": xs})[1] == -1
    xs[70] = -1.0
    assert 63 <= kernel((100,), {"x": xs})[1] <= 70
    xs[70] = 0.0
    assert kernel((100,), {"x": xs})[1] >= 0
    assert kernel((1,), {"x": xs[70]})[1] == 0


OPERATIONS = [
    lambda a, b: a + b,
    lambda a, b: a - 2.0 * b,
    lambda a, b: a * b,
    lambda a, b: 0.5 * a * b - b,
    lambda a, b: a / b,
    lambda a, b: 3.0 / a,
    lambda a, b: -a,
    lambda a, b: abs(a),
    lambda a, b: np.sqrt(abs(a)),
    lambda a, b: np.sin(a) - np.cos(a),
    lambda a, b: np.minimum(a, b),
    lambda a, b: np.where(a < b, a, 1.0),
    lambda a, b: np.tanh(a),
    lambda a, b: np.exp(-a),
]


@pytest.mark.parametrize("seed", range(30))
def test_what_is_not_finite_is_found_whatever_it_goes_through(seed):
    """Few values are looked at (`Program.telling`): those whose being infinite no other shows."""
    rng, graph = np.random.default_rng(seed), Graph()
    values = list(graph.inputs("x", (6,)))
    for _ in range(30):
        a, b = rng.choice(len(values), size=2)
        values.append(OPERATIONS[rng.integers(len(OPERATIONS))](values[a], values[b]))
    guard = values[rng.integers(len(values))] ** 2 + 1e-3
    code = program(graph, {"x": 6}, {"y": np.array([values[i] for i in rng.choice(len(values), size=5)])}, [guard])
    kernel, found = Kernel(code), Counter()
    for value in (0.0, np.nan, np.inf, -np.inf, 1e200):
        for k in range(6):
            xs = rng.normal(size=(11, 6))
            xs[5, k] = value
            for rows in (xs, xs[5]):  # many lanes, one lane
                batch = rows.shape[:-1]
                answer, bad = kernel(batch, {"x": rows})
                wrong = ~(np.isfinite(rows).all(axis=-1) & np.isfinite(answer["y"]).all(axis=-1))
                assert bad >= 0 or not wrong.any()
                found[bad >= 0] += 1
    assert found[True] >= 36  # every NaN and infinity that was put in
    assert len(code.telling & {i for i, (op, *_) in enumerate(code.instructions) if op == "in"}) > 0


def test_a_comparison_has_no_truth_value_and_scalars_stay_hashable(xy):
    _, x, y = xy
    for condition in (x < y, x == y, (x < y) & (y < 1.0), ~(x != 2.0)):
        with pytest.raises(TypeError, match=r"truth value.*np\.where"):
            bool(condition)
    with pytest.raises(TypeError, match="zeros_like"):
        np.zeros(2)[0] = x
    assert len({x, y, x}) == 2
    assert (x == None) is False  # noqa: E711


def choices(x, y):
    """An expression of every condition and choice, for floats and traced numbers alike."""
    inside = (x > -0.5) & (y <= 0.5) | ~(x < y)
    a = np.where(inside, x * y, np.maximum(x, y))
    b = np.where((a >= 0.1) & (x != y), np.minimum(a, 0.3), np.clip(y, -0.2, 0.2))
    return a + b * (x < 0.3) + np.sign(y) - (y > 0.1) * 2.0


def test_conditions_cross_the_borders_of_pieces(monkeypatch):
    """A program cut into pieces of three operations keeps its conditions in slots."""
    rng = np.random.default_rng(1)
    xs = rng.normal(size=(41, 2))
    graph = Graph()
    y = choices(*graph.inputs("x", (2,)))
    code = program(graph, {"x": 2}, {"y": np.array([y], dtype=object)})
    whole, bad = Kernel(code)((41,), {"x": xs})
    assert bad == -1
    assert np.allclose(whole["y"][:, 0], choices(*xs.T), rtol=1e-15, atol=1e-15)
    monkeypatch.setattr("robodyn.engine.emit.straight.PIECE", 3)
    cut, bad = Kernel(code)((41,), {"x": xs})
    assert bad == -1
    assert np.array_equal(cut["y"], whole["y"])
