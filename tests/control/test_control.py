"""Clocks, sensors, targets and the PID, alone: against sequences worked out by hand."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PchipInterpolator

from crinoid.assembly.control_loop import _formula, lags
from crinoid.base import Base, Servo, SineMotion
from crinoid.control import (
    Clock,
    ControllerInput,
    FeedForward,
    Idle,
    Line,
    Pid,
    Sensor,
    SensorState,
    SubmarineFrame,
    Target,
    TipPose,
    damped_inverse,
)
from crinoid.control.controller import Reading
from crinoid.control.target import pose_error
from crinoid.foundation.axes import CHANNELS
from crinoid.numerics.piecewise import PiecewisePolynomial
from crinoid.numerics.ramp import Onset
from crinoid.scenario import Target as TargetTable

# --- clock -------------------------------------------------------------------------------------


@eqx.filter_jit
def _ticks(clock: Clock, times: Array) -> Array:
    def once(ticks: Array, time: Array) -> tuple[Array, Array]:
        due = clock.due(ticks, time)
        return ticks + due, due

    return jax.lax.scan(once, jnp.asarray(0), times)[1]


def ticks(period: float, times: np.ndarray) -> np.ndarray:
    """Return the steps at which a clock ticks."""
    return np.flatnonzero(_ticks(Clock(jnp.asarray(period)), jnp.asarray(times)))


LONG = 100_000
"""Steps of a long run, the same for all so that they share one compiled loop."""


@pytest.mark.parametrize(
    ("step", "steps_per_tick"), [(0.01, 1), (0.01, 2), (0.001, 7), (1 / 3, 3), (0.1, 10)]
)
@pytest.mark.parametrize("summed", [False, True], ids=["counted", "summed"])
def test_a_clock_ticks_at_every_whole_period(step, steps_per_tick, summed):
    # neither the round-off of n h nor that of h + h + ... may cost or add a tick in 1e5 steps
    times = step * np.arange(LONG)
    if summed:
        times = np.cumsum(np.full(LONG, step)) - step
    expected = np.arange(0, LONG, steps_per_tick)
    assert np.array_equal(ticks(steps_per_tick * step, times), expected)


@pytest.mark.parametrize("period", [0.003, 0.0137, 0.025, 0.1 * np.sqrt(2)])
def test_a_clock_out_of_step_ticks_at_the_first_step_at_or_after_its_time(period):
    step = 0.01
    # the quotient's round-off is 1e-16 of 1e5, the clock's own slack 1e-6 of a period
    expected = np.unique(np.ceil(np.arange(4 * LONG) * (period / step) - 1e-6 * period / step))
    assert np.array_equal(ticks(period, step * np.arange(LONG)), expected[expected < LONG])


# --- sensor ------------------------------------------------------------------------------------


def sensor(*, period=0.02, delay=0.0, noise=(0.0,) * 3, seed=0, resolution=0.0) -> Sensor:
    return Sensor(
        name="tip",
        measurand=TipPose(),
        clock=Clock(jnp.asarray(period)),
        delay=jnp.asarray(delay),
        noise=jnp.asarray(noise, float),
        resolution=jnp.broadcast_to(resolution, 3),
        key=jax.random.key(seed),
        kept=4,
    )


@eqx.filter_jit
def _watch(sensor: Sensor, state: SensorState, poses: Array, times: Array):
    def once(state: SensorState, now: tuple[Array, Array]) -> tuple[SensorState, Reading]:
        state = sensor.sample(state, *now)
        return state, sensor.reading(state, now[1])

    return jax.lax.scan(once, state, (poses, times))


WATCHED = 2000
"""Steps of a run with a sensor, the same for all so that they share one compiled loop."""


def watch(sensor: Sensor, poses: ArrayLike, step: float) -> Reading:
    """Return what is known of the tip at each time step; at the start, that it is at 9."""
    poses = jnp.broadcast_to(jnp.asarray(poses, float), (WATCHED, 3))
    _, known = _watch(sensor, sensor.start(jnp.full(3, 9.0)), poses, step * jnp.arange(WATCHED))
    return jax.tree.map(np.asarray, known)


def moving(step: float) -> np.ndarray:
    """Return poses that tell the time."""
    return step * np.arange(WATCHED)[:, None] * np.array([1, 2, -1])


@pytest.mark.parametrize(
    ("every", "delay", "late"),
    # a delay between two time steps is rounded up to the later one
    [(3, 0.0, 0), (2, 0.02, 2), (2, 0.05, 5), (2, 0.06, 6), (2, 0.013, 2)],
)
def test_a_sample_is_known_exactly_its_delay_later_with_its_time(every, delay, late):
    step = 0.01
    known = watch(sensor(period=every * step, delay=delay), moving(step), step)
    # before the first sample is known, the tip is known to be where it was at the start
    assert np.array_equal(known.value[:late], np.full((late, 3), 9.0))
    assert np.array_equal(known.measurement_time[:late], step * np.arange(late))
    sampled = every * step * (np.arange(WATCHED - late) // every)
    assert known.value[late:] == pytest.approx(sampled[:, None] * [1, 2, -1], abs=1e-12)
    assert np.array_equal(known.measurement_time[late:], known.value[late:, 0])


def test_noise_has_its_standard_deviation_and_no_memory():
    spread = np.array([0.01, 0.002, 0.1])
    pose = np.array([1.0, -2.0, 0.3])
    noise = watch(sensor(period=0.01, noise=spread), pose, 0.01).value - pose
    # of n samples the mean scatters by s / sqrt(n), the deviation by s / sqrt(2 n), a correlation
    # by 1 / sqrt(n): four times that leaves one seed in ten thousand out
    scatter = 4 / np.sqrt(WATCHED)
    assert np.abs(noise.mean(axis=0) / spread).max() < scatter
    assert noise.std(axis=0) / spread == pytest.approx(1.0, abs=scatter / np.sqrt(2))
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < scatter
    for coordinate in noise.T:
        assert abs(np.corrcoef(coordinate[1:], coordinate[:-1])[0, 1]) < scatter


def test_noise_depends_on_the_seed_and_on_nothing_else():
    def heard(seed: int, step: float) -> np.ndarray:
        known = watch(sensor(period=0.04, noise=[0.1] * 3, seed=seed), np.zeros(3), step).value
        return known[:: round(0.04 / step)]  # one reading per sample

    one = heard(1, 0.02)
    assert np.array_equal(one, heard(1, 0.02))
    assert np.array_equal(one[:400], heard(1, 0.01)[:400])
    assert np.abs(one - heard(2, 0.02)).max() > 0.1


@pytest.mark.parametrize("spread", [0.0, 0.1, -0.1])
def test_a_sample_follows_its_noise_from_none_on(spread):
    @jax.jit
    def sampled(noise: Array) -> Array:
        noisy = eqx.tree_at(lambda s: s.noise, sensor(), noise)
        return noisy.sample(noisy.start(jnp.zeros(3)), jnp.ones(3), jnp.zeros(())).samples[-1]

    noise = jnp.full(3, spread)
    drawn = np.diag(sampled(noise + 1.0) - sampled(noise))  # they are proportional
    assert np.abs(np.diag(drawn)).min() > 1e-3
    for slope in (jax.jacfwd(sampled), jax.jacrev(sampled)):
        np.testing.assert_allclose(slope(noise), drawn, rtol=1e-12, atol=1e-15)


def test_a_sensor_goes_on_from_its_state_as_if_never_stopped():
    noisy = sensor(period=0.03, delay=0.05, noise=[0.1] * 3)
    times, poses = 0.01 * jnp.arange(200), jnp.asarray(moving(0.01))[:200]
    start = noisy.start(jnp.zeros(3))
    _, whole = _watch(noisy, start, poses, times)
    state, before = _watch(noisy, start, poses[:100], times[:100])
    _, after = _watch(noisy, state, poses[100:], times[100:])
    assert np.array_equal(np.concatenate([before.value, after.value]), np.asarray(whole.value))


# --- target ------------------------------------------------------------------------------------


def test_a_path_follows_its_points_without_overshoot_and_is_held_before_and_after():
    points = np.array([[0.1, 0.5], [0.2, 0.5], [0.2, -0.3], [0.4, 0.1]])
    through = PchipInterpolator([1.0, 2.0, 4.0, 5.0], points)
    # x and the angle follow the points, z is fixed
    path = Target(jnp.asarray([9.0, -0.7, 9.0]), PiecewisePolynomial(through), (0, 2))
    times = np.array([*np.linspace(0.0, 6.0, 601), 80.0])
    x, z, angle = np.asarray(jax.jit(jax.vmap(path))(times)).T
    assert np.stack([x, angle], 1) == pytest.approx(through(np.clip(times, 1.0, 5.0)), abs=1e-14)
    assert np.all(z == -0.7)
    assert np.diff(x).min() >= -1e-15  # rising points, x of the middle two the same
    assert x[(times >= 2.0) & (times <= 4.0)] == pytest.approx(0.2, abs=1e-15)


# --- targets that move by a formula --------------------------------------------------------------


def by_formula(begin, **keys):
    """Return the path of a target that begins somewhere, and its velocity, over time."""
    path = _formula(TargetTable(**keys), np.asarray(begin))
    return jax.jit(jax.vmap(path)), jax.jit(jax.vmap(jax.jacfwd(path)))


BEGIN = [0.4, -10.0]
SECONDS = np.linspace(0.0, 12.0, 49)
TURN = {"path": "circle", "radius": 0.05, "period": 8.0}


def test_a_circle_begins_at_the_tip_and_turns_from_x_towards_z():
    def circle(turned):
        return 0.05 * np.stack([np.cos(turned), np.sin(turned)], axis=1)

    position, velocity = by_formula(BEGIN, **TURN, ramp_time=2.0)
    found = np.asarray(position(SECONDS)) - [0.35, -10.0]
    late = SECONDS >= 2.0
    # on half a cosine of a ramp half of its time is lost
    expected = circle(2 * np.pi * (SECONDS[late] - 1.0) / 8.0)
    assert found[late] == pytest.approx(expected, abs=1e-14)
    assert found[0] == pytest.approx([0.05, 0.0], abs=1e-15)
    speed = np.linalg.norm(velocity(SECONDS), axis=1)
    assert speed[0] == 0.0
    assert speed[late] == pytest.approx(2 * np.pi * 0.05 / 8.0)
    assert np.linalg.norm(found, axis=1) == pytest.approx(0.05)
    # about a centre, the other way round, from the top
    keys = TURN | {"period": -8.0, "centre": [1.0, 2.0], "phase_deg": 90.0, "ramp_time": 0.0}
    found = np.asarray(by_formula(BEGIN, **keys)[0](SECONDS)) - [1.0, 2.0]
    assert found == pytest.approx(circle(np.pi / 2 - 2 * np.pi * SECONDS / 8.0), abs=1e-14)


@pytest.mark.parametrize(
    ("normal", "first", "quarter"),
    [
        (None, [1, 0, 0], [0, 0, 1]),
        ([0, 0, 2], [1, 0, 0], [0, 1, 0]),
        # of any length
        ([5e-324, 0, 0], [0, 1, 0], [0, 0, 1]),
        ([1e-200, 0, 0], [0, 1, 0], [0, 0, 1]),
        ([1e200, 0, 0], [0, 1, 0], [0, 0, 1]),
        ([1, 1, 0], np.array([1, -1, 0]) / np.sqrt(2), [0, 0, -1]),
    ],
)
def test_a_circle_in_space_turns_about_its_normal(normal, first, quarter):
    keys = TURN | {"centre": [0, 0, 0], "normal": normal, "ramp_time": 0.0, "start": 2.0}
    found = np.asarray(by_formula([9.0, 9.0, 9.0], **keys)[0](np.array([0.0, 2.0, 4.0])))
    assert found / 0.05 == pytest.approx(np.array([first, first, quarter]), abs=1e-14)


def test_a_sine_swings_to_either_side():
    keys = {"path": "sine", "amplitude": [0.03, 0.04], "frequency_hz": 0.2, "ramp_time": 0.0}
    swing = np.sin(2 * np.pi * 0.2 * SECONDS)[:, None]
    found = np.asarray(by_formula(BEGIN, **keys)[0](SECONDS))
    assert found == pytest.approx(BEGIN + swing * [0.03, 0.04], abs=1e-14)
    found = by_formula(BEGIN, **keys, phase_deg=90.0)[0](SECONDS)
    assert np.asarray(found)[0] == pytest.approx(BEGIN, abs=1e-14)


def test_a_line_goes_on_at_its_velocity_or_ends_with_the_least_jerk():
    keys = {"path": "line", "velocity": [0.02, -0.01], "start": 1.0, "ramp_time": 4.0}
    late = SECONDS[SECONDS >= 5.0]
    found = np.asarray(by_formula(BEGIN, **keys)[0](late))
    assert found == pytest.approx(BEGIN + (late[:, None] - 3.0) * [0.02, -0.01], abs=1e-14)
    keys = {"path": "line", "to": [0.5, -9.8], "start": 1.0, "travel_time": 8.0}
    position, velocity = by_formula(BEGIN, **keys)
    share = np.clip((SECONDS - 1.0) / 8.0, 0.0, 1.0)
    way = share**3 * (10 - 15 * share + 6 * share**2)
    expected = BEGIN + way[:, None] * [0.1, 0.2]
    assert np.asarray(position(SECONDS)) == pytest.approx(expected, abs=1e-13)
    assert np.asarray(velocity(np.array([1.0, 9.0, 11.0]))) == pytest.approx(0.0, abs=1e-12)


# --- a target that moves with the submarine ------------------------------------------------------


@pytest.mark.parametrize("axes", [2, 3])
def test_a_target_fixed_to_the_submarine_moves_and_turns_with_it(axes):
    def pointing(ahead):
        return jnp.arctan2(ahead[1], ahead[0])[None] if axes == 2 else ahead

    count = len(CHANNELS[axes])
    rng = np.random.default_rng(axes)
    motions = tuple(
        SineMotion(index, *map(jnp.asarray, (*rng.uniform(0.2, 0.5, 2), 0.7)))
        for index in range(count)
    )
    base = Base(
        jnp.asarray(rng.uniform(-0.5, 0.5, 1 if axes == 2 else 3)),
        jnp.asarray(0.02),
        Servo(*map(jnp.asarray, np.tile([[-1.0], [1.0], [1.0], [1.0], [1.0]], count))),
        motions,
    )
    carrier = SubmarineFrame(base, jnp.asarray(rng.normal(size=axes)))
    # half a metre along the root, and pointing as the root does: there it stays
    ahead = base.direction(jnp.zeros(count))
    fixed = jnp.concatenate([0.5 * ahead, pointing(ahead)])
    time = jnp.asarray(1.3)
    pose, _, _ = base.pose(time, base.servo.at_rest())
    turned = base.direction(pose)
    carried = carrier.to_world(fixed, time)
    place = carrier.origin + pose[:axes] + 0.5 * turned
    expected = np.concatenate([place, pointing(turned)])
    assert np.asarray(carried) == pytest.approx(expected, abs=1e-14)
    back = np.asarray(carrier.to_frame(carried, time))
    assert back == pytest.approx(np.asarray(fixed), abs=1e-14)
    # a second point keeps its distance from the first
    other = jnp.asarray(rng.normal(size=fixed.size))
    between = (carrier.to_world(other, time) - carried)[:axes]
    assert np.linalg.norm(between) == pytest.approx(np.linalg.norm((other - fixed)[:axes]))


# --- feed-forward --------------------------------------------------------------------------------


def test_a_channel_aims_at_where_the_target_will_be_once_it_has_followed():
    line = Line(jnp.asarray([1.0, 2.0]), jnp.asarray([0.1, -0.2]), Onset.of(0.0, 0.0))
    target = Target(jnp.asarray([9.0, 9.0, 0.3]), line, (0, 1))
    mapping = jnp.asarray([[2.0, 0.0, 5.0], [0.0, 1.0, 5.0]])
    known = FeedForward(mapping, jnp.asarray([0.05, 0.02]), jnp.asarray(3.0))
    given = np.asarray(known(target, jnp.asarray(7.0)))
    assert given == pytest.approx([2.0 * 0.1 * 4.05, -0.2 * 4.02], abs=1e-14)


def test_a_servo_follows_a_ramp_by_its_lag():
    servo = Servo(*(jnp.full(1, x) for x in (-9.0, 9.0, 9.0, 99.0, 2.0)))

    def once(state, command):
        return servo.advance(state, command[None], jnp.asarray(0.01)), None

    state, _ = jax.lax.scan(once, servo.at_rest(), 0.2 * 0.01 * jnp.arange(300))
    # a command is held for a step: on the average it is half a step old
    behind = 0.2 * 3.0 - float(state.position[0])
    assert behind == pytest.approx(0.2 * (lags([servo])[0] + 0.005), rel=1e-4)


def test_a_reading_is_rounded_to_the_resolution():
    known = watch(sensor(period=0.01, resolution=0.5), moving(0.01), 0.01)
    np.testing.assert_array_equal(known.value, 0.5 * np.round(moving(0.01) / 0.5))


def test_angles_are_corrected_the_short_way_round():
    for wanted, measured, short in (
        (0.3, 0.1, 0.2),
        (3.0, -3.0, 6.0 - 2 * np.pi),
        (-3.0, 3.0, 2 * np.pi - 6.0),
        (0.1, 0.1 + 4 * np.pi, 0.0),
        (3.1, 0.0, 3.1),
        (3.2, 0.0, 3.2 - 2 * np.pi),
    ):
        error = pose_error(jnp.asarray([0.5, 7.0, wanted]), jnp.asarray([0.2, -7.0, measured]))
        # places are not angles: 14 m is 14 m
        assert np.asarray(error) == pytest.approx([0.3, 14.0, short], abs=1e-14)


# --- spline ------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [CubicSpline, PchipInterpolator])
def test_a_piecewise_cubic_is_the_one_it_is_built_from(kind):
    values = np.array([[0.0, 1.0], [2.0, -1.0], [0.5, 0.0], [0.7, 3.0], [0.6, 2.0]])
    source = kind(np.array([0.0, 0.3, 1.1, 1.2, 2.5]), values)
    spline, at = PiecewisePolynomial(source), jnp.linspace(0.0, 2.5, 51)
    assert np.asarray(jax.vmap(spline)(at)) == pytest.approx(source(at), abs=1e-13)
    slopes = jax.vmap(jax.jacfwd(spline))(at)  # at its first and last knots too
    assert np.asarray(slopes) == pytest.approx(source(at, 1), abs=1e-11)


# --- PID ---------------------------------------------------------------------------------------

PERIOD = 0.1


def pid(*, kp=0.0, ki=0.0, kd=0.0, filter_time=0.0, take_up=0.0, mapping=((1.0, 0.0, 0.0),)) -> Pid:
    """One channel that moves x, unless a mapping says otherwise."""
    gains = (jnp.full(len(mapping), x) for x in (kp, ki, kd, filter_time))
    return Pid(*gains, jnp.asarray(mapping), jnp.asarray(PERIOD), jnp.asarray(take_up))


def seen(
    measured: ArrayLike, wanted: ArrayLike, feedforward: ArrayLike, limit: float
) -> ControllerInput:
    """Return what is seen of a tip, with limits of all inputs."""
    now, feedforward = jnp.zeros(()), jnp.asarray(feedforward)
    none = jnp.zeros_like(feedforward)
    return ControllerInput(
        time=now,
        measured=jnp.asarray(measured),
        measurement_time=now,
        reference=jnp.asarray(wanted),
        feedforward=feedforward,
        target=Target(jnp.zeros(3), None, ()),
        base=none,
        command=none,
        actuators=(),
        lower=none - limit,
        upper=none + limit,
        readings={},
    )


_command = eqx.filter_jit(Pid.command)


def commands(pid, measured, wanted, feedforward=0.0, limit=100.0) -> np.ndarray:
    """Return the commands of one channel for tips whose x is given; one per call."""
    given, memory = [], None
    for x, to, ahead in zip(*np.broadcast_arrays(measured, wanted, feedforward), strict=True):
        now = seen([float(x), 0.0, 0.0], [float(to), 0.0, 0.0], [float(ahead)], limit)
        memory = pid.start(now) if memory is None else memory
        command, memory = _command(pid, memory, now)
        given.append(float(command[0]))
    return np.array(given)


BY_HAND = {
    # -kd dy / h; a target that moves does not kick
    "derivative of the measurement": (
        {"kd": 0.2},
        ([0.0, 0.0, 0.3, 0.3, 0.2], [0.0, 1.0, 1.0, 5.0, 5.0]),
        [0.0, 0.0, -0.6, 0.0, 0.2],
    ),
    "at the upper limit": ({"kp": 3.0, "ki": 5.0}, ([0.0] * 20, 1.0, 0.0, 0.5), 0.5),
    "at the lower limit": ({"kp": 3.0, "ki": 5.0}, ([0.0] * 20, -1.0, 0.0, 0.5), -0.5),
    "feed-forward within limits": (
        {"kp": 2.0},
        ([0.0, 0.3, 1.2], [0.0, 0.4, 1.0], [0.1, 0.2, 3.0], 1.0),
        [0.1, 0.4, 1.0],
    ),
    # at the upper limit a negative error must unwind what is there
    "integral that leads back from the limit": (
        {"ki": 1.0},
        ([0.0] * 10 + [2.0] * 5, 1.0, 0.0, 0.25),
        [0.1, 0.2] + [0.25] * 8 + [0.1, 0.0, -0.1, -0.2, -0.25],
    ),
}
"""Gains; x, target, feed-forward and limit; commands."""


@pytest.mark.parametrize("name", BY_HAND)
def test_commands_are_those_worked_out_by_hand(name):
    gains, given, expected = BY_HAND[name]
    found = commands(pid(**gains), *given)
    assert found == pytest.approx(expected, abs=1e-14)
    assert np.abs(found).max() <= (given[3] if len(given) > 3 else np.inf)


def test_all_terms_add_up():
    kp, ki, kd, filter_time = 1.5, 0.8, 0.3, 0.2
    x = np.array([0.0, 0.4, 0.9, 1.1])
    given = commands(pid(kp=kp, ki=ki, kd=kd, filter_time=filter_time), x, 1.0)
    slopes = [0.0]  # T s' + s = dy/dt by backward Euler
    for moved in np.diff(x):
        slopes.append((filter_time * slopes[-1] + moved) / (filter_time + PERIOD))
    expected = kp * (1.0 - x) + ki * PERIOD * np.cumsum(1.0 - x) - kd * np.array(slopes)
    assert given == pytest.approx(expected, abs=1e-14)


def test_errors_are_mapped_to_channels():
    mapping = [[2.0, 0.0, 0.5], [0.0, -1.0, 0.0], [0.0, 0.0, 3.0]]
    controller = pid(kp=1.0, mapping=mapping)
    now = seen([0.1, 0.2, 3.0], [0.3, 0.5, -3.0], [0.0] * 3, 100.0)
    command, _ = _command(controller, controller.start(now), now)
    expected = mapping @ np.array([0.2, 0.3, 2 * np.pi - 6.0])
    assert np.asarray(command) == pytest.approx(expected, abs=1e-14)


def test_a_tip_that_moves_as_asked_for_is_not_held_back_nor_wound_up():
    x = 0.05 * np.sin(0.3 * np.arange(40))
    given = commands(pid(kp=1.0, ki=2.0, kd=0.5, filter_time=0.1), x, x, x)
    assert given == pytest.approx(x, abs=1e-14)
    # and beyond a limit nothing is wound up that would delay the way back
    feedforward = np.where(np.arange(60) < 40, 3.0, 0.5)
    given = commands(pid(ki=2.0), np.minimum(feedforward, 1.0), feedforward, feedforward, limit=1.0)
    assert given == pytest.approx(np.minimum(feedforward, 1.0), abs=1e-14)


def test_what_is_there_at_the_first_call_is_taken_up_along_half_a_cosine():
    terms = {"kp": 1.5, "ki": 0.8, "kd": 0.4, "filter_time": 0.2}
    x, wanted = np.array([0.2, 0.2, 0.25, 0.4]), np.array([1.0, 1.1, 1.2, 1.3])
    feedforward = np.array([0.3, 0.4, 0.5, 0.6])
    given = commands(pid(**terms, take_up=0.2), x, wanted, feedforward)
    assert given[0] == 0.0
    # half of it is left at the second call, and nothing from the third on
    left = np.array([1.0, 0.5, 0.0, 0.0])
    eased = commands(pid(**terms), x, wanted - 0.8 * left, feedforward - 0.3 * left)
    assert given == pytest.approx(eased, abs=1e-14)
    # where nothing is there, nothing changes
    rest = (x, wanted - 0.8, feedforward - 0.3)
    at_once = commands(pid(**terms), *rest)
    assert commands(pid(**terms, take_up=9.0), *rest) == pytest.approx(at_once, abs=1e-14)


def test_idle_commands_nothing():
    now = seen([1.0, 2.0, 3.0], [0.0] * 3, [1.0, 2.0, 3.0], 1.0)
    command, memory = Idle().command(Idle().start(now), now)
    assert memory is None
    assert np.array_equal(command, np.zeros(3))


# --- mapping -----------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(3, 2), (2, 3), (3, 3), (4, 1)])
def test_a_damped_inverse_is_that_of_least_squares_where_no_direction_is_nearly_lost(shape):
    left, _, right = np.linalg.svd(np.random.default_rng(3).normal(size=shape), full_matrices=False)
    values = np.linspace(1.0, 0.06, min(shape))  # down to just over a twentieth
    jacobian = (left * values) @ right
    np.testing.assert_allclose(damped_inverse(jacobian), np.linalg.pinv(jacobian), atol=1e-12)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_a_damped_inverse_asks_little_for_what_hardly_any_command_undoes(size):
    def gain(share):
        """Return by how much a direction is undone that follows commands by a share."""
        turn = np.array([[0.6, -0.8], [0.8, 0.6]])
        inverse = damped_inverse(size * turn @ np.diag([1.0, share]))
        # the other direction is inverted whatever the share
        np.testing.assert_allclose(inverse @ turn[:, 0], [1 / size, 0], atol=1e-12 / size)
        return size * (inverse @ turn[:, 1])[1]

    # 1 / s down to a twentieth; below, s / e^2: it is continuous, falls, and ends with nothing
    assert gain(0.05) == pytest.approx(20.0)
    assert gain(0.049999) == pytest.approx(20.0, rel=1e-4)
    assert gain(0.01) == pytest.approx(0.01 * 400)
    assert gain(0.0) == 0.0
    np.testing.assert_array_equal(damped_inverse(np.zeros((3, 2))), np.zeros((2, 3)))
