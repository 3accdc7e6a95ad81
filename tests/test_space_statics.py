"""Static equilibria in space: the plane's exact shapes in any plane, and solutions in space.

As in the plane the arms of the exact inextensible shapes resist stretch with EA = 1e7 EI/L^2.
"""

from functools import cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root
from scipy.spatial.transform import Rotation

from crinoid.dynamics import Forces, System
from crinoid.dynamics.integrator import Stage
from crinoid.elements import DistributedLoad, TipLoad
from crinoid.flow import Uniform, Water
from crinoid.frames import Frames, Orientation, spun, tangents, transport
from elastica import BLADES, CRITICAL, LIMP, MATTIASSON, OWN_WEIGHT, UPRIGHT, Shape, elastica
from physics import always, arm, facing, order

MESHES = (11, 21, 41)
EA = 1e7
FLOOR = 2e-7
"""A few times the round-off of the stretching forces (N)."""
X, Y, Z = np.eye(3)
QUICKLY = {"xla_backend_optimization_level": 0}

_find = eqx.filter_jit(System.find_equilibrium, compiler_options=QUICKLY)
linearise = eqx.filter_jit(System.linearise, compiler_options=QUICKLY)


def equilibrium(system):
    state, outcome = _find(system, jnp.zeros(()))
    assert outcome.converged
    return state


def loaded(
    nodes,
    *,
    dead=(0.0, 0.0, 0.0),
    follower=(0.0, 0.0, 0.0),
    moment=(0.0, 0.0, 0.0),
    follower_moment=(0.0, 0.0, 0.0),
    tangential=0.0,
    normal=0.0,
    fixed=(0.0, 0.0, 0.0),
    current=(0.0, 0.0, 0.0),
    **changes,
):
    """Build a spatial arm of unit length and stiffness; always of the same elements.

    The density and diameter of water and arm make the drag of a broadside current |u| u per
    length.
    """
    settings = {
        "EA": EA,
        "GJ": 2 / 3,
        "floor": FLOOR,
        "water_density": 1.0,
        "diameter": 2.0,
        "drag_normal": 1.0,
        "drag_tangential": 0.0,
    }
    number = jnp.asarray
    return arm(
        axes=3,
        nodes=nodes,
        loads=(
            lambda rod: DistributedLoad.of(
                rod, tangential=tangential, normal=normal, fixed=number(fixed)
            ),
            lambda rod: TipLoad.of(
                rod,
                dead_force=number(dead),
                follower_force=number(follower),
                moment=number(moment),
                follower_moment=number(follower_moment),
            ),
        ),
        flows=(Uniform(always(), number(current, float)),),
        **settings | changes,
    )


# --- the gates of the plane, in any plane ------------------------------------------------------

LEVEL = (np.eye(3), 0.0)
"""The plane x-z as it stands in space, and how far the arm is rolled in it."""
UPRIGHT_PLANE = (Rotation.from_euler("z", 0.7).as_matrix(), 0.4)
TURNED = (Rotation.from_euler("zx", [0.7, 0.4]).as_matrix(), 0.9)
ROTATIONS = {"level": LEVEL, "upright": UPRIGHT_PLANE, "turned": TURNED}


def in_plane(plane, *, tilt=0.0, rest_curvature=0.0, **case):
    """Write a planar case as the one of a spatial arm in a plane, its director rolled in it."""
    rotation, roll = plane
    c, s = np.cos(roll), np.sin(roll)
    given = dict(case)
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


def solve(nodes, plane, **case):
    """Return the shape of an arm in equilibrium, which must stay in its plane."""
    rotation, _ = plane
    system = loaded(nodes, **in_plane(plane, **case))
    state = equilibrium(system)
    pose = np.asarray(system.tip(state)).reshape(2, 3) @ rotation
    places = np.asarray(state.position) @ rotation
    # but for the floor of the imbalance
    np.testing.assert_allclose(places[:, 1], 0, atol=2e-6)
    np.testing.assert_allclose(pose[1] @ pose[1], 1, rtol=1e-13)
    edges = np.diff(places[1:], axis=0)
    sine = edges[:, 2] / np.linalg.norm(edges, axis=1)
    return Shape(pose[0, 0], pose[0, 2], np.arctan2(pose[1, 2], pose[1, 0]), np.mean(sine**3))


def converge(exact, plane, *, digits=2e-5, within=0.2, **case):
    """Solve on all meshes: the error falls with order 2, its leading terms removed it is small.

    The ends of the arm add a term of order 3, so that both are taken out (Richardson).
    """
    exact = np.asarray(exact)
    shapes = np.array([solve(nodes, plane, **case) for nodes in MESHES])
    shapes[:, 2] = np.unwrap([[exact[2]] * 3, shapes[:, 2]], axis=0)[1]
    errors = np.linalg.norm(shapes - exact, axis=1)
    once = shapes[1:] + (shapes[1:] - shapes[:-1]) / (2**2 - 1)
    limit = once[1] + (once[1] - once[0]) / (2**3 - 1)
    print("orders", order(errors), "finest", errors[-1], "limit", np.abs(limit - exact).max())
    coarse, fine = order(errors)
    assert coarse > 1.4
    assert abs(fine - 2) < within
    np.testing.assert_allclose(limit, exact, rtol=0, atol=digits)


planes = pytest.mark.parametrize("plane", [LEVEL, TURNED], ids=["level", "turned"])
vertical_planes = pytest.mark.parametrize("plane", [LEVEL, UPRIGHT_PLANE], ids=["level", "upright"])


@planes
@pytest.mark.parametrize("load", MATTIASSON)
def test_dead_tip_load(load, plane):
    angle, drop, shortening = MATTIASSON[load]
    exact = elastica((-UPRIGHT + 1e-9, -0.1), dead=(0.0, -load))
    np.testing.assert_allclose(
        (-exact.angle, -exact.z, 1 - exact.x), (angle, drop, shortening), rtol=0, atol=6e-7
    )
    converge(exact, plane, dead=(0.0, -load))


@vertical_planes
@pytest.mark.parametrize("load", OWN_WEIGHT)
def test_own_weight(load, plane):
    exact = elastica((-UPRIGHT + 1e-9, -0.05), distributed=lambda angle: (0.0, -load))
    np.testing.assert_allclose((-exact.z, 1 - exact.x), OWN_WEIGHT[load], rtol=0, atol=6e-7)
    # under the largest load the terms of order 2 and 3 almost cancel on the coarsest mesh
    converge(exact, plane, gravity=float(load), within=0.3 if load == 10 else 0.2)


@planes
@pytest.mark.parametrize("turns", [0.5, 1.0])
def test_end_moment_bends_a_circle(turns, plane):
    # M = 2 pi EI/L: the arm closes; half of it: half a circle of radius L/pi. In space a moment on
    # a free tip is not conservative, and a whole circle of a round arm does not stay in its plane:
    # that takes one that is stiff in twist
    angle = 2 * np.pi * turns
    exact = np.array([np.sin(angle), 1 - np.cos(angle)]) / angle
    errors = []
    for nodes in MESHES:
        x, z, direction, _ = solve(nodes, plane, moment=angle, GJ=3.0)
        turned = np.unwrap([angle, direction])[1]
        errors.append(np.linalg.norm([x - exact[0], z - exact[1], turned - angle]))
    print("orders", order(errors), errors)
    coarse, fine = order(errors)
    assert coarse > 1.6
    assert abs(fine - 2) < 0.2


def test_a_circle_that_does_not_stay_in_its_plane_is_found_where_there_is_no_other():
    # the moment is the same all along the arm, whatever its stiffness in twist
    stays, leaves = (solve(11, TURNED, moment=2 * np.pi, GJ=GJ) for GJ in (3.0, 2 / 3))
    np.testing.assert_allclose(leaves, stays, rtol=0, atol=1e-7)


@planes
@pytest.mark.parametrize("load", [2.0, 6.0])
def test_follower_tip_load(load, plane):
    exact = elastica((0.1, 4.0), follower=(0.0, load))
    # 6 EI/L^2 bends the arm by 136 degrees
    converge(exact, plane, follower=(0.0, load), digits=1e-4)


@planes
def test_tip_force_and_moment_together(plane):
    exact = elastica((-1.0, 2.0), dead=(0.5, -2.0), moment=2.2)
    converge(exact, plane, dead=(0.5, -2.0), moment=2.2)


@planes
def test_curved_arm_under_load(plane):
    exact = elastica((-1.5, 1.9), rest_curvature=2.0, dead=(0.0, -1.0))
    converge(exact, plane, rest_curvature=2.0, dead=(0.0, -1.0))


@vertical_planes
@pytest.mark.parametrize(("cauchy", "buoyancy"), BLADES)
def test_blade_in_a_current(cauchy, buoyancy, plane):
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
        plane,
        tilt=UPRIGHT,
        gravity=1.0,
        displaced_area=1.0 + buoyancy,
        current=(np.sqrt(cauchy), 0.0),
    )


@vertical_planes
def test_limp_chain_in_a_current(plane):
    exact = np.arcsin((np.sqrt(5) - 1) / 2)
    np.testing.assert_allclose(LIMP, exact, atol=1e-5)
    # hinged at its root it is straight whatever its stiffness
    case = {"tilt": -UPRIGHT, "gravity": 1.0, "current": (1.0, 0.0)}
    state = equilibrium(loaded(11, **in_plane(plane, **case), pinned=True, EI=1e-3))
    edges = np.diff(np.asarray(state.position)[1:], axis=0) @ plane[0]
    np.testing.assert_allclose(np.arctan2(edges[:, 0], -edges[:, 2]), exact, rtol=0, atol=1e-5)
    np.testing.assert_allclose(edges[:, 1], 0, atol=1e-6)


def test_an_arm_confined_to_the_plane_is_the_planar_arm():
    # soft in stretch, whose round-off is small; with all loads that there are
    case = {
        "tilt": 0.3, "rest_curvature": 1.1, "gravity": 1.5, "displaced_area": 0.2,
        "EA": 1e3, "floor": 1e-12, "tolerance": 1e-13,
    }  # fmt: skip
    loads = {"tangential": 0.3, "normal": -0.4}
    ends = {"dead": (0.2, -0.5), "follower": (0.3, 0.6), "moment": 0.4}
    fixed, current = (0.1, 0.2), (0.5, -0.6)
    spatial = loaded(
        11, **case | loads | in_plane(LEVEL, **ends, fixed=fixed, current=current, tilt=0.3,
        rest_curvature=1.1),
    )  # fmt: skip
    planar = arm(
        nodes=11,
        loads=(
            lambda rod: DistributedLoad.of(rod, **loads, fixed=fixed),
            lambda rod: TipLoad.of(
                rod, dead_force=ends["dead"], follower_force=ends["follower"], moment=0.4
            ),
        ),
        flows=(Uniform(always(), jnp.asarray(current)),),
        **case, water_density=1.0, diameter=2.0, drag_normal=1.0, drag_tangential=0.0,
    )  # fmt: skip
    flat, there = equilibrium(planar), equilibrium(spatial)
    places = np.asarray(there.position)
    np.testing.assert_allclose(places[:, [0, 2]], flat.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(places[:, 1], 0, atol=1e-9)
    assert np.abs(places[-1, 2]) > 0.3
    np.testing.assert_allclose(there.base_force[jnp.array([0, 2])], flat.base_force, atol=1e-9)
    np.testing.assert_allclose(there.base_moment, [0, -flat.base_moment, 0], atol=1e-9)
    np.testing.assert_allclose(there.energy, flat.energy, rtol=0, atol=1e-9)


# --- solutions in space ------------------------------------------------------------------------


def test_bend_of_45_degrees():
    # Bathe and Bolourchi, Int. J. Numer. Methods Eng. 14 (1979) 961-986: an arc of radius 100 from
    # the origin along x toward y, square section of 1 with E = 1e7 and G = E/2: EI = 8.3333e5 both
    # ways, of the same GJ; force 300 on its tip along z. No shear here
    exact = np.array([58.780, 22.245, 40.189])
    tips = []
    for nodes in MESHES:
        system = loaded(
            nodes, length=25 * np.pi, EI=1e7 / 12, GJ=1e7 / 12, EA=1e7, floor=None,
            rest_curvature=(0.01, 0.0, 0.0), dead=(0.0, 0.0, 300.0), tolerance=1e-9,
        )  # fmt: skip
        tips.append(np.asarray(system.tip(equilibrium(system)))[:3])
    tips = np.array(tips)
    print(tips)
    assert order(np.linalg.norm(np.diff(tips, axis=0), axis=1)) == pytest.approx(2.0, abs=0.2)
    np.testing.assert_allclose(tips[2] + (tips[2] - tips[1]) / 3, exact, rtol=0, atol=0.02)


class Problem:
    """A rod in space that bends, twists and stretches: its two-point boundary-value problem.

    Along its rest length: r' = (1 + n_t / EA) t, d' = (tau t + kappa_1 m_2 - kappa_2 m_1) x d,
    n' = -load, m' = -r' x n; the moment m = EI_1 dkappa_1 m_2 - EI_2 dkappa_2 m_1 + GJ dtau t. The
    tip bears forces and moments, dead ones and such that turn along.
    """

    def __init__(
        self, *, EA, EI, GJ, rest_curvature, frame, gravity, dead, follower, moment,
        follower_moment, tangential, normal, fixed, pinned=False,
    ):  # fmt: skip
        self.EA, self.stiffness = EA, np.array([GJ, EI[0], EI[1]])
        self.rest, self.frame, self.pinned = np.array(rest_curvature), np.asarray(frame), pinned
        self.spread = tangential, normal, np.array(fixed) - gravity * Z  # of unit mass per length
        self.ends = tuple(map(np.array, (dead, follower, moment, follower_moment)))

    def rates(self, _, y, share=1.0):
        frame, force, moment = y[3:12].reshape(3, 3), y[12:15], y[15:18]
        t, m_1, m_2 = frame
        turns, toward_1, toward_2 = [moment @ t, moment @ m_2, -moment @ m_1] / self.stiffness
        kappa_1, kappa_2, tau = self.rest + np.array([toward_1, toward_2, turns])
        turning = tau * t + kappa_1 * m_2 - kappa_2 * m_1
        along = (1 + force @ t / self.EA) * t
        tangential, normal, fixed = self.spread
        load = share * (tangential * t + normal * m_2 + fixed)
        frames = np.cross(turning, frame).ravel()
        return np.concatenate([along, frames, -load, -np.cross(along, force)])

    def end(self, root_wrench, share=1.0):
        start = np.concatenate([np.zeros(3), self.frame.ravel(), root_wrench])
        done = solve_ivp(
            self.rates, (0, 1), start, args=(share,), method="DOP853", rtol=1e-12, atol=1e-13
        )
        return done.y[:, -1]

    def miss(self, wrench, share):
        y = self.end(wrench, share)
        frame = y[3:12].reshape(3, 3)
        dead, follower, moment, follower_moment = (share * load for load in self.ends)
        return y[12:] - np.concatenate([dead + follower @ frame, moment + follower_moment @ frame])

    def solve(self):
        """Return the tip's place and frame, and force and moment at the root."""
        wrench = np.zeros(6)
        for share in (0.25, 0.5, 0.75, 1.0):
            found = root(self.miss, wrench, (share,), tol=1e-12, options={"eps": 1e-7})
            wrench = found.x
        assert np.abs(self.miss(wrench, 1.0)).max() < 1e-9
        y = self.end(wrench)
        return y[:3], y[3:12].reshape(3, 3), wrench[:3], wrench[3:]


BODY = {"EI": (1.0, 2.2), "GJ": 0.7, "EA": 1e3, "rest_curvature": (0.6, -0.9, 1.5)}
LOADS = {
    "dead": (0.7, -1.2, 0.5), "follower": (0.4, 0.5, -0.6),
    "moment": (0.3, -0.5, 0.4), "follower_moment": (-0.4, 0.3, 0.5),
    "tangential": 0.3, "normal": -0.4, "fixed": (0.2, 0.3, -0.1), "gravity": 1.5,
}  # fmt: skip


def differences(system, exact):
    """Return how far an equilibrium is off in the tip's place and direction, and in the wrench."""
    place, frame, force, moment = exact
    state = equilibrium(system)
    pose = np.asarray(system.tip(state))
    return np.array(
        [
            np.linalg.norm(pose[:3] - place),
            np.linalg.norm(pose[3:] - frame[0]),
            np.linalg.norm(state.base_force - force),
            np.linalg.norm(state.base_moment - moment),
        ]
    )


def test_every_load_at_once_is_the_boundary_value_problems_solution():
    turns = {"pan": 0.4, "tilt": 0.3, "roll": 0.8}
    system = loaded(11, **turns)
    exact = Problem(frame=system.base.frame(jnp.zeros(6)), **BODY, **LOADS).solve()
    # bent and twisted far from the rest shape
    rest = Problem(frame=system.base.frame(jnp.zeros(6)), **BODY, **LOADS).end(np.zeros(6), 0.0)
    assert np.linalg.norm(exact[0] - rest[:3]) > 0.3
    errors = np.array(
        [
            differences(
                loaded(nodes, **turns, **BODY, **LOADS, floor=1e-10, tolerance=1e-12), exact
            )
            for nodes in MESHES
        ]
    )
    print(errors, order(errors))
    assert (errors[-1] < 3e-3).all()
    # the force at the root is that of all loads whatever the mesh, but that they turn along
    np.testing.assert_allclose(order(errors)[-1], 2.0, atol=0.25)


def test_a_pinned_root_bears_no_bending_but_a_torque():
    # as a joint of constant velocity does: along the middle of both tangents, so that the torque
    # about either is the same. Follower loads would spin the arm for ever
    loads = {"dead": (0.3, 0.2, 0.0), "moment": (0.1, 0.2, -0.4), "gravity": 4.0}
    turns = {"pan": 0.4, "tilt": -0.9, "roll": 0.8}
    system = loaded(21, **turns, **BODY, **loads, pinned=True, floor=1e-10, tolerance=1e-12)
    state = equilibrium(system)
    clamp, first = np.diff(np.asarray(state.position)[:3], axis=0)
    clamp, first = clamp / np.linalg.norm(clamp), first / np.linalg.norm(first)
    assert clamp @ first < 0.9  # it has swung down
    moment = np.asarray(state.base_moment)
    np.testing.assert_allclose(np.cross(clamp + first, moment), 0, atol=1e-8)
    assert abs(moment @ clamp) > 1e-2
    np.testing.assert_allclose(state.base_force, [0.3, 0.2, -4.0], rtol=0, atol=1e-8)


def test_a_pinned_arm_that_hangs_winds_up_by_its_torque():
    # M L / GJ in all: the last edge's middle is half an edge before the tip
    torque, nodes = 0.9, 11
    system = loaded(
        nodes, tilt=-UPRIGHT, roll=0.3, pinned=True, gravity=20.0, EA=1e4, floor=1e-10,
        moment=(0.0, 0.0, -torque),
    )  # fmt: skip
    state = equilibrium(system)
    np.testing.assert_allclose(np.asarray(state.position)[:, :2], 0, atol=1e-9)
    director = np.asarray(state.motion.orientation.director)
    wound = np.arctan2(-Z @ np.cross(director[1], director[-1]), director[1] @ director[-1])
    assert wound == pytest.approx(torque / (2 / 3) * (1 - 0.5 / (nodes - 1)), abs=1e-9)
    np.testing.assert_allclose(state.base_moment, [0, 0, -torque], rtol=0, atol=1e-8)


def test_an_arm_under_tension_winds_up_by_whole_turns():
    # three turns of M L / GJ: a pull of 200 EI/L^2, more than M^2 / (4 EI) (Greenhill 1883), keeps
    # it straight
    torque, nodes = 3 * 2 * np.pi * 2 / 3, 11
    assert torque**2 / 4 < 100
    system = loaded(
        nodes, tilt=-UPRIGHT, roll=0.3, EA=1e4, floor=1e-10,
        dead=(0.0, 0.0, -200.0), moment=(0.0, 0.0, -torque),
    )  # fmt: skip
    state = equilibrium(system)
    np.testing.assert_allclose(np.asarray(state.position)[:, :2], 0, atol=1e-9)
    twist = np.asarray(state.motion.orientation.twist)
    np.testing.assert_allclose(twist[2:-1], 6 * np.pi / (nodes - 1), rtol=1e-10)
    np.testing.assert_allclose(np.sum(twist), 6 * np.pi * (1 - 0.5 / (nodes - 1)), rtol=1e-10)
    np.testing.assert_allclose(state.base_moment, [0, 0, -torque], rtol=0, atol=1e-8)


# --- natural shapes ----------------------------------------------------------------------------


def helix(places):
    """Return radius and rise per edge of equally turned edges, and how far nodes are from it."""
    # second differences point at the axis, whose direction is normal to their changes
    inward = np.diff(places, 2, axis=0)
    axis = np.cross(inward[1] - inward[0], inward[2] - inward[1])
    axis /= np.linalg.norm(axis)
    rise = np.diff(places, axis=0) @ axis
    across = places - np.outer(places @ axis, axis)
    # the centre of three of them
    rows = 2 * np.stack([across[1] - across[0], across[2] - across[0], axis])
    squared = np.sum(across[:3] ** 2, axis=1)
    centre = np.linalg.solve(rows, [squared[1] - squared[0], squared[2] - squared[0], 0])
    radius = np.linalg.norm(across - centre, axis=1)
    turn = np.arccos((across[1] - centre) @ (across[0] - centre) / radius[0] ** 2)
    off = max(np.ptp(radius), np.ptp(rise))
    return radius[0], abs(rise[0]) * 2 * np.pi / turn, off


def test_an_arm_of_even_curvature_and_twist_is_a_helix():
    # radius kappa / (kappa^2 + tau^2), pitch 2 pi tau / (kappa^2 + tau^2); the frame of the helix
    # turns about the tangent at the rate tau where the curvature keeps its direction in it
    kappa, tau = np.array([1.2, -2.1]), 1.7
    whole = kappa @ kappa + tau**2
    exact = np.linalg.norm(kappa) / whole, 2 * np.pi * tau / whole
    errors = []
    for nodes in MESHES:
        system = loaded(
            nodes, pan=0.5, tilt=-0.4, roll=1.1, rest_curvature=(*kappa, tau),
            EA=1e3, floor=None, GJ=0.8, EI=(1.0, 1.6),
        )  # fmt: skip
        shape, _ = system.rod.rest_frames(system.base.frame(jnp.zeros(6)))
        radius, pitch, off = helix(np.asarray(shape))
        assert off < 1e-12
        errors.append([radius - exact[0], pitch - exact[1]])
        # pushed aside and let go, it comes back
        there = np.asarray(equilibrium(system).position)
        np.testing.assert_allclose(there[1:], shape, rtol=0, atol=1e-8)
    assert np.abs(errors[-1]).max() < 2e-3
    np.testing.assert_allclose(order(np.abs(errors)), 2.0, atol=0.05)


# --- stability ---------------------------------------------------------------------------------


def dense(bands):
    """Write the bands of the free nodes out as a matrix with axes node, unknown, node, unknown."""
    bands = np.asarray(bands)[2:]
    n, _, b, _ = bands.shape
    matrix = np.zeros((n, b, n, b))
    for i in range(n):
        for d in range(max(0, 2 - i), min(5, n + 2 - i)):
            matrix[i, :, i + d - 2] = bands[i, d]
    return matrix


@pytest.mark.parametrize("kind", CRITICAL)
def test_a_column_buckles_in_its_weak_direction(kind):
    # m_1, in which it is softer, lies at 0.6 from the x axis
    EI, turns = (1.0, 2.5), {"tilt": UPRIGHT, "pan": 0.0, "roll": 0.6}

    @cache
    def straight(nodes):
        return equilibrium(loaded(nodes, **turns, EI=EI, floor=None))

    def softness(load, nodes, direction=None):
        """Return the lowest stiffness sideways, and in which direction it is, or in the given."""
        forces = {"dead": (0.0, 0.0, -load)} if kind == "tip" else {"gravity": load}
        system = loaded(nodes, **turns, **forces, EI=EI)
        above = 1 - (np.arange(nodes - 1) + 0.5) / (nodes - 1)
        carried = load * (np.ones(nodes - 1) if kind == "tip" else above)
        height = np.cumsum((1 - carried / EA) / (nodes - 1))
        state = straight(nodes)
        squeezed = state.motion.position.at[2:, :3].set(height[:, None] * Z)
        matrix = dense(
            linearise(system, eqx.tree_at(lambda s: s.motion.position, state, squeezed))[0]
        )
        np.testing.assert_allclose(matrix, matrix.transpose(2, 3, 0, 1), atol=1e-12 * EA * nodes)
        # sideways, lengthwise and twist do not couple
        np.testing.assert_allclose(matrix[:, :2, :, 2:], 0, atol=1e-14 * EA * nodes)
        sideways = matrix[:, :2, :, :2]
        if direction is not None:
            return np.linalg.eigvalsh(np.einsum("a,iajb,b->ij", direction, sideways, direction))[0]
        values, vectors = np.linalg.eigh(sideways.reshape(2 * (nodes - 1), -1))
        return values[0], vectors[:, 0].reshape(-1, 2)

    frame = np.asarray(loaded(11, **turns).base.frame(jnp.zeros(6)))
    exact = CRITICAL[kind]
    loads = []
    for nodes in MESHES:
        _, shape = softness(0.5 * exact, nodes)
        np.testing.assert_allclose(shape @ frame[2, :2], 0, atol=1e-6)
        at = (0.9 * exact, 1.1 * exact)
        weak = brentq(softness, *at, (nodes, frame[1, :2]), xtol=1e-9)
        if nodes == MESHES[0]:
            at = (0.9 * 2.5 * exact, 1.1 * 2.5 * exact)
            assert brentq(softness, *at, (nodes, frame[2, :2])) == pytest.approx(
                2.5 * weak, rel=1e-6
            )
        loads.append(weak)
    loads = np.array(loads)
    errors = abs(loads - exact)
    print(loads, "orders", order(errors))
    assert (abs(order(errors) - 2) < 0.1).all()
    once = loads[1:] + (loads[1:] - loads[:-1]) / 3
    np.testing.assert_allclose(once[1] + (once[1] - once[0]) / 15, exact, rtol=2e-6)


@pytest.mark.parametrize("kind", CRITICAL)
def test_a_column_past_its_buckling_load_leans_in_its_weak_direction(kind):
    load = 1.5 * CRITICAL[kind]
    forces = {"dead": (0.0, 0.0, -load)} if kind == "tip" else {"gravity": load}
    exact = elastica(
        (-UPRIGHT + 1e-3, UPRIGHT - 0.5),
        tilt=UPRIGHT,
        dead=(0.0, -load if kind == "tip" else 0.0),
        distributed=lambda _: (0.0, -load if kind == "own" else 0.0),
    )
    for roll in (0.0, 0.6, -1.5):
        system = loaded(21, tilt=UPRIGHT, roll=roll, EI=(1.0, 2.5), **forces)
        place = np.asarray(equilibrium(system).position)[-1]
        _, weak, strong = np.asarray(system.base.frame(jnp.zeros(6)))
        # a mesh that buckles at a load off by 1/nodes^2 leans that much differently
        assert np.hypot(abs(place @ weak) - exact.x, place[2] - exact.z) < 15 / 21**2
        assert abs(place @ strong) < 1e-4
        assert abs(place @ weak) > 0.4


def test_a_column_that_hardly_bends_the_other_way_leans_just_past_its_buckling_load():
    load = 1.05 * CRITICAL["tip"]
    exact = elastica((UPRIGHT + 0.1, UPRIGHT + 1.5), tilt=UPRIGHT, dead=(0.0, -load))
    soft = {"EI": (1e-4, 1.0), "GJ": 1e-2, "EA": 1e4, "floor": 1e-10}
    system = loaded(21, tilt=UPRIGHT, dead=(0.0, 0.0, -1e-4 * load), **soft)
    place = np.asarray(equilibrium(system).position)[-1]  # m_1 lies along y
    np.testing.assert_allclose([abs(place[1]), place[2]], [-exact.x, exact.z], atol=5e-4)
    assert abs(place[0]) < 1e-6


@eqx.filter_jit(compiler_options=QUICKLY)
def _stiffness(stretch, bend, position, orientation):
    forces = Forces((stretch, bend), Water(()), jnp.zeros(3))
    frames = Frames.of(position, orientation)
    zero, none = jnp.zeros_like(position), jnp.zeros(())
    stage = Stage(none, position, zero, zero, jnp.ones(()), none, none, frames)
    around = forces.surroundings(stage, zero)
    motion = forces.motion(stage, zero, around)
    return forces.residual(motion)[0], forces.tangent(stage, motion, around).bands


def held_at_both_ends(places, twist, *, GJ, joint):
    """Return the stiffnesses of an evenly twisted rod whose first and last edges are held.

    Of unit length and EI between where the held edges meet the free ones; ``joint`` is the share
    of an edge's length that the nodes there own.
    """
    edges = len(places) - 2
    owned = np.ones(edges)
    owned[[0, -1]] = joint
    owned /= owned.sum()
    length = owned[1]
    stretch, bend = loaded(edges + 1, GJ=GJ, EA=1e6, length=length * edges).forces.elements[:2]
    bend = eqx.tree_at(lambda e: e.stiffness, bend, np.array([1.0, 1.0, GJ]) / owned[:, None])
    position = jnp.asarray(np.pad(places, ((0, 0), (0, 1))))
    tangent = tangents(position)
    director = [jnp.asarray(Z)] * 2  # normal to the first edge
    for before, after, turn in zip(tangent[1:-1], tangent[2:], twist * owned, strict=True):
        director.append(spun(transport(director[-1], before, after), after, jnp.asarray(turn)))
    twists = np.pad(twist * owned, 1)
    none = jnp.zeros_like(tangent)
    orientation = Orientation(jnp.stack(director), jnp.asarray(twists), none)
    residual, bands = _stiffness(stretch, bend, position, orientation)
    matrix = dense(bands)
    free = np.ones(matrix.shape[:2], bool)
    free[-1], free[-2, :3] = False, False  # of the edge before the last the spin is free
    np.testing.assert_allclose(np.asarray(residual)[2:][free], 0, atol=1e-7)
    matrix = matrix[free][:, free]
    np.testing.assert_allclose(matrix, matrix.T, rtol=0, atol=1e-9 * np.abs(matrix).max())
    return np.linalg.eigvalsh(matrix)


@pytest.mark.parametrize("shape", ["ring", "straight"])
def test_twist_at_which_a_rod_leaves_its_plane(shape):
    # A ring that was straight stays in its plane until its twist is 2 pi sqrt(3) EI/GJ (Michell
    # 1890; Zajac, J. Appl. Mech. 29 (1962) 136-142). To hold one of its edges takes from it its
    # rigid motions only.
    # A straight rod clamped at both ends buckles at a torque of 8.9868 EI/L, twice the first root
    # of tan x = x (Greenhill 1883; Timoshenko and Gere, Theory of Elastic Stability, section 2.21)
    GJ = 0.8
    if shape == "ring":
        exact = 2 * np.pi * np.sqrt(3) / GJ
    else:
        exact = 2 * brentq(lambda x: np.sin(x) - x * np.cos(x), 4, 5) / GJ

    def lowest(twist, edges):
        step = np.arange(-1, edges + 1)
        if shape == "ring":
            angle, radius = 2 * np.pi * step / edges, 0.5 / edges / np.sin(np.pi / edges)
            places = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
            values = held_at_both_ends(places, twist, GJ=GJ, joint=1.0)
            # a ring turns about its own line without effort, like one of smoke
            free = np.argmin(np.abs(values))
            assert abs(values[free]) < 1e-6
            return np.delete(values, free)[0]
        places = step[:, None] / (edges - 1) * X
        return held_at_both_ends(places, twist, GJ=GJ, joint=0.5)[0]

    critical = []
    for edges in (24, 48):
        assert lowest(0.5 * exact, edges) > 0
        critical.append(brentq(lowest, 0.8 * exact, 1.2 * exact, (edges,), xtol=1e-8))
    errors = np.abs(np.array(critical) - exact)
    print(critical, exact, order(errors))
    assert order(errors)[0] == pytest.approx(2.0, abs=0.1)
    assert critical[1] + (critical[1] - critical[0]) / 3 == pytest.approx(exact, rel=5e-4)
