"""Refusals of commands on results, before anything slow is loaded."""

import re
from pathlib import Path

from crinoid.results.report_error import ReportError
from crinoid.scenario.errors import got, one_of

FIGURES = ("png", "pdf", "svg")  # formats of figures
_KEPT = (".nc", ".csv", ".eqx")  # endings of results, tables of studies, and policies


_INCHES = {"mm": 1 / 25.4, "cm": 1 / 2.54, "in": 1.0}
_LEAST, _MOST = 60.0, 500.0  # mm


def width_of(text: str, name: str = "--width") -> float:
    """Read a width of figures, such as 85mm, and return it in inches."""
    found = re.fullmatch(r"(\d{1,4}(?:\.\d{1,4})?) ?(mm|cm|in)", str(text).strip(), re.ASCII)
    inches = float(found[1]) * _INCHES[found[2]] if found else 0.0
    if not _LEAST <= round(25.4 * inches, 3) <= _MOST:
        must = f"be {_LEAST:g}mm to {_MOST:g}mm, such as 85mm, 8.5cm or 3.4in"
        raise ReportError(f"{name}: {got(text, must)}")
    return inches


def require_path(path: Path) -> None:
    """Require a file or folder that may be a result."""
    if not path.exists():
        near = f"; did you mean {near}?" if (near := Path("results", path)).exists() else ""
        raise ReportError(f"{path}: no such file or directory{near}")
    if path.suffix == ".toml":
        hint = f"Run it first: crinoid run {path}"
        raise ReportError(f"{path}: is a scenario; must be a folder of crinoid run. {hint}.")
    if path.is_dir() and not any(each.suffix in _KEPT for each in path.iterdir()):
        text = f"{path}: no result here; it contains no result.nc nor another file of a result"
        raise ReportError(f"{text}. Name a folder that crinoid wrote.")


def require_figures(form: str) -> None:
    """Require a format of figures."""
    if form not in FIGURES:
        raise ReportError(f"--format: {got(form, f'be {one_of(FIGURES)}')}")
