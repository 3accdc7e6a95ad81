"""Shares of time of the runs of a sweep, from a histogram of speed or a table of sea states."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from crinoid.analysis.sea_record import SHARE, SPEED
from crinoid.scenario import refusal, shown
from crinoid.studies.design import SEED
from crinoid.studies.sweep.plan import SweepDesign


def shares_of_time(plan: SweepDesign, file: Path) -> Float[np.ndarray, " run"]:
    """Return the share of time of each run.

    It is that of the values of its keys where these are columns, such as those of a wave scatter
    diagram; otherwise that of the speeds nearest to its value. Runs of the same case, such as those
    of other seeds, have equal parts of it.
    """
    runs = [plan.values(run) for run in range(1, plan.runs + 1)]
    keys = [key for key in plan.varied if key != SEED]
    names, cases, alone = [SPEED, SHARE], False, len(keys) == 1 and not plan.sampled
    try:
        with file.open(newline="", encoding="utf-8-sig") as stream:
            rows = csv.DictReader(stream)
            if keys and set(keys) <= set(rows.fieldnames or ()):
                names, cases = [*keys, SHARE], True
            table = [[float(row[name]) for name in names] for row in rows if cases or alone]
        if not table and (cases or alone):
            raise ValueError
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        text = f"{file} must have numbers in columns {' and '.join(map(shown, names))}"
        raise refusal("--weights", text) from error
    if not (cases or alone):
        text = "needs one key with a list or a count of values (--vary)"
        raise refusal("--weights", f"{text}, or a file with a column for each key")
    known, parts = np.split(np.array(table).reshape(-1, len(names)), [-1], axis=1)
    parts = parts[:, 0]
    if not (np.isfinite(known).all() and (parts >= 0).all() and abs(parts.sum() - 1) < 0.01):
        text = f"{file} has shares of time of {parts.min(initial=0.0):.4g} or more that add up to "
        text += f"{parts.sum():.4g}"
        raise refusal("--weights", f"{text}; must be 0 or more, and add up to 1")
    return _of_cases(runs, keys, known, parts) if cases else _of_speeds(runs, known[:, 0], parts)


def _of_cases(
    runs: Sequence[Mapping[str, Any]],
    keys: Sequence[str],
    known: Float[np.ndarray, "case key"],
    parts: Float[np.ndarray, " case"],
) -> Float[np.ndarray, " run"]:
    try:
        values = np.array([[float(run[key]) for key in keys] for run in runs])
    except (TypeError, ValueError) as error:
        raise refusal("--weights", f"a key of {keys} has values that are no numbers") from error
    same = np.isclose(values[:, None], known, rtol=1e-6).all(axis=2)
    count = same.sum(axis=0)
    if parts[count == 0].any():
        case = ", ".join(map(str, known[int(np.argmax((count == 0) * parts))]))
        text = f"no run has {', '.join(keys)} = {case}, and {parts[count == 0].sum():.2%} of the "
        raise refusal("--weights", f"{text}time is without a run. Vary the keys over all rows.")
    return np.asarray(same @ (parts / np.maximum(count, 1)))


def _of_speeds(
    runs: Sequence[Mapping[str, Any]],
    speeds: Float[np.ndarray, " bin"],
    parts: Float[np.ndarray, " bin"],
) -> Float[np.ndarray, " run"]:
    (key,) = {key for key in runs[0] if key != SEED}
    try:
        sizes = np.array([np.linalg.norm(np.asarray(run[key], float)) for run in runs])
    except (TypeError, ValueError) as error:
        raise refusal("--weights", f"{key} has values that are no speeds") from error
    known, place, count = np.unique(sizes, return_inverse=True, return_counts=True)
    nearest = np.argmin(np.abs(speeds[:, None] - known), axis=1)
    far = np.abs(speeds - known[nearest]) > np.diff(known).max(initial=0.0)
    if parts[far].any():
        text = f"{parts[far].sum():.2%} of the time is far from {known[0]:g} to {known[-1]:g} m/s"
        raise refusal("--weights", f"{text}, the values of {key}. Vary it over all speeds.")
    return np.asarray((np.bincount(nearest, parts, known.size) / count)[place])
