"""Check that a dataset has the variables, dimensions and attributes of a result."""

import xarray as xr

from crinoid.foundation.result_variables import of_dimension

_REQUIRED = (
    *("tip_position", "tip_target", "tip_error", "tip_angle"),
    *("base_command", "base_servo", "base_force", "base_moment"),
    *("channel_lower", "channel_upper", "channel_max_speed", "channel_max_acceleration"),
    *("energy", "steps", "newton_iterations", "residual"),
)
_MOTION = ("position", "velocity", "acceleration")
"""Variables without which a file is no result, and those that a scenario may leave out."""


def fault_of(dataset: xr.Dataset, *, positions: bool) -> str:
    """Return what a dataset lacks of a result, such as ``it has no energy``; empty if nothing.

    Motion along the arm counts only with ``positions``.
    """
    for name in ("time", "axis", "channel", "kind"):
        if name not in dataset.variables or dataset[name].dims != (name,):
            return f"it has no {name} over {name}"
    for name in (*_REQUIRED, *(_MOTION if positions else ())):
        if name not in dataset.variables:
            return f"it has no {name}"
    expected = {name: each.dims for name, each in of_dimension(dataset.sizes["axis"]).items()}
    for name, dims in {"time": ("time",), **expected}.items():
        found = dataset.variables.get(name)
        if found is not None and (found.dims != dims or found.dtype.kind not in "fi"):
            return f"its {name} is no array of numbers over {', '.join(dims)}"
    if not dataset.sizes["time"]:
        return "it holds no instant"
    for name, kind in {"status": str, "scenario": str, "wall_time": float}.items():
        if not isinstance(dataset.attrs.get(name), kind):
            return f"it does not say its {name}"
    return ""
