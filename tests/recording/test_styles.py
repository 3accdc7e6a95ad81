"""Measured currents in netCDF as services and models write them, and straight profiles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.assembly.arrays import build_flow
from crinoid.flow import Water
from helpers.measured import measured, recorded
from helpers.styles import (
    DEPTHS,
    DOWN,
    EAST,
    EAST_NORTH,
    M_PER_S,
    NORTH,
    PROFILE,
    Played,
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


def spread(values):
    """Return an array over time and level with two more axes of one entry."""
    return np.asarray(values)[:, :, None, None]


def axis(name, values, units):
    return (name,), np.asarray(values), {"standard_name": name.lower(), "units": units}


# --- ERDDAP --------------------------------------------------------------------------------------


def erddap_griddap(folder):
    grid = "time", "depth", "latitude", "longitude"
    east, north = over(straight, Z)
    variables = {
        "time": clock(),
        "depth": (("depth",), DEPTHS, DOWN | {"_CoordinateAxisType": "Height"}),
        "latitude": axis("latitude", [36.75], "degrees_north"),
        "longitude": axis("longitude", [-122.03], "degrees_east"),
        "u": (grid, spread(east), EAST | {"_FillValue": -1e34, "ioos_category": "Currents"}),
        "v": (grid, spread(north), NORTH | {"_FillValue": -1e34, "ioos_category": "Currents"}),
    }
    return store(folder / "model_1.nc", variables, form="NETCDF3_CLASSIC", cdm_data_type="Grid")


def erddap_rows(depths):
    """Return what writes a flat file of tabledap: all variables over rows."""

    def write(folder):
        depths_of_rows = np.tile(depths, 4)
        east, north = (each.ravel() for each in over(straight, -np.asarray(depths)))
        (_, times, attributes) = clock()
        name = np.array([list("M1")] * east.size, "S1")
        variables = {
            "station": (("row", "station_strlen"), name, {"cf_role": "timeseries_id"}),
            "time": (("row",), np.repeat(times, len(depths)), attributes),
            "depth": (("row",), depths_of_rows, DOWN),
            "u": (("row",), east, EAST),
            "v": (("row",), north, NORTH),
        }
        kind = {"cdm_data_type": "TimeSeriesProfile" if len(depths) > 1 else "TimeSeries"}
        return store(folder / "mooring_1.nc", variables, form="NETCDF3_CLASSIC", **kind)

    return write


# --- Copernicus, HYCOM, ROMS, NEMO ---------------------------------------------------------------

CMEMS_DEPTHS = np.array([0.494025, 1.541375, 2.645669], "f4")
CMEMS_Z = tuple(-CMEMS_DEPTHS.astype(float))


def copernicus(vertical):
    """Return what writes a subset of Copernicus Marine, by depth or by elevation."""

    def write(folder):
        grid = "time", vertical, "latitude", "longitude"
        levels = CMEMS_DEPTHS if vertical == "depth" else -CMEMS_DEPTHS[::-1]
        attributes = DOWN if vertical == "depth" else {
            "standard_name": "elevation", "units": "m", "positive": "up", "axis": "Z",
        }  # fmt: skip
        limits = {"valid_min": levels.min(), "valid_max": levels.max()}
        texts = [f"{each}.000000000" for each in dates("%Y-%m-%dT%H:%M:%S", step=3600.0)]
        east, north = over(straight, -np.abs(levels.astype(float)))
        fill = {"_FillValue": np.float32(9.96921e36)}
        variables = {
            "time": (
                ("time",),
                since("1950-01-01", "h", step=3600.0),
                {
                    "standard_name": "time",
                    "units": "hours since 1950-01-01",
                    "axis": "T",
                    "valid_min": texts[0],
                    "valid_max": texts[-1],
                },
            ),
            vertical: ((vertical,), levels, attributes | limits),
            "latitude": axis("latitude", np.float32([43.25]), "degrees_north"),
            "longitude": axis("longitude", np.float32([7.5]), "degrees_east"),
            "uo": (grid, spread(east).astype("f4"), EAST | fill),
            "vo": (grid, spread(north).astype("f4"), NORTH | fill),
        }
        return store(folder / "cmems_mod_glo_phy-cur_anfc.nc", variables, Conventions="CF-1.8")

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
    good = np.ones(east.shape, "i1")
    variables = {
        "TIME": (
            ("TIME",),
            since("1950-01-01", "D"),
            {"standard_name": "time", "units": "days since 1950-01-01T00:00:00Z", "axis": "T"},
        ),
        "TIME_QC": (("TIME",), np.ones(4, "i1"), flags),
        "LATITUDE": axis("LATITUDE", np.float32([36.6]), "degrees_north"),
        "LONGITUDE": axis("LONGITUDE", np.float32([-7.4]), "degrees_east"),
        "DEPH": (
            both,
            np.tile(DEPTHS.astype("f4"), (4, 1)),
            DOWN | {"_FillValue": np.float32(-1e9)},
        ),
        "DEPH_QC": (both, 7 * good, flags),
        "EWCT": (
            both,
            with_gap(east, 2, 1, 4321),
            EAST | packed | {"ancillary_variables": "EWCT_QC"},
        ),
        "EWCT_QC": (both, with_gap(good, 2, 1, 4), flags),
        "NSCT": (both, with_gap(north, 1, 0, -2147483647), NORTH | packed),
        "NSCT_QC": (both, with_gap(good, 1, 0, 9), flags),
    }
    return store(folder / "IR_TS_MO_6200085.nc", variables, data_type="OceanSITES time-series data")


def hycom(folder):
    """Water velocities of HYCOM: 16-bit numbers, longitudes of 0 to 360 degrees, land masked."""
    grid = "time", "depth", "lat", "lon"
    variables = {
        "time": (
            ("time",),
            since("2000-01-01", "h", step=10800.0),
            {"units": "hours since 2000-01-01 00:00:00", "calendar": "gregorian", "axis": "T"},
        ),
        "depth": (("depth",), DEPTHS, DOWN | {"long_name": "Depth", "NAVO_code": np.int32(5)}),
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
        variables[name] = (grid, numbers, attributes | packed | {"units": "m/s"})
    return store(folder / "hycom_glb_930.nc", variables, form="NETCDF3_64BIT_OFFSET")


S_RHO = np.array([-0.875, -0.625, -0.375, -0.125])
STRETCHED = np.sinh(3.0 * S_RHO) / np.sinh(3.0)
ZETA = np.array([0.0, 0.1, 0.2, -0.1, -0.2])
HC, H = 5.0, 18.0
S_LEVELS = H * (HC * S_RHO + H * STRETCHED) / (HC + H)
"""Heights (m) of the levels of ROMS under a surface at rest."""


def roms(folder):
    """Averages of ROMS (Vtransform 2): levels that follow the surface and the bed."""
    grid = "ocean_time", "s_rho", "eta_rho", "xi_rho"
    z = ZETA[:, None] + (ZETA[:, None] + H) * S_LEVELS / H
    values = straight(np.arange(5)[:, None], z)
    depth, zeta = np.full((2, 2), 300.0), np.full((5, 2, 2), 0.7)
    depth[1, 0], zeta[:, 1, 0] = H, ZETA
    terms = "s: s_rho C: Cs_r eta: zeta depth: h depth_c: hc"
    level = {
        "standard_name": "ocean_s_coordinate_g2",
        "positive": "up",
        "formula_terms": terms,
        "valid_min": -1.0,
        "valid_max": 0.0,
    }
    variables = {
        "ocean_time": (
            ("ocean_time",),
            since("1970-01-01", "s", count=5, step=3600.0),
            {"units": "seconds since 1970-01-01 00:00:00", "field": "time, scalar, series"},
        ),
        "Vtransform": ((), np.int32(2), {"long_name": "vertical terrain-following equation"}),
        "hc": ((), HC, {"units": "meter"}),
        "s_rho": (("s_rho",), S_RHO, level),
        "Cs_r": (("s_rho",), STRETCHED, {"valid_min": -1.0, "valid_max": 0.0}),
        "h": (grid[2:], depth, {"units": "meter", "long_name": "bathymetry at RHO-points"}),
        "zeta": ((grid[0], *grid[2:]), zeta, {"units": "meter", "time": "ocean_time"}),
    }
    for name, each in zip(("u_eastward", "v_northward"), values, strict=True):
        numbers = np.full((5, 4, 2, 2), 1e37, "f4")
        numbers[:, :, 1, 0] = each
        attributes = {
            "units": "meter second-1",
            "time": "ocean_time",
            "_FillValue": np.float32(1e37),
        }
        variables[name] = (grid, numbers, attributes)
    return store(folder / "ocean_avg_0001.nc", variables, form="NETCDF3_64BIT_OFFSET")


def nemo(folder):
    """A subset of NEMO by XIOS on the grid T: axes without coordinates, two variables of time."""
    grid = "time_counter", "deptht", "y", "x"
    (_, times, _) = clock(step=3600.0)
    times = times - times[0] + since("1900-01-01", "s")[0]
    time = {
        "standard_name": "time",
        "units": "seconds since 1900-01-01 00:00:00",
        "calendar": "gregorian",
        "time_origin": "1900-01-01 00:00:00",
    }
    depth = {"long_name": "Vertical T levels", "units": "m", "positive": "down", "axis": "Z"}
    variables = {
        "nav_lat": (grid[2:], np.float32([[43.2, 43.2]]), {"units": "degrees_north"}),
        "nav_lon": (grid[2:], np.float32([[7.5, 7.6]]), {"units": "degrees_east"}),
        "deptht": (("deptht",), DEPTHS.astype("f4"), depth),
        "time_centered": (("time_counter",), times - 1800.0, time),
        "time_counter": (("time_counter",), times, time | {"axis": "T"}),
    }
    names = {"vozocrtx": "sea_water_x_velocity", "vomecrty": "sea_water_y_velocity"}
    for (name, standard), each in zip(names.items(), over(straight, Z), strict=True):
        attributes = {
            "standard_name": standard,
            "units": "m/s",
            "_FillValue": np.float32(1e20),
            "missing_value": np.float32(1e20),
            "coordinates": "time_centered nav_lat nav_lon",
        }
        numbers = np.stack([np.full((4, 3), 1e20), each], axis=-1)[:, :, None]
        variables[name] = (grid, numbers.astype("f4"), attributes)
    return store(folder / "MED_1h_20240301_grid_T.nc", variables)


# --- the table ---


def east_north(east, north, vertical=None, **keys):
    """Return the keys of a flow by the names of its components."""
    named = {"velocity": [east, north, "0"], "heading_deg": 90.0}
    return named | ({} if vertical is None else {"vertical": vertical}) | keys


UO_VO = east_north("uo", "vo")

STYLES = {
    "ERDDAP griddap": Played(erddap_griddap, PROFILE, Z),
    "ERDDAP rows of a point": Played(erddap_rows([2.0]), EAST_NORTH, at=-2.0),
    "ERDDAP rows of a profile": Played(erddap_rows(DEPTHS), PROFILE, Z),
    "Copernicus Marine by depth": Played(
        copernicus("depth"), UO_VO | {"vertical": "depth"}, CMEMS_Z, step=3600.0
    ),
    "Copernicus Marine by elevation": Played(
        copernicus("elevation"), UO_VO | {"vertical": "elevation"}, CMEMS_Z, step=3600.0
    ),
    "Copernicus in situ": Played(
        copernicus_in_situ,
        east_north("EWCT", "NSCT", "DEPH", time="TIME"),
        Z,
        gaps=((2, 1), (1, 0)),
    ),
    "HYCOM": Played(
        hycom,
        east_north("water_u", "water_v", "depth"),
        Z,
        place={"select": {"lat": 38.97, "lon": -75.05}},
        step=10800.0,
    ),
    "ROMS": Played(
        roms,
        east_north("u_eastward", "v_northward", "s_rho", time="ocean_time"),
        tuple(S_LEVELS[1:-1]),
        place={"select": {"eta_rho": 1, "xi_rho": 0}},
        count=5,
        step=3600.0,
        remark="mean",
        moving=True,
    ),
    "NEMO": Played(
        nemo,
        {"time": "time_counter", "vertical": "deptht"},
        Z,
        place=east_north("vozocrtx", "vomecrty", select={"x": 1}),
        step=3600.0,
    ),
}


@pytest.mark.parametrize("style", by_keys(STYLES))
def test_a_file_is_played_or_refused(tmp_path, style):
    check_keys(style, tmp_path)


@pytest.mark.parametrize("style", by_proposal(STYLES))
def test_the_keys_of_a_file_are_proposed(tmp_path, style):
    check_proposal(style, tmp_path)


@pytest.mark.slow
def test_a_straight_profile_is_played_straight(tmp_path):
    depths = np.array([2.0, 3.0, 6.5, 9.0, 18.0])
    time = np.arange(0.0, 40.0, 0.5)
    both = "time", "depth"
    profile = np.stack([0.4 - 0.02 * depths] * time.size)
    variables = {
        "time": (("time",), time, {"units": "s"}),
        "depth": (("depth",), depths, DOWN),
        "u": (both, profile, M_PER_S),
    }
    path = store(tmp_path / "straight.nc", variables)
    case = measured(path, velocity=["u", "0"], vertical="depth")
    water = Water((build_flow(case, 0, case.flow[0], recorded(case)),))
    heights = jnp.linspace(-18.0, -2.0, 50)
    points = jnp.stack([jnp.zeros_like(heights), heights], axis=1)
    velocity = jax.vmap(lambda point: water.current(point, jnp.asarray(3.0)).velocity)(points)
    np.testing.assert_allclose(velocity[:, 0], 0.4 + 0.02 * heights, atol=1e-6)
