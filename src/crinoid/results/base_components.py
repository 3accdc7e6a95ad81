"""Loads on the base by component: least and greatest values and their times, from the start."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.results.result import Result


class ComponentRange(NamedTuple):
    """Least and greatest value of a component (N, N m) over the saved instants, and their times."""

    min: float
    min_time: float
    """s."""
    max: float
    max_time: float
    """s."""


class ComponentRanges(dict[str, ComponentRange]):
    """The components of force and moment by name, such as ``force_x``."""

    def __getattr__(self, name: str) -> float | None:
        """Return a number such as ``force_x_min_time``; None of a component that does not exist."""
        load, axis, field = name.split("_", 2)
        found = self.get(f"{load}_{axis}")
        return None if found is None else float(getattr(found, field))


def base_components(result: Result) -> ComponentRanges:
    """Return the range of each component of the load on the base, right-handed about each axis.

    A planar arm has ``force_x``, ``force_z`` and ``moment_y``, which is positive from z toward x.
    """
    data, found = result.dataset, ComponentRanges()
    for load in ("force", "moment"):
        values = data[f"base_{load}"].values
        if values.ndim == 1:
            found[f"{load}_y"] = _range(data["time"].values, 0.0 - values)
            continue
        for axis, component in zip(data["axis"].values, values.T, strict=True):
            found[f"{load}_{axis}"] = _range(data["time"].values, component)
    return found


def _range(time: Float[np.ndarray, " time"], values: Float[np.ndarray, " time"]) -> ComponentRange:
    least, greatest = int(np.argmin(values)), int(np.argmax(values))
    return ComponentRange(values[least], time[least], values[greatest], time[greatest])
