"""Each element in space: forces, torques, energies and powers, and its tangent through rotations.

All of them act at once on one arm; the others are silenced by their numbers, so that little is
compiled.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.elements import (
    AddedMass,
    Bend,
    DistributedLoad,
    Drag,
    Inertia,
    Stretch,
    TipLoad,
    Weight,
)
from crinoid.flow import PowerShear, Uniform
from crinoid.numerics.frames import Frames, Orientation, angle_between, tangents, transport
from helpers.arms import acting, always, arm, dense, only
from helpers.newton_steps import assert_converges_quadratically, motion_of, slopes

NODES = 6
EDGE = 0.2
"""Length of an edge (m)."""
TURN = 2 * np.pi
SEEDS = range(4)

FORCES = acting(arm(
    axes=3, nodes=NODES, EA=50.0, EI=(0.05, 0.08), GJ=0.06, mass_per_length=1.2, diameter=0.04,
    displaced_area=1.1e-3, rest_curvature=(0.8, -0.5, 1.3), damping_time=0.03, gravity=9.81,
    water_density=1000.0, drag_tangential=0.1, added_mass_tangential=0.2, linear_drag=0.5,
    loads=(
        lambda rod: DistributedLoad.of(rod, tangential=0.4, normal=-0.7, fixed=(0.2, 0.1, -0.3)),
        lambda rod: TipLoad.of(
            rod, dead_force=(0.1, -0.2, 0.3), follower_force=(0.3, 0.4, -0.2),
            moment=(0.05, 0.02, -0.04), follower_moment=(-0.06, 0.03, 0.05),
        ),
    ),
    flows=(
        Uniform(always(), jnp.asarray([0.3, 0.2, -0.1])),
        # an upward part makes the shear felt as an acceleration
        PowerShear(always(), jnp.asarray([0.4, -0.2, 0.1]), *map(jnp.asarray, (2.0, -5.0, 0.3))),
    ),
))  # fmt: skip
KINDS = (Stretch, Bend, Inertia, Weight, Drag, AddedMass, DistributedLoad, TipLoad)


def of_kind(kind):
    (element,) = (e for e in FORCES.elements if isinstance(e, kind))
    return element


# --- any shapes and motions --------------------------------------------------------------------


def edges_at_random(rng, bend):
    """Return directions of edges, each at an angle of at most ``bend`` to the one before."""
    turned, frame = [], Rotation.random(random_state=rng)
    for _ in range(NODES):
        aside = rng.uniform(0, TURN)
        turn = rng.uniform(0.2, 1.0) * bend * np.array([0.0, np.cos(aside), np.sin(aside)])
        frame = frame * Rotation.from_rotvec(turn)
        turned.append(frame.apply([1.0, 0.0, 0.0]))
    return np.array(turned)


def placed(rng, tangent):
    """Place nodes on edges of about the length at rest; their spins are anything."""
    edges = EDGE * rng.uniform(0.9, 1.1, (NODES, 1)) * tangent
    places = np.concatenate([rng.normal(size=(1, 3)), edges]).cumsum(axis=0)
    return np.concatenate([places, rng.uniform(-4, 4, (NODES + 1, 1))], axis=1)


def oriented(rng, position, turns=0):
    """Return directors at random, and the twists that go along, some turns more."""
    tangent = np.asarray(tangents(jnp.asarray(position)))
    director = np.cross(tangent, rng.normal(size=tangent.shape))
    director /= np.linalg.norm(director, axis=1, keepdims=True)
    now, ahead = slice(1, -1), slice(2, None)
    carried = transport(*map(jnp.asarray, (director[now], tangent[now], tangent[ahead])))
    twist = angle_between(carried, *map(jnp.asarray, (director[ahead], tangent[ahead])))
    twist = np.pad(np.asarray(twist) + TURN * turns, 1)
    return Orientation(*map(jnp.asarray, (director, twist, np.zeros_like(director))))


def at_random(seed, *, bend=0.7, turns=0, turned=0.0, sharp=None, step=0.02):
    """Make a stage of a step: bent, twisted, stretched and moving.

    The frames are those of a shape whose edges point elsewhere, by the angle ``turned``. One edge
    turns by ``sharp`` from the one before.
    """
    rng = np.random.default_rng(seed)
    tangent = edges_at_random(rng, bend)
    position = placed(rng, tangent)
    aside = np.cross(tangent, rng.normal(size=tangent.shape))
    aside *= turned * rng.uniform(0.6, 1.0, (NODES, 1)) / np.linalg.norm(aside, axis=1)[:, None]
    before = placed(rng, Rotation.from_rotvec(aside).apply(tangent))
    if turned == 0.0:
        before = position
    if sharp is not None:
        across = np.cross(tangent[2], rng.normal(size=3))
        tangent[3] = np.cos(sharp) * tangent[2] + np.sin(sharp) * across / np.linalg.norm(across)
        position = placed(rng, tangent)
    frames = Frames.of(jnp.asarray(before), oriented(rng, before, turns))
    velocity, acceleration = rng.normal(size=(2, NODES + 1, 4))
    numbers = (1.0, position, velocity, acceleration, 1.0, 2 / step, 4 / step**2)
    return StepMap(*map(jnp.asarray, numbers), frames)


@eqx.filter_jit
def observe(forces, stage):
    """Return residual, energies, powers and the motion of a stage."""
    motion, _ = motion_of(forces, stage, jnp.zeros_like(stage.position))
    energy, working = (
        forces.arm.energy(motion),
        forces.arm.nonconservative_forces(motion, motion.position.shape[0]),
    )
    power = jnp.asarray([jnp.sum(force * motion.velocity) for force in working.values()])
    return forces.residual(motion)[0], energy, power, motion


def force_and_torque(position, residual):
    """Return the sum of forces, and of moments about the origin with the torques about edges."""
    position, residual = np.asarray(position), np.asarray(residual)
    along = residual[:, 3:] * np.asarray(tangents(jnp.asarray(position)))
    return residual[:, :3].sum(axis=0), (np.cross(position[:, :3], residual[:, :3]) + along).sum(
        axis=0
    )


# --- tangents ----------------------------------------------------------------------------------


def assert_tangent(forces, stage, digits=1e-12):
    bands, _, expected = slopes(forces, stage)
    got, expected = dense(bands), np.asarray(expected)
    assert np.isfinite(got).all()
    row = np.abs(expected).max(axis=(2, 3), keepdims=True) + np.finfo(float).tiny
    # a spin of the first row belongs to no edge, nor do torques act there
    assert not np.abs(got[0, 3]).any()
    np.testing.assert_allclose(got / row, expected / row, rtol=0, atol=digits)
    return np.abs(got).max()


@pytest.mark.parametrize("turned", [0.0, 0.5, 1.2])
@pytest.mark.parametrize("kind", [*KINDS, KINDS], ids=lambda k: getattr(k, "__name__", "all"))
def test_tangent_is_the_slope_of_the_residual(kind, turned):
    kinds = kind if isinstance(kind, tuple) else (kind,)
    for seed in SEEDS:
        size = assert_tangent(only(FORCES, *kinds), at_random(seed, turned=turned))
        assert (size > 1e-3) == (kinds != (Weight,))


@pytest.mark.parametrize("turns", [-2, 1, 3])
def test_tangent_with_turns_of_twist(turns):
    for seed in SEEDS:
        stage = at_random(seed, turned=0.6, turns=turns)
        assert np.abs(observe(FORCES, stage)[3].orientation.twist[2:-1]).max() > TURN / 2
        assert_tangent(only(FORCES, Bend), stage)


@pytest.mark.parametrize("sharp", np.deg2rad([150.0, 160.0, 169.0]))
@pytest.mark.parametrize("turns", [0, 2])
def test_tangent_of_edges_bent_sharply(sharp, turns):
    for seed in SEEDS:
        assert_tangent(
            only(FORCES, Bend), at_random(seed, sharp=sharp, turned=0.3, turns=turns), 1e-11
        )


def test_tangent_of_a_slow_and_a_hasty_step():
    # a static solve moves places only; a short step is all velocity
    stage = at_random(0, turned=0.4)
    for rates in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.55, 2e5, 4e10)):
        names = ("by_position", "by_velocity", "by_acceleration")
        chosen = replace(stage, **dict(zip(names, map(jnp.asarray, rates), strict=True)))
        assert_tangent(only(FORCES, Bend, Inertia), chosen)


# --- bend and twist ----------------------------------------------------------------------------


def undamped(forces):
    """Return the forces without damping."""

    def damping(forces):
        return [e.material.damping_time for e in forces.elements if isinstance(e, Stretch | Bend)]

    return eqx.tree_at(damping, forces, replace_fn=jnp.zeros_like)


def reframed(forces, stage):
    """Return a stage whose frames are those of its shape."""
    return replace(stage, frames=Frames.of(stage.position, observe(forces, stage)[3].orientation))


@eqx.filter_jit
def energy_slope(forces, stage):
    """Return d(stored energy but the kinetic)/d(places and spins)."""

    def stored(correction):
        motion, _ = motion_of(forces, stage, correction)
        return jnp.sum(forces.arm.energy(motion)[1:])

    return jax.grad(stored)(jnp.zeros_like(stage.position))


@pytest.mark.parametrize("turns", [0, -2])
@pytest.mark.parametrize("sharp", [None, np.deg2rad(165.0)])
@pytest.mark.parametrize("kind", [Stretch, Bend, Weight])
def test_conservative_forces_are_the_slope_of_their_energy(kind, sharp, turns):
    for seed in SEEDS:
        # there the spins and the places turn the edges each for themselves
        stage = reframed(FORCES, at_random(seed, sharp=sharp, turns=turns))
        forces = undamped(only(FORCES, kind))
        slope, residual = energy_slope(forces, stage), observe(forces, stage)[0]
        size = np.abs(slope).max()
        assert size > 1e-2
        np.testing.assert_allclose(residual, slope, rtol=0, atol=3e-12 * size)


@pytest.mark.parametrize("turned", [0.0, 0.8])
def test_what_deforms_an_arm_stores_energy_or_is_dissipated(turned):
    # dE/dt along the velocities by differences of energies along a motion: through the frames
    for seed in SEEDS:
        stage = at_random(seed, turned=turned, turns=1)
        elastic = only(FORCES, Stretch, Bend)
        residual, _, power, motion = observe(elastic, stage)
        fed = float(jnp.sum(residual * motion.velocity))
        stage, h = reframed(elastic, stage), 1e-5
        places = (stage.position + s * h * stage.velocity for s in (1, -1))
        ahead, behind = (observe(elastic, replace(stage, position=p))[1] for p in places)
        storing = float(jnp.sum(ahead - behind)) / (2 * h)
        damping = float(jnp.sum(power))
        assert damping < -1e-3
        assert fed == pytest.approx(storing - damping, abs=1e-6 * (abs(fed) + abs(damping)))
        # and exactly what damping alone takes
        elastic_only = observe(undamped(elastic), stage)
        taken = np.sum((residual - elastic_only[0]) * stage.velocity)
        assert -damping == pytest.approx(float(taken), rel=1e-11)
        assert not np.abs(elastic_only[2]).any()


def rigid(rng, position):
    """Return the velocities of a body that turns with the arm's shape on it."""
    turning, drift = rng.normal(size=(2, 3))
    places = drift + np.cross(turning, np.asarray(position)[:, :3])
    spins = np.asarray(tangents(position)) @ turning
    return jnp.asarray(np.concatenate([places, spins[:, None]], axis=1))


def test_turning_as_a_whole_is_not_damped():
    for seed in SEEDS:
        stage = at_random(seed, turns=seed)
        damped = only(FORCES, Stretch, Bend)
        usual = -float(jnp.sum(observe(damped, stage)[2]))
        still = replace(stage, velocity=rigid(np.random.default_rng(seed), stage.position))
        # round-off of the rate, squared
        assert usual > 1e-2
        assert abs(float(jnp.sum(observe(damped, still)[2]))) < 1e-24 * usual
        # nor does it stress the arm
        stressed, at_rest = (observe(f, still)[0] for f in (damped, undamped(damped)))
        size = np.abs(at_rest).max()
        np.testing.assert_allclose(stressed, at_rest, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("sharp", [None, np.deg2rad(165.0)])
def test_inner_forces_are_in_balance(sharp):
    for seed in SEEDS:
        stage = at_random(seed, turned=0.5, turns=seed, sharp=sharp)
        for kind in (Stretch, Bend):
            residual, _, _, motion = observe(only(FORCES, kind), stage)
            size = np.abs(residual).max()
            assert size > 1e-2
            force, moment = force_and_torque(motion.position, residual)
            np.testing.assert_allclose(force, 0, atol=1e-13 * size)
            np.testing.assert_allclose(moment, 0, atol=1e-13 * size)


def turned_stage(stage, rotation, shift):
    """Turn and shift all of a stage."""
    matrix = jnp.asarray(rotation.as_matrix())

    def rows(rows, shift=0.0):
        return jnp.concatenate([rows[:, :3] @ matrix.T + shift, rows[:, 3:]], axis=1)

    frames = stage.frames
    frames = replace(frames, tangent=frames.tangent @ matrix.T, director=frames.director @ matrix.T)
    return replace(
        stage,
        position=rows(stage.position, shift),
        velocity=rows(stage.velocity),
        acceleration=rows(stage.acceleration),
        frames=frames,
    )


def test_forces_turn_with_everything_else():
    # in still water; what is fixed in the world aside
    followers = still_water(only(FORCES, *(kind for kind in KINDS if kind is not Weight)))
    for seed in SEEDS:
        stage = at_random(seed, turned=0.5, turns=seed)
        rotation = Rotation.random(random_state=seed)
        residual, energy, power, _ = observe(followers, stage)
        turned = observe(followers, turned_stage(stage, rotation, jnp.asarray([3.0, -2.0, 5.0])))
        size = np.abs(residual).max(axis=0)
        force, torque = residual[:, :3] @ rotation.as_matrix().T, residual[:, 3]
        assert (size > 1e-2).all()
        close = np.testing.assert_allclose
        close(turned[0][:, :3], force, rtol=0, atol=1e-12 * size[:3].max())
        close(turned[0][:, 3], torque, rtol=0, atol=1e-12 * size[3])
        for got, scalar in zip(turned[1:3], (energy, power), strict=True):
            np.testing.assert_allclose(got, scalar, rtol=1e-11, atol=1e-12)


def still_water(forces):
    """Return the forces without a current, and without what has a direction in the world."""

    def fixed(forces):
        (*_, spread, tip), (uniform, shear) = forces.elements, forces.water.flows
        flows = [uniform.uniform_velocity, shear.reference_velocity]
        return [spread.fixed, tip.dead_force, tip.moment, *flows]

    return eqx.tree_at(fixed, forces, replace_fn=jnp.zeros_like)


@pytest.mark.parametrize("twist", [0.0, 0.9, -2.0, 3 * np.pi, 5.5 * np.pi])
@pytest.mark.parametrize("bend", [0.0, 0.3, 2.5])
def test_strains_are_those_of_the_frame_half_way(bend, twist):
    # bent by an angle about any axis b across the first edge, the second edge's frame further
    # twisted: (2 tan(bend / 2) + 4 sin(bend / 2)) / 3 b is read in the frame half way
    for about in (0.0, 1.0, 4.0):
        first = Rotation.from_rotvec([0.3, -0.7, 0.4])
        binormal = first.apply([0.0, np.cos(about), np.sin(about)])
        second = Rotation.from_rotvec(bend * binormal) * first
        x, y = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
        tangent = np.stack([first.apply(x), first.apply(x), second.apply(x)])
        second = Rotation.from_rotvec(twist * tangent[2]) * second
        edges = np.concatenate([tangent, np.tile(tangent[2:], (NODES - 3, 1))])
        position = jnp.asarray(np.pad(np.cumsum(EDGE * edges, axis=0), ((1, 0), (0, 1))))
        directors = [first.apply(y)] * 3 + [second.apply(y)] * (NODES - 2)
        twists = twist * np.eye(NODES + 1)[2]
        orientation = Orientation(*map(jnp.asarray, (directors, twists, np.zeros((NODES + 1, 3)))))
        frames = Frames.of(position, orientation)
        none = jnp.zeros_like(position)
        numbers = (jnp.zeros(()), position, none, none, *[jnp.ones(())] * 3)
        strains = strains_of(FORCES, StepMap(*numbers, frames))
        strains += of_kind(Bend).rest_strain
        half = about - twist / 2  # the binormal as seen from the frame half way
        size = (2 * np.tan(bend / 2) + 4 * np.sin(bend / 2)) / 3
        expected = size * np.array([np.sin(half), -np.cos(half)])
        np.testing.assert_allclose(strains[1], [*expected, twist], rtol=0, atol=1e-12)
        np.testing.assert_allclose(np.delete(strains, 1, axis=0), 0, atol=1e-12)


@eqx.filter_jit
def strains_of(forces, stage):
    """Return the strains of all nodes but the tip, beyond those at rest."""
    return forces.strains(motion_of(forces, stage, jnp.zeros_like(stage.position))[0])


# --- loads and inertia -------------------------------------------------------------------------


def with_tip_load(**changes):
    """Return a changed load at the tip, alone."""
    forces = only(FORCES, TipLoad)
    *others, load = forces.elements
    return replace(forces, elements=(*others, replace(load, **changes)))


def test_the_moments_of_a_tip_load_are_those_that_it_says():
    dead, follower = np.array([0.05, 0.02, -0.04]), np.array([-0.06, 0.03, 0.05])
    for seed in SEEDS:
        stage = at_random(seed, turned=0.5)
        alone = with_tip_load(dead_force=jnp.zeros((1, 3)), follower_force=jnp.zeros((1, 3)))
        residual, _, _, motion = observe(alone, stage)
        force, moment = force_and_torque(motion.position, residual)
        np.testing.assert_allclose(force, 0, atol=1e-14)
        # the tip's frame: the last one, its tangent and its twist carried on by half an edge
        a, b = np.asarray(tangents(motion.position))[-2:]
        swing = np.cross(a, b)
        swing *= np.arctan2(np.linalg.norm(swing), a @ b) / np.linalg.norm(swing)
        carried = Rotation.from_rotvec(0.5 * swing)
        tip = carried.apply(b.copy())
        m_1 = carried.apply(np.array(motion.orientation.director[-1]))
        half = 0.5 * float(motion.orientation.twist[-2])
        m_1 = np.cos(half) * m_1 + np.sin(half) * np.cross(tip, m_1)
        frame = np.stack([tip, m_1, np.cross(tip, m_1)])
        np.testing.assert_allclose(moment, -(dead + follower @ frame), rtol=0, atol=1e-13)


def test_a_distributed_load_along_the_normal_is_along_m_2():
    stage = at_random(0, turned=0.5)
    residual, _, _, motion = observe(only(FORCES, DistributedLoad), stage)
    t = np.asarray(tangents(motion.position))[2:]
    normal = np.cross(t, np.asarray(motion.orientation.director)[2:])
    per_edge = EDGE * (0.4 * t - 0.7 * normal + np.array([0.2, 0.1, -0.3]))
    np.testing.assert_allclose(-residual[:, :3].sum(0), per_edge.sum(0), rtol=0, atol=1e-13)
    np.testing.assert_allclose(-residual[-1, :3], per_edge[-1] / 2, rtol=0, atol=1e-14)
    assert not np.asarray(residual[:, 3]).any()


def test_inertia_of_a_round_arm_is_that_of_its_mass_and_of_its_spin():
    # rho (I_1 + I_2) = m r^2 / 2 per length
    stage = at_random(1)
    residual, energy, power, motion = observe(only(FORCES, Inertia), stage)
    # of what runs linearly along an edge each end bears a third, and a sixth of the other end's
    mass = np.diag([2.0, *[4.0] * (NODES - 2), 2.0]) + np.eye(NODES, k=1) + np.eye(NODES, k=-1)
    mass *= 1.2 * EDGE / 6
    spin = EDGE * 1.2 * 1.0**2 / 2  # of radius 1
    a, v = np.asarray(motion.acceleration)[1:], np.asarray(motion.velocity)[1:]
    np.testing.assert_allclose(residual[1:, :3], mass @ a[:, :3], rtol=1e-12)
    np.testing.assert_allclose(residual[2:, 3], spin * a[1:, 3], rtol=1e-13)
    kinetic = 0.5 * np.sum(v[:, :3] * (mass @ v[:, :3])) + 0.5 * spin * np.sum(v[1:, 3] ** 2)
    np.testing.assert_allclose(energy, [kinetic, 0, 0], rtol=1e-13)
    assert not np.asarray(power).any()


# --- Newton's method ---------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [*KINDS, KINDS], ids=lambda k: getattr(k, "__name__", "all"))
def test_newton_converges_quadratically(kind):
    kinds = kind if isinstance(kind, tuple) else (kind,)
    forces = only(FORCES, Inertia, *kinds)
    stage = at_random(2, turned=0.3, turns=1)
    off = np.zeros((NODES + 1, 4))
    off[BOUNDARY_NODES:] = np.random.default_rng(4).uniform(-1, 1, (NODES - 1, 4)) * [
        *[EDGE / 20] * 3,
        0.3,
    ]
    assert_converges_quadratically(forces, stage, off, linear=kind in (Inertia, Weight))
