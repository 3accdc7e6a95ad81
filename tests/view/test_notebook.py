"""Results in notebooks: what they show, that it is small and safe, and their plots."""

import html
import json
import os
import re
import subprocess
import sys
from itertools import pairwise

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg

from crinoid.results.result import Result
from crinoid.scenario import Scenario
from crinoid.view.figures.charts.summary import summary
from crinoid.view.page.write import LARGEST
from helpers.made_results import made_result
from helpers.pages import HOSTILE, Tags
from helpers.planar_result import among_obstacles as planar_obstacles
from helpers.planar_result import swaying_arm
from helpers.spatial_result import among_obstacles, curling_arm

mpl.use("Agg")


def compared():
    """A result of a planar arm, and of one without control."""
    control = {"kind": "pid", "pid": {"slide": {"kp": 1.0}}}
    base, arm = {"channels": {"slide": {}}}, {"nodes": 5}
    scenario = Scenario(
        title="An arm", control=control, base=base, arm=arm, simulation={"duration": 1.0}
    )
    result = made_result(scenario)
    result.uncontrolled = made_result(scenario)
    return result


def test_a_result_shows_the_numbers_that_close_its_run():
    result = compared()
    html = result._repr_html_()
    found = summary(result)
    rows = [[*row, *[""] * (len(found.heads) - len(row))] for row in found.rows]
    assert Tags(html).rows == [found.heads, *rows]
    assert re.sub("<.*?>", "", html).startswith("An arm")


def test_the_page_of_a_long_result_is_small():
    data = planar_obstacles(records=3000, nodes=121)
    data["position"] += 0.02 * np.random.default_rng(0).normal(size=data["position"].shape)
    shown = Result(data, uncontrolled=Result(data))._repr_html_()
    assert LARGEST < 1_000_000
    assert len(shown) < 1_000_000
    assert len(Tags(shown).attributes("iframe")) == 1
    assert "of 3000 saved instants" in shown


def test_a_notebook_animates_the_arm_and_titles_stay_text():
    data = among_obstacles(records=21, duration=4.0, nodes=9)
    data = data.assign_attrs(title=HOSTILE, status=HOSTILE)
    shown = Tags(Result(data)._repr_html_())
    assert {"script", "img", "svg", "a"}.isdisjoint(tag for tag, _ in shown.tags)
    assert any(HOSTILE in text for text in shown.texts.values())
    (frame,) = shown.attributes("iframe")
    assert frame["sandbox"] == "allow-scripts"
    page = Tags(frame["srcdoc"])
    assert page.texts["title"].startswith(HOSTILE)
    assert (len(page.attributes("script")), page.attributes("img")) == (4, [])
    table = json.loads(page.texts["table"])
    assert table["scene"]["members"][0]["nodes"] == 9
    assert table["times"] == pytest.approx(data["time"].values)


BROKEN = {
    "no position": lambda data: data.drop_vars("position"),
    "no finite shape": lambda data: data.assign(position=np.nan * data["position"]),
    "no scenario": lambda data: data.assign_attrs(scenario="no ] TOML"),
    "no attributes": lambda data: data.drop_attrs(),
    "no instants": lambda data: data.isel(time=[]),
    "nothing": lambda data: xr.Dataset(),
}


@pytest.mark.parametrize("spoil", BROKEN.values(), ids=BROKEN)
def test_a_broken_result_shows_a_line(spoil):
    result = compared()
    result.dataset = spoil(result.dataset)
    shown = html.unescape(result._repr_html_())
    assert "no numbers: " in shown or "no animation: " in shown
    if "no numbers: " not in shown:
        assert shown.count("<tr>") > 10


def test_one_instant_is_shown_like_an_equilibrium():
    data = curling_arm(records=1, duration=0.0, nodes=5)
    shown = Tags(Result(data)._repr_html_())
    assert "greatest twist" in [row[0] for row in shown.rows]
    assert len(shown.attributes("iframe")) == 1


# Plots.


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


def lines(axes):
    return {line.get_label().partition(":")[0]: line.get_xydata() for line in axes.lines}


def test_plots_show_the_numbers_of_the_result():
    data = swaying_arm(records=41)
    free = swaying_arm(records=41, driven=False)
    plot = Result(data, uncontrolled=Result(free)).plot
    error = lines(plot.tip_error())
    for label, each in {"with control": data, "without control": free}.items():
        np.testing.assert_allclose(error[label][:, 0], each["time"])
        np.testing.assert_allclose(error[label][:, 1], 1e3 * each["tip_error"])
    assert plot.tip_error().get_ylabel() == "tip displacement (mm)"  # it has no target
    assert plot.tip_error().get_xlabel() == "time (s)"
    miss = lines(plot.tip_miss())["z, with control"][:, 1]
    np.testing.assert_allclose(miss, 1e3 * (data["tip_position"] - data["tip_target"])[:, 1])
    steps = lines(plot.iterations())["with control"][1:, 1]
    np.testing.assert_allclose(steps, 2 / np.arange(1, 41))
    for axes in (plot.tip_spectrum(), plot.loads()[-1]):
        assert axes.get_xlabel() == "frequency (Hz)"
    bent = plot.bending()
    assert bent.get_ylabel() == "curvature (1/m)"
    np.testing.assert_allclose(bent.collections[0].get_segments()[-1][:, 1], data["curvature"][-1])


def test_a_plot_keeps_what_its_backend_sets_when_it_is_loaded(tmp_path):
    # the backend of notebooks shows figures only while this setting is on
    (tmp_path / "shows.py").write_text(
        "import matplotlib\n"
        "from matplotlib.backends.backend_agg import *\n"
        "matplotlib.interactive(True)\n"
    )
    code = "import matplotlib, crinoid.view.notebook as n\nwith n._axes([1.0], None): pass\n"
    ended = subprocess.run(
        [sys.executable, "-c", f"{code}print(matplotlib.is_interactive())"],
        env=os.environ
        | {
            "MPLBACKEND": "module://shows",
            "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path]),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    assert ended.stdout.split() == ["True"]


def test_plots_go_into_axes_that_are_given():
    plot = Result(among_obstacles(records=21, nodes=7)).plot
    one, two = mpl.figure.Figure().subplots(1, 2)
    assert plot.base_force(ax=one) is one
    assert plot.shape(two, view="above") is two
    assert (two.get_xlabel(), two.get_ylabel()) == ("x (m)", "y (m)")
    assert plot.bending(two, of="twist") is two
    assert not plt.get_fignums()
    several = mpl.figure.Figure().subplots(3, 1)
    assert plot.energy(several) == list(several)
    assert plot.contact(list(several)) == list(several)
    before = dict(mpl.rcParams)
    drawn = [plot.tip_off_direction(), plot.water_speed(), plot.base_moment(), *plot.commands()]
    assert all(axes.get_ylabel() for axes in drawn)
    assert dict(mpl.rcParams) == before


def drawn(figure):
    """Draw a figure; fail if a legend is wider than its axes; return where each legend lies."""
    FigureCanvasAgg(figure).draw()
    legends = {axes: axes.get_legend() for axes in figure.axes if axes.get_legend()}
    boxes = {axes: legend.get_window_extent() for axes, legend in legends.items()}
    for axes, box in boxes.items():
        assert axes.bbox.x0 <= box.x0 < box.x1 <= axes.bbox.x1
    return boxes


@pytest.mark.parametrize(
    ("layout", "shared"), [("constrained", False), (None, True), (None, False)]
)
def test_shapes_side_by_side_do_not_lie_over_each_other(layout, shared, caplog, recwarn):
    figure = mpl.figure.Figure(figsize=(12, 4), layout=layout)
    if not layout:
        figure.subplots_adjust(wspace=0.5)
    result = Result(swaying_arm(records=21))
    for axes in figure.subplots(1, 3, sharex=shared, sharey=shared):
        result.plot.shape(axes)
    legends = drawn(figure)
    found = sorted((axes.get_tightbbox() for axes in figure.axes), key=lambda box: box.x0)
    assert len(found) == 6  # three panels, three bars
    assert all(one.x1 < next_.x0 + 1 for one, next_ in pairwise(found))
    assert len(legends) == 3
    for axes, box in legends.items():
        arm = axes.transData.transform(np.concatenate(axes.collections[0].get_segments()))
        assert arm[:, 1].max() < box.y0  # no arm lies under it
    for words in (text for axes in figure.axes for text in axes.texts):
        assert words.get_text().startswith("water ")
        box, arm = words.get_window_extent(), _arm_box(words.axes)
        assert box.x0 > arm[0] or box.y0 > arm[1]  # the key of the water is beyond the arm
    assert not caplog.records
    assert not [str(each.message) for each in recwarn]


def _arm_box(axes):
    """Return the largest x and y of the shapes of the arm (pixels)."""
    lines = np.concatenate(axes.collections[0].get_segments())
    return axes.transData.transform(lines).max(axis=0)


def test_axes_of_one_scale_show_all_that_each_shows():
    data = swaying_arm(records=41)
    plot, time = Result(data).plot, data["time"].values
    figure = mpl.figure.Figure()
    limits = []
    for index, axes in enumerate(figure.subplots(1, 3, sharex=True, sharey=True)):
        plot.shape(axes, times=[time[20 * index]], legend=not index, colorbar=False)
        limits.append(axes.get_ylim())
    assert all(low <= limits[0][0] and high >= limits[0][1] for low, high in limits)


def test_an_arm_without_a_target_has_a_start():
    data = swaying_arm(records=3)
    data["tip_target"] = data["tip_target"].isel(time=0).broadcast_like(data["tip_target"])
    tables = "[control]\nkind = '{}'\n[target]\ntip = 'initial'\n"
    for kind, word in {"none": "start of the tip", "pid": "target"}.items():
        axes = Result(data.assign_attrs(scenario=tables.format(kind))).plot.shape()
        assert word in axes.get_legend_handles_labels()[1]


def test_a_shape_is_drawn_at_the_times_that_are_asked_for():
    data = swaying_arm(records=41)
    plot, time = Result(data).plot, data["time"].values
    bare = mpl.figure.Figure()
    axes = bare.subplots()
    plot.shape(axes, times=[time[10], time[30], time[20] + 1e-4], legend=False, colorbar=False)
    assert bare.axes == [axes]
    assert axes.get_legend() is None
    drawn = axes.collections[0].get_segments()
    np.testing.assert_allclose(drawn, data["position"][[10, 20, 30]])
    path = next(line for line in axes.lines if line.get_label() == "path of the tip")
    np.testing.assert_allclose(path.get_xydata(), data["tip_position"][10:31])
    for wrong in ([], [time[-1] + 1.0], [-0.1], [float("nan")]):
        with pytest.raises(ValueError, match=r"^times: got .*; must be one or more from 0 to"):
            plot.shape(times=wrong)


def test_a_legend_is_no_wider_than_narrow_axes():
    data, free = swaying_arm(records=21), swaying_arm(records=21, driven=False)
    figure = mpl.figure.Figure(figsize=(8, 4))
    for axes in figure.subplots(1, 3, sharey=True):
        Result(data, uncontrolled=Result(free)).plot.tip_error(axes)
    legends = drawn(figure)
    assert len(legends) == 3
    for axes, box in legends.items():
        highest = max(np.max(line.get_ydata()) for line in axes.lines)
        assert axes.transData.transform((0.0, highest))[1] < box.y0 < box.y1 <= axes.bbox.y1


def test_a_plot_that_does_not_exist_is_refused():
    plot = Result(swaying_arm(records=5, nodes=5)).plot
    bare = Result(swaying_arm(records=5, nodes=5).drop_vars("position")).plot
    two = mpl.figure.Figure().subplots(2, 1)
    refused = {
        "no obstacles": plot.contact,
        "no submarine floats": plot.vehicle,
        'got "below"; must be "side", "above" or "ahead"': lambda: plot.shape(view="below"),
        'got "twist"; must be "curvature" or "tension"': lambda: plot.bending(of="twist"),
        "got 2 axes; must be 3, one for each panel": lambda: plot.energy(two),
        "leaves it out": bare.shape,
    }
    for words, draw in refused.items():
        with pytest.raises(ValueError, match=words):
            draw()
    assert bare.tip_error().lines
