"""Attempts at validation cases: their outcome, files and record."""

from __future__ import annotations

import json
import math
import os
import platform
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jax
import matplotlib as mpl
from matplotlib.figure import Figure

from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.version import __version__
from crinoid.validation.case import Case, Evidence
from crinoid.view.figures.style import STYLE, head

VALIDATION = "validation.json"


@dataclass(frozen=True)
class Attempt:
    """A case that was run, or could not be."""

    case: Case
    evidence: Evidence | None
    trouble: str
    """Why there is no evidence; empty otherwise."""
    seconds: float

    @property
    def left_out(self) -> bool:
        """Whether a package was missing."""
        return bool(self.case.missing)

    @property
    def holds(self) -> bool:
        """Whether it was run and every check holds."""
        return self.evidence is not None and all(each.holds for each in self.evidence.checks)

    def write(self, folder: Path) -> list[Path]:
        """Write figure and scenarios of the evidence into a folder; return their paths."""
        if self.evidence is None:
            return []
        written = []
        for label, scenario in self.evidence.scenarios.items():
            path = folder / f"{self.case.name}{f'-{label}' if label else ''}.toml"
            with atomic_write(path) as temporary:
                temporary.write_text(scenario.to_toml(), "utf-8")
            written.append(path)
        if self.evidence.draw is not None:
            path = folder / f"{self.case.name}.png"
            metadata = {"Software": f"crinoid {__version__}", "Source": VALIDATION}
            with mpl.rc_context(STYLE | {"savefig.dpi": 100}), atomic_write(path) as temporary:
                figure = Figure(figsize=(5.6, 3.6), layout="constrained")
                self.evidence.draw(figure.add_subplot())
                head(figure, self.case.title, "ok")
                figure.savefig(temporary, format="png", facecolor="white", metadata=metadata)
            written.append(path)
        return written


def attempt(case: Case) -> Attempt:
    """Run a case; an error of any kind becomes its trouble."""
    if case.missing:
        packages = " and ".join(case.missing)
        return Attempt(case, None, f"not run: needs {packages}, which is not installed", 0.0)
    started = time.perf_counter()
    try:
        evidence, trouble = case.run(), ""
    except Exception as error:
        evidence, trouble = None, " ".join(f"{type(error).__name__}: {error}".split())
    return Attempt(case, evidence, trouble, time.perf_counter() - started)


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
        temporary.write_text(json.dumps(record, indent=1, allow_nan=False), "utf-8")
    return path


def _case_record(each: Attempt) -> dict[str, Any]:
    case, evidence = each.case, each.evidence
    return {
        "name": case.name,
        "title": case.title,
        "source": case.source,
        "method": case.method,
        "reason": case.reason,
        "kind": case.kind,
        "seconds": round(each.seconds, 3),
        "holds": each.holds,
        "trouble": each.trouble,
        "figure": evidence is not None and evidence.draw is not None,
        "scenarios": [] if evidence is None else list(evidence.scenarios),
        "remarks": [] if evidence is None else list(evidence.remarks),
    }


def _check_records(each: Attempt) -> list[dict[str, Any]]:
    if each.evidence is None:
        return []
    order = each.evidence.order
    return [
        {
            "name": each.case.name,
            "quantity": check.quantity,
            "source": each.case.source,
            "kind": each.case.kind,
            "reference": _number(check.reference),
            "value": _number(check.value),
            "error": _number(check.error),
            "tolerance": check.tolerance,
            "relative": check.relative,
            "unit": check.unit,
            "order": None if order is None else _number(order),
            "holds": check.holds,
        }
        for check in each.evidence.checks
    ]


def _number(value: float) -> float | None:
    """Return a number that JSON can hold: NaN and infinity become null."""
    return float(value) if math.isfinite(value) else None
