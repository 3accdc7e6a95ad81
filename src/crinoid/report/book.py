"""The book of figures that belongs to a result or a study: which are drawn, and where to."""

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import xarray as xr
from matplotlib.figure import Figure

from crinoid.cases import CASES, is_table
from crinoid.replacement import replacing
from crinoid.report.bending import draw_bending
from crinoid.report.cases import draw_cases
from crinoid.report.charts.chart import Chart
from crinoid.report.charts.drive import drive_chart
from crinoid.report.charts.energy import energy_chart
from crinoid.report.charts.tip import tip_chart
from crinoid.report.charts.touch import contact_chart, has_contact
from crinoid.report.closeup import draw_close_up
from crinoid.report.compare import COMPARISON, draw_comparison, open_comparison
from crinoid.report.flow import FLOW, open_flow
from crinoid.report.identify import IDENTIFICATION, draw_identification, open_identification
from crinoid.report.margins import MARGINS, draw_bode, draw_nyquist, open_margins
from crinoid.report.modes import MODES, draw_modes, open_modes
from crinoid.report.page.file import PAGE
from crinoid.report.page.study import write_study
from crinoid.report.page.write import write_run
from crinoid.report.paper import draw_chart
from crinoid.report.profile import draw_profile
from crinoid.report.run import RESULT, ReportError, Run, open_run
from crinoid.report.series import draw_series
from crinoid.report.shape import draw_shape
from crinoid.report.sheet import draw_sheet
from crinoid.report.spectrum import draw_spectrum
from crinoid.report.style import STYLE
from crinoid.report.table import read_cases
from crinoid.report.train import draw_training, open_training
from crinoid.report.tune import TUNING, draw_tuning, open_tuning
from crinoid.report.view import is_spatial
from crinoid.result import TRAINING
from crinoid.version import __version__

_MOST_CASES = 60
"""Cases that fit a printed page; the page of a study shows more."""


def _of(chart: Callable[[Run], Chart]) -> Callable[[Run], Figure]:
    return lambda run: draw_chart(chart(run), run)


_FIGURES: dict[str, Callable[[Run], Figure]] = {
    "shape.png": draw_shape,
    "tip_error.png": _of(tip_chart),
    "tip_path.png": draw_close_up,
    "commands.png": _of(drive_chart),
    "energy.png": _of(energy_chart),
    "bending.png": draw_bending,
}

_SPACE = {"shape.png": draw_sheet}
"""Figures that differ for an arm in space."""

_FLOW_FIGURES: dict[str, Callable[[xr.Dataset], Figure]] = {
    "flow.png": draw_series,
    "spectrum.png": draw_spectrum,
    "profile.png": draw_profile,
}


def write_book(path: Path, out: Path | None) -> list[Path]:
    """Draw everything that the result or study at `path` gives; see `crinoid.report`."""
    if not path.exists():
        raise ReportError(f"{path}: no such file or directory")
    if path.is_file() and path.name in _APART:
        return _APART[path.name](path, out or path.parent)
    if path.is_file() and path.name != CASES:
        return _write_run(path, out or path.parent)
    folder = path if path.is_dir() else path.parent
    written = []
    there = [name for name in (RESULT, *_APART) if path.is_dir() and (folder / name).is_file()]
    # beside a result of ours a table of others is none of our business
    if is_table(folder / CASES) or ((folder / CASES).is_file() and not there):
        written += _write_study(folder, out or folder)
    if RESULT in there:
        written += _write_run(folder / RESULT, out or folder)
    for name, write in _APART.items():
        if name in there:
            written += write(folder / name, out or folder)
    if not written:
        names = " nor ".join((RESULT, CASES, *_APART))
        raise ReportError(f"{path}: no result here, neither {names}")
    return written


def _write_run(path: Path, out: Path) -> list[Path]:
    run = open_run(path)
    figures = _FIGURES | (_SPACE if is_spatial(run.result) else {})
    figures |= {"contact.png": _of(contact_chart)} if has_contact(run) else {}
    drawn = [_save(lambda draw=draw: draw(run), out / name, path) for name, draw in figures.items()]
    return [*drawn, write_run(run, out / PAGE)]


def _write_flow(path: Path, out: Path) -> list[Path]:
    flow = open_flow(path)
    figures = _FLOW_FIGURES.items()
    return [_save(lambda draw=draw: draw(flow), out / name, path) for name, draw in figures]


def _write_modes(path: Path, out: Path) -> list[Path]:
    modes = open_modes(path)
    return [_save(lambda: draw_modes(modes), out / "modes.png", path)]


def _write_comparison(path: Path, out: Path) -> list[Path]:
    data = open_comparison(path)
    return [_save(lambda: draw_comparison(data), out / "compare.png", path)]


def _write_margins(path: Path, out: Path) -> list[Path]:
    data = open_margins(path)
    figures = {"bode.png": draw_bode, "nyquist.png": draw_nyquist}
    return [_save(lambda draw=draw: draw(data), out / name, path) for name, draw in figures.items()]


def _write_tuning(path: Path, out: Path) -> list[Path]:
    data = open_tuning(path)
    return [_save(lambda: draw_tuning(data), out / "tune.png", path)]


def _write_training(path: Path, out: Path) -> list[Path]:
    data = open_training(path)
    return [_save(lambda: draw_training(data), out / "training.png", path)]


def _write_identification(path: Path, out: Path) -> list[Path]:
    data = open_identification(path)
    return [_save(lambda: draw_identification(data), out / "identify.png", path)]


def _write_study(folder: Path, out: Path) -> list[Path]:
    cases = read_cases(folder / CASES)
    title, path = folder.resolve().name, folder / CASES
    written = []
    if len(cases) <= _MOST_CASES:
        written.append(_save(lambda: draw_cases(cases, title), out / "cases.png", path))
    for case in cases:
        if case.result is not None:
            written += _write_run(case.result, out / case.directory)
    # a result beside the table has the page of that name
    return written if (folder / RESULT).is_file() else [*written, write_study(cases, folder, out)]


def _save(draw: Callable[[], Figure], path: Path, source: Path) -> Path:
    """Draw and save within the style, which leaves the caller's own settings as they were.

    The figure says that crinoid drew it and from which file.
    """
    metadata = {"Software": f"crinoid {__version__}", "Source": source.name}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context(STYLE), replacing(path) as temporary:
            draw().savefig(temporary, format="png", facecolor="white", metadata=metadata)
    except OSError as error:
        raise ReportError(f"{path}: cannot write the figure ({error.strerror})") from error
    return path


_APART: dict[str, Callable[[Path, Path], list[Path]]] = {
    FLOW: _write_flow,
    MODES: _write_modes,
    COMPARISON: _write_comparison,
    MARGINS: _write_margins,
    TUNING: _write_tuning,
    IDENTIFICATION: _write_identification,
    TRAINING: _write_training,
}
"""Files of commands that run no scenario by itself, which may lie beside a result."""
