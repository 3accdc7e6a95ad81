"""Going on from an earlier result, if that is whole and of this program."""

import math
from typing import Any

import numpy as np
import xarray as xr

from crinoid.elements import WORKS
from crinoid.result import UNFINISHED, Result, ResultError
from crinoid.scenario import counted
from crinoid.simulation.loop import LoopState

_SAME = 1e-9
"""Difference, of the largest number of its kind, that is round-off."""


def restored(
    earlier: Result, start: LoopState, first: xr.Dataset, stride: int
) -> tuple[LoopState, xr.Dataset]:
    """Return the state to go on from and what was kept before it.

    Parameters
    ----------
    earlier
        What was saved.
    start
        The state at the start, of the same kind.
    first
        The first instant as a dataset: what there is to be at each.
    stride
        Number of time steps between kept instants.
    """
    carry, kept = earlier.restore(start), earlier.dataset
    _check_variables(kept, first)
    for name, leaf in earlier.checkpoint.items():
        if leaf.dtype.kind == "f" and np.isnan(leaf).any():
            raise ResultError(f"its state cannot be gone on from: {name} is not a number")
    instants = 1 + int(carry.steps) // stride
    cut = earlier.status == UNFINISHED
    if cut:  # the file may be ahead of its checkpoint
        kept = kept.isel(time=slice(instants))
    if not (cut and int(carry.tally.steps)):  # else the state is later than any instant
        _check_last(kept, carry)
    _check_steps(kept, carry, stride, cut=cut)
    # if it stopped between two instants that are kept, its last one is not among them
    return carry, kept.isel(time=slice(instants))


def _check_variables(kept: xr.Dataset, first: xr.Dataset) -> None:
    sizes = dict(first.sizes) | {"time": kept.sizes["time"]}
    for name, wanted in first.variables.items():
        found = kept.variables.get(name)
        if found is None:
            raise ResultError(f"it has no {name}, which output.variables may have left out")
        shape = tuple(sizes[dim] for dim in wanted.dims)
        if (found.dims, found.shape) != (wanted.dims, shape):
            raise ResultError(f"its {name} has the shape {found.shape}, not {shape}")
        if found.dtype.kind != wanted.dtype.kind and not _texts(found, wanted):
            raise ResultError(f"its {name} is of {found.dtype}, not {wanted.dtype}")
    time, wall_time = kept["time"].values, float(kept.attrs["wall_time"])
    if not np.isfinite(time).all() or (np.diff(time) <= 0).any() or time[0] != 0:
        raise ResultError("its time does not increase from 0 on")
    if not math.isfinite(wall_time) or wall_time < 0:
        raise ResultError(f"its wall_time is {wall_time}")


def _texts(*variables: Any) -> bool:
    return all(variable.dtype.kind in "OUT" for variable in variables)


def _check_last(kept: xr.Dataset, carry: LoopState) -> None:
    """Refuse a state that is not that of the last instant."""
    state = carry.state
    saved = {
        "time": state.time,
        "velocity": state.velocity[1:],
        "acceleration": state.acceleration[1:],
        "base_command": carry.command[: kept.sizes["channel"]],
    }
    if "actuator_command" in kept:
        saved["actuator_command"] = carry.command[kept.sizes["channel"] :]
    last = {name: kept[name].values[-1] for name in [*saved, "position"]}
    last["work"] = kept["energy"].sel(kind=list(WORKS)).values[-1]
    scales = {name: float(np.abs(value).max(initial=0.0)) for name, value in last.items()}
    assert carry.books is not None
    saved["work"] = carry.books.work
    # nodes are kept from the world's origin, and stepped from the base's
    saved["position"] = np.diff(state.position[1:], axis=0)
    last["position"] = np.diff(last["position"], axis=0)
    for name, leaf in saved.items():
        if not np.allclose(leaf, last[name], rtol=0, atol=_SAME * scales[name]):
            raise ResultError(f"its state is not that of its last instant: {name} is another")


def _check_steps(kept: xr.Dataset, carry: LoopState, stride: int, *, cut: bool) -> None:
    """Refuse counts that do not go with each other."""
    steps, since = int(carry.steps), int(carry.tally.steps)
    whole, left = divmod(steps, stride)
    instants = 1 + whole + (since > 0 and not cut)
    if steps < 0 or since < left or kept.sizes["time"] != instants:
        after = f"{counted(steps, 'time step')}, {since} of them since the last kept instant"
        held = counted(kept.sizes["time"], "instant")
        raise ResultError(f"it holds {held} and a state after {after}: they do not go together")
