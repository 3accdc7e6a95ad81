"""Clocks, sensors, targets and the PID, alone: against sequences worked out by hand."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PchipInterpolator

from crinoid.assembly.lags import lags
from crinoid.assembly.target import _formula, _plane_of
from crinoid.base import Base, Servo, SineMotion
from crinoid.control import (
    Carrier,
    Clock,
    FeedForward,
    Idle,
    Line,
    Pid,
    Seen,
    Sensor,
    SensorState,
    Target,
    TipPose,
    damped_inverse,
)
from crinoid.control.pid import PidMemory
from crinoid.control.target import pose_error
from crinoid.onset import Onset
from crinoid.scenario import Target as TargetTable
from crinoid.space import ANGLES, CHANNELS
from crinoid.spline import PiecewisePolynomial

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


@pytest.mark.parametrize("period", [0.0137, 0.025, 0.1 * np.sqrt(2)])
def test_a_clock_out_of_step_ticks_at_the_first_step_at_or_after_its_time(period):
    step = 0.01
    ticked = ticks(period, step * np.arange(LONG))
    # the quotient's round-off is 1e-16 of 1e5, the clock's own slack 1e-6 of a period
    expected = np.ceil(np.arange(LONG) * (period / step) - 1e-6 * period / step)
    assert np.array_equal(ticked, expected[expected < LONG])


def test_a_clock_faster_than_the_steps_ticks_at_every_step():
    assert np.array_equal(ticks(0.003, 0.01 * np.arange(LONG)), np.arange(LONG))


# --- sensor ------------------------------------------------------------------------------------


def sensor(
    *,
    period: float = 0.02,
    delay: float = 0.0,
    noise: ArrayLike = (0.0,) * 3,
    seed: int = 0,
    resolution: float = 0.0,
) -> Sensor:
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
def _watch(sensor: Sensor, first: Array, poses: Array, times: Array) -> tuple[SensorState, Array]:
    def once(state: SensorState, now: tuple[Array, Array]) -> tuple[SensorState, Array]:
        pose, time = now
        state = sensor.sample(state, pose, time)
        return state, sensor.reading(state, time).value

    return jax.lax.scan(once, sensor.start(first), (poses, times))


WATCHED = 2000
"""Steps of a run with a sensor, the same for all so that they share one compiled loop."""


def watch(
    sensor: Sensor, poses: ArrayLike, step: float, first: ArrayLike = (9.0, 9.0, 9.0)
) -> np.ndarray:
    """Return what is known of the tip at each time step."""
    poses = jnp.broadcast_to(jnp.asarray(poses, float), (WATCHED, 3))
    times = step * jnp.arange(WATCHED)
    return np.asarray(_watch(sensor, jnp.asarray(first), poses, times)[1])


def moving(step: float) -> np.ndarray:
    """Return poses that tell the time."""
    time = step * np.arange(WATCHED)
    return np.stack([time, 2 * time, -time], axis=1)


def test_a_sensor_without_delay_knows_what_it_samples():
    known = watch(sensor(period=0.03), moving(0.01), 0.01)
    sampled = 0.03 * (np.arange(WATCHED) // 3)
    assert known == pytest.approx(np.stack([sampled, 2 * sampled, -sampled], 1), abs=1e-12)


@pytest.mark.parametrize("delay", [0.02, 0.05, 0.06])
def test_a_sample_is_known_exactly_its_delay_later(delay):
    step, late = 0.01, round(delay / 0.01)
    known = watch(sensor(period=0.02, delay=delay), moving(step), step)
    # before the first sample is known, the tip is known to be where it was at the start
    assert np.array_equal(known[:late], np.full((late, 3), 9.0))
    sampled = 0.02 * (np.arange(WATCHED - late) // 2)
    assert known[late:, 0] == pytest.approx(sampled, abs=1e-12)


def test_a_delay_between_time_steps_is_rounded_up_to_the_next():
    known = watch(sensor(period=0.02, delay=0.013), moving(0.01), 0.01)
    sampled = 0.02 * (np.arange(WATCHED - 2) // 2)
    assert known[2:, 0] == pytest.approx(sampled, abs=1e-12)


def test_noise_has_its_standard_deviation_and_no_memory():
    spread = np.array([0.01, 0.002, 0.1])
    pose = np.array([1.0, -2.0, 0.3])
    noise = watch(sensor(period=0.01, noise=spread), pose, 0.01) - pose
    # of n samples the mean scatters by s / sqrt(n), the deviation by s / sqrt(2 n), a correlation
    # by 1 / sqrt(n): four times that leaves one seed in ten thousand out
    scatter = 4 / np.sqrt(WATCHED)
    assert np.abs(noise.mean(axis=0) / spread).max() < scatter
    assert noise.std(axis=0) / spread == pytest.approx(1.0, abs=scatter / np.sqrt(2))
    between = np.corrcoef(noise.T)
    assert np.abs(between - np.eye(3)).max() < scatter
    for coordinate in noise.T:
        assert abs(np.corrcoef(coordinate[1:], coordinate[:-1])[0, 1]) < scatter


def test_noise_depends_on_the_seed_and_on_nothing_else():
    def heard(seed: int, step: float) -> np.ndarray:
        known = watch(sensor(period=0.04, noise=[0.1] * 3, seed=seed), np.zeros(3), step)
        return known[:: round(0.04 / step)]  # one reading per sample

    assert np.array_equal(heard(1, 0.02), heard(1, 0.02))
    assert np.array_equal(heard(1, 0.02)[:400], heard(1, 0.01)[:400])
    assert np.abs(heard(1, 0.02) - heard(2, 0.02)).max() > 0.1


@pytest.mark.parametrize("spread", [0.0, 0.1, -0.1])
def test_a_sample_follows_its_noise_from_none_on(spread):
    begun = sensor().start(jnp.zeros(3))

    @jax.jit
    def sampled(noise: Array) -> Array:
        noisy = eqx.tree_at(lambda s: s.noise, sensor(), noise)
        return noisy.sample(begun, jnp.ones(3), jnp.zeros(())).samples[-1]

    noise = jnp.full(3, spread)
    drawn = np.diag(sampled(noise + 1.0) - sampled(noise))  # they are proportional
    assert np.abs(np.diag(drawn)).min() > 1e-3
    for slope in (jax.jacfwd(sampled), jax.jacrev(sampled)):
        np.testing.assert_allclose(slope(noise), drawn, rtol=1e-12, atol=1e-15)


def test_a_sensor_can_be_stopped_and_taken_up_again():
    noisy = sensor(period=0.03, delay=0.05, noise=[0.1] * 3)
    times, poses = 0.01 * jnp.arange(200), jnp.asarray(moving(0.01))[:200]
    first = jnp.zeros(3)
    _, whole = _watch(noisy, first, poses, times)
    state, before = _watch(noisy, first, poses[:100], times[:100])

    def once(state: SensorState, now: tuple[Array, Array]) -> tuple[SensorState, Array]:
        state = noisy.sample(state, *now)
        return state, noisy.reading(state, now[1]).value

    _, after = jax.lax.scan(once, state, (poses[100:], times[100:]))
    assert np.array_equal(np.concatenate([before, after]), np.asarray(whole))


# --- target ------------------------------------------------------------------------------------


def test_a_fixed_target():
    target = Target(jnp.asarray([0.5, -0.2, 0.1]), None, ())
    for time in (0.0, 7.0):
        assert np.asarray(target(jnp.asarray(time))) == pytest.approx([0.5, -0.2, 0.1])


TIMES = np.array([1.0, 2.0, 4.0, 5.0])
POINTS = np.array([[0.1, 0.5], [0.2, 0.5], [0.2, -0.3], [0.4, 0.1]])


def path() -> Target:
    """A target of fixed z whose x and angle follow points."""
    through = PiecewisePolynomial(PchipInterpolator(TIMES, POINTS))
    return Target(jnp.asarray([9.0, -0.7, 9.0]), through, (0, 2))


@pytest.mark.parametrize("point", range(4))
def test_a_path_passes_through_its_points(point):
    x, z, angle = path()(jnp.asarray(TIMES[point]))
    assert np.stack([x, angle]) == pytest.approx(POINTS[point], abs=1e-14)
    assert z == -0.7


@pytest.mark.parametrize(("time", "point"), [(0.0, 0), (0.999, 0), (5.001, -1), (80.0, -1)])
def test_a_path_is_held_before_and_after(time, point):
    x, z, angle = path()(jnp.asarray(time))
    assert np.stack([x, angle]) == pytest.approx(POINTS[point], abs=1e-15)
    assert z == -0.7


def test_a_path_between_points_does_not_overshoot_them():
    times = np.linspace(1.0, 5.0, 401)
    x, _, angle = np.asarray(jax.vmap(path())(jnp.asarray(times))).T
    expected = PchipInterpolator(TIMES, POINTS)(times)
    assert np.stack([x, angle], 1) == pytest.approx(expected, abs=1e-14)
    assert np.diff(x).min() >= -1e-15  # rising points, x of the middle two the same
    between = (times >= 2.0) & (times <= 4.0)
    assert x[between] == pytest.approx(0.2, abs=1e-15)


# --- targets that move by a formula --------------------------------------------------------------


def by_formula(begin, **keys):
    """Return positions over time, of the path of a target that begins somewhere."""
    path = _formula(TargetTable(**keys), np.asarray(begin))
    return jax.jit(jax.vmap(path)), jax.jit(jax.vmap(jax.jacfwd(path)))


SECONDS = np.linspace(0.0, 12.0, 49)
TURN = {"path": "circle", "radius": 0.05, "period": 8.0}


def test_a_circle_begins_at_the_tip_and_turns_from_x_towards_z():
    position, velocity = by_formula([0.4, -10.0], **TURN, ramp_time=2.0)
    found = np.asarray(position(SECONDS)) - [0.35, -10.0]
    # on half a cosine of a ramp half of its time is lost
    turned = 2 * np.pi * (SECONDS - 1.0) / 8.0
    late = SECONDS >= 2.0
    expected = 0.05 * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    assert found[late] == pytest.approx(expected[late], abs=1e-14)
    assert found[0] == pytest.approx([0.05, 0.0], abs=1e-15)
    speed = np.linalg.norm(velocity(SECONDS), axis=1)
    assert speed[0] == 0.0
    assert speed[late] == pytest.approx(2 * np.pi * 0.05 / 8.0)
    assert np.linalg.norm(found, axis=1) == pytest.approx(0.05)
    # about a centre, the other way round, from the top
    keys = TURN | {"period": -8.0, "centre": [1.0, 2.0], "phase_deg": 90.0, "ramp_time": 0.0}
    found = by_formula([0.4, -10.0], **keys)[0](SECONDS)
    turned = np.pi / 2 - 2 * np.pi * SECONDS / 8.0
    expected = 0.05 * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    assert np.asarray(found) == pytest.approx(np.array([1.0, 2.0]) + expected, abs=1e-14)


@pytest.mark.parametrize(
    ("normal", "first", "quarter"),
    [
        (None, [1, 0, 0], [0, 0, 1]),
        ([0, 0, 2], [1, 0, 0], [0, 1, 0]),
        ([3, 0, 0], [0, 1, 0], [0, 0, 1]),
        ([1, 1, 0], np.array([1, -1, 0]) / np.sqrt(2), [0, 0, -1]),
    ],
)
def test_a_circle_in_space_turns_about_its_normal(normal, first, quarter):
    keys = TURN | {"centre": [0, 0, 0], "normal": normal, "ramp_time": 0.0, "start": 2.0}
    found = np.asarray(by_formula([9.0, 9.0, 9.0], **keys)[0](np.array([0.0, 2.0, 4.0])))
    assert found / 0.05 == pytest.approx(np.array([first, first, quarter]), abs=1e-14)


def test_a_sine_swings_to_either_side():
    keys = {"path": "sine", "amplitude": [0.03, 0.04], "frequency_hz": 0.2, "ramp_time": 0.0}
    found = by_formula([0.4, -10.0], **keys)[0](SECONDS)
    swing = np.sin(2 * np.pi * 0.2 * SECONDS)[:, None]
    assert np.asarray(found) == pytest.approx([0.4, -10.0] + swing * [0.03, 0.04], abs=1e-14)
    found = by_formula([0.4, -10.0], **keys, phase_deg=90.0)[0](SECONDS)
    assert np.asarray(found)[0] == pytest.approx([0.4, -10.0], abs=1e-14)


def test_a_line_goes_on_at_its_velocity_or_ends_with_the_least_jerk():
    velocity = np.array([0.02, -0.01])
    keys = {"path": "line", "velocity": velocity, "start": 1.0, "ramp_time": 4.0}
    found = np.asarray(by_formula([0.4, -10.0], **keys)[0](SECONDS))
    late = SECONDS >= 5.0
    expected = [0.4, -10.0] + (SECONDS[late, None] - 3.0) * velocity
    assert found[late] == pytest.approx(expected, abs=1e-14)
    keys = {"path": "line", "to": [0.5, -9.8], "start": 1.0, "travel_time": 8.0}
    position, velocity = by_formula([0.4, -10.0], **keys)
    share = np.clip((SECONDS - 1.0) / 8.0, 0.0, 1.0)
    way = share**3 * (10 - 15 * share + 6 * share**2)
    expected = [0.4, -10.0] + way[:, None] * [0.1, 0.2]
    assert np.asarray(position(SECONDS)) == pytest.approx(expected, abs=1e-13)
    assert np.asarray(velocity(np.array([1.0, 9.0, 11.0]))) == pytest.approx(0.0, abs=1e-12)


# --- a target that moves with the submarine ------------------------------------------------------


@pytest.mark.parametrize("axes", [2, 3])
def test_what_is_fixed_to_the_submarine_moves_and_turns_with_its_prescribed_motion(axes):
    turns = [name for name in CHANNELS[axes] if name in ANGLES]
    rng = np.random.default_rng(axes)
    motions = tuple(
        SineMotion(index, *map(jnp.asarray, (*rng.uniform(0.2, 0.5, 2), 0.7)))
        for index in range(len(CHANNELS[axes]))
    )
    limits = np.tile([[-1.0], [1.0], [1.0], [1.0], [1.0]], len(CHANNELS[axes]))
    base = Base(
        jnp.asarray(rng.uniform(-0.5, 0.5, len(turns))),
        jnp.asarray(0.02),
        Servo(*map(jnp.asarray, limits)),
        motions,
    )
    carrier = Carrier(base, jnp.asarray(rng.normal(size=axes)))
    still = jnp.zeros(len(CHANNELS[axes]))
    # half a metre along the root, and pointing as the root does: there it stays
    ahead = base.direction(still)
    angle = jnp.arctan2(ahead[1], ahead[0])[None] if axes == 2 else ahead
    fixed = jnp.concatenate([0.5 * ahead, angle])
    time = jnp.asarray(1.3)
    pose, _, _ = base.pose(time, base.servo.at_rest())
    turned = base.direction(pose)
    carried = carrier.carry(fixed, time)
    expected = carrier.origin + pose[:axes] + 0.5 * turned
    assert np.asarray(carried[:axes]) == pytest.approx(np.asarray(expected), abs=1e-14)
    points = jnp.arctan2(turned[1], turned[0])[None] if axes == 2 else turned
    assert np.asarray(carried[axes:]) == pytest.approx(np.asarray(points), abs=1e-14)
    assert np.asarray(carrier.seen(carried, time)) == pytest.approx(np.asarray(fixed), abs=1e-14)
    # a second point keeps its distance from the first
    other = jnp.asarray(rng.normal(size=fixed.size))
    between = (carrier.carry(other, time) - carried)[:axes]
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
    state, step = servo.at_rest(), jnp.asarray(0.01)
    advance = jax.jit(Servo.advance)
    for index in range(300):
        state = advance(servo, state, jnp.full(1, 0.2 * 0.01 * index), step)
    # a command is held for a step: on the average it is half a step old
    behind = 0.2 * 3.0 - float(state.position[0])
    assert behind == pytest.approx(0.2 * (lags([servo])[0] + 0.005), rel=1e-4)


def test_a_reading_knows_when_it_was_taken():
    late = sensor(period=0.02, delay=0.05)
    times = 0.01 * np.arange(40)
    state, taken = late.start(jnp.zeros(3)), []
    for time in map(jnp.asarray, times):
        state = late.sample(state, jnp.full(3, time), time)
        known = late.reading(state, time)
        taken.append(float(known.taken))
        if time >= 0.05:
            assert taken[-1] == float(known.value[0])
    assert taken[:5] == list(times[:5])  # that of the start


def test_a_reading_is_rounded_to_the_resolution():
    known = watch(sensor(period=0.01, resolution=0.5), moving(0.01), 0.01)
    expected = 0.5 * np.round(moving(0.01) / 0.5)
    np.testing.assert_array_equal(known, expected)


@pytest.mark.parametrize(
    ("wanted", "measured", "short"),
    [
        (0.3, 0.1, 0.2),
        (3.0, -3.0, 6.0 - 2 * np.pi),
        (-3.0, 3.0, 2 * np.pi - 6.0),
        (0.1, 0.1 + 4 * np.pi, 0.0),
        (3.1, 0.0, 3.1),
        (3.2, 0.0, 3.2 - 2 * np.pi),
    ],
)
def test_angles_are_corrected_the_short_way_round(wanted, measured, short):
    error = pose_error(jnp.asarray([0.5, 7.0, wanted]), jnp.asarray([0.2, -7.0, measured]))
    # places are not angles: 14 m is 14 m
    assert np.asarray(error) == pytest.approx([0.3, 14.0, short], abs=1e-14)


# --- spline ------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [CubicSpline, PchipInterpolator])
def test_a_piecewise_cubic_is_what_it_was_built_from(kind):
    times = np.array([0.0, 0.3, 1.1, 1.2, 2.5])
    values = np.array([[0.0, 1.0], [2.0, -1.0], [0.5, 0.0], [0.7, 3.0], [0.6, 2.0]])
    source = kind(times, values)
    spline = PiecewisePolynomial(source)
    sampled = np.linspace(0.0, 2.5, 51)
    at = jnp.asarray(sampled)
    assert np.asarray(jax.vmap(spline)(at)) == pytest.approx(source(sampled), abs=1e-13)
    slopes = jax.vmap(jax.jacfwd(spline))(at)  # at its first and last knots too
    assert np.asarray(slopes) == pytest.approx(source(sampled, 1), abs=1e-11)


# --- PID ---------------------------------------------------------------------------------------

PERIOD = 0.1


def pid(
    *,
    kp: float = 0.0,
    ki: float = 0.0,
    kd: float = 0.0,
    filter_time: float = 0.0,
    take_up: float = 0.0,
    mapping: ArrayLike | None = None,
) -> Pid:
    """One channel that moves x, unless a mapping says otherwise."""
    mapping = jnp.asarray([[1.0, 0.0, 0.0]] if mapping is None else mapping)
    channels = mapping.shape[0]
    gains = (jnp.full(channels, x) for x in (kp, ki, kd, filter_time))
    return Pid(*gains, mapping, jnp.asarray(PERIOD), jnp.asarray(take_up))


def seen(measured: ArrayLike, wanted: ArrayLike, forward: ArrayLike, limit: float) -> Seen:
    """Return what is seen of a tip, with limits of all inputs."""
    now, none = jnp.zeros(()), jnp.zeros_like(forward)
    return Seen(
        time=now,
        measured=jnp.asarray(measured),
        taken=now,
        wanted=jnp.asarray(wanted),
        forward=jnp.asarray(forward),
        target=Target(jnp.zeros(3), None, ()),
        base=none,
        command=none,
        actuators=(),
        lower=none - limit,
        upper=none + limit,
        readings={},
    )


@eqx.filter_jit
def _command(pid: Pid, memory: PidMemory, seen: Seen):
    return pid.command(memory, seen)


def commands(
    pid: Pid,
    measured: ArrayLike,
    wanted: ArrayLike,
    forward: ArrayLike = 0.0,
    limit: float = 100.0,
) -> np.ndarray:
    """Return the commands for tips whose x is given; one per call."""
    measured, wanted = np.broadcast_arrays(measured, wanted)
    poses, targets = (np.pad(np.asarray(x, float)[:, None], ((0, 0), (0, 2))) for x in
                      (measured, wanted))  # fmt: skip
    ahead = np.broadcast_to(np.asarray(forward, float)[..., None], (len(poses), pid.kp.size))
    given = []
    memory = pid.start(seen(poses[0], targets[0], ahead[0], limit))
    for pose, target, known in zip(poses, targets, ahead, strict=True):
        now = seen(pose, target, known, limit)
        command, memory = _command(pid, memory, now)
        given.append(np.asarray(command))
    return np.squeeze(given, axis=1) if given[0].size == 1 else np.asarray(given)


def test_proportional():
    given = commands(pid(kp=2.0), [0.0, 0.3, 1.2], 1.0)
    assert given == pytest.approx([2.0, 1.4, -0.4], abs=1e-14)


def test_integral():
    # ki e h, summed: 0.5 * 0.1 * (1, 0.7, -0.2)
    given = commands(pid(ki=0.5), [0.0, 0.3, 1.2], 1.0)
    assert given == pytest.approx([0.05, 0.085, 0.075], abs=1e-14)


def test_derivative_acts_on_the_measurement():
    # -kd dy / h; a target that moves does not kick
    given = commands(pid(kd=0.2), [0.0, 0.0, 0.3, 0.3, 0.2], [0.0, 1.0, 1.0, 5.0, 5.0])
    assert given == pytest.approx([0.0, 0.0, -0.6, 0.0, 0.2], abs=1e-14)


def test_derivative_is_filtered_with_its_time_constant():
    # T s' + s = dy/dt by backward Euler: after a jump of 1, s = (T / (T + h))^k / (T + h)
    filter_time, kd = 0.4, 1.0
    given = commands(pid(kd=kd, filter_time=filter_time), [0.0] + [1.0] * 30, 0.0)
    decay = filter_time / (filter_time + PERIOD)
    expected = np.append(0.0, -kd * decay ** np.arange(30) / (filter_time + PERIOD))
    assert given == pytest.approx(expected, abs=1e-14)
    # a jump of 1 moves the integral of the rate by 1, however it is filtered
    assert given.sum() * PERIOD == pytest.approx(-kd, abs=2e-3)


def test_derivative_of_a_ramp_settles_at_its_slope():
    filter_time = 0.3
    given = commands(pid(kd=0.5, filter_time=filter_time), 0.2 * PERIOD * np.arange(80), 0.0)
    assert given[-1] == pytest.approx(-0.5 * 0.2, rel=1e-6)
    # and gets there as 1 - (T / (T + h))^k
    share = given[1:40] / (-0.5 * 0.2)
    decay = filter_time / (filter_time + PERIOD)
    assert share == pytest.approx(1 - decay ** np.arange(1, 40), abs=1e-12)


def test_all_terms_together():
    kp, ki, kd, filter_time = 1.5, 0.8, 0.3, 0.2
    x, wanted = [0.0, 0.4, 0.9, 1.1], 1.0
    given = commands(pid(kp=kp, ki=ki, kd=kd, filter_time=filter_time), x, wanted)
    integral = slope = 0.0
    for k, command in enumerate(given):
        error = wanted - x[k]
        integral += ki * PERIOD * error
        moved = x[k] - x[max(k - 1, 0)]
        slope = (filter_time * slope + moved) / (filter_time + PERIOD)
        assert command == pytest.approx(kp * error + integral - kd * slope, abs=1e-14)


def test_errors_are_mapped_to_channels():
    mapping = [[2.0, 0.0, 0.5], [0.0, -1.0, 0.0], [0.0, 0.0, 3.0]]
    controller = pid(kp=1.0, mapping=mapping)
    measured, wanted = jnp.asarray([0.1, 0.2, 3.0]), jnp.asarray([0.3, 0.5, -3.0])
    now = seen(measured, wanted, jnp.zeros(3), 100.0)
    command, _ = _command(controller, controller.start(now), now)
    short = 2 * np.pi - 6.0
    assert np.asarray(command) == pytest.approx(
        [2.0 * 0.2 + 0.5 * short, -0.3, 3.0 * short], abs=1e-14
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_commands_stay_within_their_limits(sign):
    given = commands(pid(kp=3.0, ki=5.0), [0.0] * 20, sign, limit=0.5)
    assert given == pytest.approx(sign * 0.5, abs=0.0)


def test_what_is_known_beforehand_is_added_within_the_limits():
    given = commands(pid(kp=2.0), [0.0, 0.3, 1.2], [0.0, 0.4, 1.0], [0.1, 0.2, 3.0], limit=1.0)
    assert given == pytest.approx([0.1, 0.4, 1.0], abs=1e-14)


def test_a_tip_that_moves_as_asked_for_is_not_held_back_nor_wound_up():
    x = 0.05 * np.sin(0.3 * np.arange(40))
    given = commands(pid(kp=1.0, ki=2.0, kd=0.5, filter_time=0.1), x, x, x)
    assert given == pytest.approx(x, abs=1e-14)
    # and beyond a limit nothing is wound up that would delay the way back
    forward = np.where(np.arange(60) < 40, 3.0, 0.5)
    given = commands(pid(ki=2.0), np.minimum(forward, 1.0), forward, forward, limit=1.0)
    assert given == pytest.approx(np.minimum(forward, 1.0), abs=1e-14)


def test_what_is_there_at_the_first_call_is_taken_up_along_half_a_cosine():
    terms = {"kp": 1.5, "ki": 0.8, "kd": 0.4, "filter_time": 0.2}
    x, wanted = np.array([0.2, 0.2, 0.25, 0.4]), np.array([1.0, 1.1, 1.2, 1.3])
    forward = np.array([0.3, 0.4, 0.5, 0.6])
    given = commands(pid(**terms, take_up=0.2), x, wanted, forward)
    assert given[0] == 0.0
    # half of it is left at the second call, and nothing from the third on
    left = np.array([1.0, 0.5, 0.0, 0.0])
    eased = commands(pid(**terms), x, wanted - 0.8 * left, forward - 0.3 * left)
    assert given == pytest.approx(eased, abs=1e-14)
    # where nothing is there, nothing changes
    rest = (x, wanted - 0.8, forward - 0.3)
    at_once = commands(pid(**terms), *rest)
    assert commands(pid(**terms, take_up=9.0), *rest) == pytest.approx(at_once, abs=1e-14)


def _closed_loop(controller: Pid, *, anti_windup: bool) -> np.ndarray:
    """Return x of a plant that follows its command with a lag, sent out of reach and back."""
    lag, steps = 1.0, 400
    wanted = np.where(np.arange(steps) < 200, 2.0, 0.2)
    limit, x, integral, given = 1.0, 0.0, 0.0, []
    nowhere, still = jnp.zeros(3), jnp.zeros(1)
    memory = controller.start(seen(nowhere, nowhere, still, limit))
    for target in wanted:
        if anti_windup:
            pose, goal = jnp.asarray([x, 0.0, 0.0]), jnp.asarray([target, 0.0, 0.0])
            now = seen(pose, goal, still, limit)
            answer, memory = _command(controller, memory, now)
            command = float(answer[0])
        else:
            integral += float(controller.ki[0]) * PERIOD * (target - x)
            command = float(controller.kp[0]) * (target - x) + integral
            command = min(max(command, -limit), limit)
        x = command + (x - command) * np.exp(-PERIOD / lag)
        given.append(x)
    return np.array(given)


def test_a_long_saturation_is_left_at_once():
    controller = pid(kp=1.0, ki=0.8)
    guarded = _closed_loop(controller, anti_windup=True)
    naive = _closed_loop(controller, anti_windup=False)
    # both are stuck at the limit, out of reach of 2
    assert guarded[199] == pytest.approx(1.0, abs=1e-6)
    assert naive[199] == pytest.approx(1.0, abs=1e-6)

    def settled(x: np.ndarray) -> float:
        """Return the time from the new target until x stays within 0.05 of it (s)."""
        away = np.flatnonzero(np.abs(x[200:] - 0.2) > 0.05)
        return (away[-1] + 1) * PERIOD

    # 20 s at an error of 1 wind the naive integral up to 16 times the limit, which takes
    # 20 s (16 - 1) / 16 and more to unwind; without windup a few lags of the plant suffice
    assert settled(guarded) < 5.0
    assert settled(naive) > 15.0


def test_integration_goes_on_where_it_leads_back_from_the_limit():
    # at the upper limit a negative error must unwind what is there
    controller = pid(ki=1.0)
    given = commands(controller, [0.0] * 10 + [2.0] * 5, 1.0, limit=0.25)
    assert given == pytest.approx(
        [0.1, 0.2] + [0.25] * 8 + [0.1, 0.0, -0.1, -0.2, -0.25], abs=1e-12
    )


def test_idle_commands_nothing():
    pose = jnp.asarray([1.0, 2.0, 3.0])
    now = seen(pose, 0 * pose, pose, 1.0)
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


def test_a_jacobian_of_nothing_asks_for_nothing():
    np.testing.assert_array_equal(damped_inverse(np.zeros((3, 2))), np.zeros((2, 3)))


@pytest.mark.parametrize("size", [5e-324, 1e-200, 1e200])
def test_the_plane_of_a_circle_does_not_ask_how_long_its_normal_is(size):
    circle = {"path": "circle", "radius": 0.1, "period": 5.0}
    plane = _plane_of(TargetTable(**circle, normal=(size, 0.0, 0.0)), 3)
    np.testing.assert_allclose(plane, [[0, 1, 0], [0, 0, 1]], atol=1e-15)
