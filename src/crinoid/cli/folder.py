"""The folder that a command writes to: one command at a time, and nothing of another run in it."""

from __future__ import annotations

import errno
import re
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import filelock
import netCDF4
from rich.console import Console

from crinoid.current import FLOW
from crinoid.replacement import remove_unfinished
from crinoid.result import RESULT, UNCONTROLLED, Result, attributes
from crinoid.scenario import Mistake, Scenario, ScenarioError

CASES = "cases.csv"
_CASE = re.compile(r"case-\d+")
_LOCK = ".crinoid.lock"
_NO_LOCKS = {errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK}

Wanted = Mapping[str, Scenario]
"""Scenarios to run, by the folder below the one given; "" for that one itself."""


def case_names(count: int) -> list[str]:
    """Return the names of a study's cases, which are those of their folders."""
    digits = max(2, len(str(count)))
    return [f"case-{number:0{digits}d}" for number in range(1, count + 1)]


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Have a folder for oneself; it is made if needed, and goes again if nothing is written.

    Raises
    ------
    ScenarioError
        If another command is writing to it.
    OSError
        If it cannot be written to.
    """
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    lock = filelock.FileLock(folder / _LOCK)
    try:
        _open(folder, lock)
        try:
            for place in (folder, *_case_folders(folder)):
                for name in (RESULT, UNCONTROLLED, CASES, FLOW):
                    remove_unfinished(place / name)
            yield
        finally:
            if lock.is_locked:
                (folder / _LOCK).unlink(missing_ok=True)
                lock.release()
    finally:
        with suppress(OSError):  # not empty: something came of it
            for each in made:
                each.rmdir()


def _open(folder: Path, lock: filelock.BaseFileLock) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
        lock.acquire(blocking=False)
    except filelock.Timeout:
        text = f"another command is writing to {folder}: takes another folder, or a moment"
        raise ScenarioError([Mistake("--out", text)]) from None
    except NotImplementedError:
        pass  # a file system without locks
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise OSError(error.errno, error.strerror, str(folder)) from error


def check_replaced(
    folder: Path, wanted: Wanted, *, resume: bool = False, still: bool = False
) -> None:
    """Refuse to replace a finished result of another scenario.

    Parameters
    ----------
    folder, wanted
        Where, and what is to be run there.
    resume
        Whether results of ``wanted`` are gone on with, which looks at them more closely.
    still
        Whether an equilibrium is to replace them.

    Raises
    ------
    ScenarioError
        If there is one.
    """
    for place in ("", *(each.name for each in _case_folders(folder))):
        path = folder / place / RESULT
        found = attributes(path)
        if found.get("status") != "ok" or (resume and place in wanted):
            continue
        if place not in wanted or not _same(found, wanted[place]) or still != _still(path):
            text = f"{path} is a finished result of another scenario; takes another folder, or "
            raise ScenarioError([Mistake("--out", f"{text}--force to replace it")])


def interrupted(folder: Path, scenario: Scenario) -> bool:
    """Tell whether a folder holds an interrupted run of a scenario."""
    found = attributes(folder / RESULT)
    return str(found.get("status")).startswith("interrupted") and _same(found, scenario)


def clear(folder: Path, wanted: Wanted, *, resume: bool = False) -> None:
    """Remove what crinoid wrote here of anything but the results of ``wanted``."""
    for place in ("", *(each.name for each in _case_folders(folder))):
        found = attributes(folder / place / RESULT)
        if place in wanted and (resume or _same(found, wanted[place])):
            continue
        for name in (RESULT, UNCONTROLLED):
            if attributes(folder / place / name):
                (folder / place / name).unlink()
        clear_figures(folder / place)
        if place:
            remove_table(folder / place)
            with suppress(OSError):  # it holds something else as well
                (folder / place).rmdir()
    if "" in wanted:
        remove_table(folder)


def remove_table(folder: Path) -> None:
    """Remove the table of an earlier study."""
    table = folder / CASES
    with suppress(OSError, UnicodeDecodeError):
        first = table.read_text(encoding="utf-8").partition("\n")[0].strip()
        if first.startswith("case,") and first.endswith(",directory"):
            table.unlink()


def clear_figures(folder: Path) -> None:
    """Remove the figures of an earlier result, but for those of a current."""
    for path in folder.glob("*.png"):
        with suppress(OSError), path.open("rb") as file:
            head = file.read(2000)
            if b"Software\0crinoid" in head and b"Source\0" + FLOW.encode() not in head:
                path.unlink()


def save(result: Result, folder: Path) -> tuple[list[Path], str]:
    """Save a result, elsewhere if it cannot be in its folder.

    Returns
    -------
    paths
        Its files.
    trouble
        What went wrong, if anything did.
    """
    try:
        paths = result.save(folder)
    except OSError as error:
        return _rescue(result, f"{error.filename or folder}: {error.strerror or error}")
    clear_figures(folder)
    return paths, ""


def _rescue(result: Result, reason: str) -> tuple[list[Path], str]:
    for parent in (tempfile.gettempdir(), Path.home()):
        try:
            folder = Path(tempfile.mkdtemp(prefix="crinoid-", dir=parent))
        except OSError:
            continue
        try:
            paths = result.save(folder)
        except OSError:
            with suppress(OSError):
                folder.rmdir()
            continue
        return paths, f"{reason}; what was computed is saved in {folder} instead"
    return [], f"{reason}; what was computed could be saved nowhere and is lost"


def say_where(console: Console, paths: list[Path]) -> None:
    """Show where the results are."""
    for path in paths:
        console.print(f"wrote {path}", soft_wrap=True)
    if paths:
        console.print(f"figures: crinoid report {paths[0].parent}", soft_wrap=True)


def _case_folders(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(
        each
        for each in folder.iterdir()
        if _CASE.fullmatch(each.name) and each.is_dir() and not each.is_symlink()
    )


def _still(path: Path) -> bool:
    """Tell whether a result is of one instant, an equilibrium."""
    with netCDF4.Dataset(path) as file:
        return "time" in file.dimensions and file.dimensions["time"].size == 1


def _same(found: Mapping[str, object], scenario: Scenario) -> bool:
    text = str(found.get("scenario"))
    if text == scenario.to_toml():
        return True
    try:
        return Scenario.from_toml(text) == scenario
    except ScenarioError:  # of a version that took something else
        return False
