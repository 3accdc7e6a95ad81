"""The spatial arm in time, where it is more than the planar one: twist, the world's directions.

What holds in the plane as well is in `test_dynamics.py`.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from crinoid.elements import ENERGIES
from crinoid.foundation.axes import CHANNELS
from crinoid.numerics.frames import tangents
from helpers import motion
from helpers.arms import QUICKLY, acting, facing
from helpers.motion import (
    advance,
    at,
    march,
    rest,
    ring_down,
    run,
    submerged,
    vector,
    vibrations,
    whole_step,
    wrench,
)

pytestmark = pytest.mark.usefixtures("optimised")

NODES = motion.NODES[3]
EDGES = NODES - 1
ROLL = CHANNELS[3].index("roll")
TURN = 2 * np.pi

dry, spatial = partial(motion.dry, 3), partial(submerged, 3)


@eqx.filter_jit(compiler_options=QUICKLY)
def _inertia(system, motion):
    def kinetic(velocity):
        moving = eqx.tree_at(lambda m: m.velocity, motion, velocity)
        return acting(system).arm.energy(moving)[ENERGIES.index("kinetic")]

    return jax.hessian(kinetic)(jnp.zeros_like(motion.velocity))


def momentum(system, state, velocity):
    """Return the momentum of all nodes, the held ones too, and the spin's of each edge.

    It is the slope of the kinetic energy by the velocities, which is linear in them: of
    accelerations it is the rate of change.
    """
    return np.tensordot(velocity, _inertia(system, state.motion), axes=2)


# --- vibration ---------------------------------------------------------------------------------


def torsion(mode):
    """Return the circular frequency of a mode of twist, and that of a chain of ``EDGES`` edges.

    (2 n - 1) pi / 2 sqrt(GJ / rho J) / L, with rho J = m r^2 / 2 (Blevins 1979, table 8-16); of
    masses in the middle of the edges, with half an edge's spring at the clamp, a sine's difference.
    """
    speed = np.sqrt(0.8 / 0.5)
    exact = (2 * mode + 1) * np.pi / 2 * speed
    return exact, 2 * EDGES * speed * np.sin(exact / speed / EDGES / 2)


@pytest.mark.slow
def test_frequencies_of_twist_are_those_of_a_wave_along_the_arm():
    frequency, shapes = vibrations(spatial(), 3)
    assert len(frequency) >= 4
    for mode in range(4):
        exact, chain = torsion(mode)
        assert frequency[mode] == pytest.approx(chain, rel=1e-10)
        assert frequency[mode] == pytest.approx(exact, rel=0.5 * (exact / EDGES) ** 2)
        middles = (np.arange(EDGES) + 0.5) / EDGES
        sine = np.sin((2 * mode + 1) * np.pi / 2 * middles)
        shape = shapes[mode, 1:, 3]
        np.testing.assert_allclose(shape, sine * (shape[-1] / sine[-1]), rtol=0, atol=1e-9)


@pytest.mark.release
@pytest.mark.parametrize("mode", [0, 2])
def test_a_mode_of_twist_rings_at_its_frequency_and_damping(mode):
    damping_time = 0.01
    linear = {"drag_normal": 0.0, "drag_tangential": 0.0, "tolerance": 1e-12}
    frequency, pole = ring_down(spatial(damping_time=damping_time, **linear), 3, mode)
    assert frequency == pytest.approx(torsion(mode)[1], rel=1e-10)
    assert abs(pole) == pytest.approx(frequency, rel=1e-8)
    assert -pole.real / abs(pole) == pytest.approx(damping_time * frequency / 2, rel=1e-7)


@pytest.mark.release
def test_water_lowers_the_frequencies_of_bending_but_not_of_twist():
    # m = 1 kg/m, rho A = 0.6 kg/m, Ca = 1.5
    wet = {"displaced_area": 6e-4, "added_mass_normal": 1.5}
    lower, unlike = np.sqrt(1 / (1 + 1.5 * 0.6)), {"EA": 1e6, "EI": (1.0, 1.7)}
    for column, share in ((1, lower), (2, lower), (3, 1.0)):
        dry_, wet_ = (vibrations(spatial(**case, **unlike), column)[0][:2] for case in ({}, wet))
        np.testing.assert_allclose(wet_ / dry_, share, rtol=1e-9)


# --- energy ------------------------------------------------------------------------------------


def swinging(load, radius):
    return dry(
        EI=(0.8, 1.5),
        radius=radius,
        rest_curvature=(0.4, 0.0, 2.0),
        gravity=load,
        pan=0.3,
        roll=0.5,
        tolerance=1e-12,
    )


def gained(start, states):
    """Return how much the energy of each state is above the first's, over the largest kinetic."""
    kinetic = states.energy[:, ENERGIES.index("kinetic")].max()
    return (states.energy.sum(axis=1) - float(start.energy.sum())) / kinetic


@pytest.mark.slow
@pytest.mark.parametrize(
    ("load", "radius", "step", "spin", "travel", "band"),
    [(2.0, 0.3, 0.01, 0.4, 10.0, 2e-4), (10.0, 0.05, 0.0025, 10.0, 20.0, 2e-3)],
    ids=["gentle", "wild"],
)
def test_energy_of_an_undamped_swing_stays_in_a_band(load, radius, step, spin, travel, band):
    # 1e4 steps. The large load makes the motion chaotic, which stirs up ever faster vibrations; and
    # of one that turns by an angle x in a step the trapezoid rule misses the share x^2 / 6 of its
    # energy (what it keeps is in `test_dynamics.py`). So the energy seems to sink
    system = swinging(load, radius)
    start = rest(system)
    states = run(system, start, until=1e4 * step, steps=10_000)
    assert np.abs(states.motion.velocity[:, 2:, 3]).max() > spin
    assert np.abs(np.diff(states.position[:, -1], axis=0)).sum(axis=0).min() > travel
    assert states.energy[:, ENERGIES.index("kinetic")].max() > 0.04 * load
    assert np.abs(gained(start, states)).max() < band


# --- the plane in space, and the directions of the world ---------------------------------------


@pytest.mark.slow
def test_an_arm_confined_to_the_plane_moves_as_the_planar_arm():
    def case(axes):
        turning = {"moment": 0.1, "follower_moment": 0.05}
        if axes == 3:
            turning = {name: (0.0, -about, 0.0) for name, about in turning.items()}
        return submerged(
            axes,
            nodes=NODES,
            EA=1e3,
            EI=0.7,
            damping_time=0.03,
            gravity=9.81,
            diameter=0.032,
            rest_curvature=0.6,
            displaced_area=8e-4,
            added_mass_tangential=0.2,
            linear_drag=0.5,
            tilt=0.3,
            tolerance=1e-13,
            swing={"slide": 0.05, "heave": -0.04, "tilt": 0.2},
            onset=(0.0, 0.3),
            tool=1.0,
            current=vector(axes, 0.3, -0.2),
            swaying=vector(axes, 0.4, 0.5),
            tangential=0.1,
            normal=0.3,
            fixed=vector(axes, 0.2, 0.3),
            dead=vector(axes, 0.2, 0.6),
            follower=vector(axes, 0.1, 0.3),
            **turning,
        )

    there, flat = (run(system, rest(system), until=1.5, steps=300) for system in map(case, (3, 2)))
    assert np.ptp(flat.position[:, -1], axis=0).min() > 0.2
    (force, moment), (flat_force, flat_moment) = map(wrench, (there, flat))
    for got, expected in (
        (there.position, flat.position),
        (there.velocity, flat.velocity),
        (np.asarray(force), flat_force),
    ):
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(got[..., [0, 2]], expected, rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(got[..., 1], 0, atol=1e-9 * scale)
    np.testing.assert_allclose(moment[:, 1], -flat_moment, rtol=0, atol=1e-9)
    np.testing.assert_allclose(there.energy, flat.energy, rtol=0, atol=1e-9)
    np.testing.assert_allclose(there.work, flat.work, rtol=0, atol=1e-9)
    np.testing.assert_allclose(there.motion.orientation.twist, 0, atol=1e-9)


def turned(rotation, case):
    """Turn what has a direction in the world."""
    directed = ("fixed", "dead", "moment", "current", "swaying")
    return case | {name: rotation.apply(case[name]) for name in directed if name in case}


@pytest.mark.slow
@pytest.mark.parametrize("gravity", [0.0, 9.81], ids=["any", "about the vertical"])
def test_the_motion_does_not_depend_on_the_directions_of_the_world(gravity):
    # the base's angles are those that the rotation makes of it; it rolls as its path says
    case = {
        "EI": (0.8, 1.3),
        "rest_curvature": (0.5, -0.7, 1.1),
        "damping_time": 0.05,
        "displaced_area": 8e-4,
        "diameter": 0.032,
        "radius": 0.2,
        "linear_drag": 0.5,
        "tolerance": 1e-12,
        "current": (0.3, -0.4, 0.1),
        "swaying": (0.2, 0.3, -0.4),
        "paths": {"roll": ((0.0, 1.0, 2.0, 3.0), (0.0, 2.0, 1.0, 4.0))},
        "onset": (0.0, 0.4),
        "tangential": 0.1,
        "normal": 0.3,
        "fixed": (0.2, -0.2, 0.3),
        "dead": (0.2, 0.4, 0.6),
        "follower": (0.1, -0.2, 0.3),
        "moment": (0.1, 0.05, -0.2),
        "follower_moment": (0.2, -0.1, 0.1),
        "gravity": gravity,
    }
    level = Rotation.from_euler("zyx", [0.4, -0.2, -0.6])

    def moved(rotation):
        system = spatial(**turned(rotation, case), **facing((rotation * level).as_matrix()))
        return run(system, rest(system), until=1.0, steps=200)

    plain = moved(Rotation.identity())
    assert np.ptp(plain.position[:, -1], axis=0).min() > 0.1
    for seed in range(2):
        rotation = Rotation.random(random_state=seed)
        if gravity:
            rotation = Rotation.from_rotvec([0.0, 0.0, 2.0 + 3.0 * seed])
        states, back = moved(rotation), rotation.as_matrix()
        for got, expected in zip(
            (states.position, states.velocity, *wrench(states)),
            (plain.position, plain.velocity, *wrench(plain)),
            strict=True,
        ):
            scale = max(1.0, np.abs(expected).max())
            np.testing.assert_allclose(got @ back, expected, rtol=0, atol=1e-8 * scale)
        orientation, expected = states.motion.orientation, plain.motion.orientation
        np.testing.assert_allclose(orientation.director @ back, expected.director, atol=1e-8)
        np.testing.assert_allclose(orientation.twist, expected.twist, rtol=0, atol=1e-8)
        np.testing.assert_allclose(
            states.motion.velocity[..., 3], plain.motion.velocity[..., 3], rtol=0, atol=1e-7
        )


# --- the base ----------------------------------------------------------------------------------


def tumbling(**properties):
    """Build an arm in a vacuum on a base that moves in all channels, and rolls several turns."""
    return dry(
        **{
            "EI": (0.8, 1.3),
            "rest_curvature": (0.5, -0.7, 1.1),
            "radius": 0.2,
            "pan": 0.4,
            "tilt": 0.2,
            "roll": -0.6,
            "damping_time": 0.02,
            "swing": {
                "slide": 0.06,
                "sway": -0.05,
                "heave": 0.04,
                "pan": 0.5,
                "tilt": -0.4,
                "roll": 0.9,
            },
            "paths": {"roll": ((0.0, 1.0, 2.0, 3.0), np.array([0.0, 2.5, 3.0, 0.0]) * TURN)},
            "tolerance": 1e-12,
        }
        | properties
    )


@pytest.fixture(scope="module")
def tumble():
    system = tumbling()
    return system, run(system, rest(system), until=2.0, steps=1000)


@pytest.mark.slow
def test_the_clamp_follows_the_base_through_several_turns(tumble):
    system, states = tumble
    servo = system.base.servo.at_rest()
    for n in range(99, 1000, 100):
        state = at(states, n)
        pose, _, _ = system.base.pose(state.time, servo)
        frame = np.asarray(system.base.frame(pose))
        ghost, root = np.asarray(state.position[:2])
        np.testing.assert_allclose(root, pose[:3], rtol=0, atol=1e-14)
        np.testing.assert_allclose((root - ghost) * EDGES, frame[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.motion.orientation.director[1], frame[1], atol=1e-12)
    # velocities of the clamp by differences of places and frames
    h = float(states.time[1] - states.time[0])
    for rows, rates in ((states.position, states.velocity), (states.velocity, states.acceleration)):
        difference = (rows[2:, :2] - rows[:-2, :2]) / (2 * h)
        scale = np.abs(rates[:, :2]).max()
        np.testing.assert_allclose(difference, rates[1:-1, :2], rtol=0, atol=2e-3 * scale)
    director = states.motion.orientation.director[:, 1]
    clamp = (states.position[:, 1] - states.position[:, 0]) * EDGES
    rate = (director[2:] - director[:-2]) / (2 * h)
    spin = np.sum(np.cross(clamp, director)[1:-1] * rate, axis=1)
    expected = states.motion.velocity[1:-1, 1, 3]
    assert np.abs(expected).max() > 10.0
    np.testing.assert_allclose(spin, expected, rtol=0, atol=2e-3 * np.abs(expected).max())


@pytest.mark.slow
def test_the_base_feels_the_rate_of_change_of_momentum(tumble):
    # in a vacuum without gravity. Rotary inertia of the arm is that of its spin alone, about the
    # edge's own axis: what it takes to turn that axis is left out
    system, states = tumble
    change, spinning = np.split(
        momentum(system, at(states, 0), states.motion.acceleration), [3], axis=-1
    )
    force = -np.sum(change, axis=1)
    got_force, got_moment = wrench(states)
    lever = states.position - states.position[:, 1:2]
    moment = -np.cross(lever, change).sum(axis=1)
    scale = np.abs(force).max()
    assert scale > 5.0
    np.testing.assert_allclose(got_force, force, rtol=0, atol=1e-8 * scale)
    tangent = np.stack([np.asarray(tangents(jnp.asarray(x))) for x in states.position[::50]])
    spun = spinning[::50] * tangent
    assert np.abs(spun).max() > 1e-2
    np.testing.assert_allclose(
        got_moment[::50], moment[::50] - spun.sum(axis=1), rtol=0, atol=1e-8 * scale
    )


# --- turns that are wound up, and turns that are not -------------------------------------------


def by_turns(turns, within):
    """Return a table of roll: from rest to whole turns within a time (s), and held there."""
    time = np.linspace(0.0, 2 * within, 41)
    share = np.clip(time / within, 0.0, 1.0)
    return time, TURN * turns * share**2 * (3 - 2 * share)


@pytest.mark.slow
@pytest.mark.parametrize("gravity", [0.0, 4.0], ids=["straight", "hanging"])
def test_rolling_the_base_carries_a_round_arm_along_and_winds_up_nothing(gravity):
    # it rolls about its own line, whether that is straight or an arc
    case = {"radius": 0.2, "gravity": gravity, "damping_time": 0.2, "pan": 0.3}
    idle = dry(**case, paths={"roll": by_turns(0.0, 2.0)})
    still = march(idle, rest(idle), until=16.0, steps=800)
    assert bool(gravity) == (float(still.position[-1, 2]) < -0.3)
    system = dry(**case, paths={"roll": by_turns(3.0, 2.0)})
    start = eqx.tree_at(lambda s: s.motion.time, still, jnp.zeros(()))
    states = run(system, start, until=2.0, steps=400)
    # on the way it twists, and a bent arm is carried off sideways by its damping
    assert np.abs(states.motion.orientation.twist).max() > 0.05
    sideways = states.position @ [-np.sin(0.3), np.cos(0.3), 0.0]
    assert bool(gravity) == (np.abs(sideways).max() > 0.05)
    end = march(system, at(states, -1), until=16.0, steps=800)
    np.testing.assert_allclose(end.position, still.position, rtol=0, atol=1e-7)
    np.testing.assert_allclose(end.motion.orientation.twist, 0, atol=1e-7)
    director = still.motion.orientation.director
    np.testing.assert_allclose(end.motion.orientation.director, director, rtol=0, atol=1e-6)


@pytest.mark.slow
def test_rolling_the_base_turns_an_arm_that_is_not_round():
    # a naturally bent arm goes round with the base: after a quarter turn it points to starboard
    case = {"radius": 0.2, "damping_time": 0.2, "rest_curvature": (0.0, 1.0, 0.0), "EI": (1.0, 1.5)}
    system = dry(**case, paths={"roll": by_turns(2.25, 1.0)})
    start = rest(system)
    end = march(system, march(system, start, until=2.0, steps=400), until=20.0, steps=800)
    x, _, z = np.asarray(start.position).T
    # roll from +y toward +z turns what points up to -y
    np.testing.assert_allclose(end.position, np.stack([x, -z, 0 * x], axis=1), rtol=0, atol=1e-6)


def writhe(places):
    """Return the writhe of a closed polygon: the Gauss integral over all pairs of edges.

    Of two edges the solid angle of the directions from one to the other (Klenin and Langowski,
    Biopolymers 54 (2000) 307-317, method 1a).
    """
    nodes = np.asarray(places)
    ahead = np.roll(nodes, -1, axis=0)
    count, total = len(nodes), 0.0
    for i in range(count):
        j = np.arange(i + 2, count if i else count - 1)
        if not len(j):
            continue
        a, b, c, d = nodes[i], ahead[i], nodes[j], ahead[j]
        to = [c - a, d - a, d - b, c - b]
        faces = [np.cross(to[k], to[(k + 1) % 4]) for k in range(4)]
        faces = [face / (np.linalg.norm(face, axis=1)[:, None] + 1e-300) for face in faces]
        cosines = [np.sum(faces[k] * faces[(k + 1) % 4], axis=1) for k in range(4)]
        angle = np.sum(np.arcsin(np.clip(cosines, -1, 1)), axis=0)
        sign = np.sign(np.sum(np.cross(d - c, b - a) * (c - a), axis=1))
        total += np.sum(angle * sign) / (2 * np.pi)  # twice over 4 pi
    return total


def linked(state):
    """Return the twist and the writhe (turns) of an arm whose ends go on upward and downward."""
    places, far = np.asarray(state.position), 1e5
    up, down = places[0] + far * np.array([0, 0, 1.0]), places[-1] - far * np.array([0, 0, 1.0])
    aside = far * np.array([1.0, 0.0, 0.0])
    loop = np.concatenate([places, [down, down + aside, up + aside, up]])
    return np.sum(np.asarray(state.motion.orientation.twist)) / TURN, writhe(loop)


@pytest.mark.release
def test_turns_of_the_tip_and_the_base_become_twist_and_writhe():
    # Calugareanu, White, Fuller: of a ribbon, link = twist + writhe. An arm that hangs and is
    # naturally bent is wound at its tip by a torque, at its base by its roll, until it coils up;
    # its ends go on straight down and up. So the twist and the writhe together change by what the
    # director turns about the vertical at the tip, less what it turns at the base
    torque = 4.6 * 0.8 * TURN  # GJ = 0.8
    system = dry(
        radius=0.3,
        damping_time=0.1,
        tilt=-np.pi / 2,
        EI=(1.0, 1.2),
        dead=(0.0, 0.0, -53.0),
        rest_curvature=(2.5, 0.0, 0.0),
        moment=(0.0, 0.0, -torque),
        onset=(0.0, 2.0),
        paths={"roll": by_turns(-1.0, 2.0)},
        tolerance=1e-11,
    )
    start = rest(system)
    states = run(system, start, until=1.94, steps=800)  # soon after it passes through itself

    down = np.array([0.0, 0.0, -1.0])
    before, wound, links = None, 0.0, []
    every = jax.tree.map(lambda first, later: np.concatenate([first[None], later]), start, states)
    for n in range(len(every.time)):
        state = jax.tree.map(lambda leaf, n=n: leaf[n], every)
        last = state.position[-1] - state.position[-2]
        last = last / np.linalg.norm(last)
        assert last @ down > -0.9
        director = state.motion.orientation.director[-1]
        share = director @ down / (1 + last @ down)
        carried = director - share * (last + down)  # transport to straight down
        angle = np.arctan2(down @ np.cross([1.0, 0.0, 0.0], carried), carried[0])
        unwrap_from = 0.0 if before is None else np.angle(np.exp(1j * (angle - before)))
        assert abs(unwrap_from) < 1.0
        wound, before = wound + unwrap_from / TURN, angle
        if n % 40 == 0:
            pose, _, _ = system.base.pose(jnp.asarray(state.time), system.base.servo.at_rest())
            links.append([*linked(state), wound, float(pose[ROLL]) / TURN])
    twist, writhes, tip, roll = np.array(links).T
    assert tip[-1] > 3.0
    assert np.ptp(writhes) > 0.4
    assert np.ptp(twist) > 1.0
    np.testing.assert_allclose(twist + writhes - (tip - roll), 0, atol=1e-5)


# --- folds -------------------------------------------------------------------------------------


def sharpest(state):
    edges = np.diff(np.asarray(state.position), axis=0)
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    return np.rad2deg(np.arccos(np.clip(np.sum(edges[1:] * edges[:-1], axis=1), -1, 1))).max()


def folding(calm, seed, *, outer, bent, turn, step):
    """Bend a straight arm sharply, its ``outer`` edges on their way to ``turn`` within a step."""
    places, velocity = np.array(calm.motion.position), np.zeros((NODES + 1, 4))
    hinge = places[-1 - outer, :3].copy()
    # in the plane of m_2, so that m_1 stays normal; and a little out of it
    velocity[2:] = 2e-3 * np.random.default_rng(seed).normal(size=(NODES - 1, 4)) / step
    fold = Rotation.from_rotvec([0.0, -np.deg2rad(bent), 0.0])
    for node in range(-outer, 0):
        lever = fold.apply(places[node, :3] - hinge)
        places[node, :3] = hinge + lever
        velocity[node, :3] += np.cross([0.0, -np.deg2rad(turn) / step, 0.0], lever)
    return eqx.tree_at(
        lambda s: (s.motion.position, s.motion.velocity, s.motion.acceleration),
        calm,
        (jnp.asarray(places), jnp.asarray(velocity), jnp.zeros((NODES + 1, 4))),
    )


@pytest.mark.release
@pytest.mark.parametrize(
    ("EI", "step"), [(5e-2, 0.005), (1e-5, 0.005), (1e-7, 0.02)], ids=["soft", "limp", "a string"]
)
def test_a_step_over_a_fold_is_refused_and_cut(EI, step):
    system = spatial(
        EI=EI, GJ=EI, EA=10.0, damping_time=1e-3, displaced_area=1e-6, radius=0.02, diameter=2e-3
    )
    calm = rest(system)
    refused, recovered, short = 0, 0, step
    for seed in range(4):
        for outer in (1, 3):
            for bent, turn in ((150, 20), (150, 30), (150, 40), (165, 20)):
                start = folding(calm, seed, outer=outer, bent=bent, turn=turn, step=step)
                whole, outcome = whole_step(system, start, step)
                if outcome.converged:
                    assert sharpest(whole) < 170.0
                if outcome.folded:
                    assert not outcome.converged
                    assert sharpest(whole) > 170.0
                    refused += 1
                state, progress = advance(system, start, short)
                for leaf in jax.tree.leaves(state):
                    assert np.isfinite(leaf).all()
                assert sharpest(state) < 170.0
                assert progress.outcome.converged == (float(state.time) == pytest.approx(step))
                recovered += bool(progress.outcome.converged & outcome.folded)
    assert refused > 8
    # what has some stiffness bounces
    assert recovered == (refused if EI == 5e-2 else 0)


@pytest.mark.slow
def test_what_is_not_a_number_is_never_accepted():
    system = spatial(gravity=9.81)
    calm = rest(system)
    for part in ("position", "velocity"):
        for column in range(4):
            rows = getattr(calm.motion, part).at[5, column].set(jnp.nan)
            broken = eqx.tree_at(lambda s, part=part: getattr(s.motion, part), calm, rows)
            _, outcome = whole_step(system, broken, 0.01)
            assert not outcome.converged
