"""Lock-in of vortex shedding to the modes of an arm, in a run that does not model its lift."""

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from crinoid.assembly.facts import Facts
from crinoid.results.chunks import pieces
from crinoid.results.dimensionless import MOTION, bending, length_share, normal_velocity

_CYCLES = 3.0  # periods of a mode that lock-in must last to build up before a swing reverses it
_SHEDDING = 50.0  # Reynolds number above which vortices are shed (Williamson 1996: 49)
_NOTED = 0.05  # share of the time, and of the length, above which lock-in deserves a note
_MOSTLY = 0.5
"""Share of the time at a node above which lock-in to a mean flow counts, in spite of gaps."""


def lock_in_note(dataset: xr.Dataset, facts: Facts) -> str:
    """Return the note on lock-in that a run does not model; empty without it."""
    water, spatial = facts.scenario.water, dataset.sizes["axis"] == 3
    if "reduced_velocity" not in dataset or (water.vortices is not None and spatial):
        return ""
    low, high = facts.lock_in
    time, diameter = dataset["time"].values, dataset["diameter"].values
    shapes, tangent = dataset["mode_shape"].values, dataset["tangent"].values[0]
    spin = dataset["mode_spin"].values if spatial else None
    modes = dataset["mode"].values[bending(shapes, spin, tangent, diameter)]
    frequency = dataset["natural_frequency"].sel(mode=modes).values
    total = sum(normal_velocity(piece).sum(axis=0) for piece in pieces(dataset, MOTION))
    mean = np.asarray(total) / time.size
    inside: list[list[np.ndarray]] = [[] for _ in modes]
    ahead = np.zeros(len(mean))
    for piece in pieces(dataset, MOTION):
        velocity = normal_velocity(piece)
        speed = np.linalg.norm(velocity, axis=2)
        ahead += np.sum(np.einsum("tni,ni->tn", velocity, mean) >= 0, axis=0) / time.size
        sheds = speed * diameter > _SHEDDING * water.kinematic_viscosity
        for each, its in zip(frequency, inside, strict=True):
            reduced = speed / (each * diameter)
            its.append(sheds & (reduced > low) & (reduced < high))
    steady = np.linalg.norm(mean, axis=1)
    struck, share = [], length_share(dataset)
    for mode, each, its in zip(modes, frequency, inside, strict=True):
        locked, least = np.concatenate(its), _CYCLES / each
        part = lasting_share(locked, time, least, share)
        at = part > _NOTED
        if at.mean() <= _NOTED and np.ptp(time) >= least:
            # or with gaps, in a flow that hardly ever reverses
            lasts = (steady > low * each * diameter) & (steady < high * each * diameter)
            lasts &= (locked.mean(axis=0) > _MOSTLY) & (ahead > 1 - _NOTED)
            part = np.where(lasts, locked * share, 0.0).sum(axis=1)
            at = part > _NOTED
        if at.mean() > _NOTED:
            struck.append(
                f"mode {mode} ({each:.2g} Hz) for {at.mean():.0%} of the time on "
                f"{part[at].mean():.0%} of the length"
            )
    if not struck:
        return ""
    where, hint = "out of the plane of the arm", ""
    if spatial:
        where, hint = "across both arm and current", ". Add [water.vortices]"
    return (
        f"vortex shedding may lock in to {', '.join(struck)} ({low:.3g} < U/fd < {high:.3g}, "
        f"U across the arm); its lift, {where}, is not modelled{hint}"
    )


def lasting_share(
    inside: Bool[np.ndarray, "time node"],
    time: Float[np.ndarray, " time"],
    least: float,
    of: Float[np.ndarray, " node"],
) -> Float[np.ndarray, " time"]:
    """Return the sum of ``of`` over the nodes where a condition lasts, at each instant.

    The condition is true ``inside``, and counts only if it lasts for ``least`` or longer (s).
    """
    edges = np.diff(np.pad(inside, ((1, 1), (0, 0))).astype(np.int8), axis=0).T
    # starts and ends alternate at each node
    (node, begin), (_, end) = np.nonzero(edges == 1), np.nonzero(edges == -1)
    long = time[end - 1] - time[begin] >= least
    marks = np.zeros((2, time.size + 1))
    np.add.at(marks[0], begin[long], of[node[long]])
    np.add.at(marks[1], end[long], of[node[long]])
    return np.cumsum(marks[0] - marks[1])[:-1]
