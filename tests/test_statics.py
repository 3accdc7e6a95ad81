"""Static equilibria against the exact elastica, and against figures that others have published.

The exact shapes are those of inextensible rods. The arms here resist stretch with EA = 1e7 EI/L^2,
so that loads of 10 EI/L^2 stretch them by 1e-6: below what the tests ask for, and still far enough
from the round-off of the stretching forces, EA/l times 2e-16 = 1e-7 EI/L^2 on the finest mesh.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from crinoid.dynamics.statics import still
from crinoid.elements import DistributedLoad, TipLoad
from crinoid.flow import Uniform
from physics import always, arm, order

MESHES = (11, 21, 41)
EA = 1e7
FLOOR = 4e-7
"""A few times the round-off of the stretching forces (N)."""
UPRIGHT = np.pi / 2

equilibrium = eqx.filter_jit(lambda system: system.equilibrium())


def loaded(
    nodes,
    *,
    dead=(0.0, 0.0),
    follower=(0.0, 0.0),
    moment=0.0,
    tangential=0.0,
    normal=0.0,
    fixed=(0.0, 0.0),
    current=(0.0, 0.0),
    **changes,
):
    """Build an arm of unit length and stiffness; always of the same elements, compiled once.

    The density and diameter of water and arm make the drag of a broadside current |u| u per
    length.
    """
    settings = {
        "EA": EA,
        "floor": FLOOR,
        "water_density": 1.0,
        "diameter": 2.0,
        "drag_normal": 1.0,
        "drag_tangential": 0.0,
    }
    return arm(
        nodes=nodes,
        loads=(
            lambda rod: DistributedLoad.of(
                rod, tangential=tangential, normal=normal, fixed=jnp.asarray(fixed)
            ),
            lambda rod: TipLoad.of(
                rod,
                dead_force=jnp.asarray(dead),
                follower_force=jnp.asarray(follower),
                moment=moment,
            ),
        ),
        flows=(Uniform(always(), jnp.asarray(current, float)),),
        **settings | changes,
    )


class Shape(NamedTuple):
    """What is compared of a shape of unit length."""

    x: float
    z: float
    angle: float
    """Direction at the tip, from +x toward +z (rad)."""
    reach: float
    """Integral of the cubed sine of the direction: the share of the length that a current feels
    (the effective length of Luhar and Nepf 2011)."""


def solve(nodes, **case):
    """Return the shape of an arm in equilibrium, which must be found."""
    system = loaded(nodes, **case)
    state, outcome = equilibrium(system)
    assert outcome.converged
    x, z, angle = np.asarray(system.tip(state))
    edges = np.diff(np.asarray(state.position)[1:], axis=0)
    sine = edges[:, 1] / np.hypot(*edges.T)
    return Shape(x, z, angle, np.mean(sine**3))


def elastica(
    bracket: tuple[float, float],
    *,
    tilt: float = 0.0,
    dead=(0.0, 0.0),
    follower=(0.0, 0.0),
    moment: float = 0.0,
    distributed: Callable = lambda angle: (0.0, 0.0),
    stiffness: Callable = lambda s: 1.0,
    rest_curvature: float = 0.0,
) -> Shape:
    """Solve the boundary-value problem of an inextensible rod by shooting from its tip.

    EI (theta' - rest curvature) = M, M' = -t x n, n' = -load; at the tip M and n are the tip's
    load, at the root theta is the tilt. The direction at the tip, sought within the bracket, is
    the only unknown.
    """

    def rates(s, y):
        theta, bending, along_x, along_z = y[:4]
        c, s_ = np.cos(theta), np.sin(theta)
        load_x, load_z = distributed(theta)
        turn = bending / stiffness(s) + rest_curvature
        return [turn, s_ * along_x - c * along_z, -load_x, -load_z, c, s_, s_**3]

    def shoot(angle):
        c, s = np.cos(angle), np.sin(angle)
        end_x = dead[0] + c * follower[0] - s * follower[1]
        end_z = dead[1] + s * follower[0] + c * follower[1]
        start = [angle, moment, end_x, end_z, 0.0, 0.0, 0.0]
        done = solve_ivp(rates, (1.0, 0.0), start, method="DOP853", rtol=1e-12, atol=1e-13)
        return done.y[:, -1]

    angle = brentq(lambda a: shoot(a)[0] - tilt, *bracket, xtol=1e-13, rtol=1e-14)
    root = shoot(angle)
    return Shape(-root[4], -root[5], angle, -root[6])


def converge(exact, *, digits=1e-5, orders=(1.8, 2.2), **case):
    """Solve on all meshes: the error falls with order 2, its leading terms removed it is small.

    The ends of the arm add a term of order 3, so that both are taken out (Richardson).
    """
    exact = np.asarray(exact)
    shapes = np.array([solve(nodes, **case) for nodes in MESHES])
    errors = np.linalg.norm(shapes - exact, axis=1)
    print("orders", order(errors), end=" ")
    once = shapes[1:] + (shapes[1:] - shapes[:-1]) / (2**2 - 1)
    limit = once[1] + (once[1] - once[0]) / (2**3 - 1)
    print("limit error", np.abs(limit - exact).max(), "finest", errors[-1])
    assert ((orders[0] < order(errors)) & (order(errors) < orders[1])).all()
    np.testing.assert_allclose(limit, exact, rtol=0, atol=digits)


# Clamped, horizontal, dead force down at the tip, a = P L^2 / EI: tip angle, drop, shortening.
# Mattiasson, Int. J. Numer. Methods Eng. 17 (1981) 145-153, from elliptic integrals.
MATTIASSON = {
    1: (0.461352, 0.301721, 0.056433),
    2: (0.781750, 0.493457, 0.160642),
    5: (1.215368, 0.713792, 0.387628),
    10: (1.430286, 0.810609, 0.554996),
}
# Clamped, horizontal, own weight w L^3 / EI: drop, shortening (two-point problem, to 1e-9).
OWN_WEIGHT = {1: (0.123471, 0.008754), 5: (0.495905, 0.153343), 10: (0.700200, 0.343646)}


@pytest.mark.parametrize("load", MATTIASSON)
def test_dead_tip_load(load):
    angle, drop, shortening = MATTIASSON[load]
    exact = elastica((-UPRIGHT + 1e-9, -0.1), dead=(0.0, -load))
    np.testing.assert_allclose(
        (-exact.angle, -exact.z, 1 - exact.x), (angle, drop, shortening), rtol=0, atol=6e-7
    )
    converge(exact, dead=(0.0, -load), digits=2e-5)


def test_oblique_dead_tip_load():
    # 3.7 EI/L^2, 30 degrees beyond the vertical: the force also pushes back on the arm
    dead = 3.7 * np.array([np.cos(np.deg2rad(-120)), np.sin(np.deg2rad(-120))])
    converge(elastica((np.deg2rad(-119.9), -0.2), dead=dead), dead=dead)


@pytest.mark.parametrize("load", [1, 3.3, 5, 10])
def test_own_weight(load):
    exact = elastica((-UPRIGHT + 1e-9, -0.05), distributed=lambda angle: (0.0, -load))
    if load in OWN_WEIGHT:
        np.testing.assert_allclose((-exact.z, 1 - exact.x), OWN_WEIGHT[load], rtol=0, atol=6e-7)
    converge(exact, gravity=load)


@pytest.mark.parametrize("turns", [0.5, 1.0, -1.0])
def test_end_moment_bends_a_circle(turns):
    # M = 2 pi EI/L: the arm closes; half of it: half a circle of radius L/pi
    angle = 2 * np.pi * turns
    exact = np.array([np.sin(angle), 1 - np.cos(angle)]) / angle
    errors = []
    for nodes in MESHES:
        x, z, direction, _ = solve(nodes, moment=angle)
        turned = np.unwrap([angle, direction])[1]
        errors.append(np.linalg.norm([x - exact[0], z - exact[1], turned - angle]))
    print("orders", order(errors), errors)
    assert (abs(order(errors) - 2) < 0.2).all()


def test_tapered_arm_under_a_tip_load():
    # a cone from a radius of 1 mm to half of it: EI falls to a sixteenth; E makes EI 1 at the root
    root, tip = 1e-3, 0.5e-3
    modulus = 4 / (np.pi * root**4)

    def stiffness(s):
        return (1 + (tip / root - 1) * s) ** 4

    exact = elastica((-UPRIGHT + 1e-9, -0.1), dead=(0.0, -1.5), stiffness=stiffness)
    # EA is that of the section, 4e6 EI/L^2 at the root and a quarter of it at the tip
    section = {"EA": None, "EI": None, "radius": jnp.asarray([root, tip])}
    converge(exact, dead=(0.0, -1.5), youngs_modulus=modulus, mass_per_length=1.0, **section)


@pytest.mark.parametrize("load", [2.0, 6.0])
def test_follower_tip_load(load):
    exact = elastica((0.1, 4.0), follower=(0.0, load))
    converge(exact, follower=(0.0, load))


def test_tip_force_and_moment_together():
    exact = elastica((-1.0, 2.0), dead=(0.5, -2.0), moment=2.2)
    converge(exact, dead=(0.5, -2.0), moment=2.2)


def test_curved_arm_without_load_keeps_its_shape():
    curvature, tilt = 2.0, 0.4
    exact = elastica((0.0, 5.0), tilt=tilt, rest_curvature=curvature)
    # a circular arc of 2 rad
    arc = (np.sin(tilt + 2) - np.sin(tilt)) / 2, (np.cos(tilt) - np.cos(tilt + 2)) / 2, tilt + 2
    np.testing.assert_allclose(exact[:3], arc, rtol=0, atol=1e-11)
    converge(exact, tilt=tilt, rest_curvature=curvature)
    system = loaded(11, tilt=tilt, rest_curvature=curvature)
    state, _ = equilibrium(system)
    np.testing.assert_allclose(state.position[1:], system.rod.rest_shape(tilt), rtol=0, atol=1e-12)


def test_curved_arm_under_load():
    exact = elastica((-1.5, 1.9), rest_curvature=2.0, dead=(0.0, -1.0))
    converge(exact, rest_curvature=2.0, dead=(0.0, -1.0))


# Upright blade of neutral weight in a steady current, normal drag only (the model of Luhar and
# Nepf, Limnol. Oceanogr. 56 (2011) 2003-2017). Ca = 1/2 rho C_d d U^2 L^3/EI; B = buoyancy per
# length times L^3/EI: effective length, tip angle from upright in degrees.
BLADES = {
    (1, 0): (0.97483, 9.31),
    (10, 0): (0.52361, 47.09),
    (1, 10): (0.99508, 3.98),
    (10, 10): (0.74471, 30.69),
}


@pytest.mark.parametrize(("cauchy", "buoyancy"), BLADES)
def test_blade_in_a_current(cauchy, buoyancy):
    def distributed(angle):
        # normal drag on a resting arm, w_n = U sin(angle) across it; and buoyancy
        drag = cauchy * np.sin(angle) * abs(np.sin(angle))
        return drag * np.sin(angle), -drag * np.cos(angle) + buoyancy

    exact = elastica((0.1, UPRIGHT), tilt=UPRIGHT, distributed=distributed)
    effective_length, leaning = BLADES[cauchy, buoyancy]
    np.testing.assert_allclose(exact.reach, effective_length, rtol=0, atol=6e-6)
    np.testing.assert_allclose(90 - np.rad2deg(exact.angle), leaning, rtol=0, atol=6e-3)
    # a mass of 1 per length displaces 1 + B of water of density 1, under a gravity of 1
    converge(
        exact,
        tilt=UPRIGHT,
        gravity=1.0,
        displaced_area=1.0 + buoyancy,
        current=(np.sqrt(cauchy), 0.0),
    )


LIMP = np.deg2rad(38.173)
"""From the vertical: normal drag r cos^2 = sin for r = 1/2 rho C_d d U^2 / w = 1, which the golden
section solves."""


def test_limp_chain_in_a_current():
    np.testing.assert_allclose(np.sin(LIMP), (np.sqrt(5) - 1) / 2, atol=1e-5)
    exact = np.arcsin((np.sqrt(5) - 1) / 2)
    # hinged at its root it is straight whatever its stiffness
    system = loaded(11, tilt=-UPRIGHT, pinned=True, EI=1e-3, gravity=1.0, current=(1.0, 0.0))
    state, outcome = equilibrium(system)
    assert outcome.converged
    edges = np.diff(np.asarray(state.position)[1:], axis=0)
    np.testing.assert_allclose(np.arctan2(edges[:, 0], -edges[:, 1]), exact, rtol=0, atol=1e-5)


@pytest.mark.parametrize("current", [1.0, -1.0])
def test_almost_limp_clamped_chain_in_a_current(current):
    # EI = 1e-4 w L^3: bent in a boundary layer of sqrt(EI / T) = L/100 at the clamp
    system = loaded(
        41, tilt=-UPRIGHT, EI=1e-4, EA=1e5, floor=None, gravity=1.0, current=(current, 0.0)
    )
    state, outcome = equilibrium(system)
    assert outcome.converged
    edges = np.diff(np.asarray(state.position)[1:], axis=0)
    angle = np.arctan2(current * edges[:, 0], -edges[:, 1])
    np.testing.assert_allclose(angle[20:], LIMP, rtol=0, atol=1e-4)


tangent = eqx.filter_jit(
    lambda system, position: system.forces.tangent(
        still(jnp.zeros(()), position),
        system.forces.motion(still(jnp.zeros(()), position), jnp.zeros_like(position)),
    )
)


def dense(bands):
    """Write the bands of the free nodes out as a matrix with axes node, unknown, node, unknown."""
    bands = np.asarray(bands)[2:]
    n, _, b, _ = bands.shape
    matrix = np.zeros((n, b, n, b))
    for i in range(n):
        for d in range(max(0, 2 - i), min(5, n + 2 - i)):
            matrix[i, :, i + d - 2] = bands[i, d]
    return matrix


def standing(nodes, *, tip=0.0, own=0.0):
    """Return a column that bears loads, straight and compressed, and its sideways stiffness."""
    system = loaded(nodes, tilt=UPRIGHT, dead=(0.0, -tip), gravity=own)
    carried = np.full(nodes - 1, tip) + own * (1 - (np.arange(nodes - 1) + 0.5) / (nodes - 1))
    edges = (1 - carried / EA) / (nodes - 1)
    position = np.zeros((nodes + 1, 2))
    position[0, 1] = -1 / (nodes - 1)
    position[2:, 1] = np.cumsum(edges)
    position = jnp.asarray(position)
    residual, _ = balance(system, position)
    # it is in balance indeed, but for the round-off of its stretching forces
    np.testing.assert_allclose(residual[2:], 0, atol=FLOOR)
    matrix = dense(tangent(system, position))
    np.testing.assert_allclose(matrix, matrix.transpose(2, 3, 0, 1), atol=1e-12 * matrix.max())
    # sideways and lengthwise do not couple
    np.testing.assert_allclose(matrix[:, 0, :, 1], 0, atol=1e-6 * abs(matrix[:, 0, :, 0]).max())
    return position, matrix[:, 0, :, 0]


balance = eqx.filter_jit(
    lambda system, position: system.forces.residual(
        system.forces.motion(still(jnp.zeros(()), position), jnp.zeros_like(position))
    )
)

# Euler: pi^2 / 4. Greenhill (1881): a standing arm buckles under its own weight where
# w L^3 / EI is 9/4 of the square of the first zero of the Bessel function J_{-1/3}: 7.837347.
CRITICAL = {"tip": np.pi**2 / 4, "own": 7.837347}


@pytest.mark.parametrize("kind", CRITICAL)
def test_buckling_load(kind):
    def stiffness(load, nodes):
        return np.linalg.eigvalsh(standing(nodes, **{kind: load})[1])[0]

    exact = CRITICAL[kind]
    loads = np.array(
        [brentq(stiffness, 0.9 * exact, 1.1 * exact, (nodes,), xtol=1e-9) for nodes in MESHES]
    )
    errors = abs(loads - exact)
    print(kind, loads, order(errors))
    assert (abs(order(errors) - 2) < 0.1).all()
    once = loads[1:] + (loads[1:] - loads[:-1]) / 3
    np.testing.assert_allclose(once[1] + (once[1] - once[0]) / 15, exact, rtol=2e-6)


def stored(system, state, tip):
    """Return elastic and potential energy, that of the tip's dead load included (J)."""
    _, elastic, potential = np.asarray(state.energy)
    return elastic + potential + tip * float(system.tip(state)[1])


@pytest.mark.parametrize("kind", CRITICAL)
def test_column_leaves_the_straight_past_its_buckling_load(kind):
    load = 1.1 * CRITICAL[kind]
    system = loaded(21, tilt=UPRIGHT, **forces_of(kind, load))
    state, outcome = equilibrium(system)
    assert outcome.converged
    position, _ = standing(21, **{kind: load})
    straight = eqx.filter_jit(lambda s, p: s._begin(jnp.zeros(()), p))(system, position)
    tip = load if kind == "tip" else 0.0
    assert stored(system, state, tip) < stored(system, straight, tip) - 1e-3
    # and it is stable where it went
    matrix = dense(tangent(system, state.position))
    free = matrix.shape[0] * 2
    assert np.linalg.eigvalsh(matrix.reshape(free, free))[0] > 0
    # it leans to either side: the exact shape, mirrored if need be
    x, z, angle, _ = solve(41, tilt=UPRIGHT, **forces_of(kind, load))
    exact = elastica(
        (-UPRIGHT, UPRIGHT - 0.5),
        tilt=UPRIGHT,
        dead=(0.0, -tip),
        distributed=lambda _: (0.0, -load if kind == "own" else 0.0),
    )
    np.testing.assert_allclose((abs(x), z), (exact.x, exact.z), rtol=0, atol=5e-3)
    np.testing.assert_allclose(abs(angle - UPRIGHT), UPRIGHT - exact.angle, rtol=0, atol=5e-3)


@pytest.mark.parametrize("kind", CRITICAL)
def test_column_stands_below_its_buckling_load(kind):
    state, outcome = equilibrium(loaded(21, tilt=UPRIGHT, **forces_of(kind, 0.98 * CRITICAL[kind])))
    assert outcome.converged
    # what is left of the push that tries its stability is round-off over its stiffness
    np.testing.assert_allclose(state.position[:, 0], 0, atol=1e-4)


def forces_of(kind, load):
    return {"dead": (0.0, -load)} if kind == "tip" else {"gravity": load}


def test_very_large_dead_load_from_straight():
    exact = elastica((-UPRIGHT + 1e-12, -1.4), dead=(0.0, -100.0))
    shapes = np.array([solve(nodes, dead=(0.0, -100.0)) for nodes in MESHES])
    # the arm bends within L / 10 of the clamp, one edge of the coarsest mesh
    errors = np.linalg.norm(shapes - np.asarray(exact), axis=1)
    print("a=100", errors, order(errors))
    assert (order(errors) > 1.3).all()
    assert errors[-1] < 1e-2


@pytest.mark.parametrize("inclination", [0.02, -0.02])
def test_push_almost_along_the_arm(inclination):
    # ten times the buckling load, from a straight arm: it must fold over, to the pushed side
    angle = np.pi + inclination
    dead = 25.0 * np.array([np.cos(angle), np.sin(angle)])
    shape = solve(41, dead=dead)
    system = loaded(41, dead=dead)
    state, _ = equilibrium(system)
    matrix = dense(tangent(system, state.position))
    assert np.linalg.eigvalsh(matrix.reshape(80, 80))[0] > 0
    print(shape)


def test_signs():
    # everything that acts toward +z turns an arm along +x toward +z
    for case in (
        {"moment": 0.3},
        {"normal": 0.3},
        {"fixed": (0.0, 0.3)},
        {"dead": (0.0, 0.3)},
        {"follower": (0.0, 0.3)},
        {"current": (0.0, 0.6)},
        {"rest_curvature": 0.3},
        # lighter than the water that it displaces
        {"gravity": 0.3, "displaced_area": 2.0},
    ):
        _, z, angle, _ = solve(11, **case)
        assert z > 0.02, case
        assert angle > 0.02, case
    # and stretches it if along it
    soft = {"EA": 1e3, "floor": None}
    for case in ({"dead": (1.0, 0.0)}, {"follower": (1.0, 0.0)}, {"tangential": 2.0}):
        x, z, _, _ = solve(11, **case, **soft)
        np.testing.assert_allclose((x, z), (1.001, 0.0), rtol=0, atol=1e-8)


def test_loads_that_are_no_numbers_are_no_equilibrium():
    _, outcome = equilibrium(loaded(11, dead=(0.0, np.nan)))
    assert not outcome.converged
