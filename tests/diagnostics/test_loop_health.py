"""How a loop did, on made-up motions of the tip and of the servos."""

import re

import numpy as np
import pytest
import xarray as xr
from scipy.signal import lfilter

import crinoid
from crinoid.diagnostics.control_loop import (
    comparison,
    growth,
    limit_cycle,
    loop_notes,
)
from crinoid.foundation.result_variables import quantity
from crinoid.results.errors import tip_error
from crinoid.results.result import Result
from crinoid.results.saturation import limit_shares

TIME = np.arange(0.0, 30.001, 0.02)
SLIDE = {"range": [0.0, 0.2], "max_speed": 0.1, "max_acceleration": 2.0}
SCENARIO = crinoid.Scenario(
    base={"channels": {"slide": SLIDE, "tilt": {}}},
    control={"kind": "pid", "pid": {"slide": {"ki": 1.0}}},
)


def made(error, slide=None, uncontrolled=None, scenario=SCENARIO) -> Result:
    """Make a run whose tip is off by ``error`` (m), along x or along both axes."""
    error = error if error.ndim == 2 else np.stack([error, 0 * error], axis=1)
    servo = np.zeros((TIME.size, 3))
    servo[:, 0] = 0.1 if slide is None else slide
    values = {
        "tip_position": np.add(error, [0.5, -10.0]),
        "tip_target": np.add(0 * error, [0.5, -10.0]),
        "tip_error": np.linalg.norm(error, axis=1),
        "base_servo": servo,
        "channel_lower": [0.0, 0.0, -1.0],
        "channel_upper": [0.2, 0.0, 1.0],
        "channel_max_speed": [0.1, 0.0, 1.0],
        "channel_max_acceleration": [2.0, 0.0, 10.0],
    }
    dataset = xr.Dataset(
        {name: quantity(name, value, 2) for name, value in values.items()},
        {"time": TIME, "channel": ["slide", "heave", "tilt"]},
        {"scenario": scenario.to_toml(), "status": "ok", "notes": ""},
    )
    other = None if uncontrolled is None else made(uncontrolled, scenario=scenario)
    return Result(dataset, uncontrolled=other)


def turbulence(seed: int, scale: float = 1.5) -> np.ndarray:
    """Return an error (m) that wanders with an integral time of ``scale`` (s)."""
    keep = np.exp(-(TIME[1] - TIME[0]) / scale)
    noise = np.random.default_rng(seed).normal(size=(TIME.size, 2))
    return 0.02 * lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], noise, axis=0)


CALM = 0.02 + 0 * TIME


# --- limits ------------------------------------------------------------------------------------


def test_a_note_gives_the_time_at_the_ends_of_the_travel():
    # an ideal slide of 0.2 m that should move by 0.1 + 0.2 sin: beyond its ends 2/3 of the time
    wanted = 0.1 + 0.2 * np.sin(2 * np.pi * 0.05 * TIME)
    result = made(CALM, slide=np.clip(wanted, 0.0, 0.2))
    (met,) = limit_shares(result).values()
    beyond = np.mean(np.abs(wanted - 0.1) >= 0.1)
    assert met.range == pytest.approx(beyond, abs=0.01)
    assert 0.6 < beyond < 0.72
    assert met.speed == 0
    (note,) = loop_notes(result)
    assert note.startswith(f"base.channels.slide: at its limit of range for {100 * met.range:.1f}%")
    assert loop_notes(made(CALM, slide=0.1 + 0.05 * np.sin(TIME))) == []


def test_an_end_that_the_channel_begins_at_counts_once_it_has_left_it():
    assert limit_shares(made(CALM, slide=0 * TIME))["slide"].range == 0
    back = np.where((TIME > 10) & (TIME < 20), 0.1, 0.0)
    assert limit_shares(made(CALM, slide=back))["slide"].range == pytest.approx(1 / 3, abs=0.01)


def test_speed_and_acceleration_are_those_between_instants():
    half = TIME < 15
    ramp = np.where(half, 0.1 * (TIME % 1.5), 0.0) + 0.02
    met = limit_shares(made(CALM, slide=ramp))["slide"]
    assert met.speed == pytest.approx(0.5, abs=0.03)
    jerk = 0.1 + 2.0 * np.abs((TIME % 0.2) - 0.1) ** 2 * np.where(TIME % 0.4 < 0.2, 1, -1)
    assert limit_shares(made(CALM, slide=jerk))["slide"].acceleration > 0.8
    (note,) = loop_notes(made(CALM, slide=ramp))
    assert "at its limit of speed for" in note


def test_time_before_control_is_on_does_not_count():
    late = SCENARIO.with_values({"control.start": 15.0})
    stuck = np.where(TIME < 15, 0.2, 0.1)
    assert limit_shares(made(CALM, slide=stuck, scenario=late))["slide"].range == 0
    off = SCENARIO.with_values({"control.kind": "none"})
    assert limit_shares(made(CALM, slide=stuck, scenario=off)) == {}
    assert loop_notes(made(CALM, slide=stuck, scenario=off)) == []


# --- swings by itself --------------------------------------------------------------------------


def test_an_error_that_grows_by_itself_gets_a_note():
    growing = 1e-3 * np.exp(TIME / 8.0) * np.sin(2 * np.pi * 0.3 * TIME)
    found = growth(made(growing, uncontrolled=CALM))
    assert found == pytest.approx(np.exp(15 / 8.0), rel=0.1)
    assert any("grows" in note for note in loop_notes(made(growing, uncontrolled=CALM)))
    # not where it does so without control
    assert growth(made(growing, uncontrolled=2 * growing)) is None
    assert growth(made(1e-3 * growing, uncontrolled=CALM)) is None


def test_a_limit_cycle_gets_a_note_and_a_driven_swing_none():
    cycle = 0.01 * np.sin(2 * np.pi * 2.5 * TIME) + 0.002
    found = limit_cycle(made(cycle, uncontrolled=CALM))
    assert found.frequency == pytest.approx(2.5, abs=0.05)
    assert found.amplitude == pytest.approx(0.01 / np.sqrt(2), rel=0.05)
    (note,) = loop_notes(made(cycle, uncontrolled=CALM))
    assert note.startswith(
        "the loop is in a limit cycle: the tip oscillates at 2.5 Hz with 7.1 mm RMS"
    )
    # waves swing the tip without control as well
    assert limit_cycle(made(cycle, uncontrolled=1.5 * cycle)) is None
    # what dies down, or cannot be seen
    assert limit_cycle(made(cycle * np.exp(-TIME / 8.0), uncontrolled=CALM)) is None
    assert limit_cycle(made(0.02 * cycle, uncontrolled=CALM)) is None
    # with nothing to compare with, where nothing else swings
    assert limit_cycle(made(cycle)) is not None
    sine = {"kind": "sine", "amplitude": [0.1, 0.0], "frequency_hz": 2.5}
    assert limit_cycle(made(cycle, scenario=SCENARIO.with_values({"flow": [sine]}))) is None


@pytest.mark.parametrize("seed", range(20))
def test_turbulence_neither_grows_nor_cycles(seed):
    free = np.add(turbulence(seed), [0.02, -0.01])
    held = 0.2 * turbulence(seed + 100, scale=0.2)
    result = made(held, uncontrolled=free)
    assert loop_notes(result) == []
    assert growth(made(free)) is None
    assert limit_cycle(made(free)) is None


# --- whether it helped -------------------------------------------------------------------------


def test_control_that_makes_it_worse_gets_a_note():
    result = made(2 * turbulence(3), uncontrolled=turbulence(3))
    with_, without = comparison(result)
    assert with_ == pytest.approx(2 * without)
    assert any(note.startswith("control increases the tip's error") for note in loop_notes(result))
    assert comparison(made(CALM)) is None
    # for less than a period of the arm it has had no time to
    for frequency, judged in ((0.02, False), (0.1, True)):
        result.dataset["natural_frequency"] = ("mode", [frequency])
        assert (comparison(result) is not None) == judged
    # as in the table of the run
    late = SCENARIO.with_values({"target.judged_from": 0.5 * TIME[-1]})
    result = made(2 * turbulence(3), uncontrolled=turbulence(3), scenario=late)
    assert comparison(result) == (tip_error(result).rms, tip_error(result.uncontrolled).rms)
    # two nothings
    assert loop_notes(made(1e-6 + 0 * TIME, uncontrolled=1e-7 + 0 * TIME)) == []
    # while it is on
    late = SCENARIO.with_values({"control.start": 15.0})
    before = np.where(TIME < 15, 0.05, 0.01)
    assert loop_notes(made(before, uncontrolled=CALM, scenario=late)) == []


@pytest.mark.slow
def test_a_load_of_held_commands_that_steps_do_not_resolve_is_noted():
    scenario = crinoid.load(
        "floating", ["control.compare=false", "arm.nodes=9", "simulation.duration=4.0"]
    )
    loads, notes = {}, {}
    for step in (0.01, 0.000625, 0.0003125):
        cut = {"simulation.time_step": step, "output.interval": step}
        run = crinoid.simulate(scenario.with_values(cut)).dataset
        late = run["base_force"].isel(time=run["time"].values > 2.5)
        loads[step] = np.linalg.norm(late, axis=1)
        notes[step] = run.attrs["notes"]
    assert "the force on the base is not resolved: held for 0.01 s" in notes[0.01]
    assert "simulation.time_step = 0.000625" in notes[0.01]
    assert "resolve" not in notes[0.000625] + notes[0.0003125]
    assert loads[0.000625].max() == pytest.approx(loads[0.0003125].max(), rel=0.01)
    # what the coarse steps miss, as estimated in the note
    rms = {step: float(np.sqrt(np.mean(load**2))) for step, load in loads.items()}
    missed = np.sqrt(rms[0.0003125] ** 2 - rms[0.01] ** 2)
    (said,) = re.findall(r"adds about (\S+) N RMS", notes[0.01])
    assert float(said) == pytest.approx(missed, rel=0.5)
