"""A control loop as a linear system: against its simulation, and against what is known on paper."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from crinoid.analysis.linear_loop import (
    LinearPlant,
    System,
    _frequencies,
    linear_controller,
    linear_loop,
)
from crinoid.analysis.margins import find_margins
from crinoid.assembly.plan import Parts
from crinoid.assembly.prepared import Prepared
from crinoid.control import Controller
from crinoid.inverse.smooth_loop import Neighbours
from crinoid.inverse.stability import StabilityMargin
from crinoid.scenario import Scenario
from crinoid.simulation import loop_margin as closed_form
from crinoid.simulation.chunk import fast_chunk
from crinoid.simulation.loop_margin import OpenLoop
from crinoid.simulation.run import begin
from crinoid.simulation.setup import set_up
from helpers.command import succeeded
from helpers.figures import assert_shows_something

TRAVELS = {"slide": {"range": [-0.3, 0.3]}, "tilt": {"range_deg": [0.0, 60.0]}}
GAINS = {
    "slide": {"kp": 0.07, "ki": 1.4, "kd": 0.014},
    "tilt": {"kp": 0.07, "ki": 0.7, "kd": 0.014},
}
SCENARIO = Scenario(
    title="a loop",
    arm={"nodes": 5, "youngs_modulus": 4e5, "damping_time": 0.05},
    base={"tilt_deg": 90.0, "channels": TRAVELS},
    sensors=[{"kind": "shape", "stations": [0.2]}],
    flow=[{"kind": "uniform", "velocity": [0.05, 0.0]}],
    control={"kind": "pid", "controlled": ["x", "angle"], "pid": GAINS},
)


def changed(prepared, values, gains=1.0):
    """Return the scenario with other values, and with other gains of its PID."""
    scaled = {
        f"control.pid.{name}.{term}": gains * getattr(given, term)
        for name, given in prepared.scenario.control.pid.present.items()
        for term in ("kp", "ki", "kd")
    }
    return Prepared(prepared.scenario.with_values(scaled | values))


@pytest.fixture(scope="module")
def prepared():
    return Prepared(SCENARIO)


@pytest.fixture(scope="module")
def setup(prepared):
    return set_up(prepared)


@pytest.fixture(scope="module")
def linear(prepared):
    return linear_loop(prepared)


def rolled(loop, state, distance, steps):
    """Return the tilt commanded at each time step after the target has moved along x (m)."""
    fixed = loop.target.fixed.at[0].add(distance)
    loop = eqx.tree_at(lambda each: each.target.fixed, loop, fixed)
    carry, _ = begin(loop, state)
    end, stride = jnp.asarray(steps, int), jnp.asarray(1, int)
    _, kept, filled, outcome = fast_chunk(loop, carry, end, stride, steps)
    assert outcome.converged
    return np.asarray(kept.command)[: int(filled), 2]


def test_a_pid_is_the_transfer_that_its_equations_have(setup, linear):
    controller, period = setup.loop.controller, 0.01
    found = linear_controller(setup.loop, setup.state, period).minimal()
    frequency = np.array([0.01, 0.3, 2.0, 20.0])
    gains = closed_form._controller(controller, frequency)
    response = found.response(np.exp(2j * np.pi * frequency * period))
    expected = -gains[:, :, None] * np.asarray(controller.mapping)
    np.testing.assert_allclose(response[:, :, :3], expected, rtol=1e-9, atol=1e-9)
    assert not response[:, :, 3:].any()  # neither the shape nor the servos
    assert linear.inputs == ("slide", "tilt")


def test_the_loop_is_that_of_the_arm_in_continuous_time(setup, linear):
    quick = setup.open_loop
    slow = (quick.frequency > 0.05) & (quick.frequency < 3.0)
    for row, frequency in zip(quick.transfer[0, slow], quick.frequency[slow], strict=True):
        at = np.argmin(np.abs(linear.open.frequency - frequency))
        near = frequency / linear.open.frequency[at]
        assert near == pytest.approx(1.0, rel=0.01)
        np.testing.assert_allclose(linear.open.transfer[0, at], row, atol=0.06 * np.abs(row).max())
    one, other = quick.margin(), linear.open.margin()
    assert other.stable
    for name in ("modulus", "gain", "phase", "delay"):
        assert getattr(other, name) == pytest.approx(getattr(one, name), rel=0.15), name


def test_fewer_frequencies_keep_those_near_a_resonance():
    turn = 2 * np.pi * 1.3 / 100  # 1.3 Hz, hardly damped
    frequency = _frequencies(np.exp(np.array([1j, -1j]) * turn - 1e-5), 100.0)
    none = System(*np.zeros((4, 0, 0)))
    response = frequency[None, :, None, None] + 0j
    few = LinearPlant({"water": none}, (), 0.01, frequency, response).every(5)
    grid = np.geomspace(frequency[0], frequency[-1], 1500)
    beside = [f for f in frequency if np.abs(f / grid - 1).min() > 1e-9]
    assert np.abs(np.array(beside) - 1.3).min() < 1e-12  # 1.3 Hz itself, and closely on both sides
    assert len(beside) > 20
    assert np.isin(beside, few.frequency).all()
    assert few.frequency.size < 0.25 * frequency.size
    np.testing.assert_array_equal(few.response[0, :, 0, 0], few.frequency)


@pytest.mark.release
@pytest.mark.parametrize(("share", "grows"), [(0.7, False), (1.2, True)])
def test_a_loop_swings_by_itself_beyond_its_delay_margin_and_not_below(
    prepared, setup, linear, share, grows
):
    margin = linear.open.margin().delay
    assert 0.04 < margin < 1.0
    # room for as many readings under way as the longest delay takes
    loop = set_up(changed(prepared, {"sensor.delay": 1.3 * margin})).loop
    loop = eqx.tree_at(lambda each: each.sensors[0].delay, loop, jnp.asarray(share * margin))
    tilt = rolled(loop, setup.state, 1e-4, 3000)
    early, late = np.ptp(tilt[1000:1600]), np.ptp(tilt[2400:])
    assert (late > 1.5 * early) if grows else (late < 0.5 * early)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 1e-3])
def test_margins_of_an_undamped_arm_agree_with_its_poles(prepared, factor):
    values = {"arm.damping_time": 0.0, "water.density": 0.0, "simulation.integrator": "newmark"}
    gains = {f"control.pid.{name}.kp": 0.07 * factor for name in ("slide", "tilt")}
    own = changed(prepared, values | gains)
    found = linear_loop(own)
    assert found.poles[0].real > 1e-5 * abs(found.poles[0].imag)
    assert np.isfinite(found.open.transfer).all()
    assert not found.open._replace(stable=None).margin().stable
    quick = set_up(own)
    assert not quick.open_loop.margin().stable
    assert "small motions grow" in quick.loop_warnings[0]


def test_poles_and_gain_margin_agree(prepared, linear):
    margin = linear.open.margin()
    assert linear_loop(changed(prepared, {}, 0.97 * margin.gain)).open.margin().stable
    found = linear_loop(changed(prepared, {}, 1.03 * margin.gain))
    assert not found.open.margin().stable
    frequency = np.abs(found.poles[0].imag) / (2 * np.pi)
    assert frequency == pytest.approx(margin.gain_frequency, rel=0.05)


class Everything(Controller):
    """Feeds back the shape, the tip, the speed of a servo, its last command and a memory."""

    gain: jax.Array

    def start(self, seen):
        return seen.readings["shape"].value, jnp.zeros(()), jnp.asarray(0)

    def command(self, memory, seen):
        begin, slow, calls = memory
        bent = jnp.sum(seen.readings["shape"].value - begin)
        slow = 0.8 * slow + 0.2 * bent
        wanted = seen.reference[0] - seen.measured[0]
        tilt = self.gain * (0.05 * slow + wanted) - 0.02 * seen.actuators[0].velocity[2]
        tilt += 0.3 * seen.command[2]
        return jnp.zeros_like(seen.command).at[2].set(tilt), (begin, slow, calls + 1)


@pytest.mark.slow
def test_a_loop_of_any_controller_grows_as_its_pole_says(prepared):
    # every second time step a command, readings between two of them late
    values = {"control.rate_hz": 50.0, "sensor.delay": 0.015, "sensors.0.delay": 0.03}
    scenario = prepared.scenario.with_values({**values, "control.kind": "custom"})
    own = Prepared(scenario, Parts(controller=Everything(jnp.asarray(12.0))))
    found = linear_loop(own)
    assert found.inputs == ("tilt",)
    assert not found.open.margin().stable
    pole = found.poles[0]
    assert pole.imag != 0
    setup = set_up(own)
    # limits of the servo are far, so that it grows for long
    free = eqx.tree_at(
        lambda loop: (loop.system.base.servo.lower, loop.system.base.servo.upper),
        setup.loop,
        (jnp.full(3, -9.0), jnp.full(3, 9.0)),
    )
    steps = int(14.0 / pole.real / 0.01)
    tilt = rolled(free, setup.state, 1e-9, steps)
    # two poles that are conjugates obey y'' = 2 Re(z) y' - |z|^2 y from period to period
    late = tilt[2 * (steps // 3) :: 2]
    z = np.exp(pole * 0.02)
    fitted, *_ = np.linalg.lstsq(np.stack([late[1:-1], late[:-2]], axis=1), late[2:], rcond=None)
    np.testing.assert_allclose(fitted, [2 * z.real, -(np.abs(z) ** 2)], rtol=1e-3)


@pytest.mark.slow
def test_an_input_at_the_end_of_its_range_is_modelled_as_any_other(prepared):
    def gains(*limits):
        values = {"control.kind": "lqg", "base.channels.tilt.range_deg": limits}
        return np.asarray(set_up(changed(prepared, values)).loop.controller.gains)

    # as wide, so that LQG takes its speeds for as dear
    within, at_end = gains(-20.0, 20.0), gains(0.0, 40.0)
    assert np.abs(within).max() > 0
    np.testing.assert_allclose(at_end, within, rtol=1e-6, atol=1e-9 * np.abs(within).max())


def test_states_that_nothing_reaches_or_sees_do_not_count():
    # of three states the first follows the input and is seen; the others are not reached, not seen
    whole = System(
        np.array([[0.5, 0.1, 0.0], [0.0, 1.0, 0.0], [0.3, 0.0, 2.0]]),
        np.array([[1.0], [0.0], [0.0]]),
        np.array([[2.0, 0.0, 0.0]]),
        np.array([[0.1]]),
    )
    least = whole.minimal()
    assert least.A.tolist() == [[0.5]]
    z = np.exp(1j * np.array([0.1, 1.0]))
    expected = 2.0 / (z - 0.5) + 0.1
    np.testing.assert_allclose(least.response(z)[:, 0, 0], expected, rtol=1e-12)
    np.testing.assert_allclose(whole.response(z)[:, 0, 0], expected, rtol=1e-12)


# --- the command -------------------------------------------------------------------------------


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Return how to call the command with a file that is found; its figures are looked at."""

    def written(found, prepared):
        # the command's own programs would be compiled anew
        monkeypatch.setattr("crinoid.cli.analyses.find_margins", lambda _: found)
        (tmp_path / "loop.toml").write_text(prepared.scenario.to_toml())
        output = succeeded("margins", tmp_path / "loop.toml", "--out", tmp_path)
        for name in ("bode.png", "nyquist.png"):
            assert_shows_something(tmp_path / name)
        return output

    return written


def test_crinoid_margins_prints_saves_and_draws(prepared, linear, tmp_path, written):
    output, margin = written(find_margins(prepared), prepared), linear.open.margin()
    assert f"{np.rad2deg(margin.phase):.3g} deg" in output
    saved = xr.load_dataset(tmp_path / "margins.nc")
    assert float(saved["delay_margin"]) == pytest.approx(margin.delay)
    assert saved["delay_margin"].attrs["units"] == "s"
    assert saved["input"].values.tolist() == ["slide", "tilt"]
    loci = saved["locus_real"].values + 1j * saved["locus_imaginary"].values
    assert np.abs(1 + loci).min() == pytest.approx(float(saved["modulus_margin"]))


MEAN = {"kind": "uniform", "velocity": [0.1, 0.0]}
SWELL = {"kind": "sine", "amplitude": [0.2, 0.0], "frequency_hz": 0.1}


def in_water(prepared, gains, *flow):
    return changed(prepared, {"flow": list(flow)}, gains)


CALM = {"kind": "uniform", "velocity": [0.0, 0.0]}


@pytest.mark.release
def test_a_swell_that_passes_through_still_water_is_judged_there_as_well(prepared):
    cases = ((MEAN,), (CALM,), (MEAN, SWELL))
    steady, still, both = (linear_loop(in_water(prepared, 0.3, *flow)) for flow in cases)
    assert both.open.waters == ("the mean current", "still water")
    assert both.water == "still water"
    steady, still, found = (each.open.margin() for each in (steady, still, both))
    assert still.modulus < 0.8 * steady.modulus
    for name in ("modulus", "phase", "delay", "gain"):
        worse = min(getattr(steady, name), getattr(still, name))
        assert getattr(found, name) == pytest.approx(worse, rel=0.02), name  # about another bend
    quick = set_up(in_water(prepared, 0.3, MEAN, SWELL)).open_loop
    assert quick.weakest == "still water"
    assert quick.margin().modulus == pytest.approx(still.modulus, rel=0.15)


@pytest.mark.release
def test_a_loop_that_only_the_mean_current_damps_is_unstable(prepared, written):
    assert linear_loop(in_water(prepared, 1.0, MEAN)).open.margin().stable
    calm, both = (in_water(prepared, 1.0, *flow) for flow in ((CALM,), (MEAN, SWELL)))
    pole = linear_loop(calm).poles[0]
    assert pole.real > 0.05
    found = linear_loop(both).poles[0]
    assert (found.real, abs(found.imag)) == pytest.approx((pole.real, abs(pole.imag)), rel=0.02)
    (note,) = set_up(both).loop_warnings
    assert "small motions grow by themselves in still water" in note
    output = written(find_margins(both), both)
    assert "unstable in still water: small motions grow near 0.279 Hz" in output


@pytest.mark.release
def test_a_search_keeps_its_margin_in_the_worse_water(prepared):
    def excess(gains, asked):
        own = in_water(prepared, gains, MEAN, SWELL)
        stability, loop = StabilityMargin(own.scenario, asked), set_up(own).loop
        found = stability.excess(Neighbours(loop, [], np.zeros(0)))
        return *found[:2], stability.closed(own.scenario)

    kept, violation, closed = excess(0.3, 0.5)
    assert closed.water == "still water"
    margin = closed.open.margin()
    assert kept <= margin.modulus
    assert violation > 1 - margin.modulus / 0.5
    steady, _ = (OpenLoop(closed.open.frequency, L, np.zeros((2, 2))) for L in closed.open.transfer)
    between = 0.5 * (margin.modulus + steady.margin().modulus)
    assert excess(0.3, between)[1] > 0.1
    # stable in the mean current alone: as bad as any unstable loop
    assert excess(1.0, 0.5)[1] > 1
