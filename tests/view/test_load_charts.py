"""Charts of loads, of the time that counts and the tolerance, of a submarine, and of cycles."""

import numpy as np
import pytest

import crinoid
from crinoid.foundation.result_variables import quantity
from crinoid.view.figures.charts.spectra import load_chart
from crinoid.view.figures.charts.tip import tip_chart
from crinoid.view.figures.charts.vehicle import has_vehicle_motion, vehicle_chart
from crinoid.view.figures.cycles import draw_cycles, has_cycles
from crinoid.view.figures.paper import draw_chart
from crinoid.view.figures.run import Run
from helpers import planar_result, spatial_result

BOTH = pytest.mark.parametrize("dimension", [2, 3])
VEHICLE = {"mass": 30.0, "inertia": 2.0, "hold": "thrusters", "max_force": 4.0}


def run_of(dimension, **keys):
    """Return a run of a moving arm with a scenario of these keys."""
    make = planar_result.swaying_arm if dimension == 2 else spatial_result.curling_arm
    data = make()
    scenario = crinoid.Scenario().with_values(
        {"arm.dimension": dimension, "simulation.duration": 20.0, **keys}
    )
    return Run(data.assign_attrs(scenario=scenario.to_toml()))


@BOTH
def test_the_tip_s_error_is_summed_up_over_the_time_that_counts(dimension):
    near = {2: 0.015, 3: 0.2}[dimension]
    keys = {"target.tip": [0.1] * dimension, "target.tolerance": near}
    run = run_of(dimension, **keys)
    error, time = run.result["tip_error"].values, run.result["time"].values
    begin = float(time[time.size // 2])
    run = run_of(dimension, **keys, **{"target.judged_from": begin})
    panel = tip_chart(run).panels[0]
    late = error[time >= begin]
    assert (panel.label, panel.aside) == ("tip error", begin)
    assert panel.levels[0].value == near
    assert panel.levels[1].value == pytest.approx(np.sqrt(np.mean(late**2)))
    share = 100 * np.mean(late <= near)
    assert 0 < share < 100
    words = f"{share:.3g} % within {1e3 * near:g} mm"
    assert words in panel.traces[0].summary
    figure = draw_chart(tip_chart(run), run)
    (shade,) = figure.axes[0].patches
    assert shade.get_x() + shade.get_width() == begin


def test_an_arm_without_target_and_controller_has_a_displacement_and_no_error():
    words = [panel.label for panel in tip_chart(run_of(2)).panels]
    assert words[:3] == ["tip displacement", "tip \N{MINUS SIGN} start", "turn of\nthe tip"]
    spatial = tip_chart(run_of(3)).panels[2]
    assert spatial.also == (("start", "dashed"),)
    aimed = run_of(3, **{"target.direction": [0.0, 0.0, -1.0]})
    assert tip_chart(aimed).panels[2].also == (("target", "dashed"),)


@BOTH
def test_the_spectrum_of_a_load_has_its_variance_at_its_frequency(dimension):
    run = run_of(dimension)
    time = run.result["time"].values
    swing = np.zeros((time.size, dimension))
    frequency = 8 / (time[-1] - time[0])
    swing[:, 0] = 3.0 + 0.5 * np.sin(2 * np.pi * frequency * time)
    name, values = "base_force", quantity("base_force", swing, dimension)
    run = Run(run.result.assign({name: values}))
    force, moment = load_chart(run).panels
    (trace,) = force.traces
    shown = np.isfinite(trace.values)  # the smallest ones are below the axis
    assert shown.any()
    density = np.where(shown, trace.values, 0.0)
    width = trace.at[1] - trace.at[0]
    assert trace.at[np.argmax(density)] == pytest.approx(frequency, abs=width)
    assert density.sum() * width == pytest.approx(0.5 * 0.5**2, rel=0.05)
    assert force.unit.name == "N²/Hz"
    assert moment.over in (force.over, None)
    draw_chart(load_chart(run), run).draw_without_rendering()


@BOTH
def test_a_submarine_has_its_motion_and_its_thrust_with_limits(dimension):
    run = run_of(dimension, vehicle=VEHICLE)
    assert not has_vehicle_motion(run)  # its result has none
    time, channels = run.result["time"].values, run.result.sizes["channel"]
    force = np.zeros((time.size, dimension))
    force[:, 0] = np.clip(6.0 * np.sin(time), -4.0, 4.0)
    pose = 0.1 * np.outer(time, np.arange(channels))
    moment = np.zeros(time.size) if dimension == 2 else np.zeros((time.size, 3))
    values = {"vehicle_pose": pose, "thruster_force": force, "thruster_moment": moment}
    found = {name: quantity(name, each, dimension) for name, each in values.items()}
    run = Run(run.result.assign(found))
    shift, turn, thrust, _ = vehicle_chart(run).panels
    assert [trace.name for trace in shift.traces + turn.traces] == [
        str(name) for name in run.result["channel"].values
    ]
    assert [level.value for level in thrust.levels] == [0.0, 4.0, -4.0]
    draw_chart(vehicle_chart(run), run).draw_without_rendering()


@BOTH
def test_cycles_are_drawn_where_the_arm_bends_to_and_fro(dimension):
    run = run_of(dimension)
    assert has_cycles(run)
    figure = draw_cycles(run)
    figure.draw_without_rendering()
    (steps,) = figure.axes[0].patches
    values, edges, _ = steps.get_data()
    assert values[0] == max(values)
    assert (np.diff(edges) >= 0).all()
    still = Run(run.result.assign(curvature=0.0 * run.result["curvature"]))
    assert not has_cycles(still)
