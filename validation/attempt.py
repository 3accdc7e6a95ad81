"""Attempts at validation cases: their outcome, files and record."""

from __future__ import annotations

import json
import math
import os
import platform
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jax
import matplotlib as mpl
from matplotlib.figure import Figure

from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.status import Status
from crinoid.foundation.version import __version__
from crinoid.view.figures.style import STYLE, head, key
from validation.case import Case, Evidence

VALIDATION = "validation.json"
_COLUMNS = ("quantity", "reference", "value", "error", "tolerance", "relative", "unit", "holds")
"""Parts of a check in the record."""
_SIZE = (5.6, 3.6)
"""Size of a figure (inches)."""
_STYLE = STYLE | {"savefig.dpi": 100}


@dataclass(frozen=True)
class Attempt:
    """A case that was run, or could not be."""

    case: Case
    evidence: Evidence | None
    trouble: str
    """Why there is no evidence; empty otherwise."""
    seconds: float
    figure: Figure | None = None
    files: tuple[str, ...] = ()
    """Names of the files that were written of it."""

    @property
    def left_out(self) -> bool:
        """Whether a package was missing."""
        return bool(self.case.missing)

    @property
    def holds(self) -> bool:
        """Whether it was run and every check holds."""
        return self.evidence is not None and all(each.holds for each in self.evidence.checks)

    def save(self, folder: Path) -> Attempt:
        """Write figure and scenarios of the evidence into a folder; return it with their names."""
        if self.evidence is None:
            return self
        files = []
        for label, scenario in self.evidence.scenarios.items():
            files.append(f"{self.case.name}{f'-{label}' if label else ''}.toml")
            with atomic_write(folder / files[-1]) as temporary:
                temporary.write_text(scenario.to_toml(), "utf-8")
        if self.figure is not None:
            files.append(f"{self.case.name}.png")
            metadata = {"Software": f"crinoid {__version__}", "Source": VALIDATION}
            with mpl.rc_context(_STYLE), atomic_write(folder / files[-1]) as temporary:
                self.figure.savefig(temporary, format="png", facecolor="white", metadata=metadata)
        return replace(self, files=tuple(files))


def attempt(case: Case) -> Attempt:
    """Run and draw a case; an error of any kind becomes its trouble."""
    if case.missing:
        packages = " and ".join(case.missing)
        return Attempt(case, None, f"not run: needs {packages}, which is not installed", 0.0)
    started = time.perf_counter()
    try:
        evidence = case.run()
        figure = _drawn(case, evidence)
    except Exception as error:
        trouble = " ".join(f"{type(error).__name__}: {error}".split())
        return Attempt(case, None, trouble, time.perf_counter() - started)
    return Attempt(case, evidence, "", time.perf_counter() - started, figure)


def _drawn(case: Case, evidence: Evidence) -> Figure | None:
    if evidence.draw is None:
        return None
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=_SIZE, layout="constrained")
        axes = figure.add_subplot()
        evidence.draw(axes)
        if axes.get_legend() is None:
            key(axes)
        head(figure, case.title, Status.OK)
    return figure


def write_record(folder: Path, attempts: Sequence[Attempt]) -> Path:
    """Write the checks of attempts, and what they ran on, as JSON."""
    record = {
        "crinoid": __version__,
        "jax": jax.__version__,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "cases": [_case_record(each) for each in attempts],
        "checks": [check for each in attempts for check in _check_records(each)],
    }
    path = folder / VALIDATION
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(_finite(record), indent=1, allow_nan=False), "utf-8")
    return path


def clear_record(folder: Path) -> None:
    """Remove an earlier record with its figures and scenarios."""
    path = folder / VALIDATION
    if not path.exists():
        return
    with suppress(ValueError, KeyError, TypeError):  # not written by crinoid
        cases = json.loads(path.read_text("utf-8"))["cases"]
        for name in (name for case in cases for name in case["files"]):
            if Path(name).name == name:
                (folder / name).unlink(missing_ok=True)
    path.unlink()


def _case_record(each: Attempt) -> dict[str, Any]:
    names = ("name", "title", "source", "method", "reason", "kind")
    return {name: getattr(each.case, name) for name in names} | {
        "seconds": round(each.seconds, 3),
        "holds": each.holds,
        "trouble": each.trouble,
        "files": each.files,
        "remarks": [] if each.evidence is None else list(each.evidence.remarks),
    }


def _check_records(each: Attempt) -> list[dict[str, Any]]:
    if each.evidence is None:
        return []
    case, order = each.case, each.evidence.order
    return [
        {"name": case.name, "source": case.source, "kind": case.kind, "order": order}
        | {name: getattr(check, name) for name in _COLUMNS}
        for check in each.evidence.checks
    ]


def _finite(item: Any) -> Any:
    """Return a record that JSON can hold: NaN and infinity become null."""
    if isinstance(item, dict):
        return {key: _finite(value) for key, value in item.items()}
    if isinstance(item, list):
        return [_finite(value) for value in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item
