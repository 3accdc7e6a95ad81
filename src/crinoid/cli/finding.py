"""Findings about one case of a scenario: a file with its figures, a table and notes."""

import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import xarray as xr
from rich.table import Table

from crinoid.assembly.prepared import Prepared
from crinoid.cli.display import say_doubts, show
from crinoid.cli.folder import check_own, claimed
from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.status import Status
from crinoid.foundation.text_variables import text_encoding
from crinoid.results.metrics import measures_of
from crinoid.results.own_files import is_own
from crinoid.results.report_error import ReportError
from crinoid.results.result import Result
from crinoid.results.summary import SUMMARY_CSV, SUMMARY_JSON, write_summary
from crinoid.scenario import Scenario, refusal
from crinoid.scenario.errors import mistakes_at
from crinoid.scenario.variation import case_words
from crinoid.studies.design import Design
from crinoid.view.figures import write_page, write_report
from crinoid.view.page.parts import PAGE

Content = str | Callable[[Path], object]  # text of a file, or a function that writes it


class Finding(NamedTuple):
    """The file of a command that examines one case."""

    prepared: Prepared
    path: Path
    doubts: list[str]  # implausible values that were reported

    def save(self, data: xr.Dataset, files: Mapping[str, Content] | None = None) -> list[Path]:
        """Save and draw a dataset, after other files by name, elsewhere if need be; return all."""

        def write(path: Path) -> None:
            with atomic_write(path) as temporary:
                data.to_netcdf(temporary, engine="netcdf4", encoding=text_encoding(data))

        contents = {**(files or {}), self.path.name: write}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            paths = write_contents(self.path.parent, contents)
        except OSError as error:
            folder = Path(tempfile.mkdtemp(prefix="crinoid-"))
            write_contents(folder, contents)
            text = f"{error.strerror}; what was computed is saved in {folder} instead"
            raise OSError(error.errno, text, error.filename) from error
        return [*paths, *write_report(paths[-1])]

    def show(
        self,
        data: xr.Dataset,
        table: Table,
        *,
        lines: Iterable[str] = (),
        notes: Iterable[str] = (),
        files: Mapping[str, Content] | None = None,
    ) -> str:
        """Save and draw a dataset, and print a table, lines and all notes; return what went wrong.

        Notes of the dataset come first.
        """
        written = self.save(data, files)
        show(table, [*data.attrs.get("notes", "").splitlines(), *notes], written, lines)
        status = str(data.attrs.get("status", Status.OK))
        return "" if status == Status.OK else status


def write_contents(folder: Path, contents: Mapping[str, Content]) -> list[Path]:
    """Write files by name into a folder; return them."""
    for name, content in contents.items():
        if isinstance(content, str):
            with atomic_write(folder / name) as temporary:
                temporary.write_text(content, "utf-8")
        else:
            content(folder / name)
    return [folder / name for name in contents]


def require_one(scenario: Scenario, name: str) -> None:
    """Require a scenario of one case for a command such as `"a tuning"`."""
    if scenario.vary:
        text = f"{name} is of one case. Set its values with --set and leave out vary."
        raise refusal("vary", text)


@contextmanager
def finding(
    scenario: Scenario,
    path: Path,
    name: str,
    *,
    force: bool,
    others: Iterable[str] = (),
    check: Callable[[Prepared], object] | None = Prepared.check,
    doubts: Collection[str] | None = (),
) -> Iterator[Finding]:
    """Prepare and check a case, and lock the folder of a file about it.

    The ``name`` is its subject in messages: `"a tuning"`. With ``force`` the file, and ``others``
    beside it, may replace those that crinoid did not write. Implausible values of the tables
    ``doubts`` are reported: of all for none, of no table for None.
    """
    require_one(scenario, name)
    prepared = Prepared(scenario)
    if check is not None:
        check(prepared)
    with claimed(path.parent):
        for each in () if force else (path.name, *others):
            check_own(path.parent / each)
        found = [] if doubts is None else say_doubts(prepared, doubts)
        yield Finding(prepared, path, found)


@contextmanager
def solvable() -> Iterator[None]:
    """Turn a failure before the first trial, such as a missing equilibrium, into a mistake."""
    try:
        yield
    except RuntimeError as error:
        raise refusal("", str(error)) from error


def checked_runs(plan: Design, runs: Iterable[int], key: str) -> Iterator[tuple[str, Prepared]]:
    """Check runs of a plan, and yield each with its name; a mistake at ``key`` names its case."""
    measures_of(plan.scenario)  # refuses those that are in no package
    for run in runs:
        with mistakes_at(key, case_words(plan.values(run))):
            prepared = Prepared(plan.case(run))
            prepared.check()
        yield plan.name(run), prepared


def complete(result: Result, folder: Path) -> tuple[list[Path], list[str]]:
    """Write summary and page of a run that was killed at its end; return them, and notes."""
    if all(is_own(folder / name) for name in (SUMMARY_JSON, SUMMARY_CSV, PAGE)):
        return [], []
    try:
        paths = write_summary(result, folder)
    except OSError as error:
        return [], [f"no summary: {error.filename or folder}: {error.strerror or error}"]
    pages, lacking = page_in(folder)
    return paths + pages, lacking


def page_in(folder: Path) -> tuple[list[Path], list[str]]:
    """Write the page of the run or the study in a folder; return it, or a note of why not."""
    try:
        return [write_page(folder)], []
    except ReportError as error:
        return [], [f"no page: {error}"]
