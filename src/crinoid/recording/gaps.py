"""Gaps in a record: levels that are mostly missing are left out, gaps in time are filled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from crinoid.recording.refusal import refusal

_MOST = 0.5
"""Smallest share of a level that must have been measured."""
_LATE = 1.5
"""A sample later than this, in usual intervals, comes after samples that are missing."""


class Whole(NamedTuple):
    """A record without gaps."""

    time: Float[np.ndarray, " time"]
    """Time (s), with the instants that the file left out."""
    levels: Float[np.ndarray, " kept"] | None
    velocity: Float[np.ndarray, "time kept component"]
    filled: Bool[np.ndarray, "time kept"]
    """Whether anything was missing."""
    remarks: list[str]
    """Levels left out and gaps filled, a sentence each."""


def fill(
    time: Float[np.ndarray, " time"],
    levels: Float[np.ndarray, " level"] | None,
    velocity: Float[np.ndarray, "time level component"],
    names: list[str],
) -> Whole:
    """Fill the gaps of a record by straight lines in time, and leave out empty levels.

    Parameters
    ----------
    time
        Time (s), increasing.
    levels
        Heights z (m), if there are several.
    velocity
        Velocity (m/s), not a number where it is missing.
    names
        What to call the components.
    """
    steps = np.diff(time)
    absent = np.maximum(np.rint(steps / np.median(steps)).astype(int) - 1, 0)
    absent[steps <= _LATE * np.median(steps)] = 0
    if absent.sum(dtype=float) >= time.size:
        text = f"most samples are missing at the usual interval of {np.median(steps):.6g} s"
        raise refusal("time", f"{text}; takes a record in one piece: cut one out")
    places = np.concatenate([[0], np.cumsum(absent + 1)])
    whole = np.interp(np.arange(places[-1] + 1), places, time)
    measured = np.zeros((whole.size, *velocity.shape[1:]), bool)
    measured[places] = np.isfinite(velocity)
    kept = (measured.mean(axis=0) >= _MOST).all(axis=1)
    if not kept.any():
        name, share = _emptiest(measured, names)
        text = f"{share:.0%} of {name} is missing, takes a record of which half is there"
        raise refusal("file", text + ("" if levels is None else ", at one level at least"))
    remarks = []
    if levels is not None and not kept.all():
        heights = ", ".join(f"{height:.6g}" for height in np.sort(levels[~kept]))
        remarks.append(f"most is missing at z = {heights} m: left out")
    measured = measured[:, kept]
    filled = np.empty(measured.shape)
    for level, component in np.ndindex(*measured.shape[1:]):
        there = measured[:, level, component]
        values = velocity[:, kept][:, level, component]
        filled[:, level, component] = np.interp(whole, whole[there], values[np.isfinite(values)])
    for component, name in enumerate(names):
        there = measured[:, :, component]
        if not there.all():
            remarks.append(
                f"{1 - there.mean():.2%} of {name} is missing and was filled by straight lines, "
                f"the longest gap {_longest_gap(whole, there):.4g} s"
            )
    levels = None if levels is None else levels[kept]
    lacking = np.logical_not(measured.all(axis=2))
    return Whole(whole, levels, filled, lacking, remarks)


def _emptiest(
    measured: Bool[np.ndarray, "time level component"], names: list[str]
) -> tuple[str, float]:
    share = 1 - measured.mean(axis=0).max(axis=0)
    return names[int(np.argmax(share))], float(share.max())


def _longest_gap(time: Float[np.ndarray, " time"], there: Bool[np.ndarray, "time level"]) -> float:
    """Return the longest time (s) between two samples of a level, or to the ends of the record."""
    ends = time[[0, -1]]
    gaps = [
        np.diff(np.concatenate([ends[:1], time[column], ends[1:]])).max()
        for column, missing in zip(there.T, ~there.T, strict=True)
        if missing.any()
    ]
    return float(max(gaps))
