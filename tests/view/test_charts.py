"""Numbers in charts: errors, spectra, loads, contact, vortices, a submarine, cycles, frames."""

import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.foundation.result_variables import quantity
from crinoid.results.metrics import MEASURES, RunStatistics
from crinoid.results.result import Result
from crinoid.results.table import summary
from crinoid.view.figures.charts.spectra import fluctuation_spectrum, load_chart
from crinoid.view.figures.charts.tip import tip_chart
from crinoid.view.figures.charts.touch import contact_chart
from crinoid.view.figures.charts.vehicle import vehicle_chart
from crinoid.view.figures.charts.vortices import vortex_chart
from crinoid.view.figures.shape import draw_cycles, has_cycles
from crinoid.view.figures.sheet import in_best_frame
from helpers import planar_result, spatial_result
from helpers.made_results import made_result

BOTH = pytest.mark.parametrize("dimension", [2, 3])
VEHICLE = {"mass": 30.0, "inertia": 2.0, "hold": "thrusters", "max_force": 4.0}


def run_of(dimension, **keys):
    """Return a run of a moving arm with a scenario of these keys."""
    make = planar_result.swaying_arm if dimension == 2 else spatial_result.curling_arm
    data = make()
    scenario = crinoid.Scenario().with_values(
        {"arm.dimension": dimension, "simulation.duration": 20.0, **keys}
    )
    return Result(data.assign_attrs(scenario=scenario.to_toml()))


@BOTH
def test_the_tip_s_error_is_summed_up_over_the_time_that_counts(dimension):
    near = {2: 0.015, 3: 0.2}[dimension]
    keys = {"target.tip": [0.1] * dimension, "target.tolerance": near}
    run = run_of(dimension, **keys)
    error, time = run.dataset["tip_error"].values, run.dataset["time"].values
    begin = float(time[time.size // 2])
    run = run_of(dimension, **keys, **{"target.judged_from": begin})
    panel = tip_chart(run).panels[0]
    late = error[time >= begin]
    assert (panel.label, panel.aside) == ("tip error", begin)
    assert panel.levels[0].value == near
    assert panel.levels[1].value == pytest.approx(np.sqrt(np.mean(late**2)))
    share = 100 * np.mean(late <= near)
    assert 0 < share < 100
    assert f"{share:.3g} % within {1e3 * near:g} mm" in panel.traces[0].summary


@BOTH
def test_the_spectrum_of_a_load_has_its_variance_at_its_frequency(dimension):
    run = run_of(dimension)
    time = run.dataset["time"].values
    swing = np.zeros((time.size, dimension))
    frequency = 8 / (time[-1] - time[0])
    swing[:, 0] = 3.0 + 0.5 * np.sin(2 * np.pi * frequency * time)
    run = Result(run.dataset.assign(base_force=quantity("base_force", swing, dimension)))
    force = load_chart(run).panels[0]
    (trace,) = force.traces
    shown = np.isfinite(trace.values)  # the smallest ones are below the axis
    assert shown.any()
    density = np.where(shown, trace.values, 0.0)
    width = trace.at[1] - trace.at[0]
    assert trace.at[np.argmax(density)] == pytest.approx(frequency, abs=width)
    assert density.sum() * width == pytest.approx(0.5 * 0.5**2, rel=0.05)
    assert force.unit.name == "N²/Hz"


@BOTH
def test_a_submarine_has_its_motion_and_its_thrust_with_limits(dimension):
    run = run_of(dimension, vehicle=VEHICLE)
    assert vehicle_chart(run) is None  # its result has none
    time, channels = run.dataset["time"].values, run.dataset.sizes["channel"]
    force = np.zeros((time.size, dimension))
    force[:, 0] = np.clip(6.0 * np.sin(time), -4.0, 4.0)
    pose = 0.1 * np.outer(time, np.arange(channels))
    moment = np.zeros(time.size) if dimension == 2 else np.zeros((time.size, 3))
    values = {"vehicle_pose": pose, "thruster_force": force, "thruster_moment": moment}
    found = {name: quantity(name, each, dimension) for name, each in values.items()}
    run = Result(run.dataset.assign(found))
    shift, turn, thrust, _ = vehicle_chart(run).panels
    names = [trace.name for trace in shift.traces + turn.traces]
    assert names == run.dataset["channel"].values.tolist()
    assert [level.value for level in thrust.levels] == [0.0, 4.0, -4.0]


@BOTH
def test_cycles_are_drawn_where_the_arm_bends_to_and_fro(dimension):
    run = run_of(dimension)
    assert has_cycles(run)
    (steps,) = draw_cycles(run).axes[0].patches
    values, edges, _ = steps.get_data()
    assert values[0] == max(values)
    assert (np.diff(edges) >= 0).all()
    still = Result(run.dataset.assign(curvature=0.0 * run.dataset["curvature"]))
    assert not has_cycles(still)


def test_the_spectrum_of_an_error_holds_its_variance_at_its_frequency():
    time = 0.02 * np.arange(2001)
    off = np.zeros((time.size, 3))
    off[:, 0] = 0.003 * np.sin(2 * np.pi * 2.0 * time) + 0.01
    off[:, 2] = 0.004 * np.cos(2 * np.pi * 2.0 * time)
    frequency, density = fluctuation_spectrum(time, off)
    assert frequency[np.argmax(density)] == pytest.approx(2.0, abs=0.1)
    variance = density.sum() * (frequency[1] - frequency[0])
    assert variance == pytest.approx(0.5 * 0.005**2, rel=0.02)
    # the end of a run may lie between two instants that are kept
    again = fluctuation_spectrum(
        np.append(time, time[-1] + 0.007), np.append(off, [[1.0, 0, 0]], axis=0)
    )
    np.testing.assert_array_equal(again[1], density)
    assert fluctuation_spectrum(time[:10], off[:10]) is None


def test_positions_are_relative_to_a_base_that_drives_far():
    still = planar_result.among_obstacles(drift=0.0)

    def driving(distance):
        away = distance * (still["time"] / still["time"][-1]) * (still["axis"] == "x")
        places = {name: still[name] + away for name in ("position", "tip_position", "tip_target")}
        places = {name: each.transpose(*still[name].dims) for name, each in places.items()}
        return Result(still.assign(places))

    run, about = in_best_frame(driving(12.0))
    assert about == " from the base"
    np.testing.assert_allclose(
        run.dataset["position"], still["position"] - still["position"].isel(node=0), atol=1e-12
    )
    # what stands in the world passes by
    passed = run.dataset["obstacle_position"].isel(obstacle=0).sel(axis="x")
    assert float(passed[0] - passed[-1]) == pytest.approx(12.0, rel=0.01)
    near = driving(0.3)
    assert in_best_frame(near) == (near, "")


def touching():
    """Return a run whose first and last edge press on each other from the middle on."""
    time = np.linspace(0.0, 2.0, 21)
    pressing = np.arange(21) >= 10
    force, gap = np.zeros((21, 5, 2)), np.full((21, 5), np.inf)
    force[pressing, 0], force[pressing, -1] = (0.0, 3.0), (0.0, -3.0)
    gap[:, 0] = gap[:, -1] = np.where(pressing, 4e-4, 0.02)
    return xr.Dataset(
        {"self_force": (("time", "edge", "axis"), force), "self_gap": (("time", "edge"), gap)},
        {"time": time, "axis": ["x", "z"]},
    )


def test_contact_with_itself_has_its_times_force_and_gap():
    run = Result(touching())
    assert contact_chart(Result(touching().drop_vars("self_force"))) is None
    # without all variables of obstacles their contacts are left out
    run.dataset["contact_force"] = ("time", "obstacle", "axis"), np.zeros((21, 1, 2))
    when, pressed, apart = contact_chart(run).panels
    (row,) = when.rows
    assert row.spans == pytest.approx(np.array([[1.0, 2.0]]))
    assert pressed.traces[0].values[-1] == pytest.approx(3.0)  # the two press once
    assert apart.traces[0].values.min() == pytest.approx(4e-4)


def test_contact_with_itself_is_measured_and_in_the_table():
    result = made_result(crinoid.Scenario(arm={"nodes": 6}, simulation={"duration": 2.0}))
    run = RunStatistics(result)
    names = ("self_contact_time", "max_self_force", "min_self_gap")
    assert [MEASURES[name].read(run) for name in names] == [None] * 3
    contact = touching().interp(time=result.dataset["time"], method="nearest")
    result.dataset = xr.merge([result.dataset, contact.drop_vars("axis")], join="override")
    run = RunStatistics(result)
    assert [MEASURES[name].read(run) for name in names] == pytest.approx([1.0, 3.0, 4e-4])
    rows = {row[0]: row[1:] for row in summary(result, full=True).rows}
    assert rows["time in contact with itself"] == ["1 s"]
    assert rows["largest force on itself"] == ["3 N"]
    assert "smallest gap from hull" not in rows


def test_loads_of_round_off_are_0_without_a_prefix():
    result = made_result(crinoid.Scenario(arm={"nodes": 6}, simulation={"duration": 2.0}))
    size = np.array([0.898e-9, 0.0])
    result.dataset = result.dataset.assign(base_force=0 * result.dataset["base_force"] + size)
    rows = {row[0]: row[1:] for row in summary(result).rows}
    loads = [cells for name, cells in rows.items() if "force on" in name]
    assert loads == [["0 N"]] * len(loads) != []


TIME = np.linspace(0.0, 10.0, 501)


def shedding(phase):
    force = np.zeros((TIME.size, 2, 3))
    force[:, -1, 2] = 0.4 * np.cos(phase)
    return xr.Dataset(
        {
            "vortex_phase": (("time", "edge"), np.stack([0.5 * phase, phase], axis=1)),
            "vortex_force": (("time", "edge", "axis"), force),
            "natural_frequency": ("mode", [1.4, 30.0]),
        },
        {"time": TIME, "axis": list("xyz")},
    )


@pytest.mark.parametrize("wrapped", [False, True])
def test_the_chart_of_vortices_has_their_frequency_next_to_that_of_the_arm(wrapped):
    phase = 2 * np.pi * 1.3 * TIME
    run = Result(shedding(np.angle(np.exp(1j * phase)) if wrapped else phase))
    assert vortex_chart(Result(run.dataset.drop_vars("vortex_force"))) is None
    frequency, force = vortex_chart(run).panels
    assert [level.value for level in frequency.levels] == [1.4]
    np.testing.assert_allclose(frequency.traces[0].values, 1.3, rtol=1e-6)
    assert "0.283 N/m RMS" in force.traces[0].words


def test_lock_in_ends_by_the_mass_ratio_or_by_the_model():
    def ends(density, **water):
        scenario = crinoid.Scenario(arm={"density": density}, water={"density": 1000.0} | water)
        return Prepared(scenario).facts.lock_in

    # Govardhan and Williamson 2000: 9.25 sqrt((m + 1) / (m - 0.54))
    assert ends(1050.0) == pytest.approx((4.0, 9.25 * np.sqrt(2.05 / 0.51)))
    assert ends(500.0) == (4.0, np.inf)
    assert ends(1050.0, vortices={}) == pytest.approx((1 / 0.26, 1 / 0.1))
