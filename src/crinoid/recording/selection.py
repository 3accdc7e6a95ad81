"""One component of a velocity, cut out of a variable that may run over more than time."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.recording.opening import numbers_of
from crinoid.recording.refusal import listed, refusal
from crinoid.scenario.errors import shown
from crinoid.scenario.measured import Component, MeasuredFlow


def component_of(
    variable: xr.DataArray,
    component: Component,
    key: str,
    along: str,
    upright: str | None,
    flow: MeasuredFlow,
    used: set[str],
) -> Float[np.ndarray, "time level"]:
    """Cut one component out of a variable; ``used`` gathers the dimensions selected in."""
    name = component.name
    if len(set(variable.dims)) < variable.ndim:
        dims = ", ".join(map(str, variable.dims))
        raise refusal(key, f"{name} runs over {dims}, takes each dimension once")
    for dimension, which in ((along, "time"), (upright, "vertical")):
        if dimension is not None and dimension not in variable.dims:
            raise refusal(key, f"{name} has no dimension {dimension}, as {which} has")
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
            hint = _left_over(variable, component, dimension)
            numbered = dimension in variable.coords and not labelled_by_text(variable, dimension)
            if upright is None and numbered:
                hint += f', or vertical = "{dimension}" for a profile'
            raise refusal(key, f"{name} also runs over {hint}")
    kept = [along] if upright is None else [along, upright]
    values = numbers_of(variable.transpose(*kept), key, "a velocity")
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
        has = f"its entries are {known}" if known else "it has no labelled dimension"
        raise refusal(key, f"{component.name} has no entry {shown(component.entry)}; {has}")
    index = labels[found[0]].index(component.entry)
    return variable.isel({found[0]: index})


def labelled_by_text(variable: xr.DataArray, dimension: str) -> bool:
    """Whether the entries of a dimension have names, and no numbers."""
    return dimension in variable.coords and variable.coords[dimension].dtype.kind not in "iuf"


def _labels(variable: xr.DataArray, dimension: str) -> list[str]:
    values = variable.coords[dimension].values
    texts = [item.decode() if isinstance(item, bytes) else str(item) for item in values.tolist()]
    return [text.strip() for text in texts]


def _nearest(variable: xr.DataArray, dimension: str, flow: MeasuredFlow) -> int:
    """Return the entry nearest to what is asked for; it is not to lie outside."""
    key, wanted, size = f"select.{dimension}", flow.select[dimension], variable.sizes[dimension]
    if dimension not in variable.coords:
        if wanted != int(wanted) or not 0 <= wanted < size:
            raise refusal(key, f"got {wanted:g}, takes an index from 0 to {size - 1}")
        return int(wanted)
    if labelled_by_text(variable, dimension):
        text = f"holds {listed(_labels(variable, dimension))}"
        raise refusal(key, f'{dimension} {text}; takes an entry in velocity, such as "name[label]"')
    places = np.asarray(variable.coords[dimension].values, float)
    low, high = float(places.min()), float(places.max())
    slack = 0.5 * (high - low) / max(1, size - 1)
    # longitudes count from -180 or from 0
    turns = (0.0, 360.0, -360.0) if _is_longitude(variable.coords[dimension]) else (0.0,)
    for turned in (wanted + turn for turn in turns):
        if low - slack <= turned <= high + slack:
            return int(np.argmin(np.abs(places - turned)))
    raise refusal(key, f"got {wanted:g}, takes {low:g} to {high:g}")


def _is_longitude(coordinate: xr.DataArray) -> bool:
    return str(coordinate.attrs.get("units", "")).startswith("degrees_east")


def _left_over(variable: xr.DataArray, component: Component, dimension: str) -> str:
    """Say which dimension is left, and what to do about it."""
    if dimension not in variable.coords:
        size = variable.sizes[dimension]
        return f"{dimension}; takes select = {{{dimension} = ...}}, an index from 0 to {size - 1}"
    if labelled_by_text(variable, dimension):
        texts = _labels(variable, dimension)
        return (
            f'{dimension} ({listed(texts)}); takes an entry, such as "{component.name}[{texts[0]}]"'
        )
    coordinate = variable.coords[dimension]
    low, high = float(coordinate.min()), float(coordinate.max())
    return f"{dimension} ({low:g} to {high:g}); takes select = {{{dimension} = ...}}"
