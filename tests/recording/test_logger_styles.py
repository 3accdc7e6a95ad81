"""Measured currents of data loggers, and slips that would change numbers without a word."""

import numpy as np
import pytest
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.recording import propose, read_dataset
from crinoid.recording.selection import read_selection
from crinoid.scenario import Scenario
from crinoid.scenario.flow import MeasuredFlow
from helpers.styles import (
    BED,
    EAST_NORTH,
    M_PER_S,
    Played,
    Refused,
    by_keys,
    by_proposal,
    check_keys,
    check_proposal,
    clock,
    dates,
    over,
    speed_and_direction,
    store,
    straight,
    turning,
)

EAST_PART, NORTH_PART = (each[:, 0] for each in over(straight))
BLANK = "%Y-%m-%d %H:%M:%S"


def lines(*head, row="{0},{1:.3f},{2:.3f}", times=BLANK, change=("", "")):
    """Return what writes lines of a head and a row for each instant, with one text changed."""

    def write(folder):
        rows = zip(dates(times), EAST_PART, NORTH_PART, strict=True)
        text = "\n".join([*head, *(row.format(*each) for each in rows), ""])
        (folder / "logger.csv").write_text(text.replace(*change))
        return folder / "logger.csv"

    return write


def one_cell(folder):
    """Realtime currents of NDBC at one depth, the newest first."""
    speed, direction = over(speed_and_direction, -2.5)
    rows = [
        f"{time}    2.5 {d:5.0f} {100 * s:5.1f}"
        for time, s, d in zip(dates("%Y %m %d %H %M"), speed[:, 0], direction[:, 0], strict=True)
    ]
    head = ["#YY  MM DD hh mm DEP01 DIR01 SPD01", "#yr  mo dy hr mn      m  degT  cm/s"]
    (folder / "42001.txt").write_text("\n".join([*head, *rows[::-1], ""]))
    return folder / "42001.txt"


def nortek_comma(folder):
    """Cells of Nortek whose numbers, distances too, have a decimal comma."""
    speed, direction = over(speed_and_direction, (-19.4, -18.9))
    text = "DateTime;Speed#1(0,6m);Dir#1(0,6m);Speed#2(1,1m);Dir#2(1,1m)\n"
    for k, time in enumerate(dates(BLANK)):
        cells = ";".join(f"{s:.3f};{d:.1f}" for s, d in zip(speed[k], direction[k], strict=True))
        text += f"{time};{cells}\n".replace(".", ",")
    (folder / "nortek.csv").write_text(text)
    return folder / "nortek.csv"


TOA5 = (
    '"TOA5","CR1000","CR1000","1234","CR1000.Std.32","CPU:current.CR1","5555","Table1"',
    '"TIMESTAMP","RECORD","u","v"',
    '"TS","RN","m/s","m/s"',
    '"","","Avg","Avg"',
)
HOBO = (
    '"Plot Title: 20123456"',
    '"#","Date Time, GMT-07:00","u, m/s (LGR S/N: 20123456)"',
)
PARTS = "year,month,day,hour,minute,second,u (m/s),v (m/s)"
FLAGGED = "time,u (m/s),v (m/s),{}"
GAP = {"gaps": ((1, 0),)}
SPIKE = ("0.420,-0.090,1", "1.9,-0.090,4")
COMMAS = "time;u (mm/s);v (mm/s)"

STYLES = {
    "Campbell": Played(
        lines(*TOA5, row='"{0}",7,{1:.3f},"{2:.3f}"'), EAST_NORTH | {"time": "TIMESTAMP"}
    ),
    "Campbell with a gap": Played(
        lines(*TOA5, row='"{0}",7,{1:.3f},{2:.3f}', change=("0.420", '"NAN"')),
        EAST_NORTH | {"time": "TIMESTAMP"},
        **GAP,
    ),
    "HOBO": Refused(
        lines(*HOBO, row="1,{0},{1:.3f}", times="%m/%d/%y %I:%M:%S %p"),
        "03/01/24 06:00:00 AM.*ISO dates",
        {"time": "Date Time, GMT-07:00", "velocity": ["u, m/s", "0"]},
    ),
    "parts of a date": Played(
        lines(PARTS, row="{0},{1:.3f},{2:.3f}", times="%Y,%m,%d,%H,%M,%S"), EAST_NORTH
    ),
    "one cell of NDBC": Played(one_cell, None, (-2.5,), current=turning),
    "Nortek with decimal commas": Played(nortek_comma, None, (-19.4, -18.9), current=turning),
    "a flag of all columns": Played(
        lines(FLAGGED.format("flag"), row="{0},{1:.3f},{2:.3f},1", change=SPIKE), EAST_NORTH, **GAP
    ),
    "a quality of all columns": Played(
        lines(FLAGGED.format("Quality"), row="{0},{1:.3f},{2:.3f},1", change=SPIKE),
        EAST_NORTH,
        **GAP,
    ),
    "a flag of another variable": Played(
        lines(FLAGGED.format("T,T_flag"), row="{0},{1:.3f},{2:.3f},11,4"), EAST_NORTH
    ),
    "a flag of no variable": Played(
        lines(FLAGGED.format("salt_qc"), row="{0},{1:.3f},{2:.3f},4"),
        EAST_NORTH,
        remark="salt_qc is a flag of no variable",
    ),
    "commas between thousands": Refused(
        lines(COMMAS, row="{0};4;5", change=("06:10:00;4", "06:10:00;1,400")), "u contains 1,400"
    ),
}


@pytest.mark.parametrize("style", by_keys(STYLES))
def test_a_logger_is_played_or_refused(tmp_path, style):
    check_keys(style, tmp_path)


@pytest.mark.parametrize("style", by_proposal(STYLES))
def test_the_keys_of_a_logger_are_proposed(tmp_path, style):
    check_proposal(style, tmp_path)


def test_a_comma_that_may_separate_thousands_is_said(tmp_path):
    path = lines(COMMAS, row="{0};1,400;0,5")(tmp_path)
    record = read_selection(MeasuredFlow(file=str(path), **EAST_NORTH), BED)
    np.testing.assert_allclose(record.velocity[:, 0, 0], 1.4e-3)
    assert "u: 1,400 is read as 1.4" in record.remarks


@pytest.mark.parametrize(
    ("long_name", "said"),
    [("current direction (magnetic)", True), ("direction, less magnetic declination", False)],
)
def test_a_direction_from_magnetic_north_is_said(tmp_path, long_name, said):
    turn = {"units": "degrees", "long_name": long_name}
    variables = {"time": clock(), "speed": (("time",), np.full(4, 0.3), M_PER_S)}
    path = store(tmp_path / "a.nc", variables | {"dir": (("time",), np.full(4, 60.0), turn)})
    with read_dataset(str(path)) as dataset:
        record = read_selection(MeasuredFlow(**propose(dataset, str(path))), BED)
    assert said == ("dir counts from magnetic north, and so must heading_deg" in record.remarks)


def test_a_path_of_the_target_may_be_a_dataset(tmp_path, monkeypatch):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    place = {name: ("time", np.full(3, at), {"units": "m"}) for name, at in (("x", 0.5), ("z", -9))}
    dataset = xr.Dataset(place, {"time": ("time", [0.0, 5.0, 9.0], {"units": "s"})})
    series = Prepared(Scenario(target={"path": "file", "file": dataset})).series["target"]
    np.testing.assert_array_equal(series.time, [0, 5, 9])
    np.testing.assert_array_equal(series.values, [[0.5, -9]] * 3)
