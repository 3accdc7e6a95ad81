"""Optimisation: derivatives, known optima, limits, and what the command writes."""

import json
import os
import signal

import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.inverse import StoppedError
from crinoid.inverse.goal import Goal
from crinoid.inverse.optimisation import _SLOPE, Optimisation
from crinoid.inverse.ranges import Ranges
from crinoid.inverse.smooth_loop import SmoothLoop
from crinoid.inverse.trial_runs import TrialRuns
from crinoid.results.metrics import MEASURES
from crinoid.scenario import Scenario, ScenarioText
from crinoid.view.figures import write_report
from helpers.command import SMALL, call, refused, succeeded
from helpers.figures import assert_shows_something

LOOP = Scenario(
    seed=3,
    arm={"nodes": 5, "youngs_modulus": 1e6},
    base={"tilt_deg": -20.0, "channels": {"slide": {}, "tilt": {}}},
    flow=[{"kind": "uniform", "velocity": [0.2, 0.1]}],
    chamber=[{"name": "lift", "offset": 0.005, "area": 1e-4, "max_pressure": 2e4}],
    control={
        "kind": "pid",
        "rate_hz": 50.0,
        "pid": {"slide": {"kp": 0.05, "ki": 0.5}, "lift": {"ki": 0.5}},
    },
    target={"tip": [0.47, -10.17]},
    simulation={"duration": 0.5, "time_step": 0.02},
)
# a chamber alone bends a light arm in still water into an arc of a circle
EI, OFFSET, AREA, LENGTH = 1e-2, 0.01, 1e-4, 0.5
ARC = """\
title = "an arc"

[arm]
length = 0.5
nodes = 11
density = 1000.0   # that of the water
section = { EI = 1e-2, EA = 1e6 }

[water]
density = 1000.0

[[chamber]]
offset = 0.004     # m, to be chosen
area = 1e-4
angle_deg = 180.0
max_pressure = 6.0e3 # Pa, too little
schedule = { time = [0.0, 1.0], share = [1.0, 1.0] }

[target]
tip = [TIP]

[simulation]
duration = 1.0
"""


def arc_tip(curvature):
    """Return the tip of an arc that starts at the base, 10 m deep and level."""
    angle = curvature * LENGTH
    return np.array([np.sin(angle) / curvature, (1 - np.cos(angle)) / curvature - 10.0])


WANTED = arc_tip(1.2)
LIMIT = 0.03
OVER = ("chamber.0.max_pressure=4e3:4e4", "chamber.0.offset=0.002:0.01")


def search_of(scenario, over, measure, keep=(), *, seeds=1, trials=40, rest=False):
    goal = Goal(scenario, measure, keep)
    search = Optimisation(scenario, Ranges(scenario, over), goal, seeds, trials, rest=rest)
    search.run(lambda *_: None, lambda: False)
    return search


@pytest.fixture(scope="module")
def arc(tmp_path_factory):
    path = tmp_path_factory.mktemp("arc") / "arc.toml"
    path.write_text(ARC.replace("[TIP]", str(WANTED.tolist())))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("acts_on", "over", "rest"),
    [
        ("controller", ("control.pid.slide.ki=0.1:2", "control.pid.lift.ki=0.1:2:log"), False),
        ("numbers", ("control.pid.slide.ki=0.1:2", "arm.damping_time=0.01:0.2"), False),
        # the angle of the target is that of the equilibrium
        ("all", ("arm.youngs_modulus=5e5:2e6", "chamber.0.max_pressure=1e4:4e4"), True),
    ],
)
def test_derivatives_are_those_of_differences_of_runs(acts_on, over, rest):
    scenario = LOOP.with_values({"control.compare": False})
    if rest:
        schedule = {"time": [0, 1], "share": [0.5, 0.5]}
        scenario = scenario.with_values({"chamber.0.schedule": schedule})
    else:  # errors count from 0.2 s, but the last tenth is that of the whole run
        scenario = scenario.with_values({"target.judged_from": 0.2})
    names = [name for name, measure in MEASURES.items() if measure.smooth]
    if rest:  # of one instant there is no fluctuation, and no speed of an input
        names = [name for name in names if name not in ("fluctuation", "control_cost")]
    goal = Goal(scenario, names[0], [f"{name}<1" for name in names[1:]])
    ranges = Ranges(scenario, over)
    search = Optimisation(scenario, ranges, goal, 1, 1, rest=rest)
    loop = SmoothLoop(scenario, ranges, [3], rest=rest)
    assert loop.acts_on == acts_on
    point, h = np.array([0.4, 0.6]), 1e-3
    steps = [h * axis for axis in np.eye(2)]
    points = [point, *(point + step for step in steps), *(point - step for step in steps)]
    runs = search.runs([ranges.scenario(each) for each in points])[..., 0]
    values, slopes = (each[:, 0] for each in loop.measures(point, goal.of_run))
    np.testing.assert_allclose(values, runs[0], rtol=1e-6, atol=1e-10)
    differences = (runs[1:3] - runs[3:5]).T / (2 * h)
    assert np.abs(differences).max() > 0
    for name, slope, difference in zip(goal.names, slopes, differences, strict=True):
        # the slope of a smooth maximum is a mean over the instants about the largest one: it may be
        # off by as much as a search allows
        near = _SLOPE if name.startswith("max_") else 2e-3
        size = 1e-6 + near * np.linalg.norm(difference)
        assert np.abs(slope - difference).max() < size, name


@pytest.mark.release
def test_without_derivatives_a_population_evolves():
    over = ("control.pid.slide.ki=0.1:4", "arm.damping_time=0.01:0.2")
    search = search_of(LOOP, over, "rms_error", ["work<1"], trials=48, seeds=2)
    assert search.method == "differential evolution (work: no derivatives)"
    assert len(search.trials) == 1 + 48  # the given values, and three generations
    first = [trial.found[0].mean() for trial in search.trials if trial.start == 0]
    assert search.least < min(first)
    assert search.least < search.given[0].mean()


def test_a_start_outside_its_range_is_the_nearest_end():
    scenario = LOOP
    ranges = Ranges(scenario, ["arm.youngs_modulus=2e6:8e6:log", "base.tilt_deg=-40:0"])
    np.testing.assert_allclose(ranges.start, [0.0, 0.5])
    inside = Ranges(scenario, ["arm.youngs_modulus=1e5:1e7:log"])
    np.testing.assert_allclose(inside.start, [0.5])
    assert inside.values(np.array([1.0])) == {"arm.youngs_modulus": 1e7}


def test_points_that_keep_the_limits_come_first():
    goal = Goal(LOOP, "rms_error", ["max_error<0.1", "work>1"])
    found = np.array([[5.0, 0.05, 2.0], [1.0, 0.2, 2.0], [2.0, 0.05, 0.5], [4.0, 0.1, 1.0]])
    assert list(np.argsort(goal.rank(found[..., None]))) == [3, 0, 2, 1]
    np.testing.assert_allclose(goal.violation(found[..., None]), [0.0, 1.0, 0.5, 0.0])
    worst = np.array([[1.0, 1.0], [0.05, 0.15], [2.0, 2.0]])
    assert goal.violation(worst) == pytest.approx(0.5)  # in one of two draws
    assert goal.rank(np.array([[np.nan], [0.05], [2.0]])) == np.inf


# --- the command -----------------------------------------------------------------------------


def command(arc, out, *more, over=OVER, keep=f"max_error<{LIMIT}", ask=succeeded):
    ranges = [part for each in over for part in ("--over", each)]
    limits = ["--keep", keep] if keep else []
    goal = ("--at-rest", "--for", "max_pressure", *limits)
    return ask("optimise", arc, *goal, *ranges, *more, "--out", out)


@pytest.mark.slow
def test_the_command_writes_the_optimum_on_paper_into_the_users_own_file(arc, tmp_path):
    """The least pressure has the largest offset, and bends the arm just far enough."""
    out = tmp_path / "out"
    command(arc, out, "--trials", 40, "--set", "water.drag_normal=1.3")
    text = (out / "optimised.toml").read_text()
    for line in ("density = 1000.0   # that of the water", "offset = 0.01     # m, to be chosen"):
        assert line in text
    summary = json.loads((out / "summary.json").read_text())
    assert summary["kept"]
    numbers = summary["numbers"]
    curvatures = np.linspace(0.6, 1.2, 6001)
    away = [np.linalg.norm(arc_tip(each) - WANTED) for each in curvatures]
    least = curvatures[np.argmax(np.array(away) < LIMIT)] * EI / (AREA * OFFSET)
    assert numbers["chamber.0.offset"] == pytest.approx(OFFSET)
    assert summary["at_end"] == ["chamber.0.offset"]
    assert numbers["chamber.0.max_pressure"] == pytest.approx(least, rel=0.01)
    given = ScenarioText(arc, ["water.drag_normal=1.3"]).scenario
    assert crinoid.load(out / "optimised.toml") == given.with_values(numbers)
    # the numbers are those of a real run
    rest = crinoid.equilibrium(out / "optimised.toml")
    (pressure,), (error,) = (summary["measures"][m]["after"] for m in ("max_pressure", "max_error"))
    assert MEASURES["max_pressure"].of(rest) == pytest.approx(pressure, rel=1e-12)
    assert MEASURES["max_error"].of(rest) == pytest.approx(error, rel=1e-9)
    assert error == pytest.approx(LIMIT, rel=1e-3)
    data = xr.load_dataset(out / "optimise.nc")
    assert data.attrs["method"] == "gradients"
    np.testing.assert_array_equal(data["best"], list(numbers.values()))
    np.testing.assert_array_equal(data["given"], [6e3, 0.004])
    assert data["found"].dims == ("trial", "measure", "draw")
    (figure,) = write_report(out / "optimise.nc", tmp_path)
    assert_shows_something(figure)
    # again over its own files, but not over those of others
    (out / "optimise.nc").write_text("notes")
    assert "not written by crinoid" in command(arc, out, ask=refused)


@pytest.mark.slow
def test_a_missed_limit_is_named_with_exit_code_1(arc, tmp_path):
    # no arm keeps it; the ranges and measures of the other calls share what they compile
    found = command(arc, tmp_path, "--trials", 8, keep="max_error<-1", ask=call)
    assert found.exit_code == 1
    assert "no trial keeps all limits: max_error<-1 is missed by " in found.stderr
    assert (tmp_path / "optimised.toml").exists()
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert not summary["kept"]
    # the best one is that with the least violation
    errors = xr.load_dataset(tmp_path / "optimise.nc")["found"].sel(measure="max_error")
    (error,) = summary["measures"]["max_error"]["after"]
    assert error == pytest.approx(float(errors.min()), rel=1e-3)


def test_an_interruption_of_the_second_trial_saves_the_given_numbers(tmp_path, monkeypatch):
    def runs(self, scenarios, seeds=None):
        if len(scenarios) > 1:  # the first generation
            os.kill(os.getpid(), signal.SIGINT)
            if self._stop():
                raise StoppedError
        return np.full((len(scenarios), 1, 1), 0.02)

    monkeypatch.setattr(TrialRuns, "__call__", runs)
    file = tmp_path / "small.toml"
    file.write_text(SMALL.with_values({"arm.youngs_modulus": 6e5}).to_toml())
    words = ("--over", "arm.youngs_modulus=1e5:1e6", "--for", "settling_time", "--out", tmp_path)
    found = call("optimise", file, *words)
    assert found.exit_code == 130, found.output
    assert "interrupted after 1 trial; the best so far is saved" in found.stderr
    assert crinoid.load(str(tmp_path / "optimised.toml")).arm.youngs_modulus == 6e5
    data = xr.load_dataset(tmp_path / "optimise.nc")
    assert data["found"].values.tolist() == [[[0.02]]]


@pytest.mark.slow
def test_an_interruption_saves_the_best_so_far(arc, tmp_path, monkeypatch):
    keep = Optimisation._keep

    def interrupted(self, trial):
        keep(self, trial)
        if len(self.trials) == 3:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Optimisation, "_keep", interrupted)
    found = command(arc, tmp_path, "--trials", 4000, ask=call)
    assert found.exit_code == 130
    assert "the best so far is saved" in found.stderr
    data = xr.load_dataset(tmp_path / "optimise.nc")
    assert 3 <= data.sizes["trial"] < 200
    assert Scenario.from_toml((tmp_path / "optimised.toml").read_text())
