"""Results in notebooks: what they show, that it is small and safe, and their plots."""

import html
import json
import subprocess
import sys
from html.parser import HTMLParser
from itertools import pairwise

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg

from crinoid.report.charts.summary import summary
from crinoid.report.page.small import LARGEST
from crinoid.result import Result
from crinoid.scenario import Scenario
from made_results import made_result
from spatial_arm import among_obstacles, curling_arm
from test_page import HOSTILE, Tags, unpacked
from test_report import among_obstacles as planar_obstacles
from test_report import swaying_arm

mpl.use("Agg")


class Cells(HTMLParser):
    """Rows of a table, the frame's page, and all tags."""

    def __init__(self, text):
        super().__init__()
        self.rows, self.tags, self.frames, self.text = [], [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
        elif tag == "iframe":
            self.frames.append(dict(attrs))

    def handle_data(self, data):
        self.text += data
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data


def compared():
    """A result of a planar arm, and of one without control."""
    scenario = Scenario.model_validate(
        {
            "title": "An arm",
            "control": {"kind": "pid", "pid": {"slide": {"kp": 1.0}}},
            "base": {"channels": {"slide": {}}},
            "arm": {"nodes": 5},
            "simulation": {"duration": 1.0},
        }
    )
    result = made_result(scenario)
    result.uncontrolled = made_result(scenario)
    return result


def test_importing_crinoid_loads_nothing_that_draws():
    program = (
        "import sys, crinoid; crinoid.Result; from crinoid.result import Result;"
        "print(sorted({'matplotlib', 'bokeh', 'crinoid.report'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stderr


def test_a_result_shows_the_numbers_that_close_its_run():
    result = compared()
    shown = Cells(result._repr_html_())
    found = summary(result)
    rows = [[*row, *[""] * (len(found.heads) - len(row))] for row in found.rows]
    assert shown.rows == [found.heads, *rows]
    assert shown.text.startswith("An arm")


def test_a_result_shows_itself_moving():
    data = among_obstacles(records=21, duration=4.0, nodes=9)
    (frame,) = Cells(Result(data)._repr_html_()).frames
    assert frame["sandbox"] == "allow-scripts"
    tags = Tags(frame["srcdoc"])
    table = json.loads(tags.texts["table"])
    (member,) = table["scene"]["members"]
    root = unpacked(tags.texts["numbers"], member["root"])
    offset = unpacked(tags.texts["numbers"], member["offset"]).reshape(21, 9, 3)
    step = member["root"]["step"] + member["offset"]["step"]
    np.testing.assert_allclose(root[:, None] + offset, data["position"].values, atol=step)
    assert table["times"] == pytest.approx(data["time"].values)
    assert [tag for tag, _ in tags.tags].count("script") == 4


def test_what_a_result_shows_is_small():
    rng = np.random.default_rng(0)
    data = planar_obstacles(records=3000, nodes=121)
    noise = 0.02 * rng.normal(size=data["position"].shape)
    data = data.assign(position=data["position"] + noise)
    shown = Result(data, uncontrolled=Result(data))._repr_html_()
    assert LARGEST < 1_000_000
    assert len(shown) < 1_000_000
    found = Cells(shown)
    assert len(found.frames) == 1
    assert "of 3000 saved instants" in found.text


def test_titles_are_text():
    data = swaying_arm(records=5, nodes=5).assign_attrs(title=HOSTILE, status=HOSTILE)
    shown = Cells(Result(data)._repr_html_())
    assert {"script", "img", "svg", "a"}.isdisjoint(shown.tags)
    assert shown.tags.count("iframe") == 1
    assert HOSTILE in shown.text
    page = Tags(shown.frames[0]["srcdoc"])
    assert page.texts["title"].startswith(HOSTILE)
    assert "img" not in [tag for tag, _ in page.tags]
    assert [tag for tag, _ in page.tags].count("script") == 4


BROKEN = {
    "no position": lambda data: data.drop_vars("position"),
    "no finite shape": lambda data: data.assign(position=np.nan * data["position"]),
    "no scenario": lambda data: data.assign_attrs(scenario="no ] TOML"),
    "no attributes": lambda data: data.drop_attrs(),
    "no instants": lambda data: data.isel(time=[]),
    "nothing": lambda data: xr.Dataset(),
}


@pytest.mark.parametrize("spoil", BROKEN.values(), ids=BROKEN)
def test_what_cannot_be_shown_leaves_a_line(spoil):
    result = compared()
    result.dataset = spoil(result.dataset)
    shown = html.unescape(result._repr_html_())
    lines = [words for words in ("no numbers: ", "no animation: ") if words in shown]
    assert lines
    if "no numbers: " not in shown:
        assert shown.count("<tr>") > 10


def test_one_instant_is_shown_like_an_equilibrium():
    data = curling_arm(records=1, duration=0.0, nodes=5)
    shown = Cells(Result(data)._repr_html_())
    assert "greatest twist" in [row[0] for row in shown.rows]
    assert len(shown.frames) == 1


# Plots.


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


def lines(axes):
    return {line.get_label().partition(":")[0]: line.get_xydata() for line in axes.lines}


def test_plots_show_what_the_result_has():
    data = swaying_arm(records=41)
    free = swaying_arm(records=41, driven=False)
    plot = Result(data, uncontrolled=Result(free)).plot
    error = lines(plot.tip_error())
    for label, each in {"with control": data, "without control": free}.items():
        np.testing.assert_allclose(error[label][:, 0], each["time"])
        np.testing.assert_allclose(error[label][:, 1], 1e3 * each["tip_error"])
    assert plot.tip_error().get_ylabel() == "tip error (mm)"
    assert plot.tip_error().get_xlabel() == "time (s)"
    miss = lines(plot.tip_miss())["z, with control"][:, 1]
    np.testing.assert_allclose(miss, 1e3 * (data["tip_position"] - data["tip_target"])[:, 1])
    steps = lines(plot.iterations())["with control"][1:, 1]
    np.testing.assert_allclose(steps, 2 / np.arange(1, 41))
    assert plot.tip_spectrum().get_xlabel() == "frequency (Hz)"
    bent = plot.bending()
    assert bent.get_ylabel() == "curvature (1/m)"
    np.testing.assert_allclose(bent.collections[0].get_segments()[-1][:, 1], data["curvature"][-1])


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


def boxes(figure, renderer):
    """Where each pair of axes, legend and colour bar lies (pixels)."""
    return [axes.get_tightbbox(renderer) for axes in figure.axes]


@pytest.mark.parametrize("given", [{"layout": "constrained"}, {"sharex": True, "sharey": True}, {}])
def test_shapes_side_by_side_do_not_lie_over_each_other(given, caplog, recwarn):
    layout = given.pop("layout", None)
    figure = mpl.figure.Figure(figsize=(12, 4), layout=layout)
    if not layout:
        figure.subplots_adjust(wspace=0.5)
    result = Result(swaying_arm(records=21))
    for axes in figure.subplots(1, 3, **given):
        result.plot.shape(axes)
    FigureCanvasAgg(figure).draw()
    renderer = figure.canvas.get_renderer()
    found = sorted(boxes(figure, renderer), key=lambda box: box.x0)
    assert len(found) == 6  # three panels, three bars
    assert all(one.x1 < next_.x0 + 1 for one, next_ in pairwise(found))
    for axes in figure.axes:
        legend = axes.get_legend()
        if legend is None:
            continue
        box = legend.get_window_extent(renderer)
        assert axes.bbox.x0 <= box.x0 < box.x1 <= axes.bbox.x1
        arm = axes.transData.transform(np.concatenate(axes.collections[0].get_segments()))
        assert arm[:, 1].max() < box.y0  # no arm lies under it
    assert not caplog.records
    assert not [str(each.message) for each in recwarn]


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
    plot = Result(data, uncontrolled=Result(free)).plot
    for axes in figure.subplots(1, 3, sharey=True):
        plot.tip_error(axes)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    for axes in figure.axes:
        box = axes.get_legend().get_window_extent(canvas.get_renderer())
        assert axes.bbox.x0 <= box.x0 < box.x1 <= axes.bbox.x1
        highest = max(np.max(line.get_ydata()) for line in axes.lines)
        assert axes.transData.transform((0.0, highest))[1] < box.y0 < box.y1 <= axes.bbox.y1


def test_a_plot_that_there_is_not_is_refused():
    plot = Result(swaying_arm(records=5, nodes=5)).plot
    with pytest.raises(ValueError, match="no obstacles"):
        plot.contact()
    with pytest.raises(ValueError, match="got 'below', takes 'side', 'above', 'ahead'"):
        plot.shape(view="below")
    with pytest.raises(ValueError, match="got 'twist', takes 'curvature', 'tension'"):
        plot.bending(of="twist")
    with pytest.raises(ValueError, match="takes 3 axes, one for each panel, got 2"):
        plot.energy(mpl.figure.Figure().subplots(2, 1))
    bare = Result(swaying_arm(records=5, nodes=5).drop_vars("position")).plot
    with pytest.raises(ValueError, match="left it out"):
        bare.shape()
    assert bare.tip_error().lines
