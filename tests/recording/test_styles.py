"""Measured currents in netCDF as services, models and instruments write them."""

import numpy as np
import pytest

from helpers.styles import (
    DEPTHS,
    DOWN,
    EAST,
    M_PER_S,
    NORTH,
    Played,
    Refused,
    Z,
    clock,
    dates,
    over,
    since,
    store,
    straight,
    with_gap,
)


def spread(values):
    """Return an array over time and level with two more axes of one entry."""
    return np.asarray(values)[:, :, None, None]


def axis(name, values, units):
    return (name,), np.asarray(values), {"standard_name": name.lower(), "units": units}


# --- services and models -------------------------------------------------------------------------


def grid(level, names, fill, time, levels=DEPTHS, **options):
    """Return what writes a column of a grid over a depth or an elevation."""

    def write(folder):
        axes = "time", level[0], "latitude", "longitude"
        east, north = (each.astype(fill.dtype) for each in over(straight, -np.abs(levels)))
        variables = {
            "time": time,
            level[0]: ((level[0],), levels, level[1]),
            "latitude": axis("latitude", [36.75], "degrees_north"),
            "longitude": axis("longitude", [-122.03], "degrees_east"),
            names[0]: (axes, spread(east), EAST | {"_FillValue": fill}),
            names[1]: (axes, spread(north), NORTH | {"_FillValue": fill}),
        }
        return store(folder / "model.nc", variables, **options)

    return write


CMEMS_DEPTHS = np.array([0.494025, 1.541375, 2.645669], "f4")
CMEMS_Z = tuple(-CMEMS_DEPTHS.astype(float))
ELEVATION = {"standard_name": "elevation", "units": "m", "positive": "up", "axis": "Z"}


def copernicus(vertical):
    """Return what writes a subset of Copernicus Marine, by depth or by elevation."""
    levels = CMEMS_DEPTHS if vertical == "depth" else -CMEMS_DEPTHS[::-1]
    attributes = DOWN if vertical == "depth" else ELEVATION
    attributes = attributes | {"valid_min": levels.min(), "valid_max": levels.max()}
    name, hours, units = clock(epoch="1950-01-01", unit="h", step=3600.0)
    first, *_, last = dates("%Y-%m-%dT%H:%M:%S.000000000", step=3600.0)
    time = name, hours, units | {"valid_min": first, "valid_max": last}
    fill = np.float32(9.96921e36)
    return grid((vertical, attributes), ("uo", "vo"), fill, time, levels)


def erddap_rows(depths):
    """Return what writes a flat file of tabledap: all variables over rows."""

    def write(folder):
        east, north = (each.ravel() for each in over(straight, -np.asarray(depths)))
        (_, times, attributes) = clock()
        name = np.array([list("M1")] * east.size, "S1")
        variables = {
            "station": (("row", "station_strlen"), name, {"cf_role": "timeseries_id"}),
            "time": (("row",), np.repeat(times, len(depths)), attributes),
            "depth": (("row",), np.tile(depths, 4), DOWN),
            "u": (("row",), east, EAST),
            "v": (("row",), north, NORTH),
        }
        kind = {"cdm_data_type": "TimeSeriesProfile" if len(depths) > 1 else "TimeSeries"}
        return store(folder / "mooring_1.nc", variables, form="NETCDF3_CLASSIC", **kind)

    return write


def copernicus_in_situ(folder):
    """Moorings of Copernicus Marine In Situ: packed, a quality flag for each number."""
    both = "TIME", "DEPTH"
    packed = {"_FillValue": np.int32(-2147483647), "scale_factor": 0.001, "add_offset": 0.0}
    flags = {
        "long_name": "quality flag",
        "_FillValue": np.int8(-127),
        "flag_values": np.arange(10, dtype="i1"),
        "flag_meanings": "no_qc_performed good_data probably_good_data "
        "bad_data_that_are_potentially_correctable bad_data value_changed value_below_detection "
        "nominal_value interpolated_value missing_value",
    }
    east, north = (np.rint(1e3 * each).astype("i4") for each in over(straight, Z))
    good, levels = np.ones(east.shape, "i1"), np.tile(DEPTHS.astype("f4"), (4, 1))
    linked = {"ancillary_variables": "EWCT_QC"}
    variables = {
        "TIME": clock("TIME", "1950-01-01", "D"),
        "TIME_QC": (("TIME",), np.ones(4, "i1"), flags),
        "DEPH": (both, levels, DOWN | {"_FillValue": np.float32(-1e9)}),
        "DEPH_QC": (both, 7 * good, flags),
        "EWCT": (both, with_gap(east, 2, 1, 4321), EAST | packed | linked),
        "EWCT_QC": (both, with_gap(good, 2, 1, 4), flags),
        "NSCT": (both, with_gap(north, 1, 0, -2147483647), NORTH | packed),
        "NSCT_QC": (both, with_gap(good, 1, 0, 9), flags),
    }
    return store(folder / "IR_TS_MO_6200085.nc", variables)


def hycom(folder):
    """Water velocities of HYCOM: 16-bit numbers, longitudes of 0 to 360 degrees, land masked."""
    axes = "time", "depth", "lat", "lon"
    (_, hours, _) = clock(epoch="2000-01-01", unit="h", step=10800.0)
    since_2000 = {"units": "hours since 2000-01-01 00:00:00", "calendar": "gregorian", "axis": "T"}
    variables = {
        "time": (("time",), hours, since_2000),
        "depth": (("depth",), DEPTHS, DOWN),
        "lat": (("lat",), np.array([38.96, 39.0]), {"units": "degrees_north", "axis": "Y"}),
        "lon": (("lon",), np.array([284.96, 285.04]), {"units": "degrees_east", "axis": "X"}),
    }
    marks = {name: np.int16(-30000) for name in ("_FillValue", "missing_value")}
    packed = marks | {"scale_factor": np.float32(0.001), "add_offset": np.float32(0.0)}
    for name, values, attributes in zip(
        ("water_u", "water_v"), over(straight, Z), (EAST, NORTH), strict=True
    ):
        numbers = np.full((4, 3, 2, 2), -30000, "i2")
        numbers[:, :, 0, 0], numbers[:, :, 1, 1] = np.rint(1e3 * values), 77
        variables[name] = (axes, numbers, attributes | packed)
    return store(folder / "hycom_glb_930.nc", variables, form="NETCDF3_64BIT_OFFSET")


S_RHO = np.array([-0.875, -0.625, -0.375, -0.125])
STRETCHED = np.sinh(3.0 * S_RHO) / np.sinh(3.0)
ZETA = np.array([0.0, 0.1, 0.2, -0.1, -0.2])
HC, H = 5.0, 18.0
S_LEVELS = H * (HC * S_RHO + H * STRETCHED) / (HC + H)
"""Heights (m) of the levels of ROMS under a surface at rest."""


def roms(folder):
    """Averages of ROMS (Vtransform 2): levels that follow the surface and the bed."""
    axes = "ocean_time", "s_rho", "eta_rho", "xi_rho"
    z = ZETA[:, None] + (ZETA[:, None] + H) * S_LEVELS / H
    values = straight(np.arange(5)[:, None], z)
    depth, zeta = np.full((2, 2), 300.0), np.full((5, 2, 2), 0.7)
    depth[1, 0], zeta[:, 1, 0] = H, ZETA
    terms = "s: s_rho C: Cs_r eta: zeta depth: h depth_c: hc"
    level = {"standard_name": "ocean_s_coordinate_g2", "positive": "up", "formula_terms": terms}
    limits = {"valid_min": -1.0, "valid_max": 0.0}
    time = {"units": "seconds since 1970-01-01 00:00:00", "field": "time, scalar, series"}
    variables = {
        "ocean_time": (axes[:1], since("1970-01-01", "s", count=5, step=3600.0), time),
        "Vtransform": ((), np.int32(2), {"long_name": "vertical terrain-following equation"}),
        "hc": ((), HC, {"units": "meter"}),
        "s_rho": (("s_rho",), S_RHO, level | limits),
        "Cs_r": (("s_rho",), STRETCHED, limits),
        "h": (axes[2:], depth, {"units": "meter", "long_name": "bathymetry at RHO-points"}),
        "zeta": ((axes[0], *axes[2:]), zeta, {"units": "meter", "time": "ocean_time"}),
    }
    attributes = {"units": "meter second-1", "time": axes[0], "_FillValue": np.float32(1e37)}
    for name, each in zip(("u_eastward", "v_northward"), values, strict=True):
        numbers = np.full((5, 4, 2, 2), 1e37, "f4")
        numbers[:, :, 1, 0] = each
        variables[name] = (axes, numbers, attributes)
    return store(folder / "ocean_avg_0001.nc", variables, form="NETCDF3_64BIT_OFFSET")


def nemo(folder):
    """A subset of NEMO by XIOS on the grid T: axes without coordinates, two variables of time."""
    axes = "time_counter", "deptht", "y", "x"
    (_, times, time) = clock(epoch="1900-01-01", step=3600.0)
    depth = {"long_name": "Vertical T levels", "units": "m", "positive": "down", "axis": "Z"}
    variables = {
        "nav_lat": (axes[2:], np.float32([[43.2, 43.2]]), {"units": "degrees_north"}),
        "nav_lon": (axes[2:], np.float32([[7.5, 7.6]]), {"units": "degrees_east"}),
        "deptht": (("deptht",), DEPTHS.astype("f4"), depth),
        "time_centered": (axes[:1], times - 1800.0, {k: time[k] for k in time if k != "axis"}),
        "time_counter": (axes[:1], times, time),
    }
    names = {"vozocrtx": "sea_water_x_velocity", "vomecrty": "sea_water_y_velocity"}
    marks = {name: np.float32(1e20) for name in ("_FillValue", "missing_value")}
    for (name, standard), each in zip(names.items(), over(straight, Z), strict=True):
        attributes = {"standard_name": standard, "units": "m/s"} | marks
        attributes["coordinates"] = "time_centered nav_lat nav_lon"
        numbers = np.stack([np.full((4, 3), 1e20), each], axis=-1)[:, :, None]
        variables[name] = (axes, numbers.astype("f4"), attributes)
    return store(folder / "MED_1h_20240301_grid_T.nc", variables)


# --- instruments ---------------------------------------------------------------------------------

RANGES = np.array([0.6, 1.1, 1.6])


def dolfyn(coordinates):
    """Return what writes a profile of DOLfYN (MHKiT) in a coordinate system."""

    def write(folder):
        east, north = (each.T for each in over(straight, RANGES - 19.5))
        up = np.zeros_like(east)
        names = {"earth": ["E", "N", "U"], "beam": [1, 2, 3]}[coordinates]
        variables = {
            "time": clock(),
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


def xmitgcm(folder):
    """A column of MITgcm by xmitgcm: negative levels that the file calls a depth, downward."""
    both = "time", "Z"
    east, north = over(straight, Z)
    names = {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"}
    variables = {
        "time": (("time",), 600.0 * np.arange(4), {"units": "seconds"}),
        "Z": (("Z",), np.array(Z), names),
        "UVEL": (both, east.astype("f4"), {"units": "m s-1", "long_name": "Zonal Velocity"}),
        "VVEL": (both, north.astype("f4"), {"units": "m s-1", "long_name": "Meridional Velocity"}),
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
        "time": (("time",), since("2024-01-01", "D", count=5), {"units": "days since 2024-01-01"}),
        "lon": (("time",), np.linspace(-158.0, -157.9, 5), {"units": "degrees_east"}),
        "lat": (("time",), np.linspace(21.0, 21.1, 5), {"units": "degrees_north"}),
        "depth": (both, depth.astype("f4"), {"long_name": "Depth", "units": "meter"} | marks),
    }
    for name, long_name, each in (("u", "Zonal", east), ("v", "Meridional", north)):
        attributes = {"long_name": f"{long_name} velocity component", "units": "meter second-1"}
        variables[name] = (both, each.astype("f4"), attributes | marks)
    return store(folder / "os75nb_short.nc", variables, software="pycurrents")


# --- the table -----------------------------------------------------------------------------------

UVEL_VVEL = {"velocity": ["UVEL", "VVEL", "0"], "heading_deg": 90.0}
VOZO_VOME = {"velocity": ["vozocrtx", "vomecrty", "0"], "heading_deg": 90.0}
BEAM = {"velocity": ["vel", "0", "0"], "vertical": "range", "select": {"dir": 1}}
MOVING = {"count": 5, "remark": "mean", "moving": True}

STYLES = {
    "ERDDAP griddap": Played(
        grid(("depth", DOWN), "uv", np.float64(-1e34), clock(), form="NETCDF3_CLASSIC"), Z),
    "ERDDAP rows of a point": Played(erddap_rows([2.0]), at=-2.0),
    "ERDDAP rows of a profile": Played(erddap_rows(DEPTHS), Z),
    "Copernicus Marine by depth": Played(copernicus("depth"), CMEMS_Z, step=3600.0),
    "Copernicus Marine by elevation": Played(copernicus("elevation"), CMEMS_Z, step=3600.0),
    "Copernicus in situ": Played(copernicus_in_situ, Z, gaps=((2, 1), (1, 0))),
    "HYCOM": Played(hycom, Z, place={"select": {"lat": 38.97, "lon": 284.95}}, step=10800.0),
    "ROMS": Played(
        roms, tuple(S_LEVELS[1:-1]), place={"select": {"eta_rho": 1, "xi_rho": 0}}, step=3600.0,
        **MOVING),
    "NEMO": Played(nemo, Z, place=VOZO_VOME | {"select": {"x": 1}}, step=3600.0),
    "DOLfYN in earth coordinates": Played(
        dolfyn("earth"), tuple(RANGES - 19.5), place={"origin": -19.5}),
    "DOLfYN in beam coordinates": Refused(dolfyn("beam"), "beam.*(rotate|earth)", BEAM),
    "MITgcm": Played(xmitgcm, Z, UVEL_VVEL | {"vertical": "-Z"}),
    "MITgcm without a sign": Refused(xmitgcm, "above.*minus sign", UVEL_VVEL | {"vertical": "Z"}),
    "UHDAS": Played(uhdas, tuple(-UHDAS_DEPTHS[1:-1]), **MOVING),
}  # fmt: skip


@pytest.mark.parametrize("style", STYLES.values(), ids=STYLES)
def test_a_file_is_played_or_refused(tmp_path, style):
    style.check(tmp_path)
