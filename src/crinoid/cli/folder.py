"""The folder that a command writes to: one command at a time, and nothing of another run in it."""

import errno
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import NoReturn

import filelock
import netCDF4
from rich.console import Console

from crinoid.cases import CASES, is_table
from crinoid.cli.lines import say_written
from crinoid.comparison import COMPARISON
from crinoid.current import FLOW
from crinoid.export.files import exports_in
from crinoid.identification import IDENTIFICATION
from crinoid.replacement import remove_unfinished
from crinoid.report.film.file import films_in
from crinoid.report.page.file import PAGE, is_page
from crinoid.result import RESULT, TRAINING, UNCONTROLLED, Result, attributes
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.simulation import MODES
from crinoid.simulation.margins import MARGINS
from crinoid.status import Status
from crinoid.stream import is_stream, remove_checkpoints
from crinoid.sweep import PLAN
from crinoid.tuning import TUNING

_CASE = re.compile(r"case-\d+")
_LOCK = ".crinoid.lock"
_APART = (FLOW, MODES, COMPARISON, MARGINS, TUNING, IDENTIFICATION, TRAINING)
"""Files of commands that run no scenario by itself, which may lie beside a result."""
_NO_LOCKS = {errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK}

Wanted = Mapping[str, Scenario]
"""Scenarios to run, by the folder below the one given; "" for that one itself."""


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Have a folder for oneself; it is made if needed, and goes again if nothing is written."""
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    lock = filelock.FileLock(folder / _LOCK)
    try:
        _open(folder, lock)
        try:
            for place in (folder, *_case_folders(folder)):
                for name in (RESULT, UNCONTROLLED, CASES, *_APART):
                    remove_unfinished(place / name)
                for name in (RESULT, UNCONTROLLED):
                    remove_checkpoints(place / name)
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
    """Refuse to replace a finished result of another scenario, and what crinoid did not write.

    Parameters
    ----------
    folder, wanted
        Where, and what is to be run there.
    resume
        Whether results of ``wanted`` are gone on with, which looks at them more closely.
    still
        Whether an equilibrium is to replace them.
    """
    for path in _foreign(folder, wanted, resume=resume):
        _refuse(path)
    if (folder / PLAN).exists():
        text = f"{folder} holds a sweep; takes another folder, or --force to write beside it"
        raise ScenarioError([Mistake("--out", text)])
    for place in ("", *(each.name for each in _case_folders(folder))):
        path = folder / place / RESULT
        found = attributes(path)
        if Status.of(found.get("status")) is not Status.OK or (resume and place in wanted):
            continue
        if place not in wanted or not _same(found, wanted[place]) or still != _still(path):
            text = f"{path} is a finished result of another scenario; takes another folder, or "
            raise ScenarioError([Mistake("--out", f"{text}--force to replace it")])


def check_own(path: Path, is_own: Callable[[Path], object] = attributes) -> None:
    """Refuse to replace a file that crinoid did not write; by default it is a netCDF file."""
    if path.exists() and not is_own(path):
        _refuse(path)


def _refuse(path: Path) -> NoReturn:
    text = f"{path} was not written by crinoid, or cannot be read; takes another folder, or "
    raise ScenarioError([Mistake("--out", f"{text}--force to replace it")])


def _foreign(folder: Path, wanted: Wanted, *, resume: bool) -> Iterator[Path]:
    """Yield files that are not crinoid's and have the name of one that it would write or read."""
    for place in wanted:
        if resume and (folder / place / RESULT).exists():
            continue  # the two are looked at more closely
        for path in (folder / place / RESULT, folder / place / UNCONTROLLED):
            if path.exists() and not attributes(path):
                yield path
    if "" not in wanted and (folder / CASES).exists() and not is_table(folder / CASES):
        yield folder / CASES


def interrupted(folder: Path, scenario: Scenario) -> bool:
    """Tell whether a folder holds an interrupted run of a scenario."""
    found = attributes(folder / RESULT)
    stopped = Status.of(found.get("status")) in (Status.INTERRUPTED, Status.UNFINISHED)
    return stopped and _same(found, scenario)


def holds(folder: Path, scenario: Scenario) -> bool:
    """Tell whether a folder holds a result of a scenario, whatever became of it."""
    return _same(attributes(folder / RESULT), scenario)


def clear(folder: Path, wanted: Wanted, *, resume: bool = False, force: bool = False) -> None:
    """Remove what crinoid wrote here of anything but the results of ``wanted``.

    With ``force`` no file of others is left that would be read as the comparison of such a result.
    """
    for place in wanted if force else ():
        path = folder / place / UNCONTROLLED
        if path.is_file() and not attributes(path):
            path.unlink()
    for place in ("", *(each.name for each in _case_folders(folder))):
        found = attributes(folder / place / RESULT)
        if place in wanted and (resume or _same(found, wanted[place])):
            continue
        for name in (RESULT, UNCONTROLLED):
            if attributes(folder / place / name):
                (folder / place / name).unlink()
                remove_checkpoints(folder / place / name)
        clear_figures(folder / place)
        if place:
            remove_table(folder / place)
            with suppress(OSError):  # it holds something else as well
                (folder / place).rmdir()
    if "" in wanted:
        remove_table(folder)


def remove_table(folder: Path) -> None:
    """Remove the table of an earlier study."""
    if is_table(folder / CASES):
        with suppress(OSError):
            (folder / CASES).unlink()


def clear_figures(folder: Path) -> None:
    """Remove all that was made of an earlier result, but not what is of other commands."""
    page = [folder / PAGE] if is_page(folder / PAGE) else []
    exports = (*exports_in(folder, "result"), *exports_in(folder, "uncontrolled"))
    for path in (*page, *films_in(folder), *exports):
        with suppress(OSError):
            path.unlink()
    for path in folder.glob("*.png"):
        with suppress(OSError), path.open("rb") as file:
            head = file.read(2000)
            apart = any(b"Source\0" + name.encode() in head for name in _APART)
            if b"Software\0crinoid" in head and not apart:
                path.unlink()


def place_for(folder: Path, scenario: Scenario) -> Path:
    """Return the folder in which a run is written while it lasts.

    That is a new one beside a finished result of the same scenario, which a run that fails or is
    interrupted does not replace.
    """
    return _beside(folder) if _finished(folder, scenario) else folder


def save(result: Result, folder: Path, place: Path) -> tuple[list[Path], str]:
    """Save a result, elsewhere if it cannot be in its folder.

    One that failed or was interrupted stays in the ``place`` that `place_for` gave.

    Returns
    -------
    paths
        Its files.
    trouble
        What went wrong, if anything did.
    """
    aside = bool(result.failure or result.interrupted)
    try:
        paths = result.save(place if aside else folder)
    except OSError as error:
        if is_stream(place / RESULT):
            return [], stopped(error, place)
        if place != folder:
            _remove_made(place)
        return _rescue(result, f"{error.filename or place}: {error.strerror or error}")
    if not aside or place == folder:
        clear_figures(folder)
    if not aside and place != folder:
        _remove_made(place)
    return paths, ""


def stopped(error: OSError, place: Path) -> str:
    """Say that a run could not be written, and what there is of it."""
    reason = f"{error.filename or place}: {error.strerror or error}"
    if is_stream(place / RESULT):
        return f"{reason}; what was written before is in {place}, --resume goes on from there"
    return f"{reason}; nothing of the run could be written"


def _finished(folder: Path, scenario: Scenario) -> bool:
    """Tell whether a folder holds all that a scenario is to give."""
    names = [RESULT]
    if scenario.control.kind != "none" and scenario.control.compare:
        names.append(UNCONTROLLED)
    found = [attributes(folder / name) for name in names]
    return all(
        Status.of(each.get("status")) is Status.OK and _same(each, scenario) for each in found
    )


def _beside(folder: Path) -> Path:
    """Return a new folder beside another."""
    folder = folder.resolve() if folder.name in ("", "..") else folder
    names = (f"{folder.name}-unfinished{'' if n == 1 else f'-{n}'}" for n in count(1))
    return next(place for name in names if not (place := folder.parent / name).exists())


def _remove_made(folder: Path) -> None:
    """Remove a new folder in which no result is to stay, with what there is of it."""
    for name in (RESULT, UNCONTROLLED):
        with suppress(OSError):
            (folder / name).unlink()
        remove_checkpoints(folder / name)
    with suppress(OSError):
        folder.rmdir()


def _rescue(result: Result, reason: str) -> tuple[list[Path], str]:
    parts: list[Path] = []
    for parent in (tempfile.gettempdir(), Path.home()):
        try:
            folder = Path(tempfile.mkdtemp(prefix="crinoid-", dir=parent))
        except OSError:
            continue
        try:
            paths = result.save(folder)
        except OSError:
            parts += (folder / name for name in (RESULT, UNCONTROLLED) if attributes(folder / name))
            with suppress(OSError):
                folder.rmdir()  # empty, unless one of two files could be saved
            continue
        for part in parts:
            _remove_made(part.parent)
        return paths, f"{reason}; what was computed is saved in {folder} instead"
    if parts:
        text = f"of what was computed only {' and '.join(map(str, parts))} could be saved"
        return [], f"{reason}; {text}, the rest is lost"
    return [], f"{reason}; what was computed could be saved nowhere and is lost"


def say_where(console: Console, paths: list[Path]) -> None:
    """Show where the results are; the first of them is in their folder."""
    say_written(console, paths)
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
