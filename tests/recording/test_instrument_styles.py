"""Measured currents in netCDF of instruments, and attributes that say how to read them."""

import netCDF4
import numpy as np
import pytest

from helpers.styles import (
    DEPTHS,
    DOWN,
    EAST,
    EAST_NORTH,
    M_PER_S,
    NORTH,
    PROFILE,
    Played,
    Refused,
    Z,
    by_keys,
    by_proposal,
    check_keys,
    check_proposal,
    clock,
    over,
    put,
    since,
    speed_and_direction,
    store,
    straight,
    turning,
    with_gap,
)

# --- instruments ---------------------------------------------------------------------------------

RANGES = np.array([0.6, 1.1, 1.6])


def dolfyn(coordinates):
    """Return what writes a profile of DOLfYN (MHKiT) in a coordinate system."""

    def write(folder):
        east, north = (each.T for each in over(straight, RANGES - 19.5))
        up = np.zeros_like(east)
        names = {"earth": ["E", "N", "U"], "beam": [1, 2, 3]}[coordinates]
        variables = {
            "time": (
                ("time",),
                since("1970-01-01", "s"),
                {"standard_name": "time", "units": "seconds since 1970-01-01"},
            ),
            "dir": (("dir",), np.array(names), {"units": "1", "long_name": "Reference Frame"}),
            "range": (("range",), RANGES, {"units": "m", "long_name": "Profile Range"}),
            "vel": (
                ("dir", "range", "time"),
                np.stack([east, north, up]).astype("f4"),
                M_PER_S | {"long_name": "Water Velocity", "_FillValue": np.float32(np.nan)},
            ),
        }
        about = {"inst_make": "Nortek", "inst_type": "ADCP", "fs": 0.1, "coord_sys": coordinates}
        return store(folder / "adcp.nc", variables, **about)

    return write


def imos(folder):
    """Moored profiler of IMOS: days since 1950, flags named by `ancillary_variables`."""
    both = "TIME", "HEIGHT_ABOVE_SENSOR"
    east, north = (each.astype("f4") for each in over(straight, RANGES - 19.5))
    variables = {
        "TIME": (
            ("TIME",),
            since("1950-01-01", "D"),
            {"standard_name": "time", "units": "days since 1950-01-01 00:00:00 UTC", "axis": "T"},
        ),
        "HEIGHT_ABOVE_SENSOR": (
            both[1:],
            RANGES.astype("f4"),
            {"long_name": "height_above_sensor", "units": "m", "positive": "up", "axis": "Z"},
        ),
        "UCUR": (
            both,
            with_gap(east, 2, 0, 1.9),
            EAST | {"ancillary_variables": "UCUR_quality_control", "valid_min": np.float32(-10)},
        ),
        "VCUR": (both, north, NORTH | {"_FillValue": np.float32(999999.0)}),
        "UCUR_quality_control": (
            both,
            with_gap(np.ones((4, 3), "i1"), 2, 0, 4),
            {
                "standard_name": "eastward_sea_water_velocity status_flag",
                "flag_values": np.array([0, 1, 2, 3, 4, 9], "i1"),
                "flag_meanings": "No_QC_performed Good_data Probably_good_data "
                "Bad_data_that_are_potentially_correctable Bad_data Missing_value",
            },
        ),
    }
    return store(folder / "IMOS_ANMN-NSW_AETVZ_FV01.nc", variables, Conventions="CF-1.6,IMOS-1.4")


def xmitgcm(folder):
    """A column of MITgcm by xmitgcm: negative levels that the file calls a depth, downward."""
    grid = "time", "Z"
    east, north = over(straight, Z)
    names = {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"}
    variables = {
        "time": (("time",), 600.0 * np.arange(4), {"standard_name": "time", "units": "seconds"}),
        "Z": (("Z",), np.array(Z), names),
        "UVEL": (grid, east.astype("f4"), {"units": "m s-1", "long_name": "Zonal Velocity"}),
        "VVEL": (grid, north.astype("f4"), {"units": "m s-1", "long_name": "Meridional Velocity"}),
    }
    return store(folder / "column.nc", variables)


UHDAS_SHIFT = np.array([0.0, 0.2, -0.2, 0.1, -0.1])
UHDAS_DEPTHS = np.array([3.0, 5.0, 7.0, 9.0])


def uhdas(folder):
    """Short netCDF of a ship's profiler (UHDAS, CODAS): depths of the cells differ in time."""
    depth = UHDAS_DEPTHS + UHDAS_SHIFT[:, None]
    east, north = straight(np.arange(5)[:, None], -depth)
    mark = np.float32(1e38)
    marks = {"missing_value": mark, "_FillValue": mark}
    both = "time", "depth_cell"
    variables = {
        "time": (
            ("time",),
            since("2024-01-01", "D", count=5),
            {"long_name": "Decimal day", "units": "days since 2024-01-01 00:00:00"},
        ),
        "lon": (("time",), np.linspace(-158.0, -157.9, 5), {"units": "degrees_east"}),
        "lat": (("time",), np.linspace(21.0, 21.1, 5), {"units": "degrees_north"}),
        "depth": (both, depth.astype("f4"), {"long_name": "Depth", "units": "meter"} | marks),
    }
    for name, long_name, each in (("u", "Zonal", east), ("v", "Meridional", north)):
        attributes = {"long_name": f"{long_name} velocity component", "units": "meter second-1"}
        variables[name] = (both, each.astype("f4"), attributes | marks)
    return store(folder / "os75nb_short.nc", variables, software="pycurrents")


# --- attributes ----------------------------------------------------------------------------------


def moored(east=None, north=None, depth=None, depths=DEPTHS, name="depth", more=(), **packed):
    """Return what writes a profile; functions change the packed values of each component."""

    def write(folder):
        parts = over(straight, -np.asarray(depths))
        if "scale_factor" in packed:
            parts = [np.rint(each / packed["scale_factor"]).astype("i2") for each in parts]
        parts = [
            each if change is None else change(each)
            for each, change in zip(parts, (east, north), strict=True)
        ]
        u, v = parts
        attributes = DOWN if depth is None else depth
        variables = {
            "time": clock(),
            name: ((name,), np.asarray(depths), attributes),
            "u": (("time", name), u, EAST | packed),
            "v": (("time", name), v, NORTH | packed),
        }
        for flag in more:
            variables[flag[0]] = (("time", name), *flag[1:])
            variables["u"][2]["ancillary_variables"] = more[0][0]
        return store(folder / "mooring.nc", variables)

    return write


def marked(mark):
    """Return what puts a mark at instant 1 and level 2."""
    return lambda values: with_gap(values, 1, 2, mark)


GAP = {"gaps": ((1, 2),)}
QARTOD = (
    "eastward_qc_agg",
    with_gap(with_gap(np.ones((4, 3), "i1"), 1, 2, 4), 2, 0, 2),
    {
        "standard_name": "aggregate_quality_flag",
        "flag_values": np.array([1, 2, 3, 4, 9], "i1"),
        "flag_meanings": "PASS NOT_EVALUATED SUSPECT FAIL MISSING",
    },
)

CHARACTERS = (
    "u_QC",
    with_gap(np.full((4, 3), b"1"), 1, 2, b"4"),
    {"long_name": "quality flag", "conventions": "OceanSITES reference table 2"},
)
ERROR = (
    "u_error",
    np.full((4, 3), 4.0),
    {"standard_name": "eastward_sea_water_velocity standard_error", "units": "cm s-1"},
)


def polar(way=None):
    """Return what writes speed and direction, with standard names if ``way`` is to or from."""

    def write(folder):
        speed, direction = (each[:, 0] for each in over(speed_and_direction))
        names = [{"standard_name": "sea_water_speed"}, {}]
        if way is None:
            names = [{}, {}]
        else:
            names[1]["standard_name"] = f"sea_water_velocity_{way}_direction"
        turned = direction if way == "to" else (direction + 180.0) % 360.0
        variables = {
            "time": clock(),
            "spd": (("time",), 100.0 * speed, {"units": "cm/s"} | names[0]),
            "dir": (("time",), turned, {"units": "degree"} | names[1]),
        }
        return store(folder / "buoy.nc", variables)

    return write


def bottom_mounted(folder):
    """A profile of a profiler on the bed, whose last cell is above the surface."""
    heights = np.array([2.0, 8.0, 14.0, 20.5])
    east, north = over(straight, heights - 20.0)
    both = "time", "height"
    up = {"standard_name": "height_above_sea_floor", "units": "m", "positive": "up"}
    variables = {
        "time": clock(),
        "height": (("height",), heights, up),
        "u": (both, east, EAST),
        "v": (both, north, NORTH),
    }
    return store(folder / "awac.nc", variables)


def groups(folder):
    """All variables in a group, as a converter of Nortek stores each kind of data."""
    path = folder / "S101663A001.nc"
    with netCDF4.Dataset(path, "w") as file:
        east, north = (each[:, 0] for each in over(straight))
        variables = {
            "time": clock(),
            "u": (("time",), east, EAST),
            "v": (("time",), north, NORTH),
        }
        put(file.createGroup("Data").createGroup("Average"), variables)
        file.createGroup("Config").setncatts({"Instrument": "Signature1000"})
    return path


BELOW = moored(depths=[2.0, 8.0, 14.0, 22.0])
UVEL_VVEL = {"velocity": ["UVEL", "VVEL", "0"], "heading_deg": 90.0}
POLAR = {"speed": "spd", "direction": "dir", "heading_deg": 90.0}

STYLES = {
    "DOLfYN in earth coordinates": Played(
        dolfyn("earth"),
        {"velocity": ["vel[E]", "vel[N]", "vel[U]"], "vertical": "range", "heading_deg": 90.0},
        tuple(RANGES - 19.5),
        place={"origin": -19.5},
    ),
    "DOLfYN in beam coordinates": Refused(
        dolfyn("beam"),
        "beam.*(rotate|earth)",
        {"velocity": ["vel", "0", "0"], "vertical": "range", "select": {"dir": 1}},
    ),
    "IMOS": Played(
        imos,
        {"velocity": ["UCUR", "VCUR", "0"], "heading_deg": 90.0}
        | {"time": "TIME", "vertical": "HEIGHT_ABOVE_SENSOR"},
        tuple(RANGES - 19.5),
        place={"origin": -19.5},
        gaps=((2, 0),),
    ),
    "MITgcm": Played(xmitgcm, UVEL_VVEL | {"vertical": "-Z"}, Z, proposed=False),
    "MITgcm without a sign": Refused(xmitgcm, "above.*minus sign", UVEL_VVEL | {"vertical": "Z"}),
    "UHDAS": Played(
        uhdas, PROFILE, tuple(-UHDAS_DEPTHS[1:-1]), count=5, remark="mean", moving=True
    ),
    "valid_min and valid_max": Played(
        moored(east=marked(9.9), valid_min=-3.0, valid_max=3.0), PROFILE, Z, **GAP
    ),
    "valid_range of packed numbers": Played(
        moored(east=marked(30000), scale_factor=0.001, valid_range=np.array([-3000, 3000], "i2")),
        PROFILE,
        Z,
        **GAP,
    ),
    "missing_value alone": Played(
        moored(north=marked(-999.0), missing_value=-999.0), PROFILE, Z, **GAP
    ),
    "QARTOD": Played(moored(east=marked(2.5), more=[QARTOD]), PROFILE, Z, **GAP),
    "flags as characters": Played(moored(east=marked(2.5), more=[CHARACTERS]), PROFILE, Z, **GAP),
    "an ancillary variable without flags": Played(moored(more=[ERROR]), PROFILE, Z),
    "direction to": Played(polar("to"), POLAR, current=turning),
    "direction from": Played(polar("from"), POLAR, current=turning),
    "direction from by key": Played(
        polar(), POLAR, place={"direction_is": "from"}, current=turning
    ),
    "positive Down": Played(
        moored(depth={"units": "m", "positive": "Down"}, name="lev"),
        EAST_NORTH | {"vertical": "lev"},
        Z,
    ),
    "a level above the surface": Played(
        bottom_mounted, EAST_NORTH | {"vertical": "height"}, (-18.0, -12.0, -6.0), remark="surface"
    ),
    "a level below the bed": Played(BELOW, PROFILE, (-2.0, -8.0, -14.0), remark="bed"),
    "a level above an unknown bed": Played(BELOW, PROFILE, (-2.0, -8.0, -14.0, -22.0), bed=None),
    "groups": Refused(groups, "group"),
}


@pytest.mark.parametrize("style", by_keys(STYLES))
def test_an_instrument_is_played_or_refused(tmp_path, style):
    check_keys(style, tmp_path)


@pytest.mark.parametrize("style", by_proposal(STYLES))
def test_the_keys_of_an_instrument_are_proposed(tmp_path, style):
    check_proposal(style, tmp_path)
