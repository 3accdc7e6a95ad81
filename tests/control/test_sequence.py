"""A sequence of phases: what its inputs do, and the touches that end a phase."""

import re

import numpy as np
import pytest

import crinoid

PHASES = [
    # down to the ball, however far away it is
    {"inputs": {"heave": -0.1}, "duration": 1.0, "until": {"finger": 0.05}},
    {"inputs": {"curl": 0.5, "tilt_deg": 3.0}, "duration": 0.2},
    {"inputs": {"heave": 0.05}, "duration": 0.5},
]


def scenario(phases=PHASES, ball=-10.08, **tables):
    """Describe an arm above a ball, at a height (m)."""
    described = {
        "arm": {"nodes": 5, "youngs_modulus": 4e6, "density": 1025.0},
        "base": {"channels": {"heave": {}, "tilt": {}}},
        "chamber": [{"name": "curl", "max_curvature": 2.0}],
        "obstacle": [{"kind": "sphere", "radius": 0.02, "position": [0.4, ball]}],
        "sensors": [{"kind": "contact", "name": "finger"}],
        "control": {"kind": "sequence", "sequence": phases, "compare": False},
        "simulation": {"duration": 1.5, "time_step": 0.01},
        "output": {"interval": 0.01},
    }
    return crinoid.Scenario(**described | tables)


@pytest.fixture(scope="module")
def run():
    return crinoid.simulate(scenario()).dataset


def at(time, duration):
    """Return half a cosine from 0 to 1."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip(np.asarray(time) / duration, 0.0, 1.0))


@pytest.mark.slow
def test_a_touch_stops_the_inputs_where_they_are_and_the_next_phase_begins(run):
    time, heave = run["time"].values, run["base_command"].sel(channel="heave").values
    felt = np.linalg.norm(
        run["sensor_reading"].sel(reading=["finger.force_x", "finger.force_z"]), axis=1
    )
    touched = time[np.argmax(felt >= 0.05)]
    assert 0.2 < touched < 0.8  # long before its 0.1 m
    down = time < touched
    np.testing.assert_allclose(heave[down], -0.1 * at(time[down], 1.0), atol=2e-3)
    assert heave.min() > -0.08
    # the second one leaves the heave where it is, the third one lifts it from there
    second = (time > touched + 0.015) & (time < touched + 0.195)
    assert np.ptp(heave[second]) == 0.0
    share = run["actuator_command"].sel(input="curl").values
    np.testing.assert_allclose(share[second], 0.5 * at(time[second] - touched, 0.2), atol=0.05)
    assert share[-1] == 0.5
    assert run["base_command"].sel(channel="tilt").values[-1] == pytest.approx(np.deg2rad(3.0))
    assert heave[-1] == pytest.approx(0.05)


@pytest.mark.release
def test_a_touch_that_ends_the_last_phase_stops_the_inputs_for_good():
    data = crinoid.simulate(scenario(PHASES[:1])).dataset
    heave = data["base_command"].sel(channel="heave").values
    assert -0.08 < heave[-1] < -0.01
    assert np.ptp(heave[data["time"] > 1.0]) == 0.0


@pytest.mark.release
def test_without_a_touch_it_waits_at_its_values():
    data = crinoid.simulate(scenario(ball=-11.0)).dataset
    heave, share = data["base_command"].sel(channel="heave"), data["actuator_command"]
    np.testing.assert_allclose(heave[data["time"] > 1.01], -0.1)
    assert not share.any()


HIGH = "the range of this input"
MISTAKES = {
    'control.sequence: missing; must have a phase with kind = "sequence"': [],
    'control.sequence.0.inputs.tilt: got 3.0; must be of "heave", "tilt_deg" or "curl"': [
        {"inputs": {"tilt": 3.0}, "duration": 1.0}
    ],
    f"control.sequence.0.inputs.tilt_deg: got 70.0; must be from -60 to 60, {HIGH}": [
        {"inputs": {"tilt_deg": 70.0}, "duration": 1.0}
    ],
    f"control.sequence.1.inputs.curl: got -0.5; must be from 0 to 1, {HIGH}": [
        {"duration": 1.0},
        {"inputs": {"curl": -0.5}, "duration": 1.0},
    ],
    'control.sequence.0.until.toe: got 0.1; must be of "finger"': [
        {"until": {"toe": 0.1}, "duration": 1.0}
    ],
    "control.sequence.0.until.finger: got 0.0; must be a number above 0": [
        {"until": {"finger": 0.0}, "duration": 1.0}
    ],
    "control.sequence.0.duration: missing; must be a number above 0 (s)": [{}],
}


@pytest.mark.parametrize("line", MISTAKES)
def test_mistakes_are_one_line(line):
    with pytest.raises(crinoid.ScenarioError, match=f"^{re.escape(line)}$"):
        crinoid.closed_loop(scenario(MISTAKES[line]))
