"""Figures of a result, printed with matplotlib, which is loaded only when something is drawn."""

from pathlib import Path

from crinoid.foundation.atomic_file import FilePath

__all__ = ["write_means", "write_page", "write_report"]


def write_report(
    path: FilePath,
    out: FilePath | None = None,
    *,
    file_format: str = "png",
    width: str | None = None,
) -> list[Path]:
    """Draw the figures of a result, or of a study of several cases.

    A result gives its figures, such as ``shape.png`` and ``tip_error.png``, and the page
    ``report.html``; a file ``uncontrolled.nc`` next to it is drawn as the comparison. A study (a
    folder with ``cases.csv``) gives those of each case, in the folder of that case, the means over
    its seeds, and a page of all. Each file of another command gives its figures: that of a current
    (``flow.nc``), a record (``record.nc``), modes (``modes.nc``), equilibria (``curve.nc``), a
    comparison (``compare.nc``), margins (``margins.nc``), the response of a linear model
    (``response.nc``), a search (``tune.nc``, ``identify.nc``, ``optimise.nc``), an estimate
    (``estimate.nc``) or a training (``training.nc``).

    Parameters
    ----------
    path : str or path
        A result's folder, its ``result.nc``, a study's folder or its ``cases.csv``, a folder with
        a file of another command, or that file.
    out : str or path
        Folder for the figures, created if needed; by default that of the result.
    file_format : str
        Format of the figures, ``"png"``, ``"pdf"`` or ``"svg"``: the ending of their names.
        ``"pdf"`` without a width gives one document in place of the figures, ``report.pdf``, with
        the numbers, the figures, the notes and the scenario of a result.
    width : str
        Width of figures for a paper, such as ``"85mm"``, ``"17.8cm"`` or ``"3.4in"``: of 60 to
        500 mm, without titles, in 7 to 8 pt. By default they are for the screen.

    Returns
    -------
    list of Path
        The figures written.

    Raises
    ------
    ReportError
        If there is nothing to draw, the format is another one, or the width is none.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "simulation.duration=0.2"])
    >>> files = crinoid.simulate(scenario).save("results/still-water")
    >>> figures = crinoid.write_report("results/still-water", file_format="svg")
    >>> "shape.svg" in [path.name for path in figures]
    True
    """
    from crinoid.view.figures.book import write_book

    return write_book(Path(path), None if out is None else Path(out), file_format, width)


def write_means(folder: FilePath) -> list[Path]:
    """Draw the means over seeds of the study whose table is in a folder, if it has any.

    Over one or two keys; of more there is no figure.
    """
    from crinoid.view.figures.book import write_means_figure

    return write_means_figure(Path(folder), Path(folder))


def write_page(folder: FilePath) -> Path:
    """Write the page `report.html` of a run, or of a study whose table is in the folder.

    That of a run shows it moving, its charts and its numbers; that of a study its cases in a table,
    in a chart over what varied, and their arms at the end.

    Parameters
    ----------
    folder
        Where `result.nc` or `cases.csv` is, and the page will be.
    """
    from crinoid.results.metrics import CASES
    from crinoid.results.reading import open_drawable
    from crinoid.results.result import RESULT
    from crinoid.view.page.parts import PAGE

    folder = Path(folder)
    if not (folder / RESULT).is_file() and (folder / CASES).is_file():
        from crinoid.view.figures.study import read_cases
        from crinoid.view.page.study import write_study

        return write_study(read_cases(folder / CASES), folder, folder)
    from crinoid.view.page.write import write_run

    return write_run(open_drawable(folder / RESULT, lazily=True), folder / PAGE)
