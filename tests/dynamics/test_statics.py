"""Static equilibria against the exact elastica, and against figures that others have published.

In the plane, and most of them in other planes of space too.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.dynamics.statics import static_stage
from crinoid.dynamics.tangent_assembly import assemble_tangent
from helpers.arms import QUICKLY, acting, dense, facing, order
from helpers.elastica import CRITICAL, LIMP, UPRIGHT
from helpers.slender import (
    EA,
    FLOOR,
    MESHES,
    assert_buckling_converges,
    column,
    energy,
    equilibrium,
    find,
    leaning,
    loaded,
    tip_pose,
)
from validation.elastica import PlanarEnd, elastica

LEVEL = (np.eye(3), 0.0)
"""The plane x-z as it stands in space, and how far the arm is rolled in it."""
UPRIGHT_PLANE = (Rotation.from_euler("z", 0.7).as_matrix(), 0.4)
TURNED = (Rotation.from_euler("zx", [0.7, 0.4]).as_matrix(), 0.9)


def _planes(**others):
    """Parametrize a test by the plane of a spatial arm; None is a planar arm, which is quick."""
    slow = [pytest.param(plane, id=name, marks=pytest.mark.slow) for name, plane in others.items()]
    return pytest.mark.parametrize("plane", [pytest.param(None, id="planar"), *slow])


planes = _planes(level=LEVEL, turned=TURNED)
vertical_planes = _planes(level=LEVEL, upright=UPRIGHT_PLANE)


def in_plane(plane, *, tilt=0.0, rest_curvature=0.0, **case):
    """Write a planar case as that of a spatial arm in a plane, its director rolled in it.

    Without a plane it stays planar.
    """
    if plane is None:
        return case | {"tilt": tilt, "rest_curvature": rest_curvature}
    rotation, roll = plane
    c, s = np.cos(roll), np.sin(roll)
    given = {**case, "axes": 3}
    for name in ("dead", "fixed", "current"):
        if name in case:
            x, z = case[name]
            given[name] = rotation @ [x, 0.0, z]
    if "follower" in case:  # in the frame of an arm along +x that is not turned
        x, z = case["follower"]
        given["follower"] = (x, s * z, c * z)
    if "moment" in case:
        given["moment"] = -case["moment"] * rotation[:, 1]
    given["rest_curvature"] = (s * rest_curvature, c * rest_curvature, 0.0)
    turns = Rotation.from_matrix(rotation) * Rotation.from_euler("yx", [-tilt, 0.0])
    # roll about the arm, from +y toward +z
    turns = turns * Rotation.from_rotvec([roll, 0.0, 0.0])
    return given | facing(turns.as_matrix())


def solve(nodes, plane=None, **case):
    """Return the shape of an arm in equilibrium, which must stay in its plane."""
    system = loaded(nodes, **in_plane(plane, **case))
    state = equilibrium(system)
    places, end = np.asarray(state.position), np.asarray(tip_pose(system, state))
    if plane is None:
        angle = end[2]
    else:
        rotation, _ = plane
        places, direction = places @ rotation, end[3:] @ rotation
        # but for the floor of the imbalance
        np.testing.assert_allclose(places[:, 1], 0, atol=2e-6)
        np.testing.assert_allclose(direction @ direction, 1, rtol=1e-13)
        places, angle = places[:, [0, 2]], np.arctan2(direction[2], direction[0])
    edges = np.diff(places[1:], axis=0)
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    return PlanarEnd(*places[-1], np.unwrap([*angles, angle])[-1], np.mean(np.sin(angles) ** 3))


def assert_planar(plane, **case):
    """Compare an arm in a plane of space with the planar one, on the coarsest mesh."""
    there, planar = (solve(MESHES[0], each, **case) for each in (plane, None))
    np.testing.assert_allclose(there, planar, rtol=0, atol=2e-6)


def converge(exact, plane=None, *, coarse, digits=2e-5, last=2.0, **case):
    """Solve on all meshes: the tip is near on the coarsest, and errors fall with an order.

    ``last`` is that between the two finest meshes: 2, and more where it is bent a little only.

    The ends of the arm add a term of order 3, so that both are taken out (Richardson).
    ``coarse``: how far off the tip is at most, its direction aside: that is carried on from the
    edges before. In a plane of space the arm is the planar one.
    """
    if plane is not None:
        assert_planar(plane, **case)
        return
    exact = np.asarray(exact)
    shapes = np.array([solve(nodes, **case) for nodes in MESHES])
    errors = np.linalg.norm(shapes - exact, axis=1)
    off = np.hypot(*(shapes - exact)[0, :2])
    once = shapes[1:] + (shapes[1:] - shapes[:-1]) / (2**2 - 1)
    limit = once[1] + (once[1] - once[0]) / (2**3 - 1)
    print(
        "errors", errors, "orders", order(errors), "off", off, "limit", np.abs(limit - exact).max()
    )
    assert off < coarse
    first, second = order(errors)
    assert first > 1.4
    assert second == pytest.approx(last, abs=0.25)
    np.testing.assert_allclose(limit, exact, rtol=0, atol=digits)


@pytest.mark.slow
@pytest.mark.parametrize("plane", [LEVEL, TURNED], ids=["level", "turned"])
@pytest.mark.parametrize("load", [1.0, 10.0])
def test_dead_tip_load_in_space(load, plane):
    assert_planar(plane, dead=(0.0, -load))


@pytest.mark.release
def test_oblique_dead_tip_load():
    # 3.7 EI/L^2, 30 degrees beyond the vertical: the force also pushes back on the arm
    dead = 3.7 * np.array([np.cos(np.deg2rad(-120)), np.sin(np.deg2rad(-120))])
    converge(elastica((np.deg2rad(-119.9), -0.2), dead=dead), coarse=1.5e-3, dead=dead)


@pytest.mark.slow
@pytest.mark.parametrize("plane", [LEVEL, UPRIGHT_PLANE], ids=["level", "upright"])
@pytest.mark.parametrize("load", [1.0, 10.0])
def test_own_weight_in_space(load, plane):
    assert_planar(plane, gravity=load)


@pytest.mark.slow
@planes
@pytest.mark.parametrize("turns", [1.0, 0.5, -1.0])
def test_end_moment_bends_a_circle(turns, plane):
    # M = 2 pi EI/L: the arm closes; half of it: half a circle of radius L/pi. In space a moment on
    # a free tip is not conservative, and a whole circle of a round arm does not stay in its plane:
    # that takes one that is stiff in twist
    angle = 2 * np.pi * turns
    if plane is not None:
        assert_planar(plane, moment=angle, GJ=3.0)
        return
    exact = (np.exp(1j * angle) - 1) / (1j * angle)
    errors = []
    for nodes in MESHES:
        x, z, turned, _ = solve(nodes, moment=angle)
        # to order 2: corners on a wider circle, of which the end correction at the root swings
        # the arm back by a twelfth of an edge's turn and edge
        drawn = exact - 1j * angle / (24 * (nodes - 1) ** 2) * (np.exp(1j * angle) + 1)
        errors.append(np.hypot(abs(x + 1j * z - drawn), turned - angle))
    print("orders", order(errors), errors)
    # M l / EI = d(s^2 / 2)/da = a + 3/160 a^5: each node turns that much less
    turn = angle / (MESHES[0] - 1)
    assert errors[0] < 1.2 * abs(3 / 160 * turn**4 * angle)
    np.testing.assert_allclose(order(errors), 4.0, atol=0.3)


@pytest.mark.slow
def test_a_circle_that_does_not_stay_in_its_plane_is_found_where_there_is_no_other():
    # the moment is the same all along the arm, whatever its stiffness in twist
    stays, leaves = (solve(11, TURNED, moment=2 * np.pi, GJ=GJ) for GJ in (3.0, 2 / 3))
    np.testing.assert_allclose(leaves, stays, rtol=0, atol=1e-7)


@pytest.mark.slow
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
    converge(exact, coarse=1e-3, dead=(0.0, -1.5), youngs_modulus=modulus, digits=1e-4, **section)


@pytest.mark.slow
def test_a_cantilever_whose_stiffness_tapers_sags_as_on_paper():
    # w'' = F (1 - s) / (a + c s) with u = a + c s: w = F / c^3 [b^2 ln u - 2 b u + u^2 / 2]
    a, b, force = 1.0, 0.25, 1e-2

    def part(u):
        return b**2 * np.log(u) - 2 * b * u + u**2 / 2

    exact = force / (b - a) ** 3 * (part(b) - part(a))
    system = loaded(11, EI=jnp.asarray([a, b]), dead=(0.0, -force))
    sag = -float(tip_pose(system, equilibrium(system))[1])
    assert sag == pytest.approx(exact, rel=1e-4)  # large deflections have 2e-5 of that


@pytest.mark.slow
@planes
@pytest.mark.parametrize(("load", "coarse"), [(2.0, 1.2e-3), (6.0, 1.6e-2)])
def test_follower_tip_load(load, coarse, plane):
    exact = elastica((0.1, 4.0), follower=(0.0, load))
    # 6 EI/L^2 bends the arm by 136 degrees
    converge(exact, plane, coarse=coarse, follower=(0.0, load))


@planes
def test_tip_force_and_moment_together(plane):
    exact = elastica((-1.0, 2.0), dead=(0.5, -2.0), moment=2.2)
    converge(exact, plane, coarse=5e-3, dead=(0.5, -2.0), moment=2.2)


def test_curved_arm_without_load_keeps_its_shape():
    curvature, tilt = 2.0, 0.4
    exact = elastica((0.0, 5.0), tilt=tilt, rest_curvature=curvature)
    # a circular arc of 2 rad
    arc = (np.sin(tilt + 2) - np.sin(tilt)) / 2, (np.cos(tilt) - np.cos(tilt + 2)) / 2, tilt + 2
    np.testing.assert_allclose(exact[:3], arc, rtol=0, atol=1e-11)
    converge(exact, coarse=2.2e-3, tilt=tilt, rest_curvature=curvature)
    # a soft arm, whose round-off is small
    system = loaded(11, tilt=tilt, rest_curvature=curvature, EA=1e3)
    state = equilibrium(system)
    np.testing.assert_allclose(
        state.position[1:], system.reference.rest_shape(tilt), rtol=0, atol=1e-10
    )
    # it turns by its curvature, whatever the mesh
    np.testing.assert_allclose(tip_pose(system, state)[2], tilt + 2, rtol=0, atol=1e-9)


@planes
def test_curved_arm_under_load(plane):
    exact = elastica((-1.5, 1.9), rest_curvature=2.0, dead=(0.0, -1.0))
    converge(exact, plane, coarse=2.5e-3, rest_curvature=2.0, dead=(0.0, -1.0))


@pytest.mark.slow
@pytest.mark.parametrize("plane", [LEVEL, UPRIGHT_PLANE], ids=["level", "upright"])
@pytest.mark.parametrize(("cauchy", "buoyancy"), [(1, 0), (10, 0), (1, 10), (10, 10)])
def test_blade_in_a_current_is_the_planar_one(cauchy, buoyancy, plane):
    # that is the validation case luhar-nepf-current. A mass of 1 per length displaces 1 + B of
    # water of density 1, under a gravity of 1
    water = {"displaced_area": 1.0 + buoyancy, "current": (np.sqrt(cauchy), 0.0)}
    case = {"tilt": UPRIGHT, "gravity": 1.0} | water
    there, planar = (solve(MESHES[0], each, **case) for each in (plane, None))
    np.testing.assert_allclose(there, planar, rtol=0, atol=2e-6)


@vertical_planes
def test_limp_chain_in_a_current(plane):
    exact = np.arcsin((np.sqrt(5) - 1) / 2)
    np.testing.assert_allclose(LIMP, exact, atol=1e-5)
    # hinged at its root it is straight whatever its stiffness
    case = in_plane(plane, tilt=-UPRIGHT, gravity=1.0, current=(1.0, 0.0))
    state = equilibrium(loaded(11, **case, pinned=True, EI=1e-3))
    edges = np.diff(np.asarray(state.position)[1:], axis=0)
    if plane is not None:
        edges = edges @ plane[0]
        np.testing.assert_allclose(edges[:, 1], 0, atol=1e-6)
    np.testing.assert_allclose(np.arctan2(edges[:, 0], -edges[:, -1]), exact, rtol=0, atol=1e-5)


@pytest.mark.slow
def test_an_arm_confined_to_the_plane_is_the_planar_arm():
    # soft in stretch, whose round-off is small, 1e-12 N; with all loads that there are
    case = {
        "tilt": 0.3,
        "rest_curvature": 1.1,
        "gravity": 1.5,
        "displaced_area": 0.2,
        "tangential": 0.3,
        "normal": -0.4,
        "fixed": (0.1, 0.2),
        "current": (0.5, -0.6),
        "dead": (0.2, -0.5),
        "follower": (0.3, 0.6),
        "moment": 0.4,
        "EA": 1e3,
        "tolerance": 1e-13,
    }
    systems = [loaded(11, **in_plane(plane, **case)) for plane in (None, LEVEL)]
    flat, there = map(equilibrium, systems)
    places = np.asarray(there.position)
    np.testing.assert_allclose(places[:, [0, 2]], flat.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(places[:, 1], 0, atol=1e-9)
    assert np.abs(places[-1, 2]) > 0.3
    np.testing.assert_allclose(there.base_force[jnp.array([0, 2])], flat.base_force, atol=1e-9)
    np.testing.assert_allclose(there.base_moment, [0, -flat.base_moment, 0], atol=1e-9)
    stored = [energy(system, state) for system, state in zip(systems, (flat, there), strict=True)]
    np.testing.assert_allclose(stored[1], stored[0], rtol=0, atol=1e-9)


@eqx.filter_jit(compiler_options=QUICKLY)
def at_rest(system, position):
    """Return imbalance, tangent and stored energies of a shape at rest."""
    forces, stage = acting(system), static_stage(jnp.zeros(()), position, None)
    zero = jnp.zeros_like(position)
    current = forces.surroundings(stage, zero)
    motion = forces.motion(stage, zero, current)
    residual, _ = forces.residual(motion)
    energy = forces.arm.energy(motion)
    return residual, assemble_tangent(forces, stage, motion, current).bands, energy


def lowest_stiffness(system, position):
    """Return the lowest eigenvalue of the tangent: positive where the equilibrium is stable."""
    matrix = dense(at_rest(system, position)[1][BOUNDARY_NODES:])
    size = matrix.shape[0] * matrix.shape[1]
    return np.linalg.eigvalsh(matrix.reshape(size, size))[0]


def standing(nodes, kind, load):
    """Return a column that bears a load, and its place when straight and compressed."""
    system, heights = column(nodes, kind, load)
    position = np.zeros((nodes + 1, 2))
    position[0, 1], position[2:, 1] = -1 / (nodes - 1), heights
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
        np.testing.assert_allclose(residual[BOUNDARY_NODES:], 0, atol=FLOOR)
        matrix = dense(bands[BOUNDARY_NODES:])
        np.testing.assert_allclose(matrix, matrix.transpose(2, 3, 0, 1), atol=1e-12 * EA * nodes)
        # sideways and lengthwise do not couple, and the former is not drowned by the latter
        np.testing.assert_allclose(matrix[:, 0, :, 1], 0, atol=1e-12)
        return np.linalg.eigvalsh(matrix[:, 0, :, 0])[0]

    exact = CRITICAL[kind]
    errors = assert_buckling_converges(
        [
            brentq(sideways_stiffness, 0.9 * exact, 1.1 * exact, (nodes,), xtol=1e-9)
            for nodes in MESHES
        ],
        kind,
    )
    # a thrust P(s) softens the bend of an edge by P l^2 / 12: that lowers the load by
    # the mean of P l^2 / 12 EI over the mode, weighed with its curvature squared
    share = errors / exact * (np.array(MESHES) - 1) ** 2
    softer = {"tip": np.pi**2 / 48, "own": 0.51552}[kind]
    np.testing.assert_allclose(share, softer, rtol=0.035)
    np.testing.assert_allclose(share[-1], softer, rtol=0.015)


@pytest.mark.parametrize("nodes", [21, 41])
@pytest.mark.parametrize("kind", CRITICAL)
@pytest.mark.parametrize("excess", [1.1, 2.0])
def test_column_leaves_the_straight_past_its_buckling_load(kind, nodes, excess):
    load = excess * CRITICAL[kind]
    system, straight = standing(nodes, kind, load)
    assert lowest_stiffness(system, straight) < 0
    state = equilibrium(system)
    assert lowest_stiffness(system, state.position) > 0
    fall = stored(system, straight, kind, load) - stored(system, state.position, kind, load)
    assert fall > 1e-2
    # it leans to either side: the exact shape, mirrored if need be
    exact = leaning(kind, load)
    x, z = np.asarray(state.position)[-1]
    # a mesh that buckles at a load off by 1/nodes^2 leans that much differently, over the excess
    assert np.hypot(abs(x) - exact.x, z - exact.z) < 3 / nodes**2


@pytest.mark.parametrize("kind", CRITICAL)
def test_column_stands_below_its_buckling_load(kind):
    system, _ = standing(21, kind, 0.98 * CRITICAL[kind])
    state = equilibrium(system)
    # what is left of the push that tries its stability: round-off over a fiftieth of its stiffness
    np.testing.assert_allclose(state.position[:, 0], 0, atol=1e-4)


def test_very_large_dead_load_from_straight():
    # the arm bends within L / 10 of the clamp, one edge of the coarsest mesh
    exact = elastica((-UPRIGHT + 1e-12, -1.4), dead=(0.0, -100.0))
    shapes = np.array([solve(nodes, dead=(0.0, -100.0)) for nodes in MESHES])
    errors = np.linalg.norm(shapes - np.asarray(exact), axis=1)
    print("errors", errors, "orders", order(errors))
    assert (order(errors) > 1.4).all()
    assert errors[-1] < 5e-4


@pytest.mark.parametrize("inclination", [0.02, -0.02, 0.2])
def test_push_almost_along_the_arm(inclination):
    # ten times the buckling load on a straight arm: it folds over, and stays at no saddle
    angle = np.pi + inclination
    dead = 25.0 * np.array([np.cos(angle), np.sin(angle)])
    errors = []
    for nodes in (21, 41):
        system = loaded(nodes, dead=dead)
        state = equilibrium(system)
        assert lowest_stiffness(system, state.position) > 0
        x, z, direction = np.asarray(tip_pose(system, state))
        # over either side: both are stable
        side = np.sign(np.asarray(state.position)[nodes // 2, 1])
        exact = elastica(sorted((side * 2.0, side * np.pi + inclination - side * 1e-6)), dead=dead)
        turn = np.angle(np.exp(1j * (direction - exact.angle)))
        errors.append(np.linalg.norm([x - exact.x, z - exact.z, turn]))
    print("errors", errors, "order", order(errors))
    assert order(errors) > 1.6
    assert errors[-1] < 8e-4


@pytest.mark.parametrize("load", [1e-4, 1e-2])
def test_a_small_load_on_an_arm_stiff_to_stretch_is_felt_by_the_base(load):
    # below the floor, where round-off may rule, iterations go on while they gain anything
    system = loaded(21, dead=(0.0, -load), EA=1e7)
    np.testing.assert_allclose(equilibrium(system).base_force, [0.0, -load], rtol=0, atol=1.5e-7)


def test_loads_below_the_round_off_of_the_stretch_are_warned_of():
    # 2 eps EA L / l = 8.9e-6 N
    with pytest.warns(RuntimeWarning, match="accurate to 8.9e-06 N only, the round-off"):
        loaded(21, dead=(0.0, -1e-5), EA=1e9).equilibrium()
    loaded(21, dead=(0.0, -1e-2), EA=1e9).equilibrium()  # a warning fails the test
    loaded(21, dead=(0.0, 0.0), EA=1e4).equilibrium()


@pytest.mark.slow
@pytest.mark.parametrize("axes", [2, 3])
def test_two_states_at_once_have_the_wrench_of_each(axes):
    # two: as many as the rows of the ghost node and the root, which they were once taken for
    cases = ({"dead": (0.3, -0.5)}, {"dead": (-0.2, 0.4), "moment": 0.3})
    states = [equilibrium(loaded(11, **in_plane(LEVEL if axes == 3 else None, **c))) for c in cases]
    both = jax.tree.map(lambda *leaves: jnp.stack(leaves), *states)
    for i, state in enumerate(states):
        np.testing.assert_array_equal(both.base_force[i], state.base_force)
        np.testing.assert_array_equal(both.base_moment[i], state.base_moment)
    force = np.zeros(axes)
    force[[0, -1]] = cases[0]["dead"]
    np.testing.assert_allclose(both.base_force[0], force, atol=20 * FLOOR)
    assert both.base_moment.shape == ((2,) if axes == 2 else (2, 3))


@pytest.mark.release
def test_an_equilibrium_has_a_gradient_outside_of_compiled_code():
    system = loaded(7, dead=(0.0, -1e-2))

    def height(factor):
        bend = system.forces.bend.stiffness
        stiffer = eqx.tree_at(lambda one: one.forces.bend.stiffness, system, factor * bend)
        return stiffer.equilibrium().motion.position[-1, 1]

    found = jax.value_and_grad(height)
    slope = float(found(1.0)[1])
    difference = float(found(1.001)[0] - found(0.999)[0]) / 0.002
    assert slope == pytest.approx(difference, rel=1e-4)
    assert slope > 0  # a stiffer arm sags less


def test_loads_that_are_no_numbers_have_no_equilibrium():
    system = loaded(11, dead=(0.0, np.nan))
    _, outcome = find(system, jnp.zeros(()))
    assert not outcome.converged
    with pytest.raises(RuntimeError, match="no static equilibrium found"):
        system.equilibrium()
