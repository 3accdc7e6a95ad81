"""Runs whose time steps are too long, and what is said of them: a rod that swings from a pin."""

import re
from functools import cache

import pytest

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.results.result import Result
from crinoid.simulation import play

PENDULUM = {
    "arm.nodes": 3,
    "arm.length": 0.22,
    "arm.radius": 6.5e-3,
    "arm.youngs_modulus": 8.2e6,
    "arm.damping_time": 0.0,
    "base.mount": "pinned",
    "water.density": 1.2,
    "simulation.start": "rest",
    "output.interval": 0.1,
}


@cache
def swing(time_step: float, integrator: str = "newmark", duration: float = 10.0) -> Result:
    simulation = {"time_step": time_step, "integrator": integrator, "duration": duration}
    own = {f"simulation.{key}": value for key, value in simulation.items()}
    return play(Prepared(crinoid.Scenario().with_values(PENDULUM | own)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("time_step", "integrator", "said"),
    [
        (0.1, "newmark", "the arm gained .* no force accounts.*; try simulation.time_step = 0.02"),
        (0.02, "newmark", "the arm gained .* too fast for time steps of 0.02 s.* = 0.004, or"),
        (0.1, "generalized-alpha", "the arm gained .*; try simulation.time_step = 0.02$"),
        (0.002, "implicit-euler", 'the arm lost .*implicit Euler damps .*integrator = "newmark"'),
    ],
)
def test_a_run_whose_energy_comes_from_nowhere_has_failed(time_step, integrator, said):
    result = swing(time_step, integrator)
    assert result.failure
    assert re.match(r"failed at t = [0-9.]+ s: ", result.status)
    assert re.search(said, result.status)
    # to the end: what was computed is there to look at
    assert float(result.dataset["time"][-1]) == pytest.approx(10.0)


@pytest.mark.release
def test_what_a_message_says_to_try_helps():
    result = swing(0.004)
    assert result.status == "ok"
    assert not any("energy balance" in note for note in result.notes)
    assert float(result.dataset["step_error"].max()) < 1e-3 * 0.22


@pytest.mark.slow
def test_a_run_that_goes_on_is_judged_as_a_whole():
    begun = swing(0.02, duration=1.0)
    assert begun.status == "ok"
    whole = swing(0.02)
    resumed = play(Prepared(whole.scenario), resume=begun)
    assert resumed.status == whole.status
    assert resumed.notes == whole.notes
