"""Where a record of the tip lies, and where the arm can reach."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from crinoid.scenario import Mistake, ScenarioError

__all__ = ["LOST", "stuck", "within_reach"]

LOST = 0.25
"""Largest share of the rows that may be set aside as lost markers."""
_ROOM = 1.25
"""Distance of a record from the root, over the arm's length in the run."""
_STUCK = 0.02
"""Way of the tip in the run over the arm's length, along which a marker that rests is stuck."""
_CLEARLY = 0.2
"""Distance of another reading from the run, over that of the record as it is, and the length."""

Places = Float[np.ndarray, "time axis"]


def within_reach(
    names: Sequence[str], measured: Places, root: Places, tip: Places, length: float
) -> tuple[Bool[np.ndarray, " time"], list[str]]:
    """Tell which rows of a record the arm can reach; return a note where another reading fits.

    Places (m) are those on the axes `names`: of the record, and in a run whose arm is at most
    `length` (m) long.
    """
    inside = np.linalg.norm(measured - root, axis=1) <= _ROOM * length
    turned = np.where(np.array(names) == "z", -1.0, 1.0) * measured
    frames: list[tuple[str, Places, Places | float]] = [
        ("all else is right", measured, 0.0),
        ("positions are measured from the base", measured, root),
        ("heights are positive down", turned, 0.0),
        ("positions are measured from the base, positive down", turned, root),
        ("axes are swapped", np.hstack([measured[:, :-2], measured[:, :-3:-1]]), 0.0),
    ]
    frames += [(f"lengths are in mm; {words}", 1e-3 * each, at) for words, each, at in frames]
    away = [np.median(np.linalg.norm(at + each - tip, axis=1)) for _, each, at in frames]
    best = int(np.argmin(away))
    near = away[best] < _CLEARLY * min(away[0], length)
    hint = f"Likely cause: {frames[best][0]}." if near else ""
    where = _spans(names, measured)
    if inside.mean() < 1 - LOST:
        text = (
            f"got the tip at {where}; must lie within {_ROOM * length:.3g} m of the root at "
            f"{_spans(names, root)}. {hint or 'Check units, origin, axes and the sign of z.'}"
        )
        raise ScenarioError([Mistake("RECORD", text)])
    note = f"the record has the tip at {where}, the run at {_spans(names, tip)}. {hint}"
    return inside, [note] if hint and away[0] > _STUCK * length else []


def stuck(measured: Places, tip: Places, length: float) -> Bool[np.ndarray, " time"]:
    """Tell the rows of a marker that rests while the tip (m) of the fit moves on.

    The arm is `length` (m) long.
    """
    same = np.all(np.diff(measured, axis=0) == 0, axis=1)
    starts = np.flatnonzero(np.append(True, ~same))
    way = np.maximum.reduceat(tip, starts) - np.minimum.reduceat(tip, starts)
    return np.repeat(way.max(axis=1) > _STUCK * length, np.diff(starts, append=len(tip)))


def _spans(names: Sequence[str], places: Places) -> str:
    ends = zip(names, places.min(axis=0), places.max(axis=0), strict=True)
    return ", ".join(f"{name} = {low:.4g} to {high:.4g} m" for name, low, high in ends)
