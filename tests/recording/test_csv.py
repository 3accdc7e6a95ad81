"""Files of columns: CSV as people write it, paths and motions from files, files that would hurt."""

import os
import random
import re

import jax
import jax.numpy as jnp
import netCDF4
import numpy as np
import pytest
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.scenario import Scenario, ScenarioError, load
from helpers.measured import measured, recorded
from helpers.paths import ROOT
from helpers.refusals import refusal

TIME = np.arange(80) * 0.5
U, W = 0.4 + 0.1 * np.sin(TIME), 0.05 * np.cos(TIME)
HEADER = "time [s],u (m/s),w (m/s)\n"
DATES = np.datetime64("2024-03-01T06:00") + (1000 * TIME).astype("timedelta64[ms]")


def rows(separator=",", decimal=".", end="\n", times=None):
    """Return the lines of a record; twelve digits keep round-off out of comparisons."""
    first = [f"{value:.3f}".replace(".", decimal) for value in TIME] if times is None else times
    numbers = ([f"{value:.12f}".replace(".", decimal) for value in series] for series in (U, W))
    return "".join(separator.join(row) + end for row in zip(first, *numbers, strict=True))


@pytest.fixture
def csv(tmp_path):
    """Return what writes a CSV file."""

    def write(text):
        path = tmp_path / "a.csv"
        path.write_text(text)
        return path

    return write


# --- records in CSV ------------------------------------------------------------------------------

SPOKEN = {
    "commas": HEADER + rows(),
    "tabs": HEADER.replace(",", "\t") + rows("\t"),
    "blanks": "time [s] u (m/s)  w (m/s)\n" + rows("   "),
    "semicolons and decimal commas": HEADER.replace(",", ";") + rows(";", ","),
    "as Excel has it": "\ufeffsep=;\r\n" + HEADER.replace(",", ";").strip() + "\r\n"
    + rows(";", ",", "\r\n"),
    "comments and blank lines": "# of 1 March\n\n" + HEADER + "# begin\n" + rows() + "\n# end\n\n",
    "as NumPy writes it": "# time (s),u (m/s),w (m/s)\n" + rows(),
    "units in a row of their own": "time,u,w\ns,m/s,m/s\n" + rows(),
    "quoted": '"time [s]","u (m/s)","w (m/s)"\n' + rows(),
    "a separator at the end of each line": HEADER.strip() + ",\n" + rows(end=",\n"),
    "ISO dates": "time,u (m/s),w (m/s)\n" + rows(times=[str(date) for date in DATES]),
    "dates with a blank and a zone": "time,u (m/s),w (m/s)\n"
    + rows(times=[f"{date}+01:00".replace("T", " ") for date in DATES]),
    "a column of words that nobody asks for": "time (s),u (m/s),w (m/s),by\n" + rows(end=",me\n"),
} | {
    encoding: f"# 20 \N{DEGREE SIGN}C\n{HEADER}{rows()}".encode(encoding)
    for encoding in ("utf-16", "cp1252", "utf-8-sig")
}  # fmt: skip


@pytest.mark.parametrize("text", SPOKEN.values(), ids=SPOKEN.keys())
def test_a_record_is_read_however_it_is_written(tmp_path, text):
    path = tmp_path / "a.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    case = measured(path)
    recording = recorded(case)
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)
    np.testing.assert_allclose(recording.velocity[:, 0], np.stack([U, W], axis=1), atol=1e-11)
    assert Prepared(case).notes() == []


def test_a_csv_file_is_the_netcdf_file_of_the_same_numbers(tmp_path):
    (tmp_path / "a.csv").write_text("time [ms],u (cm/s),w\n" + rows(times=map(str, 1e3 * TIME)))
    names = {"u": (U, {"units": "cm/s"}), "w": (W, {})}
    variables = {name: ("time", np.round(v, 12), units) for name, (v, units) in names.items()}
    time = ("time", 1e3 * TIME, {"units": "ms"})
    xr.Dataset(variables, {"time": time}).to_netcdf(tmp_path / "a.nc")
    cases = [measured(tmp_path / name, velocity_scale=3.0) for name in ("a.csv", "a.nc")]
    one, other = map(recorded, cases)
    np.testing.assert_array_equal(one.velocity, other.velocity)
    np.testing.assert_array_equal(one.time, other.time)
    assert Prepared(cases[0]).notes() == Prepared(cases[1]).notes()
    assert Prepared(cases[0]).notes()[0] == "flow.0: w names no unit and is assumed to be in m/s"


def test_cells_that_are_missing_are_filled_and_a_note_says_so(csv):
    lines = (HEADER + rows()).splitlines()
    for row, word in ((10, ""), (11, "NaN"), (30, "n/a"), (31, "-")):
        time, _, w = lines[row + 1].split(",")
        lines[row + 1] = f"{time},{word},{w}"
    assert Prepared(measured(csv("\n".join(lines)))).notes() == [
        "flow.0: 5.00% of u is missing and was filled by straight lines, the longest gap 1.5 s"
    ]


def test_a_profile_has_a_row_for_each_time_and_level_in_any_order(csv):
    levels = np.array([0.5, 1.0, 2.0])
    lines = [
        f"{time},{level},{u + 0.1 * level},{w}\n"
        for time, u, w in zip(TIME, U, W, strict=True)
        for level in levels
    ]
    random.Random(0).shuffle(lines)
    lines.insert(0, "time (s),z (m),u (m/s),w (m/s)\n")
    case = measured(csv("".join(lines)), vertical="z", origin=-20.0)
    recording = recorded(case)
    np.testing.assert_allclose(recording.levels, levels - 20.0)
    np.testing.assert_allclose(recording.velocity[..., 0], U[:, None] + 0.1 * levels)
    csv("".join([*lines, lines[1]]))
    assert "row 241 has the time and the z of an earlier one; must have one row" in refusal(case)


def test_the_record_of_the_page_is_played_as_the_page_says(tmp_path, csv):
    page = ROOT.joinpath("docs", "how-to", "currents.md").read_text("utf-8")
    record, levels = re.findall(r"^```csv\n(.*?)^```", page, re.M | re.S)
    (tmp_path / "my-current.csv").write_text(record)
    (text,) = (
        text
        for text in re.findall(r"^```toml\n(.*?)^```", page, re.M | re.S)
        if "my-current.csv" in text
    )
    (tmp_path / "mine.toml").write_text(text)
    case = load(tmp_path / "mine.toml")
    assert Prepared(case).notes() == [
        "flow.0: 10.00% of w is missing and was filled by straight lines, the longest gap 2 s"
    ]
    first = [[0.21, 0.012], [0.235, 0.008], [0.221, 0.0015]]
    np.testing.assert_allclose(recorded(case).velocity[:3, 0], first)
    case = measured(csv(levels), vertical="z", origin=-20.0, duration=1.0)
    np.testing.assert_allclose(recorded(case).velocity[1], [[0.30, 0.01], [0.36, 0.0]])


BAD = {
    "no header": (
        rows(),
        "file: a.csv begins with numbers; must have a first line of",
    ),
    "nothing": ("", "file: a.csv has no rows; must have a header and rows of numbers"),
    "comments": ("# none\n", "file: a.csv has no rows; must have a header and rows of numbers"),
    "a header only": (HEADER, "time: time contains 0 instants; must contain at least 2"),
    "no text": ("\0\1\2", "file: a.csv is no text; must be a CSV or netCDF file"),
    "a row too long": (
        HEADER + rows() + "40.5,1,2,3\n",
        "file: a.csv has 4 values in line 82; must have 3, as in its header",
    ),
    "rows too long": (HEADER + rows(end=",1\n"), "file: a.csv has longer rows; must have 3 values"),
    "a name twice": (
        "time,u,u\n" + rows(),
        "file: a.csv has several columns u; must have each",
    ),
    "words": (
        (HEADER + rows()).replace(f"{W[2]:.12f}", "calm"),
        'velocity.1: w contains "calm" in row 3; must contain a velocity',
    ),
    "times of the day": (
        HEADER + rows(times=[f"06:00:{index:02}" for index in range(80)]),
        'time: time contains "06:00:00" in row 1; must contain increasing numbers or ISO dates',
    ),
    "dates of no order": (
        HEADER + rows(times=[*map(str, DATES[:40]), *["1.3.2024 06:00"] * 40]),
        'time: time contains "1.3.2024 06:00" in row 41',
    ),
    "a time that is missing": (
        (HEADER + rows()).replace("\n0.500,", "\n,"),
        "time: time has a missing or infinite entry; must contain increasing numbers",
    ),
    "no such column": (
        "time (s),east,w\n" + rows(),
        'velocity.0: got "u", no such column in a.csv; it contains time, east, w',
    ),
}


@pytest.mark.parametrize(("text", "line"), BAD.values(), ids=BAD.keys())
def test_a_csv_file_that_does_not_fit_is_refused_in_one_line(csv, text, line):
    assert refusal(measured(csv(text))).startswith(f"flow.0.{line}")


def test_a_csv_file_that_is_too_large_is_refused_before_it_is_read(csv, monkeypatch):
    monkeypatch.setattr("crinoid.recording.table._MAX_BYTES", 1000)
    assert "must have at most 0 MB as CSV" in refusal(measured(csv(HEADER + rows())))


# --- motions and paths ---------------------------------------------------------------------------

HEAVE = "time (s),heave (cm),tilt (deg)\n0,0,0\n10,20,-90\n20,-10,45\n"


def moved(path, channel="heave", **keys):
    motion = {"kind": "file", "channel": channel, "file": str(path), **keys}
    return Scenario(base={"motion": [motion]}, simulation={"duration": 20.0})


def read_motion(*arguments, **keys):
    return Prepared(moved(*arguments, **keys)).series["base.motion.0"]


def read_path(case):
    return Prepared(case).series["target"]


def test_a_motion_comes_from_a_file_in_its_units(csv):
    heave = read_motion(csv(HEAVE))
    np.testing.assert_allclose(heave.time, [0, 10, 20])
    np.testing.assert_allclose(heave.values, [[0], [0.2], [-0.1]])
    tilt = np.deg2rad([[0], [-90], [45]])
    np.testing.assert_allclose(read_motion(csv(HEAVE), "tilt").values, tilt)
    plain = csv("time,heave,tilt\n" + HEAVE.partition("\n")[2])
    np.testing.assert_allclose(read_motion(plain, "tilt").values, tilt)
    assert Prepared(moved(plain, "tilt")).notes() == [
        "base.motion.0: time names no unit and is assumed to be in seconds",
        "base.motion.0: tilt names no unit and is assumed to be in degrees",
    ]


def test_dates_count_from_the_first_and_numbers_are_times_of_the_run(csv):
    dates = "2024-03-01T06:00,0\n2024-03-01T06:00:10,20\n2024-03-01T06:00:30,5\n"
    found = read_motion(csv("when,heave (cm)\n" + dates), time_column="when")
    np.testing.assert_allclose(found.time, [0, 10, 30])
    found = read_motion(csv("time (s),heave (m)\n-5,0\n3,1\n40,2\n"), skip=2.0)
    np.testing.assert_allclose(found.time, [-7, 1, 38])


def test_rows_that_lack_a_value_are_left_out_and_a_note_says_so(csv):
    path = csv("time (s),heave (m)\n0,0\n4,\n6,1\n20,2\n")
    np.testing.assert_allclose(read_motion(path).time, [0, 6, 20])
    assert Prepared(moved(path)).notes() == [
        "base.motion.0: 1 of 4 rows lacks a value and is left out, the longest gap 14 s"
    ]


def test_a_heading_that_wraps_goes_on_by_the_shorter_way(csv):
    path = csv("time (s),tilt (deg)\n0,350\n5,\n8,355\n10,5\n15,356\n20,181\n")
    case = Prepared(moved(path, "tilt"))
    turn = np.rad2deg(case.series["base.motion.0"].values[:, 0])
    np.testing.assert_allclose(turn, [350, 355, 365, 356, 181])
    assert case.notes()[1] == (
        "base.motion.0: tilt jumps by more than 180 degrees between two rows, first at 10 s: the "
        "turn goes on by the shorter way round"
    )
    (motion,) = case.system.base.motions
    speed = jax.jit(jax.vmap(lambda time: motion.derivatives(time)[1]))(jnp.linspace(0, 20, 81))
    assert np.abs(np.rad2deg(speed)).max() < 60
    path = csv("time (s),x (m),z (m),angle (deg)\n0,0,0,170\n5,0,0,-170\n")
    target = {"path": "file", "file": str(path), "angle_column": "angle"}
    series = read_path(Scenario(target=target))
    np.testing.assert_allclose(np.rad2deg(series.values[:, 2]), [170, 190])


MOTIONS = {
    "too short": (
        "time (s),heave (m)\n0,0\n12,1\n",
        {},
        "time_column: ends at 12 s of the run; must end at simulation.duration = 20.0 or later",
    ),
    "too late": (
        "time (s),heave (m)\n1,0\n22,1\n",
        {},
        "time_column: begins at 1 s of the run; must begin at 0 or earlier",
    ),
    "another unit": (
        HEAVE,
        {"value_column": "tilt"},
        'value_column: tilt is in "deg"; must be',
    ),
    "no column": (
        HEAVE,
        {"value_column": "roll"},
        'value_column: got "roll", no such column in a.csv; it contains time, heave, tilt',
    ),
    "no time": (HEAVE, {"time_column": "t"}, 'time_column: got "t", no such column in a.csv'),
    "unmarked": (
        HEAVE.replace("-10", "-999999"),
        {},
        "value_column: heave reaches 999999; must reach at most 1e+05. Mark missing values by an "
        "empty cell",
    ),
    "all missing": (
        "time (s),heave (m)\n0,\n20,1\n",
        {},
        "file: a.csv has 1 row without a missing value; must have at least 2",
    ),
}


@pytest.mark.parametrize(("text", "keys", "line"), MOTIONS.values(), ids=MOTIONS.keys())
def test_a_motion_that_does_not_fit_is_refused_in_one_line(csv, text, keys, line):
    assert refusal(moved(csv(text), **keys)).startswith(f"base.motion.0.{line}")


def test_a_path_comes_from_a_csv_or_netcdf_file(tmp_path, csv):
    path = csv("time (s);x (m);z (mm);angle (rad)\n0;0,5;-10000;0\n5;0,4;-9900;0,1\n")
    target = {"path": "file", "file": str(path), "angle_column": "angle"}
    series = read_path(Scenario(target=target))
    np.testing.assert_allclose(series.values, [[0.5, -10.0, 0.0], [0.4, -9.9, 0.1]])
    place, way = np.arange(1.0, 13.0).reshape(2, 3, 2)
    lengths = {
        name: ("t", values, {"units": "m"}) for name, values in zip("xyz", place, strict=True)
    }
    ways = {f"e{name}": ("t", values) for name, values in zip("xyz", way, strict=True)}
    time = ("t", [0.0, 4.0], {"units": "s"})
    xr.Dataset(lengths | ways, {"t": time}).to_netcdf(tmp_path / "a.nc")
    target = {"path": "file", "file": str(tmp_path / "a.nc"), "time_column": "t"}
    target["direction_columns"] = ["ex", "ey", "ez"]
    series = read_path(Scenario(arm={"dimension": 3}, target=target))
    np.testing.assert_allclose(series.values[:, :3], place.T)
    np.testing.assert_allclose(series.values[:, 3:], (way / np.linalg.norm(way, axis=0)).T, 1e-14)


def pointed(path, *rows):
    """Return the scenario of a path that stays and points as the rows say."""
    lines = [f"{5 * index},0.5,0,-10,{row}\n" for index, row in enumerate(rows)]
    path.write_text("time (s),x (m),y (m),z (m),ex,ey,ez\n" + "".join(lines))
    target = {"path": "file", "file": str(path), "direction_columns": ["ex", "ey", "ez"]}
    return Scenario(arm={"dimension": 3}, target=target)


def test_directions_of_any_length_are_those_of_unit_vectors(tmp_path):
    series = read_path(pointed(tmp_path / "a.csv", "1e-300,0,1e-300", "0,1e12,0"))
    exact = [[0.5**0.5, 0, 0.5**0.5], [0, 1, 0]]
    np.testing.assert_allclose(series.values[:, 3:], exact, rtol=1e-15)


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        (("1,0,0", "0,0,0"), "direction_columns: a vector is 0; must have a direction"),
        (
            ("1,0,0", "0,1,0", "0,-3,0"),
            "direction_columns: turn to the opposite at 10 s of the run; must turn by less. Add "
            "a direction between.",
        ),
        (("1,0,0", "1e20,0,0"), "direction_columns.0: ex reaches 1e+20; must reach at most 1e+15"),
    ],
)
def test_directions_that_do_not_fit_are_refused(tmp_path, rows, line):
    assert refusal(pointed(tmp_path / "a.csv", *rows)).startswith(f"target.{line}")


def followed(path, *rows, units="m", **keys):
    """Return the scenario of a path of 20 s."""
    path.write_text(f"time (s),x ({units}),z ({units})\n" + "".join(f"{row}\n" for row in rows))
    return Scenario(target={"path": "file", "file": str(path), **keys})


def test_a_path_that_begins_after_the_run_is_refused(tmp_path):
    stamps = ("1709272800,0.5,-10", "1709272810,0.4,-10")
    assert refusal(followed(tmp_path / "a.csv", *stamps)) == (
        "target.skip: the path begins at 1.70927e+09 s of a run of 20 s; must be the time of the "
        "file when the run begins (s)"
    )
    case = followed(tmp_path / "a.csv", *stamps, skip=1709272800.0)
    np.testing.assert_array_equal(read_path(case).time, [0, 10])
    late = followed(tmp_path / "a.csv", "19,0.5,-10", "25,0.4,-10")
    np.testing.assert_array_equal(read_path(late).time, [19, 25])


@pytest.mark.parametrize("mark", ["-999", "-9999", "999.9", "-999.99", "9999", "-9999.0"])
def test_numbers_that_mark_missing_values_are_refused_in_paths_and_motions(tmp_path, csv, mark):
    said = f"contains {float(mark):g}, far from its other numbers"
    path = followed(tmp_path / "a.csv", "0,0.5,-10", f"5,{mark},-10", "10,0.4,-10")
    assert refusal(path).startswith(f"target.tip_columns.0: x {said}")
    if abs(float(mark)) < 1e3:
        line = refusal(moved(csv(f"time (s),heave (m)\n0,0\n5,{mark}\n20,0.1\n")))
        assert line.startswith(f"base.motion.0.value_column: heave {said}")


@pytest.mark.parametrize("mark", ["-999", "-9999", "-32768"])
def test_numbers_that_mark_missing_values_are_refused_in_currents_in_small_units(csv, mark):
    lines = (HEADER + rows()).replace("u (m/s)", "u (mm/s)").splitlines(keepends=True)
    assert recorded(measured(csv("".join(lines)))).time.size == TIME.size
    lines[5] = f"2.0,{mark},0.01\n"
    line = refusal(measured(csv("".join(lines))))
    assert line.startswith(f"flow.0.velocity.0: u contains {mark}, far from its other numbers")


def test_numbers_of_nines_among_their_like_are_numbers(tmp_path):
    case = followed(tmp_path / "a.csv", "0,500,-10000", "5,400,-9999", "9,400,-9900", units="mm")
    np.testing.assert_allclose(read_path(case).values[:, 1], [-10, -9.999, -9.9])


def test_the_part_of_a_series_that_a_run_meets(tmp_path):
    path = [f"{time},0.5,-10" for time in (-9, -4, 3, 18, 24, 40)]
    series = read_path(followed(tmp_path / "a.csv", *path))
    assert series.during(20.0)[0].tolist() == [-4, 3, 18, 24]
    assert series.during(18.0)[0].tolist() == [-4, 3, 18]


def test_a_home_that_nobody_has_is_a_file_that_is_not_there(tmp_path):
    (tmp_path / "a.toml").write_text('[target]\npath = "file"\nfile = "~nobody-has-this/x.csv"\n')
    assert refusal(load(tmp_path / "a.toml")).endswith("~nobody-has-this/x.csv: no such file")


# --- files that would hurt -----------------------------------------------------------------------


def record(path, change=None, *, dimensions=("time",), file_format="NETCDF4"):
    """Write a small sound record, then change something in it."""
    with netCDF4.Dataset(path, "w", format=file_format) as stored:
        stored.createDimension("time", 100)
        time = stored.createVariable("time", "f8", ("time",))
        time.units, time[:] = "s", np.arange(100) * 0.5
        for name in "uw":
            velocity = stored.createVariable(name, "f8", dimensions)
            velocity.units, velocity[:] = "m/s", 0.3
        if change is not None:
            change(stored)


@pytest.mark.parametrize("coordinate", ["time", "sample"])
def test_a_small_file_that_declares_a_huge_record_is_refused_at_once(tmp_path, coordinate):
    path, chunks = tmp_path / "a.nc", {"zlib": True, "chunksizes": (1_000_000,)}
    with netCDF4.Dataset(path, "w") as stored:
        stored.createDimension(coordinate, 3_000_000_000)
        for name, units in (("time", "s"), ("u", "m/s")):
            stored.createVariable(name, "f8", (coordinate,), **chunks).units = units
    assert path.stat().st_size < 10_000
    line = refusal(measured(path, velocity=["u", "0"]))
    assert line.startswith("flow.0.file: a.nc contains 3000000000 values of t")


def test_a_variable_in_huge_pieces_is_refused(tmp_path):
    def grow(stored):
        stored.createDimension("place", 400_000_000)
        chunks = {"zlib": True, "chunksizes": (1, 400_000_000)}
        stored.createVariable("v", "f4", ("time", "place"), **chunks).units = "m/s"

    record(tmp_path / "a.nc", grow)
    case = measured(tmp_path / "a.nc", velocity=["v", "0"], select={"place": 3})
    assert (
        refusal(case)
        == "flow.0.file: v is stored in chunks of 1.49 GB; must be stored in chunks of at most 1 GB"
    )


@pytest.mark.parametrize("name", ["pipe.csv", "pipe.nc", "/dev/zero"])
def test_what_is_no_regular_file_is_refused_and_not_waited_for(tmp_path, name):
    path = tmp_path / name
    if not path.exists():
        os.mkfifo(path)
    line = refusal(measured(path))
    assert line == f"flow.0.file: {path.name} is no regular file; must be a CSV or netCDF file"


def attribute(variable, **values):
    return lambda stored: [stored[variable].setncattr(*item) for item in values.items()]


def times(values):
    def change(stored):
        stored["time"][:] = values

    return change


ODD = {
    "steps of 1e300 s": (times(1e300 * np.arange(100)), "time: time has steps of 1e+300"),
    "steps of nothing": (times(1e-300 * np.arange(100)), "time: time has steps of 1e-300"),
    "an infinite time": (times([*range(99), np.inf]), "time: time has a missing"),
    "a scale of words": (attribute("u", scale_factor="abc"), "file: u cannot be read"),
    "a scale of the time": (attribute("time", scale_factor="abc"), "file: a.nc is broken"),
    "several scales": (attribute("u", scale_factor=np.arange(3.0)), "file: a.nc is broken"),
    "a scale that is huge": (attribute("u", scale_factor=1e308), "velocity.0: u reaches"),
    "units of numbers": (attribute("u", units=3), 'velocity.0: u is in "3"; must be in a unit'),
    "coordinates of numbers": (attribute("u", coordinates=5), "file: a.nc is broken"),
    "another type": (attribute("u", dtype="bool"), "velocity.0: u contains no numbers"),
}


@pytest.mark.parametrize(("change", "line"), ODD.values(), ids=ODD.keys())
def test_odd_times_and_attributes_are_refused_in_one_line(tmp_path, change, line):
    record(tmp_path / "a.nc", change)
    assert refusal(measured(tmp_path / "a.nc")).startswith(f"flow.0.{line}")


@pytest.mark.filterwarnings("ignore:Duplicate dimension names")
def test_a_variable_that_runs_twice_over_time_is_refused(tmp_path):
    record(tmp_path / "a.nc", dimensions=("time", "time"))
    line = refusal(measured(tmp_path / "a.nc"))
    assert line == "flow.0.velocity.0: u has dimensions time, time; must have each dimension once"


@pytest.mark.slow
@pytest.mark.parametrize("file_format", ["NETCDF4", "NETCDF3_CLASSIC"])
def test_files_cut_short_or_with_bytes_changed_are_read_or_refused_in_one_line(
    tmp_path, file_format
):
    path, rng = tmp_path / "a.nc", random.Random(3)
    record(path, file_format=file_format)
    sound, refused = path.read_bytes(), 0
    for number in range(40):
        damaged = bytearray(sound)
        if number % 4 == 0:
            del damaged[rng.randrange(len(damaged)) :]
        for _ in range(number % 4 * 5):
            damaged[rng.randrange(rng.choice([300, len(sound)]))] = rng.randrange(256)
        path.write_bytes(damaged)
        try:
            Prepared(measured(path)).notes()
        except ScenarioError as error:
            (line,) = error.lines
            assert line.startswith("flow.0.")
            refused += 1
    assert refused > 10
