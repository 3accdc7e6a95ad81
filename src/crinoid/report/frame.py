"""The frame in which shapes are drawn: the world's, or that of a base which travels far."""

import numpy as np
import xarray as xr

from crinoid.report.run import Run
from crinoid.report.view import View, arm_length

_FAR = 1.5  # travel of the base, of the arm's length, from which on the arm would look small
_PLACES = ("position", "tip_position", "tip_target", "obstacle_position")


def in_best_frame(run: Run) -> tuple[Run, str]:
    """Return a run as seen from the world, or from a base that travels far; and from what it is."""
    length = arm_length(run.result)
    if max(travel(data) for _, data in run.members) <= _FAR * length:
        return run, ""
    other = None if run.uncontrolled is None else beside_base(run.uncontrolled)
    return Run(beside_base(run.result), other), " from the base"


def travel(data: xr.Dataset) -> float:
    """Return how far the base ever is from where it began (m)."""
    root = data["position"].isel(node=0)
    away = root - root.isel(time=0)
    return float(np.sqrt((away**2).sum("axis")).max())


def beside_base(data: xr.Dataset) -> xr.Dataset:
    """Return a result with all positions measured from the base, wherever it goes."""
    root = data["position"].isel(node=0, drop=True)
    moved = {
        name: (data[name] - root).transpose(*data[name].dims) for name in _PLACES if name in data
    }
    return data.assign(moved)


def measured_from(view: View, about: str) -> list[str]:
    """Return the labels of a view's axes, with what positions are measured from."""
    return [label.replace(" (m)", f"{about} (m)") for label in view.labels]
