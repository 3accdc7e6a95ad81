"""Measured currents: files of every layout, what is mended and said, what is refused, and the flow.

The currents in the files are known functions, so that what is played can be compared with them.
"""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.flow import build_flow
from crinoid.assembly.prepared import Prepared
from crinoid.flow import Water
from crinoid.recording import Stage
from crinoid.scenario import Scenario, ScenarioError, load
from physics import order

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
real_data = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the measured records are not there: {DATA}"
)

M_PER_S = {"units": "m s-1"}


def wave(time, level=0.0):
    """A current (m/s) that is smooth in time and height; east or x."""
    return 0.4 + 0.1 * np.sin(2 * np.pi * time / 7.0 + 0.3 * level)


def swell(time, level=0.0):
    """Another one; up."""
    return 0.05 * np.cos(2 * np.pi * time / 5.0) + 0.02 * level


def point(path, *, interval=0.1, length=40.0, units="m s-1", time_units="s", since=0.0, scale=1.0):
    """Write a record at one point, as of a velocimeter."""
    time = np.arange(round(length / interval) + 1) * interval
    xr.Dataset(
        {
            "u": ("time", wave(time) * scale, {"units": units, "standard_name": "sea_water_x"}),
            "w": ("time", swell(time) * scale, {"units": units}),
        },
        {"time": ("time", since + time, {"units": time_units})},
    ).to_netcdf(path)
    return time


def profile(path, *, thickness=0.5, levels=20, length=40.0, interval=0.5, change=None):
    """Write a profile with a labelled dimension, upward from an instrument, as DOLfYN does."""
    time = np.arange(round(length / interval) + 1) * interval
    height = 0.5 + thickness * np.arange(levels)
    east, up = wave(time, height[:, None]), swell(time, height[:, None])
    north = 0.2 * np.ones_like(east)
    velocity = np.stack([east, north, up, 1.01 * up])
    if change is not None:
        change(velocity)
    xr.Dataset(
        {"vel": (("dir", "range", "time"), velocity, M_PER_S)},
        {
            "dir": ["E", "N", "U1", "U2"],
            "range": ("range", height, {"units": "m"}),
            "time": ("time", 1.6e9 + time, {"units": "seconds since 1970-01-01"}),
        },
    ).to_netcdf(path)
    return time, height


def grid(path):
    """Write an ocean model's output: CF names, depth downward, dates, a place in a grid."""
    time = np.datetime64("2024-03-01T06:00") + np.arange(20) * np.timedelta64(10, "s")
    seconds = np.arange(20) * 10.0
    depth = np.array([0.0, 2.0, 5.0, 10.0, 20.0])
    place = (3.0 + np.arange(2.0))[:, None] + np.array([0.1, 0.2, 0.3])  # lat by lon
    east = 0.01 * seconds[:, None, None, None] + 0.1 * depth[:, None, None] + place
    dims = ("time", "depth", "lat", "lon")
    attributes = {"units": "cm/s", "standard_name": "eastward_sea_water_velocity"}
    north = {"units": "cm/s", "standard_name": "northward_sea_water_velocity"}
    dataset = xr.Dataset(
        {"uo": (dims, east, attributes), "vo": (dims, 2 * east, north)},
        {
            "time": time,
            "depth": ("depth", depth, {"units": "m", "positive": "down"}),
            "lat": [48.0, 48.5],
            "lon": ("lon", [236.0, 236.5, 237.0], {"units": "degrees_east"}),
        },
    )
    dataset.to_netcdf(path, encoding={"time": {"units": "hours since 2024-01-01", "dtype": "f8"}})


def scenario(file, duration=10.0, base=(0.0, -10.0), depth=20.0, **keys):
    return Scenario(
        arm={"length": 0.5},
        base={"position": base},
        water={"depth": depth},
        flow=[{"kind": "measured", "file": str(file), **keys}],
        simulation={"duration": duration},
    )


@eqx.filter_jit
def _moves(water: Water, points: jax.Array, times: jax.Array):
    currents = jax.vmap(water.current)(points, times)
    return currents.velocity, currents.acceleration


def moves(case, points, times):
    """Return velocities and material accelerations at points and times, one each."""
    points, times = np.broadcast_arrays(points, np.asarray(times, float)[..., None])
    water = crinoid.system(case).forces.water
    return jax.tree.map(np.asarray, _moves(water, jnp.asarray(points), jnp.asarray(times[..., 0])))


def refusal(case):
    with pytest.raises(ScenarioError) as caught:
        crinoid.system(case)
    assert len(caught.value.lines) == 1, caught.value.lines
    return caught.value.lines[0]


# --- a record at one point ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("units", "time_units", "factor", "per_second"),
    [
        ("m s-1", "s", 1.0, 1.0),
        ("m/s", "seconds since 2012-06-12 18:00", 1.0, 1.0),
        ("metres per second", "ms", 1.0, 1e3),
        ("cm s^-1", "minutes since 1900-01-01", 1e2, 1 / 60),
        ("mm/sec", "days since 1950-01-01", 1e3, 1 / 86400),
    ],
)
def test_units_are_turned_into_si(tmp_path, units, time_units, factor, per_second):
    time = np.arange(401) * 0.1
    xr.Dataset(
        {"u": ("time", factor * wave(time), {"units": units})},
        {"time": ("time", 1e4 + time * per_second, {"units": time_units})},
    ).to_netcdf(tmp_path / "a.nc")
    (recording,) = Prepared(scenario(tmp_path / "a.nc", velocity=["u", "0"])).recordings.values()
    np.testing.assert_allclose(recording.time, time, atol=1e-5)  # days: round-off of the file
    np.testing.assert_allclose(recording.velocity[:, 0, 0], wave(time), rtol=1e-12)
    assert not recording.velocity[:, 0, 1].any()
    assert recording.notes == ()


def test_a_point_record_is_met_later_downstream(tmp_path):
    # dx and dz along the mean current: later by distance over mean speed
    time = point(tmp_path / "a.nc", interval=0.05)
    case = scenario(tmp_path / "a.nc")
    recording = Prepared(case).recordings[0]
    mean = np.array([wave(time).mean(), swell(time).mean()])
    np.testing.assert_allclose(recording.slowness, mean / (mean @ mean), rtol=1e-9)
    away = np.array([[0.0, 0.0], [0.3, 0.0], [-0.2, 0.4]])
    at = recording.begins + 3.0 - away @ recording.slowness
    velocity, _ = moves(case, away + np.array([0.0, -10.0]), 3.0)
    np.testing.assert_allclose(velocity, np.stack([wave(at), swell(at)], axis=1), atol=2e-7)


def test_a_frozen_pattern_accelerates_the_water_by_its_fluctuation_only(tmp_path):
    # Du/Dt = u_t + (u . grad) u = R' (1 - u . U / |U|^2): none where the water drifts along
    time = point(tmp_path / "a.nc", interval=0.05)
    case = scenario(tmp_path / "a.nc")
    recording, at = Prepared(case).recordings[0], 4.3
    velocity, acceleration = moves(case, [[0.1, -10.1]], [at])
    delayed = recording.begins + at - recording.slowness @ [0.1, -0.1]
    rate = np.array(
        [
            0.1 * 2 * np.pi / 7 * np.cos(2 * np.pi * delayed / 7),
            -0.05 * 2 * np.pi / 5 * np.sin(2 * np.pi * delayed / 5),
        ]
    )
    expected = rate * (1 - recording.slowness @ velocity[0])
    np.testing.assert_allclose(acceleration[0], expected, atol=2e-5)
    assert time[-1] > 30


def test_interpolation_in_time_is_of_fourth_order(tmp_path):
    errors = []
    times = np.linspace(0.0, 10.0, 400)
    for interval in (0.8, 0.4, 0.2):
        point(tmp_path / "a.nc", interval=interval)
        case = scenario(tmp_path / "a.nc")
        velocity, _ = moves(case, [0.0, -10.0], times)
        at = Prepared(case).recordings[0].begins + times
        errors.append(np.abs(velocity - np.stack([wave(at), swell(at)], axis=1)).max())
    assert order(errors) == pytest.approx(4.0, abs=0.5)


def test_the_arm_is_covered_from_the_first_moment_to_the_last(tmp_path):
    # nowhere within reach, at no time of the run, is the record's end held on to
    point(tmp_path / "a.nc", length=14.0)
    case = scenario(tmp_path / "a.nc", base=(1.0, -3.0))
    record = crinoid.system(case).forces.water.flows[0].record
    slowness = Prepared(case).recordings[0].slowness
    farthest = 1.1 * 0.5 * np.linalg.norm(slowness)
    assert float(record.knots[0]) <= -farthest
    assert float(record.knots[-1]) >= 10.0 + farthest
    assert Prepared(case).recordings[0].begins == pytest.approx(farthest)
    # the same run, prolonged, plays the same current
    longer = scenario(tmp_path / "a.nc", base=(1.0, -3.0), duration=10.5)
    times = np.linspace(0, 10, 37)
    both = [moves(each, [1.2, -3.1], times)[0] for each in (case, longer)]
    np.testing.assert_array_equal(*both)


def test_skip_and_scales(tmp_path):
    point(tmp_path / "a.nc", interval=0.05, length=80.0)
    keys = {"skip": 12.0, "velocity_scale": 0.5, "time_scale": 0.25}
    case = scenario(tmp_path / "a.nc", **keys)
    times = np.linspace(0.0, 10.0, 50)
    velocity, _ = moves(case, [0.0, -10.0], times)
    at = 12.0 + times / 0.25
    np.testing.assert_allclose(velocity, 0.5 * np.stack([wave(at), swell(at)], axis=1), atol=1e-6)
    # half as fast, a quarter of the time: carried past the arm at half the mean velocity
    assert 1 / np.linalg.norm(Prepared(case).recordings[0].slowness) == pytest.approx(0.2, rel=0.05)


def test_names_may_be_standard_ones_and_turned_round(tmp_path):
    time = point(tmp_path / "a.nc")
    case = scenario(tmp_path / "a.nc", velocity=["-sea_water_x", "w"])
    np.testing.assert_allclose(
        Prepared(case).recordings[0].velocity[:, 0, 0], -wave(time), rtol=1e-12
    )


def test_where_the_mean_is_small_the_water_moves_as_one_and_it_is_said(tmp_path):
    time = np.arange(0, 40, 0.1)
    sway = 0.1 * np.sin(2 * np.pi * time / 4.0) + 0.01
    xr.Dataset({"u": ("time", sway, M_PER_S)}, {"time": ("time", time, {"units": "s"})}).to_netcdf(
        tmp_path / "a.nc"
    )
    case = scenario(tmp_path / "a.nc", velocity=["u", "0"])
    velocity, _ = moves(case, [[0.0, -10.0], [0.5, -10.0]], 3.0)
    np.testing.assert_array_equal(velocity[0], velocity[1])
    (note,) = Prepared(case).notes()
    assert note.startswith(
        "flow.0: fluctuations of 0.05 m/s about a mean of 0.01 m/s are no frozen"
    )


def test_a_low_pass_takes_the_fast_away_and_delays_nothing(tmp_path):
    time = np.arange(0, 100, 0.1)
    slow, fast = (np.sin(2 * np.pi * time * frequency) for frequency in (0.1, 3.0))
    xr.Dataset(
        {"u": ("time", 1.0 + 0.2 * slow + 0.2 * fast, M_PER_S)},
        {"time": ("time", time, {"units": "s"})},
    ).to_netcdf(tmp_path / "a.nc")
    keys = {"velocity": ["u", "0"], "low_pass_hz": 1.0}
    (recording,) = Prepared(scenario(tmp_path / "a.nc", **keys)).recordings.values()
    inner = slice(50, -50)
    expected = (1.0 + 0.2 * slow)[inner]
    np.testing.assert_allclose(recording.velocity[inner, 0, 0], expected, atol=1e-4)
    line = refusal(scenario(tmp_path / "a.nc", **(keys | {"low_pass_hz": 5.0})))
    assert line == (
        "flow.0.low_pass_hz: got 5.0, takes a number below 5 (Hz), half the record's rate"
    )


# --- gaps --------------------------------------------------------------------------------------


def test_gaps_are_filled_by_straight_lines_and_said(tmp_path):
    time = np.arange(0, 40, 0.5)
    values = 0.5 + 0.01 * time
    holed = values.copy()
    holed[20:24] = np.nan  # from 9.5 to 12 s
    holed[50] = -9999.0
    dataset = xr.Dataset(
        {"u": ("time", holed, M_PER_S | {"_FillValue": -9999.0}), "w": ("time", values, M_PER_S)},
        {"time": ("time", time, {"units": "s"})},
    )
    dataset.to_netcdf(tmp_path / "a.nc")
    case = scenario(tmp_path / "a.nc")
    np.testing.assert_allclose(Prepared(case).recordings[0].velocity[:, 0, 0], values, rtol=1e-12)
    assert Prepared(case).notes() == [
        "flow.0: 6.25% of u is missing and was filled by straight lines, the longest gap 2.5 s"
    ]


def test_samples_that_the_file_leaves_out_are_gaps_too(tmp_path):
    time = np.delete(np.arange(0, 40, 0.5), slice(20, 30))
    values = 0.5 + 0.01 * time
    xr.Dataset(
        {"u": ("time", values, M_PER_S)}, {"time": ("time", time, {"units": "s"})}
    ).to_netcdf(tmp_path / "a.nc")
    case = scenario(tmp_path / "a.nc", velocity=["u", "0"])
    (recording,) = Prepared(case).recordings.values()
    np.testing.assert_allclose(recording.time, np.arange(0, 40, 0.5), atol=1e-12)
    np.testing.assert_allclose(recording.velocity[:, 0, 0], 0.5 + 0.01 * recording.time)
    assert "12.50% of u is missing" in Prepared(case).notes()[0]
    assert Prepared(case).notes()[0].endswith("the longest gap 5.5 s")


def test_units_that_a_file_does_not_name_are_assumed_and_said(tmp_path):
    time = np.arange(0, 40, 0.1)
    xr.Dataset({"u": ("time", wave(time))}, {"time": time}).to_netcdf(tmp_path / "a.nc")
    case = scenario(tmp_path / "a.nc", velocity=["u", "0"])
    assert Prepared(case).notes() == [
        "flow.0: time names no unit and is taken to be in seconds",
        "flow.0: u names no unit and is taken to be in m/s",
    ]


# --- profiles ----------------------------------------------------------------------------------

PROFILE = {"velocity": ["vel[E]", "vel[U1]"], "vertical": "range"}


def test_a_profile_is_played_at_its_heights(tmp_path):
    time, height = profile(tmp_path / "a.nc", interval=0.1)
    case = scenario(tmp_path / "a.nc", **PROFILE)
    (recording,) = Prepared(case).recordings.values()
    np.testing.assert_allclose(recording.levels, height - 20.0)
    points = np.stack([np.linspace(-3, 3, 19), -20.0 + height[:-1]], axis=1)  # the same along x
    velocity, _ = moves(case, points, 3.3)
    expected = np.stack([wave(3.3, height[:-1]), swell(3.3, height[:-1])], axis=1)
    np.testing.assert_allclose(velocity, expected, atol=1e-6)
    assert Prepared(case).notes() == []
    assert time[-1] == 40.0


def test_interpolation_in_height_is_of_fourth_order_inside(tmp_path):
    errors, z = [], np.linspace(-18.0, -12.0, 200)
    for thickness, levels in ((0.5, 20), (0.25, 40), (0.125, 80)):
        profile(tmp_path / "a.nc", thickness=thickness, levels=levels, interval=0.1)
        case = scenario(tmp_path / "a.nc", **PROFILE)
        velocity, _ = moves(case, np.stack([0 * z, z], axis=1), 2.0)
        errors.append(np.abs(velocity[:, 0] - wave(2.0, z + 20.0)).max())
    assert order(errors) == pytest.approx(4.0, abs=0.3)


def test_a_profile_is_constant_beyond_its_levels_and_has_no_kink(tmp_path):
    _, height = profile(tmp_path / "a.nc", levels=6)
    case = scenario(tmp_path / "a.nc", base=(0.0, -19.0), **PROFILE)
    flow = crinoid.system(case).forces.water.flows[0]
    ends = height[[0, -1]] - 20.0
    for end, out in zip(ends, (-1.0, 1.0), strict=True):
        velocity, _ = moves(case, [[0.0, end], [0.0, end + 0.3 * out], [0.0, end + 9.0 * out]], 2.0)
        np.testing.assert_allclose(velocity - velocity[0], 0.0, atol=1e-15)

    @jax.jit
    def slope(z):
        return jax.jvp(
            lambda z: flow.velocity(jnp.stack([0.0, z]), jnp.asarray(2.0)), (z,), (1.0,)
        )[1]

    for level in height - 20.0:
        below, above = slope(level - 1e-9), slope(level + 1e-9)
        np.testing.assert_allclose(below, above, atol=1e-7)


def test_the_acceleration_of_a_profile_is_that_of_a_drifting_particle(tmp_path):
    profile(tmp_path / "a.nc")
    case = scenario(tmp_path / "a.nc", **PROFILE)
    place, at, step = np.array([0.2, -13.1]), 3.3, 1e-4
    velocity, acceleration = moves(case, place, [at])
    ahead, behind = (
        moves(case, place + sign * step * velocity[0], [at + sign * step])[0][0]
        for sign in (1.0, -1.0)
    )
    # w du/dz is part of it, as the water rises through the shear
    np.testing.assert_allclose(acceleration[0], (ahead - behind) / (2 * step), atol=1e-6)
    assert abs(velocity[0, 1]) > 0.05


def test_levels_that_are_mostly_missing_go_and_are_named(tmp_path):
    def holes(velocity):
        velocity[0, 3, :50] = np.nan
        velocity[2, 7, 10] = np.nan

    _, height = profile(tmp_path / "a.nc", change=holes)
    case = scenario(tmp_path / "a.nc", **PROFILE)
    np.testing.assert_allclose(Prepared(case).recordings[0].levels, np.delete(height, 3) - 20.0)
    dropped, filled = Prepared(case).notes()
    assert dropped == "flow.0: most is missing at z = -18 m: left out"
    assert filled.startswith("flow.0: 0.06% of vel[U1] is missing")
    assert filled.endswith("the longest gap 1 s")


def test_an_arm_outside_the_levels_is_told(tmp_path):
    profile(tmp_path / "a.nc", levels=5)
    (note,) = Prepared(scenario(tmp_path / "a.nc", **PROFILE)).notes()
    assert note == (
        "flow.0: the arm at rest lies at z = -10 m and the levels at -19.5 to -17.5 m: "
        "outside, the current of the nearest level is taken"
    )


def test_levels_may_count_from_anywhere_and_downward(tmp_path):
    _, height = profile(tmp_path / "a.nc")
    up = Prepared(scenario(tmp_path / "a.nc", depth=None, origin=-12.0, **PROFILE)).recordings[0]
    np.testing.assert_allclose(up.levels, height - 12.0)
    case = scenario(tmp_path / "a.nc", origin=-2.0, **(PROFILE | {"vertical": "-range"}))
    down = Prepared(case).recordings[0]
    np.testing.assert_allclose(down.levels, (-2.0 - height)[::-1])
    np.testing.assert_allclose(
        down.velocity,
        up.velocity[:, ::-1],
        rtol=1e-12,
    )


@pytest.mark.parametrize("kind", ["point", "profile"])
def test_slopes_are_the_same_forth_and_back_and_those_of_differences(tmp_path, kind):
    if kind == "point":
        point(tmp_path / "a.nc", interval=0.5)
        case = scenario(tmp_path / "a.nc")
    else:
        profile(tmp_path / "a.nc")
        case = scenario(tmp_path / "a.nc", **PROFILE)
    water = crinoid.system(case).forces.water
    place = jnp.array([0.13, -10.21])

    @eqx.filter_jit
    def slopes(water, place, time):
        def acceleration(place, time):
            return water.current(place, time).acceleration

        modes = (jax.jacfwd, jax.jacrev)
        return [mode(acceleration, argnums=(0, 1))(place, time) for mode in modes]

    forward, backward = slopes(water, place, jnp.asarray(2.13))
    for one, other in zip(forward, backward, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
    step = 1e-5
    accelerations = moves(case, place, 2.13 + step * np.array([-1.0, 1.0]))[1]
    np.testing.assert_allclose(
        forward[1], (accelerations[1] - accelerations[0]) / (2 * step), atol=1e-6
    )


# --- models, and compass directions -------------------------------------------------------------


def test_an_ocean_model_is_met_at_the_nearest_place_by_depth_and_heading(tmp_path):
    grid(tmp_path / "a.nc")
    case = scenario(
        tmp_path / "a.nc",
        depth=None,
        duration=60.0,
        velocity=["eastward_sea_water_velocity", "northward_sea_water_velocity", "0"],
        vertical="depth",
        heading_deg=90.0,
        select={"lat": 48.4, "lon": -123.4},
    )
    (recording,) = Prepared(case).recordings.values()
    np.testing.assert_allclose(recording.levels, [-20.0, -10.0, -5.0, -2.0, 0.0])
    # latitude 48.5 and longitude 236.5, in m/s
    seconds = np.arange(20) * 10.0
    expected = 0.01 * (0.01 * seconds[:, None] + 0.1 * -recording.levels + 4.2)
    np.testing.assert_allclose(recording.time, seconds, atol=1e-6)
    np.testing.assert_allclose(recording.velocity[..., 0], expected, rtol=1e-6)
    assert not recording.velocity[..., 1].any()
    assert "cross the plane that the arm moves in" in Prepared(case).notes()[0]


@pytest.mark.parametrize(
    ("heading", "along"), [(0.0, 0.2), (90.0, 0.5), (180.0, -0.2), (45.0, 0.7 / np.sqrt(2))]
)
def test_a_compass_heading_turns_east_and_north_into_x(tmp_path, heading, along):
    time = np.arange(0.0, 30.0)
    steady = np.ones_like(time)
    dataset = xr.Dataset(
        {
            name: ("time", value * steady, M_PER_S)
            for name, value in (("e", 0.5), ("n", 0.2), ("up", 0.1))
        },
        {"time": ("time", time, {"units": "s"})},
    )
    dataset.to_netcdf(tmp_path / "a.nc")
    case = scenario(tmp_path / "a.nc", velocity=["e", "n", "up"], heading_deg=heading)
    np.testing.assert_allclose(
        Prepared(case).recordings[0].velocity[:, 0], [[along, 0.1]] * time.size
    )


# --- in space ----------------------------------------------------------------------------------

TURN = np.deg2rad(30.0)
COMPASS = {"velocity": ["u", "v", "w"], "heading_deg": 60.0}
"""x points 60 degrees from north, 30 degrees north of east."""


def spatial(case):
    """Return the same scenario for an arm that moves in space, its base 0.4 m to port."""
    x, z = case.base.position
    arm = case.arm.model_copy(update={"dimension": 3})
    base = case.base.model_copy(update={"position": (x, 0.4, z)})
    return case.model_copy(update={"arm": arm, "base": base})


def three(path, *, height=None):
    """Write a record, or a profile, with three components that are known functions."""
    time = np.arange(1601) * 0.05 if height is None else np.arange(401) * 0.1
    level = 0.0 if height is None else height[:, None]
    dims = ("time",) if height is None else ("range", "time")
    coordinates = {"time": ("time", time, {"units": "s"})}
    if height is not None:
        coordinates["range"] = ("range", height, {"units": "m"})
    values = dict(zip("uvw", enu(time, level), strict=True))
    xr.Dataset(
        {name: (dims, series, M_PER_S) for name, series in values.items()}, coordinates
    ).to_netcdf(path)
    return time


def enu(time, level=0.0):
    """East, north and up (m/s)."""
    return wave(time, level), 0.5 * wave(time + 1.7, level), swell(time, level)


def turned(east, north, up):
    """The same along x, y (to port of x) and z."""
    along = np.cos(TURN) * east + np.sin(TURN) * north
    return np.stack([along, -np.sin(TURN) * east + np.cos(TURN) * north, up], axis=-1)


def played(case):
    return Water((build_flow(case, 0, case.flow[0], Prepared(case).recordings[0]),))


def test_a_point_record_is_carried_past_a_spatial_arm_whichever_way_it_goes(tmp_path):
    time = three(tmp_path / "a.nc")
    case = spatial(scenario(tmp_path / "a.nc", **COMPASS))
    (recording,) = Prepared(case).recordings.values()
    known = turned(*enu(time))
    np.testing.assert_allclose(recording.velocity[:, 0], known, atol=1e-12)
    mean = known.mean(axis=0)
    assert abs(mean[1]) > 0.01
    np.testing.assert_allclose(recording.slowness, mean / (mean @ mean), rtol=1e-9)
    assert Prepared(case).notes() == []  # nothing crosses an arm that moves in space
    away = np.array([[0.0, 0.0, 0.0], [0.3, -0.2, 0.1], [-0.1, 0.4, 0.2]])
    at = recording.begins + 3.0 - away @ recording.slowness
    water, places = played(case), jnp.asarray(away + np.array([0.0, 0.4, -10.0]))
    velocity, acceleration = _moves(water, places, jnp.full(3, 3.0))
    np.testing.assert_allclose(velocity, turned(*enu(at)), atol=2e-7)
    # frozen: Du/Dt = R' (1 - u . U / |U|^2)
    step = 1e-3
    rate = (turned(*enu(at + step)) - turned(*enu(at - step))) / (2 * step)
    expected = rate * (1 - np.asarray(velocity) @ recording.slowness)[:, None]
    np.testing.assert_allclose(acceleration, expected, atol=2e-5)


def test_a_profile_is_the_same_all_over_a_height_and_lifts_faster_water(tmp_path):
    height = 0.5 + 0.5 * np.arange(20)
    three(tmp_path / "a.nc", height=height)
    case = spatial(scenario(tmp_path / "a.nc", vertical="range", **COMPASS))
    rng = np.random.default_rng(4)
    points = rng.uniform([-3, -3, -19], [3, 3, -11], (40, 3))
    velocity, acceleration = _moves(played(case), jnp.asarray(points), jnp.full(40, 3.3))
    level = points[:, 2] + 20.0
    np.testing.assert_allclose(velocity, turned(*enu(3.3, level)), atol=1e-5)

    def known(time, level):
        return turned(*enu(time, level))

    step = 1e-3
    rate = (known(3.3 + step, level) - known(3.3 - step, level)) / (2 * step)
    slope = (known(3.3, level + step) - known(3.3, level - step)) / (2 * step)
    expected = rate + np.asarray(velocity)[:, 2:] * slope
    np.testing.assert_allclose(acceleration, expected, atol=2e-4)
    assert np.abs(np.asarray(velocity)[:, 2:] * slope).max() > 3e-3  # told apart from none


def test_the_plane_of_a_spatial_record_is_the_planar_one(tmp_path):
    three(tmp_path / "a.nc")
    flat = scenario(tmp_path / "a.nc", **COMPASS)
    full = spatial(scenario(tmp_path / "a.nc", **COMPASS))
    planar, whole = Prepared(flat).recordings[0], Prepared(full).recordings[0]
    np.testing.assert_array_equal(planar.velocity, whole.velocity[..., [0, 2]])
    np.testing.assert_array_equal(planar.slowness, whole.slowness[[0, 2]])
    assert "cross the plane" in Prepared(flat).notes()[0]


def test_a_spatial_arm_reaches_as_far_as_its_base_travels(tmp_path):
    case = spatial(scenario(tmp_path / "a.nc"))
    shifts = {"slide": (0.0, 0.3), "heave": (-0.4, 0.1)}
    motion = [{"kind": "sine", "channel": "heave", "amplitude": 0.8, "frequency_hz": 1.0}]
    base = {"channels": {name: {"range": ends} for name, ends in shifts.items()}, "motion": motion}
    moved = Scenario(arm={"length": 0.5}, base=base)
    assert Stage.of(moved, {}).reach == pytest.approx(1.1 * 0.5 + np.hypot(0.3, 1.2))
    (heaving,) = moved.base.motion
    swaying = heaving.model_copy(update={"channel": "sway"})
    update = {"channels": moved.base.channels, "motion": (heaving, swaying)}
    whole = case.model_copy(update={"base": case.base.model_copy(update=update)})
    assert Stage.of(whole, {}).reach == pytest.approx(1.1 * 0.5 + np.linalg.norm([0.3, 0.8, 1.2]))
    assert Stage.of(whole, {}).heights == (-10.0, -10.0)


# --- what is refused ---------------------------------------------------------------------------


def broken(path):
    point(path)
    path.write_bytes(path.read_bytes()[:3000])


def backwards(path):
    point(path)
    with xr.open_dataset(path, decode_times=False) as stored:
        dataset = stored.load()
    time = dataset["time"].values.copy()
    time[17] = time[16]
    dataset.assign_coords(time=("time", time, {"units": "s"})).to_netcdf(path)


def constant(**changes):
    """Write a record of 0.3 m/s with something changed."""

    def write(path):
        time = np.arange(100.0)
        values = {"u": np.full(100, 0.3), "units": "m/s", "time": time} | changes
        xr.Dataset(
            {"u": ("time", values["u"], {"units": values["units"]})},
            {"time": ("time", values["time"], {"units": "s"})},
        ).to_netcdf(path)

    return write


def curvilinear(path):
    time = np.arange(100.0)
    xr.Dataset(
        {"u": (("time", "eta"), np.ones((100, 3)), M_PER_S)},
        {"time": ("time", time, {"units": "s"})},
    ).to_netcdf(path)


def two_alike(path):
    time = np.arange(100.0)
    named = M_PER_S | {"standard_name": "sea_water_speed"}
    xr.Dataset(
        dict.fromkeys(("a", "b"), ("time", 0 * time, named)),
        {"time": ("time", time, {"units": "s"})},
    ).to_netcdf(path)


ONE = {"velocity": ["u", "0"]}
REFUSED = {
    "no file": (lambda path: None, {}, "flow.0.file: PATH: no such file"),
    "a folder": (Path.mkdir, {}, "flow.0.file: a.nc is a folder, takes a CSV or netCDF file"),
    "text": (
        lambda path: path.write_text("u, w\n1, 2"),
        {},
        "flow.0.file: a.nc is broken or no netCDF file (NetCDF: Unknown file format)",
    ),
    "cut short": (broken, {}, "flow.0.file: a.nc is broken or no netCDF file (NetCDF: HDF error)"),
    "a variable that is near": (
        point,
        {"velocity": ["uu", "w"]},
        'flow.0.velocity.0: got "uu", no such variable in a.nc; did you mean u?',
    ),
    "a variable like no other": (
        point,
        {"velocity": ["u", "vertical"]},
        'flow.0.velocity.1: got "vertical", no such variable in a.nc; it holds u, w, time',
    ),
    "several of a standard name": (
        two_alike,
        {"velocity": ["sea_water_speed", "0"]},
        'flow.0.velocity.0: got "sea_water_speed", which several variables are; takes a, b',
    ),
    "no time": (point, {"time": "t"}, 'flow.0.time: got "t", no such variable in a.nc'),
    "times that repeat": (
        backwards,
        {},
        "flow.0.time: time repeats at entry 17, takes times that increase",
    ),
    "times that go back": (
        constant(time=np.arange(100.0)[::-1]),
        ONE,
        "flow.0.time: time goes back at entry 1, takes times that increase",
    ),
    "one instant": (
        lambda path: constant(time=[0.0], u=[0.3])(path),
        ONE,
        "flow.0.time: time holds 1 instant, takes 2 or more",
    ),
    "no instant": (
        lambda path: constant(time=np.zeros(0), u=np.zeros(0))(path),
        ONE,
        "flow.0.time: time holds 0 instants, takes 2 or more",
    ),
    "a unit of something else": (
        constant(units="knots"),
        ONE,
        'flow.0.velocity.0: u is in "knots", takes a unit such as m/s',
    ),
    "all missing": (
        constant(u=np.full(100, np.nan)),
        ONE,
        "flow.0.file: 100% of u is missing, takes a record of which half is there",
    ),
    "mostly missing": (
        constant(u=np.where(np.arange(100) < 70, np.nan, 0.3)),
        ONE,
        "flow.0.file: 70% of u is missing, takes a record of which half is there",
    ),
    "bursts": (
        constant(time=np.arange(100.0) + 1e4 * (np.arange(100) > 50)),
        ONE,
        "flow.0.time: most samples are missing at the usual interval of 1 s; takes a record in "
        "one piece: cut one out",
    ),
    "missing values that are not marked": (
        constant(u=np.where(np.arange(100) == 70, -9999.0, 0.3)),
        ONE,
        "flow.0.velocity.0: u reaches 9999 m/s, takes up to 50; missing values take a _FillValue "
        "that marks them",
    ),
    "too short": (
        constant(),
        ONE | {"duration": 120.0, "skip": 5.0},
        "flow.0.file: a.nc lasts 99 s, takes 126.833 s: simulation.duration / time_scale = 120 s, "
        "skip = 5 s, 1.833 s for being carried past the arm",
    ),
    "too short to be carried past": (
        point,
        {"duration": 39.0},
        "flow.0.file: a.nc lasts 40 s, takes 41.",
    ),
    "skipped": (
        constant(),
        ONE | {"skip": 99.0},
        "flow.0.skip: got 99.0, takes less than 99 (s), the record's length",
    ),
    "a profile without its levels": (
        profile,
        {"velocity": ["vel[E]", "vel[U1]"]},
        "flow.0.velocity.0: vel also runs over range (0.5 to 10); takes select = {range = ...}, or "
        'vertical = "range" for a profile',
    ),
    "no entry": (
        profile,
        {"velocity": ["vel", "0"], "vertical": "range"},
        "flow.0.velocity.0: vel also runs over dir (E, N, U1, U2); takes an entry, such as "
        '"vel[E]"',
    ),
    "another entry": (
        profile,
        {"velocity": ["vel[X]", "0"], "vertical": "range"},
        'flow.0.velocity.0: vel has no entry "X"; its entries are dir: E, N, U1, U2',
    ),
    "an entry of nothing": (
        constant(),
        {"velocity": ["u[E]", "0"]},
        'flow.0.velocity.0: u has no entry "E"; it has no labelled dimension',
    ),
    "levels without an origin": (
        profile,
        PROFILE | {"depth": None},
        "flow.0.origin: missing, takes the z from which range counts (m), or water.depth: the bed",
    ),
    "levels of another variable": (
        constant(),
        ONE | {"vertical": "time"},
        'flow.0.vertical: time is in "s", takes a unit such as m',
    ),
    "a place outside": (
        grid,
        {"velocity": ["uo", "0"], "vertical": "depth", "select": {"lat": 12.0, "lon": 236.0}},
        "flow.0.select.lat: got 12, takes 48 to 48.5",
    ),
    "a place to choose": (
        grid,
        {"velocity": ["uo", "0"], "vertical": "depth", "select": {"lat": 48.0}},
        "flow.0.velocity.0: uo also runs over lon (236 to 237); takes select = {lon = ...}",
    ),
    "a dimension that is not there": (
        grid,
        {
            "velocity": ["uo", "0"],
            "vertical": "depth",
            "select": {"lat": 48.0, "lon": 236.0, "mooring": 1},
        },
        "flow.0.select.mooring: no dimension to select in; takes lat, lon",
    ),
    "an index to choose": (
        curvilinear,
        ONE,
        "flow.0.velocity.0: u also runs over eta; takes select = {eta = ...}, an index from 0 to 2",
    ),
    "an index outside": (
        curvilinear,
        ONE | {"select": {"eta": 3}},
        "flow.0.select.eta: got 3, takes an index from 0 to 2",
    ),
}


@pytest.mark.parametrize(("write", "keys", "line"), REFUSED.values(), ids=REFUSED.keys())
def test_what_a_file_does_not_give_is_refused_in_one_line(tmp_path, write, keys, line):
    path = tmp_path / "a.nc"
    write(path)
    assert refusal(scenario(path, **keys)).startswith(line.replace("PATH", str(path)))


def test_a_large_file_is_refused_before_it_is_read(tmp_path, monkeypatch):
    point(tmp_path / "a.nc")
    monkeypatch.setattr("crinoid.recording.opening.MAX_VALUES", 500)
    line = refusal(scenario(tmp_path / "a.nc"))
    assert line == (
        "flow.0.file: a.nc holds 802 values of this current, takes up to 500; cut out the part "
        "that is needed"
    )


def test_two_files_at_fault_give_a_line_each(tmp_path):
    flows = [{"kind": "measured", "file": str(tmp_path / name)} for name in ("a.nc", "b.nc")]
    with pytest.raises(ScenarioError) as caught:
        Prepared(Scenario(flow=[{"kind": "uniform", "velocity": [0, 0]}, *flows])).notes()
    assert [line.split(":")[0] for line in caught.value.lines] == ["flow.1.file", "flow.2.file"]


# --- where a path starts -----------------------------------------------------------------------


def test_paths_start_from_the_scenario_file_or_from_here(tmp_path, monkeypatch):
    (tmp_path / "deep").mkdir()
    file = tmp_path / "deep" / "mine.toml"
    file.write_text(
        '[[flow]]\nkind = "measured"\nfile = "a.nc"\n[vary]\n"flow.0.file" = ["b.nc", "/c.nc"]\n'
        'flow = [[{kind = "measured", file = "d.nc"}]]'
    )
    monkeypatch.chdir(tmp_path)
    case = load("deep/mine.toml")
    here = str(tmp_path)
    assert case.flow[0].file == f"{here}/deep/a.nc"
    assert case.vary["flow.0.file"] == [f"{here}/deep/b.nc", "/c.nc"]
    assert case.vary["flow"][0][0]["file"] == f"{here}/deep/d.nc"
    case = load("deep/mine.toml", ["flow.0.file=e.nc", "vary={}"])
    assert case.flow[0].file == f"{here}/e.nc"
    assert Scenario.from_toml(case.to_toml()) == case
    assert Scenario(flow=case.flow).flow[0].file == f"{here}/e.nc"


# --- files that were measured ------------------------------------------------------------------


@real_data
def test_the_velocimeter_of_admiralty_inlet():
    case = scenario(DATA / "admiralty_inlet_adv.nc", velocity=["u", "w"], duration=590.0)
    (recording,) = Prepared(case).recordings.values()
    with xr.open_dataset(DATA / "admiralty_inlet_adv.nc") as stored:
        for axis, name in enumerate("uw"):
            np.testing.assert_array_equal(recording.velocity[:, 0, axis], stored[name])
    assert recording.interval == 0.125
    assert Prepared(case).notes() == []
    # at the samples' own times
    velocity, _ = moves(case, [0.0, -10.0], recording.run_time[10:200])
    np.testing.assert_allclose(velocity, recording.velocity[10:200, 0], atol=1e-12)


@real_data
def test_the_profile_of_a_tidal_current():
    case = scenario(DATA / "tidal_adcp_profile.nc", duration=90.0, **PROFILE)
    (recording,) = Prepared(case).recordings.values()
    assert recording.levels.size == 28
    with xr.open_dataset(DATA / "tidal_adcp_profile.nc", decode_times=False) as stored:
        east = stored["vel"].sel(dir="E").transpose("time", "range").values
    there = np.isfinite(east)
    np.testing.assert_array_equal(recording.velocity[..., 0][there], east[there])
    points = np.stack([np.zeros(28), recording.levels], axis=1)
    velocity, _ = moves(case, points, recording.run_time[7])
    np.testing.assert_allclose(velocity, recording.velocity[7], atol=1e-12)
