"""Free bodies: they roll, slide, collide and turn as on paper."""

from operator import itemgetter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.dynamics import Integrator
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.tangent_assembly import assemble_tangent
from crinoid.elements import Pair
from crinoid.numerics.frames import moments
from helpers.arms import QUICKLY, acting, arm, obstacles, order

RADIUS, MASS, GRAVITY = 0.05, 0.5, 9.81
SKIN = 0.02 * RADIUS
FAR = {"nodes": 5, "EA": None, "EI": None, "radius": 0.02, "youngs_modulus": 5e5,
       "mass_per_length": 1.3, "length": 0.5, "diameter": 0.04}  # fmt: skip
both = pytest.mark.parametrize("axes", [2, 3], ids=["plane", "space"])


def bodies(axes, places, *, step, arms=None, **numbers):
    """Build an arm in a vacuum, far from some bodies."""
    settings = FAR | {"axes": axes, "GJ": 1.0 if axes == 3 else None} | (arms or {})
    return arm(obstacles=obstacles(places, **numbers), time_step=step, **settings)


CHUNK = 100
"""Steps of one compiled run: as many for all, so that each make of a system is compiled once."""


@eqx.filter_jit(compiler_options=QUICKLY)
def run(system, start):
    """Return the states after each of some steps, none halved."""

    def one(state, _):
        after, outcome = system.step(state, jnp.zeros(len(system.inputs)))
        return after, (after, outcome.converged)

    return jax.lax.scan(one, start, length=CHUNK)[1]


def marched(system, count):
    """Return the start and the states of a run in which all steps converged."""
    assert count % CHUNK == 0
    start = state = system.rest()
    parts = []
    for _ in range(count // CHUNK):
        states, good = run(system, state)
        assert good.all()
        state = jax.tree.map(itemgetter(-1), states)
        parts.append(jax.tree.map(np.asarray, states))
    return start, jax.tree.map(lambda *leaves: jnp.asarray(np.concatenate(leaves)), *parts)


# --- a ball on a slope -------------------------------------------------------------------------

SLOPE = np.deg2rad(20.0)


def on_slope(
    axes, friction, *, step=2e-3, arms=None, slope=SLOPE, gravity=GRAVITY, gap=None, **numbers
):
    """Build a ball that lies on a slope, which falls along x, or is at a gap from it."""
    normal = np.array([np.sin(slope), 0.0, np.cos(slope)])
    down = np.array([np.cos(slope), 0.0, -np.sin(slope)])
    kept = [0, 2] if axes == 2 else [0, 1, 2]
    foot = np.array([2.0, 0.5, -3.0])
    if gap is None:
        strength = 32 * 5e5 * 0.02**2 + 100 * MASS * gravity
        gap = -SKIN * (MASS * gravity * np.cos(slope) / strength) ** 0.25
    places = np.stack([foot + (RADIUS + gap) * normal, foot])[:, kept]
    system = bodies(
        axes,
        places,
        step=step,
        arms={"integrator": Integrator.generalized_alpha(0.8)} | (arms or {}),
        radius=[RADIUS, 0.0],
        normal=np.stack([0 * normal, normal])[:, kept],
        friction=[0.0, friction],
        mass=[MASS, np.inf],
        gravity=gravity,
        pairs=[Pair(0, 1, 0.0)],
        **numbers,
    )
    return system, down[kept], normal[kept]


def slope_motion(system, states, down):
    """Return speed down the slope (m/s) and spin that rolls that way (rad/s)."""
    speed = np.asarray(states.obstacle_velocity)[:, 0] @ down
    spin = np.asarray(states.motion.velocity)[:, system.forces.rows.rotations][:, 0]
    # down along x: turned from z toward x, about +y
    return speed, -spin[:, 0] if down.size == 2 else spin[:, 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "axes", [2, pytest.param(3, marks=pytest.mark.release)], ids=["plane", "space"]
)
def test_a_ball_rolls_down_a_slope_at_five_sevenths_of_gravity(axes):
    system, down, _ = on_slope(axes, 0.5)
    _, states = marched(system, 200)
    speed, spin = slope_motion(system, states, down)
    time = np.asarray(states.time)
    found = (speed[-1] - speed[50]) / (time[-1] - time[50])
    assert found == pytest.approx(5 / 7 * GRAVITY * np.sin(SLOPE), rel=1e-3)
    # it hardly slips
    np.testing.assert_allclose(RADIUS * spin[50:], speed[50:], atol=1e-3)
    assert speed[-1] > 0.8


@pytest.mark.release
def test_rolling_resistance_slows_a_ball_as_on_paper():
    length = 0.2 * RADIUS * np.tan(SLOPE)
    system, down, _ = on_slope(3, 0.5, rolling=[0.0, length])
    _, states = marched(system, 200)
    speed, spin = slope_motion(system, states, down)
    time = np.asarray(states.time)
    found = (speed[-1] - speed[50]) / (time[-1] - time[50])
    # (m + J / R^2) a = m g sin - l N / R
    expected = 5 / 7 * GRAVITY * (np.sin(SLOPE) - length / RADIUS * np.cos(SLOPE))
    assert found == pytest.approx(expected, rel=1e-3)
    np.testing.assert_allclose(RADIUS * spin[50:], speed[50:], atol=1e-3)


@pytest.mark.release
def test_a_ball_rests_on_a_slope_that_rolling_resistance_holds():
    system, down, _ = on_slope(3, 0.5, rolling=[0.0, 1.5 * RADIUS * np.tan(SLOPE)])
    _, states = marched(system, 200)
    _, spin = slope_motion(system, states, down)
    # it creeps: two thirds of the moment hold it, x / sqrt(x^2 + creep^2) = 2 / 3
    assert RADIUS * spin[-1] == pytest.approx(1e-3 / np.sqrt(1.5**2 - 1), rel=0.01)


@pytest.mark.release
def test_spinning_friction_slows_a_ball_that_spins_about_the_normal():
    length, rate = 2e-3, 40.0
    spin = [[0.0, 0.0, rate], [0.0, 0.0, 0.0]]
    system, _, normal = on_slope(3, 0.5, spinning=[0.0, length], slope=0.0, spin=spin)
    start, states = marched(system, 100)
    spin = np.asarray(states.motion.velocity)[:, system.forces.rows.rotations][:, 0, :3]
    found = (rate - spin[-1] @ normal) / (states.time[-1] - start.time)
    moment, inertia = length * MASS * GRAVITY, 0.4 * MASS * RADIUS**2
    assert float(found) == pytest.approx(moment / inertia, rel=1e-3)
    # it does not roll away, and loses the work of that moment
    assert np.abs(spin[:, :2]).max() < 1e-9
    turned = np.trapezoid(np.append(rate, spin @ normal), dx=float(system.time_step))
    lost = 0.5 * inertia * (rate**2 - (spin[-1] @ normal) ** 2)
    assert lost == pytest.approx(moment * turned, rel=1e-3)


@pytest.mark.release
def test_a_ball_slides_where_friction_is_less_than_two_sevenths_of_the_slope():
    friction = 0.5 * 2 / 7 * np.tan(SLOPE)
    system, down, normal = on_slope(3, friction)
    _, states = marched(system, 200)
    speed, spin = slope_motion(system, states, down)
    time = np.asarray(states.time)
    slides, turns = ((x[-1] - x[50]) / (time[-1] - time[50]) for x in (speed, spin))
    expected = GRAVITY * (np.sin(SLOPE) - friction * np.cos(SLOPE))
    assert slides == pytest.approx(expected, rel=1e-3)
    assert turns == pytest.approx(2.5 * friction * GRAVITY * np.cos(SLOPE) / RADIUS, rel=1e-3)
    np.testing.assert_allclose(
        np.asarray(states.obstacle_velocity)[50:, 0] @ normal, 0.0, atol=1e-4
    )


@pytest.mark.release
def test_the_plane_and_space_agree_on_a_rolling_ball():
    ends = []
    for axes in (2, 3):
        system, _, _ = on_slope(axes, 0.5)
        _, states = marched(system, 200)
        ends.append(np.asarray(states.obstacle_position)[-1, 0, [0, axes - 1]])
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-12)


@pytest.mark.release
def test_a_ball_that_overlaps_a_plane_within_the_skin_is_pushed_off():
    system, _, normal = on_slope(3, 0.0, step=2e-5, gravity=0.0, gap=-0.5 * SKIN)
    _, states = marched(system, 200)
    stored = 32 * 5e5 * 0.02**2 * SKIN * 0.5**5 / 5
    speed = np.asarray(states.obstacle_velocity)[:, 0] @ normal
    assert np.asarray(states.body_gap)[-1, 0] > SKIN
    assert 0.5 * MASS * speed[-1] ** 2 == pytest.approx(stored, rel=1e-2)


@pytest.mark.parametrize(("by", "touching"), [(10.0, False), (0.3, True)])
def test_free_bodies_that_overlap_by_more_than_the_skin_are_refused(by, touching):
    ball = {"kind": "sphere", "radius": RADIUS, "mass": 0.5}
    scenario = crinoid.Scenario.from_dict(
        {
            "arm": {"length": 0.5, "nodes": 5},
            "obstacle": [
                ball | {"position": [1.0, -10.0]},
                ball | {"position": [1.0 + 2 * RADIUS - 1e-3 * by, -10.0]},
            ],
        }
    )
    if touching:
        assert Prepared(scenario).room.min() > 0.4
        return
    text = r"obstacle\.0\.position: overlaps obstacle\.1 by 10 mm\. Move it clear of that\."
    with pytest.raises(crinoid.ScenarioError, match=text):
        crinoid.simulate(scenario)


@pytest.mark.parametrize(
    ("key", "mass", "message"),
    [
        ("rolling_friction", None, "be left out without a free body and another obstacle"),
        ("spinning_friction", 0.5, "be left out in the plane"),
    ],
)
def test_resistance_that_nothing_feels_is_refused(key, mass, message):
    ball = {"kind": "sphere", "position": [1.0, -10.0], "radius": RADIUS, "mass": mass, key: 1e-3}
    plane = {"kind": "plane", "position": [0.0, -11.0], "normal": [0.0, 1.0]}
    with pytest.raises(crinoid.ScenarioError, match=rf"obstacle\.0\.{key}: .*{message}"):
        crinoid.Scenario.from_dict({"obstacle": [ball, plane]})


@pytest.mark.parametrize(
    "axes", [2, pytest.param(3, marks=pytest.mark.slow)], ids=["plane", "space"]
)
def test_a_body_with_a_heavy_bottom_swings_as_on_paper(axes):
    height, density, rate = 0.01, 1000.0, 1.0
    inertia, displaced = 0.4 * MASS * RADIUS**2, density * 4 / 3 * np.pi * RADIUS**3
    expected = 2 * np.pi * np.sqrt(inertia / (displaced * GRAVITY * height))
    swing = rate * expected / (2 * np.pi)
    spin = np.zeros((2, 1 if axes == 2 else 3))
    spin[0, spin.shape[1] // 2] = rate  # about y
    system, _, _ = on_slope(
        axes,
        0.0,
        step=expected / 200,
        arms={"integrator": Integrator.newmark()},
        gap=10.0,
        spin=spin,
        metacentric_height=height,
        density=density,
    )
    _, states = marched(system, 200)
    found = np.asarray(states.motion.velocity)[:, system.forces.rows.rotations]
    found, time = found[:, 0, spin.shape[1] // 2], np.asarray(states.time)
    before = np.flatnonzero(np.diff(np.sign(found)))
    assert before.size == 2
    slope = np.diff(found)[before] / np.diff(time)[before]
    crossed = time[before] - found[before] / slope
    # a pendulum's period at this amplitude
    assert 2 * np.diff(crossed)[0] == pytest.approx(expected * (1 + swing**2 / 16), rel=3e-4)


# --- two bodies that collide -------------------------------------------------------------------


def two_bodies(places, *, step, **numbers):
    """Build two free bodies in space, of one make for all tests."""
    return bodies(
        3,
        places,
        step=step,
        arms={"tolerance": 1e-13},
        radius=[0.05, 0.04],
        half_axis=np.zeros((2, 3)),
        friction=[0.4, 0.2],
        mass=[0.4, 0.2],
        length=0.0,
        pairs=[Pair(1, 0, 0.0)],
        **numbers,
    )


def colliding():
    """Build two balls that meet beside their centres."""
    return two_bodies(
        [[3.0, 0.0, 0.0], [3.09, 0.04, 0.02]],
        step=5e-5,
        velocity=[[0.2, 0.1, 0.0], [-0.3, 0.0, -0.1]],
        inertia=np.outer([5e-4, 1.3e-4], np.ones(3)),
        spin=[[2.0, 1.0, -1.0], [0.0, -3.0, 2.0]],
    )


def momenta(system, states):
    """Return momentum and angular momentum of the bodies at each instant."""
    free, rows = system.forces.obstacles.bodies, system.forces.rows
    place, speed = np.asarray(states.obstacle_position), np.asarray(states.obstacle_velocity)
    mass = np.asarray(free.body.mass)[:, None]
    spin = np.asarray(states.motion.velocity)[:, rows.rotations, :3]
    attitude, inertia = np.asarray(states.obstacle_attitude), np.asarray(free.body.inertia)
    own = np.einsum("tmij,mjk,tmlk,tml->tmi", attitude, inertia, attitude, spin)
    cross = np.asarray(moments(jnp.asarray(place), jnp.asarray(mass * speed)))
    return np.sum(mass * speed, axis=1), np.sum(own + cross, axis=1), own


@pytest.mark.slow
def test_a_collision_keeps_momentum_and_angular_momentum():
    system = colliding()
    start, states = marched(system, 1200)
    first = jax.tree.map(lambda x: x[None], start)
    linear, angular, own = momenta(system, states)
    linear_before, angular_before, own_before = momenta(system, first)
    # they met, rubbed, and parted
    gap = np.asarray(states.body_gap)[:, 0]
    assert gap.min() < 0.04 * 0.02 < min(gap[-1], float(start.body_gap[0]))
    assert np.abs(own[-1] - own_before[0]).max() > 1e-4
    for after, before in ((linear, linear_before), (angular, angular_before)):
        np.testing.assert_allclose(after[-1], before[0], rtol=0, atol=1e-9 * np.abs(before).max())


@eqx.filter_jit
def _pushed(forces, motion):
    rows = motion.position
    (contacts,) = forces.body_contacts(rows)
    laws = contacts, forces.obstacles.bodies.law(len(forces.nodes(rows)), forces.pose)
    total = sum(law.scatter(law.residuals(motion)[:, 0], rows.shape) for law in laws)
    return total[forces.rows.obstacle_rows]


@pytest.mark.release
def test_forces_of_capsules_on_each_other_have_no_resultant_and_no_moment():
    half = [[0.03, 0.05, -0.02], [0.06, -0.02, 0.03]]
    system = bodies(
        3,
        [[3.0, 0.0, 0.0], [3.02, 0.03, 0.0959]],
        step=1e-4,
        radius=[0.05, 0.04],
        half_axis=half,
        friction=0.4,
        rolling=2e-3,
        spinning=1e-3,
        velocity=[[0.2, 0.1, 0.3], [-0.3, 0.0, -0.1]],
        mass=[0.4, 0.2],
        spin=[[2.0, 1.0, -1.0], [0.0, -3.0, 2.0]],
        pairs=[Pair(0, 1, 1.0), Pair(0, 1, -1.0)],
    )
    state = system.rest()
    assert np.asarray(state.body_gap).max() < 0.0008
    forces, still = acting(system), jnp.zeros_like(state.motion.acceleration)
    motion = eqx.tree_at(lambda m: m.acceleration, state.motion, still)
    place = np.asarray(state.obstacle_position)
    rows = np.asarray(_pushed(forces, motion))[:, :3]
    alone = eqx.tree_at(lambda f: f.obstacles.bodies.contacts[0].strength, forces, jnp.zeros(2))
    rows = rows - np.asarray(_pushed(alone, motion))[:, :3]
    force, moment = rows[:2], rows[2:]
    assert np.abs(force).min() > 1e-3
    assert np.abs(moment).max() > 1e-2
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose((moment + np.cross(place, force)).sum(axis=0), 0.0, atol=1e-12)


# --- a body that turns freely ------------------------------------------------------------------


@pytest.mark.release
def test_a_top_keeps_energy_and_angular_momentum_at_order_two():
    lost, turned = [], []
    for count in (200, 400, 800):
        # the other body is far away and still
        system = two_bodies(
            [[3.0, 0.0, 0.0], [5.0, 0.0, 0.0]],
            step=1.0 / count,
            inertia=np.array([[1e-3, 2e-3, 2.5e-3], [1e-3, 1e-3, 1e-3]]),
            spin=[[1.0, 12.0, 0.3], [0.0, 0.0, 0.0]],
        )
        start, states = marched(system, count)
        first = jax.tree.map(lambda x: x[None], start)
        _, angular, own = momenta(system, states)
        _, before, _ = momenta(system, first)
        spin = np.asarray(states.motion.velocity)[:, system.forces.rows.rotations, :3]
        energy = 0.5 * np.sum(own * spin, axis=(1, 2))
        initial = 0.5 * np.array([1e-3, 2e-3, 2.5e-3]) @ np.array([1.0, 12.0, 0.3]) ** 2
        lost.append(np.abs(energy - initial).max() / initial)
        turned.append(np.abs(angular - before).max() / np.abs(before).max())
        # the middle axis is unstable: it turns over
        assert np.asarray(states.obstacle_attitude)[:, 0, 1, 1].min() < 0.0
    assert lost[-1] < 1e-3
    np.testing.assert_allclose(order(lost), 2.0, atol=0.2)
    np.testing.assert_allclose(order(turned), 2.0, atol=0.2)


# --- tangent and gradient ----------------------------------------------------------------------


def lying():
    """Build an arm on a capsule that lies on a plane, with a ball that leans on it, in water."""
    half = np.zeros((3, 3))
    half[0, 0] = 0.08
    normal = np.zeros((3, 3))
    normal[2, 2] = 1.0
    rng = np.random.default_rng(3)
    return bodies(
        3,
        [[0.33, 0.0, -0.0495], [0.33 + 0.08 + 0.04239, 0.0, -0.0643], [0.0, 0.0, -0.0792]],
        step=1e-3,
        arms={"nodes": 6, "damping_time": 0.02, "water_density": 1000.0, "gravity": GRAVITY},
        radius=[0.03, 0.015, 0.0],
        half_axis=half,
        normal=normal,
        friction=0.4,
        rolling=1e-3,
        spinning=5e-4,
        velocity=0.1 * rng.normal(size=(3, 3)) * [[1.0], [1.0], [0.0]],
        mass=[0.7, 0.02, np.inf],
        length=0.16 * (np.arange(2) == 0),
        spin=rng.normal(size=(3, 3)) * [[1.0], [1.0], [0.0]],
        density=1000.0,
        gravity=GRAVITY,
        pairs=[Pair(0, 2, 1.0), Pair(0, 2, -1.0), Pair(1, 0, 0.0), Pair(1, 2, 0.0)],
    )


@pytest.mark.release
def test_the_tangent_is_the_slope_of_the_residual():
    system = lying()
    state = system.rest()
    skin = 0.02 * np.array([0.03, 0.03, 0.015, 0.015])
    assert (np.asarray(state.body_gap) < 0.8 * skin).all()
    assert float(state.gap[0].min()) < 0.001
    forces, motion = acting(system), state.motion
    h = 1e-3
    rates = map(jnp.asarray, (1.0, 2 / h, 4 / h**2))
    stage = StepMap(
        state.time, motion.position, motion.velocity, motion.acceleration, *rates, state.frames
    )
    # a finite rotation within the step
    rng = np.random.default_rng(5)
    turned = np.zeros(motion.position.shape)
    turned[forces.rows.rotations, :3] = 1e-3 * rng.normal(size=(3, 1))
    turned[forces.rows.rotations][2] = 0.0

    def residual(correction):
        current = forces.surroundings(stage, jnp.asarray(turned))
        return forces.unknown(forces.residual(forces.motion(stage, correction, current))[0])

    @jax.jit
    def solved(rhs):
        current = forces.surroundings(stage, jnp.asarray(turned))
        now = forces.motion(stage, jnp.asarray(turned), current)
        return assemble_tangent(forces, stage, now, current).solve(rhs)

    @jax.jit
    def along(correction, way):
        return jax.jvp(residual, (correction,), (way,))

    unknown = np.zeros(turned.shape, bool)
    unknown[forces.rows.nodes] = True
    unknown[:2] = False
    index = list(forces.obstacles.bodies.unknowns(turned.shape[1]))
    unknown[forces.rows.obstacle_rows].reshape(-1)[index] = True
    rhs = jnp.asarray(np.where(unknown, rng.normal(size=turned.shape), 0.0))
    change = np.asarray(solved(rhs))
    assert not change[~unknown].any()
    expected = np.asarray(forces.unknown(rhs))
    exact = along(jnp.asarray(turned), jnp.asarray(change))[1]
    np.testing.assert_allclose(exact, expected, rtol=1e-8, atol=1e-9)
    size = 1e-6 / np.abs(change).max()
    ahead, behind = (
        along(jnp.asarray(turned + way * size * change), jnp.asarray(change))[0] for way in (1, -1)
    )
    # as far as round-off of differences lets it
    np.testing.assert_allclose((ahead - behind) / (2 * size), expected, atol=2e-3)


@pytest.mark.release
def test_the_gradient_through_a_rolling_contact_agrees_with_differences():
    system, down, _ = on_slope(2, 0.5, arms={"tolerance": 1e-13})
    start = system.rest()

    def distance(system):
        def one(state, _):
            after, _ = system.step(state, jnp.zeros(3))
            return after, None

        end, _ = jax.lax.scan(one, start, length=40)
        return end.obstacle_position[0] @ down + 0.01 * end.motion.velocity[-2, 0]

    def scaled(factor):
        def where(s):
            return s.forces.obstacles.bodies.body.inertia

        return distance(eqx.tree_at(where, system, factor * where(system)))

    @jax.jit
    def both_ways(factor):
        """Return the distance, and its slope in forward and in reverse mode."""
        value, linear = jax.linearize(scaled, factor)
        return value, linear(1.0), jax.linear_transpose(linear, factor)(1.0)[0]

    (ahead, *_), (behind, *_) = (both_ways(1 + change) for change in (1e-5, -1e-5))
    difference = float(ahead - behind) / 2e-5
    assert abs(difference) > 1e-4
    np.testing.assert_allclose(both_ways(1.0)[1:], difference, rtol=1e-5)
