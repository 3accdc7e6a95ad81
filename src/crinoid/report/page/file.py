"""The file of a page: how it is known, and written whole or not at all."""

from pathlib import Path

from crinoid.replacement import replacing
from crinoid.report.run import ReportError

PAGE = "report.html"


def is_page(path: Path) -> bool:
    """Tell whether a file is a page that crinoid wrote."""
    try:
        with path.open("rb") as file:
            return b'name="generator" content="crinoid' in file.read(2000)
    except OSError:
        return False


def save_page(text: str, path: Path) -> Path:
    """Write a page."""
    if path.exists() and not is_page(path):
        raise ReportError(f"{path}: not written by crinoid; move it away first")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ReportError(f"{path}: cannot write the page ({error.strerror})") from error
    return path
