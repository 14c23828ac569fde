"""Elementary functions of the kernels, against 60 digits."""

import mpmath
import numpy as np
import pytest

from robodyn import arithmetic
from robodyn.arithmetic.symbols import SymbolArray
from robodyn.engine.emit.large_angles import SMALLEST
from robodyn.engine.emit.trigonometry import EXACT_BEYOND
from robodyn.engine.run.compile import lanes
from robodyn.engine.run.kernel import Kernel
from robodyn.engine.trace.graph import Graph
from robodyn.engine.trace.program import program


def kernel(function, arguments=1):
    graph = Graph()
    x = graph.inputs("x", (arguments,))
    return Kernel(program(graph, {"x": arguments}, {"y": np.atleast_1d(function(*x))}))


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


def nearest_to_quarter_turns(exponent, bits):
    """The numbers m 2^exponent, m of so many bits, closest to a multiple of π/2: by the continued fraction of 2^(exponent+1)/π."""
    with mpmath.workdps(700):
        x, found = mpmath.mpf(2) ** exponent * 2 / mpmath.pi, []
        before, q = 0, 1
        while q < 2**bits:
            if q > 2 ** (bits // 2):
                found.append(q * ((2**bits - 1) // q))  # a multiple is nearly as close
            x = 1 / (x - mpmath.floor(x))
            before, q = q, int(mpmath.floor(x)) * q + before
    return [float(m) * 2.0**exponent for m in found]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_large_angles_are_reduced_exactly(dtype):
    """Where C libraries lose digits, one of them five at 1.6e74: as close to multiples of π/2 as doubles of every size come."""
    kind = np.finfo(dtype)
    exponents = range(17 - kind.nmant, kind.maxexp - kind.nmant, 7 if dtype is np.float64 else 1)
    near = [x for exponent in exponents for x in nearest_to_quarter_turns(exponent, kind.nmant + 1)] + [kind.max]
    if dtype is np.float64:  # Ng, Argument reduction for huge arguments, 1992: the one that comes closest of all
        near += [6381956970095103.0 * 2.0**797, 1.5986289000543612e74]
    xs = np.array(near, dtype=dtype)
    assert np.array_equal(xs, near)
    xs = np.concatenate([xs, -xs, np.random.default_rng(3).uniform(1e5, 2e5, 500).astype(dtype)])
    worst = {}
    for name in ("sin", "cos"):
        found = Kernel(kernel(getattr(arithmetic, name)).program, np.dtype(dtype))
        answers, bad = found((len(xs),), {"x": xs[:, None]})
        assert bad == -1
        assert all(found((1,), {"x": xs[k : k + 1, None]})[0]["y"][0, 0] == answers["y"][k, 0] for k in range(0, len(xs), 97))
        with mpmath.workdps(700):
            references = [getattr(mpmath, name)(mpmath.mpf(float(x))) for x in xs]
            units = [np.spacing(abs(dtype(r))) for r in references]
            values = zip(answers["y"][:, 0], references, units, strict=True)
            worst[name] = max(abs(float((mpmath.mpf(float(y)) - r) / mpmath.mpf(float(u)))) for y, r, u in values)
            smallest = min(abs(r) for r in references)
        assert worst[name] <= 1.0
        assert smallest < (1e-18 if dtype is np.float64 else 1e-8)  # the cases are hard
    assert len(xs) > 500
    assert SMALLEST <= EXACT_BEYOND


def function_arguments(name, rng):
    """Dense, random over the whole range, and at its edges: results subnormal, next to overflow, next to 1 and next to 0."""
    tiny = np.concatenate([10.0 ** rng.uniform(-323, 0, 2000), [5e-324, 2.2250738585072014e-308, 2.0**-53, 2.0**-54]])
    if name == "exp":
        edges = [709.782712893384, -708.3964185322641, -745.1332191019411, -744.4400719213812, 0.34657359027997264, -0.0]
        return np.concatenate([np.linspace(-1, 1, 4001), rng.uniform(-745, 709.7, 8000), rng.uniform(-745, -708, 1000), tiny, -tiny, edges])
    if name == "log":
        near = 1 + rng.choice([-1, 1], 4000) * 2.0 ** rng.uniform(-53, -2, 4000)
        edges = [np.sqrt(0.5), np.sqrt(2), 1.7976931348623157e308, 1.0, 2.0]
        return np.concatenate([np.linspace(0.5, 2, 4001), near, 10.0 ** rng.uniform(-323, 308, 4000), tiny, edges])
    edges = [18.9, 19.0615, 19.07, 22.0, 300.0, 1e308, 0.17328679513998632]
    return np.concatenate([np.linspace(-1, 1, 4001), rng.uniform(-22, 22, 8000), tiny, -tiny, edges])


@pytest.mark.parametrize("name", ["exp", "log", "tanh"])
def test_exp_log_and_tanh_within_one_ulp(name):
    xs = function_arguments(name, np.random.default_rng(3))
    found, bad = kernel(getattr(arithmetic, name))((len(xs),), {"x": xs[:, None]})
    assert bad == -1
    with mpmath.workdps(60):
        references = [getattr(mpmath, name)(mpmath.mpf(float(x))) for x in xs]
    assert ulps(found["y"][:, 0], references).max() <= 1.0


def power_arguments(rng):
    """Results over the whole range, from bases of any size, from bases next to 1, and subnormal ones."""
    wide, near, root = 10.0 ** rng.uniform(-307, 307, 3000), 1 + rng.normal(size=3000) * 1e-5, rng.uniform(0.1, 10, 6000)
    whole = rng.integers(-30, 30, 2000)
    return np.concatenate(
        [
            np.stack([wide, rng.uniform(-1, 1, 3000)], 1),
            np.stack([near, rng.uniform(-6e6, 6e6, 3000)], 1),
            np.stack([root, rng.uniform(-300, 300, 6000)], 1),
            np.stack([-rng.uniform(0.1, 10, 2000), whole], 1),
            np.stack([rng.uniform(2, 3, 500), rng.uniform(-900, -700, 500)], 1),
            [[5e-324, 0.5], [1e-310, -0.9], [2.0, 1023.9999], [2.0, -1074.0], [1.0, 1e300], [10.0, 308.0], [0.9999999999999999, 1e18]],
        ]
    )


def test_pow_within_one_ulp():
    xs = power_arguments(np.random.default_rng(4))
    with mpmath.workdps(60):
        references = [mpmath.mpf(float(x)) ** mpmath.mpf(float(y)) for x, y in xs]
        kept = np.array([abs(float(r)) < np.inf for r in references])
    found, bad = kernel(arithmetic.power, 2)((kept.sum(),), {"x": xs[kept]})
    assert bad == -1
    assert kept.sum() > 14000
    with mpmath.workdps(60):
        assert ulps(found["y"][:, 0], [r for r, k in zip(references, kept, strict=True) if k]).max() <= 1.0


SPECIAL = [0.0, -0.0, 1.0, -1.0, 2.0, -2.0, 0.5, -0.5, 3.0, 1e300, -1e300, 1e-310, 5e-324, 2.0**53 + 2, 746.0, -746.0, 0.1]
SPECIAL += [np.inf, -np.inf, np.nan, 710.0]


@pytest.mark.parametrize(
    "name", ["exp", "log", "tanh", "sign", "expm1", "log1p", "arctan", "absolute", "cbrt", "floor", "ceil", "trunc", "rint"]
)
def test_special_cases_are_numpys(name):
    k = kernel(getattr(np, name))
    for x in SPECIAL:
        agrees(k, np.array([x]), getattr(np, name))


@pytest.mark.parametrize(
    "name",
    ["power", "minimum", "maximum", "arctan2", "hypot", "less", "less_equal", "equal", "not_equal", "greater"],
)
def test_special_pairs_are_numpys(name):
    k = kernel(lambda x, y: 1.0 * getattr(np, name)(x, y), 2)
    for x in SPECIAL:
        for y in SPECIAL:
            if name == "power" and y == 0.5:  # NumPy takes the square root, where C's pow(−∞, ½) is ∞ and pow(−0, ½) is 0
                continue
            if name in ("minimum", "maximum") and x == y == 0:  # NumPy takes either zero
                continue
            agrees(k, np.array([x, y]), lambda a, b: 1.0 * getattr(np, name)(a, b))


@pytest.mark.parametrize("name", ["remainder", "floor_divide"])
def test_remainders_are_numpys(name):
    """But for the sign of zero, in which NumPy's own loops differ."""
    k, rng = kernel(getattr(np, name), 2), np.random.default_rng(8)
    pairs = [(x, y) for x in SPECIAL for y in SPECIAL if abs(x) < 1e100 and 1e-100 < abs(y) < 1e200]
    pairs += [(x, y) for x in (-7.5, -3.0, 3.0, 7.5) for y in (-3.0, -2.5, 2.5, 3.0)]
    xs = np.vstack([pairs, rng.uniform(-20, 20, (500, 2)), np.stack([rng.uniform(-50, 50, 500), np.full(500, 2 * np.pi)], 1)])
    found, bad = k((len(xs),), {"x": xs})
    assert bad == -1
    assert np.array_equal(found["y"][:, 0], getattr(np, name)(*xs.T))
    for special in ([x, y] for x in SPECIAL for y in SPECIAL):
        with np.errstate(all="ignore"):
            expected = getattr(np, name)(*special)
        assert np.array_equal(k((1,), {"x": np.array([special])})[0]["y"].item(), expected, equal_nan=True), special


def test_special_pairs_where_numpy_differs():
    """Annex F of C99 for pow; −0 below 0 for minimum and maximum, in whichever order."""
    for name, x, y, expected in (
        ("power", -np.inf, 0.5, np.inf),
        ("power", -0.0, 0.5, 0.0),
        ("minimum", 0.0, -0.0, -0.0),
        ("minimum", -0.0, 0.0, -0.0),
        ("maximum", 0.0, -0.0, 0.0),
        ("maximum", -0.0, 0.0, 0.0),
    ):
        agrees(kernel(getattr(arithmetic, name), 2), np.array([x, y]), lambda a, b, expected=expected: expected)


def agrees(k, xs, reference):
    """Scalar code, every lane, and NumPy: the same special value with the same sign, or the same number within 1 ulp."""
    with np.errstate(all="ignore"):
        expected = float(reference(*xs))
    n = lanes()  # one block: kernels stop after the first with a number that is not finite
    one, many = k((1,), {"x": xs})[0]["y"], k((n,), {"x": xs})[0]["y"]
    assert np.array_equal(np.repeat(one, n, 0), many, equal_nan=True)
    assert np.array_equal(np.signbit(np.repeat(one, n, 0)), np.signbit(many)) or np.isnan(expected)
    y = float(one[0, 0])
    assert (np.isnan(y) and np.isnan(expected)) or y == expected or abs(y - expected) <= np.spacing(abs(expected)), (xs, y, expected)
    assert np.isnan(expected) or np.signbit(y) == np.signbit(expected)


FLOATS = {
    "exp": (-5, 5),
    "log": (0.1, 9),
    "tanh": (-3, 3),
    "tan": (-1.5, 1.5),
    "arcsin": (-1, 1),
    "arccos": (-1, 1),
    "arctan": (-9, 9),
    "sinh": (-3, 3),
    "cosh": (-3, 3),
    "expm1": (-1, 1),
    "log1p": (-0.9, 3),
    "sign": (-1, 1),
    "sqrt": (0, 9),
    "sin": (-9, 9),
    "cos": (-9, 9),
    "arctan2": (-9, 9),
    "power": (0.1, 9),
    "minimum": (-1, 1),
    "maximum": (-1, 1),
    "cbrt": (-9, 9),
    "hypot": (-9, 9),
    "floor": (-9, 9),
    "ceil": (-9, 9),
    "trunc": (-9, 9),
    "rint": (-9, 9),
    "remainder": (-9, 9),
    "floor_divide": (-9, 9),
}


@pytest.mark.parametrize("name", FLOATS)
def test_one_name_for_three_arithmetics(name):
    """float64, 50 digits and traced: one function of `arithmetic`, the same numbers up to a few roundings of each library."""
    function, rng = getattr(arithmetic, name), np.random.default_rng(5)
    n = getattr(np, name).nin
    xs = rng.uniform(*FLOATS[name], (40, n))
    floats = function(*xs.T)
    assert floats.dtype == float
    with mpmath.workdps(50):
        digits = function(*arithmetic.exact(xs).T)
    found, bad = kernel(function, n)((40,), {"x": xs})
    assert bad == -1
    assert all(isinstance(y, mpmath.mpf) for y in digits)
    for values in (floats, found["y"][:, 0]):
        assert ulps(values, digits).max() <= 4


@pytest.mark.parametrize("convert", [np.asarray, arithmetic.exact])
def test_choices_in_float64_and_50_digits(convert):
    xs = convert(np.array([-2.0, -0.5, 0.0, 0.5, 2.0]))
    inside = arithmetic.logical_and(arithmetic.less_equal(-1.0, xs), arithmetic.less(xs, 1.0))
    assert [float(x) for x in arithmetic.where(inside, xs, 9.0)] == [9.0, -0.5, 0.0, 0.5, 9.0]
    outside = arithmetic.logical_or(arithmetic.logical_not(inside), arithmetic.equal(xs, 0.0))
    assert [bool(c) for c in outside] == [True, False, True, False, True]
    assert [float(x) for x in arithmetic.clip(xs, -1.0, 1.0)] == [-1.0, -0.5, 0.0, 0.5, 1.0]


@pytest.mark.parametrize("name", ["sin", "cos", "sqrt", "exp", "log", "tanh", "arctan", "log1p"])
def test_scalar_and_vector_code_give_the_same_bits(name):
    rng = np.random.default_rng(2)
    xs = rng.uniform(0.01, 20, 101) if name in ("sqrt", "log", "log1p") else rng.uniform(-20, 20, 101)
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


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_copysign_is_numpys_on_every_pair_and_lane(dtype):
    special = np.array([0.0, -0.0, 1.5, -1.5, np.inf, -np.inf, np.nan, -np.nan, 1e-30, -1e30])
    xs = np.array([(a, b) for a in special for b in special], dtype=dtype)
    graph = Graph()
    x = graph.inputs("x", (2,)).view(SymbolArray)
    run = Kernel(program(graph, {"x": 2}, {"y": np.atleast_1d(np.copysign(x[0], x[1]))}), dtype)
    finite = xs[np.isfinite(xs).all(1)]  # a batch ends at the first number that is not
    for rows in (finite, *xs[:, None]):
        found, expected = run((len(rows),), {"x": rows})[0]["y"][:, 0], np.copysign(rows[:, 0], rows[:, 1])
        assert np.array_equal(found, expected, equal_nan=True)
        assert (np.signbit(found) == np.signbit(expected)).all()


def test_copysign_of_floats_objects_and_constants():
    """One record is all it takes: NumPy's name, the method, folding, and mpmath's numbers."""
    graph = Graph()
    x = graph.inputs("x", (1,)).view(SymbolArray)
    assert np.copysign(2.0, x)[0].node[0] == np.copysign(x, -0.0)[0].node[0] == "copysign"
    assert np.copysign(graph.constant(2.0), -0.0).constant == -2.0
