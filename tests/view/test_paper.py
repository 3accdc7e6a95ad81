"""Figures for a paper in the width of a column, and the document for a client."""

import re
from itertools import combinations, pairwise

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

from crinoid.results.measure_labels import key_label
from crinoid.results.result import Result
from crinoid.view.figures import style, write_report
from crinoid.view.figures.arm import smooth_arm
from crinoid.view.figures.book import _FINDINGS, _run
from crinoid.view.figures.charts.tip import tip_chart
from crinoid.view.figures.controllers import draw_response
from crinoid.view.figures.document import CAPTIONS
from crinoid.view.figures.searches import draw_identification, draw_optimisation
from crinoid.view.figures.shape import draw_bending, draw_shape
from crinoid.view.page.parts import PAGE
from helpers import planar_result, spatial_result
from helpers.studies import save

COLUMN = 85.0 / 25.4
MAKERS = {2: planar_result.swaying_arm, 3: spatial_result.curling_arm}


def pages_of(content: bytes) -> list[tuple[float, float]]:
    """Return width and height of the pages of a PDF (mm)."""
    boxes = re.findall(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", content)
    return [(25.4 / 72 * float(wide), 25.4 / 72 * float(high)) for wide, high in boxes]


def assert_fit_for_a_column(figure: Figure) -> None:
    """Fail where a figure has a title, or where legends or numbers of axes cover something."""
    style.space_numbers(figure)
    figure.draw_without_rendering()
    assert figure.get_size_inches()[0] == pytest.approx(COLUMN)
    assert not any("title of a run" in text.get_text() for text in figure.texts)
    panels = [axes for axes in figure.axes if axes.axison]
    legends = [*figure.legends, *(axes.get_legend() for axes in panels if axes.get_legend())]
    page = figure.bbox.padded(0.05 * figure.dpi)
    for legend in legends:
        box = legend.get_window_extent()
        assert page.x0 <= box.x0
        assert box.x1 <= page.x1
        for axes in panels:
            inner = axes.get_window_extent().padded(-1.0)
            assert not (box.overlaps(inner)), axes.get_ylabel()
    for one, other in combinations(panels, 2):
        assert not one.get_window_extent().padded(-2.0).overlaps(other.get_window_extent())
    for axes in panels:
        for axis, side in ((axes.xaxis, "intervalx"), (axes.yaxis, "intervaly")):
            low, high = sorted(axis.get_view_interval())
            edge = 1e-6 * (high - low)
            seen = [
                getattr(tick.label1.get_window_extent(), side)
                for tick in axis.get_major_ticks()
                if tick.label1.get_visible()
                and tick.label1.get_text()
                and low - edge <= tick.get_loc() <= high + edge
            ]
            ends = sorted(tuple(each) for each in seen)
            assert all(one[1] < other[0] for one, other in pairwise(ends)), axes.get_ylabel()
        for text in [each for each in axes.texts if each.get_text()]:
            assert text.get_fontsize() >= 6.9


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_figures_fit_a_column_and_legends_cover_nothing(dimension, tmp_path):
    title = {"title": "the title of a run"}
    path = save(MAKERS[dimension](records=41).assign_attrs(title), tmp_path / "result.nc")
    save(MAKERS[dimension](records=41, driven=False), tmp_path / "uncontrolled.nc")
    with style.printed(COLUMN):
        for name, draw in _run(path).figures.items():
            figure = draw()
            assert_fit_for_a_column(figure)
            assert figure.get_size_inches()[1] < 9.5, name


def test_a_paper_has_whole_fonts_and_the_width_that_it_asks_for(tmp_path):
    save(MAKERS[2](records=5, nodes=5), tmp_path / "result.nc")
    written = write_report(tmp_path, file_format="pdf", width="8.5cm")
    assert "report.pdf" not in [path.name for path in written]
    for path in written[:-1]:
        content = path.read_bytes()
        assert b"/Type3" not in content
        assert b"/FontFile2" in content
        ((wide, _),) = pages_of(content)
        assert wide == pytest.approx(85.0, abs=0.01)


def test_a_document_has_all_of_a_run_on_pages_of_one_size(tmp_path):
    data = MAKERS[2](records=5, nodes=5).assign_attrs(title="the title of a run")
    data.attrs["notes"] = "\n".join(["a note that is long " * 20] * 3)
    path = save(data, tmp_path / "result.nc")
    written = write_report(tmp_path, file_format="pdf")
    assert [each.name for each in written] == ["report.pdf", PAGE]
    content = written[0].read_bytes()
    sizes = pages_of(content)
    scenario = -(-len(str(data.attrs["scenario"]).splitlines()) // 53)
    # cover, numbers, notes and versions
    assert len(sizes) == 4 + len(_run(path).figures) + scenario
    assert np.allclose(sizes, (210.0, 297.0), atol=0.1)
    assert b"/Type3" not in content
    assert b"/FontFile2" in content
    assert b"/Title (the title of a run)" in content
    assert b"/Subject (result.nc)" in content
    assert set(_run(path).figures) <= set(CAPTIONS)
    assert {name for each in _FINDINGS.values() for name in each.figures} <= {*CAPTIONS}
    (tmp_path / "report.pdf").write_bytes(b"%PDF-1.4 of another program")
    with pytest.raises(ValueError, match=r"report\.pdf: not written by crinoid"):
        write_report(tmp_path, file_format="pdf")


def test_plots_of_a_paper_are_narrow_and_their_files_have_whole_fonts(tmp_path):
    result = Result(MAKERS[2](records=5, nodes=5))
    axes = result.plot(width="85mm").tip_error()
    assert axes.figure.get_size_inches()[0] == pytest.approx(COLUMN)
    assert axes.xaxis.label.get_fontsize() == 8.0
    axes.figure.savefig(tmp_path / "error.pdf")
    assert b"/Type3" not in (tmp_path / "error.pdf").read_bytes()
    with pytest.raises(ValueError, match='width: got "85 px"; must be 60mm'):
        result.plot(width="85 px")


def test_an_arm_at_rest_is_drawn_without_round_off_and_without_a_target():
    data = MAKERS[2](records=21, sway=0.0, driven=False, flow=0.0)
    noise = 1e-9 * np.random.default_rng(0).normal(size=data["tip_position"].shape)
    tip = data["tip_target"] + noise
    run = Result(
        data.assign(tip_position=tip, tip_error=np.abs(tip[:, 0] - tip[0, 0]).drop_vars("axis"))
    )
    error, miss = tip_chart(run).panels[:2]
    assert not np.any(error.traces[0].values)
    assert not any(np.any(trace.values) for trace in miss.traces)
    assert (error.high * error.factor, miss.low * miss.factor, error.unit.name) == (1.0, -1.0, "mm")
    labels = [text.get_text() for text in draw_shape(run).legends[0].get_texts()]
    assert "arm at the end" in labels
    assert not {"target", "start of the tip"} & {*labels}


def test_bending_leaves_out_what_is_zero_throughout():
    data = MAKERS[3](records=5)
    twisted = data.assign(twist=0.0 * data["twist"] + 1e-9)
    labels = [axes.get_ylabel() for axes in draw_bending(Result(twisted)).axes]
    assert not any("twist" in label for label in labels)
    assert any("kappa_1" in label for label in labels)


def test_a_drawn_arm_is_a_smooth_curve_through_its_nodes():
    run = Result(MAKERS[2](records=3, nodes=6)).scene.members[0]
    drawn = smooth_arm(run)
    pieces = (drawn.position.shape[1] - 1) // 5
    np.testing.assert_allclose(drawn.position[:, ::pieces], run.position, atol=1e-12)
    steps = np.diff(drawn.position, axis=1)
    turns = np.diff(np.unwrap(np.arctan2(steps[..., 2], steps[..., 0])), axis=1)
    assert np.abs(turns).max() < 0.05


def test_a_response_has_size_and_phase():
    frequency = np.geomspace(0.1, 10.0, 50)
    lag = 1.0 / (1.0 + 2j * np.pi * frequency[:, None, None])
    axes = ("frequency", "output", "input")
    parts = {"response_real": (axes, lag.real), "response_imaginary": (axes, lag.imag)}
    names = {"output": ["tip_x"], "input": ["command_slide"], "input_unit": ("input", ["m"])}
    figure = draw_response(xr.Dataset(parts, names | {"frequency": frequency}))
    size, phase = [each for each in figure.axes if each.axison]
    np.testing.assert_allclose(size.lines[0].get_ydata(), np.abs(lag[:, 0, 0]))
    degrees = -np.rad2deg(np.arctan(2 * np.pi * frequency))
    np.testing.assert_allclose(phase.lines[0].get_ydata(), degrees)
    assert phase.get_ylabel() == "phase (deg)"


def test_a_search_has_labels_with_units_and_logarithms_of_negative_gains():
    keys = ["arm.youngs_modulus", "control.pid.slide.kp"]
    trials = np.array([[1e5, -1.0], [1e6, -30.0], [3e5, -100.0]])
    data = xr.Dataset(
        {
            "tried": (("trial", "key"), trials),
            "found": (("trial", "measure", "draw"), np.array([[[2.0]], [[1.0]], [[3.0]]])),
            "start": ("trial", [0, 0, 1]),
            "given": ("key", trials[0]),
            "best": ("key", trials[1]),
            "range": (("key", "end"), [[1e5, 1e6], [-1000.0, -1.0]]),
            "limit": ("measure", [np.nan]),
            "sign": ("measure", [0]),
        },
        {"key": keys, "measure": ["rms_error"], "unit": ("measure", ["m"])},
    )
    figure = draw_optimisation(data)
    labels = [axes.get_xlabel().replace("\n", " ") for axes in figure.axes]
    assert labels == ["arm youngs modulus (Pa)", "pid slide kp"]
    assert [axes.get_xscale() for axes in figure.axes] == ["linear", "symlog"]
    assert figure.axes[0].get_ylabel() == "RMS tip error (m)"
    assert key_label("arm.length") == "arm length (m)"


def test_an_identification_names_what_it_found_with_units():
    rows = np.linspace(0.0, 1.0, 5)[:, None]
    data = xr.Dataset(
        {
            **{name: ("parameter", [value]) for name, value in (("given", 1e5), ("found", 2.5e5))},
            "standard_error": ("parameter", [300.0]),
            **dict.fromkeys(
                ("measured", "computed", "computed_before"), (("time", "quantity"), rows)
            ),
            "set_aside": ("time", np.zeros(5)),
        },
        {
            "parameter": ["arm.youngs_modulus"],
            "quantity": ["tip.x"],
            "time": rows[:, 0],
            "marker": ("time", ["tip"] * 5),
            "hold": ("time", [""] * 5),
        },
    )
    words = draw_identification(data).get_supxlabel()
    assert words == "arm youngs modulus 250000 ± 300 Pa (initially 100000)"
