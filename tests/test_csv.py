"""Files of columns: CSV as people write it, paths and motions from files, files that would hurt."""

import os
import random
import re
from pathlib import Path

import jax.numpy as jnp
import netCDF4
import numpy as np
import pytest
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.scenario import Scenario, ScenarioError, load

TIME = np.arange(80) * 0.5
U, W = 0.4 + 0.1 * np.sin(TIME), 0.05 * np.cos(TIME)
HEADER = "time [s],u (m/s),w (m/s)\n"
DATES = np.datetime64("2024-03-01T06:00") + (1000 * TIME).astype("timedelta64[ms]")


def rows(separator=",", decimal=".", end="\n", times=None):
    """Return the lines of a record; twelve digits keep round-off out of comparisons."""
    first = [f"{value:.3f}".replace(".", decimal) for value in TIME] if times is None else times
    numbers = ([f"{value:.12f}".replace(".", decimal) for value in series] for series in (U, W))
    return "".join(separator.join(row) + end for row in zip(first, *numbers, strict=True))


def scenario(path, **keys):
    flow = {"kind": "measured", "file": str(path), "velocity": ["u", "w"], **keys}
    return Scenario(water={"depth": 20.0}, flow=[flow], simulation={"duration": 10.0})


def refusal(case):
    with pytest.raises(ScenarioError) as caught:
        Prepared(case).notes()
    (line,) = caught.value.lines
    assert "\n" not in line
    return line


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
}  # fmt: skip


@pytest.mark.parametrize("text", SPOKEN.values(), ids=SPOKEN.keys())
def test_a_record_is_read_however_it_is_written(tmp_path, text):
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode())
    case = scenario(path)
    (recording,) = Prepared(case).recordings.values()
    np.testing.assert_allclose(recording.time, TIME, atol=1e-9)
    np.testing.assert_allclose(recording.velocity[:, 0], np.stack([U, W], axis=1), atol=1e-11)
    assert Prepared(case).notes() == []


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252", "utf-8-sig"])
def test_a_record_may_be_in_any_of_the_usual_encodings(tmp_path, encoding):
    text = f"# 20 \N{DEGREE SIGN}C\n{HEADER}{rows()}"
    (tmp_path / "a.txt").write_bytes(text.encode(encoding))
    (recording,) = Prepared(scenario(tmp_path / "a.txt")).recordings.values()
    np.testing.assert_allclose(recording.velocity[:, 0, 0], U, atol=1e-11)


def test_a_csv_file_is_the_netcdf_file_of_the_same_numbers(tmp_path):
    (tmp_path / "a.csv").write_text("time [ms],u (cm/s),w\n" + rows(times=map(str, 1e3 * TIME)))
    names = {"u": (U, {"units": "cm/s"}), "w": (W, {})}
    variables = {name: ("time", np.round(v, 12), units) for name, (v, units) in names.items()}
    time = ("time", 1e3 * TIME, {"units": "ms"})
    xr.Dataset(variables, {"time": time}).to_netcdf(tmp_path / "a.nc")
    cases = [scenario(tmp_path / name, velocity_scale=3.0) for name in ("a.csv", "a.nc")]
    one, other = (Prepared(case).recordings[0] for case in cases)
    np.testing.assert_array_equal(one.velocity, other.velocity)
    np.testing.assert_array_equal(one.time, other.time)
    assert Prepared(cases[0]).notes() == Prepared(cases[1]).notes()
    assert Prepared(cases[0]).notes()[0] == "flow.0: w names no unit and is taken to be in m/s"


def test_cells_that_are_missing_are_filled_and_said(tmp_path):
    lines = (HEADER + rows()).splitlines()
    for row, word in ((10, ""), (11, "NaN"), (30, "n/a"), (31, "-")):
        time, _, w = lines[row + 1].split(",")
        lines[row + 1] = f"{time},{word},{w}"
    (tmp_path / "a.csv").write_text("\n".join(lines))
    assert Prepared(scenario(tmp_path / "a.csv")).notes() == [
        "flow.0: 5.00% of u is missing and was filled by straight lines, the longest gap 1.5 s"
    ]


def test_a_profile_has_a_row_for_each_time_and_level_in_any_order(tmp_path):
    levels = np.array([0.5, 1.0, 2.0])
    lines = [
        f"{time},{level},{u + 0.1 * level},{w}\n"
        for time, u, w in zip(TIME, U, W, strict=True)
        for level in levels
    ]
    random.Random(0).shuffle(lines)
    head = "time (s),z (m),u (m/s),w (m/s)\n"
    (tmp_path / "a.csv").write_text(head + "".join(lines))
    case = scenario(tmp_path / "a.csv", vertical="z", origin=-20.0)
    (recording,) = Prepared(case).recordings.values()
    np.testing.assert_allclose(recording.levels, levels - 20.0)
    np.testing.assert_allclose(recording.velocity[..., 0], U[:, None] + 0.1 * levels)
    again = scenario(tmp_path / "b.csv", vertical="z", origin=-20.0)
    (tmp_path / "b.csv").write_text(head + "".join([*lines, lines[0]]))
    assert "stand in two rows, takes one row for each time and level" in refusal(again)


def test_the_record_of_the_page_is_played_as_the_page_says(tmp_path):
    page = Path(__file__).resolve().parents[1].joinpath("docs", "currents.md").read_text("utf-8")
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
    np.testing.assert_allclose(
        Prepared(case).recordings[0].velocity[:3, 0],
        [[0.21, 0.012], [0.235, 0.008], [0.221, 0.0015]],
    )
    (tmp_path / "a.csv").write_text(levels)
    case = scenario(tmp_path / "a.csv", vertical="z", origin=-20.0)
    case = case.with_values({"simulation.duration": 1.0})
    np.testing.assert_allclose(
        Prepared(case).recordings[0].velocity[1], [[0.30, 0.01], [0.36, 0.0]]
    )


BAD = {
    "no header": (rows(), "file: a.csv begins with numbers, takes a first line of names such as"),
    "nothing": ("", "file: a.csv holds no rows, takes a header and rows of numbers"),
    "comments": ("# none\n", "file: a.csv holds no rows, takes a header and rows of numbers"),
    "a header only": (HEADER, "time: time holds 0 instants, takes 2 or more"),
    "no text": ("\0\1\2", "file: a.csv is no text, takes a CSV or netCDF file"),
    "a row too long": (
        HEADER + rows() + "40.5,1,2,3\n",
        "file: a.csv has 4 values in line 82, takes 3 as in its header",
    ),
    "rows too long": (HEADER + rows(end=",1\n"), "file: a.csv has rows of more values than the 3"),
    "a name twice": ("time,u,u\n" + rows(), "file: a.csv has several columns u, takes each name"),
    "words": (
        (HEADER + rows()).replace(f"{W[2]:.12f}", "calm"),
        'velocity.1: w holds what is no number ("calm" in row 3), takes a velocity',
    ),
    "times of the day": (
        HEADER + rows(times=[f"06:00:{index:02}" for index in range(80)]),
        'time: time holds what is no number ("06:00:00" in row 1), takes numbers that increase, or '
        "ISO dates",
    ),
    "dates of no order": (
        HEADER + rows(times=[*map(str, DATES[:40]), *["1.3.2024 06:00"] * 40]),
        'time: time holds what is no number ("1.3.2024 06:00" in row 41)',
    ),
    "a time that is missing": (
        (HEADER + rows()).replace("\n0.500,", "\n,"),
        "time: time has an entry that is missing or infinite, takes numbers that increase",
    ),
    "times that repeat": (
        (HEADER + rows()).replace("\n0.500,", "\n0.000,"),
        "time: time repeats at entry 1, takes times that increase",
    ),
    "times that go back": (
        (HEADER + rows()).replace("\n20.000,", "\n7.000,"),
        "time: time goes back at entry 40, takes times that increase",
    ),
    "another unit": (
        (HEADER + rows()).replace("u (m/s)", "u (knots)"),
        'velocity.0: u is in "knots", takes a unit such as m/s',
    ),
    "no such column": (
        "time (s),east,w\n" + rows(),
        'velocity.0: got "u", no such column in a.csv; it holds time, east, w',
    ),
    "missing values that are not marked": (
        (HEADER + rows()).replace(f"{U[5]:.12f}", "-9999"),
        "velocity.0: u reaches 9999 m/s, takes up to 50; missing values take a _FillValue",
    ),
}


@pytest.mark.parametrize(("text", "line"), BAD.values(), ids=BAD.keys())
def test_a_csv_file_that_does_not_fit_is_refused_in_one_line(tmp_path, text, line):
    (tmp_path / "a.csv").write_text(text)
    assert refusal(scenario(tmp_path / "a.csv")).startswith(f"flow.0.{line}")


def test_a_csv_file_that_is_too_large_is_refused_before_it_is_read(tmp_path, monkeypatch):
    (tmp_path / "a.csv").write_text(HEADER + rows())
    monkeypatch.setattr("crinoid.recording.table._MAX_BYTES", 1000)
    assert "takes up to 0 MB of CSV" in refusal(scenario(tmp_path / "a.csv"))


# --- motions and paths ---------------------------------------------------------------------------

HEAVE = "time (s),heave (cm),tilt (deg)\n0,0,0\n10,20,-90\n20,-10,45\n"


def moved(path, channel="heave", **keys):
    motion = {"kind": "file", "channel": channel, "file": str(path), **keys}
    return Scenario(base={"motion": [motion]}, simulation={"duration": 20.0})


def test_a_motion_comes_from_a_file_in_its_units(tmp_path):
    (tmp_path / "a.csv").write_text(HEAVE)
    heave = Prepared(moved(tmp_path / "a.csv")).series["base.motion.0"]
    np.testing.assert_allclose(heave.time, [0, 10, 20])
    np.testing.assert_allclose(heave.values, [[0], [0.2], [-0.1]])
    tilt = Prepared(moved(tmp_path / "a.csv", "tilt")).series["base.motion.0"]
    np.testing.assert_allclose(tilt.values, np.deg2rad([[0], [-90], [45]]))
    plain = "time,heave,tilt\n" + HEAVE.partition("\n")[2]
    (tmp_path / "b.csv").write_text(plain)
    case = moved(tmp_path / "b.csv", "tilt")
    np.testing.assert_allclose(Prepared(case).series["base.motion.0"].values, tilt.values)
    assert Prepared(case).notes() == [
        "base.motion.0: time names no unit and is taken to be in seconds",
        "base.motion.0: tilt names no unit and is taken to be in degrees",
    ]


def test_dates_count_from_the_first_and_numbers_are_times_of_the_run(tmp_path):
    table = {"2024-03-01T06:00": 0, "2024-03-01T06:00:10": 20, "2024-03-01T06:00:30": 5}
    text = "when,heave (cm)\n" + "".join(f"{date},{cm}\n" for date, cm in table.items())
    (tmp_path / "a.csv").write_text(text)
    found = Prepared(moved(tmp_path / "a.csv", time_column="when")).series["base.motion.0"]
    np.testing.assert_allclose(found.time, [0, 10, 30])
    (tmp_path / "a.csv").write_text("time (s),heave (m)\n-5,0\n3,1\n40,2\n")
    found = Prepared(moved(tmp_path / "a.csv", skip=2.0)).series["base.motion.0"]
    np.testing.assert_allclose(found.time, [-7, 1, 38])


def test_rows_that_lack_a_value_are_left_out_and_said(tmp_path):
    (tmp_path / "a.csv").write_text("time (s),heave (m)\n0,0\n4,\n6,1\n20,2\n")
    case = moved(tmp_path / "a.csv")
    np.testing.assert_allclose(Prepared(case).series["base.motion.0"].time, [0, 6, 20])
    assert Prepared(case).notes() == [
        "base.motion.0: 1 of 4 rows lacks a value and is left out, the longest gap 14 s"
    ]


def test_a_heading_that_wraps_goes_on_by_the_shorter_way(tmp_path):
    (tmp_path / "a.csv").write_text("time (s),tilt (deg)\n0,350\n5,\n8,355\n10,5\n15,356\n20,181\n")
    case = Prepared(moved(tmp_path / "a.csv", "tilt"))
    turn = np.rad2deg(case.series["base.motion.0"].values[:, 0])
    np.testing.assert_allclose(turn, [350, 355, 365, 356, 181])
    assert case.notes()[1] == (
        "base.motion.0: tilt jumps by more than 180 degrees between two rows, first at 10 s: the "
        "turn goes on by the shorter way round"
    )
    (motion,) = case.system.base.motions
    speed = [float(motion.derivatives(jnp.asarray(time))[1]) for time in np.linspace(0, 20, 81)]
    assert np.abs(np.rad2deg(speed)).max() < 60
    (tmp_path / "a.csv").write_text("time (s),x (m),z (m),angle (deg)\n0,0,0,170\n5,0,0,-170\n")
    target = {"path": "file", "file": str(tmp_path / "a.csv"), "angle_column": "angle"}
    series = Prepared(Scenario(target=target)).series["target"]
    np.testing.assert_allclose(np.rad2deg(series.values[:, 2]), [170, 190])


MOTIONS = {
    "too short": (
        "time (s),heave (m)\n0,0\n12,1\n",
        {},
        "time_column: ends at 12 s of the run, takes simulation.duration = 20.0 or later",
    ),
    "too late": (
        "time (s),heave (m)\n1,0\n22,1\n",
        {},
        "time_column: begins at 1 s of the run, takes 0 or before",
    ),
    "another unit": (HEAVE, {"value_column": "tilt"}, 'value_column: tilt is in "deg", takes a'),
    "no column": (
        HEAVE,
        {"value_column": "roll"},
        'value_column: got "roll", no such column in a.csv; it holds time, heave, tilt',
    ),
    "no time": (HEAVE, {"time_column": "t"}, 'time_column: got "t", no such column in a.csv'),
    "unmarked": (
        HEAVE.replace("-10", "-999999"),
        {},
        "value_column: heave reaches 999999, takes up to 1e+05; missing values take an empty cell",
    ),
    "all missing": (
        "time (s),heave (m)\n0,\n20,1\n",
        {},
        "file: a.csv has 1 row without a missing value, takes 2 or more",
    ),
}


@pytest.mark.parametrize(("text", "keys", "line"), MOTIONS.values(), ids=MOTIONS.keys())
def test_a_motion_that_does_not_fit_is_refused_in_one_line(tmp_path, text, keys, line):
    (tmp_path / "a.csv").write_text(text)
    assert refusal(moved(tmp_path / "a.csv", **keys)).startswith(f"base.motion.0.{line}")


def test_a_path_comes_from_a_csv_or_netcdf_file(tmp_path):
    text = "time (s);x (m);z (mm);angle (rad)\n0;0,5;-10000;0\n5;0,4;-9900;0,1\n"
    (tmp_path / "a.csv").write_text(text)
    target = {"path": "file", "file": str(tmp_path / "a.csv"), "angle_column": "angle"}
    series = Prepared(Scenario(target=target)).series["target"]
    np.testing.assert_allclose(series.values, [[0.5, -10.0, 0.0], [0.4, -9.9, 0.1]])
    names = ("x", "y", "z", "ex", "ey", "ez")
    values = dict(zip(names, np.arange(1.0, 13.0).reshape(6, 2), strict=True))
    xr.Dataset(
        {name: ("t", series, {"units": "m"} if len(name) == 1 else {}) for name, series
         in values.items()}, {"t": ("t", [0.0, 4.0], {"units": "s"})},
    ).to_netcdf(tmp_path / "a.nc")  # fmt: skip
    target = {"path": "file", "file": str(tmp_path / "a.nc"), "time_column": "t"}
    target["direction_columns"] = ["ex", "ey", "ez"]
    series = Prepared(Scenario(arm={"dimension": 3}, target=target)).series["target"]
    np.testing.assert_allclose(series.values[:, :3].T, [values[name] for name in "xyz"])
    given = np.array([values[name] for name in ("ex", "ey", "ez")]).T
    lengths = np.linalg.norm(given, axis=1, keepdims=True)
    np.testing.assert_allclose(series.values[:, 3:], given / lengths, rtol=1e-14)


def pointed(path, *rows):
    """Return the scenario of a path that stays and points as the rows say."""
    lines = [f"{5 * index},0.5,0,-10,{row}\n" for index, row in enumerate(rows)]
    path.write_text("time (s),x (m),y (m),z (m),ex,ey,ez\n" + "".join(lines))
    target = {"path": "file", "file": str(path), "direction_columns": ["ex", "ey", "ez"]}
    return Scenario(arm={"dimension": 3}, target=target)


def test_directions_of_any_length_are_those_of_unit_vectors(tmp_path):
    series = Prepared(pointed(tmp_path / "a.csv", "1e-300,0,1e-300", "0,1e12,0")).series["target"]
    exact = [[0.5**0.5, 0, 0.5**0.5], [0, 1, 0]]
    np.testing.assert_allclose(series.values[:, 3:], exact, rtol=1e-15)


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        (("1,0,0", "0,0,0"), "direction_columns: hold a vector that is 0, which has no direction"),
        (
            ("1,0,0", "0,1,0", "0,-3,0"),
            "direction_columns: turn to the opposite at 10 s of the run; take one more direction "
            "between",
        ),
        (("1,0,0", "1e20,0,0"), "direction_columns.0: ex reaches 1e+20, takes up to 1e+15"),
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
        "target.skip: got 0.0, with which the path begins at 1.70927e+09 s of a run of 20 s; takes "
        "the time of the file when the run begins (s)"
    )
    case = followed(tmp_path / "a.csv", *stamps, skip=1709272800.0)
    np.testing.assert_array_equal(Prepared(case).series["target"].time, [0, 10])
    late = followed(tmp_path / "a.csv", "19,0.5,-10", "25,0.4,-10")
    np.testing.assert_array_equal(Prepared(late).series["target"].time, [19, 25])


@pytest.mark.parametrize("mark", ["-999", "-9999", "999.9", "-999.99", "9999", "-9999.0"])
def test_numbers_that_mark_missing_values_are_refused_in_paths_and_motions(tmp_path, mark):
    said = f"holds {float(mark):g}, far from its other numbers"
    path = followed(tmp_path / "a.csv", "0,0.5,-10", f"5,{mark},-10", "10,0.4,-10")
    assert refusal(path).startswith(f"target.tip_columns.0: x {said}")
    if abs(float(mark)) < 1e3:
        (tmp_path / "b.csv").write_text(f"time (s),heave (m)\n0,0\n5,{mark}\n20,0.1\n")
        assert refusal(moved(tmp_path / "b.csv")).startswith(
            f"base.motion.0.value_column: heave {said}"
        )


@pytest.mark.parametrize("mark", ["-999", "-9999", "-32768"])
def test_numbers_that_mark_missing_values_are_refused_in_currents_in_small_units(tmp_path, mark):
    lines = (HEADER + rows()).replace("u (m/s)", "u (mm/s)").splitlines(keepends=True)
    (tmp_path / "a.csv").write_text("".join(lines))
    assert Prepared(scenario(tmp_path / "a.csv")).recordings[0].time.size == TIME.size
    lines[5] = f"2.0,{mark},0.01\n"
    (tmp_path / "a.csv").write_text("".join(lines))
    line = refusal(scenario(tmp_path / "a.csv"))
    assert line.startswith(f"flow.0.velocity.0: u holds {mark}, far from its other numbers")


def test_numbers_of_nines_among_their_like_are_numbers(tmp_path):
    case = followed(tmp_path / "a.csv", "0,500,-10000", "5,400,-9999", "9,400,-9900", units="mm")
    np.testing.assert_allclose(Prepared(case).series["target"].values[:, 1], [-10, -9.999, -9.9])


def test_the_part_of_a_series_that_a_run_meets(tmp_path):
    path = [f"{time},0.5,-10" for time in (-9, -4, 3, 18, 24, 40)]
    series = Prepared(followed(tmp_path / "a.csv", *path)).series["target"]
    assert series.during(20.0)[0].tolist() == [-4, 3, 18, 24]
    assert series.during(18.0)[0].tolist() == [-4, 3, 18]


def test_a_home_that_nobody_has_is_a_file_that_is_not_there(tmp_path):
    (tmp_path / "a.toml").write_text('[target]\npath = "file"\nfile = "~nobody-has-this/x.csv"\n')
    assert refusal(load(tmp_path / "a.toml")).endswith("~nobody-has-this/x.csv: no such file")


def test_files_of_motions_and_paths_start_from_the_scenario_and_come_along(tmp_path):
    (tmp_path / "deep").mkdir()
    text = (
        '[[base.motion]]\nkind = "file"\nchannel = "heave"\nfile = "heave.csv"\n'
        '[target]\npath = "file"\nfile = "path.csv"\n[vary]\n"target.file" = ["path.csv", "/b.csv"]'
    )
    (tmp_path / "deep" / "mine.toml").write_text(text)
    case = load(tmp_path / "deep" / "mine.toml")
    assert case.base.motion[0].file == str(tmp_path / "deep" / "heave.csv")
    assert case.target.file == str(tmp_path / "deep" / "path.csv")
    assert case.vary["target.file"] == [str(tmp_path / "deep" / "path.csv"), "/b.csv"]
    assert {line.split(":")[0] for line in _lines(case.cases()[0][1])} == {
        "base.motion.0.file",
        "target.file",
    }


def _lines(case):
    with pytest.raises(ScenarioError) as caught:
        Prepared(case).notes()
    return caught.value.lines


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
    line = refusal(scenario(path, velocity=["u", "0"]))
    assert line.startswith("flow.0.file: a.nc holds 3000000000 values of t")


def test_a_variable_in_huge_pieces_is_refused(tmp_path):
    def grow(stored):
        stored.createDimension("place", 400_000_000)
        chunks = {"zlib": True, "chunksizes": (1, 400_000_000)}
        stored.createVariable("v", "f4", ("time", "place"), **chunks).units = "m/s"

    record(tmp_path / "a.nc", grow)
    case = scenario(tmp_path / "a.nc", velocity=["v", "0"], select={"place": 3})
    assert refusal(case) == "flow.0.file: v is stored in pieces of 1.49 GB, takes up to 1 GB"


@pytest.mark.parametrize("name", ["pipe.csv", "pipe.nc", "/dev/zero"])
def test_what_is_no_regular_file_is_refused_and_not_waited_for(tmp_path, name):
    path = tmp_path / name
    if not path.exists():
        os.mkfifo(path)
    line = refusal(scenario(path))
    assert line == f"flow.0.file: {path.name} is no regular file, takes a CSV or netCDF file"


def attribute(variable, **values):
    return lambda stored: [stored[variable].setncattr(*item) for item in values.items()]


def times(values):
    def change(stored):
        stored["time"][:] = values

    return change


ODD = {
    "steps of 1e300 s": (times(1e300 * np.arange(100)), "time: time goes on in steps of 1e+300"),
    "steps of nothing": (times(1e-300 * np.arange(100)), "time: time goes on in steps of 1e-300"),
    "an infinite time": (times([*range(99), np.inf]), "time: time has an entry that is missing"),
    "a scale of words": (attribute("u", scale_factor="abc"), "file: u cannot be read"),
    "a scale of the time": (attribute("time", scale_factor="abc"), "file: a.nc is broken"),
    "several scales": (attribute("u", scale_factor=np.arange(3.0)), "file: a.nc is broken"),
    "a scale that is huge": (attribute("u", scale_factor=1e308), "velocity.0: u reaches"),
    "units of numbers": (attribute("u", units=3), 'velocity.0: u is in "3", takes a unit'),
    "coordinates of numbers": (attribute("u", coordinates=5), "file: a.nc is broken"),
    "another type": (attribute("u", dtype="bool"), "velocity.0: u holds what is no number"),
}


@pytest.mark.parametrize(("change", "line"), ODD.values(), ids=ODD.keys())
def test_odd_times_and_attributes_are_refused_in_one_line(tmp_path, change, line):
    record(tmp_path / "a.nc", change)
    assert refusal(scenario(tmp_path / "a.nc")).startswith(f"flow.0.{line}")


@pytest.mark.filterwarnings("ignore:Duplicate dimension names")
def test_a_variable_that_runs_twice_over_time_is_refused(tmp_path):
    record(tmp_path / "a.nc", dimensions=("time", "time"))
    line = refusal(scenario(tmp_path / "a.nc"))
    assert line == "flow.0.velocity.0: u runs over time, time, takes each dimension once"


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
            Prepared(scenario(path)).notes()
        except ScenarioError as error:
            (line,) = error.lines
            assert line.startswith("flow.0.")
            refused += 1
    assert refused > 10
