"""Checks of the frame of a record: places within reach of the arm, and markers that rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from crinoid.scenario import ScenarioError

LOST = 0.25
"""Largest share of the rows that may be set aside as lost markers."""
_REACH = 1.25
"""Largest distance of a record from the root, over the arm's length in the run."""
_STUCK = 0.02
"""Path of the tip in the run, over the arm's length, along which a resting marker is stuck."""
_CLEARLY = 0.2
"""Largest distance of another reading from the run, over that of the record and the length."""

Places = Float[np.ndarray, "time axis"]


def within_reach(
    subject: str,
    names: Sequence[str],
    measured: Places,
    root: Places,
    tip: Places,
    length: float,
) -> tuple[Bool[np.ndarray, " time"], list[str]]:
    """Return the rows that the arm can reach, and a note if the record fits in another reading.

    Places (m) of the ``subject`` have the axes ``names``. Root and ``tip`` are those of a run whose
    arm is at most ``length`` (m) long.
    """
    inside = np.linalg.norm(measured - root, axis=1) <= _REACH * length
    turned = np.where(np.array(names) == "z", -1.0, 1.0) * measured
    frames: list[tuple[str, Places, Places | float]] = [
        ("all else is right", measured, 0.0),
        ("positions are measured from the base", measured, root),
        ("heights are positive down", turned, 0.0),
        ("positions are measured from the base, positive down", turned, root),
        ("axes are swapped", np.hstack([measured[:, :-2], measured[:, :-3:-1]]), 0.0),
    ]
    frames += [(f"lengths are in mm; {words}", 1e-3 * each, at) for words, each, at in frames]
    distances = [np.median(np.linalg.norm(at + each - tip, axis=1)) for _, each, at in frames]
    best = int(np.argmin(distances))
    near = distances[best] < _CLEARLY * min(distances[0], length)
    hint = f"Likely cause: {frames[best][0]}." if near else ""
    where = _ranges(names, measured)
    if inside.mean() < 1 - LOST:
        text = (
            f"got {subject} at {where}; must lie within {_REACH * length:.3g} m of the root at "
            f"{_ranges(names, root)}. {hint or 'Check units, origin, axes and the sign of z.'}"
        )
        raise ScenarioError.of("RECORD", text)
    note = f"the record has {subject} at {where}, the run at {_ranges(names, tip)}. {hint}"
    return inside, [note] if hint and distances[0] > _STUCK * length else []


def stuck(measured: Places, tip: Places, length: float) -> Bool[np.ndarray, " time"]:
    """Return the rows of a marker that rests while the tip (m) of the fit moves.

    ``length`` (m) is that of the arm.
    """
    same = np.all(np.diff(measured, axis=0) == 0, axis=1)
    starts = np.flatnonzero(np.append(True, ~same))
    path = np.maximum.reduceat(tip, starts) - np.minimum.reduceat(tip, starts)
    return np.repeat(path.max(axis=1) > _STUCK * length, np.diff(starts, append=len(tip)))


def _ranges(names: Sequence[str], places: Places) -> str:
    ends = zip(names, places.min(axis=0), places.max(axis=0), strict=True)
    return ", ".join(f"{name} = {low:.4g} to {high:.4g} m" for name, low, high in ends)
