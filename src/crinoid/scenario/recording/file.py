"""What of a netCDF file makes up a current: found, cut out, and in SI units."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.scenario.errors import ScenarioError, shown
from crinoid.scenario.measured import Component, MeasuredFlow
from crinoid.scenario.recording.coordinates import factor_to, heights, only_dimension, seconds
from crinoid.scenario.recording.refusal import listed, refusal
from crinoid.scenario.recording.selection import component_of, labelled_by_text
from crinoid.scenario.recording.units import velocity_factor

_MAX_VALUES = 20_000_000
"""More than that, splines included, takes gigabytes."""
_FASTEST = 50.0
"""No current is as fast (m/s): such a number stands for a missing one."""


@dataclass(frozen=True)
class Cutting:
    """What was found in a file."""

    time: Float[np.ndarray, " time"]
    """Time (s) since the first sample, increasing."""
    levels: Float[np.ndarray, " level"] | None
    """Heights z (m), in the order of the file; None for a record of one place."""
    velocity: Float[np.ndarray, "time level component"]
    """Velocity (m/s), not a number where it is missing; zero for a component named ``0``."""
    remarks: list[str]
    """What had to be assumed."""


def cut_out(flow: MeasuredFlow, bed: float | None) -> Cutting:
    """Read what a flow asks for from its file, and no more of it.

    Parameters
    ----------
    flow
        What to read.
    bed
        Height z of the bed (m), if it is known.

    Raises
    ------
    ScenarioError
        If the file cannot be read or does not hold what is asked for.
    """
    with _opened(flow.file) as dataset:
        remarks: list[str] = []
        name = _find(dataset, flow.time, "time", flow.file)
        along = only_dimension(dataset[name], "time")
        time = seconds(dataset[name], remarks)
        levels, upright = None, None
        if flow.vertical is not None:
            component = Component.of(flow.vertical)
            if component is None or component.entry:
                raise refusal(
                    "vertical", f"got {shown(flow.vertical)}, takes the name of a variable"
                )
            level = dataset[_find(dataset, component.name, "vertical", flow.file)]
            upright = only_dimension(level, "vertical")
            levels = heights(level, component.sign, flow.origin, bed, remarks)
        layers = 1 if levels is None else levels.size
        count = time.size * layers * sum(item is not None for item in flow.components)
        if count > _MAX_VALUES:
            raise refusal(
                "file",
                f"{_short(flow.file)} holds {count} values of this current, takes up to "
                f"{_MAX_VALUES}; cut out the part that is needed",
            )
        velocity = np.zeros((time.size, layers, len(flow.components)))
        used: set[str] = set()
        for index, component in enumerate(flow.components):
            if component is not None:
                key = f"velocity.{index}"
                variable = dataset[_find(dataset, component.name, key, flow.file)]
                part = component_of(variable, component, key, along, upright, flow, used)
                factor = component.sign * factor_to(variable, velocity_factor, key, "m/s", remarks)
                velocity[:, :, index] = factor * part
                _check_speed(velocity[:, :, index], key, component)
        for dimension in flow.select:
            if dimension not in used:
                raise refusal(f"select.{dimension}", _unused(dataset, flow, along, upright))
    return Cutting(time, levels, velocity, remarks)


@contextmanager
def _opened(file: str) -> Iterator[xr.Dataset]:
    """Open a file for what is asked of it; nothing is read before."""
    if os.path.isdir(file):
        raise refusal("file", f"{_short(file)} is a folder, takes a netCDF file")
    try:
        # times are turned into seconds here: dates would only be in the way
        dataset = xr.open_dataset(file, engine="netcdf4", decode_times=False)
    except FileNotFoundError:
        raise refusal("file", f"{file}: no such file") from None
    except PermissionError:
        raise refusal("file", f"{file}: may not be read") from None
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        raise _broken(file, error) from error
    with dataset:
        try:
            yield dataset
        except (OSError, RuntimeError) as error:  # only now does it read
            raise _broken(file, error) from error


def _broken(file: str, error: Exception) -> ScenarioError:
    reason = " ".join(str(getattr(error, "strerror", None) or error).split())
    return refusal("file", f"{_short(file)} is broken or no netCDF file ({reason})")


def _find(dataset: xr.Dataset, name: str, key: str, file: str) -> str:
    """Return the variable of a name or a CF standard name."""
    if name in dataset.variables:
        return name
    standard = {
        str(variable): str(dataset[variable].attrs["standard_name"])
        for variable in dataset.variables
        if "standard_name" in dataset[variable].attrs
    }
    found = [variable for variable, text in standard.items() if text == name]
    if len(found) == 1:
        return found[0]
    if found:
        raise refusal(key, f"got {shown(name)}, which several variables are; takes {listed(found)}")
    names = [str(variable) for variable in dataset.variables]
    near = get_close_matches(name, [*names, *standard.values()], n=1)
    hint = f"did you mean {near[0]}?" if near else f"it holds {listed(names) or 'none'}"
    raise refusal(key, f"got {shown(name)}, no such variable in {_short(file)}; {hint}")


def _unused(dataset: xr.Dataset, flow: MeasuredFlow, along: str, upright: str | None) -> str:
    variables = [
        dataset[_find(dataset, component.name, "velocity", flow.file)]
        for component in flow.components
        if component is not None
    ]
    dims = {
        str(dimension)
        for variable in variables
        for dimension in variable.dims
        if dimension not in (along, upright) and not labelled_by_text(variable, str(dimension))
    }
    text = "no dimension to select in"
    return f"{text}; takes {listed(sorted(dims))}" if dims else f"{text}, there is none"


def _check_speed(values: np.ndarray, key: str, component: Component) -> None:
    fastest = float(np.nanmax(np.abs(values), initial=0.0))
    if fastest > _FASTEST:
        raise refusal(
            key,
            f"{component.name} reaches {fastest:g} m/s, takes up to {_FASTEST:g}; missing values "
            "take a _FillValue that marks them",
        )


def _short(file: str) -> str:
    return Path(file).name
