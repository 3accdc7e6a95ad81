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
    ISO,
    M_PER_S,
    NORTH,
    Played,
    Refused,
    Z,
    clock,
    dates,
    lines,
    over,
    put,
    since,
    speed_and_direction,
    store,
    straight,
    turning,
    with_gap,
)

BOTH = "time", "depth"
EAST_PART, NORTH_PART = over(straight, Z)
EAST_POINT, NORTH_POINT = (each[:, 0] for each in over(straight))
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
    parts = {"u": (("time",), EAST_POINT, EAST), "v": (("time",), NORTH_POINT, NORTH)}
    return lambda folder: store(folder / "odd.nc", {"time": clock()} | parts | more)


def levels(name, values, **attributes):
    """Return the name and the variable of levels with other attributes."""
    return name, ((name,), np.asarray(values), {"units": "m"} | attributes)


def spike(mark, **attributes):
    """Return what writes one east value as a mark, and attributes that say so."""
    return profile(u=(BOTH, with_gap(EAST_PART, 1, 2, mark), EAST | attributes))


def unsigned(mark, **attributes):
    """Return what writes unsigned numbers of 16 bits, as netCDF-3 stores them, with an offset."""
    packed = {"_Unsigned": "true", "scale_factor": 0.001, "add_offset": -5.0} | attributes
    parts = [np.rint((each + 5.0) / 0.001).astype("u2") for each in (EAST_PART, NORTH_PART)]
    east, north = (with_gap(each, 1, 2, mark).view("i2") for each in parts)
    return profile(u=(BOTH, east, EAST | packed), v=(BOTH, north, NORTH | packed))


def flagged(name, flags, bad, **attributes):
    """Return what writes a spike toward the east and a flag that calls it bad."""
    east = BOTH, with_gap(EAST_PART, 1, 2, 1.9), EAST | {"ancillary_variables": name}
    return profile(u=east, **{name: (BOTH, with_gap(flags, 1, 2, bad), attributes)})


def big_endian(folder):
    """Flat rows of a profile with the most significant byte first."""
    rows = {
        "time": (("row",), np.repeat(since("1970-01-01", "s"), 3), clock()[2]),
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
    both = "station", "obs"
    variables = {
        "time": (both, since("1970-01-01", "s")[None], clock()[2]),
        "u": (both, EAST_POINT[None], EAST),
        "v": (both, NORTH_POINT[None], NORTH),
    }
    return store(folder / "station.nc", variables)


def polar(way="to", directions=None, **attributes):
    """Return what writes a speed in cm/s and a direction."""
    speed, toward = (each[:, 0] for each in over(speed_and_direction))
    turned = (toward + (180.0 if way == "from" else 0.0)) % 360.0
    variables = {
        "time": clock(),
        "spd": (("time",), 100.0 * speed, {"units": "cm/s"}),
        "dir": (
            ("time",),
            turned if directions is None else np.array(directions),
            {"units": "degree"} | attributes,
        ),
    }
    return lambda folder: store(folder / "buoy.nc", variables)


def groups(folder):
    """All variables in a group, as a converter of Nortek stores each kind of data."""
    path = folder / "S101663A001.nc"
    with netCDF4.Dataset(path, "w") as file:
        put(file.createGroup("Data"), {"time": clock(), "u": (("time",), EAST_POINT, EAST)})
    return path


SENSOR = (("time",), np.array([18.0, 18.0, 18.1, 18.0]), DOWN)
HEIGHTS = np.array([18.0, 15.0, 10.5])
SPREAD = {"cell_methods": "time: standard_deviation"}
SOUTH = {"standard_name": "southward_sea_water_velocity"} | M_PER_S
QARTOD = "PASS NOT_EVALUATED SUSPECT FAIL MISSING"
DAYS = np.float32(since("1858-11-17", "D"))
BY_SPEED = {"speed": "spd", "direction": "dir", "heading_deg": 90.0}

MARKED = {
    "valid_min and valid_max": spike(9.9, valid_min=-3.0, valid_max=3.0),
    "missing_value alone": spike(-999.0, missing_value=-999.0),
    "unsigned with an offset": unsigned(65535, _FillValue=np.int16(-1)),
    "unsigned with a packed range": unsigned(65000, valid_range=np.array([0, 10000], "i2")),
    "a packed range of wider whole numbers": unsigned(65000, valid_max=np.int32(10000)),
    "QARTOD": flagged("u_qc_agg", with_gap(GOOD, 2, 0, 2), 4,
                      flag_values=np.array([1, 2, 3, 4, 9], "i1"), flag_meanings=QARTOD),
    "flags as characters": flagged("u_QC", np.full((COUNT, 3), b"1"), b"4",
                                   conventions="OceanSITES reference table 2"),
    "flags as bits": flagged("u_QC", 0 * GOOD, 6, flag_masks=np.array([1, 2, 4], "i1"),
                             flag_meanings="not_tested spike_fail suspect"),
    "values of flags as a text": flagged("quality", GOOD, 3, flag_values="1b, 2b, 3b",
                                         flag_meanings="good unknown bad"),
    "flags as words": flagged("u_flag", np.full((COUNT, 3), "good"), "Bad"),
}  # fmt: skip
"""What writes a profile with a value that does not count."""
STYLES = {name: Played(write, Z, gaps=((1, 2),)) for name, write in MARKED.items()} | {
    "a range that is a text": Played(
        profile(u=(BOTH, EAST_PART, EAST | {"valid_range": "-3, 3"})), Z),
    "an ancillary variable without flags": Played(
        profile(u=(BOTH, EAST_PART, EAST | {"ancillary_variables": "u_error"}),
                u_error=(BOTH, 4.0 * GOOD, {"units": "cm s-1"})), Z),
    "positive Down": Played(profile(levels("lev", DEPTHS, positive="Down")), Z),
    "cells beside the depth of the sensor": Played(
        profile(levels("bin_depth", DEPTHS), depth=SENSOR), Z),
    "ranges beside the depth of the sensor": Played(
        profile(levels("range", HEIGHTS), depth=SENSOR), Z),
    "heights above the bed": Played(profile(levels("hab", HEIGHTS)), Z),
    "levels of no direction": Played(
        profile(levels("z", HEIGHTS)), Z, remark="z .*above the bed.*origin"),
    "a level above the surface": Played(
        profile(levels("height", [22.0, 15.0, 10.5])), Z[1:], remark="surface"),
    "a level below the bed": Played(
        profile(levels("depth", [2.0, 5.0, 22.0], positive="down")), Z[:2], remark="bed"),
    "rows with the most significant byte first": Played(big_endian, Z),
    "south": Played(point(v=(("time",), -NORTH_POINT, SOUTH))),
    "deviations of the same name": Played(
        point(us=(("time",), np.full(COUNT, 0.01), EAST | SPREAD))),
    "times with bounds": Played(
        point(time=(*clock()[:2], clock()[2] | {"bounds": "tb"}),
              tb=(("time", "nv"), np.zeros((COUNT, 2)), clock()[2]))),
    "times of one station": Played(one_station),
    "direction to": Played(polar(), current=turning),
    "direction from": Played(
        polar("from", standard_name="sea_water_velocity_from_direction"), current=turning),
    "direction from by key": Played(polar("from"), place={"direction_is": "from"}, current=turning),
    "a direction that is a mark": Refused(
        polar(directions=[60, 60, 999, 60]), "999 degrees.*360", BY_SPEED),
    "times in single precision": Refused(
        point(time=(("time",), DAYS, {"units": "days since 1858-11-17"})), "double precision"),
    "groups": Refused(groups, "group"),
}  # fmt: skip


def proposed(write, folder):
    path = str(write(folder))
    with read_dataset(path) as dataset:
        return propose(dataset, path)["velocity"]


def test_a_wind_is_no_current(tmp_path):
    wind = {"units": "m/s", "standard_name": "eastward_wind"}
    with pytest.raises(ScenarioError, match="velocity"):
        proposed(point(u=(("time",), np.ones(COUNT), wind)), tmp_path)


@pytest.mark.parametrize("attributes", [
    {"standard_name": "downward_sea_water_velocity"}, {"positive": "down"},
    {"long_name": "vertical velocity, positive down"},
])  # fmt: skip
def test_a_downward_component_is_reversed(tmp_path, attributes):
    write = point(w=(("time",), np.full(COUNT, 0.1), M_PER_S | attributes))
    assert proposed(write, tmp_path) == ["u", "v", "-w"]


# --- text ----------------------------------------------------------------------------------------

HEAD = "time,u (m/s),v (m/s)"


def table(head=HEAD, row="{t},{u},{v}", *change, **keys):
    return lines(head, row=row, change=change or ("", ""), **keys)


def mark(text):
    return lines(HEAD, change=("0.420", text))


def rows(name):
    """Return what writes flat rows of a profile, with a name of the depth."""
    return lines(f"time,{name} (m),u (m/s),v (m/s)", row="{t},{depth},{u},{v}", heights=Z)


STYLES |= {
    "names of depths": Played(rows("Bin Depth"), Z),
    "levels in rows without a usual name": Refused(rows("Tiefe"), "time repeats.*vertical"),
    "a name in quotes after a blank": Played(table('"time", "u (m/s)", "v (m/s)"')),
    "time zones": Played(table(times=[each[:-1] + "+02:00" for each in ISO])),
    "words of quality": Played(
        table(f"{HEAD},u_flag", "{t},{u},{v},good", "0.420,-0.090,good", "1.9,-0.090,bad"),
        gaps=((1, 0),)),
    "a # in a cell": Refused(table("site,time,u,v", "No #3,{t},{u},{v}"), "# before.*line 2"),
    "an error of a spreadsheet": Refused(mark("#N/A"), "# before.*line 3.*empty"),
    "pixels of a picture": Refused(table("time,u (px/s),v (px/s)"), "px/s.*m/s"),
    "dates in digits": Refused(table(times=[20240301 + k for k in range(4)]), "date.*ISO"),
    "instants in digits": Refused(table(times=dates("%Y%m%d%H%M")), "date.*ISO"),
    "a mark in cm/s": Refused(
        lines("time,u (cm/s),v (cm/s)", scale=(100, 100), change=("42.000", "-99.9")),
        "-99.9.*missing"),
    "a scaled end of 16 bits": Refused(mark("-32.768"), "-32.768.*missing"),
    "a row without a date": Refused(lines(HEAD, change=(ISO[2], "")), "empty cell in row 3"),
    "a date without a time of day": Refused(
        table("time;u;v", "{t};{u};{v}", " 06:00", "", times=dates("%d.%m.%Y %H:%M")),
        "row 2; must contain increasing numbers or ISO dates"),
    "lines above the names": Refused(
        lines("Site: M1, north\ntime,u,v"), "longer rows.*mark .* by #"),
}  # fmt: skip


@pytest.mark.parametrize("style", STYLES.values(), ids=STYLES)
def test_an_odd_file_is_played_or_refused(tmp_path, style):
    style.check(tmp_path)


def test_a_count_is_no_velocity(tmp_path):
    write = lines("time,u (m/s),w (m/s),n", row="{t},{u},{v},3")
    assert proposed(write, tmp_path) == ["u", "w"]
