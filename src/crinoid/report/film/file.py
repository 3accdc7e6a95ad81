"""The file of a film: its name, and whether it is crinoid's."""

import mmap
from importlib.util import find_spec
from pathlib import Path

from crinoid.report.run import ReportError

FILMS = ("film.mp4", "film.gif")
"""Names of films beside their results."""

NO_ENCODER = 'an MP4 needs PyAV: pip install "crinoid[film]"'

MADE = "made by crinoid"
"""Begin of the comment in each film."""


def is_film(path: Path) -> bool:
    """Tell whether a file is a film that crinoid made."""
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as seen:
            return seen.find(MADE.encode()) >= 0
    except (OSError, ValueError):  # ValueError: it is empty
        return False


def films_in(folder: Path) -> list[Path]:
    """Return the films beside a result that crinoid made."""
    return [path for path in (folder / name for name in FILMS) if is_film(path)]


def has_encoder() -> bool:
    """Tell whether PyAV is installed, which an MP4 needs."""
    return find_spec("av") is not None


def check_place(path: Path, ending: str, *, force: bool) -> None:
    """Refuse a place where a film cannot be, or is not to be."""
    if ending == ".mp4" and not has_encoder():
        raise ReportError(f"--to: {NO_ENCODER}; a GIF does not")
    if path.is_dir():
        raise ReportError(f"--to: {path} is a folder, takes the name of a file")
    if not path.parent.is_dir():
        raise ReportError(f"--to: there is no folder {path.parent}")
    if path.exists() and not force and not is_film(path):
        text = f"{path} was not made by crinoid; takes another name, or --force to replace it"
        raise ReportError(f"--to: {text}")
