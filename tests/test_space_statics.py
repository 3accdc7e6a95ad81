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

from crinoid.dynamics import System
from crinoid.elements import BendTwist, DistributedLoad, TipLoad
from crinoid.flow import Uniform
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
        kappa_1, kappa_2, tau = self.rest + [toward_1, toward_2, turns]
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
