"""Currents, motions and paths of files that do not fit are refused in one line with a remedy."""

import os
import re

import netCDF4
import numpy as np
import pytest
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.scenario import Scenario, load
from helpers.measured import measured, point, profile, write
from helpers.refusals import refusal

# --- currents ------------------------------------------------------------------------------------

HEADER = "time [s],u (m/s),w (m/s)\n"
TIME = np.arange(80) * 0.5


def rows(*changes, times=TIME, end="\n"):
    """Return the rows of a current in CSV, with texts changed."""
    text = "".join(f"{t},0.3{index:02d},0.05{end}" for index, t in enumerate(times))
    for old, new in changes:
        text = text.replace(old, new)
    return text


def record(change=None, dimensions=("time",)):
    """Return what writes 100 samples of 0.3 m/s and then changes something in the file."""

    def write(path):
        with netCDF4.Dataset(path, "w") as stored:
            stored.createDimension("time", 100)
            time = stored.createVariable("time", "f8", ("time",))
            time.units, time[:] = "s", np.arange(100.0)
            for name in "uw":
                velocity = stored.createVariable(name, "f8", dimensions)
                velocity.units, velocity[:] = "m/s", 0.3
            if change is not None:
                change(stored)

    return write


def values(name, given):
    return record(lambda stored: stored[name].__setitem__(slice(None), given))


def attribute(name, **given):
    return record(lambda stored: [stored[name].setncattr(*each) for each in given.items()])


def huge_pieces(stored):
    stored.createDimension("place", 400_000_000)
    chunks = {"zlib": True, "chunksizes": (1, 400_000_000)}
    stored.createVariable("v", "f4", ("time", "place"), **chunks).units = "m/s"


def huge(coordinate):
    """Return what writes a small file that declares a huge record."""

    def write(path):
        with netCDF4.Dataset(path, "w") as stored:
            stored.createDimension(coordinate, 3_000_000_000)
            for name, units in (("time", "s"), ("u", "m/s")):
                chunks = {"zlib": True, "chunksizes": (1_000_000,)}
                stored.createVariable(name, "f8", (coordinate,), **chunks).units = units

    return write


def cut_short(path):
    point(path)
    path.write_bytes(path.read_bytes()[:3000])


def alike(path):
    name = {"standard_name": "sea_water_speed"}
    write(path, TIME, a=0 * TIME, b=0 * TIME, attributes=name)


def gridded(path):
    """Write a current on a grid that has a coordinate along one side only."""
    dims = "time", "lat", "eta"
    place = {"time": ("time", TIME, {"units": "s"}), "lat": [48.0, 48.5]}
    xr.Dataset({"u": (dims, np.ones((80, 2, 3)), {"units": "m/s"})}, place).to_netcdf(path)


N = np.arange(100.0)
U = {"velocity": ["u", "0"]}
VEL = {"velocity": ["vel[E]", "vel[U1]"], "vertical": "range"}
HOUR = np.datetime64("2024-03-01T06:00")
DATES = [str(HOUR + np.timedelta64(index, "s")) for index in range(80)]
NAMES = "time,u (m/s),w (m/s)\n"
SAID = "far from its other numbers"

CURRENTS = {
    "no file": (lambda path: None, {}, "file: .*a.nc: no such file"),
    "a folder": (lambda path: path.mkdir(), {}, "file: a.nc is a folder; must be a CSV"),
    "nanoseconds": (
        NAMES + rows(times=[f"17{index:017d}" for index in range(80)]), {},
        "time: time names no unit and begins at 1.7e.18, as of a date in ns; .*Call it time .ns."),
    "a file cut short": (cut_short, {}, "file: a.nc is broken .NetCDF"),
    "no variable": (point, {"velocity": ["uu", "w"]}, 'velocity.0: got "uu", .*; did you mean u'),
    "one standard name of two": (
        alike, {"velocity": ["sea_water_speed", "0"]}, "velocity.0: .* must name one variable"),
    "times that repeat": (values("time", np.where(N == 17, 16.0, N)), {}, "time: time repeats at "),
    "times that go back": (
        values("time", N[::-1]), {}, "time: time goes back at entry 1, 0 s after the first; must"),
    "steps of 1e300 s": (values("time", 1e300 * N), {}, "time: time has steps of 1e.300"),
    "steps of nothing": (values("time", 1e-300 * N), {}, "time: time has steps of 1e-300"),
    "an infinite time": (values("time", [*N[:99], np.inf]), {}, "time: time has a missing"),
    "pascals": (attribute("u", units="Pa"), {}, 'velocity.0: u is in "Pa"; must be in a unit such'),
    "units of numbers": (attribute("u", units=3), {}, 'velocity.0: u is in "3"; must be in a unit'),
    "a scale of words": (attribute("u", scale_factor="abc"), {}, "file: u cannot be read"),
    "a scale that is huge": (attribute("u", scale_factor=1e308), {}, "velocity.0: u reaches"),
    "another type": (attribute("u", dtype="bool"), {}, "velocity.0: u contains no numbers"),
    "twice over time": (record(None, ("time", "time")), {}, ".* must have each dimension once"),
    "gaps for the most part": (
        values("u", np.where(N < 70, np.nan, 0.3)), {}, "file: 70% of u is missing; must have"),
    "bursts": (values("time", N + 1e4 * (N > 50)), {}, "time: most samples are missing"),
    "a gap that is not marked": (
        values("u", np.where(N == 70, -9999.0, 0.3)), {}, "velocity.0: u reaches 9999 m/s; .*Mark"),
    "a gap in numbers of single precision": (
        values("u", np.where(N == 70, np.float32(-32767) * np.float32(1e-3), 0.3)), {},
        f"velocity.0: u contains -32.767, {SAID}"),
    "too short": (
        record(), {"duration": 120.0, "skip": 5.0}, "file: a.nc lasts 99 s; must last at least 12"),
    "begun after its end": (record(), {"skip": 99.0}, "skip: got 99.0; must be below 99"),
    "no labels": (record(), {"velocity": ["u[E]", "0"]}, 'velocity.0: u has no entry "E"; must'),
    "levels in s": (record(), U | {"vertical": "time"}, 'vertical: time is in "s"; must'),
    "low pass": (record(), {"low_pass_hz": 0.5}, "low_pass_hz: got 0.5; must be below 0.5 .Hz"),
    "huge pieces": (
        record(huge_pieces), {"velocity": ["v", "0"], "select": {"place": 3}},
        "file: v is stored in chunks of 1.49 GB; must be stored in chunks of at most 1 GB"),
    "a huge record": (huge("sample"), U, "file: a.nc contains 3000000000 values of this current"),
    "a huge coordinate": (huge("time"), U, "file: a.nc contains 3000000000 values of time"),
    "no level": (
        profile, {"velocity": ["vel[E]", "0"]}, "velocity.0: .* a dimension range .*vertical ="),
    "no label": (profile, VEL | {"velocity": ["vel", "0"]}, "velocity.0: vel .*a dimension dir"),
    "another label": (
        profile, VEL | {"velocity": ["vel[X]", "0"]}, 'velocity.0: .* "X"; must name one of dir'),
    "no height": (profile, VEL | {"depth": None}, "origin: missing; must be the height z from"),
    "a place outside": (gridded, U | {"select": {"lat": 12.0}}, "select.lat: got 12; must be 48"),
    "no place": (gridded, U | {"select": {"eta": 1}}, "velocity.0: u also has a dimension lat"),
    "no such side": (
        gridded, U | {"select": {"lat": 48.0, "a": 1}}, "select.a: no dimension to select in"),
    "an index outside": (
        gridded, U | {"select": {"lat": 48, "eta": 3}}, "select.eta: got 3; must be an index from"),
    "no header": (rows(), {}, "file: a.csv begins with numbers; must have a first line of"),
    "no rows": ("# none\n", {}, "file: a.csv has no rows; must have a header and rows of numbers"),
    "a header only": (HEADER, {}, "time: time contains 0 instants; must contain at least 2"),
    "no text": ("\0\1\2", {}, "file: a.csv is no text; must be a CSV or netCDF file"),
    "a row too long": (HEADER + rows() + "40,1,2,3\n", {}, "file: a.csv has 4 values in line 82"),
    "rows too long": (HEADER + rows(end=",1\n"), {}, "file: a.csv has longer rows; must have 3"),
    "a name twice": ("time,u,u\n" + rows(), {}, "file: a.csv has several columns u; must have"),
    "words": (HEADER + rows(("0.302", "calm")), {}, 'velocity.0: u contains "calm" in row 3'),
    "times of the day": (
        HEADER + rows(times=[each[11:] for each in DATES]), {}, 'time: .* "06:00:00" in row 1'),
    "dates of no order": (
        NAMES + rows((DATES[40], "1.3.2024 06:00"), times=DATES), {}, "time: .*06:00. in row 41"),
    "no time in a row": (
        HEADER + rows(("\n0.5,", "\n,")), {}, "time: time has a missing or infinite entry"),
    "a level twice": (
        "time (s),z (m),u (m/s)\n0,1,1\n0,2,1\n1,1,1\n1,1,1", U | {"vertical": "z", "origin": 0.0},
        "time: row 4 has the time and the z of an earlier one; must have one row"),
} | {
    f"{mark} in mm/s": (
        HEADER.replace("u (m/s)", "u (mm/s)") + rows(("0.304", mark)), {},
        f"velocity.0: u contains {mark}, {SAID}")
    for mark in ("-999", "-9999", "-32768")
}  # fmt: skip
"""How a file is written or its text, keys of the flow, and a pattern of the answer."""


@pytest.mark.filterwarnings("ignore:Duplicate dimension names")
@pytest.mark.parametrize(("file", "keys", "line"), CURRENTS.values(), ids=CURRENTS)
def test_a_current_that_does_not_fit_is_refused_in_one_line(tmp_path, file, keys, line):
    path = tmp_path / ("a.csv" if isinstance(file, str) else "a.nc")
    path.write_text(file) if isinstance(file, str) else file(path)
    said = refusal(measured(path, **keys))
    assert re.match(rf"flow\.0\.{line}", said), said


@pytest.mark.parametrize("name", ["a.xlsx", "a.xyz", "a.zarr"])
def test_another_format_is_refused_with_those_that_are_read(tmp_path, name):
    path = tmp_path / name
    path.mkdir() if name == "a.zarr" else path.write_bytes(b"1 2 3\n")
    said = refusal(measured(path))
    assert said.endswith(
        "must be a CSV or netCDF file (.csv, .tsv, .txt, .dat, .out, .nc), or a log of ROS"
    )


@pytest.mark.parametrize("name", ["pipe.csv", "pipe.nc", "/dev/zero"])
def test_what_is_no_regular_file_is_refused_and_not_waited_for(tmp_path, name):
    path = tmp_path / name
    if not path.exists():
        os.mkfifo(path)
    assert f"{path.name} is no regular file; must be a CSV" in refusal(measured(path))


@pytest.mark.parametrize(
    ("name", "limit"), [("a.nc", "numbers.MAX_VALUES"), ("a.csv", "table._MAX_BYTES")]
)
def test_a_large_file_is_refused_before_it_is_read(tmp_path, monkeypatch, name, limit):
    record()(tmp_path / "a.nc")
    (tmp_path / "a.csv").write_text(HEADER + rows())
    monkeypatch.setattr(f"crinoid.recording.{limit}", 100)
    assert "at most" in refusal(measured(tmp_path / name))


# --- motions and paths ---------------------------------------------------------------------------


def moved(path, **keys):
    motion = {"kind": "file", "channel": "heave", "file": str(path), **keys}
    return Scenario(base={"motion": [motion]}, simulation={"duration": 20.0})


def followed(path, **keys):
    """Return the scenario of a path; in space it has directions."""
    axes = 3 if "direction_columns" in keys else 2
    return Scenario(arm={"dimension": axes}, target={"path": "file", "file": str(path), **keys})


def pointed(*directions):
    head = "time (s),x (m),y (m),z (m),ex,ey,ez\n"
    return head + "".join(f"{5 * k},0.5,0,-10,{row}\n" for k, row in enumerate(directions))


HEAVE = "time (s),heave (cm),tilt (deg)\n0,0,0\n10,20,-90\n20,-10,45\n"
METRES = "time (s),heave (m)\n"
PATH = "time (s),x (m),z (m)\n"
TURNS = {"direction_columns": ["ex", "ey", "ez"]}
SERIES = {
    "too short": (moved, METRES + "0,0\n12,1\n", {}, "time_column: ends at 12 s of the run; must"),
    "too late": (moved, METRES + "1,0\n22,1\n", {}, "time_column: begins at 1 s of the run; must"),
    "another unit": (moved, HEAVE, {"value_column": "tilt"}, 'value_column: tilt is in "deg"; mus'),
    "no column": (moved, HEAVE, {"value_column": "roll"}, 'value_column: got "roll", no such col'),
    "no time": (moved, HEAVE, {"time_column": "t"}, 'time_column: got "t", no such column'),
    "unmarked": (
        moved, HEAVE.replace("-10", "-999999"), {}, "value_column: heave reaches 999999; .*Mark"),
    "all missing": (moved, METRES + "0,\n20,1\n", {}, "file: a.csv has 1 row without a missing"),
    "no direction": (followed, pointed("1,0,0", "0,0,0"), TURNS, "direction_columns: a vector is"),
    "opposite directions": (
        followed, pointed("1,0,0", "0,1,0", "0,-3,0"), TURNS,
        "direction_columns: turn to the opposite at 10 s of the run; must turn by less"),
    "a huge direction": (
        followed, pointed("1,0,0", "1e20,0,0"), TURNS, "direction_columns.0: ex reaches 1e.20"),
    "a path after the run": (
        followed, PATH + "1709272800,0.5,-10\n1709272810,0.4,-10\n", {},
        "skip: the path begins at 1.70927e.09 s of a run of 20 s; must"),
} | {
    f"a path with {mark}": (
        followed, f"{PATH}0,0.5,-10\n5,{mark},-10\n10,0.4,-10\n", {},
        f"tip_columns.0: x contains {float(mark):g}, {SAID}")
    for mark in ("-999", "-9999", "999.9", "-999.99", "9999")
} | {
    f"a motion with {mark}": (
        moved, f"{METRES}0,0\n5,{mark}\n20,0.1\n", {},
        f"value_column: heave contains {float(mark):g}, {SAID}")
    for mark in ("-999", "999.9")
}  # fmt: skip


@pytest.mark.parametrize(("case", "text", "keys", "line"), SERIES.values(), ids=SERIES)
def test_a_motion_or_path_that_does_not_fit_is_refused_in_one_line(
    tmp_path, case, text, keys, line
):
    (tmp_path / "a.csv").write_text(text)
    said = refusal(case(tmp_path / "a.csv", **keys))
    assert re.match(rf"(target|base\.motion\.0)\.{line}", said), said


def test_each_file_at_fault_has_a_line(tmp_path):
    (tmp_path / "a.toml").write_text(
        '[[base.motion]]\nkind = "file"\nchannel = "heave"\nfile = "heave.csv"\n'
        '[target]\npath = "file"\nfile = "~nobody-has-this/x.csv"\n'
    )
    with pytest.raises(ValueError, match="no such file") as caught:
        Prepared(load(tmp_path / "a.toml")).notes()
    assert sorted(each.key for each in caught.value.mistakes) == [
        "base.motion.0.file",
        "target.file",
    ]
