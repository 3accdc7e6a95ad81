"""Measured currents with legal but rare attributes, and slips of people's spreadsheets."""

import netCDF4
import numpy as np
import pytest

from crinoid.recording import propose, read_dataset
from crinoid.scenario import ScenarioError
from helpers.styles import (
    COUNT,
    DEPTHS,
    DOWN,
    EAST,
    EAST_NORTH,
    M_PER_S,
    NORTH,
    PROFILE,
    SINCE_1970,
    Played,
    Refused,
    Z,
    by_keys,
    by_proposal,
    check_keys,
    check_proposal,
    clock,
    dates,
    over,
    since,
    store,
    straight,
    with_gap,
)

BOTH = "time", "depth"
EAST_PART, NORTH_PART = over(straight, Z)
GAP = {"gaps": ((1, 2),)}
GOOD = np.ones((COUNT, 3), "i1")


# --- netCDF --------------------------------------------------------------------------------------


def profile(level=None, **more):
    """Return what writes a profile, with other variables added or in place of its own."""

    def write(folder):
        name, depth = level or ("depth", (("depth",), DEPTHS, DOWN))
        both = ("time", depth[0][0])
        variables = {
            "time": clock(),
            name: depth,
            "u": (both, EAST_PART, EAST),
            "v": (both, NORTH_PART, NORTH),
        }
        return store(folder / "odd.nc", variables | more)

    return write


def point(**more):
    """Return what writes a record at one point, with other variables."""

    def write(folder):
        east, north = (each[:, 0] for each in over(straight))
        variables = {"time": clock(), "u": (("time",), east, EAST), "v": (("time",), north, NORTH)}
        return store(folder / "odd.nc", variables | more)

    return write


def unsigned(mark, **attributes):
    """Return what writes unsigned numbers of 16 bits, as netCDF-3 stores them, with an offset."""
    packed = {"_Unsigned": "true", "scale_factor": 0.001, "add_offset": -5.0} | attributes
    parts = [np.rint((each + 5.0) / 0.001).astype("u2") for each in (EAST_PART, NORTH_PART)]
    east, north = (with_gap(each, 1, 2, mark).view("i2") for each in parts)
    return profile(u=(BOTH, east, EAST | packed), v=(BOTH, north, NORTH | packed))


def flagged(name, flags, **attributes):
    """Return what writes a spike toward the east and flags that call it bad."""
    east = EAST | {"ancillary_variables": name}
    spike = with_gap(EAST_PART, 1, 2, 1.9)
    return profile(u=(BOTH, spike, east), **{name: (BOTH, flags, attributes)})


def big_endian(folder):
    """Flat rows of a profile with the most significant byte first."""
    rows = {
        "time": (("row",), np.repeat(since("1970-01-01", "s"), 3), SINCE_1970),
        "depth": (("row",), np.tile(DEPTHS, COUNT), DOWN),
        "u": (("row",), EAST_PART.ravel(), EAST),
        "v": (("row",), NORTH_PART.ravel(), NORTH),
    }
    path = folder / "rows.nc"
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("row", 3 * COUNT)
        for name, (dimensions, values, attributes) in rows.items():
            variable = file.createVariable(name, ">f8", dimensions, endian="big")
            variable.setncatts(attributes)
            variable[:] = values
    return path


def one_station(folder):
    """A record whose times have a dimension of one station."""
    east, north = (each.T for each in over(straight))
    both = "station", "obs"
    variables = {
        "time": (both, since("1970-01-01", "s")[None], SINCE_1970),
        "u": (both, east, EAST),
        "v": (both, north, NORTH),
    }
    return store(folder / "station.nc", variables)


SENSOR = (("time",), np.array([18.0, 18.0, 18.1, 18.0]), DOWN)
CELLS = "bin_depth", (("bin",), DEPTHS, {"units": "m", "long_name": "centre of the cell"})
HEIGHTS = np.array([18.0, 15.0, 10.5])
SPREAD = {"cell_methods": "time: standard_deviation"}
DAYS = np.float32(since("1858-11-17", "D"))
BY_SPEED = {"speed": "speed", "direction": "dir", "heading_deg": 90.0}


def compass(directions):
    size = (("time",), np.full(COUNT, 0.4), M_PER_S)

    def write(folder):
        turn = (("time",), np.array(directions), {"units": "degrees"})
        return store(folder / "odd.nc", {"time": clock(), "speed": size, "dir": turn})

    return write


NETCDF = {
    "unsigned with an offset": Played(unsigned(65535, _FillValue=np.int16(-1)), PROFILE, Z, **GAP),
    "unsigned with a packed range": Played(
        unsigned(65000, valid_range=np.array([0, 10000], "i2")), PROFILE, Z, **GAP
    ),
    "a packed range of wider whole numbers": Played(
        unsigned(65000, valid_max=np.int32(10000)), PROFILE, Z, **GAP
    ),
    "a range that is a text": Played(profile(u=(BOTH, EAST_PART, EAST | {"valid_range": "-3, 3"})),
                                     PROFILE, Z),
    "flags as bits": Played(
        flagged(
            "u_QC",
            with_gap(0 * GOOD, 1, 2, 6),
            flag_masks=np.array([1, 2, 4], "i1"),
            flag_meanings="not_tested spike_fail suspect",
        ),
        PROFILE,
        Z,
        **GAP,
    ),
    "values of flags as a text": Played(
        flagged(
            "quality",
            with_gap(GOOD, 1, 2, 3),
            flag_values="1b, 2b, 3b",
            flag_meanings="good unknown bad",
        ),
        PROFILE,
        Z,
        **GAP,
    ),
    "flags as words": Played(
        flagged("u_flag", with_gap(np.full((COUNT, 3), "good"), 1, 2, "Bad")), PROFILE, Z, **GAP
    ),
    "cells beside the depth of the sensor": Played(
        profile(CELLS, depth=SENSOR), EAST_NORTH | {"vertical": "bin_depth"}, Z
    ),
    "ranges beside the depth of the sensor": Played(
        profile(("range", (("range",), HEIGHTS, {"units": "m"})), depth=SENSOR),
        EAST_NORTH | {"vertical": "range"},
        Z,
    ),
    "heights above the bed": Played(
        profile(("hab", (("hab",), HEIGHTS, {"units": "m"}))), EAST_NORTH | {"vertical": "hab"}, Z
    ),
    "levels of no direction": Played(
        profile(("z", (("z",), HEIGHTS, {"units": "m"}))),
        EAST_NORTH | {"vertical": "z"},
        Z,
        remark="z .*above the bed.*origin",
    ),
    "rows with the most significant byte first": Played(big_endian, PROFILE, Z),
    "south": Played(
        point(v=(("time",), -over(straight)[1][:, 0],
                 {"standard_name": "southward_sea_water_velocity"} | M_PER_S)),
        EAST_NORTH | {"velocity": ["u", "-v", "0"]},
    ),
    "deviations of the same name": Played(
        point(us=(("time",), np.full(COUNT, 0.01), EAST | SPREAD)), EAST_NORTH
    ),
    "times with bounds": Played(
        point(time=(*clock()[:2], SINCE_1970 | {"bounds": "tb"}),
              tb=(("time", "nv"), np.zeros((COUNT, 2)), SINCE_1970)),
        EAST_NORTH,
    ),
    "times of one station": Played(one_station, EAST_NORTH),
    "times in single precision": Refused(
        point(time=(("time",), DAYS, {"units": "days since 1858-11-17"})), "double precision"
    ),
    "a direction that is a mark": Refused(compass([60, 60, 999, 60]), "999 degrees.*360", BY_SPEED),
}  # fmt: skip


@pytest.mark.parametrize("style", by_keys(NETCDF))
def test_odd_netcdf_is_played_or_refused(tmp_path, style):
    check_keys(style, tmp_path)


@pytest.mark.parametrize("style", by_proposal(NETCDF))
def test_the_keys_of_odd_netcdf_are_proposed(tmp_path, style):
    check_proposal(style, tmp_path)


def test_a_wind_is_no_current(tmp_path):
    wind = {"units": "m/s", "standard_name": "eastward_wind"}
    path = point(u=(("time",), np.ones(COUNT), wind))(tmp_path)
    with read_dataset(str(path)) as dataset, pytest.raises(ScenarioError, match="velocity"):
        propose(dataset, str(path))


@pytest.mark.parametrize("attributes", [
    {"standard_name": "downward_sea_water_velocity"}, {"positive": "down"},
    {"long_name": "vertical velocity, positive down"},
])  # fmt: skip
def test_a_downward_component_is_reversed(tmp_path, attributes):
    path = point(w=(("time",), np.full(COUNT, 0.1), M_PER_S | attributes))(tmp_path)
    with read_dataset(str(path)) as dataset:
        assert propose(dataset, str(path))["velocity"] == ["u", "v", "-w"]


# --- text ----------------------------------------------------------------------------------------

ISO = tuple(dates("%Y-%m-%dT%H:%M:%SZ"))


def table(
    head="time,u (m/s),v (m/s)", row="{0},{1:.3f},{2:.3f}", times=ISO, change=("", ""), scale=1.0
):
    """Return what writes a record at one point, in a form of row, with one text changed."""

    def write(folder):
        east, north = (scale * each[:, 0] for each in over(straight))
        rows = [row.format(*each) for each in zip(times, east, north, strict=True)]
        path = folder / "odd.csv"
        path.write_text("\n".join([head, *rows, ""]).replace(*change))
        return path

    return write


def rows(name):
    """Return what writes flat rows of a profile, with a name of the depth."""

    def write(folder):
        lines = [f"time,{name} (m),u (m/s),v (m/s)"]
        for k, time in enumerate(ISO):
            for i, depth in enumerate(DEPTHS):
                lines.append(f"{time},{depth},{EAST_PART[k, i]:.3f},{NORTH_PART[k, i]:.3f}")
        (folder / "odd.csv").write_text("\n".join(lines))
        return folder / "odd.csv"

    return write


def mark(text):
    return table(change=("0.420", text))


TEXT = {
    "names of depths": Played(rows("Bin Depth"), EAST_NORTH | {"vertical": "Bin Depth"}, Z),
    "levels in rows without a usual name": Refused(rows("Tiefe"), "time repeats.*vertical"),
    "a name in quotes after a blank": Played(table('"time", "u (m/s)", "v (m/s)"'), EAST_NORTH),
    "time zones": Played(table(times=[each[:-1] + "+02:00" for each in ISO]), EAST_NORTH),
    "words of quality": Played(
        table("time,u (m/s),v (m/s),u_flag", "{0},{1:.3f},{2:.3f},good",
              change=("0.420,-0.090,good", "1.9,-0.090,bad")),
        EAST_NORTH,
        gaps=((1, 0),),
    ),
    "a # in a cell": Refused(table("site,time,u,v", "No #3,{0},{1},{2}"), "# before.*line 2"),
    "an error of a spreadsheet": Refused(mark("#N/A"), "# before.*line 3.*empty"),
    "pixels of a picture": Refused(table("time,u (px/s),v (px/s)"), "px/s.*m/s"),
    "dates in digits": Refused(table(times=[20240301 + k for k in range(4)]), "date.*ISO"),
    "instants in digits": Refused(table(times=dates("%Y%m%d%H%M")), "date.*ISO"),
    "a mark in cm/s": Refused(
        table("time,u (cm/s),v (cm/s)", scale=100, change=("42.000", "-99.9")), "-99.9.*missing"
    ),
    "a scaled end of 16 bits": Refused(mark("-32.768"), "-32.768.*missing"),
    "a row without a date": Refused(table(change=(ISO[2], "")), "empty cell in row 3"),
    "a date without a time of day": Refused(
        table("time;u;v", "{0};{1:.2f};{2:.2f}", dates("%d.%m.%Y %H:%M"), (" 06:00", "")),
        "row 2; must contain increasing numbers or ISO dates",
    ),
    "lines above the names": Refused(
        table("Site: M1, north\ntime,u,v"), "longer rows.*mark .* by #"
    ),
}  # fmt: skip


@pytest.mark.parametrize("style", by_keys(TEXT))
def test_odd_text_is_played_or_refused(tmp_path, style):
    check_keys(style, tmp_path)


@pytest.mark.parametrize("style", by_proposal(TEXT))
def test_the_keys_of_odd_text_are_proposed(tmp_path, style):
    check_proposal(style, tmp_path)


def test_a_count_is_no_velocity(tmp_path):
    path = table("time,u (m/s),w (m/s),n", "{0},{1:.3f},{2:.3f},3")(tmp_path)
    with read_dataset(str(path)) as dataset:
        assert propose(dataset, str(path))["velocity"] == ["u", "w"]
