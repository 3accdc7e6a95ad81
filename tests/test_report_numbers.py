"""Numbers in the figures: spectra of errors, frames, sweeps, limits of forces."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from crinoid.report.charts.spectrum import error_spectrum
from crinoid.report.charts.tip import off_direction
from crinoid.report.charts.touch import spike_limit
from crinoid.report.closeup import draw_close_up
from crinoid.report.frame import beside_base, in_best_frame, travel
from crinoid.report.run import Run
from crinoid.report.shape import draw_shape
from crinoid.report.sweep import draw_errors, draw_settling, find_sweep
from test_report import OBSTACLES, among_obstacles, swaying_arm


def test_the_spectrum_of_an_error_holds_its_variance_at_its_frequency():
    time = 0.02 * np.arange(2001)
    off = np.zeros((time.size, 3))
    off[:, 0] = 0.003 * np.sin(2 * np.pi * 2.0 * time) + 0.01
    off[:, 2] = 0.004 * np.cos(2 * np.pi * 2.0 * time)
    frequency, density = error_spectrum(time, off)
    assert frequency[np.argmax(density)] == pytest.approx(2.0, abs=0.1)
    variance = density.sum() * (frequency[1] - frequency[0])
    assert variance == pytest.approx(0.5 * 0.005**2, rel=0.02)
    # the end of a run may lie between two instants that are kept
    again = error_spectrum(np.append(time, time[-1] + 0.007), np.append(off, [[1.0, 0, 0]], axis=0))
    np.testing.assert_array_equal(again[1], density)
    assert error_spectrum(time[:10], off[:10]) is None


def test_the_close_up_shows_each_run_at_its_own_scale_and_one_window_in_the_other():
    run = Run(swaying_arm(sway=0.005), swaying_arm(driven=False, sway=0.12))
    figure = draw_close_up(run)
    near, far, bar, spectra = figure.axes
    assert bar.get_ylabel() == "time (s)"
    assert far.get_xlim()[1] > 5 * near.get_xlim()[1]
    window = far.patches[0].get_bbox()
    assert (window.x0, window.x1) == pytest.approx(near.get_xlim())
    assert len(spectra.lines) == 2
    error = 1e3 * run.result["tip_error"].values
    assert near.get_xlim()[1] >= 0.7 * error.max()


def driving(distance):
    """Return an arm whose base drives forward, past obstacles that stand."""
    made = among_obstacles(drift=0.0)
    away = distance * (made["time"] / made["time"][-1]).values
    shift = np.stack([away, 0 * away], axis=-1)
    return made.assign(
        {
            "position": made["position"] + shift[:, None],
            "tip_position": made["tip_position"] + shift,
            "tip_target": made["tip_target"] + shift,
        }
    )


def test_a_base_that_drives_far_is_what_positions_are_measured_from():
    still, made = among_obstacles(drift=0.0), driving(12.0)
    assert travel(made) == pytest.approx(12.0, rel=0.01)
    run, about = in_best_frame(Run(made))
    assert about == " from the base"
    np.testing.assert_allclose(
        run.result["position"], still["position"] - still["position"].isel(node=0), atol=1e-12
    )
    # what stands in the world passes by
    passed = run.result["obstacle_position"].isel(obstacle=0).sel(axis="x")
    assert float(passed[0] - passed[-1]) == pytest.approx(12.0, rel=0.01)
    axes = draw_shape(Run(made)).axes[0]
    assert axes.get_xlabel() == "x from the base (m)"
    assert np.ptp(axes.get_xlim()) < 3.0
    near = Run(driving(0.3))
    assert in_best_frame(near) == (near, "")
    assert beside_base(made)["obstacle_position"].dims == made["obstacle_position"].dims


def test_a_study_of_one_number_is_a_sweep():
    def cases(*values, **other):
        return [{"arm.radius": value, **other} for value in values]

    name, values = find_sweep(cases("0.01", "0.03", "0.02", seed="0"))
    assert name == "arm.radius"
    np.testing.assert_array_equal(values, [0.01, 0.03, 0.02])
    assert find_sweep(cases("0.01", "0.03")) is None
    assert find_sweep(cases("[0, 1]", "[0, 2]", "[0, 3]")) is None
    assert find_sweep([*cases("1", "2", "3", seed="0"), *cases("3", seed="1")]) is None


def test_errors_of_a_sweep_stand_over_its_numbers():
    values, colours = np.array([1e4, 1e6, 1e5]), ["k", "r", "b"]
    nothing = np.full(3, np.nan)
    measures = {
        "rms_error": np.array([3e-3, 1e-3, 2e-3]),
        "rms_error_uncontrolled": nothing,
        "deflection": nothing,
        "steady_error": np.array([1e-3, 1e-3, 1e-3]),
    }
    errors, settling = Figure().subplots(2)
    draw_errors(errors, "arm.youngs_modulus", values, measures, colours)
    assert errors.get_xscale() == "log"
    assert errors.get_xlabel() == "arm.youngs_modulus"
    lines = {line.get_label(): line for line in errors.lines}
    assert list(lines) == ["RMS", "steady"]
    np.testing.assert_array_equal(lines["RMS"].get_xdata(), [1e4, 1e5, 1e6])
    np.testing.assert_allclose(lines["RMS"].get_ydata(), [3.0, 2.0, 1.0])
    draw_settling(settling, "arm.youngs_modulus", values, np.array([1.0, np.nan, 2.0]), colours)
    (crosses,) = [line for line in settling.lines if line.get_label() == "not settled"]
    np.testing.assert_array_equal(crosses.get_xdata(), [1e6])


def test_one_spike_does_not_flatten_the_other_forces():
    steady = 1.0 + 0.1 * np.sin(np.arange(500.0))[:, None]
    assert spike_limit([steady]) is None
    spiked = steady.copy()
    spiked[250] = 40.0
    assert 1.1 < spike_limit([spiked]) < 2.0
    assert spike_limit([np.zeros((500, 1))]) is None


def test_the_direction_of_a_planar_tip_is_off_by_the_short_way():
    made = swaying_arm(records=5)
    target = made["tip_angle"] + np.array([0.1, -0.2, 2 * np.pi, 0.0, -2 * np.pi - 0.3])
    found = off_direction(made.assign(tip_angle_target=target))
    np.testing.assert_allclose(found, [0.1, 0.2, 0.0, 0.0, 0.3], atol=1e-12)
    assert off_direction(made.drop_vars("tip_angle")) is None


def test_the_key_of_the_close_up_lies_on_no_panel():
    figure = draw_close_up(Run(swaying_arm(sway=0.005), swaying_arm(driven=False, sway=0.12)))
    figure.draw_without_rendering()
    (key,) = figure.legends
    place = key.get_window_extent()
    assert not any(place.overlaps(axes.get_tightbbox()) for axes in figure.axes)
    assert all(axes.get_legend() is None for axes in figure.axes[:2])


@pytest.mark.parametrize(
    ("drift", "shown"),
    [
        (1e-3, {"obstacle at the end", "obstacle over time", "path of an obstacle"}),
        (9.0, {"obstacle over time", "path of an obstacle"}),
        (0.0, {"obstacle"}),
    ],
    ids=["in sight", "drifted away", "standing"],
)
def test_the_key_names_the_obstacles_that_are_in_sight(drift, shown):
    sphere = among_obstacles(drift=drift).isel(obstacle=[0])
    text = "[[obstacle]]".join(OBSTACLES.split("[[obstacle]]")[:2])
    figure = draw_shape(Run(sphere.assign_attrs(scenario=text)))
    named = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {name for name in named if "obstacle" in name} == shown
