"""When and at which heights a record was taken, in SI units."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.scenario.errors import shown
from crinoid.scenario.recording.refusal import refusal
from crinoid.scenario.recording.units import length_factor, time_factor


def only_dimension(variable: xr.DataArray, key: str) -> str:
    """Return the dimension of a variable that is to have one."""
    if variable.ndim != 1:
        dims = ", ".join(map(str, variable.dims)) or "none"
        raise refusal(
            key, f"got {variable.name} with dimensions {dims}; takes a variable of one dimension"
        )
    return str(variable.dims[0])


def seconds(variable: xr.DataArray, remarks: list[str]) -> Float[np.ndarray, " time"]:
    """Return the times of a record (s) since its first sample."""
    name, values = variable.name, np.asarray(variable.values)
    if values.size < 2:
        raise refusal("time", f"{name} holds {values.size} instants, takes 2 or more")
    if values.dtype.kind not in "iuf" or not np.isfinite(values).all():
        raise refusal("time", f"{name} holds what is no number, takes numbers that increase")
    factor = factor_to(variable, time_factor, "time", "seconds", remarks)
    # whole numbers are kept whole up to here: nanoseconds since 1970 have more digits than floats
    time = (values - values[0]).astype(float) * factor
    # unsigned ones would wrap round
    late = np.flatnonzero(~(values[1:] > values[:-1]))
    if late.size:
        after = int(late[0]) + 1
        word = "repeats" if values[after] == values[after - 1] else "goes back"
        raise refusal("time", f"{name} {word} at entry {after}, takes times that increase")
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
    values = np.asarray(variable.values)
    if values.dtype.kind not in "iuf" or not np.isfinite(values).all():
        raise refusal(
            "vertical", f"{variable.name} holds what is no number, takes heights or depths (m)"
        )
    if np.unique(values).size < values.size:
        raise refusal("vertical", f"{variable.name} holds a level twice, takes levels that differ")
    down = variable.attrs.get("positive") == "down" or (
        variable.attrs.get("standard_name") == "depth" and "positive" not in variable.attrs
    )
    if origin is None:
        origin = 0.0 if down else bed
    if origin is None:
        text = (
            f"missing, takes the z from which {variable.name} counts (m), or water.depth: the bed"
        )
        raise refusal("origin", text)
    factor = factor_to(variable, length_factor, "vertical", "m", remarks)
    return origin + (-1.0 if down else 1.0) * sign * factor * values.astype(float)


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
        return 1.0
    factor = factor_of(str(units))
    if factor is None:
        raise refusal(
            key, f"{variable.name} is in {shown(str(units))}, takes a unit such as {unit}"
        )
    return factor
