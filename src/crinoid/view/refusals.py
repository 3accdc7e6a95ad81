"""Refusals of commands on results, before anything slow is loaded."""

from pathlib import Path

from crinoid.results.report_error import ReportError
from crinoid.scenario.errors import got, one_of

FIGURES = ("png", "pdf", "svg")
"""Formats of figures."""
_KEPT = (".nc", ".csv", ".eqx")
"""Endings of results, tables of studies, and policies."""


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
