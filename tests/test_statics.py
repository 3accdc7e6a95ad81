"""Static equilibria against the exact elastica, and against figures that others have published.

The exact shapes are those of inextensible rods. The arms here resist stretch with EA = 1e7 EI/L^2,
so that loads of 10 EI/L^2 stretch them by 1e-6: below what the tests ask for, and still far enough
from the round-off of the stretching forces, EA/l times 2e-16 = 1e-7 EI/L^2 on the finest mesh.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from crinoid.dynamics import System
from crinoid.dynamics.statics import still
from crinoid.elements import DistributedLoad, TipLoad
from crinoid.flow import Uniform
from elastica import BLADES, CRITICAL, LIMP, MATTIASSON, OWN_WEIGHT, UPRIGHT, Shape, elastica
from physics import always, arm, order

MESHES = (11, 21, 41)
EA = 1e7
FLOOR = 2e-7
"""A few times the round-off of the stretching forces (N)."""

find = eqx.filter_jit(System.find_equilibrium)


def equilibrium(system):
    # the time as an array: so it is the same compilation as that of `System.equilibrium`
    return find(system, jnp.zeros(()))


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


def solve(nodes, **case):
    """Return the shape of an arm in equilibrium, which must be found."""
    system = loaded(nodes, **case)
    state, outcome = equilibrium(system)
    assert outcome.converged
    x, z, angle = np.asarray(system.tip(state))
    edges = np.diff(np.asarray(state.position)[1:], axis=0)
    sine = edges[:, 1] / np.hypot(*edges.T)
    return Shape(x, z, angle, np.mean(sine**3))


def converge(exact, *, digits=2e-5, within=0.2, **case):
    """Solve on all meshes: the error falls with order 2, its leading terms removed it is small.

    The ends of the arm add a term of order 3, so that both are taken out (Richardson).
    ``within``: how near 2 the order of the last refinement is.
    """
    exact = np.asarray(exact)
    shapes = np.array([solve(nodes, **case) for nodes in MESHES])
    errors = np.linalg.norm(shapes - exact, axis=1)
    once = shapes[1:] + (shapes[1:] - shapes[:-1]) / (2**2 - 1)
    limit = once[1] + (once[1] - once[0]) / (2**3 - 1)
    print("orders", order(errors), "finest", errors[-1], "limit", np.abs(limit - exact).max())
    coarse, fine = order(errors)
    assert coarse > 1.4
    assert abs(fine - 2) < within
    np.testing.assert_allclose(limit, exact, rtol=0, atol=digits)


@pytest.mark.parametrize("load", MATTIASSON)
def test_dead_tip_load(load):
    angle, drop, shortening = MATTIASSON[load]
    exact = elastica((-UPRIGHT + 1e-9, -0.1), dead=(0.0, -load))
    np.testing.assert_allclose(
        (-exact.angle, -exact.z, 1 - exact.x), (angle, drop, shortening), rtol=0, atol=6e-7
    )
    converge(exact, dead=(0.0, -load))


def test_oblique_dead_tip_load():
    # 3.7 EI/L^2, 30 degrees beyond the vertical: the force also pushes back on the arm
    dead = 3.7 * np.array([np.cos(np.deg2rad(-120)), np.sin(np.deg2rad(-120))])
    converge(elastica((np.deg2rad(-119.9), -0.2), dead=dead), dead=dead)


@pytest.mark.parametrize("load", [1.0, 3.3, 5.0, 10.0])
def test_own_weight(load):
    exact = elastica((-UPRIGHT + 1e-9, -0.05), distributed=lambda angle: (0.0, -load))
    if load in OWN_WEIGHT:
        np.testing.assert_allclose((-exact.z, 1 - exact.x), OWN_WEIGHT[load], rtol=0, atol=6e-7)
    # under the largest load the terms of order 2 and 3 almost cancel on the coarsest mesh
    converge(exact, gravity=load, within=0.3 if load == 10 else 0.2)


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
    coarse, fine = order(errors)
    assert coarse > 1.6
    assert abs(fine - 2) < 0.2


def test_tapered_arm_under_a_tip_load():
    # a cone from a radius of 1 mm to half of it: EI falls to a sixteenth; E makes EI 1 at the root
    root, tip = 1e-3, 0.5e-3
    modulus = 4 / (np.pi * root**4)

    def stiffness(s):
        return (1 + (tip / root - 1) * s) ** 4

    exact = elastica((-UPRIGHT + 1e-9, -0.1), dead=(0.0, -1.5), stiffness=stiffness)
    # EA is that of the section, 4e6 EI/L^2 at the root and a quarter of it at the tip
    section = {"EA": None, "EI": None, "radius": jnp.asarray([root, tip])}
    # the thin end turns most, over a few edges of the coarsest mesh
    converge(exact, dead=(0.0, -1.5), youngs_modulus=modulus, digits=1e-4, **section)


@pytest.mark.parametrize("load", [2.0, 6.0])
def test_follower_tip_load(load):
    exact = elastica((0.1, 4.0), follower=(0.0, load))
    # 6 EI/L^2 bends the arm by 136 degrees
    converge(exact, follower=(0.0, load), digits=1e-4)


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
    # a soft arm, whose round-off is small
    system = loaded(11, tilt=tilt, rest_curvature=curvature, EA=1e3, floor=1e-11)
    state, outcome = equilibrium(system)
    assert outcome.converged
    np.testing.assert_allclose(state.position[1:], system.rod.rest_shape(tilt), rtol=0, atol=1e-10)


def test_curved_arm_under_load():
    exact = elastica((-1.5, 1.9), rest_curvature=2.0, dead=(0.0, -1.0))
    converge(exact, rest_curvature=2.0, dead=(0.0, -1.0))


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


@eqx.filter_jit
def at_rest(system, position):
    """Return imbalance, tangent and stored energies of a shape at rest."""
    forces, stage = system.forces, still(jnp.zeros(()), position, None)
    zero = jnp.zeros_like(position)
    current = forces.surroundings(stage, zero)
    motion = forces.motion(stage, zero, current)
    residual, _ = forces.residual(motion)
    energy, _ = forces.audit(motion)
    return residual, forces.tangent(stage, motion, current).bands, energy


def free_stiffness(bands):
    """Write the bands of the free nodes out as a matrix with axes node, unknown, node, unknown."""
    bands = np.asarray(bands)[2:]
    n, _, b, _ = bands.shape
    matrix = np.zeros((n, b, n, b))
    for i in range(n):
        for d in range(max(0, 2 - i), min(5, n + 2 - i)):
            matrix[i, :, i + d - 2] = bands[i, d]
    return matrix


def lowest_stiffness(system, position):
    """Return the lowest eigenvalue of the tangent: positive where the equilibrium is stable."""
    matrix = free_stiffness(at_rest(system, position)[1])
    size = matrix.shape[0] * matrix.shape[1]
    return np.linalg.eigvalsh(matrix.reshape(size, size))[0]


def standing(nodes, kind, load):
    """Return a column that bears a load, and its place when straight and compressed."""
    forces = {"dead": (0.0, -load)} if kind == "tip" else {"gravity": load}
    system = loaded(nodes, tilt=UPRIGHT, **forces)
    above = 1 - (np.arange(nodes - 1) + 0.5) / (nodes - 1)
    carried = load * (np.ones(nodes - 1) if kind == "tip" else above)
    position = np.zeros((nodes + 1, 2))
    position[0, 1] = -1 / (nodes - 1)
    position[2:, 1] = np.cumsum((1 - carried / EA) / (nodes - 1))
    return system, jnp.asarray(position)


def stored(system, position, kind, load):
    """Return elastic and potential energy, that of the tip's dead load included (J)."""
    _, elastic, potential = np.asarray(at_rest(system, position)[2])
    return elastic + potential + (load * position[-1, 1] if kind == "tip" else 0.0)


@pytest.mark.parametrize("kind", CRITICAL)
def test_buckling_load(kind):
    def sideways_stiffness(load, nodes):
        residual, bands, _ = at_rest(*standing(nodes, kind, load))
        # it is in balance indeed, but for the round-off of its stretching forces
        np.testing.assert_allclose(residual[2:], 0, atol=FLOOR)
        matrix = free_stiffness(bands)
        np.testing.assert_allclose(matrix, matrix.transpose(2, 3, 0, 1), atol=1e-12 * EA * nodes)
        # sideways and lengthwise do not couple, and the former is not drowned by the latter
        np.testing.assert_allclose(matrix[:, 0, :, 1], 0, atol=1e-12)
        return np.linalg.eigvalsh(matrix[:, 0, :, 0])[0]

    exact = CRITICAL[kind]
    loads = np.array(
        [
            brentq(sideways_stiffness, 0.9 * exact, 1.1 * exact, (nodes,), xtol=1e-9)
            for nodes in MESHES
        ]
    )
    errors = abs(loads - exact)
    print(loads, "orders", order(errors))
    assert (abs(order(errors) - 2) < 0.1).all()
    once = loads[1:] + (loads[1:] - loads[:-1]) / 3
    np.testing.assert_allclose(once[1] + (once[1] - once[0]) / 15, exact, rtol=2e-6)


@pytest.mark.parametrize("nodes", [21, 41])
@pytest.mark.parametrize("kind", CRITICAL)
@pytest.mark.parametrize("excess", [1.1, 2.0])
def test_column_leaves_the_straight_past_its_buckling_load(kind, nodes, excess):
    load = excess * CRITICAL[kind]
    system, straight = standing(nodes, kind, load)
    assert lowest_stiffness(system, straight) < 0
    state, outcome = equilibrium(system)
    assert outcome.converged
    assert lowest_stiffness(system, state.position) > 0
    fall = stored(system, straight, kind, load) - stored(system, state.position, kind, load)
    assert fall > 1e-2
    # it leans to either side: the exact shape, mirrored if need be
    exact = elastica(
        (-UPRIGHT + 1e-3, UPRIGHT - 0.5),
        tilt=UPRIGHT,
        dead=(0.0, -load if kind == "tip" else 0.0),
        distributed=lambda _: (0.0, -load if kind == "own" else 0.0),
    )
    x, z = np.asarray(state.position)[-1]
    # a mesh that buckles at a load off by 1/nodes^2 leans that much differently, over the excess
    assert np.hypot(abs(x) - exact.x, z - exact.z) < 15 / nodes**2


@pytest.mark.parametrize("kind", CRITICAL)
def test_column_stands_below_its_buckling_load(kind):
    system, _ = standing(21, kind, 0.98 * CRITICAL[kind])
    state, outcome = equilibrium(system)
    assert outcome.converged
    # what is left of the push that tries its stability: round-off over a fiftieth of its stiffness
    np.testing.assert_allclose(state.position[:, 0], 0, atol=1e-4)


def test_very_large_dead_load_from_straight():
    # the arm bends within L / 10 of the clamp, one edge of the coarsest mesh
    exact = elastica((-UPRIGHT + 1e-12, -1.4), dead=(0.0, -100.0))
    shapes = np.array([solve(nodes, dead=(0.0, -100.0)) for nodes in MESHES])
    errors = np.linalg.norm(shapes - np.asarray(exact), axis=1)
    print("errors", errors, "orders", order(errors))
    assert (order(errors) > 1.4).all()
    assert errors[-1] < 1.5e-3


@pytest.mark.parametrize("inclination", [0.02, -0.02, 0.2])
def test_push_almost_along_the_arm(inclination):
    # ten times the buckling load on a straight arm: it folds over, and stays at no saddle
    angle = np.pi + inclination
    dead = 25.0 * np.array([np.cos(angle), np.sin(angle)])
    errors = []
    for nodes in (21, 41):
        system = loaded(nodes, dead=dead)
        state, outcome = equilibrium(system)
        assert outcome.converged
        assert lowest_stiffness(system, state.position) > 0
        x, z, direction = np.asarray(system.tip(state))
        # over either side: both are stable
        side = np.sign(np.asarray(state.position)[nodes // 2, 1])
        exact = elastica(sorted((side * 2.0, side * np.pi + inclination - side * 1e-6)), dead=dead)
        turn = np.angle(np.exp(1j * (direction - exact.angle)))
        errors.append(np.linalg.norm([x - exact.x, z - exact.z, turn]))
    print("errors", errors, "order", order(errors))
    assert order(errors) > 1.6
    assert errors[-1] < 5e-3


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


def test_loads_that_are_no_numbers_have_no_equilibrium():
    system = loaded(11, dead=(0.0, np.nan))
    _, outcome = equilibrium(system)
    assert not outcome.converged
    with pytest.raises(RuntimeError, match="no static equilibrium found"):
        system.equilibrium()
