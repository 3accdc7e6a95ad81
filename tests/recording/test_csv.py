"""Files of columns: CSV as people write it, paths and motions from files."""

import random
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.scenario import Scenario, load
from helpers.measured import measured, recorded
from helpers.paths import ROOT

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
    "units of a server": 'time[unit="s"],u[unit="m/s"],w[unit="m/s"]\n' + rows(),
    "a minus of typesetters": "time (s),u (m s\N{MINUS SIGN}1),w (m s\N{MINUS SIGN}1)\n"
    + rows().replace("-", "\N{MINUS SIGN}"),
    "OpenFAST": "\nMade on 1-Mar-2024, by OpenFAST\n\nof a file: test\n\nTime\tu\tw\n(s)\t(m/s)"
    + "\t(m/s)\n" + rows().replace(",", "\t"),
    "Time for time": HEADER.replace("time", "Time") + rows(),
    "rostopic": "%" + HEADER.replace("[s]", "(ns)")
    + rows(times=[f"{1_700_000_000_000_000_000 + int(1e9 * time)}" for time in TIME]),
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


ROWS = [f"{k / 10},{0.2 * np.sin(2 * np.pi * k / 80):.4f},-10\n" for k in range(250)]


@pytest.mark.parametrize("kind", ["motion", "path"])
def test_rows_that_are_absent_are_said(csv, kind):
    path = csv("time (s),x (m),z (m)\n" + "".join(ROWS[:60] + ROWS[120:]))
    target = Scenario(target={"path": "file", "file": str(path)})
    case = moved(path, value_column="x") if kind == "motion" else target
    (note,) = Prepared(case).notes()
    text = "60 rows are absent at the usual interval of 0.1 s, the longest gap 6.1 s, from 5.9 s on"
    assert note.endswith(text)
    # points at uneven times have no usual interval
    path.write_text("time (s),x (m),z (m)\n0,0,-10\n1,0,-10\n5,0,-10\n20,0,-10\n")
    assert Prepared(case).notes() == []


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


def followed(path, *rows, units="m", **keys):
    """Return the scenario of a path of 20 s."""
    path.write_text(f"time (s),x ({units}),z ({units})\n" + "".join(f"{row}\n" for row in rows))
    return Scenario(target={"path": "file", "file": str(path), **keys})


def test_a_path_begins_at_its_first_time_less_the_skip(tmp_path):
    stamps = ("1709272800,0.5,-10", "1709272810,0.4,-10")
    case = followed(tmp_path / "a.csv", *stamps, skip=1709272800.0)
    np.testing.assert_array_equal(read_path(case).time, [0, 10])
    late = followed(tmp_path / "a.csv", "19,0.5,-10", "25,0.4,-10")
    np.testing.assert_array_equal(read_path(late).time, [19, 25])


def test_numbers_of_nines_among_their_like_are_numbers(tmp_path):
    case = followed(tmp_path / "a.csv", "0,500,-10000", "5,400,-9999", "9,400,-9900", units="mm")
    np.testing.assert_allclose(read_path(case).values[:, 1], [-10, -9.999, -9.9])
