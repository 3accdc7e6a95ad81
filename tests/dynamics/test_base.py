"""Servos against the second-order system they are; prescribed motion; the wrench."""

from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PPoly

from crinoid.base import (
    Base,
    Prescribed,
    Servo,
    ServoState,
    SineMotion,
    TableMotion,
    VelocityMotion,
)
from crinoid.foundation.axes import CHANNELS
from crinoid.numerics.piecewise import PiecewisePolynomial, shape_preserving
from crinoid.numerics.ramp import Onset
from helpers.arms import order

NATURAL = 2 * np.pi / np.sqrt(np.sqrt(2.0) - 1.0)
"""Natural frequency of a bandwidth of 1 Hz (rad/s): 1 / (1 + (w/n)^2) = 1 / sqrt(2)."""

# --- servos ------------------------------------------------------------------------------------


def servo(*, bandwidth=1.0, speed=1e3, acceleration=1e6, reach=1e3) -> Servo:
    """Build one servo; without further words its limits are far away."""
    return Servo(*(jnp.full(1, x) for x in (-reach, reach, speed, acceleration, bandwidth)))


STEPS = 1000
"""Commands of a run, or of a part of it: all share one compiled loop."""


@eqx.filter_jit
def _follow(servo, start, commands, step):
    def once(state, command):
        state = servo.advance(state, command[None], step)
        return state, state

    return jax.lax.scan(once, start, commands)[1]


def follow(servo: Servo, commands, step: float, start: ServoState | None = None) -> np.ndarray:
    """Return position, velocity and acceleration, each after every step."""
    state = start or servo.at_rest()
    parts = []
    for part in commands.reshape(-1, STEPS):
        states = _follow(servo, state, jnp.asarray(part), jnp.asarray(step))
        state = jax.tree.map(lambda leaf: leaf[-1], states)
        parts.append([states.position, states.velocity, states.acceleration])
    return np.concatenate(parts, axis=1)[..., 0]


@pytest.mark.parametrize("step", [1e-3, 0.01, 0.1, 0.7])
def test_a_small_step_command_is_answered_exactly(step):
    # critically damped second order: x / c = 1 - (1 + n t) exp(-n t)
    position, velocity, acceleration = follow(servo(), np.full(STEPS, 0.01), step)
    time = step * np.arange(1, STEPS + 1)
    decay = np.exp(-NATURAL * time)
    assert position == pytest.approx(0.01 * (1 - (1 + NATURAL * time) * decay), abs=1e-13)
    assert velocity == pytest.approx(0.01 * NATURAL**2 * time * decay, abs=1e-12)
    # on from the means of the last two steps, so that in sum it is what the velocity changes by
    means = np.diff(0.01 * NATURAL**2 * time * decay, prepend=0.0) / step
    carried = means + np.append(means[0], np.diff(means) / 2)
    assert acceleration == pytest.approx(carried, abs=1e-10)


def test_any_state_is_left_exactly():
    # (e + (v + n e) t) exp(-n t), past the command and back
    start = ServoState(
        jnp.full(1, 0.01), jnp.full(1, -0.2), jnp.zeros(1), jnp.zeros(1), jnp.zeros(())
    )
    position, *_ = follow(servo(), np.zeros(STEPS), 5e-3, start)
    time = 5e-3 * np.arange(1, STEPS + 1)
    exact = (0.01 + (-0.2 + NATURAL * 0.01) * time) * np.exp(-NATURAL * time)
    assert exact.min() < -1e-3
    assert position == pytest.approx(exact, abs=1e-13)


@pytest.mark.parametrize("bandwidth", [0.5, 2.0])
def test_response_falls_by_3_decibels_at_the_bandwidth(bandwidth):
    # 1 / sqrt(2) by definition; the phase of a critically damped system is -2 atan(w / n)
    step = 5.0 / bandwidth / STEPS
    angle = 2 * np.pi * bandwidth * step * np.arange(STEPS)
    position, *_ = follow(servo(bandwidth=bandwidth), 0.01 * np.sin(angle), step)
    settled = slice(STEPS // 2, None)
    after = angle + angle[1]
    waves = np.stack([np.sin(after), np.cos(after)], axis=1)[settled]
    (inphase, quadrature), *_ = np.linalg.lstsq(waves, position[settled], rcond=None)
    assert np.hypot(inphase, quadrature) / 0.01 == pytest.approx(np.sqrt(0.5), rel=1e-3)
    lag = -2 * np.arctan(np.sqrt(np.sqrt(2.0) - 1.0))
    held = -angle[1] / 2  # a command held over a step lags by half of it
    assert np.arctan2(quadrature, inphase) == pytest.approx(lag + held, abs=2e-3)


def _random_servos():
    """Yield the limits of servos, a step and commands, each over decades."""
    for seed in range(60):
        random = np.random.default_rng(seed)
        exponents = ((-1.0, 1.5), (-1.5, 1.0), (-1.0, 2.0), (-3.0, -0.5))
        *limits, step = (10 ** random.uniform(*ends) for ends in exponents)
        held = [1, 7, 50][seed % 3]
        commands = np.repeat(random.uniform(-0.5, 0.5, STEPS // held + 1), held)[:STEPS]
        yield dict(zip(("bandwidth", "speed", "acceleration"), limits, strict=True)), step, commands


def test_limits_hold_whatever_is_commanded():
    reached = dict.fromkeys(("range", "speed", "acceleration"), 0)
    for limits, step, commands in _random_servos():
        reach, speed, acceleration = 0.3, limits["speed"], limits["acceleration"]
        x, v, a = follow(servo(**limits, reach=reach), commands, step)
        case = f"{limits} {step=}"
        assert np.abs(x).max() <= reach, case
        assert np.abs(v).max() <= speed * (1 + 1e-12), case
        assert np.abs(a).max() <= acceleration * (1 + 1e-9), case
        # nor may the positions and velocities tell another story than the rates
        before = np.pad([x, v], ((0, 0), (1, 0)))[:, :-1]
        mean_speed, mean_acceleration = np.abs([x, v] - before) / step
        assert mean_speed.max() <= speed * (1 + 1e-9), case
        assert mean_acceleration.max() <= acceleration * (1 + 1e-9), case
        reached["range"] += np.abs(x).max() > 0.999 * reach
        reached["speed"] += np.abs(v).max() > 0.999 * speed
        reached["acceleration"] += np.abs(a).max() > 0.999 * acceleration
    assert min(reached.values()) > 10  # so the limits were met, not only kept


def test_a_step_command_is_reached_and_not_overrun():
    for limits, step, _ in _random_servos():
        natural, case = NATURAL * limits["bandwidth"], f"{limits} {step=}"
        position, *_ = follow(servo(**limits, reach=10.0), np.full(STEPS, 1.0), step)
        # a step longer than the servo takes to respond cannot be finer than what it brakes in it
        coarse = natural * step > 1.0
        assert position.max() - 1.0 < (1e-6 if coarse else 1e-12), case
        # on the way, braking, and settling within exp(-20) (1 + 20)
        braking = 2 * np.sqrt(1.0 / limits["acceleration"])
        enough = 1.0 / limits["speed"] + braking + 20.0 / natural + 20 * step
        if enough < STEPS * step:
            assert position[-1] == pytest.approx(1.0, abs=1e-6), case


@pytest.mark.parametrize(
    ("speed", "acceleration"), [(0.5, 2.0), (5.0, 2.0), (0.3, 100.0)], ids=["both", "acc", "speed"]
)
def test_limited_motion_is_second_order_in_the_step(speed, acceleration):
    limited = servo(bandwidth=2.0, speed=speed, acceleration=acceleration)

    def run(refinement: int) -> np.ndarray:
        steps = STEPS * refinement
        time = 3.0 / steps * np.arange(steps)
        # turned around on the way, at a time that is on all grids
        commands = np.where(time < 0.96 - 1e-9, 0.5, -0.2)
        position, *_ = follow(limited, commands, 3.0 / steps)
        return position[refinement - 1 :: refinement]

    exact = run(64)
    errors = [np.abs(run(refinement) - exact).max() for refinement in (1, 4)]
    # a limit that is met inside a step makes single orders uneven
    assert order(errors, 4.0) > 1.7
    assert errors[-1] < 1e-5


def test_a_channel_without_room_stays():
    fixed = Servo(*(jnp.asarray([x]) for x in (0.0, 0.0, 1.0, 1.0, 1.0)))
    states = follow(fixed, np.full(STEPS, 0.5), 0.01)
    assert not states.any()


@eqx.filter_jit
def _gradient(servo: Servo, start: Array, command: Array) -> ServoState:
    """Return how everything after a step of 0.01 s follows the command."""

    def last(command: Array) -> ServoState:
        state = ServoState(start, *[jnp.zeros(1)] * 3, jnp.zeros(()))
        return jax.tree.map(jnp.sum, servo.advance(state, command, jnp.asarray(0.01)))

    return jax.jacrev(last)(command)


def test_gradients_of_a_servo():
    limited = servo(speed=0.5, acceleration=2.0, reach=0.3)
    # at the end of the range, beyond it, and far away
    for position, command in ((0.3, 0.3), (0.3, 1.0), (-0.3, 0.3)):
        for slope in jax.tree.leaves(
            _gradient(limited, jnp.full(1, position), jnp.full(1, command))
        ):
            assert np.isfinite(slope).all()
    # near the command, and on it, the response is linear: as to a step command of 1
    since = 0.01 * NATURAL
    decay = np.exp(-since)
    # from rest the acceleration at the end is twice the mean
    expected = [1 - (1 + since) * decay, NATURAL * since * decay, 2 * NATURAL**2 * decay]
    for command in (0.0, 0.002):
        slopes = _gradient(limited, jnp.zeros(1), jnp.full(1, command))
        found = [slopes.position[0], slopes.velocity[0], slopes.acceleration[0]]
        assert np.stack(found) == pytest.approx(expected, rel=1e-9)


# --- prescribed motion -------------------------------------------------------------------------


def sine(channel: int, amplitude: float, frequency: float, phase: float) -> SineMotion:
    return SineMotion(channel, *(jnp.asarray(x) for x in (amplitude, frequency, phase)))


def test_a_sine_and_its_rates():
    value, rate, second = sine(0, 0.3, 0.5, 0.2).derivatives(jnp.asarray(1.7))
    angle = np.pi * 1.7 + 0.2
    assert value == pytest.approx(0.3 * np.sin(angle), abs=1e-14)
    assert rate == pytest.approx(0.3 * np.pi * np.cos(angle), abs=1e-14)
    assert second == pytest.approx(-0.3 * np.pi**2 * np.sin(angle), abs=1e-13)


@eqx.filter_jit
def derivatives(motion, time):
    return motion.derivatives(time)


KNOTS = np.array([0.0, 0.7, 1.5, 2.0, 3.1])
TABLE = CubicSpline(KNOTS, [0.0, 0.3, -0.1, 0.2, 0.4])


def test_a_table_is_its_spline_and_is_held_outside_its_times():
    motion = TableMotion(1, PiecewisePolynomial(TABLE))
    # at the first knot the motion begins with the slope that it goes on with
    for time in (0.0, 0.3, 0.7, 1.9, 3.0, 3.1):
        for derivative, value in enumerate(derivatives(motion, jnp.asarray(time))):
            assert value == pytest.approx(float(TABLE(time, derivative)), abs=1e-11)
    for time, end in ((-0.5, 0.0), (3.2, 0.4)):
        value, *rates = derivatives(motion, jnp.asarray(time))
        assert value == pytest.approx(end, abs=1e-14)
        assert rates == [0.0, 0.0]


def test_a_velocity_comes_on_along_half_a_cosine_and_stays():
    start, ramp, velocity = 0.5, 2.0, -0.3
    motion = VelocityMotion(0, Onset.of(start, ramp), jnp.asarray(velocity))
    times, shares = (0.0, 0.5, 1.5, 2.5, 7.0), (0.0, 0.0, 0.5, 1.0, 1.0)
    for time, share, rate in zip(times, shares, (0.0, 0.0, np.pi / 4, 0.0, 0.0), strict=True):
        value, speed, second = derivatives(motion, jnp.asarray(time))
        since = np.clip(time - start, 0.0, ramp)
        exact = 0.5 * (since - ramp / np.pi * np.sin(np.pi * since / ramp))
        exact += max(time - start - ramp, 0.0)
        assert value == pytest.approx(velocity * exact, abs=1e-14)
        assert speed == pytest.approx(velocity * share, abs=1e-14)
        assert second == pytest.approx(velocity * rate, abs=1e-14)


# --- points that are joined by a curve of their shape -------------------------------------------


def test_any_points_are_joined_monotonically_and_with_continuous_acceleration():
    rng = np.random.default_rng(0)
    for _ in range(200):
        times = np.cumsum(rng.uniform(0.05, 2.0, rng.integers(2, 9)))
        values = rng.normal(size=(times.size, 2)).round(rng.integers(0, 3))
        curve = shape_preserving(times, values)
        pieces = [curve(np.linspace(*ends, 40)) for ends in pairwise(times)]
        for piece, rise in zip(pieces, np.diff(values, axis=0), strict=True):
            step = np.diff(piece, axis=0)
            assert (step * np.sign(rise)).min() >= -1e-13
            assert np.abs(step[:, rise == 0]).max(initial=0.0) < 1e-13
        for derivative in range(3):
            before, after = (curve(times[1:-1] + side, derivative) for side in (-1e-11, 1e-11))
            scale = np.abs(curve(times, derivative)).max()
            assert before == pytest.approx(after, abs=1e-5 * scale + 1e-6)


def test_joining_points_of_a_monotone_curve_is_of_third_order():
    at = np.linspace(0.0, 2.0, 500)
    errors = []
    for count in (11, 21, 41):
        times = np.linspace(0.0, 2.0, count)
        errors.append(np.abs(shape_preserving(times, np.exp(times))(at) - np.exp(at)).max())
    assert order(errors) == pytest.approx(3.0, abs=0.3)


# --- the base ----------------------------------------------------------------------------------


def base(*motions: SineMotion | TableMotion, tilt: float = -0.4) -> Base:
    limits = ((-1.0,) * 3, (1.0,) * 3, (10.0,) * 3, (100.0,) * 3, (5.0,) * 3)
    return Base(jnp.asarray([tilt]), jnp.asarray(0.2), Servo(*jnp.asarray(limits)), motions)


def at_rest(*position: float) -> ServoState:
    return ServoState(jnp.asarray(position), *[jnp.zeros(3)] * 3, jnp.zeros(()))


@eqx.filter_jit
def prescribe(base, servo, time):
    return base.prescribe(time, servo)


@pytest.mark.parametrize(
    ("tilt", "pose", "root", "ghost"),
    [
        (0.0, (0.0, 0.0, 0.0), (0.0, 0.0), (-0.2, 0.0)),
        (0.0, (0.3, -0.1, 0.0), (0.3, -0.1), (0.1, -0.1)),
        (0.0, (0.0, 0.0, np.pi / 2), (0.0, 0.0), (0.0, -0.2)),  # the arm points up
        (0.0, (0.0, 0.0, np.pi), (0.0, 0.0), (0.2, 0.0)),
        # tilts of the mount and of the channel add
        (0.5, (0.0, 0.0, 0.25), (0.0, 0.0), (-0.2 * np.cos(0.75), -0.2 * np.sin(0.75))),
    ],
)
def test_channels_move_the_clamp(tilt, pose, root, ghost):
    held = prescribe(base(tilt=tilt), at_rest(*pose), jnp.zeros(()))
    assert np.asarray(held.position) == pytest.approx(np.array([ghost, root]), abs=1e-15)
    assert not held.velocity.any()
    assert not held.acceleration.any()


def test_prescribed_velocity_and_acceleration_are_those_of_the_position():
    moving = base(
        sine(0, 0.3, 0.5, 0.2),
        sine(2, 0.9, 0.8, 1.0),
        TableMotion(CHANNELS[2].index("heave"), PiecewisePolynomial(TABLE)),
        sine(2, 0.2, 1.7, 0.0),  # two motions of one channel add up
    )
    # a servo under way rides along: x = p + v t + a t^2 / 2 about t = 1.1
    p, v, a = (jnp.asarray(x) for x in ([0.1, -0.2, 0.3], [0.4, 0.1, -0.6], [-1.0, 2.0, 1.5]))

    def at(time: float) -> Prescribed:
        since = time - 1.1
        riding = ServoState(p + v * since + 0.5 * a * since**2, v + a * since, a, a, jnp.ones(()))
        return prescribe(moving, riding, jnp.asarray(time))

    step = 1e-3
    places = np.stack([at(1.1 + step * n).position for n in range(-2, 3)])
    held = at(1.1)
    # central differences of order four
    velocity = np.tensordot([1, -8, 0, 8, -1], places, 1) / (12 * step)
    acceleration = np.tensordot([-1, 16, -30, 16, -1], places, 1) / (12 * step**2)
    assert np.asarray(held.velocity) == pytest.approx(velocity, abs=1e-7)
    assert np.asarray(held.acceleration) == pytest.approx(acceleration, abs=1e-5)
    assert np.abs(np.diff(held.acceleration, axis=0)).max() > 1.0


@pytest.mark.parametrize("where", [(0.0, 0.0), (3.0, -4.0)])
def test_wrench_does_work_as_the_reactions_do(where: ArrayLike):
    # virtual work: force . shift + moment . turn = -sum of reaction . displacement
    random = np.random.default_rng(0)
    reaction = jnp.asarray(random.normal(size=(2, 2)))
    pose = jnp.asarray([*where, 0.3])
    turned = base()
    force, moment = turned.wrench(turned.hold(pose), reaction)
    work = jax.grad(lambda pose: -jnp.sum(reaction * turned.hold(pose)))(pose)
    assert np.append(force, moment) == pytest.approx(np.asarray(work), abs=1e-14)


def test_a_spline_finds_its_pieces_whether_its_knots_are_even_or_not():
    even = CubicSpline(np.linspace(-1.0, 3.0, 9), np.sin(np.linspace(0.0, 5.0, 9)))
    # the same function with one knot more
    knots = np.insert(even.x, 3, 0.3)
    taylor = np.stack([even(knots[:-1], order) for order in (3, 2, 1, 0)])
    uneven = PPoly(taylor / np.array([6, 2, 1, 1])[:, None], knots)
    both = [PiecewisePolynomial(spline) for spline in (even, uneven)]
    assert [spline.even for spline in both] == [True, False]
    times = jnp.asarray(np.concatenate([np.linspace(-2.0, 4.0, 101), knots]))
    one, other = (jax.vmap(spline)(times) for spline in both)
    np.testing.assert_allclose(one, other, atol=1e-14)
    np.testing.assert_allclose(one[:, 0], even(np.clip(times, -1.0, 3.0)), atol=1e-14)
