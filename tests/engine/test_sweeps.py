"""Recorded sweeps over hand-made forests against plain loops over NumPy arrays. Nothing here knows of robots.

Where nothing else is said, every number is a small integer, so that float64 adds, multiplies and fuses them without rounding: results
are compared for equality.
"""

import pickle
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from robodyn.arithmetic import cos, sin
from robodyn.engine.emit import blocks
from robodyn.engine.run import kernel as kernels
from robodyn.engine.run.kernel import Kernel
from robodyn.engine.trace.alike import MANY
from robodyn.engine.trace.layout import Fill, Loop, Straight
from robodyn.engine.trace.recording import SUM, Entry, Forest, Kept, OfNode, Own, Param, objects
from robodyn.engine.trace.sweeps import NodeRecords, Recorder

SIZES = (1, 2, 0)  # numbers that a node of each kind has in a vector


class Wood:
    """A random forest of three kinds whose nodes have 1, 2 or 0 entries in a vector, recorded and known."""

    def __init__(self, seed: int, n: int, kinds: int = 3) -> None:
        rng = np.random.default_rng([17, seed, n])
        self.n, self.recorder = n, Recorder()
        self.kinds = rng.integers(kinds, size=n) if n < kinds else rng.permutation(np.arange(n) % kinds)
        self.parents = np.array([rng.integers(-1, i) if rng.random() < 0.6 else i - 1 for i in range(n)], dtype=int)
        self.starts = np.cumsum([0, *(SIZES[k] for k in self.kinds)])[:-1].astype(int)
        self.size = sum(SIZES[k] for k in self.kinds)
        # A number of parameters that differs from kind to kind.
        self.parameters = [rng.integers(-3, 4, size=2 + k).astype(float) for k in self.kinds]
        self.forest = self.recorder.forest(Forest(self.kinds, self.parents, {"x": self.starts}, self.parameters))

    def rows(self, x, i):
        """A node's entries of a vector (..., size)."""
        return x[..., self.starts[i] : self.starts[i] + SIZES[self.kinds[i]]]

    def field(self, region):
        """Records of each node's entries of an input vector."""
        sizes = SIZES[: self.recorder.forests[self.forest].count]
        places = [[Entry(region, "x", k) for k in range(size)] for size in sizes]
        return NodeRecords(self.recorder, self.forest, places, [objects] * len(places))

    def outward(self, step, root, *fields):
        """The same step(kind, parameters, comes, *records), recorded; `grown` runs it."""
        return self.recorder.sweep(self.forest, lambda kind, comes, graph, *r: step(kind, Parameters(graph), comes, *r), fields, root=root)

    def inward(self, step, *fields):
        def at(kind, comes, graph, *records):
            return step(kind, Parameters(graph), (0.0, 0.0) if comes is None else comes, *records)

        return self.recorder.sweep(self.forest, at, fields, inward=True)

    def grown(self, step, root, *fields, inward=False):
        """What a sweep keeps at each node, by a plain loop; inward `root` is an empty sum."""
        passed, kept = [None] * self.n, [None] * self.n
        came = [[np.copy(x) for x in root] for _ in range(self.n)]
        for i in reversed(range(self.n)) if inward else range(self.n):
            parent = self.parents[i]
            comes = came[i] if inward else (passed[parent] if parent >= 0 else root)
            passed[i], kept[i] = step(self.kinds[i], self.parameters[i], tuple(comes), *(f[i] for f in fields))
            if inward and parent >= 0:
                came[parent] = [a + b for a, b in zip(came[parent], passed[i], strict=True)]
        return kept

    def evaluated(self, outputs, inputs):
        """Outputs by name at the rows of the inputs."""
        return evaluated(self.recorder.finish({name: x.shape[-1] for name, x in inputs.items()}, outputs, ()), inputs)


def evaluated(program, inputs):
    """Outputs by name; every row must be good."""
    values, bad = Kernel(program)(next(iter(inputs.values())).shape[:-1], inputs)
    assert bad == -1
    return values


class Parameters:
    """A node's parameters as symbols."""

    def __init__(self, graph):
        self._graph = graph

    def __getitem__(self, k):
        return self._graph.node("in", Param(k))


def integers(rng, *shape):
    return rng.integers(-3, 4, size=shape).astype(float)


# --- outward ---


class Passed(NamedTuple):
    matrix: np.ndarray  # (2, 2), symmetric
    constant: float
    sum: float


def matrix_step(kind, p, comes, x):
    """Passes on a symmetric matrix, a number that is always 4, and a sum."""
    a, c = comes.matrix if isinstance(comes, Passed) else comes[0], comes[1]
    first = x[..., 0] if kind != 2 else p[1]
    beside = a[1, 0] + first
    on = np.array([[a[0, 0] + p[0], beside], [beside, a[1, 1] - c * p[1] + a[0, 1]]], dtype=object)
    return Passed(on, 4.0, comes[2] + (first * p[0] if kind != 1 else x[..., 1])), (on[1, 0] - on[0, 0], (comes[2], on[1, 1] * c))


def test_outward_with_a_symmetric_matrix_and_a_constant():
    wood, rng = Wood(0, 60), np.random.default_rng(0)
    root = Passed(np.array([[1.0, 2.0], [2.0, 3.0]], dtype=object), 4.0, 5.0)
    x = wood.recorder.inputs("x", (wood.size,))
    kept = wood.outward(matrix_step, root, wood.field(x[0].node[1]))
    outputs = {"out": wood.recorder.gathered(flat(kept), wood.recorder.column(wood.forest, "three", 3 * np.arange(60)), 180)}
    program = wood.recorder.finish({"x": wood.size}, outputs, ())
    # Off-diagonal entries are one number, the constant is none: four numbers a node, and one for the ground; what is kept is in the result.
    assert program.size == wood.size + 180 + 4 * 61

    values = integers(rng, 5, wood.size)
    found = evaluated(program, {"x": values})["out"]
    for row, given in zip(found, values, strict=True):
        expected = wood.grown(matrix_step, root, [wood.rows(given, i) for i in range(60)])
        assert np.array_equal(row, [float(e) for a, (b, c) in expected for e in (a, b, c)])


def loops(program):
    return [item for item in program.items if isinstance(item, Loop)]


def flat(records):
    """The same records as vectors."""
    return replace(records, rebuild=[objects] * len(records.rebuild))


def test_where_nodes_share_an_entry_their_numbers_are_added():
    wood, rng = Wood(20, 50), np.random.default_rng(20)
    wood.recorder.inputs("x", (wood.size,))
    shared = rng.integers(7, size=50)  # two numbers of each node go to entries 2k and 2k + 1
    kept = wood.outward(lambda kind, p, comes: ((comes[0] + p[0],), objects([comes[0], p[1]])), (1.0,))
    column = wood.recorder.column(wood.forest, SUM, 2 * shared)
    found = wood.evaluated({"out": wood.recorder.gathered(kept, column, 14)}, {"x": integers(rng, 3, wood.size)})["out"]
    expected = np.zeros((7, 2))
    np.add.at(expected, shared, [*wood.grown(lambda kind, p, comes: ((comes[0] + p[0],), [comes[0], p[1]]), (1.0,))])
    assert np.array_equal(found, np.tile(expected.ravel(), (3, 1)))


def test_entries_that_only_look_alike_at_first_are_not_merged():
    """Two entries that are equal at the ground and in one kind of node, but not in the other."""
    wood = Wood(1, 40, kinds=2)

    def step(kind, p, comes, x):
        a, b = comes
        return (a + p[0], b + p[0] if kind == 0 else b + p[1]), (a - b) * x[..., 0]

    x = wood.recorder.inputs("x", (wood.size,))
    kept = wood.outward(step, (1.0, 1.0), wood.field(x[0].node[1]))
    values = integers(np.random.default_rng(1), 2, wood.size)
    total = wood.recorder.total(wood.forest, lambda kind, graph, r: r * 1.0, [kept])
    found = wood.evaluated({"out": np.array([total])}, {"x": values})["out"]
    for row, given in zip(found, values, strict=True):
        assert row[0] == sum(wood.grown(step, (1.0, 1.0), [wood.rows(given, i) for i in range(40)]))


def test_a_constant_of_the_nodes_that_the_ground_does_not_share_is_not_taken_for_one():
    wood = Wood(2, 30)

    def step(kind, p, comes):
        return (7.0, comes[0]), (comes[0] * p[0], comes[1])

    wood.recorder.inputs("x", (1,))
    kept = wood.outward(step, (2.0, 3.0))
    column = wood.recorder.column(wood.forest, "two", 2 * np.arange(30))
    found = wood.evaluated({"out": wood.recorder.gathered(flat(kept), column, 60)}, {"x": np.zeros((1, 1))})["out"]
    assert np.array_equal(found[0], np.ravel(wood.grown(step, (2.0, 3.0))))


def test_entries_that_are_one_at_every_node_but_not_at_the_ground_are_not_merged():
    wood = Wood(2, 30)

    def step(kind, p, comes):
        a, b = comes
        return (a - 2.0 * b + p[0], a - 2.0 * b + p[0]), a - b

    wood.recorder.inputs("x", (1,))
    kept = wood.outward(step, (2.0, 3.0))
    column = wood.recorder.column(wood.forest, "one", np.arange(30))
    found = wood.evaluated({"out": wood.recorder.gathered(flat(kept), column, 30)}, {"x": np.zeros((1, 1))})["out"]
    assert np.array_equal(found[0], wood.grown(step, (2.0, 3.0)))


# --- inward ---


def sum_step(kind, p, comes, x):
    """Sends two numbers, keeps what arrived and what it sends."""
    a, b = comes
    own = p[0] if kind == 2 else x[..., 0]
    send = (a + own, (b - a if kind == 1 else b + p[1]) + 0.0)
    return send, (a, b, *send)


@pytest.mark.parametrize("n", [1, 2, 50])
def test_inward_sums(n):
    wood, rng = Wood(3, n), np.random.default_rng(3)
    x = wood.recorder.inputs("x", (max(wood.size, 1),))
    kept = wood.inward(sum_step, wood.field(x[0].node[1]))
    column = wood.recorder.column(wood.forest, "four", 4 * np.arange(n))
    # More than one row: what one evaluation has summed up must not be there in the next.
    values = integers(rng, 3, len(x))
    found = wood.evaluated({"out": wood.recorder.gathered(flat(kept), column, 4 * n)}, {"x": values})["out"]
    for row, given in zip(found, values, strict=True):
        expected = wood.grown(sum_step, (0.0, 0.0), [wood.rows(given, i) for i in range(n)], inward=True)
        assert np.array_equal(row, np.ravel(expected))


def test_two_inward_passes_with_nothing_between_them():
    """The second's sums cannot be cleared by an outward pass before it: there is none."""
    wood = Wood(4, 40)
    x = wood.recorder.inputs("x", (wood.size,))
    field = wood.field(x[0].node[1])
    first = wood.inward(sum_step, field)

    def second(kind, p, comes, kept):
        return (comes[0] + kept[2], comes[1] + kept[1] * p[1]), comes[0] - comes[1]

    kept = wood.inward(second, first)
    column = wood.recorder.column(wood.forest, "one", np.arange(40))
    values = integers(np.random.default_rng(4), 4, wood.size)
    found = wood.evaluated({"out": wood.recorder.gathered(flat(kept), column, 40)}, {"x": values})["out"]
    for row, given in zip(found, values, strict=True):
        once = wood.grown(sum_step, (0.0, 0.0), [wood.rows(given, i) for i in range(40)], inward=True)
        assert np.array_equal(row, wood.grown(second, (0.0, 0.0), once, inward=True))


# --- vectors ---


def test_totals_and_numbers_of_single_nodes():
    wood, rng = Wood(5, 45), np.random.default_rng(5)
    x = wood.recorder.inputs("x", (wood.size,))
    root = Passed(np.array([[1.0, 2.0], [2.0, 3.0]], dtype=object), 4.0, 5.0)
    kept = wood.outward(matrix_step, root, field := wood.field(x[0].node[1]))
    total = wood.recorder.total(wood.forest, lambda kind, graph, r, e: np.array([r[0], 2.0 if kind else r[1][1]]), [kept, field])
    picked = [kept[7][0], kept[44][1][1], kept[0][1][0], *field[3 if wood.kinds[3] != 2 else 4]]
    values = integers(rng, 2, wood.size)
    found = wood.evaluated({"out": np.array([*total, *picked, total[0] * picked[0]], dtype=object)}, {"x": values})["out"]
    for row, given in zip(found, values, strict=True):
        own = [wood.rows(given, i) for i in range(45)]
        k = wood.grown(matrix_step, root, own)
        sums = [sum(a for a, _ in k), sum(2.0 if kind else b[1] for kind, (_, b) in zip(wood.kinds, k, strict=True))]
        one = [k[7][0], k[44][1][1], k[0][1][0], *own[3 if wood.kinds[3] != 2 else 4]]
        assert np.array_equal(row, np.array([*sums, *one, sums[0] * one[0]], dtype=float))


def test_gathered_where_they_are_made_and_copied():
    """The same numbers gathered twice: the first time they live in the vector, the second they are copied; and steps still read them."""
    wood, rng = Wood(6, 40), np.random.default_rng(6)
    x = wood.recorder.inputs("x", (wood.size,))
    field = wood.field(x[0].node[1])

    def step(kind, p, comes, x):
        return (comes[0] + p[0],), x * p[1] + comes[0] if kind != 2 else x

    kept = wood.outward(step, (1.0,), field)
    moved, copied = (wood.recorder.gathered(kept, "x", wood.size) for _ in range(2))
    as_they_are = wood.recorder.gathered(field, "x", wood.size)

    def again(kind, p, comes, k, x):
        return (), k * x if kind != 2 else x

    products = wood.recorder.gathered(wood.outward(again, (), kept, field), "x", wood.size)
    first = next(i for i in range(40) if wood.kinds[i] == 1)
    shuffled = objects([moved[0], *moved[:0:-1]])  # as many as there are, from the first on, but not in order
    outputs = {
        "f": moved[:5],
        "k": shuffled,
        "a": moved,
        "b": copied,
        "c": as_they_are,
        "d": products,
        "e": np.array([kept[first][1] + 1.0]),
        "g": moved[5:9],
    }
    twice = wood.outward(lambda kind, p, comes, x: ((), objects([*(x * 2.0)[:1], *(x * 2.0)[:1]])), (), field)
    lengths = np.array([2 * min(1, SIZES[kind]) for kind in wood.kinds])
    column = wood.recorder.column(wood.forest, "twice", np.cumsum([0, *lengths])[:-1])
    outputs["h"] = wood.recorder.gathered(twice, column, sum(lengths))
    values = integers(rng, 3, wood.size)
    found = wood.evaluated(outputs, {"x": values})
    for r, given in enumerate(values):
        own = [wood.rows(given, i) for i in range(40)]
        expected = np.concatenate(wood.grown(step, (1.0,), own))
        assert np.array_equal(found["a"][r], expected)
        assert np.array_equal(found["b"][r], expected)
        assert np.array_equal(found["c"][r], given)
        assert np.array_equal(found["d"][r], expected * given)
        assert np.array_equal(found["f"][r], expected[:5])
        assert np.array_equal(found["k"][r], [expected[0], *expected[:0:-1]])
        assert np.array_equal(found["g"][r], expected[5:9])
        assert np.array_equal(found["h"][r], np.repeat([2 * x[0] for x in own if len(x)], 2))
        assert found["e"][r] == wood.rows(expected, first)[1] + 1


def test_vectors_in_loops():
    """Many like expressions of neighbours, with constants; a few others between them; inputs as outputs; a vector of constants."""
    n, recorder, rng = 100, Recorder(), np.random.default_rng(7)
    x, y, c = recorder.inputs("x", (n + 5,)), recorder.inputs("y", (n,)), rng.integers(2, 6, size=n)
    entries = [x[k + 5] * c[k] - y[k] + x[k] for k in range(n)]
    entries[13], entries[50] = x[1] * x[2], 8.0
    outputs = {"a": objects(entries), "b": x, "c": objects([0.0] * n), "d": x[3 : 3 + n], "e": objects([*np.arange(40.0)]), "f": y[::-1]}
    program = recorder.finish({"x": n + 5, "y": n}, outputs, ())
    assert any(isinstance(item, Loop) for item in program.items)
    straight = sum(item.program.length for item in program.items if isinstance(item, Straight))
    assert straight < n + 10  # entries 13 and 50, and what is not in order
    given = {"x": integers(rng, 9, n + 5), "y": integers(rng, 9, n)}
    found = evaluated(program, given)
    expected = given["x"][:, 5:] * c - given["y"] + given["x"][:, :n]
    expected[:, 13], expected[:, 50] = given["x"][:, 1] * given["x"][:, 2], 8.0
    assert np.array_equal(found["a"], expected)
    assert np.array_equal(found["b"], given["x"])
    assert not found["c"].any()
    assert np.array_equal(found["d"], given["x"][:, 3 : 3 + n])
    assert np.array_equal(found["e"], np.tile(np.arange(40.0), (9, 1)))
    assert np.array_equal(found["f"], given["y"][:, ::-1])


@pytest.mark.parametrize("count", [3, MANY + 3])
def test_sparse_vectors(count):
    """Zero but for some entries, whatever was there in the row before."""
    wood, rng = Wood(8, 80, kinds=1), np.random.default_rng(8)
    x = wood.recorder.inputs("x", (80,))
    region = wood.recorder.sparse(80, [(2 * k, x[k] * 2.0) for k in range(count)])
    kept = wood.outward(lambda kind, p, comes, s: ((comes[0] + s[0],), objects([comes[0] - s[0]])), (0.0,), wood.field(region))
    values = integers(rng, 3, 80)
    found = wood.evaluated({"out": wood.recorder.gathered(kept, "x", 80)}, {"x": values})["out"]
    for row, given in zip(found, values, strict=True):
        sparse = np.zeros(80)
        sparse[: 2 * count : 2] = 2 * given[:count]
        expected = wood.grown(lambda kind, p, comes, s: ((comes[0] + s[0],), comes[0] - s[0]), (0.0,), sparse[:, None])
        assert np.array_equal(row, expected)


# --- expressions of vectors ---


def test_long_sums_become_loops():
    """A dense product, one sum over everything, and short sums that stay as they are; each with a few terms that are like no other."""
    rng, n = np.random.default_rng(18), 2 * MANY
    A = integers(rng, n, n)

    def of(x, y):
        dense = A @ x
        dense[3] = dense[3] + y[0] * y[1] * y[2]
        power = (x * y).sum() - (2.0 * y[5:] - x[1]).sum() + 7.0 - y[2] * y[2] * x[0]
        return {"dense": dense, "power": np.asarray([power, -power, x[0] - y[0]], dtype=x.dtype)}

    recorder = Recorder()
    x, y = recorder.inputs("x", (n,)), recorder.inputs("y", (n,))
    program = recorder.finish({"x": n, "y": n}, of(x, y), ())
    assert sum(item.program.length for item in program.items if isinstance(item, Straight)) < 60
    given = {"x": integers(rng, 5, n), "y": integers(rng, 5, n)}
    found = evaluated(program, given)
    for r in range(5):
        for name, expected in of(given["x"][r], given["y"][r]).items():
            assert np.array_equal(found[name][r], expected), name


def test_what_entries_share_is_computed_once():
    """A sine of one number and a comparison with it in every entry; an entry of two vectors that is there already is not computed again."""
    n, rng = 3 * MANY, np.random.default_rng(19)

    def of(t, x):
        wave = sin(t * 3.0)[0]
        return np.where(t[0] < 2.0, x * wave, -x) * 2.0 + x[7] * x[8] * x[::-1]

    recorder = Recorder()
    t, x = recorder.inputs("t", (1,)), recorder.inputs("x", (n,))
    both = of(t, x)
    region = recorder.vector(both)
    assert recorder.vector(both) == region
    assert recorder.vector(both[3:9]) == (region[0], 3)
    total = objects([both.sum() * 1.0])
    program = recorder.finish({"t": 1, "x": n}, {"out": both, "total": total}, ())
    functions = [sum(op == "sin" for op, *_ in code.instructions) for code in program.programs]
    assert sum(functions) == 1
    assert sum("sin" in str(item.program.instructions) for item in program.items if isinstance(item, Straight)) == 1
    given = {"t": np.array([[1.0], [3.0]]), "x": integers(rng, 2, n)}
    found = evaluated(program, given)
    for r in range(2):
        expected = of(given["t"][r], given["x"][r])
        bound = 4 * np.finfo(float).eps * abs(expected).max()
        assert np.allclose(found["out"][r], expected, rtol=0, atol=bound)
        assert abs(found["total"][r, 0] - expected.sum()) < n * bound


def test_several_forests_and_what_goes_from_one_to_the_other():
    wood, other, rng = Wood(9, 40), Wood(10, 70), np.random.default_rng(9)
    other.recorder = wood.recorder
    other.forest = wood.recorder.forest(Forest(other.kinds, other.parents, {"x": other.starts}, other.parameters))
    wood.recorder.inputs("x", (wood.size,))
    y = wood.recorder.inputs("y", (other.size,))

    def step(kind, p, comes, x):
        return (comes[0] + p[0],), x + comes[0]

    z = wood.recorder.gathered(wood.outward(step, (1.0,), wood.field("x")), "x", wood.size)
    shifted = objects([*(z[:30] * 2.0 - y[:30]), *y[30:]])
    region, start = wood.recorder.vector(shifted)
    assert start == 0
    sums = other.inward(sum_step, other.field(region))
    back = wood.outward(step, (3.0,), wood.field(z[0].node[1]))
    column = wood.recorder.column(other.forest, "four", 4 * np.arange(70))
    outputs = {"a": wood.recorder.gathered(flat(sums), column, 280), "b": wood.recorder.gathered(back, "x", wood.size)}
    given = {"x": integers(rng, 2, wood.size), "y": integers(rng, 2, other.size)}
    found = wood.evaluated(outputs, given)
    for r in range(2):
        own = wood.grown(step, (1.0,), [wood.rows(given["x"][r], i) for i in range(40)])
        z = np.concatenate(own)
        mixed = np.concatenate([2 * z[:30] - given["y"][r, :30], given["y"][r, 30:]])
        expected = other.grown(sum_step, (0.0, 0.0), [other.rows(mixed, i) for i in range(70)], inward=True)
        assert np.array_equal(found["a"][r], np.ravel(expected))
        assert np.array_equal(found["b"][r], np.concatenate(wood.grown(step, (3.0,), own)))


# --- anything ---


@pytest.mark.parametrize("seed", range(12))
def test_random_sweeps_one_after_the_other(seed):
    """Random passes, each over what some before it kept. Steps add, and multiply by parameters of ±1: numbers stay small."""
    rng = np.random.default_rng([5, seed])
    wood = Wood(100 + seed, int(rng.integers(1, 40)))
    wood.parameters[:] = [np.sign(p) for p in wood.parameters]
    x = wood.recorder.inputs("x", (max(wood.size, 1),))
    values = integers(rng, 11, len(x))
    fields, known = [wood.field("x")], [[[wood.rows(given, i) for i in range(wood.n)] for given in values]]
    outputs, expected = {}, {}

    def draw():
        """A step that combines what comes and one number of each of two records, differently at each kind."""
        signs, holes = rng.integers(-1, 2, size=(3, 6)), rng.random(3) < 0.2

        def step(kind, p, comes, one, two):
            a, b = comes
            u, w = (r[..., -1] if len(r) else p[0] for r in (one, two))
            on = (a * p[1] + signs[kind][0] * u, b + signs[kind][1] * w if not holes[kind] else 0.0 * b)
            return on, np.array(
                [signs[kind][2] * a + u, w * p[0] + signs[kind][3], b, float(signs[kind][4])][: 1 + (kind + signs[0][5]) % 4], object
            )

        return step

    for _ in range(int(rng.integers(4, 10))):
        one, two = rng.integers(len(fields), size=2)
        step, inward = draw(), rng.random() < 0.5
        fields.append(wood.inward(step, fields[one], fields[two]) if inward else wood.outward(step, (2.0, 0.0), fields[one], fields[two]))
        ground = (0.0, 0.0) if inward else (2.0, 0.0)
        known.append([wood.grown(step, ground, a, b, inward=inward) for a, b in zip(known[one], known[two], strict=True)])
        if rng.random() < 0.4:
            pick, name = int(rng.integers(1, len(fields))), f"out{len(outputs)}"
            lengths = [len(x) for x in known[pick][0]]
            column = wood.recorder.column(wood.forest, name, np.cumsum([0, *lengths])[:-1])
            outputs[name] = wood.recorder.gathered(fields[pick], column, sum(lengths))
            expected[name] = [np.concatenate(x) if sum(lengths) else np.zeros(0) for x in known[pick]]
    total = wood.recorder.total(wood.forest, lambda kind, graph, r: r[0] if len(r) else 1.0, [fields[-1]])
    outputs["total"] = objects([total])
    expected["total"] = [[sum(r[0] if len(r) else 1.0 for r in x)] for x in known[-1]]
    found = wood.evaluated({k: x for k, x in outputs.items() if len(x)}, {"x": values})
    for name, x in found.items():
        assert np.array_equal(x, np.array(expected[name], dtype=float)), name


# --- what is not needed; small forests ---


def test_what_is_not_needed_is_neither_computed_nor_stored():
    def recorded(*, wanted):
        wood = Wood(11, 50, kinds=1)
        x = wood.recorder.inputs("x", (wood.size,))
        field = wood.field(x[0].node[1])
        useful = wood.outward(
            lambda kind, p, comes, x: ((comes[0] + x[0], comes[1] * p[0]), (objects([comes[0]]), comes[1])), (1.0, 2.0), field
        )
        a, b = useful.unzip(2)
        sums = wood.inward(sum_step, field)
        total = wood.recorder.total(wood.forest, lambda kind, graph, r, s: r * s[0], [b, sums])
        outputs = {"a": wood.recorder.gathered(a, "x", 50)} | ({"b": objects([total])} if wanted else {})
        return wood.recorder.finish({"x": wood.size}, outputs, ())

    few, all_of_it = recorded(wanted=False), recorded(wanted=True)
    assert len(loops(few)) == 1
    assert few.length < all_of_it.length / 2
    assert few.size == 50 + 50 + 51  # x, the result, and one number passed on by each node and the ground
    # One addition per node.
    assert few.operations == 50


def test_an_empty_forest_and_a_single_node():
    recorder = Recorder()
    x = recorder.inputs("x", (2,))
    nothing = recorder.forest(Forest(np.zeros(0, dtype=int), np.zeros(0, dtype=int), {"x": np.zeros(0, dtype=int)}, []))
    kept = recorder.sweep(nothing, lambda kind, comes, graph: (comes, comes), [], root=(1.0,))
    back = recorder.sweep(nothing, lambda kind, comes, graph, k: (k, k), [kept], inward=True)
    assert recorder.total(nothing, lambda kind, graph, k: k[0], [back]) == 0
    assert len(recorder.gathered(kept, "x", 0)) == 0
    single = recorder.forest(Forest(np.zeros(1, dtype=int), np.array([-1]), {"x": np.zeros(1, dtype=int)}, [np.array([3.0])]))
    kept = recorder.sweep(single, lambda kind, comes, graph: (comes, comes[0] + graph.node("in", Param(0))), [], root=(1.0,))
    found = evaluated(recorder.finish({"x": 2}, {"out": objects([kept[0] + x[0], x[1]])}, ()), {"x": np.array([[1.0, 2.0], [3.0, 4.0]])})
    assert np.array_equal(found["out"], [[5, 2], [7, 4]])


# --- guards, NaN, bits ---


def guarded(n):
    """A program whose guards are x_k + k > 0, and that ignores the last entry of x."""
    recorder = Recorder()
    x = recorder.inputs("x", (n + 1,))
    return recorder.finish({"x": n + 1}, {"out": x[:n] * 2.0}, [x[k] + float(k) for k in range(n)])


@pytest.mark.parametrize("n", [3, 2 * MANY])
def test_guards(n):
    """The first row of a block that holds a bad one is reported: of a guard, an input, used or not, or an output that overflows."""
    run, x = Kernel(guarded(n)), np.ones((41, n + 1))
    assert run((41,), {"x": x})[1] == -1
    width = kernels.lanes()
    for row, k, value in (
        (0, 0, 0.0),
        (12, 0, 1e308),
        (17, n - 1, -float(n - 1)),
        (40, 1, -5.0),
        (23, 0, np.inf),
        (9, n, np.nan),
        (30, n, -np.inf),
        (31, 1, np.nan),
    ):
        spoilt = x.copy()
        spoilt[row, k] = value
        bad = run((41,), {"x": spoilt})[1]
        assert bad >= 0
        assert bad <= row < bad + width
        assert run((), {"x": spoilt[row]})[1] == 0  # scalar code


def test_constant_guards():
    recorder = Recorder()
    x = recorder.inputs("x", (2,))
    for guards, bad in (([1.0, 2.0], -1), ([1.0, 0.0], 0), ([0.0, 0.0], 0), ([x[0], 1.0], -1), ([np.nan], 0), ([np.inf, 1.0], 0)):
        program = recorder.finish({"x": 2}, {"out": x + 1.0}, guards)
        assert Kernel(program)((), {"x": np.ones(2)})[1] == bad, guards


def irrational(n):
    """A program of real numbers with functions, divisions, sums, several kinds and loops over vectors."""
    wood = Wood(12, n)
    x = wood.recorder.inputs("x", (wood.size,))
    field = wood.field("x")

    def turn(kind, p, comes, x):
        a, b = comes
        angle = x[0] if kind != 2 else p[0]
        return (cos(angle) * a - sin(angle) * b, sin(angle) * a + cos(angle) * b), (a / (b * b + 1.5), x * a if kind != 2 else x)

    kept, scaled = wood.outward(turn, (1.0, 0.25), field).unzip(2)

    def gather(kind, p, comes, k):
        return ((comes[0] + k) * 0.7, comes[1] * k + 0.1), objects([comes[0] / (comes[1] + 3.0)])

    back = wood.inward(gather, kept)
    column = wood.recorder.column(wood.forest, "one", np.arange(n))
    outputs = {"a": wood.recorder.gathered(back, column, n), "b": wood.recorder.gathered(scaled, "x", wood.size) * 1.1 + x}
    return wood.recorder.finish({"x": wood.size}, outputs, ()), wood.size


def test_the_same_bits_from_scalar_and_vector_code_of_any_width_and_any_number_of_threads(monkeypatch):
    program, size = irrational(50)
    x = np.random.default_rng(13).normal(size=(67, size))
    found = {}
    for width in (1, 2, 4, 8):
        monkeypatch.setattr(kernels, "lanes", lambda width=width: width)
        found[width] = evaluated(program, {"x": x})
        if width > 1:
            monkeypatch.setattr(kernels, "WORK", 1)
            run = Kernel(program)
            for threads in (2, 3):
                values, bad = run((67,), {"x": x}, threads)
                assert bad == -1
                assert np.array_equal(values["a"], found[width]["a"])
            monkeypatch.undo()
    for width in (2, 4, 8):
        for name in ("a", "b"):
            assert np.array_equal(found[width][name], found[1][name])


def test_programs_can_be_pickled():
    program, size = irrational(20)
    x = np.random.default_rng(14).normal(size=(3, size))
    again = evaluated(pickle.loads(pickle.dumps(program)), {"x": x})
    assert all(np.array_equal(again[name], found) for name, found in evaluated(program, {"x": x}).items())


def test_code_does_not_grow_with_the_forest():
    def text(n):
        program, _ = irrational(n)
        assert program.length > n
        return blocks.module(program, 8).splitlines()

    small, large = text(200), text(2000)
    assert len(small) == len(large)
    assert sum(a != b for a, b in zip(small, large, strict=True)) < 0.2 * len(small)  # sizes and where things start


def test_fills_write_constants_and_zeros():
    """Short and long, with and without a number in them."""
    recorder = Recorder()
    recorder.inputs("x", (1,))
    wood_n = 40
    forest = recorder.forest(
        Forest(np.zeros(wood_n, dtype=int), np.arange(-1, wood_n - 1), {"x": np.arange(wood_n)}, [np.zeros(0)] * wood_n)
    )
    region = recorder.sparse(wood_n, [])
    fields = [NodeRecords(recorder, forest, [[Entry(region, "x", 0)]], [objects])]
    kept = recorder.sweep(forest, lambda kind, comes, graph, r: ((comes[0] + 1.0,), objects([comes[0] + r[0]])), fields, root=(-6.0,))
    program = recorder.finish({"x": 1}, {"out": recorder.gathered(kept, "x", wood_n)}, ())
    assert sum(isinstance(item, Fill) for item in program.items) == 3  # the ground's block, the region, what the ground passes on
    found = evaluated(program, {"x": np.zeros((2, 1))})["out"]
    assert np.array_equal(found, np.tile(np.arange(wood_n) - 6.0, (2, 1)))


# --- what was recorded is checked ---


@pytest.mark.parametrize(
    ("places", "message"),
    [
        ([Entry("y", "x", 0)], "no region 'y'"),
        ([Entry("x", "z", 0)], "forest 0 has no column 'z'"),
        ([Entry("x", "x", 20)], "region 'x' has 20 entries, and none numbered 39"),
        ([Entry("x", None, -1)], "none numbered -1"),
        ([Param(2)], "kind 0 of forest 0 have 2 parameters, and none numbered 2"),
    ],
)
def test_a_place_that_is_not_there_is_named(places, message):
    wood = Wood(30, 20, kinds=1)
    x = wood.recorder.inputs("x", (20,))
    with pytest.raises(ValueError, match=message):
        NodeRecords(wood.recorder, wood.forest, [places], [objects])
    # And where a step of its own reads it.
    kept = wood.recorder.sweep(wood.forest, lambda kind, comes, graph: ((), graph.node("in", places[0]) * 2.0), [], root=())
    with pytest.raises(ValueError, match=message):
        wood.recorder.finish({"x": 20}, {"out": objects([kept[3] + x[0]])}, ())


def test_a_node_or_a_number_that_is_not_there_is_named():
    wood = Wood(30, 20, kinds=1)
    key = Kept(7, 0, 0)
    with pytest.raises(ValueError, match="no forest 3: 1 were recorded"):
        NodeRecords(wood.recorder, 3, [[Own(key)]], [objects])
    for node, message in (
        (OfNode(3, 0, key), "no forest 3"),
        (OfNode(0, 20, key), "20 nodes, and none numbered 20"),
        (OfNode(0, 0, key), "no sweep over forest 0 stores"),
    ):
        recorder = Recorder()
        recorder.inputs("x", (20,))
        recorder.forest(wood.recorder.forests[0])
        with pytest.raises(ValueError, match=message):
            recorder.finish({"x": 20}, {"out": objects([recorder.graph.node("in", node) * 2.0])}, ())
