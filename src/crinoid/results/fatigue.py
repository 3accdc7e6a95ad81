"""Fatigue life: ranges of bending stress at the surface by rainflow counting, and Miner's rule."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.results.chunks import pieces
from crinoid.results.errors import judged
from crinoid.results.loads import cycles_of, stretch_at_nodes
from crinoid.results.result import Result

YEAR = 365.25 * 86400.0
"""s."""
_AROUND = 16
"""Points around the section of an arm in space: between two of them lie 2 % of a range at most."""


class FatigueLife(NamedTuple):
    """Life of the arm in the conditions of a run, where it is shortest."""

    life: float  # year of 365.25 days; infinite without a cycle
    station: float  # distance from the root along the arm at rest (m)


def fatigue_life(result: Result) -> FatigueLife | None:
    """Return the fatigue life, from the time that counts; None without ``[arm.fatigue]``.

    Miner's rule (Miner 1945) adds up the damage ``S^m / a`` of cycles with the range ``S`` of
    stress, by rainflow counting (ASTM E1049-85). The stress is Young's modulus times the strain
    from stretch and bending, half a ``diameter`` from the axis, at points around each node.
    """
    data, arm, counted = result.dataset, result.scenario.arm, judged(result)
    if arm.fatigue is None or not {"curvature", "position"} <= set(data) or counted.sum() < 2:
        return None
    modulus = arm.fatigue.youngs_modulus or arm.youngs_modulus
    once = arm.fatigue.intercept ** (1 / arm.fatigue.slope)  # range of which one cycle breaks it
    damage = []
    for series in _reversals(result, int(np.argmax(counted))):
        sizes, counts = cycles_of(series)
        damage.append(float(counts @ (modulus * sizes / once) ** arm.fatigue.slope))
    time, worst = data["time"].values[counted], int(np.argmax(damage))
    lasted, points = float(time[-1] - time[0]) / YEAR, len(damage) // data.sizes["node"]
    life = lasted / damage[worst] if damage[worst] else math.inf
    return FatigueLife(life, float(data["arc_length"].values[worst // points]))


def combined_life(lives: Float[np.ndarray, " run"], shares: Float[np.ndarray, " run"]) -> float:
    """Return the life in conditions with shares of time (year): Miner's rule adds up ``p / L``.

    NaN where a life that counts is unknown.
    """
    damage = float(np.sum(shares[shares > 0] / lives[shares > 0]))
    return 1 / damage if damage else math.inf


def _reversals(result: Result, first: int) -> Iterator[Float[np.ndarray, " reversal"]]:
    """Yield the strain at each point of each node where it reverses, and at ends of pieces."""
    kept: list[list[np.ndarray]] = []
    for part in pieces(result.dataset.isel(time=slice(first, None)), ["curvature", "position"]):
        strain = _surface_strain(part)
        rising = np.sign(np.diff(strain, axis=0))
        turns = np.ones(strain.shape, bool)
        turns[1:-1] = rising[1:] != rising[:-1]
        kept.append([values[at] for values, at in zip(strain.T, turns.T, strict=True)])
    for each in zip(*kept, strict=True):
        yield np.concatenate(each)


def _surface_strain(part: xr.Dataset) -> Float[np.ndarray, "time node_by_point"]:
    """Return the strain at points around each node: two in the plane."""
    curvature, around = part["curvature"].values, np.array([[1.0, -1.0]])
    if curvature.ndim == 2:
        curvature = curvature[..., None]
    else:
        angles = 2 * np.pi * np.arange(_AROUND) / _AROUND
        around = np.stack([np.cos(angles), np.sin(angles)])
    bent = part["diameter"].values[:, None] / 2 * (curvature @ around)
    return np.reshape(stretch_at_nodes(part)[..., None] + bent, (len(curvature), -1))
