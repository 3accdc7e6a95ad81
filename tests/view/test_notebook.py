"""Results in notebooks: what they show, that it is small and safe, and their plots."""

import html
import json
import os
import re
import subprocess
import sys

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

from crinoid.results.result import Result
from crinoid.results.table import summary
from crinoid.scenario import Scenario
from crinoid.view.page.write import LARGEST
from helpers.made_results import made_result
from helpers.pages import HOSTILE, Tags
from helpers.planar_result import among_obstacles as planar_obstacles
from helpers.planar_result import swaying_arm
from helpers.spatial_result import among_obstacles

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


def test_a_result_shows_the_numbers_that_close_its_run_and_folds_the_others():
    result = compared()
    html = result._repr_html_()
    parts = html.split("<details><summary>All numbers</summary>")
    for full, part in enumerate(parts):
        found = summary(result, full=bool(full))
        rows = [[*row, *[""] * (len(found.heads) - len(row))] for row in found.rows]
        assert Tags(part).rows == [found.heads, *rows]
    assert len(parts) == 2
    assert html.endswith("</table></details>")
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
        assert shown.count("<tr>") >= 7


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
    miss = lines(plot.tip_miss())["z, with control"][:, 1]
    np.testing.assert_allclose(miss, 1e3 * (data["tip_position"] - data["tip_target"])[:, 1])
    steps = lines(plot.iterations())["with control"][1:, 1]
    np.testing.assert_allclose(steps, 2 / np.arange(1, 41))
    bent = plot.bending().collections[0].get_segments()[-1]
    np.testing.assert_allclose(bent[:, 1], data["curvature"][-1])


@pytest.mark.slow
def test_a_plot_keeps_what_its_backend_sets_when_it_is_loaded(tmp_path):
    # the backend of notebooks shows figures only while this setting is on
    backend = "from matplotlib.backends.backend_agg import *\nmatplotlib.interactive(True)\n"
    (tmp_path / "shows.py").write_text(f"import matplotlib\n{backend}")
    code = "import matplotlib, crinoid.view.notebook as n\nwith n._axes([1.0], None, None): pass\n"
    path = os.pathsep.join([str(tmp_path), *sys.path])
    ended = subprocess.run(
        [sys.executable, "-c", f"{code}print(matplotlib.is_interactive())"],
        env=os.environ | {"MPLBACKEND": "module://shows", "PYTHONPATH": path},
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
    assert plot.bending(two, of="twist") is two
    assert not plt.get_fignums()
    several, before = mpl.figure.Figure().subplots(3, 1), dict(mpl.rcParams)
    assert plot.energy(several) == list(several)
    assert dict(mpl.rcParams) == before


def test_a_shape_is_drawn_at_the_times_that_are_asked_for():
    data = swaying_arm(records=41)
    plot, time = Result(data).plot, data["time"].values
    axes = plot.shape(times=[time[10], time[30], time[20] + 1e-4], legend=False, colorbar=False)
    drawn = np.array(axes.collections[0].get_segments())
    pieces = (drawn.shape[1] - 1) // (data.sizes["node"] - 1)
    np.testing.assert_allclose(drawn[:, ::pieces], data["position"][[10, 20, 30]])
    path = next(line for line in axes.lines if line.get_label() == "path of the tip")
    np.testing.assert_allclose(path.get_xydata(), data["tip_position"][10:31])
    for wrong in ([], [time[-1] + 1.0], [-0.1], [float("nan")]):
        with pytest.raises(ValueError, match=r"^times: got .*; must be one or more from 0 to"):
            plot.shape(times=wrong)


def test_a_plot_that_does_not_exist_is_refused():
    plot = Result(swaying_arm(records=5, nodes=5)).plot
    refused = {
        "no obstacles": plot.contact,
        'got "below"; must be "side", "above" or "ahead"': lambda: plot.shape(view="below"),
        'got "twist"; must be "curvature" or "tension"': lambda: plot.bending(of="twist"),
        "got 1 axes; must be 3": lambda: plot.energy([mpl.figure.Figure().subplots()]),
        "leaves it out": Result(swaying_arm(records=5).drop_vars("position")).plot.shape,
    }
    for words, draw in refused.items():
        with pytest.raises(ValueError, match=words):
            draw()
