"""Check that a dataset has the variables, dimensions and attributes of a result."""

from collections.abc import Iterable

import numpy as np
import xarray as xr

from crinoid.foundation.axes import AXES
from crinoid.foundation.result_variables import of_dimension

_OF_RUN = (
    *("tip_position", "tip_target", "tip_error", "tip_angle"),
    *("base_command", "base_servo", "base_force", "base_moment"),
    *("channel", "channel_lower", "channel_upper", "channel_max_speed", "channel_max_acceleration"),
    *("energy", "kind", "steps", "newton_iterations", "residual"),
)
_MOTION = ("position", "velocity", "acceleration")
"""Variables without which a file is no result, and those that a scenario may leave out."""


def fault_of_run(dataset: xr.Dataset, *, positions: bool) -> str:
    """Return what a dataset lacks of a run that can be read as a whole; empty if nothing.

    Motion along the arm counts only with ``positions``.
    """
    if fault := fault_of(dataset, (*_OF_RUN, *(_MOTION if positions else ()))):
        return fault
    for name, kind in {"status": str, "scenario": str, "wall_time": float}.items():
        if not isinstance(dataset.attrs.get(name), kind):
            return f"it does not say its {name}"
    return ""


def fault_of(dataset: xr.Dataset, required: Iterable[str]) -> str:
    """Return what a dataset lacks of a result, such as ``it has no energy``; empty if nothing.

    Of its variables only those that are ``required`` must be there; none may have other dimensions.
    """
    for name in ("time", "axis"):
        if name not in dataset.coords or dataset[name].dims != (name,):
            return f"it has no {name} over {name}"
    axes = tuple(map(str, dataset["axis"].values))
    if axes not in AXES.values():
        return "its axes are not labelled x and z, or x, y, z"
    for name in required:
        if name not in dataset.variables:
            return f"it has no {name}"
    expected = {name: each.dims for name, each in of_dimension(len(axes)).items()}
    for name, dims in {"time": ("time",), **expected}.items():
        found = dataset.variables.get(name)
        if found is not None and (found.dims != dims or found.dtype.kind not in "fi"):
            return f"its {name} is no array of numbers over {', '.join(dims)}"
    time = dataset["time"].values
    if not time.size:
        return "it holds no instant"
    if not (np.isfinite(time).all() and (np.diff(time) > 0.0).all()):
        return "its times do not rise"
    return "its arm has fewer than two nodes" if dataset.sizes.get("node", 0) < 2 else ""
