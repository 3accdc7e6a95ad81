"""When and at which heights a record was taken, in SI units."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.recording.opening import numbers_of
from crinoid.recording.refusal import refusal
from crinoid.recording.units import length_factor, time_factor
from crinoid.scenario.errors import counted, shown
from crinoid.scenario.quantity import INTERVALS

_FARTHEST = 1e5
"""No level is as far from the surface (m)."""
_THINNEST = 1e-6
"""Levels that are less apart are one (m)."""


def only_dimension(variable: xr.DataArray, key: str) -> str:
    """Return the dimension of a variable that is to have one."""
    if variable.ndim != 1:
        dims = ", ".join(map(str, variable.dims)) or "none"
        raise refusal(
            key, f"got {variable.name} with dimensions {dims}; takes a variable of one dimension"
        )
    return str(variable.dims[0])


def seconds(
    variable: xr.DataArray, remarks: list[str], *, key: str = "time"
) -> Float[np.ndarray, " time"]:
    """Return the times of a record (s) since its first sample."""
    name, takes = variable.name, "numbers that increase, or ISO dates"
    if variable.size < 2:
        raise refusal(key, f"{name} holds {counted(variable.size, 'instant')}, takes 2 or more")
    values = numbers_of(variable, key, takes)
    if not np.isfinite(values).all():
        raise refusal(key, f"{name} has an entry that is missing or infinite, takes {takes}")
    factor = factor_to(variable, time_factor, key, "seconds", remarks)
    # whole numbers are kept whole up to here: nanoseconds since 1970 have more digits than floats
    with np.errstate(over="ignore"):
        time = (values - values[0]).astype(float) * factor
    # unsigned ones would wrap round
    late = np.flatnonzero(~(values[1:] > values[:-1]))
    if late.size:
        after = int(late[0]) + 1
        word = "repeats" if values[after] == values[after - 1] else "goes back"
        raise refusal(key, f"{name} {word} at entry {after}, takes times that increase")
    with np.errstate(invalid="ignore"):
        steps = np.diff(time)
    low, high = INTERVALS
    if not (steps.min() >= low and steps.max() <= high):
        text = f"{name} goes on in steps of {steps.min():.3g} to {steps.max():.3g} s"
        raise refusal(key, f"{text}, takes {low:g} to {high:g} s")
    return time


def heights(
    variable: xr.DataArray,
    sign: float,
    origin: float | None,
    bed: float | None,
    remarks: list[str],
) -> Float[np.ndarray, " level"]:
    """Return the heights z of levels (m), which count upward from the bed or from ``origin``.

    A depth counts downward from the surface (CF: ``positive = "down"``), and so do levels whose
    name has a minus sign.
    """
    takes = "heights or depths (m)"
    values = numbers_of(variable, "vertical", takes)
    if not np.isfinite(values).all():
        raise refusal(
            "vertical", f"{variable.name} has an entry that is missing or infinite, takes {takes}"
        )
    if np.unique(values).size < values.size:
        raise refusal("vertical", f"{variable.name} holds a level twice, takes levels that differ")
    positive = str(variable.attrs.get("positive", ""))
    down = positive == "down" or (
        str(variable.attrs.get("standard_name", "")) == "depth" and not positive
    )
    if origin is None:
        origin = 0.0 if down else bed
    if origin is None:
        text = (
            f"missing, takes the z from which {variable.name} counts (m), or water.depth: the bed"
        )
        raise refusal("origin", text)
    factor = factor_to(variable, length_factor, "vertical", "m", remarks)
    z = origin + (-1.0 if down else 1.0) * sign * factor * values.astype(float)
    if np.abs(z).max(initial=0.0) > _FARTHEST:
        text = f"{variable.name} reaches {np.abs(z).max():.6g} m, takes up to {_FARTHEST:g} m"
        raise refusal("vertical", text)
    if np.diff(np.sort(z)).min(initial=np.inf) < _THINNEST:
        text = f"{variable.name} has levels less than {_THINNEST:g} m apart"
        raise refusal("vertical", f"{text}, takes levels that differ")
    return z


def factor_to(
    variable: xr.DataArray,
    factor_of: Callable[[str], float | None],
    key: str,
    unit: str,
    remarks: list[str],
) -> float:
    """Return what turns a variable into SI units; what it does not say becomes a remark."""
    units = variable.attrs.get("units")
    if units is None or not str(units).strip():
        remarks.append(f"{variable.name} names no unit and is taken to be in {unit}")
        units = unit
    factor = factor_of(str(units))
    if factor is None:
        raise refusal(
            key, f"{variable.name} is in {shown(str(units))}, takes a unit such as {unit}"
        )
    return factor
