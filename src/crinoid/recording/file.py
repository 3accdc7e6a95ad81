"""The parts of a file that make up a current: found, cut out, and in SI units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.recording.coordinates import factor_to, heights, only_dimension, seconds
from crinoid.recording.marks import check_marks
from crinoid.recording.opening import check_count, find, opened
from crinoid.recording.refusal import listed, refusal
from crinoid.recording.selection import component_of, labelled_by_text
from crinoid.recording.units import velocity_factor
from crinoid.scenario.errors import shown
from crinoid.scenario.measured import Component, MeasuredFlow

_FASTEST = 50.0
"""No current is as fast (m/s): such a number stands for a missing one."""


@dataclass(frozen=True)
class Cutting:
    """Part of a file that a flow asks for, as it was read."""

    time: Float[np.ndarray, " time"]
    """Time (s) since the first sample, increasing."""
    levels: Float[np.ndarray, " level"] | None
    """Heights z (m), in the order of the file; None for a record at one point."""
    velocity: Float[np.ndarray, "time level component"]
    """Velocity (m/s), not a number where it is missing; zero for a component named ``0``."""
    remarks: list[str]
    """Assumptions that had to be made, a sentence each."""


def cut_out(flow: MeasuredFlow, bed: float | None) -> Cutting:
    """Read the part of its file that a flow asks for, and no more.

    Parameters
    ----------
    flow
        What to read.
    bed
        Height z of the bed (m), if it is known.
    """
    with opened(flow.file, flow.time, flow.vertical) as dataset:
        remarks: list[str] = []
        clock = dataset[find(dataset, flow.time, "time", flow.file)]
        along = only_dimension(clock, "time")
        level, upright, sign = None, None, 1.0
        if flow.vertical is not None:
            component = Component.of(flow.vertical)
            if component is None or component.entry:
                raise refusal(
                    "vertical", f"got {shown(flow.vertical)}, takes the name of a variable"
                )
            level = dataset[find(dataset, component.name, "vertical", flow.file)]
            upright, sign = only_dimension(level, "vertical"), component.sign
        layers = 1 if level is None else level.size
        wanted = sum(item is not None for item in flow.components)
        check_count(clock.size * layers * wanted, flow.file, "this current")
        time = seconds(clock, remarks)
        levels = None
        if level is not None:
            levels = heights(level, sign, flow.origin, bed, remarks)
        velocity = np.zeros((time.size, layers, len(flow.components)))
        used: set[str] = set()
        for index, component in enumerate(flow.components):
            if component is not None:
                key = f"velocity.{index}"
                variable = dataset[find(dataset, component.name, key, flow.file)]
                part = component_of(variable, component, key, along, upright, flow, used)
                factor = component.sign * factor_to(variable, velocity_factor, key, "m/s", remarks)
                velocity[:, :, index] = factor * part
                _check_speed(velocity[:, :, index], key, component)
                check_marks(part, key, component.name)
        for dimension in flow.select:
            if dimension not in used:
                raise refusal(f"select.{dimension}", _unused(dataset, flow, along, upright))
    return Cutting(time, levels, velocity, remarks)


def _unused(dataset: xr.Dataset, flow: MeasuredFlow, along: str, upright: str | None) -> str:
    variables = [
        dataset[find(dataset, component.name, "velocity", flow.file)]
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
            "take a _FillValue that marks them, or in a CSV file an empty cell",
        )
