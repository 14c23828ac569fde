"""Physical identities on 50 seeded random trees: serial and branched, all joint types, generic inertias, O ≠ S.

Tolerances are c·κ·eps: κ the condition number of M̂ where a linear system with it was solved, 1 where only sums and products were taken;
c counts the roundings, a few per body on the way from the ground to the leaves.
"""

import mpmath
import numpy as np
import pytest
from tools import EPS, ROUTES, SEEDS, case, condition, derivative, error, many_digits

import robodyn as rd
from robodyn.formalism import constraints, kinematics
from robodyn.formalism.kinematics import motion
from robodyn.formalism.newton_euler import bias_resultants
from robodyn.formalism.reactions import joint_wrenches
from robodyn.random import MIXED


@pytest.fixture
def fifty_digits():
    """The test's own sums and products in 50 digits; robodyn sets its precision itself."""
    with mpmath.workdps(50):
        yield


ALL = pytest.mark.parametrize("seed", SEEDS)
C = 50  # roundings along a path of up to 8 bodies, each a product of 3 × 3 matrices


@ALL
def test_four_routes_agree(seed):
    c = case(seed)
    found = {route: c.reference.forward_dynamics(c.q, c.v, c.tau, formalism=route) for route in ROUTES}
    tolerance = C * condition(c.robot, c.q) * EPS
    for route in ROUTES[1:]:
        assert error(found[route], found["recursive"]) < tolerance, route


@ALL
def test_B_J_equals_C(seed):
    c = case(seed)
    tree = rd.Scene(c.robot).equations(opened=True).tree
    state = motion(tree, c.q, c.v)
    B, C_, J = (f(tree, state, np.dtype(float)) for f in (constraints.B_matrix, constraints.C_matrix, constraints.J_matrix))
    n = len(tree.bodies)
    assert error(B @ J, C_) < C * EPS * max(1.0, abs(J).max())
    assert np.array_equal(B, np.tril(B))
    assert np.array_equal(B[np.arange(6 * n), np.arange(6 * n)], np.ones(6 * n))
    assert error(J @ c.v, np.concatenate(state.twist)) < C * EPS


@ALL
def test_constraint_wrenches_do_no_work(seed):
    """Cᵀ f̌ᵖ = 0 and Jᵀ f̌ᵏ = 0, eqs. (16), (17), for wrenches that come from η̇ by the sweeps."""
    c = case(seed)
    scene = rd.Scene(c.robot)
    tree = scene.equations(opened=True).tree
    state = motion(tree, c.q, c.v)
    f_p = c.reference.reactions(c.q, c.v, c.tau).array.reshape(-1)
    total = c.reference.reactions(c.q, c.v, c.tau, part="total").array
    C_, B, J = (f(tree, state, np.dtype(float)) for f in (constraints.C_matrix, constraints.B_matrix, constraints.J_matrix))
    tolerance = C * condition(c.robot, c.q) * EPS * abs(total).max()
    assert abs(C_.T @ f_p).max() < tolerance
    assert abs(J.T @ (B.T @ f_p)).max() < tolerance * max(1.0, abs(J).max())


@ALL
def test_reactions_are_the_multipliers_of_the_saddle_point(seed):
    """f̌ᵖ of eq. (18) and f̌ᵏ of eq. (19), where they are unknowns, are what the sweeps recover from η̇."""
    from robodyn.formalism.saddle import saddle_body, saddle_joint

    c = case(seed)
    scene = rd.Scene(c.robot)
    state = scene.equations(opened=True).state(0.0, c.q, c.v)
    tree, u = state.tree, scene.equations().applied(scene.equations().state(0.0, c.q, c.v), c.tau).u
    f_p = c.reference.reactions(c.q, c.v, c.tau).array.reshape(-1)
    tolerance = C * condition(c.robot, c.q) * EPS
    a, multipliers, _ = saddle_joint(state, u, {}, np.array(scene.gravity))
    assert error(f_p, multipliers) < tolerance
    a_body, resultants, _ = saddle_body(state, u, {}, np.array(scene.gravity))
    B = constraints.B_matrix(tree, state.motion, np.dtype(float))
    assert error(B.T @ f_p, resultants) < tolerance
    assert error(a, a_body) < tolerance


@ALL
def test_joint_wrenches_from_those_without_acceleration(seed):
    """f̌ᵏ(η̇) = f̌ᵏ(0) + M J η̇, on bodies that turn and carry loads: what the minimal form shares is what Newton and Euler say."""
    c = case(seed)
    equations = rd.Scene(c.robot).equations(opened=True)
    rng = np.random.default_rng([seed, 5])
    wrenches = {i: rng.normal(size=6) for i in range(len(equations.tree.bodies))}
    state = motion(equations.tree, c.q, c.v)
    gravity = np.array((0, 0, -9.81))
    ways = (None, bias_resultants(equations.tree, state, wrenches, gravity))
    whole, parts = (joint_wrenches(equations.tree, state, c.a, wrenches, gravity, resting=way) for way in ways)
    assert error(np.array(parts), np.array(whole)) < C * EPS


@ALL
def test_forward_after_inverse_is_the_identity(seed):
    c = case(seed)
    tau = c.reference.inverse_dynamics(c.q, c.v, c.a)
    for route in ROUTES:
        # Errors of tau, relative to tau, pass through M̂⁻¹.
        M = c.reference.mass_matrix(c.q)
        bound = C * EPS * (np.linalg.norm(np.linalg.inv(M), 2) * np.linalg.norm(tau) + condition(c.robot, c.q) * np.linalg.norm(c.a))
        assert np.linalg.norm(c.reference.forward_dynamics(c.q, c.v, tau, formalism=route) - c.a) < bound, route


@ALL
def test_mass_matrix_is_symmetric_positive_definite_and_J_M_J(seed):
    c = case(seed)
    M = c.reference.mass_matrix(c.q)
    assert error(M, M.T) < C * EPS
    assert np.linalg.eigvalsh(M).min() > 0

    # JᵀMJ written out, and the columns that inverse dynamics gives.
    from robodyn.formalism.saddle import Saddle

    state = rd.Scene(c.robot).equations().state(0.0, c.q, c.v)
    s = Saddle(state, np.zeros(state.tree.nu), {}, np.zeros(3))
    assert error(s.J.T @ s.M @ s.J, M) < C * EPS
    bias = c.reference.bias_forces(c.q, c.v)
    columns = c.reference.inverse_dynamics(c.q, c.v, np.eye(c.robot.nv)) - bias
    assert np.allclose(columns, M, rtol=0, atol=C * EPS * max(abs(bias).max(), abs(M).max()))
    assert np.isclose(c.reference.kinetic_energy(c.q, c.v), c.v @ M @ c.v / 2, rtol=C * EPS)


@ALL
def test_gravity_is_the_gradient_of_the_potential(seed):
    """g(q)ᵀ v = dV/dt at rest, along every velocity direction, by differences in 50 digits."""
    c = case(seed, n=4)
    q, zero = many_digits(c.q), np.zeros(c.robot.nv)
    gravity = (0.3, -1.7, -9.81)
    g = c.reference.bias_forces(c.q, zero, gravity=gravity, backend="mpmath")
    equations = rd.Scene(c.robot).equations()
    for k in range(c.robot.nv):
        direction = equations.rate(c.q, np.eye(c.robot.nv)[k])
        slope = derivative(lambda x: c.reference.potential_energy(x, gravity=gravity, backend="mpmath"), q, many_digits(direction))
        # The direction is a float64 array: its rounding is the only error left.
        assert abs(slope - g[k]) < C * EPS * max(1.0, float(abs(g).max()))


@ALL
def test_power_is_the_rate_of_energy(seed, fifty_digits):
    """d/dt (T + V) = ηᵀ τ along the motion, by differences in 50 digits."""
    c = case(seed, n=5)
    q, v, tau = (many_digits(x) for x in (c.q, c.v, c.tau))
    vdot = c.reference.forward_dynamics(q, v, tau, backend="mpmath", formalism=("recursive", "nonrecursive")[seed % 2])
    with mpmath.workdps(50):
        qdot = rd.Scene(c.robot).equations("mpmath").rate(q, v)

    def energy(x):
        q, v = x[: c.robot.nq], x[c.robot.nq :]
        return c.reference.kinetic_energy(q, v, backend="mpmath") + c.reference.potential_energy(q, backend="mpmath")

    slope = derivative(energy, np.concatenate([q, v]), np.concatenate([qdot, vdot]))
    assert abs(slope - tau @ v) < 1e-25 * max(1, abs(tau @ v))


@pytest.mark.parametrize("seed", range(20))
def test_Mdot_minus_2C_is_skew(seed, fifty_digits):
    """With C from the Christoffel symbols: C e_k = ½ (c(η + e_k) − c(η) − c(e_k)), c the bias without gravity.

    Coordinates must be true ones (β̇ = η) for the symbols to be symmetric: no spherical or free joints here.
    """
    c = case(seed, n=4, joint_types=("revolute", "continuous", "prismatic", "planar", "fixed"), floating_base=False)
    q, v, n = many_digits(c.q), many_digits(c.v), c.robot.nv

    def bias(v):
        return c.reference.bias_forces(q, v, gravity=(0.0, 0.0, 0.0), backend="mpmath")

    columns = [(bias(v + e) - bias(v) - bias(e)) / 2 for e in many_digits(np.eye(n))]
    Mdot = derivative(lambda x: c.reference.mass_matrix(x, backend="mpmath"), q, v)
    N = Mdot - 2 * np.stack(columns, axis=-1)
    assert abs(N + N.T).max() < 1e-25 * max(1, abs(N).max())
    if seed == 0:
        assert abs(N).max() > 0.1  # it is not skew because it is nothing


@ALL
def test_accelerations_are_the_rates_of_velocities(seed):
    """ǎ_i is the time derivative of the velocity of O_i and of the angular velocity, taken in the ground's frame, in 50 digits."""
    from robodyn.arithmetic.vectors import mul

    c = case(seed, n=5)
    with mpmath.workdps(50):
        equations = rd.Scene(c.robot).equations("mpmath")
        tree, q, v, a = equations.tree, many_digits(c.q), many_digits(c.v), many_digits(c.a)

        def velocities(x):
            state = motion(tree, x[: tree.nq], x[tree.nq :])
            world = kinematics.world_poses(tree, state.pose)
            return np.concatenate([np.concatenate([mul(X.R, t[:3]), mul(X.R, t[3:])]) for X, t in zip(world, state.twist, strict=True)])

        state = motion(tree, q, v)
        world = kinematics.world_poses(tree, state.pose)
        swept = kinematics.accelerations(tree, state, np.zeros(6), a)
        expected = np.concatenate([np.concatenate([mul(X.R, x[:3]), mul(X.R, x[3:])]) for X, x in zip(world, swept, strict=True)])
        slope = derivative(velocities, np.concatenate([q, v]), np.concatenate([kinematics.rate(tree, q, v), a]))
    assert error(slope, expected) < 1e-25


@ALL
def test_momentum_changes_by_what_acts_from_outside(seed, fifty_digits):
    """For a free base without gravity the rate of momentum is zero; on the ground it is the reaction there."""
    c = case(seed, n=5)
    q, v, tau = (many_digits(x) for x in (c.q, c.v, c.tau))
    none = (0.0, 0.0, 0.0)
    if c.robot.joints[0].type.nv:
        tau[:6] = 0
    vdot = c.reference.forward_dynamics(q, v, tau, gravity=none, backend="mpmath")
    with mpmath.workdps(50):
        qdot = rd.Scene(c.robot).equations("mpmath").rate(q, v)
    h = derivative(
        lambda x: c.reference.momentum(x[: c.robot.nq], x[c.robot.nq :], backend="mpmath"),
        np.concatenate([q, v]),
        np.concatenate([qdot, vdot]),
    )
    if c.robot.joints[0].type.nv:
        assert abs(h).max() < 1e-25
    else:
        ground = c.reference.reactions(q, v, tau, gravity=none, backend="mpmath")["ground"]
        assert error(h, ground) < 1e-25


@ALL
def test_float64_against_50_digits(seed):
    c = case(seed)
    exact = c.reference.forward_dynamics(c.q, c.v, c.tau, backend="mpmath")
    tolerance = C * condition(c.robot, c.q) * EPS
    for route in ROUTES:
        assert error(c.reference.forward_dynamics(c.q, c.v, c.tau, formalism=route), exact) < tolerance, route
    assert error(c.reference.inverse_dynamics(c.q, c.v, c.a), c.reference.inverse_dynamics(c.q, c.v, c.a, backend="mpmath")) < C * EPS
    assert error(c.reference.mass_matrix(c.q), c.reference.mass_matrix(c.q, backend="mpmath")) < C * EPS
    assert error(c.reference.link_poses(c.q), c.reference.link_poses(c.q, backend="mpmath")) < C * EPS
    exact = c.reference.reactions(c.q, c.v, c.tau, backend="mpmath").array
    assert error(c.reference.reactions(c.q, c.v, c.tau).array, exact) < tolerance


@pytest.mark.parametrize("seed", range(8))
def test_the_routes_are_the_same_in_50_digits(seed):
    """In 50 digits nothing is left of rounding: the four routes solve the same equations."""
    c = case(seed, n=3)
    found = [c.reference.forward_dynamics(c.q, c.v, c.tau, backend="mpmath", formalism=route) for route in ROUTES]
    assert max(error(x, found[0]) for x in found) < 1e-40


@ALL
def test_batches_are_their_states(seed):
    """Leading dimensions change nothing but the shape: every state of a batch is what it is alone, to the last bits."""
    c = case(seed)
    rng = np.random.default_rng(seed)
    q = np.stack([[c.robot.random_state(rng)[0] for _ in range(3)] for _ in range(2)])
    v, tau, a = (rng.normal(size=(2, 3, c.robot.nv)) for _ in range(3))
    for route in ROUTES:
        batch = c.reference.forward_dynamics(q, v, tau, formalism=route)
        assert batch.shape == (2, 3, c.robot.nv)
        for i in np.ndindex(2, 3):
            tolerance = C * condition(c.robot, q[i]) * EPS
            assert error(batch[i], c.reference.forward_dynamics(q[i], v[i], tau[i], formalism=route)) < tolerance
    r = c.reference.reactions(q, v, tau, frame="world")
    assert r.array.shape == (2, 3, len(c.robot.joints), 6)
    single = c.reference.reactions(q[1, 2], v[1, 2], tau[1, 2], frame="world")
    assert error(r.array[1, 2], single.array) < C * condition(c.robot, q[1, 2]) * EPS
    assert error(c.reference.mass_matrix(q)[1, 0], c.reference.mass_matrix(q[1, 0])) < C * EPS
    assert error(c.reference.inverse_dynamics(q, v, a)[0, 2], c.reference.inverse_dynamics(q[0, 2], v[0, 2], a[0, 2])) < C * EPS
    assert c.reference.link_poses(q).shape == (2, 3, len(c.robot.links), 4, 4)
    assert c.reference.kinetic_energy(q, v).shape == c.reference.potential_energy(q).shape == (2, 3)
    assert c.reference.momentum(q, v).shape == (2, 3, 6)


@pytest.mark.parametrize("kinds", [("prismatic",), ("revolute", "prismatic", "planar"), MIXED])
def test_states_in_50_digits_one_by_one_and_together(kinds):
    """Leading dimensions mean the same in every arithmetic, where poses turn with the state and where they do not."""
    rng = np.random.default_rng(len(kinds))
    robot = rd.random_robot(rng, 5, joint_types=kinds, floating_base=True)
    q, v = map(np.array, zip(*(robot.random_state(rng) for _ in range(3)), strict=True))
    for route in ("recursive", "nonrecursive"):
        together = robot.forward_dynamics(q, v, v, backend="mpmath", formalism=route)
        alone = np.stack([robot.forward_dynamics(*state, state[1], backend="mpmath", formalism=route) for state in zip(q, v, strict=True)])
        assert error(together, alone) < 1e-40
