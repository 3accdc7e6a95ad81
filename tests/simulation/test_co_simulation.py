"""A co-simulation is the session of its inputs, step by step."""

import numpy as np
import pytest

from crinoid import Session
from crinoid.scenario import ScenarioError, load
from crinoid.simulation.co_simulation import CoSimulation

SMALL = [
    "arm.nodes=6",
    "simulation.duration=0.2",
    "simulation.max_halvings=1",
    "sensor.noise_position=0.001",
    "flow.1.modes=8",
]
CHANGED = {"arm.youngs_modulus": 3e6, "seed": 5}


@pytest.fixture(scope="module")
def scenario():
    return load("station-keeping", SMALL)


def values(arm):
    found = {each.name: np.array(arm.get(each.name)) for each in arm.outputs}
    assert all(found[each.name].shape == each.shape for each in arm.outputs)
    return found


def test_outputs_are_those_of_a_session_with_the_same_inputs(scenario):
    arm = CoSimulation(scenario)
    for name, value in CHANGED.items():
        arm.set(name, value)
    session = Session(scenario.with_values(CHANGED), external=["current", "base"])
    for number, (slide, current, heave) in enumerate([(0.02, 0.1, 0.0), (-0.01, 0.3, 0.001)]):
        arm.set("command_slide", slide)
        arm.set("current_x", current)
        arm.set("base_heave", heave)
        # commands and what comes from outside hold over a step of two control periods
        arm.advance(2 * number * arm.period, 2 * arm.period)
        for _ in range(2):
            command = {"slide": slide, "tilt": 0.0}
            session.step(command, current=[current, 0.0], base={"heave": (heave, 0.0)})
        found = values(arm)
        assert arm.time == pytest.approx(session.time, rel=1e-12)
        now, seen = session.record(), session.seen
        for name, value in zip(("x", "z", "angle"), now.tip, strict=True):
            assert found[f"tip_{name}"] == pytest.approx(float(value), abs=1e-12)
        for prefix, pose in ("target", seen.reference), ("measured", seen.measured):
            assert [found[f"{prefix}_{name}"] for name in ("x", "z", "angle")] == pose.tolist()
        assert [found["base_force_x"], found["base_force_z"]] == now.base_force.tolist()
        assert found["base_moment"] == now.base_moment
        assert [found["base_pose_slide"], found["base_pose_heave"]] == now.pose.tolist()[:2]
        assert found["max_curvature"] == np.abs(now.curvature).max() > 0
    data = session.result().dataset.isel(time=-1)
    np.testing.assert_allclose(found["shape"], data["position"], atol=1e-12)
    # the noise shows that the seed counts
    assert abs(found["measured_x"] - found["tip_x"]) > 1e-5


def test_an_angle_turns_on_without_jumps(scenario):
    arm = CoSimulation(scenario.with_values({"base.tilt_deg": 177.0}))
    first = arm.get("tip_angle")
    for number in range(8):
        arm.set("base_tilt", -0.01 * (number + 1))  # the tip swings the other way at first
        arm.advance(number * arm.period, arm.period)
        assert arm.get("tip_angle") == pytest.approx(first, abs=0.1)
    assert first < np.pi < arm.get("tip_angle")


def test_parameters_are_real_numbers_by_key(scenario):
    arm = CoSimulation(scenario)
    names = {each.name: each for each in arm.parameters}
    assert names["arm.youngs_modulus"].unit == "Pa"
    assert names["flow.1.mean.0"].start == pytest.approx(0.06)
    assert all(names[each].meaning for each in ("seed", "water.density", "flow.0.amplitude.0"))
    unused = {"control.pid.slide.kp", "simulation.time_step", "arm.nodes", "arm.dimension"}
    assert not unused & set(names)
    arm.set("arm.youngs_modulus", -1.0)
    with pytest.raises(ScenarioError, match=r"arm.youngs_modulus: got -1.0; must be a number abo"):
        arm.start()


def refused(arm, message, time=0.0, step=0.01, kind=(ValueError, RuntimeError)):
    with pytest.raises(kind, match=message):
        arm.advance(time, step)


def test_steps_are_multiples_of_the_control_period_from_the_present_on(scenario):
    arm = CoSimulation(scenario)
    for step in (0.015, 0.0, -0.01, float("nan"), float("inf")):
        refused(arm, r"step: got \S+; must be a multiple of the control period, 0.01", step=step)
    refused(arm, r"communication point: got 0.01; must be 0 s, the time of the arm", 0.01)
    refused(arm, r"simulation.duration = 0.2 s ends before 0.21 s. Set this parameter", step=0.21)
    arm.set("current_z", float("nan"))
    refused(arm, r"current: got \[0.0, NaN\]; must be finite|current: got .*; must be finite")
    assert arm.time == 0.0
    arm.set("current_z", 0.0)
    arm.advance(0.0, 0.2 * (1 - 1e-9))
    refused(arm, "simulation.duration = 0.2 s ends", 0.2)
    arm.set("seed", arm.get("seed"))
    with pytest.raises(RuntimeError, match="seed: got 7 after the start; must be set before it"):
        arm.set("seed", 7)


def test_a_time_step_that_cannot_be_solved_is_reported(scenario):
    arm = CoSimulation(scenario)
    arm.set("current_x", 1e4)
    refused(arm, r"^failed at t = 0\S* s: ", kind=RuntimeError)
    refused(arm, "the session has ended: a time step failed")


def test_scenarios_that_no_host_can_step_are_refused(scenario):
    with pytest.raises(ScenarioError, match=r"vary: is of several cases. Choose one with --set"):
        CoSimulation(load("constant-load"))
    rate = scenario.with_values({"control.rate_hz": 70.0})
    with pytest.raises(ScenarioError, match=r"control.rate_hz: got 70.0; must have a period that"):
        CoSimulation(rate)


def test_a_submarine_that_floats_has_no_motion_from_outside():
    settings = ["sensors.0.kind=shape", "sensors.0.stations=[0.5]", "sensors.0.name=gauge"]
    arm = CoSimulation(load("floating-3d", settings))
    inputs, outputs = ({each.name for each in some} for some in (arm.inputs, arm.outputs))
    assert {"command_sway", "current_y"} <= inputs
    assert not {"command_slide", "base_slide"} & inputs
    assert {"tip_direction_y", "gauge.twist_0", "vehicle_pose_roll", "base_moment_y"} <= outputs
    assert "tip_angle" not in outputs
