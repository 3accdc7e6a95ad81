"""Where a record of the tip lies, and where the arm can reach."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from crinoid.scenario import Mistake, ScenarioError

__all__ = ["LOST", "within_reach"]

LOST = 0.25
"""Largest share of the rows that may be set aside as lost markers."""
_ROOM = 1.25
"""Distance from the root that a record may have, over the arm's length in the run."""
_STUCK = 0.02
"""Way of the tip over the arm's length, during which a record that stays the same is stuck."""
_CLEARLY = 0.2
"""Distance from the run, over that of the record as it is, from which on another reading fits."""
_UNITS = {"": 1.0, "lengths in cm": 0.01, "lengths in mm": 0.001}

Places = Float[np.ndarray, "time axis"]


def within_reach(
    names: Sequence[str], measured: Places, root: Places, tip: Places, length: float
) -> tuple[Bool[np.ndarray, " time"], list[str]]:
    """Tell which rows of a record the arm can reach; return a note where another reading fits.

    Parameters
    ----------
    names
        Axes that were measured.
    measured, root, tip
        Places on these axes (m): of the record, and in the run with the numbers given.
    length
        Largest length of the arm in that run (m).

    Raises
    ------
    ScenarioError
        If the arm reaches too few rows.
    """
    changed = np.any(np.diff(measured, axis=0) != 0, axis=1)
    starts = np.flatnonzero(np.append(True, changed))  # of rows that stay the same
    way = np.maximum.reduceat(tip, starts) - np.minimum.reduceat(tip, starts)
    stuck = np.repeat(way.max(axis=1) > _STUCK * length, np.diff(starts, append=len(tip)))
    inside = np.linalg.norm(measured - root, axis=1) <= _ROOM * length
    kept = inside & ~stuck
    down = np.where(np.array(names) == "z", -1.0, 1.0)
    frames: dict[str, tuple[Places, Places | float]] = {
        "": (measured, 0.0),
        "positions from the base": (measured, root),
        "heights positive down": (down * measured, 0.0),
        "positions from the base, heights positive down": (down * measured, root),
        "axes in another order": (np.hstack([measured[:, :-2], measured[:, :-3:-1]]), 0.0),
    }
    away = {
        ", ".join(filter(None, (unit, frame))): np.median(
            np.linalg.norm(origin + scale * places - tip, axis=1)
        )
        for (unit, scale), (frame, (places, origin)) in product(_UNITS.items(), frames.items())
    }
    cause = min(away, key=lambda each: away[each])
    hint = f"Likely cause: {cause}." if away[cause] < _CLEARLY * away[""] else ""
    where = _spans(names, measured)
    if kept.mean() < 1 - LOST:
        if inside.mean() >= 1 - LOST:
            hint = "The marker is stuck: its place stays the same while the arm moves."
        text = (
            f"got the tip at {where}; must lie within {_ROOM * length:.3g} m of the root at "
            f"{_spans(names, root)}. {hint or 'Check units, origin, axes and the sign of z.'}"
        )
        raise ScenarioError([Mistake("RECORD", text)])
    note = f"the record has the tip at {where}, the run at {_spans(names, tip)}. {hint}"
    return kept, [note] if hint and away[""] > _STUCK * length else []


def _spans(names: Sequence[str], places: Places) -> str:
    ends = zip(names, places.min(axis=0), places.max(axis=0), strict=True)
    return ", ".join(f"{name} = {low:.4g} to {high:.4g} m" for name, low, high in ends)
