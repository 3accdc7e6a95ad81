"""The book of figures that belongs to a result or a study: which are drawn, and where to."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import xarray as xr
from matplotlib.figure import Figure

from crinoid.analysis.equilibria import CURVE
from crinoid.analysis.sea_record import RECORD
from crinoid.analysis.state_space import RESPONSE
from crinoid.foundation.version import __version__
from crinoid.inverse import ESTIMATE, IDENTIFICATION, OPTIMISATION, TUNING
from crinoid.results.metrics import CASES, is_table
from crinoid.results.reading import load_as, open_drawable
from crinoid.results.report_error import ReportError
from crinoid.results.result import RESULT, TRAINING, UNCONTROLLED
from crinoid.results.scene.data import is_spatial
from crinoid.view.figures import shape, style
from crinoid.view.figures.analyses import draw_modes, draw_profile, draw_spectrum, series_chart
from crinoid.view.figures.charts.chart import Chart
from crinoid.view.figures.charts.estimate import log_chart
from crinoid.view.figures.charts.of_run import charts_of
from crinoid.view.figures.charts.section_loads import section_load_chart
from crinoid.view.figures.controllers import draw_bode, draw_comparison, draw_nyquist, draw_response
from crinoid.view.figures.curve import draw_curve
from crinoid.view.figures.document import DOCUMENT, Part, write_document
from crinoid.view.figures.paper import draw_chart
from crinoid.view.figures.sea_record import draw_record
from crinoid.view.figures.searches import draw_identification, draw_optimisation, draw_training
from crinoid.view.figures.seed_means import draw_means, means_keys
from crinoid.view.figures.sheet import draw_sheet
from crinoid.view.figures.study import read_cases, study_of
from crinoid.view.figures.waves import draw_waves, seas
from crinoid.view.page.parts import PAGE, report_file
from crinoid.view.page.study import about_study, write_study
from crinoid.view.page.write import write_run
from crinoid.view.refusals import require_figures, require_path, width_of


class _Finding(NamedTuple):
    """The file of a finding: its kind in words, required variables, and figures."""

    kind: str
    required: Mapping[str, str]  # names of variables by their dimensions
    figures: Mapping[str, Callable[[xr.Dataset], Figure | Chart]]


_SEARCH = {
    "trial key": "tried",
    "trial measure draw": "found",
    "trial": "start",
    "key end": "range",
    "key": "given best",
    "measure draw": "before after",
    "measure": "limit sign",
}
"""Variables of a search for numbers."""
_FINDINGS = {
    "flow.nc": _Finding(
        "a current",
        {
            "time place axis": "flow_velocity",
            "frequency place axis": "flow_spectrum",
            "height axis": "profile_mean profile_standard_deviation",
        },
        {
            "flow": series_chart,
            "waves": draw_waves,
            "spectrum": draw_spectrum,
            "profile": draw_profile,
        },
    ),
    RECORD: _Finding(
        "a record",
        {"time axis": "velocity", "time": "filled", "frequency part": "spectrum", "speed": "share"},
        {"record": draw_record},
    ),
    "modes.nc": _Finding(
        "modes",
        {
            "medium mode": "frequency damping_ratio",
            "medium mode node axis": "shape shape_quadrature",
            "medium node axis": "position",
        },
        {"modes": draw_modes},
    ),
    CURVE: _Finding(
        "a bending curve",
        {
            "branch *": "tip_turn max_curvature",
            "branch * axis": "tip_position",
            "branch * node axis": "position",
        },
        {"curve": draw_curve},
    ),
    "compare.nc": _Finding(
        "a comparison",
        {
            "controller seed": "rms_error max_error",
            "controller seed input": "effort",
            "controller": "tick_time",
        },
        {"compare": draw_comparison},
    ),
    "margins.nc": _Finding(
        "margins",
        {
            "frequency locus": "locus_real locus_imaginary",
            "": "gain_margin phase_margin delay_margin modulus_margin",
        },
        {"bode": draw_bode, "nyquist": draw_nyquist},
    ),
    RESPONSE: _Finding(
        "a response",
        {"frequency output input": "response_real response_imaginary"},
        {"response": draw_response},
    ),
    IDENTIFICATION: _Finding(
        "an identification",
        {
            "parameter": "given found standard_error",
            "time quantity": "measured computed computed_before",
            "time": "set_aside marker hold",
        },
        {"identify": draw_identification},
    ),
    ESTIMATE: _Finding(
        "an estimate",
        {
            "time axis": "estimated_tip_position estimated_tip_position_std "
            "estimated_flow_velocity estimated_flow_velocity_std",
            "time reading": "innovation innovation_std sensor_reading",
        },
        {"log_estimate": log_chart},
    ),
    OPTIMISATION: _Finding("an optimisation", _SEARCH, {"optimise": draw_optimisation}),
    TUNING: _Finding("a tuning", _SEARCH, {"tune": draw_optimisation}),
    TRAINING: _Finding("a training", {"look": "cost error"}, {"training": draw_training}),
}
"""Findings by the names of their files, which may be in the folder of a result."""


_PAGE_ALONE = ("spectrum", "effort")  # charts that are no figures


class _Form(NamedTuple):
    """Format of figures, and their width for a paper (inches)."""

    ending: str
    width: float | None

    @property
    def document(self) -> bool:
        """Whether they are in one document."""
        return self.ending == "pdf" and self.width is None


_SCREEN = _Form("png", None)


def write_book(path: Path, out: Path | None, ending: str, width: str | None) -> list[Path]:
    """Draw everything that the result or study at `path` gives; see `crinoid.view.figures`."""
    require_figures(ending)
    form = _Form(ending, None if width is None else width_of(width))
    require_path(path)
    if path.is_file() and path.name in _FINDINGS:
        return _write([_finding(path)], out or path.parent, form)
    if path.is_file() and path.name != CASES:
        # figures of the controlled run have the same names
        apart = path.with_suffix("") if path.name == UNCONTROLLED else path.parent
        return _write([_run(path)], out or apart, form)
    folder = path if path.is_dir() else path.parent
    written = []
    there = [name for name in (RESULT, *_FINDINGS) if path.is_dir() and (folder / name).is_file()]
    # in the folder of a result, a table that is no study's is left alone
    studied = is_table(folder / CASES) or ((folder / CASES).is_file() and not there)
    if studied:
        written += _write_study(folder, out or folder, form)
    parts = [(_run if name == RESULT else _finding)(folder / name) for name in there]
    written += _write(parts, out or folder, form)
    if not written and not studied:
        files = " nor ".join((RESULT, CASES, *_FINDINGS))
        raise ReportError(f"{path}: no result here, neither {files}")
    return written


def _run(path: Path) -> Part:
    """Return a run and its figures; those that show changes only where it has several instants."""
    run = open_drawable(path)
    changes = run.dataset.sizes["time"] > 1
    figures = {"shape": draw_sheet if is_spatial(run.dataset) else shape.draw_shape}
    figures |= {"tip_path": shape.draw_close_up} if changes else {}
    figures["bending"] = shape.draw_bending
    figures |= {"cycles": shape.draw_cycles} if shape.has_cycles(run) else {}
    drawn = {name: partial(draw, run) for name, draw in figures.items()}
    for chart in (section_load_chart(run), *(charts_of(run) if changes else ())):
        if chart is not None and chart.name not in _PAGE_ALONE:
            drawn[chart.name] = partial(draw_chart, chart, run.dataset, run.title)
    return Part(path, run.dataset, run, drawn)


def _finding(path: Path) -> Part:
    """Return what another command found, and its figures."""
    finding = _FINDINGS[path.name]
    data = load_as(path, finding.kind, finding.required)

    def drawn(draw: Callable[[xr.Dataset], Figure | Chart]) -> Figure:
        found = draw(data)
        return draw_chart(found, data, found.title) if isinstance(found, Chart) else found

    figures = {name: partial(drawn, draw) for name, draw in finding.figures.items()}
    if "waves" in figures and not seas(data):
        del figures["waves"]
    return Part(path, data, None, figures)


def _write(parts: list[Part], out: Path, form: _Form) -> list[Path]:
    """Write the figures and the page of the files of a folder."""
    written = [write_document(out / DOCUMENT, parts)] if form.document and parts else []
    for part in parts:
        for name, draw in {} if form.document else part.figures.items():
            written.append(_save(draw, out / f"{name}.{form.ending}", part.source, form.width))
        if part.run is not None:
            written.append(write_run(part.run, out / PAGE))
    return written


def _write_study(folder: Path, out: Path, form: _Form) -> list[Path]:
    cases = read_cases(folder / CASES)
    written = []
    for case in cases:
        if case.result is not None:
            written += _write([_run(case.result)], out / case.directory, form)
    written += write_means_figure(folder, out, form)
    # a result in the same folder has the page of that name
    return written if (folder / RESULT).is_file() else [*written, write_study(cases, folder, out)]


def write_means_figure(folder: Path, out: Path, form: _Form = _SCREEN) -> list[Path]:
    """Draw the means over seeds of the study in a folder, if there are any over one or two keys."""
    cases = read_cases(folder / CASES)
    _, title, registry = about_study(folder, cases)
    study = study_of(cases, registry)
    if not means_keys(study):
        return []
    path = out / f"means.{form.ending}"
    return [_save(lambda: draw_means(study, title), path, folder / CASES, form.width)]


def _save(draw: Callable[[], Figure], path: Path, source: Path, width: float | None) -> Path:
    """Draw and save within the style; the file names crinoid and its source."""
    form, program = path.suffix[1:], f"crinoid {__version__}"
    metadata: dict[str, dict[str, str | None]] = {
        "png": {"Software": program, "Source": source.name},
        "pdf": {"Creator": program, "Subject": source.name, "CreationDate": None},
        "svg": {"Creator": program, "Source": source.name, "Date": None},
    }
    with report_file(path, "figure") as temporary, style.printed(width):
        figure = draw()
        style.space_numbers(figure)
        figure.savefig(temporary, format=form, facecolor="white", metadata=metadata[form])
    return path
