"""Figures and the page of a result.

The only package that draws. Importing it costs nothing: the plotting libraries are loaded when
they draw, not before.
"""

from pathlib import Path

from crinoid.replacement import FilePath
from crinoid.report.run import ReportError

__all__ = ["ReportError", "write_page", "write_report"]


def write_report(path: FilePath, out: FilePath | None = None) -> list[Path]:
    """Draw the figures of a result, or of a study of several cases.

    A result gives `shape.png`, `tip_error.png`, `tip_path.png`, `commands.png`, `energy.png` and
    `bending.png`, with obstacles `contact.png`, and the page `report.html`; a file
    `uncontrolled.nc` beside it is drawn as the comparison. A study (a folder with `cases.csv`)
    gives `cases.png`, those of each case in the folder of that case, and a page of all. The
    current that `crinoid flow` sampled (`flow.nc`) gives `flow.png`, `spectrum.png` and
    `profile.png`, what `crinoid modes` found (`modes.nc`) `modes.png`, what `crinoid compare`
    compared (`compare.nc`) `compare.png`, the loop of `crinoid margins` (`margins.nc`) `bode.png`
    and `nyquist.png`, the search of `crinoid tune` (`tune.nc`) `tune.png`, that of
    `crinoid identify` (`identify.nc`) `identify.png`, and what `crinoid train` went through
    (`training.nc`) `training.png`.

    Parameters
    ----------
    path
        A result's folder, its `result.nc`, a study's folder or its `cases.csv`, a folder with
        `flow.nc`, `modes.nc`, `compare.nc`, `margins.nc`, `tune.nc`,
        `identify.nc` or `training.nc`, or that file.
    out
        Folder for the figures, made if needed; beside the result by default.

    Returns
    -------
    list of Path
        The figures written, in the order above.
    """
    from crinoid.report.book import write_book

    return write_book(Path(path), None if out is None else Path(out))


def write_page(folder: FilePath) -> Path:
    """Write the page `report.html` of a run, or of a study whose table is in the folder.

    That of a run shows it moving, its charts and its numbers; that of a study its cases in a table,
    in a chart over what varied, and their arms at the end.

    Parameters
    ----------
    folder
        Where `result.nc` or `cases.csv` is, and the page will be.
    """
    from crinoid.cases import CASES
    from crinoid.report.page.file import PAGE
    from crinoid.report.run import RESULT, open_run

    folder = Path(folder)
    if not (folder / RESULT).is_file() and (folder / CASES).is_file():
        from crinoid.report.page.study import write_study
        from crinoid.report.table import read_cases

        return write_study(read_cases(folder / CASES), folder, folder)
    from crinoid.report.page.write import write_run

    return write_run(open_run(folder / RESULT, lazily=True), folder / PAGE)
