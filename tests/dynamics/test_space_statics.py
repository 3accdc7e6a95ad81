"""Static equilibria in space: boundary-value problems, natural shapes, stability.

Shapes that stay in a plane are in `test_statics.py`.
"""

from functools import cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

from crinoid.dynamics import ActingForces, Context, Forces, System
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.dynamics.tangent_assembly import assemble_tangent
from crinoid.flow import Water
from crinoid.numerics.frames import Frames, Orientation, spun, tangents, transport
from helpers import slender
from helpers.arms import QUICKLY, dense, order
from helpers.elastica import CRITICAL, UPRIGHT
from helpers.slender import (
    EA,
    MESHES,
    assert_buckling_converges,
    column,
    equilibrium,
    leaning,
    tip_pose,
)
from validation.elastica import elastica

X, Y, Z = np.eye(3)

linearise = eqx.filter_jit(System.linearise, compiler_options=QUICKLY)
loaded = partial(slender.loaded, axes=3)


# --- solutions in space ------------------------------------------------------------------------


class Problem:
    """A rod in space that bends, twists and stretches: its two-point boundary-value problem.

    Along its rest length: r' = (1 + n_t / EA) t, d' = (tau t + kappa_1 m_2 - kappa_2 m_1) x d,
    n' = -load, m' = -r' x n; the moment m = EI_1 dkappa_1 m_2 - EI_2 dkappa_2 m_1 + GJ dtau t. The
    tip bears forces and moments, dead ones and such that turn along.
    """

    def __init__(
        self,
        *,
        EA,
        EI,
        GJ,
        rest_curvature,
        frame,
        gravity,
        dead,
        follower,
        moment,
        follower_moment,
        tangential,
        normal,
        fixed,
        pinned=False,
    ):
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
    pose = np.asarray(tip_pose(system, state))
    return np.array(
        [
            np.linalg.norm(pose[:3] - place),
            np.linalg.norm(pose[3:] - frame[0]),
            np.linalg.norm(state.base_force - force),
            np.linalg.norm(state.base_moment - moment),
        ]
    )


@pytest.mark.release
def test_every_load_at_once_is_the_boundary_value_problems_solution():
    turns = {"pan": 0.4, "tilt": 0.3, "roll": 0.8}
    system = loaded(11, **turns)
    exact = Problem(frame=system.base.frame(jnp.zeros(6)), **BODY, **LOADS).solve()
    # bent and twisted far from the rest shape
    rest = Problem(frame=system.base.frame(jnp.zeros(6)), **BODY, **LOADS).end(np.zeros(6), 0.0)
    assert np.linalg.norm(exact[0] - rest[:3]) > 0.3
    errors = np.array(
        [
            differences(loaded(nodes, **turns, **BODY, **LOADS, tolerance=1e-12), exact)
            for nodes in MESHES
        ]
    )
    print(errors, order(errors))
    assert (errors[-1] < 3e-3).all()
    # the force at the root is that of all loads whatever the mesh, but that they turn along
    np.testing.assert_allclose(order(errors)[-1], 2.0, atol=0.25)


@pytest.mark.release
def test_a_pinned_root_bears_no_bending_but_a_torque():
    # as a joint of constant velocity does: along the middle of both tangents, so that the torque
    # about either is the same. Follower loads would spin the arm for ever
    loads = {"dead": (0.3, 0.2, 0.0), "moment": (0.1, 0.2, -0.4), "gravity": 4.0}
    turns = {"pan": 0.4, "tilt": -0.9, "roll": 0.8}
    system = loaded(21, **turns, **BODY, **loads, pinned=True, tolerance=1e-12)
    state = equilibrium(system)
    clamp, first = np.diff(np.asarray(state.position)[:3], axis=0)
    clamp, first = clamp / np.linalg.norm(clamp), first / np.linalg.norm(first)
    assert clamp @ first < 0.9  # it has swung down
    moment = np.asarray(state.base_moment)
    np.testing.assert_allclose(np.cross(clamp + first, moment), 0, atol=1e-8)
    assert abs(moment @ clamp) > 1e-2
    np.testing.assert_allclose(state.base_force, [0.3, 0.2, -4.0], rtol=0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("torque", "case"),
    [
        pytest.param(0.9, {"pinned": True, "gravity": 20.0}, marks=pytest.mark.slow),
        # three turns: a pull of 200 EI/L^2, more than M^2 / (4 EI) (Greenhill 1883), keeps it
        # straight
        (3 * 2 * np.pi * 2 / 3, {"dead": (0.0, 0.0, -200.0)}),
    ],
    ids=["pinned", "three turns"],
)
def test_a_hanging_arm_winds_up_by_its_torque(torque, case):
    # M L / GJ in all: the last edge's middle is half an edge before the tip
    assert torque**2 / 4 < 100
    nodes, turn = 11, torque / (2 / 3)
    system = loaded(nodes, tilt=-UPRIGHT, roll=0.3, EA=1e4, moment=(0.0, 0.0, -torque), **case)
    state = equilibrium(system)
    np.testing.assert_allclose(np.asarray(state.position)[:, :2], 0, atol=1e-9)
    orientation = state.motion.orientation
    director, twist = map(np.asarray, (orientation.director, orientation.twist))
    wound = np.arctan2(-Z @ np.cross(director[1], director[-1]), director[1] @ director[-1])
    off = wound - turn * (1 - 0.5 / (nodes - 1))
    assert np.angle(np.exp(1j * off)) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(twist[2:-1], turn / (nodes - 1), rtol=1e-10)
    np.testing.assert_allclose(np.sum(twist), turn * (1 - 0.5 / (nodes - 1)), rtol=1e-10)
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


@pytest.mark.slow
def test_an_arm_of_even_curvature_and_twist_is_a_helix():
    # radius kappa / (kappa^2 + tau^2), pitch 2 pi tau / (kappa^2 + tau^2); the frame of the helix
    # turns about the tangent at the rate tau where the curvature keeps its direction in it
    kappa, tau = np.array([1.2, -2.1]), 1.7
    whole = kappa @ kappa + tau**2
    exact = np.linalg.norm(kappa) / whole, 2 * np.pi * tau / whole
    for nodes in MESHES[:2]:
        system = loaded(
            nodes,
            pan=0.5,
            tilt=-0.4,
            roll=1.1,
            rest_curvature=(*kappa, tau),
            EA=1e3,
            GJ=0.8,
            EI=(1.0, 1.6),
        )
        shape, _ = system.reference.rest_frames(system.base.frame(jnp.zeros(6)))
        radius, pitch, off = helix(np.asarray(shape))
        assert off < 1e-12
        np.testing.assert_allclose([radius, pitch], exact, rtol=1e-12)  # on any mesh
        # pushed aside and let go, it comes back
        there = np.asarray(equilibrium(system).position)
        np.testing.assert_allclose(there[1:], shape, rtol=0, atol=1e-8)


# --- stability ---------------------------------------------------------------------------------


@pytest.mark.release
@pytest.mark.parametrize("kind", CRITICAL)
def test_a_column_buckles_in_its_weak_direction(kind):
    # m_1, in which it is softer, lies at 0.6 from the x axis
    case = {"axes": 3, "pan": 0.0, "roll": 0.6, "EI": (1.0, 2.5)}

    @cache
    def straight(nodes):
        return equilibrium(slender.loaded(nodes, **case, tilt=UPRIGHT))

    def softness(load, nodes, direction=None):
        """Return the lowest stiffness sideways, and in which direction it is, or in the given."""
        system, heights = column(nodes, kind, load, **case)
        state = straight(nodes)
        squeezed = state.motion.position.at[2:, :3].set(heights[:, None] * Z)
        stiffness, _ = linearise(system, eqx.tree_at(lambda s: s.motion.position, state, squeezed))
        matrix = dense(stiffness[BOUNDARY_NODES:])
        np.testing.assert_allclose(matrix, matrix.transpose(2, 3, 0, 1), atol=1e-12 * EA * nodes)
        # sideways, lengthwise and twist do not couple
        np.testing.assert_allclose(matrix[:, :2, :, 2:], 0, atol=1e-14 * EA * nodes)
        sideways = matrix[:, :2, :, :2]
        if direction is not None:
            return np.linalg.eigvalsh(np.einsum("a,iajb,b->ij", direction, sideways, direction))[0]
        values, vectors = np.linalg.eigh(sideways.reshape(2 * (nodes - 1), -1))
        return values[0], vectors[:, 0].reshape(-1, 2)

    frame = np.asarray(column(11, kind, 0.0, **case)[0].base.frame(jnp.zeros(6)))
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
    assert_buckling_converges(loads, kind)


@pytest.mark.release
@pytest.mark.parametrize("kind", CRITICAL)
def test_a_column_past_its_buckling_load_leans_in_its_weak_direction(kind):
    load = 1.5 * CRITICAL[kind]
    exact = leaning(kind, load)
    for roll in (0.0, 0.6, -1.5):
        system, _ = column(21, kind, load, axes=3, roll=roll, EI=(1.0, 2.5))
        place = np.asarray(equilibrium(system).position)[-1]
        _, weak, strong = np.asarray(system.base.frame(jnp.zeros(6)))
        # a mesh that buckles at a load off by 1/nodes^2 leans that much differently
        assert np.hypot(abs(place @ weak) - exact.x, place[2] - exact.z) < 3 / 21**2
        assert abs(place @ strong) < 1e-4
        assert abs(place @ weak) > 0.4


@pytest.mark.release
def test_a_column_that_hardly_bends_the_other_way_leans_just_past_its_buckling_load():
    load, nodes = 1.05 * CRITICAL["tip"], 21
    # how far it leans is a matter of the excess: this mesh buckles at a share P l^2 / 12 EI less
    # than Euler's load P
    excess = load * (1 + CRITICAL["tip"] / (12 * (nodes - 1) ** 2))
    exact = elastica((UPRIGHT + 0.1, UPRIGHT + 1.5), tilt=UPRIGHT, dead=(0.0, -excess))
    soft = {"EI": (1e-4, 1.0), "GJ": 1e-2, "EA": 1e4}
    system = loaded(nodes, tilt=UPRIGHT, dead=(0.0, 0.0, -1e-4 * load), **soft)
    place = np.asarray(equilibrium(system).position)[-1]  # m_1 lies along y
    np.testing.assert_allclose([abs(place[1]), place[2]], [-exact.x, exact.z], atol=1.5e-4)
    assert abs(place[0]) < 1e-6


@eqx.filter_jit(compiler_options=QUICKLY)
def _stiffness(stretch, bend, position, orientation):
    forces = ActingForces.of(Forces((stretch, bend), Water(()), jnp.zeros(3)), Context())
    frames = Frames.of(position, orientation)
    zero, none = jnp.zeros_like(position), jnp.zeros(())
    stage = StepMap(none, position, zero, zero, jnp.ones(()), none, none, frames)
    around = forces.surroundings(stage, zero)
    motion = forces.motion(stage, zero, around)
    return forces.residual(motion)[0], assemble_tangent(forces, stage, motion, around).bands


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
    matrix = dense(bands[BOUNDARY_NODES:])
    free = np.ones(matrix.shape[:2], bool)
    free[-1], free[-2, :3] = False, False  # of the edge before the last the spin is free
    np.testing.assert_allclose(np.asarray(residual)[BOUNDARY_NODES:][free], 0, atol=1e-7)
    matrix = matrix[free][:, free]
    np.testing.assert_allclose(matrix, matrix.T, rtol=0, atol=1e-9 * np.abs(matrix).max())
    return np.linalg.eigvalsh(matrix)


@pytest.mark.slow
def test_an_arm_with_other_numbers_is_built_without_compiling(caplog):
    loaded(11)
    with jax.log_compiles():
        loaded(11, GJ=0.3, rest_curvature=(0.2, 0.1, -0.4))
    assert "Compiling" not in caplog.text
    with jax.log_compiles():
        loaded(7)
    assert "Compiling" in caplog.text  # which is how it would show


@pytest.mark.release
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
    assert errors[0] < 0.015 * exact
    assert critical[1] + (critical[1] - critical[0]) / 3 == pytest.approx(exact, rel=5e-4)
