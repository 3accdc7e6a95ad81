"""Estimates of an observer: their covariance, their place in results, and their frames."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.control_design import observer_model
from crinoid.assembly.observer import ReadingSchedule, reading_noise
from crinoid.assembly.prepared import Prepared
from crinoid.control import Estimate, Estimated, SubmarineFrame
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation.setup import set_up
from helpers.figures import assert_shows_something
from helpers.scripts import load_script

DOCS = Path(__file__).parents[2] / "docs"
NOISE = 1e-3
HELD = Scenario(
    seed=4,
    arm={"nodes": 6, "radius": 0.015, "youngs_modulus": 4e6, "density": 1080.0},
    base={"tilt_deg": 90.0, "channels": {"slide": {"bandwidth_hz": 10.0}, "tilt": {}}},
    flow=[{"kind": "sine", "amplitude": [0.2, 0.0], "frequency_hz": 0.2, "ramp_time": 1.0}],
    sensor={"noise_position": NOISE, "noise_angle_deg": 0.1, "delay": 0.02},
    control={"kind": "lqg", "controlled": ["x", "angle"], "compare": True},
    simulation={"duration": 4.0, "time_step": 0.02, "start": "equilibrium"},
    output={"interval": 0.02},
)
NAMES = {"tip_position", "tip_angle", "position", "flow_velocity"}
VARIABLES = {f"estimated_{name}{end}" for name in NAMES for end in ("", "_std")}


@pytest.fixture(scope="module")
def held():
    """Return the run of an upright arm under LQG control in a swell."""
    return crinoid.simulate(HELD)


@pytest.mark.release
def test_covariance_is_that_of_the_errors_of_a_linear_arm():
    setup = set_up(Prepared(HELD), notes=False)
    plan, observer = setup.plan, setup.loop.controller.observer
    arrivals = ReadingSchedule.of(plan.sensors, plan.period, HELD.simulation.time_step)
    model, parts = observer_model(plan, HELD.driven, arrivals)
    variance, _ = reading_noise(plan, model, parts)
    assert arrivals.age == (1,)  # readings under way are states too
    draws, rng = 1000, np.random.default_rng(5)
    size, ways = np.linalg.eigh(parts.noise)
    by_noise = ways * np.sqrt(np.maximum(size, 0.0))
    true, found = np.zeros((2, draws, parts.move.shape[0]))
    gain = np.asarray(observer.gains[0])
    for _ in range(800):
        true = true @ parts.move.T + rng.standard_normal(true.shape) @ by_noise.T
        found = found @ parts.move.T
        read = true @ parts.expect.T
        read += rng.standard_normal(read.shape) * np.sqrt(variance)
        found = found + (read - found @ parts.expect.T) @ gain.T
    outputs = observer.outputs
    for output in (outputs.tip, outputs.position):
        errors = (found - true) @ np.asarray(output.by_state).T
        expected = np.asarray(output.std**2 - output.apart**2).ravel()
        moves = expected > 1e-12 * expected.max()
        # the variance of 1000 draws errs by 4.5 %
        ratio = errors.var(axis=0)[moves] / expected[moves]
        np.testing.assert_allclose(ratio, 1.0, atol=0.2)
        assert abs(np.mean(ratio) - 1) < 0.1
        np.testing.assert_allclose(errors[:, ~moves], 0.0, atol=1e-9)


@pytest.mark.slow
def test_a_result_has_tip_shape_and_current_with_standard_deviations(held):
    data = held.dataset
    assert {str(name) for name in data.data_vars if str(name).startswith("estimated")} == VARIABLES
    assert data["estimated_position"].dims == ("time", "node", "axis")
    assert data["estimated_flow_velocity"].attrs["units"] == "m s-1"
    for name in VARIABLES:
        value = data[name].values
        assert np.isnan(value[0]).all()  # before the first command
        assert np.isfinite(value[1:]).all()
    # the newest command is that of the step that ends at the instant
    np.testing.assert_allclose(data["estimate_time"][1:], data["time"][:-1], atol=1e-12)
    pairs = (("estimated_position", "estimated_tip_position"),)
    for along, tip in pairs:
        last = data[along].isel(node=-1).values[1:]
        np.testing.assert_allclose(last, data[tip].values[1:], atol=1e-9)


def errors_of(data):
    """Return errors of the tip and of the mean current (x), with their standard deviations."""
    nodes = data["flow_velocity"].values
    current = np.mean((nodes[:, 1:] + nodes[:, :-1]) / 2, axis=1)
    at = np.flatnonzero(data["estimate_time"].values > 1.0)
    found = []
    for name, true in (("tip_position", data["tip_position"].values), ("flow_velocity", current)):
        # the estimate of an instant is that of the instant before
        error = data[f"estimated_{name}"].values[at] - true[at - 1]
        found.append((error, data[f"estimated_{name}_std"].values[at]))
    return found


@pytest.mark.slow
def test_the_estimate_is_better_than_a_reading_and_its_band_contains_the_truth(held):
    (tip, tip_std), (current, current_std) = errors_of(held.dataset)
    assert np.sqrt(np.mean(tip**2)) < 0.8 * NOISE
    assert np.mean(np.abs(tip) < 2 * tip_std) > 0.9
    assert np.std(current[:, 0]) < 0.06  # the swell is 0.2 m/s
    assert np.mean(np.abs(current) < 2 * current_std) > 0.8


@pytest.mark.slow
def test_without_an_observer_a_record_has_no_estimate(held):
    assert "estimate_time" not in held.uncontrolled.dataset
    plain = HELD.with_values({"control": {"kind": "none"}})
    setup = set_up(Prepared(plain), notes=False)
    assert setup.loop.estimate(setup.loop.start(setup.state)) == (None, None)


def test_variables_without_an_observer_are_refused():
    chosen = {"output.variables": ["position", "estimated_position"]}
    assert HELD.with_values(chosen).output.variables
    for values in ({"kind": "none"}, {"kind": "mpc", "mpc": {"model": "scheduled"}}):
        with pytest.raises(ScenarioError, match=r"output.variables.1: got \"estimated_position\""):
            HELD.with_values(chosen | {"control": values})


def test_a_forecast_leaves_out_the_current():
    known = {"control": {"kind": "mpc", "controlled": ["x", "angle"], "mpc": {"current": "known"}}}
    loop = set_up(Prepared(HELD.with_values(known)), notes=False).loop
    seen_none = jax.eval_shape(lambda: loop.controller.observer.outputs)
    assert seen_none.flow_velocity is None
    assert seen_none.tip is not None


def frame(amplitude=0.0):
    motions = [
        {"kind": "sine", "channel": "heave", "amplitude": amplitude, "frequency_hz": 0.5},
        {"kind": "sine", "channel": "tilt", "amplitude_deg": 90.0, "frequency_hz": 0.25},
    ]
    scenario = HELD.with_values({"base.motion": motions, "target.frame": "base"})
    prepared = Prepared(scenario)
    target = prepared.target(jnp.array([0.0, -9.5, 1.5]))
    assert isinstance(target.carrier, SubmarineFrame)
    return target.carrier


def test_an_estimate_in_the_frame_of_a_submarine_is_turned_into_the_world():
    carrier, time = frame(0.3), jnp.asarray(1.0)  # turned by 90 degrees, at rest there
    tip = Estimated(jnp.array([0.5, 0.1, 0.2]), jnp.array([1.0, 2.0, 3.0]))
    nodes = Estimated(jnp.array([[0.0, 0.0], [0.5, 0.1]]), jnp.array([[0.0, 0.0], [1.0, 2.0]]))
    flow = Estimated(jnp.array([0.2, 0.0]), jnp.array([0.1, 0.3]))
    found = eqx.filter_jit(Estimate.in_world)(Estimate(tip, nodes, flow), carrier, time)
    turn = np.pi / 2
    base, away = np.array([0.0, -10.0 + 0.3 * np.sin(np.pi)]), np.array([-0.1, 0.5])
    np.testing.assert_allclose(found.tip.value, [*(base + away), 0.2 + turn], atol=1e-12)
    np.testing.assert_allclose(found.tip.std, [2.0, 1.0, 3.0], atol=1e-9)
    np.testing.assert_allclose(found.position.value, [base, base + away], atol=1e-12)
    np.testing.assert_allclose(found.position.std[1], [2.0, 1.0], atol=1e-9)
    # plus the velocity of the frame, heave at its fastest downward
    heave = 0.3 * np.pi * np.cos(np.pi)
    np.testing.assert_allclose(found.flow_velocity.value, [0.0, 0.2 + heave], atol=1e-9)
    np.testing.assert_allclose(found.flow_velocity.std, [0.3, 0.1], atol=1e-9)


class Guess(crinoid.Controller):
    """Rests, and estimates that the tip is where it was measured."""

    wrong: int = eqx.field(static=True, default=0)

    def start(self, seen):
        return seen.measured

    def command(self, memory, seen):
        return jnp.zeros_like(seen.command), seen.measured

    def estimate(self, memory):
        size = memory.size - self.wrong
        return Estimate(Estimated(memory[:size], jnp.full(size, NOISE)))


@pytest.mark.release
def test_a_controller_of_a_package_may_estimate_a_part():
    given = HELD.with_values({"simulation.duration": 0.2, "control.compare": False})
    data = crinoid.simulate(given, controller=Guess()).dataset
    assert "estimated_position" not in data
    assert "estimated_flow_velocity" not in data
    readings = data["sensor_reading"].values[1:-1, :2]
    np.testing.assert_allclose(data["estimated_tip_position"][2:], readings)
    with pytest.raises(ScenarioError, match=r"Guess.* estimate: returned tip with value"):
        crinoid.simulate(given, controller=Guess(wrong=1))


@pytest.mark.slow
def test_the_report_draws_the_estimate(held, tmp_path):
    held.save(tmp_path)
    figures = crinoid.write_report(tmp_path)
    assert "estimate.png" in [path.name for path in figures]
    assert_shows_something(tmp_path / "estimate.png")
    assert "within the band" in (tmp_path / "report.html").read_text()


@pytest.mark.release
def test_over_20_seeds_the_bands_have_the_truth_as_often_as_the_page_says():
    # an upright arm in a swell is in the run above
    shares = load_script(DOCS / "make_coverage.py").coverage("wave-zone")
    assert len(shares) == 6
    # a right model has 0.95; the observer allows for more errors than most runs have
    assert min(shares.values()) > 0.9
    assert shares["tip_position x"] < 0.995


@pytest.mark.slow
def test_estimates_on_a_moving_submarine_are_in_the_world():
    motions = [
        {"kind": "sine", "channel": "heave", "amplitude": 0.05, "frequency_hz": 0.2},
        {"kind": "sine", "channel": "tilt", "amplitude_deg": 8.0, "frequency_hz": 0.15},
    ]
    carried = {"base.motion": motions, "target.frame": "base", "control.compare": False}
    data = crinoid.simulate(HELD.with_values(carried)).dataset
    moved = np.ptp(data["tip_position"].values, axis=0)
    assert moved.min() > 0.005
    assert moved.max() > 0.05
    (tip, _), (current, _) = errors_of(data)
    assert np.sqrt(np.mean(tip**2)) < 1.5 * NOISE
    nodes = data["estimated_position"].values[51:] - data["position"].values[50:-1]
    assert np.abs(nodes).max() < 0.01
    # the base heaves at 0.06 m/s
    assert np.std(current[:, 1]) < 0.04
