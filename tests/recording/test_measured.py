"""Measured currents: files of every layout, what is mended and said, and the flow.

The currents in the files are known functions, so that what is played can be compared with them.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.arrays import build_flow
from crinoid.assembly.prepared import Prepared
from crinoid.flow import Water
from crinoid.recording.recording import base_travel
from crinoid.scenario import Scenario, load
from helpers.arms import order
from helpers.measured import BASES, M_PER_S, enu, measured, point, profile, recorded, wave, write
from helpers.paths import ROOT

DATA = ROOT.parent / "shared" / "data"
real_data = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the measured records are not there: {DATA}"
)

# in space x points 60 degrees from north, 30 degrees north of east
TURN = np.deg2rad(30.0)
POINT = {2: {}, 3: {"velocity": ["u", "v", "w"], "heading_deg": 60.0}}
PROFILE = {
    2: {"velocity": ["vel[E]", "vel[U1]"], "vertical": "range"},
    3: {"velocity": ["vel[E]", "vel[N]", "vel[U1]"], "vertical": "range", "heading_deg": 60.0},
}
PLANE_AND_SPACE = pytest.mark.parametrize("axes", [2, 3])


def known(axes, time, level=0.0):
    """Return what `POINT` and `PROFILE` make of the records: along x and z, or x, y, z."""
    east, north, up = enu(time, level)
    if axes == 2:
        return np.stack([east, up], axis=-1)
    along = np.cos(TURN) * east + np.sin(TURN) * north
    return np.stack([along, -np.sin(TURN) * east + np.cos(TURN) * north, up], axis=-1)


@eqx.filter_jit
def _moves(water: Water, points: jax.Array, times: jax.Array):
    currents = jax.vmap(water.current)(points, times)
    return currents.velocity, currents.acceleration


def moves(case, points, times):
    """Return velocities and material accelerations at points and times, one each."""
    points, times = np.broadcast_arrays(points, np.asarray(times, float)[..., None])
    water = Water((build_flow(case, 0, case.flow[0], recorded(case)),))
    return jax.tree.map(np.asarray, _moves(water, jnp.asarray(points), jnp.asarray(times[..., 0])))


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
    keys = {"units": units, "time_units": time_units}
    write(tmp_path / "a.nc", 1e4 + time * per_second, u=factor * wave(time), **keys)
    recording = recorded(measured(tmp_path / "a.nc", velocity=["u", "0"]))
    np.testing.assert_allclose(recording.time, time, atol=1e-5)  # days: round-off of the file
    np.testing.assert_allclose(recording.velocity[:, 0, 0], wave(time), rtol=1e-12)
    assert not recording.velocity[:, 0, 1].any()
    assert recording.notes == ()


@PLANE_AND_SPACE
def test_a_frozen_pattern_accelerates_the_water_by_its_fluctuation_only(tmp_path, axes):
    time = point(tmp_path / "a.nc", interval=0.05, length=80.0)
    case = measured(tmp_path / "a.nc", axes, **POINT[axes])
    recording = recorded(case)
    np.testing.assert_allclose(recording.velocity[:, 0], known(axes, time), atol=1e-12)
    # met later by the distance along the mean current over its speed
    mean = known(axes, time).mean(axis=0)
    assert abs(mean[1]) > (0.01 if axes == 3 else 0.0)
    np.testing.assert_allclose(recording.slowness, mean / (mean @ mean), rtol=1e-9)
    assert Prepared(case).notes() == []  # nothing crosses an arm that moves in space
    away = np.array([[0.0, 0.0, 0.0], [0.3, -0.2, 0.1], [-0.1, 0.4, 0.2]])[:, :axes]
    at = recording.start + 3.0 - away @ recording.slowness
    velocity, acceleration = moves(case, away + BASES[axes], 3.0)
    np.testing.assert_allclose(velocity, known(axes, at), atol=2e-7)
    # Du/Dt = u_t + (u . grad) u = R' (1 - u . U / |U|^2): none where the water drifts along
    step = 1e-3
    rate = (known(axes, at + step) - known(axes, at - step)) / (2 * step)
    expected = rate * (1 - velocity @ recording.slowness)[:, None]
    np.testing.assert_allclose(acceleration, expected, atol=2e-5)


@pytest.mark.parametrize("speed", [1.5, -0.8])
@PLANE_AND_SPACE
def test_a_record_with_a_phase_speed_is_delayed_along_x(tmp_path, axes, speed):
    point(tmp_path / "a.nc", interval=0.05, length=80.0)
    profile(tmp_path / "b.nc", interval=0.05)
    away = np.array([[0.0, 0.0, 0.0], [0.3, -0.2, 0.1], [-0.1, 0.4, 0.2]])[:, :axes]
    for name, keys, level in (
        ("a.nc", POINT[axes], lambda height: 0.0),
        ("b.nc", PROFILE[axes], lambda height: 20.0 + height),
    ):
        base = (*BASES[axes][:-1], -12.0)
        places = away + base
        case = measured(tmp_path / name, axes, base=base, skip=5.0, phase_speed=speed, **keys)
        recording = recorded(case)
        assert recording.notes == ()
        assert recording.start == max(5.0, 1.1 * 0.5 / abs(speed))
        at = recording.start + 3.0 - away[:, 0] / speed
        heights = level(places[:, -1])
        velocity, acceleration = moves(case, places, 3.0)
        np.testing.assert_allclose(velocity, known(axes, at, heights), atol=2e-5)
        # Du/Dt = u_t (1 - u_x / c) + u_z du/dz
        step = 1e-3
        rate = (known(axes, at + step, heights) - known(axes, at - step, heights)) / (2 * step)
        expected = rate * (1 - velocity[:, :1] / speed)
        if name == "b.nc":
            above, below = (known(axes, at, heights + way) for way in (step, -step))
            expected = expected + velocity[:, -1:] * (above - below) / (2 * step)
        np.testing.assert_allclose(acceleration, expected, atol=5e-4)
    # the water at the base is its uniform part, and other flows do not carry the record
    (flow,) = crinoid.system(case).forces.water.flows
    assert not flow.drifts


def test_interpolation_in_time_is_of_fourth_order(tmp_path):
    errors = []
    times = np.linspace(0.0, 10.0, 400)
    for interval in (0.8, 0.4, 0.2):
        point(tmp_path / "a.nc", interval=interval)
        case = measured(tmp_path / "a.nc")
        velocity, _ = moves(case, BASES[2], times)
        errors.append(np.abs(velocity - known(2, recorded(case).start + times)).max())
    assert order(errors) == pytest.approx(4.0, abs=0.5)


def test_the_arm_is_covered_from_the_first_moment_to_the_last(tmp_path):
    # nowhere within reach, at no time of the run, is the record's end held on to
    point(tmp_path / "a.nc", length=14.0)
    case = measured(tmp_path / "a.nc", base=(1.0, -3.0))
    record = crinoid.system(case).forces.water.flows[0].record
    recording = recorded(case)
    farthest = 1.1 * 0.5 * np.linalg.norm(recording.slowness)
    assert float(record.knots[0]) <= -farthest
    assert float(record.knots[-1]) >= 10.0 + farthest
    assert recording.start == pytest.approx(farthest)
    # the same run, prolonged, plays the same current
    longer = measured(tmp_path / "a.nc", base=(1.0, -3.0), duration=10.5)
    times = np.linspace(0, 10, 37)
    both = [moves(each, [1.2, -3.1], times)[0] for each in (case, longer)]
    np.testing.assert_array_equal(*both)


def test_skip_and_scales(tmp_path):
    point(tmp_path / "a.nc", interval=0.05, length=80.0)
    case = measured(tmp_path / "a.nc", skip=12.0, velocity_scale=0.5, time_scale=0.25)
    times = np.linspace(0.0, 10.0, 50)
    velocity, _ = moves(case, BASES[2], times)
    np.testing.assert_allclose(velocity, 0.5 * known(2, 12.0 + times / 0.25), atol=1e-6)
    # half as fast, a quarter of the time: carried past the arm at half the mean velocity
    assert 1 / np.linalg.norm(recorded(case).slowness) == pytest.approx(0.2, rel=0.05)


def test_names_may_be_standard_ones_and_turned_round(tmp_path):
    time = point(tmp_path / "a.nc")
    recording = recorded(measured(tmp_path / "a.nc", velocity=["-sea_water_x", "w"]))
    np.testing.assert_allclose(recording.velocity[:, 0, 0], -wave(time), rtol=1e-12)


def test_where_the_mean_is_small_the_water_moves_as_one_and_a_note_says_so(tmp_path):
    time = np.arange(0, 40, 0.1)
    write(tmp_path / "a.nc", time, u=0.1 * np.sin(2 * np.pi * time / 4.0) + 0.01)
    case = measured(tmp_path / "a.nc", velocity=["u", "0"])
    velocity, _ = moves(case, [[0.0, -10.0], [0.5, -10.0]], 3.0)
    np.testing.assert_array_equal(velocity[0], velocity[1])
    (note,) = Prepared(case).notes()
    assert note.startswith(
        "flow.0: fluctuations of 0.05 m/s about a mean of 0.01 m/s are no frozen"
    )


def test_a_low_pass_removes_the_fast_and_delays_nothing(tmp_path):
    time = np.arange(0, 100, 0.1)
    slow, fast = (0.2 * np.sin(2 * np.pi * time * frequency) for frequency in (0.1, 3.0))
    write(tmp_path / "a.nc", time, u=1.0 + slow + fast)
    keys = {"velocity": ["u", "0"], "low_pass_hz": 1.0}
    recording = recorded(measured(tmp_path / "a.nc", **keys))
    inner = slice(50, -50)
    np.testing.assert_allclose(recording.velocity[inner, 0, 0], (1.0 + slow)[inner], atol=1e-4)


# --- gaps --------------------------------------------------------------------------------------


def test_samples_that_the_file_leaves_out_are_gaps_too(tmp_path):
    time = np.delete(np.arange(0, 40, 0.5), slice(20, 30))
    write(tmp_path / "a.nc", time, u=0.5 + 0.01 * time)
    case = measured(tmp_path / "a.nc", velocity=["u", "0"])
    recording = recorded(case)
    np.testing.assert_allclose(recording.time, np.arange(0, 40, 0.5), atol=1e-12)
    np.testing.assert_allclose(recording.velocity[:, 0, 0], 0.5 + 0.01 * recording.time)
    note = Prepared(case).notes()[0]
    assert "12.50% of u is missing" in note
    assert note.endswith("the longest gap 5.5 s")


# --- profiles ----------------------------------------------------------------------------------


@PLANE_AND_SPACE
def test_a_profile_is_the_same_all_over_a_height_and_lifts_faster_water(tmp_path, axes):
    height = profile(tmp_path / "a.nc", interval=0.1)
    case = measured(tmp_path / "a.nc", axes, **PROFILE[axes])
    np.testing.assert_allclose(recorded(case).levels, height - 20.0)
    assert Prepared(case).notes() == []
    rng = np.random.default_rng(4)
    points = rng.uniform([-3, -3, -19][-axes:], [3, 3, -11][-axes:], (40, axes))
    points[:18, -1] = height[1:-1] - 20.0  # there is a kink at the ends
    velocity, acceleration = moves(case, points, 3.3)
    expected = known(axes, 3.3, points[:, -1] + 20.0)
    np.testing.assert_allclose(velocity[:18], expected[:18], atol=1e-6)
    np.testing.assert_allclose(velocity, expected, atol=1e-5)
    # that of a drifting particle: w du/dz is part of it, as the water rises through the shear
    step = 1e-4
    ahead, behind = (
        moves(case, points + sign * step * velocity, 3.3 + sign * step)[0] for sign in (1.0, -1.0)
    )
    np.testing.assert_allclose(acceleration, (ahead - behind) / (2 * step), atol=1e-6)
    assert np.abs(velocity[:, -1]).max() > 0.05


def test_interpolation_in_height_is_of_fourth_order_inside(tmp_path):
    errors, z = [], np.linspace(-18.0, -12.0, 200)
    for thickness, levels in ((0.5, 20), (0.25, 40), (0.125, 80)):
        profile(tmp_path / "a.nc", thickness=thickness, levels=levels, interval=0.1)
        case = measured(tmp_path / "a.nc", **PROFILE[2])
        velocity, _ = moves(case, np.stack([0 * z, z], axis=1), 2.0)
        errors.append(np.abs(velocity[:, 0] - wave(2.0, z + 20.0)).max())
    assert order(errors) == pytest.approx(4.0, abs=0.3)


def test_a_profile_is_constant_beyond_its_levels_and_has_no_kink_between(tmp_path):
    height = profile(tmp_path / "a.nc", levels=6)
    case = measured(tmp_path / "a.nc", base=(0.0, -19.0), **PROFILE[2])
    ends = height[[0, -1]] - 20.0
    for end, out in zip(ends, (-1.0, 1.0), strict=True):
        velocity, _ = moves(case, [[0.0, end], [0.0, end + 0.3 * out], [0.0, end + 9.0 * out]], 2.0)
        np.testing.assert_allclose(velocity - velocity[0], 0.0, atol=1e-15)
    flow = crinoid.system(case).forces.water.flows[0]

    @jax.jit
    def slope(z):
        return jax.jvp(
            lambda z: flow.velocity(jnp.stack([0.0, z]), jnp.asarray(2.0)), (z,), (1.0,)
        )[1]

    for level in height[1:-1] - 20.0:
        below, above = slope(level - 1e-9), slope(level + 1e-9)
        np.testing.assert_allclose(below, above, atol=1e-7)


def test_a_straight_profile_is_straight_to_its_ends(tmp_path):
    z = np.array([-19.0, -17.5, -17.0, -14.0, -12.0])
    speed = 0.1 + 0.05 * (z + 19.0)
    time = np.arange(0.0, 40.0, 0.5)
    xr.Dataset(
        {"u": (("time", "z"), np.tile(speed, (time.size, 1)), M_PER_S)},
        {"time": ("time", time, {"units": "s"}), "z": ("z", z, {"units": "m"})},
    ).to_netcdf(tmp_path / "a.nc")
    case = measured(tmp_path / "a.nc", velocity=["u", "0"], vertical="z", base=(0.0, -19.0))
    at = np.linspace(-19.0, -12.0, 29)
    velocity, _ = moves(case, np.stack([0 * at, at], axis=1), 2.0)
    np.testing.assert_allclose(velocity[:, 0], 0.1 + 0.05 * (at + 19.0), rtol=0, atol=1e-12)


def test_a_note_names_levels_that_are_mostly_missing_and_left_out(tmp_path):
    def holes(velocity):
        velocity[0, 3, :50] = np.nan
        velocity[2, 7, 10] = np.nan

    height = profile(tmp_path / "a.nc", change=holes)
    case = measured(tmp_path / "a.nc", **PROFILE[2])
    np.testing.assert_allclose(recorded(case).levels, np.delete(height, 3) - 20.0)
    dropped, filled = Prepared(case).notes()
    assert dropped == "flow.0: most is missing at z = -18 m: left out"
    assert filled.startswith("flow.0: 0.06% of vel[U1] is missing")
    assert filled.endswith("the longest gap 1 s")


def test_an_arm_outside_the_levels_gets_a_note(tmp_path):
    profile(tmp_path / "a.nc", levels=5)
    assert Prepared(measured(tmp_path / "a.nc", **PROFILE[2])).notes() == [
        "flow.0: the arm at rest is at z = -10 m and the levels at -19.5 to -17.5 m: "
        "outside, the current of the nearest level is taken"
    ]


def test_levels_may_count_from_anywhere_and_downward(tmp_path):
    height = profile(tmp_path / "a.nc")
    up = recorded(measured(tmp_path / "a.nc", depth=None, origin=-12.0, **PROFILE[2]))
    np.testing.assert_allclose(up.levels, height - 12.0)
    keys = PROFILE[2] | {"vertical": "-range"}
    down = recorded(measured(tmp_path / "a.nc", origin=-2.0, **keys))
    np.testing.assert_allclose(down.levels, (-2.0 - height)[::-1])
    np.testing.assert_allclose(down.velocity, up.velocity[:, ::-1], rtol=1e-12)


@eqx.filter_jit
def _slopes(water, place, time):
    """Return how the acceleration changes with place and time, forth and back."""

    def acceleration(place, time):
        return water.current(place, time).acceleration

    return [mode(acceleration, argnums=(0, 1))(place, time) for mode in (jax.jacfwd, jax.jacrev)]


@pytest.mark.parametrize(("write", "keys"), [(point, {}), (profile, PROFILE[2])])
def test_slopes_are_the_same_forth_and_back_and_those_of_differences(tmp_path, write, keys):
    write(tmp_path / "a.nc", interval=0.5)
    case = measured(tmp_path / "a.nc", **keys)
    place = jnp.array([0.13, -10.21])
    forward, backward = _slopes(crinoid.system(case).forces.water, place, jnp.asarray(2.13))
    for one, other in zip(forward, backward, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
    step = 1e-5
    early, late = moves(case, place, 2.13 + step * np.array([-1.0, 1.0]))[1]
    np.testing.assert_allclose(forward[1], (late - early) / (2 * step), atol=1e-6)


# --- compass directions --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("heading", "along"), [(0.0, 0.2), (90.0, 0.5), (180.0, -0.2), (45.0, 0.7 / np.sqrt(2))]
)
def test_a_compass_heading_turns_east_and_north_into_x(tmp_path, heading, along):
    time = np.arange(0.0, 30.0)
    write(tmp_path / "a.nc", time, e=0 * time + 0.5, n=0 * time + 0.2, up=0 * time + 0.1)
    case = measured(tmp_path / "a.nc", velocity=["e", "n", "up"], heading_deg=heading)
    np.testing.assert_allclose(recorded(case).velocity[:, 0], [[along, 0.1]] * time.size)


def test_the_plane_of_a_spatial_record_is_the_planar_one(tmp_path):
    point(tmp_path / "a.nc")
    flat, full = (measured(tmp_path / "a.nc", axes, **POINT[3]) for axes in (2, 3))
    planar, whole = recorded(flat), recorded(full)
    np.testing.assert_array_equal(planar.velocity, whole.velocity[..., [0, 2]])
    np.testing.assert_array_equal(planar.slowness, whole.slowness[[0, 2]])
    assert "cross the plane" in Prepared(flat).notes()[0]


@PLANE_AND_SPACE
def test_a_base_travels_as_far_as_channels_and_motions_together(axes):
    sine = {"kind": "sine", "amplitude": 0.8, "frequency_hz": 1.0}
    channels = {"slide": {"range": (0.0, 0.3)}, "heave": {"range": (-0.4, 0.1)}}
    motion = [sine | {"channel": channel} for channel in ("heave", "sway")[: axes - 1]]
    base = {"channels": channels, "motion": motion}
    scenario = Scenario(arm={"length": 0.5, "dimension": axes}, base=base)
    travel = np.linalg.norm([0.3, 1.2, 0.8][:axes])
    assert base_travel(scenario, {}) == pytest.approx(travel)


# --- where a path starts -----------------------------------------------------------------------


def test_paths_start_from_the_scenario_file_or_from_here(tmp_path, monkeypatch):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "mine.toml").write_text(
        '[[flow]]\nkind = "measured"\nfile = "a.nc"\n[[flow]]\nkind = "measured"\nfile = "/z.nc"\n'
        '[[base.motion]]\nkind = "file"\nchannel = "heave"\nfile = "heave.csv"\n'
        '[target]\npath = "file"\nfile = "path.csv"\n'
        '[vary]\n"flow.0.file" = ["b.nc", "/c.nc"]\n"target.file" = ["path.csv", "/b.csv"]\n'
        'flow = [[{kind = "measured", file = "d.nc"}]]'
    )
    monkeypatch.chdir(tmp_path)
    case, deep = load("deep/mine.toml"), f"{tmp_path}/deep"
    files = [case.flow[0].file, case.base.motion[0].file, case.target.file]
    assert files == [f"{deep}/a.nc", f"{deep}/heave.csv", f"{deep}/path.csv"]
    assert case.vary["flow.0.file"] == [f"{deep}/b.nc", "/c.nc"]
    assert case.vary["target.file"] == [f"{deep}/path.csv", "/b.csv"]
    assert case.vary["flow"][0][0]["file"] == f"{deep}/d.nc"
    case = load("deep/mine.toml", ["flow.0.file=e.nc", "vary={}"])
    assert case.flow[0].file == f"{tmp_path}/e.nc"
    assert Scenario.from_toml(case.to_toml()) == case
    assert Scenario(flow=case.flow).flow[0].file == f"{tmp_path}/e.nc"


# --- files that were measured ------------------------------------------------------------------


@real_data
def test_the_velocimeter_of_admiralty_inlet():
    case = measured(DATA / "admiralty_inlet_adv.nc", velocity=["u", "w"], duration=590.0)
    recording = recorded(case)
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
    case = measured(DATA / "tidal_adcp_profile.nc", duration=90.0, **PROFILE[2])
    recording = recorded(case)
    assert recording.levels.size == 28
    with xr.open_dataset(DATA / "tidal_adcp_profile.nc", decode_times=False) as stored:
        east = stored["vel"].sel(dir="E").transpose("time", "range").values
    there = np.isfinite(east)
    np.testing.assert_array_equal(recording.velocity[..., 0][there], east[there])
    points = np.stack([np.zeros(28), recording.levels], axis=1)
    velocity, _ = moves(case, points, recording.run_time[7])
    np.testing.assert_allclose(velocity, recording.velocity[7], atol=1e-12)
