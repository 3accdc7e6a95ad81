"""Refusals of commands on results, before anything slow is loaded."""

from pathlib import Path

from crinoid.results.report_error import ReportError
from crinoid.scenario.errors import got, one_of

FIGURES = ("png", "pdf", "svg")
"""Formats of figures."""


def require_path(path: Path) -> None:
    """Require a file or folder, and no scenario."""
    if not path.exists():
        raise ReportError(f"{path}: no such file or directory")
    if path.suffix == ".toml":
        raise ReportError(f"{path} is a scenario; run it first: crinoid run {path}")


def require_figures(form: str) -> None:
    """Require a format of figures."""
    if form not in FIGURES:
        raise ReportError(f"--format: {got(form, f'be {one_of(FIGURES)}')}")
