"""Pages that a command writes when its runs have ended."""

from pathlib import Path

from crinoid.report import ReportError, write_page


def page_beside(folder: Path) -> tuple[list[Path], list[str]]:
    """Write the page of the run or the study in a folder; return it, or a note of why not.

    A run without a page is a run all the same.
    """
    try:
        return [write_page(folder)], []
    except ReportError as error:
        return [], [f"no page: {error}"]
