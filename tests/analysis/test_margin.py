"""How far a control loop is from swinging by itself: loops and chains that are known on paper."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.base import Servo
from crinoid.dynamics import Influence
from crinoid.scenario import PidGains
from crinoid.simulation.frequency_response import Plant
from crinoid.simulation.loop_margin import INDENTED, OpenLoop, _frequencies, loop_warnings
from helpers.arms import dense

FREQUENCY = np.geomspace(1e-3, 20.0, 400)
RATE = 2j * np.pi * FREQUENCY
DELAY = 0.2


def late_integrators(*gains: float) -> OpenLoop:
    """Make a channel for each gain k: k e^(-s T) / s, unstable from k T = pi / 2 on."""
    late = np.exp(-RATE * DELAY) / RATE
    return OpenLoop(FREQUENCY, late[:, None, None] * np.diag(gains), np.diag(gains))


LIMIT = math.pi / 2 / DELAY


@pytest.mark.parametrize("share", [0.1, 0.3, 0.75, 0.9, 1.1, 3.0])
def test_margins_of_an_integrator_with_a_delay(share):
    gain = share * LIMIT
    margin = late_integrators(gain).margin()
    assert margin.stable == (share < 1)
    assert margin.gain == pytest.approx(1 / share, rel=1e-3)
    if abs(share - 1) < 0.2:
        assert margin.frequency == pytest.approx(0.25 / DELAY, rel=0.1)
    if share < 1:
        assert margin.phase == pytest.approx(math.pi / 2 - gain * DELAY, rel=1e-3)
        assert margin.delay == pytest.approx(math.pi / 2 / gain - DELAY, rel=1e-3)
        assert margin.delay_frequency == pytest.approx(gain / (2 * math.pi), rel=1e-3)
        assert margin.gain_frequency == pytest.approx(0.25 / DELAY, rel=1e-3)
        assert margin.least_gain == 0
        # the modulus margin is the distance from -1
        fine = 1j * np.linspace(1e-3, 40.0, 200_000)
        exact = np.abs(1 + gain * np.exp(-fine * DELAY) / fine).min()
        assert margin.modulus == pytest.approx(exact, rel=0.01)


def alone(transfer: np.ndarray, integrated: float = 0.0) -> OpenLoop:
    return OpenLoop(FREQUENCY, transfer[:, None, None], np.array([[integrated]]))


def test_margins_of_a_loop_of_third_order():
    # K / (s (s + 1) (s + 2)) is -K / 6 at sqrt(2) rad/s
    gain = 1.5
    margin = alone(gain / (RATE * (RATE + 1) * (RATE + 2)), gain / 2).margin()
    assert margin.gain == pytest.approx(6 / gain, rel=1e-3)
    assert 2 * math.pi * margin.gain_frequency == pytest.approx(math.sqrt(2), rel=1e-3)
    roots = np.roots([1, 0, 5, 0, 4, 0, -(gain**2)])
    (rate,) = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)].real
    phase = math.pi / 2 - math.atan(rate) - math.atan(rate / 2)
    assert margin.phase == pytest.approx(phase, rel=2e-3)
    assert margin.delay == pytest.approx(phase / rate, rel=2e-3)


def test_the_delay_margin_is_the_least_of_all_crossings():
    # a resonance is as large as 1 on both sides of its peak; the least phase is not there where
    # the least delay is
    def resonance(rate):
        return (0.4 / (1 + 0.2 * rate + rate**2) + 0.3 / rate) * np.exp(-0.02 * rate)

    margin = alone(resonance(RATE), 0.3).margin()
    fine = 1j * np.geomspace(1e-2, 1e2, 400_001)
    exact = resonance(fine)
    above = np.abs(exact) > 1
    at = np.flatnonzero(above[1:] != above[:-1])
    assert at.size == 3
    lag = np.mod(np.angle(exact[at]) + math.pi, 2 * math.pi)
    assert margin.phase == pytest.approx(np.minimum(lag, 2 * math.pi - lag).min(), rel=2e-3)
    assert margin.delay == pytest.approx((lag / fine[at].imag).min(), rel=2e-3)
    # all commands that much later, and it swings
    for share, stable in ((0.97, True), (1.03, False)):
        later = np.exp(-share * margin.delay * RATE) * resonance(RATE)
        assert alone(later, 0.3).margin().stable == stable


def test_some_loops_have_no_margins():
    small = alone(0.5 / (1 + RATE)).margin()
    assert (small.phase, small.delay, small.gain) == (math.inf, math.inf, math.inf)
    unstable = late_integrators(4 * LIMIT).margin()
    assert not unstable.stable
    assert np.isnan([unstable.phase, unstable.delay]).all()


@pytest.mark.parametrize("gain", [1e-4, 1e-2, 1.0])
def test_late_damping_of_an_undamped_resonance_is_stable_and_the_opposite_is_not(gain):
    # k s e^(-s T) / (s^2 + w^2) moves the poles by -k / 2: the resonance itself is on the grid
    grid = _frequencies(np.array([1.3]), 50.0)
    assert 1.3 in grid
    rate = 2j * np.pi * grid * (1 - 1j * INDENTED)
    late = gain * rate * np.exp(-0.01 * rate) / (rate**2 + (2.6 * np.pi) ** 2)
    for sign in (1, -1):
        loop = OpenLoop(grid, sign * late[:, None, None], np.zeros((1, 1)))
        assert loop.margin().stable == (sign > 0)


def test_the_response_of_an_undamped_arm_at_its_resonance_is_large_and_finite():
    # four free coordinates, each of stiffness and mass 1: singular at 1 rad/s exactly
    bands = np.zeros((4, 5, 2, 2))
    bands[:, 2] = np.eye(2)
    influence = Influence(np.zeros((2, 2, 1)), np.ones((4, 2, 1)), np.ones((1, 3, 2)))
    plant = Plant(bands, 0 * bands, bands, influence)
    at = np.array([1 / (2 * np.pi)])
    with pytest.raises(np.linalg.LinAlgError):
        plant.response(at)
    # of two nodes' two coordinates each: 1 / (1 - w^2), w = 1 - i e
    found = plant.response(at * (1 - INDENTED * 1j))[0, 0, 1]
    np.testing.assert_allclose(found, 4 / (2j * INDENTED), rtol=1e-5)


def test_channels_that_are_coupled_share_one_margin():
    loop = late_integrators(1.0, 4.0)
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    turned = loop._replace(
        transfer=turn @ loop.transfer @ turn.T, integrated=turn @ loop.integrated @ turn.T
    )
    assert turned.margin().gain == pytest.approx(loop.margin().gain, rel=1e-6)
    assert turned.margin().gain == pytest.approx(LIMIT / 4.0, rel=1e-3)
    assert turned.scaled(2.0).margin().stable is False


def test_a_loop_that_is_stable_between_two_gains_only():
    # lags behind by more than half a turn, leads again, and then falls to a delay
    loop = alone(((1 + RATE) / (1 + 20 * RATE)) ** 2 / RATE * np.exp(-0.05 * RATE), 1.0)
    stable = {gain: loop.scaled(gain).margin().stable for gain in (0.1, 1.0, 1e3, 2e4)}
    assert stable == {0.1: True, 1.0: False, 1e3: True, 2e4: False}
    margin = loop.scaled(1e3).margin()
    for factor, remains in ((margin.gain, False), (margin.least_gain, True)):
        assert loop.scaled(1e3 * factor * 1.02).margin().stable == remains
        assert loop.scaled(1e3 * factor / 1.02).margin().stable != remains


def test_an_integrator_of_the_wrong_sign_runs_away_however_small():
    loop = late_integrators(1.0, -1e-2)
    assert not loop.margin().stable
    gains = {"slide": PidGains(ki=1.0), "tilt": PidGains(ki=-1e-2)}
    (note,) = loop_warnings(loop, gains)
    assert note.startswith("control.pid.tilt: got kp = 0, ki = -0.01, kd = 0; the tip runs away")
    assert note.endswith("is the sign right?")


def test_the_margin_in_two_waters_is_that_of_the_worse_which_a_note_names():
    one, other = late_integrators(0.5 * LIMIT), late_integrators(0.96 * LIMIT)
    both = OpenLoop(
        FREQUENCY,
        np.stack([one.transfer, other.transfer]),
        np.stack([one.integrated, other.integrated]),
        ("the mean current", "still water"),
    )
    assert both.margin() == other.margin()
    assert both.scaled(1.1).margin().stable is False
    assert (both.weakest, both.scaled(1.1).weakest) == ("still water", "still water")
    (note,) = loop_warnings(both, {"slide": PidGains(ki=0.96 * LIMIT)})
    expected = f"hardly die down in still water (modulus margin {other.margin().modulus:.2g})"
    assert expected in note
    factor = float(note.split("these three times ")[1].split(" ")[0])
    assert other.scaled(factor).margin().modulus >= 0.2


def test_a_note_names_the_channel_at_fault_and_by_what_to_lower_it():
    gains = {"slide": PidGains(ki=1.0), "tilt": PidGains(ki=4.0 * LIMIT)}
    (note,) = loop_warnings(late_integrators(1.0, 4.0 * LIMIT), gains)
    assert note.startswith("control.pid.tilt: got kp = 0, ki = 31.4")
    assert "small motions grow by themselves, near" in note
    factor = float(note.split("times ")[1].split(" ")[0])
    assert 0.15 < factor < 0.25
    assert loop_warnings(late_integrators(1.0, factor * 4.0 * LIMIT), gains) == []
    # close to unstable
    (note,) = loop_warnings(late_integrators(1.0, 0.96 * LIMIT), gains)
    assert "with 1.04 times all gains they grow" in note
    both = {name: PidGains(ki=4.0 * LIMIT) for name in gains}
    (note,) = loop_warnings(late_integrators(4.0 * LIMIT, 4.0 * LIMIT), both)
    assert note.startswith("control.pid: got slide kp = 0, ki = 31.4")


def test_small_motions_in_a_current_ignore_the_gusts_of_the_moment():
    @eqx.filter_jit
    def motions(system):
        return system.small_motions(system.rest(), jnp.array([0.2, 0]))

    def small(speed):
        shear = {"kind": "shear", "velocity": [speed, 0.0], "reference_depth": 10.0}
        arm, base = {"nodes": 5, "damping_time": 0.5}, {"tilt_deg": 70.0}
        scenario = crinoid.Scenario(arm=arm, base=base, water={"depth": 11.0}, flow=[shear])
        return motions(crinoid.system(scenario))

    calm, sheared = small(0.0), small(3.0)
    assert not np.allclose(calm.stiffness, sheared.stiffness, rtol=1e-3)
    np.testing.assert_array_equal(calm.stiffness_in_current, sheared.stiffness_in_current)
    np.testing.assert_array_equal(calm.damping_in_current, sheared.damping_in_current)


@pytest.mark.parametrize("size", [2, 4])
def test_the_response_of_a_chain_is_that_of_its_full_matrix(size):
    rng = np.random.default_rng(size)
    nodes, channels, drives, pose = 6, 3, 2, 5
    bands = [rng.normal(size=(nodes, 5, size, size)) for _ in range(3)]
    held = rng.normal(size=(2, size, channels))
    loads = rng.normal(size=(nodes, size, drives))
    tip = rng.normal(size=(pose, 3, size - size // 4))
    frequency = np.array([0.1, 3.0])
    plant = Plant(*bands, Influence(held, loads, tip))
    response = plant.response(frequency)
    # computed once for equal arms, and again for another
    again = plant._replace(mass=plant.mass.copy())
    assert again.response(frequency) is response
    other = again._replace(mass=2 * plant.mass).response(frequency)
    assert not np.allclose(other, response)
    stiffness, damping, mass = (dense(each).reshape((nodes * size,) * 2) for each in bands)
    for rate, found in zip(2 * np.pi * frequency, response, strict=True):
        full = stiffness + 1j * rate * damping - rate**2 * mass
        known = np.pad(held.reshape(2 * size, channels), ((0, 0), (0, drives)))
        forced = np.pad(loads[2:].reshape(-1, drives), ((0, 0), (channels, 0)))
        forced = forced - full[2 * size :, : 2 * size] @ known
        free = np.linalg.solve(full[2 * size :, 2 * size :], forced)
        moved = np.concatenate([known, free]).reshape(nodes, size, -1)[-3:, : tip.shape[2]]
        np.testing.assert_allclose(found, np.einsum("pnd,ndc->pc", tip, moved), rtol=1e-9)


def test_a_servo_has_fallen_by_three_decibels_at_its_bandwidth():
    channel = np.array([5.0])
    servo = Servo(*map(jnp.asarray, (-channel, channel, channel, channel, channel)))
    found = np.abs(servo.response(np.array([1e-6, 5.0])))
    np.testing.assert_allclose(found[:, 0], [1.0, math.sqrt(0.5)], rtol=1e-6)
