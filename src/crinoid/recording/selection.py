"""Selection of a current from a file: the velocity at times and heights, in SI units."""

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.recording.axes import (
    as_profile,
    find,
    heights,
    in_water,
    only_dimension,
    seconds,
    sigma_levels,
)
from crinoid.recording.numbers import Column, check_count, labels_of, quantity
from crinoid.recording.readers import read_dataset
from crinoid.recording.series import FilledRecord, fill
from crinoid.recording.texts import listed
from crinoid.recording.units import angle_factor, velocity_factor
from crinoid.scenario.errors import ScenarioError, got, refusal, shown
from crinoid.scenario.flow import Component, MeasuredFlow

_FASTEST = 50.0  # no current is so fast (m/s): such a number marks a missing value
_FAST = 5.0  # few currents are faster (m/s): without a unit it is another one
_TURN = 2 * np.pi + 0.005  # largest compass direction (rad)
_ROTATED = ("beam", "inst", "instrument", "xyz", "ship")
"""Frames of an instrument, in which the numbers are no components of the current."""
_STEADY = 1e-3  # largest change of levels in time that counts as none (m)


class _Source(NamedTuple):
    """A file, its dimensions of time and of levels, and the remarks on it."""

    dataset: xr.Dataset
    flow: MeasuredFlow
    along: str
    upright: str | None
    remarks: list[str]

    def numbers(self, component: Component, column: Column) -> tuple[np.ndarray, xr.DataArray]:
        """Return a component over time and level in SI units, and its variable."""
        key, name = column.key, component.name
        variable = whole = self.dataset[find(self.dataset, name, key, self.flow.file)]
        if len(set(variable.dims)) < variable.ndim:
            dims = ", ".join(map(str, variable.dims))
            raise refusal(key, f"{name} has dimensions {dims}", "have each dimension once")
        axes = {"time": self.along} | ({"vertical": self.upright} if self.upright else {})
        for which, dimension in axes.items():
            if dimension not in variable.dims:
                raise refusal(key, f"{name} lacks a dimension", f"have {dimension}, as {which}")
        if component.entry:
            variable = _entry(variable, component, key, [*axes.values()])
        for dimension in [str(each) for each in variable.dims if each not in axes.values()]:
            if variable.sizes[dimension] > 1:
                raise left_over(variable, name, key, dimension, profile=self.upright is not None)
            variable = variable.isel({dimension: 0})
        variable = variable.transpose(*axes.values())
        values = quantity(self.dataset, variable, column, self.remarks)
        return component.sign * values.reshape(values.shape[0], -1), whole

    def speeds(self, component: Component, key: str) -> Float[np.ndarray, "time level"]:
        """Return a component of the velocity, or the speed (m/s)."""
        name = component.name
        column = Column(key, name, velocity_factor, "m/s", _FASTEST, noun="a velocity")
        found, variable = self.numbers(component, column)
        fastest = float(np.nanmax(np.abs(found), initial=0.0))
        if fastest > _FAST and not str(variable.attrs.get("units", "")).strip():
            text = f"{name} names no unit and reaches {fastest:g}, a lot in m/s"
            raise refusal(key, text, "name its unit", f"Call it {name} (cm/s), say.")
        return found

    def by_compass(self, speed: str, direction: str) -> Float[np.ndarray, "time level axis=3"]:
        """Return east, north and up from speed and direction (m/s)."""
        size = self.speeds(Component(speed, "", 1.0), "speed")
        role = ("direction", direction, angle_factor, "degrees", _TURN)
        column = Column(*role, noun="a direction")
        turn, variable = self.numbers(Component(direction, "", 1.0), column)
        standard = str(variable.attrs.get("standard_name", ""))
        if not self.flow.direction_is and "direction" not in standard:
            text = f"{direction} is taken as the direction to which the water flows"
            self.remarks.append(f"{text}: see direction_is")
        if (self.flow.direction_is or standard).endswith(("from", "from_direction")):
            turn = turn + np.pi
        return np.stack([size * np.sin(turn), size * np.cos(turn), 0 * size], axis=-1)


def _entry(
    variable: xr.DataArray, component: Component, key: str, other: Collection[str]
) -> xr.DataArray:
    labels = {
        str(dimension): labels_of(variable[dimension])
        for dimension in variable.dims
        if str(dimension) not in other and dimension in variable.coords
    }
    found = [dimension for dimension, texts in labels.items() if component.entry in texts]
    if len(found) != 1:
        known = "; ".join(f"{dimension}: {listed(texts)}" for dimension, texts in labels.items())
        must = f"name one of {known}" if known else "name no entry of a variable without labels"
        raise refusal(key, f"{component.name} has no entry {shown(component.entry)}", must)
    return variable.isel({found[0]: labels[found[0]].index(component.entry)})


def is_labelled(variable: xr.DataArray, dimension: str) -> bool:
    """Return whether the entries of a dimension have names instead of numbers."""
    return dimension in variable.coords and variable.coords[dimension].dtype.kind not in "iuf"


def left_over(
    variable: xr.DataArray, name: str, key: str, dimension: str, *, profile: bool
) -> ScenarioError:
    """Return the refusal of a dimension from which no entry is selected."""
    select = f"Set select = {{{dimension} = ...}}"
    if is_labelled(variable, dimension):
        texts = labels_of(variable[dimension])
        has, hint = f" ({listed(texts)})", f'Name an entry, such as "{name}[{texts[0]}]"'
    elif dimension in variable.coords:
        places = variable.coords[dimension]
        has = f" ({float(places.min()):g} to {float(places.max()):g})"
        hint = select + ("" if profile else f', or vertical = "{dimension}" for a profile')
    else:
        has, hint = "", f"{select}, an index from 0 to {variable.sizes[dimension] - 1}"
    return refusal(key, f"{name} also has a dimension {dimension}{has}. {hint}.")


def _nearest(dataset: xr.Dataset, dimension: str, place: float) -> int:
    """Return the index nearest to the selected place, which must not lie outside."""
    key, size = f"select.{dimension}", dataset.sizes[dimension]
    if dimension not in dataset.coords:
        if place != int(place) or not 0 <= place < size:
            raise refusal(key, f"got {place:g}", f"be an index from 0 to {size - 1}")
        return int(place)
    axis = dataset[dimension]
    if is_labelled(axis, dimension):
        text = f"{dimension} contains {listed(labels_of(axis))}"
        raise refusal(key, text, 'be an entry in velocity, such as "name[label]"')
    places = np.asarray(axis.values, float)
    low, high = float(places.min()), float(places.max())
    slack = 0.5 * (high - low) / max(1, size - 1)
    if not low - slack <= place <= high + slack:
        raise refusal(key, f"got {place:g}", f"be {low:g} to {high:g}")
    return int(np.argmin(np.abs(places - place)))


def at_place(
    dataset: xr.Dataset, select: Mapping[str, float], names: list[str], kept: Collection[str | None]
) -> xr.Dataset:
    """Return the dataset at a place in the dimensions of variables other than those ``kept``."""
    others = {
        str(dimension)
        for name in names
        for dimension in dataset[name].dims
        if dimension not in kept and not is_labelled(dataset[name], str(dimension))
    }
    for dimension, place in select.items():
        if dimension not in others:
            must = f"be {listed(sorted(others))}" if others else "be left out"
            raise refusal(f"select.{dimension}", "no dimension to select in", must)
        dataset = dataset.isel({dimension: _nearest(dataset, dimension, place)})
    return dataset


def read_selection(flow: MeasuredFlow, bed: float | None) -> FilledRecord:
    """Read the part of its file that a flow selects; ``bed`` is the height z of the bed (m)."""
    remarks: list[str] = []
    with read_dataset(flow.file) as dataset:
        frame = str(dataset.attrs.get("coord_sys", "")).lower()
        if frame in _ROTATED:
            hint = 'Rotate it: mhkit.dolfyn.rotate2(dataset, "earth").'
            text = f"the velocity is in the frame of the instrument (coord_sys = {shown(frame)})"
            raise refusal("file", text, "be in that of the earth", hint)
        wanted = {f"velocity.{k}": each for k, each in enumerate(flow.components)}
        named = [find(dataset, c.name, key, flow.file) for key, c in wanted.items() if c]
        clock = find(dataset, flow.time, "time", flow.file)
        level, upright, component = None, None, Component.of(flow.vertical or "0")
        if flow.vertical is not None:
            if component is None or component.entry:
                raise refusal("vertical", got(flow.vertical, "be the name of a variable"))
            upright = find(dataset, component.name, "vertical", flow.file)
            check_count(dataset[upright].size, flow.file, upright)
            dataset = as_profile(dataset, clock, upright, flow.file)
        dataset = at_place(dataset, flow.select, named, (flow.time, flow.vertical))
        if dataset[clock].ndim > 1:  # as of a single station
            dataset = dataset.squeeze([d for d, n in dataset[clock].sizes.items() if n == 1])
        along = only_dimension(dataset[clock], "time")
        if upright:
            formula = "formula_terms" in dataset[upright].attrs
            level = sigma_levels(dataset, upright) if formula else dataset[upright]
            across = [str(each) for each in level.dims if each != along]
            across = [each for each in across if level.sizes[each] > 1] or across[-1:]
            upright = across[0] if len(across) == 1 else only_dimension(level, "vertical")
            single = [d for d, n in level.sizes.items() if n == 1 and d not in (along, upright)]
            level = level.squeeze(single).transpose(..., upright)
        layers = dataset.sizes[upright] if upright else 1
        columns = 2 if flow.speed else len(named)
        check_count(dataset[clock].size * layers * columns, flow.file, "this current")
        time = seconds(dataset[clock], remarks)
        z = None
        if level is not None and component:
            z = heights(level, component.sign, flow.origin, bed, remarks)
        source = _Source(dataset, flow, along, upright, remarks)
        if flow.speed and flow.direction:
            velocity, names = source.by_compass(flow.speed, flow.direction), [flow.speed] * 3
        else:
            nothing = np.zeros((time.size, layers))
            parts = [source.speeds(c, key) if c else nothing for key, c in wanted.items()]
            velocity, names = np.stack(parts, axis=-1), list(flow.velocity)
    if z is not None:
        z, velocity = _at_fixed_levels(z, velocity, remarks)
        inside = in_water(z, bed, remarks)
        z, velocity = z[inside], velocity[:, inside]
    return fill(time, z, velocity, names, remarks)


def _at_fixed_levels(
    z: Float[np.ndarray, "*time level"],
    velocity: Float[np.ndarray, "time level axis"],
    remarks: list[str],
) -> tuple[Float[np.ndarray, " level"], Float[np.ndarray, "time level axis"]]:
    """Return the mean heights of levels (m) that vary in time, and the velocity there."""
    mean = z if z.ndim == 1 else z.mean(axis=0)
    if (most := float(np.abs(z - mean).max())) <= _STEADY:
        return mean, velocity
    remarks.append(
        f"levels vary by up to {most:.3g} m in time: the current is interpolated to their means"
    )
    fixed = np.empty_like(velocity)
    for now, row in enumerate(z):
        order = np.argsort(row)
        for axis in range(velocity.shape[-1]):
            fixed[now, :, axis] = np.interp(mean, row[order], velocity[now, order, axis])
    return mean, fixed
