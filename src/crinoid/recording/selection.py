"""Selection of a current from a file: the velocity at times and levels, in SI units."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.recording.opening import (
    check_count,
    factor_to,
    find,
    heights,
    numbers_of,
    only_dimension,
    opened,
    seconds,
)
from crinoid.recording.series import FilledRecord, fill
from crinoid.recording.table import MARKED, check_marks, listed, velocity_factor
from crinoid.scenario.errors import ScenarioError, got, refusal, shown
from crinoid.scenario.flow import Component, MeasuredFlow

_FASTEST = 50.0
"""No current is so fast (m/s): such a number marks a missing value."""


def _velocity_of(
    variable: xr.DataArray,
    component: Component,
    key: str,
    along: str,
    upright: str | None,
    flow: MeasuredFlow,
    used: set[str],
) -> Float[np.ndarray, "time level"]:
    """Return one component of the velocity; ``used`` collects the dimensions of ``select``."""
    name = component.name
    if len(set(variable.dims)) < variable.ndim:
        dims = ", ".join(map(str, variable.dims))
        raise refusal(key, f"{name} has dimensions {dims}", "have each dimension once")
    for dimension, which in ((along, "time"), (upright, "vertical")):
        if dimension is not None and dimension not in variable.dims:
            raise refusal(key, f"{name} lacks a dimension", f"have {dimension}, as {which}")
    if component.entry:
        variable = _entry(variable, component, key, {along, upright})
    for dimension in map(str, variable.dims):
        if dimension in (along, upright):
            continue
        if dimension in flow.select:
            used.add(dimension)
            variable = variable.isel({dimension: _nearest(variable, dimension, flow)})
        elif variable.sizes[dimension] == 1:
            variable = variable.isel({dimension: 0})
        else:
            raise _left_over(variable, component, key, dimension, profile=upright is not None)
    order = [along] if upright is None else [along, upright]
    values = numbers_of(variable.transpose(*order), key, "a velocity")
    values = values.astype(float).reshape(values.shape[0], -1)
    return np.where(np.isfinite(values), values, np.nan)


def _entry(
    variable: xr.DataArray, component: Component, key: str, other: set[str | None]
) -> xr.DataArray:
    labels = {
        str(dimension): _labels(variable, str(dimension))
        for dimension in variable.dims
        if dimension not in other and dimension in variable.coords
    }
    found = [dimension for dimension, texts in labels.items() if component.entry in texts]
    if len(found) != 1:
        known = "; ".join(f"{dimension}: {listed(texts)}" for dimension, texts in labels.items())
        must = f"name one of {known}" if known else "name no entry of a variable without labels"
        raise refusal(key, f"{component.name} has no entry {shown(component.entry)}", must)
    return variable.isel({found[0]: labels[found[0]].index(component.entry)})


def _is_labelled(variable: xr.DataArray, dimension: str) -> bool:
    """Return whether the entries of a dimension have names instead of numbers."""
    return dimension in variable.coords and variable.coords[dimension].dtype.kind not in "iuf"


def _labels(variable: xr.DataArray, dimension: str) -> list[str]:
    values = variable.coords[dimension].values
    texts = [item.decode() if isinstance(item, bytes) else str(item) for item in values.tolist()]
    return [text.strip() for text in texts]


def _nearest(variable: xr.DataArray, dimension: str, flow: MeasuredFlow) -> int:
    """Return the index nearest to the selected place, which must not lie outside."""
    key, place, size = f"select.{dimension}", flow.select[dimension], variable.sizes[dimension]
    if dimension not in variable.coords:
        if place != int(place) or not 0 <= place < size:
            raise refusal(key, f"got {place:g}", f"be an index from 0 to {size - 1}")
        return int(place)
    if _is_labelled(variable, dimension):
        text = f"{dimension} contains {listed(_labels(variable, dimension))}"
        raise refusal(key, text, 'be an entry in velocity, such as "name[label]"')
    places = np.asarray(variable.coords[dimension].values, float)
    low, high = float(places.min()), float(places.max())
    slack = 0.5 * (high - low) / max(1, size - 1)
    # longitudes count from -180 or from 0
    units = str(variable.coords[dimension].attrs.get("units", ""))
    turns = (0.0, 360.0, -360.0) if units.startswith("degrees_east") else (0.0,)
    for equal in (place + turn for turn in turns):
        if low - slack <= equal <= high + slack:
            return int(np.argmin(np.abs(places - equal)))
    raise refusal(key, f"got {place:g}", f"be {low:g} to {high:g}")


def _left_over(
    variable: xr.DataArray, component: Component, key: str, dimension: str, *, profile: bool
) -> ScenarioError:
    """Return the refusal of a dimension from which no entry is selected."""
    name, select = component.name, f"select = {{{dimension} = ...}}"
    if dimension not in variable.coords:
        last = variable.sizes[dimension] - 1
        subject, hint = dimension, f"Set {select}, an index from 0 to {last}."
    elif _is_labelled(variable, dimension):
        texts = _labels(variable, dimension)
        subject = f"{dimension} ({listed(texts)})"
        hint = f'Name an entry, such as "{name}[{texts[0]}]".'
    else:
        places = variable.coords[dimension]
        subject = f"{dimension} ({float(places.min()):g} to {float(places.max()):g})"
        vertical = "" if profile else f', or vertical = "{dimension}" for a profile'
        hint = f"Set {select}{vertical}."
    return refusal(key, f"{name} also has a dimension {subject}. {hint}")


def read_selection(flow: MeasuredFlow, bed: float | None) -> FilledRecord:
    """Read the part of its file that a flow selects; ``bed`` is the height z of the bed (m)."""
    with opened(flow.file, flow.time, flow.vertical) as dataset:
        remarks: list[str] = []
        clock = dataset[find(dataset, flow.time, "time", flow.file)]
        along = only_dimension(clock, "time")
        level, upright, sign = None, None, 1.0
        if flow.vertical is not None:
            component = Component.of(flow.vertical)
            if component is None or component.entry:
                raise refusal("vertical", got(flow.vertical, "be the name of a variable"))
            level = dataset[find(dataset, component.name, "vertical", flow.file)]
            upright, sign = only_dimension(level, "vertical"), component.sign
        layers = 1 if level is None else level.size
        columns = sum(item is not None for item in flow.components)
        check_count(clock.size * layers * columns, flow.file, "this current")
        time = seconds(clock, remarks)
        levels = None if level is None else heights(level, sign, flow.origin, bed, remarks)
        velocity = np.zeros((time.size, layers, len(flow.components)))
        used, others = set[str](), set[str]()
        for index, component in enumerate(flow.components):
            if component is not None:
                key = f"velocity.{index}"
                variable = dataset[find(dataset, component.name, key, flow.file)]
                part = _velocity_of(variable, component, key, along, upright, flow, used)
                factor = component.sign * factor_to(variable, velocity_factor, key, "m/s", remarks)
                velocity[:, :, index] = factor * part
                fastest = float(np.nanmax(np.abs(velocity[:, :, index]), initial=0.0))
                if fastest > _FASTEST:
                    text = f"{component.name} reaches {fastest:g} m/s"
                    raise refusal(key, text, f"reach at most {_FASTEST:g}", MARKED)
                check_marks(part, key, component.name)
                others |= {
                    dimension
                    for dimension in map(str, variable.dims)
                    if dimension not in (along, upright) and not _is_labelled(variable, dimension)
                }
        for dimension in flow.select:
            if dimension not in used:
                must = f"be {listed(sorted(others))}" if others else "be left out"
                raise refusal(f"select.{dimension}", "no dimension to select in", must)
    return fill(time, levels, velocity, list(flow.velocity), remarks)
