"""Numbers in the figures: spectra of errors, frames, sweeps, limits of forces."""

import numpy as np
import pytest

from crinoid.view.figures.charts.spectra import fluctuation_spectrum
from crinoid.view.figures.charts.tip import off_direction
from crinoid.view.figures.charts.touch import spike_limit
from crinoid.view.figures.run import Run
from crinoid.view.figures.shape import draw_close_up, draw_shape
from crinoid.view.figures.sheet import base_travel, in_best_frame, relative_to_base
from helpers.planar_result import OBSTACLES, among_obstacles, swaying_arm


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
    figure.draw_without_rendering()
    (key,) = figure.legends  # over no panel
    assert not any(key.get_window_extent().overlaps(a.get_tightbbox()) for a in figure.axes)
    assert near.get_legend() is far.get_legend() is None


def driving(distance):
    """Return an arm whose base drives forward, past obstacles that stand."""
    made = among_obstacles(drift=0.0)
    away = distance * (made["time"] / made["time"][-1]) * (made["axis"] == "x")
    places = {name: made[name] + away for name in ("position", "tip_position", "tip_target")}
    return made.assign({name: each.transpose(*made[name].dims) for name, each in places.items()})


def test_positions_are_relative_to_a_base_that_drives_far():
    still, made = among_obstacles(drift=0.0), driving(12.0)
    assert base_travel(made) == pytest.approx(12.0, rel=0.01)
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
    assert relative_to_base(made)["obstacle_position"].dims == made["obstacle_position"].dims


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


@pytest.mark.parametrize(
    ("drift", "shown"),
    [
        (1e-3, {"obstacle at the end", "obstacle over time", "path of an obstacle"}),
        (9.0, {"obstacle over time", "path of an obstacle"}),
        (0.0, {"obstacle"}),
    ],
)
def test_the_key_names_the_obstacles_that_are_in_sight(drift, shown):
    sphere = among_obstacles(drift=drift).isel(obstacle=[0])
    first = OBSTACLES[: OBSTACLES.index("},") + 1] + "]"
    figure = draw_shape(Run(sphere.assign_attrs(scenario=first)))
    named = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {name for name in named if "obstacle" in name} == shown
