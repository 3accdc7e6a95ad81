"""Metrics of a run, and the tables that show them."""

import numpy as np
import pytest
from rich.console import Console

import crinoid
from crinoid.cli.display import cases_table, run_table
from crinoid.results import table
from crinoid.results.effort import input_use
from crinoid.results.errors import angle_error, deflection, short_way, tip_error
from crinoid.results.loads import base_force, base_moment
from crinoid.results.metrics import MEASURES
from crinoid.results.result import Result
from helpers.made_results import LIMITS, of_values

TIME = np.linspace(0.0, 10.0, 101)
PID = {"slide": {"ki": 1.0}, "tilt": {"ki": 1.0}}
DRIVEN = {
    "base.channels": {"slide": {}, "tilt": {}},
    "control": {"kind": "pid", "controlled": ["x", "angle"], "pid": PID},
}


def made(error, angle=0.0, scenario=None, slide=0.0, force=1.0):
    """Make a planar result of a tip that is off along x, and off in angle."""
    zero = np.zeros_like(TIME)
    error, angle, slide, force = (zero + values for values in (error, angle, slide, force))
    scenario = crinoid.Scenario() if scenario is None else scenario
    run = of_values(
        2,
        TIME,
        np.zeros(2),
        np.ones(2),
        tip_error=np.abs(error),
        tip_position=np.stack([error, zero], axis=1),
        tip_angle=angle,
        tip_angle_target=zero,
        base_servo=np.stack([slide, zero, -10 * slide], axis=1),
        **{f"channel_{key}": np.full(3, each) for key, each in LIMITS.items()},
        base_force=np.stack([3 * force, 4 * force], axis=1),
        base_moment=-0.1 * force,
        steps=np.ones(TIME.size, dtype=int),
        newton_iterations=np.full(TIME.size, 2),
    )
    attrs = {"title": "made up", "scenario": scenario.to_toml(), "wall_time": 1.0, "status": "ok"}
    return Result(run.assign_attrs(attrs))


def test_a_result_says_its_main_numbers_in_a_few_lines():
    result = made(0.02, scenario=crinoid.Scenario().with_values(DRIVEN))
    result.uncontrolled = made(0.04)
    title, run, *rows = str(result).splitlines()
    assert title == 'Result of "made up": ok'
    assert run.endswith("101 saved instants, arm in the plane of 2 nodes")
    assert [" ".join(row.split()) for row in rows[:2]] == [
        "tip error, RMS 20 mm, 40 mm without control",
        "tip error, maximum 20 mm, 40 mm without control",
    ]
    assert len(rows) == 6
    result.dataset = result.dataset.drop_vars("time")  # whatever it holds
    assert repr(result).startswith('Result of "made up": ok')


def said(shown, width=80):
    console = Console(width=width)
    with console.capture() as capture:
        console.print(shown)
    return capture.get()


def cells(text):
    """Return the cells of a run's table by the name of their row."""
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in text.splitlines()]
    return {row[0]: row[1:] for row in rows if row}


def test_steady_error_and_deflection_of_a_known_error():
    run = made(np.where(TIME < 3.95, 0.5, 0.01))
    run.uncontrolled = made(np.where(TIME < 1.0, 0.0, 1.0))
    assert deflection(run) == pytest.approx(1.0)
    assert tip_error(run).steady == pytest.approx(0.01)


def test_without_a_comparison_only_a_run_without_controller_has_a_deflection():
    assert deflection(made(0.02)) == pytest.approx(0.02)
    driven = crinoid.Scenario().with_values(DRIVEN | {"control.compare": False})
    assert deflection(made(0.02, scenario=driven)) is None


def test_the_error_of_the_angle_goes_the_short_way_round():
    errors = angle_error(made(0.0, angle=2 * np.pi + 0.2 * np.sign(np.sin(TIME + 0.01))))
    assert errors.rms == pytest.approx(0.2)
    assert errors.maximum == pytest.approx(0.2)
    np.testing.assert_allclose(
        short_way(np.array([3.5, -3.5, 0.1])), [3.5 - 2 * np.pi, 2 * np.pi - 3.5, 0.1]
    )


def test_the_error_of_a_direction_in_space_is_the_angle_between_the_two():
    turn = 0.3 + 0.1 * np.sign(np.sin(6 * np.pi * (TIME + 0.01)))
    run, ahead = made(0.0), np.tile([1.0, 0.0, 0.0], (TIME.size, 1))
    direction = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    run.dataset["tip_direction"] = (("time", "axes"), direction)
    run.dataset["tip_direction_target"] = (("time", "axes"), ahead)
    errors = angle_error(run)
    assert errors.maximum == pytest.approx(0.4)
    assert errors.rms == pytest.approx(np.sqrt(np.mean(turn**2)))
    assert errors.fluctuation == pytest.approx(0.1, rel=0.01)


def test_the_use_of_channels_is_that_of_the_servos_a_controller_drives():
    slide = 0.03 * np.sin(2 * np.pi * TIME / 10) + 0.01
    driven = crinoid.Scenario().with_values(DRIVEN)
    use = input_use(made(0.0, scenario=driven, slide=slide))
    assert list(use) == ["slide", "tilt"]
    assert use["slide"].low == pytest.approx(slide.min())
    assert use["slide"].high == pytest.approx(slide.max())
    assert use["tilt"].rms == pytest.approx(10 * np.sqrt(np.mean(slide**2)))
    assert input_use(made(0.0, slide=slide)) == {}


def test_the_largest_load_counts_all_its_parts():
    run = made(0.0, force=np.sin(TIME) - 2.0)
    assert base_force(run).maximum == pytest.approx(5 * 3.0, rel=1e-2)
    assert base_moment(run).maximum == pytest.approx(0.3, rel=1e-2)


def test_a_run_s_table_has_units_that_read_well_and_fits_80_columns():
    driven = crinoid.Scenario().with_values(DRIVEN)
    run = made(3e-6, angle=0.01, scenario=driven, slide=0.02 * np.sin(TIME), force=1e-3)
    run.uncontrolled = made(26.0 * (1 + 0.1 * np.sin(6 * np.pi * TIME / 10)), angle=0.1, force=2e-3)
    text = said(run_table(run))
    assert max(map(len, text.splitlines())) <= 80
    rows = cells(text)
    assert rows["tip error, maximum"][1:] == ["28.6 m", "0.0%"]
    assert rows["angle error, RMS"] == ["0.573 deg", "5.73 deg", "10.0%"]
    assert rows["slide, limits ±1 m"][0] == "-20 to 20 mm"
    assert rows["tilt, limits ±57.3 deg"][0] == "-11.5 to 11.5 deg"
    assert rows["largest force on base"] == ["5 mN", "10 mN", "50.0%"]
    assert len(table.summary(run).rows) <= 12
    more = {row[0] for row in table.summary(run, full=True).rows}
    assert set(rows) - {"", "tip error, RMS"} < more
    assert {"tip error, P95", "slide, RMS", "force on base, RMS"} <= more - set(rows)
    run.uncontrolled = None
    assert "uncontrolled" not in said(run_table(run))
    assert cells(said(run_table(run)))["tip error, RMS"] == ["3 µm"]


def test_of_many_inputs_the_short_table_has_the_one_nearest_to_a_limit(monkeypatch):
    run = made(0.0, scenario=crinoid.Scenario().with_values(DRIVEN), slide=0.03 * np.sin(TIME))
    monkeypatch.setattr(table, "_FEW_INPUTS", 1)
    rows = {name: cell for name, cell in table.summary(run).rows if "limit" in name}
    assert rows == {"nearest limit (2 inputs)": "tilt, 30% of its limit"}


def test_a_run_s_table_has_no_round_off():
    scenario = crinoid.Scenario().with_values(DRIVEN)
    run = made(3e-17, scenario=scenario, slide=1e-14, force=2e-15)
    rows = cells(said(run_table(run, full=True)))
    assert {rows[f"tip error, {name}"][0] for name in ("RMS", "maximum")} <= {"0 mm", "0 µm"}
    assert rows["slide, RMS"] == ["0 mm"]
    assert rows["largest force on base"][0].startswith("0 ")
    assert "largest curvature" not in rows


def test_a_study_s_table_has_what_was_varied_and_found_in_80_columns():
    varied = {"arm.youngs_modulus": 4e6, "flow.0.velocity": [0.3, 0.123]}
    found = {"deflection": 26.03, "rms_error": 0.01234, "rms_error_uncontrolled": 0.05}
    found |= {"settling_time": 3.456, "rise_time": 1.0, "steady_error": 1e-5}
    rows = [{"case": "case-01", **varied, **found}]
    text = said(cases_table("A study", list(varied), rows, MEASURES))
    assert max(map(len, text.splitlines())) <= 80
    for part in ("modulus", "4e+06", "[0.3, 0.123]", "26", "12.3", "3.46"):
        assert part in text


def test_a_study_s_table_says_which_cases_with_a_step_do_not_settle():
    found = {"steady_error": 1e-5, "rms_error": 0.01, "rms_error_uncontrolled": ""}
    rows = [
        {"case": f"case-0{n}", "seed": n, **found, "rise_time": rise, "settling_time": settled}
        for n, (rise, settled) in enumerate([(1.0, 3.456), (1.0, ""), ("", "")], start=1)
    ]
    lines = said(cases_table("A study", ["seed"], rows, MEASURES)).splitlines()
    cases = [line.split() for line in lines if line.strip().startswith("0")]
    assert [case[-1] for case in cases] == ["3.46", "not", "10"]
    assert "settled" not in said(cases_table("A study", ["seed"], rows[2:], MEASURES))
