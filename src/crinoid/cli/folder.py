"""The folder that a command writes to: its lock, its earlier files, and where results go."""

import errno
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

import filelock
import netCDF4

from crinoid.analysis.current import FLOW
from crinoid.analysis.equilibria import CURVE
from crinoid.analysis.margins import MARGINS
from crinoid.analysis.sea_record import RECORD
from crinoid.analysis.state_space import RESPONSE
from crinoid.analysis.vibrations import MODES
from crinoid.cli.display import difference
from crinoid.foundation.atomic_file import remove_unfinished
from crinoid.foundation.status import Status
from crinoid.inverse import ESTIMATE, IDENTIFICATION, OPTIMISATION, TUNING
from crinoid.results.metrics import CASES
from crinoid.results.own_files import FIGURES, is_own
from crinoid.results.result import RESULT, TRAINING, UNCONTROLLED, Result
from crinoid.results.result_file import attributes
from crinoid.results.stream import is_stream, open_lazily, remove_checkpoints
from crinoid.results.summary import SUMMARY_CSV, SUMMARY_JSON, write_summary
from crinoid.scenario import Scenario, ScenarioError, refusal
from crinoid.studies.comparison import COMPARISON
from crinoid.studies.statistics import MEANS
from crinoid.studies.sweep.plan import PLAN
from crinoid.view.export.formats import exports_of
from crinoid.view.film.encode import FILMS
from crinoid.view.page.parts import PAGE

_CASE = re.compile(r"case-\d+")
_LOCK = ".crinoid.lock"
_APART = (
    FLOW, RECORD, MODES, CURVE, COMPARISON, MARGINS, RESPONSE, TUNING, IDENTIFICATION, ESTIMATE,
    OPTIMISATION, TRAINING,
)  # fmt: skip
"""Files of commands that run no scenario by itself, which may be next to a result."""
_SUMMARY = (SUMMARY_JSON, SUMMARY_CSV)
_NO_LOCKS = {errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK}

Wanted = Mapping[str, Scenario]
"""Scenarios to run, by the folder below that of the command; "" for that one itself."""


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Lock a folder; create it if needed and remove it if nothing was written."""
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    lock = filelock.FileLock(folder / _LOCK)
    try:
        _open(folder, lock)
        try:
            for place in (folder, *_case_folders(folder)):
                for name in (RESULT, UNCONTROLLED, CASES, MEANS, *_SUMMARY, *_APART):
                    remove_unfinished(place / name)
                for name in (RESULT, UNCONTROLLED):
                    remove_checkpoints(place / name)
            yield
        finally:
            if lock.is_locked:
                with suppress(OSError):  # it vanished, or may no longer be written to
                    (folder / _LOCK).unlink()
                lock.release()
    finally:
        with suppress(OSError):  # not empty: something was written
            for each in made:
                each.rmdir()


def _open(folder: Path, lock: filelock.BaseFileLock) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
        lock.acquire(blocking=False)
    except filelock.Timeout:
        text = f"{folder} is in use by another crinoid process. Wait for its end, or choose "
        raise refusal("--out", f"{text}another folder.") from None
    except NotImplementedError:
        pass  # a file system without locks
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise OSError(error.errno, error.strerror, str(folder)) from error


def check_replaced(
    folder: Path, wanted: Wanted, *, resume: bool = False, still: bool = False
) -> None:
    """Refuse to replace finished results of other scenarios, a sweep, or files of other programs.

    Results that ``resume`` continues are checked more closely elsewhere; with ``still`` an
    equilibrium is to replace them.
    """
    for place in wanted:
        goes_on = resume and (folder / place / RESULT).exists()  # checked more closely elsewhere
        for name in _SUMMARY if goes_on else (RESULT, UNCONTROLLED, *_SUMMARY):
            check_own(folder / place / name)
    for name in () if "" in wanted else (CASES, MEANS):
        check_own(folder / name)
    if (folder / PLAN).exists():
        text = f"{folder} contains a sweep. Choose another folder, or use --force to write next "
        raise refusal("--out", f"{text}to it.")
    for place in ("", *(each.name for each in _case_folders(folder))):
        path = folder / place / RESULT
        found = attributes(path)
        if Status.of(found.get("status")) is not Status.OK or (resume and place in wanted):
            continue
        if place not in wanted or not _same(found, wanted[place]) or still != _still(path):
            alike = place in wanted and still == _still(path)
            keys = difference(found, wanted[place]) if alike else ""
            text = f"{path} is a finished result of another scenario{keys}. Choose another folder, "
            raise refusal("--out", f"{text}or use --force to replace it.")


def check_own(path: Path, own: Callable[[Path], object] = is_own) -> None:
    """Refuse to replace a file that crinoid did not write."""
    if path.exists() and not own(path):
        text = f"{path} was not written by crinoid, or cannot be read. Choose another folder, or "
        raise refusal("--out", f"{text}use --force to replace it.")


def contains(folder: Path, scenario: Scenario, *statuses: Status) -> bool:
    """Return whether a folder contains a result of a scenario, of some statuses or any."""
    found = attributes(folder / RESULT)
    wanted = not statuses or Status.of(found.get("status")) in statuses
    return wanted and _same(found, scenario)


def clear(folder: Path, wanted: Wanted, *, resume: bool = False, force: bool = False) -> None:
    """Remove crinoid's files of all scenarios except the results of ``wanted``.

    With ``force`` also files of other programs that would be read as its run without control.
    """
    for path in [folder / place / UNCONTROLLED for place in wanted] if force else []:
        if path.is_file() and not is_own(path):
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
            clear_own(folder / place, [CASES])
            with suppress(OSError):  # it contains other files
                (folder / place).rmdir()
    if "" in wanted:
        clear_own(folder, [CASES, MEANS])


def clear_figures(folder: Path) -> None:
    """Remove figures, page, summary, films and exports of a result, not those of other commands."""
    clear_own(folder, [PAGE, *_SUMMARY, *FILMS, *exports_of(RESULT), *exports_of(UNCONTROLLED)])
    if (apart_of := (folder / UNCONTROLLED).with_suffix("")).is_dir():
        clear_figures(apart_of)
        with suppress(OSError):  # it contains other files
            apart_of.rmdir()
    for ending, (_, source) in FIGURES.items():
        apart = [source % name.encode() for name in _APART]
        for path in folder.glob(f"*{ending}"):
            with suppress(OSError):
                content = path.read_bytes() if is_own(path) else None
                if content is not None and not any(name in content for name in apart):
                    path.unlink()


def clear_own(folder: Path, names: Iterable[str]) -> None:
    """Remove files of some names, of those that crinoid wrote."""
    for path in (folder / name for name in names):
        with suppress(OSError):
            if path.is_file() and is_own(path):
                path.unlink()


def place_for(folder: Path, scenario: Scenario) -> Path:
    """Return the folder to write a run to while it lasts.

    Next to a finished result of the same scenario it is a new one: a run that fails or is
    interrupted does not replace such a result.
    """
    for name in (RESULT, UNCONTROLLED) if scenario.control.compared else (RESULT,):
        found = attributes(folder / name)
        if Status.of(found.get("status")) is not Status.OK or not _same(found, scenario):
            return folder
    folder = folder.resolve() if folder.name in ("", "..") else folder
    names = (f"{folder.name}-unfinished{'' if n == 1 else f'-{n}'}" for n in count(1))
    return next(place for name in names if not (place := folder.parent / name).exists())


def save(result: Result, folder: Path, place: Path) -> tuple[list[Path], str]:
    """Save a result, elsewhere if need be; return its files and what went wrong, if anything.

    One that failed or was interrupted is left in the ``place`` that `place_for` returned.
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
    saved = paths[0].parent
    for (_, run), name in zip(result.members, (RESULT, UNCONTROLLED), strict=False):
        run.dataset = open_lazily(saved / name)  # the files that it read before may be gone
    try:
        return paths + write_summary(result, saved), ""
    except OSError as error:
        return paths, f"{error.filename or saved}: {error.strerror or error}"


def stopped(error: OSError, place: Path) -> str:
    """Return why a run could not be written, and where the part before is."""
    reason = f"{error.filename or place}: {error.strerror or error}"
    if is_stream(place / RESULT):
        return f"{reason}; what was written before is in {place}, --resume goes on from there"
    return f"{reason}; nothing of the run could be written"


def _remove_made(folder: Path) -> None:
    """Remove a new folder with its results."""
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


def _case_folders(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(
        each
        for each in folder.iterdir()
        if _CASE.fullmatch(each.name) and each.is_dir() and not each.is_symlink()
    )


def _still(path: Path) -> bool:
    """Return whether a result is of one instant, an equilibrium."""
    with netCDF4.Dataset(path) as file:
        return "time" in file.dimensions and file.dimensions["time"].size == 1


def _same(found: Mapping[str, object], scenario: Scenario) -> bool:
    text = str(found.get("scenario"))
    if text == scenario.to_toml():
        return True
    try:
        return Scenario.from_toml(text) == scenario
    except ScenarioError:  # of another version
        return False
