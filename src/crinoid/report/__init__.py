"""Figures from a result file.

The only package that draws. Importing it costs nothing: the plotting library is loaded when
`write_report` is called, not before.
"""

from pathlib import Path

from crinoid.report.run import ReportError

__all__ = ["ReportError", "write_report"]


def write_report(path: Path, out: Path | None = None) -> list[Path]:
    """Draw the figures of a result, or of a study of several cases.

    A result gives `shape.png`, `tip_error.png`, `tip_path.png`, `commands.png`, `energy.png` and
    `bending.png`, and with obstacles `contact.png`; a file `uncontrolled.nc` beside it is drawn as
    the comparison. A study (a folder with `cases.csv`) gives `cases.png`, and the figures of each
    case in the folder of that case. The current that `crinoid flow` sampled (`flow.nc`) gives
    `flow.png`, `spectrum.png` and `profile.png`, what `crinoid modes` found (`modes.nc`)
    `modes.png`, what `crinoid compare` compared (`compare.nc`) `compare.png`, the loop of
    `crinoid margins` (`margins.nc`) `bode.png` and `nyquist.png`, the search of `crinoid tune`
    (`tune.nc`) `tune.png`, and that of `crinoid identify` (`identify.nc`) `identify.png`.

    Parameters
    ----------
    path
        A result's folder, its `result.nc`, a study's folder or its `cases.csv`, a folder with
        `flow.nc`, `modes.nc`, `compare.nc`, `margins.nc`, `tune.nc` or `identify.nc`, or that file.
    out
        Folder for the figures, made if needed; beside the result by default.

    Returns
    -------
    list of Path
        The figures written, in the order above.

    Raises
    ------
    ReportError
        If there is no result at `path`, or the file is empty, broken or of another kind.
    """
    from crinoid.report.book import write_book

    return write_book(Path(path), None if out is None else Path(out))
