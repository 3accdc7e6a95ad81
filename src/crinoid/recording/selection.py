"""Selection of a current from a file: the velocity at times and heights, in SI units."""

from __future__ import annotations

import re

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
from crinoid.recording.numbers import (
    check_count,
    check_marks,
    factor_to,
    labels_of,
    numbers_of,
    without_flagged,
)
from crinoid.recording.readers import read_dataset
from crinoid.recording.series import FilledRecord, fill
from crinoid.recording.texts import MARKED, listed
from crinoid.recording.units import angle_factor, velocity_factor
from crinoid.scenario.errors import ScenarioError, got, refusal, shown
from crinoid.scenario.flow import Component, MeasuredFlow

_FASTEST = 50.0
"""No current is so fast (m/s): such a number marks a missing value."""
_FAST = 5.0
"""Few currents are faster (m/s): without a unit it is another one."""
_TURN = 2 * np.pi + 0.01
"""Largest compass direction (rad)."""
_ROTATED = ("beam", "inst", "instrument", "xyz", "ship")
"""Frames of an instrument, in which the numbers are no components of the current."""
_EAST = re.compile(r"degrees?_?(east|E)")
"""Units of a longitude (CF, section 4.2)."""
_STEADY = 1e-3
"""Largest change of levels in time that counts as none (m)."""


class _Source:
    """A file and the part of it that a flow selects."""

    def __init__(
        self, dataset: xr.Dataset, flow: MeasuredFlow, along: str, upright: str | None
    ) -> None:
        self.dataset, self.flow, self.along, self.upright = dataset, flow, along, upright
        self.remarks: list[str] = []

    def numbers(self, component: Component, key: str) -> tuple[np.ndarray, xr.DataArray]:
        """Return the numbers of a variable over time and level, and the variable."""
        variable = self.dataset[find(self.dataset, component.name, key, self.flow.file)]
        whole, name = variable, component.name
        if len(set(variable.dims)) < variable.ndim:
            dims = ", ".join(map(str, variable.dims))
            raise refusal(key, f"{name} has dimensions {dims}", "have each dimension once")
        for dimension, which in ((self.along, "time"), (self.upright, "vertical")):
            if dimension is not None and dimension not in variable.dims:
                raise refusal(key, f"{name} lacks a dimension", f"have {dimension}, as {which}")
        if component.entry:
            variable = _entry(variable, component, key, {self.along, self.upright})
        for dimension in map(str, variable.dims):
            if dimension in (self.along, self.upright):
                continue
            if variable.sizes[dimension] > 1:
                raise _left_over(variable, name, key, dimension, profile=self.upright is not None)
            variable = variable.isel({dimension: 0})
        order = [self.along] if self.upright is None else [self.along, self.upright]
        variable = without_flagged(self.dataset, variable.transpose(*order), self.remarks)
        values = numbers_of(
            variable, key, "a direction" if key == "direction" else "a velocity"
        ).astype(float)
        values = values.reshape(values.shape[0], -1)
        return np.where(np.isfinite(values), values, np.nan), whole

    def speeds(self, component: Component, key: str) -> Float[np.ndarray, "time level"]:
        """Return a component of the velocity, or the speed (m/s)."""
        part, variable = self.numbers(component, key)
        factor = factor_to(variable, velocity_factor, key, "m/s", self.remarks)
        found = component.sign * factor * part
        fastest = float(np.nanmax(np.abs(found), initial=0.0))
        if fastest > _FASTEST:
            text = f"{component.name} reaches {fastest:g} m/s"
            raise refusal(key, text, f"reach at most {_FASTEST:g}", MARKED)
        if fastest > _FAST and not str(variable.attrs.get("units", "")).strip():
            text = f"{component.name} names no unit and reaches {fastest:g}, a lot in m/s"
            raise refusal(key, text, "name its unit", f"Call it {component.name} (cm/s), say.")
        check_marks(part, key, component.name)
        return found

    def by_compass(self, speed: str, direction: str) -> Float[np.ndarray, "time level axis=3"]:
        """Return east, north and up from speed and direction (m/s)."""
        size = self.speeds(Component(speed, "", 1.0), "speed")
        numbers, variable = self.numbers(Component(direction, "", 1.0), "direction")
        turn = factor_to(variable, angle_factor, "direction", "degrees", self.remarks) * numbers
        if (most := float(np.nanmax(np.abs(turn), initial=0.0))) > _TURN:
            text = f"{direction} reaches {np.rad2deg(most):g} degrees"
            raise refusal("direction", text, "reach at most 360", MARKED)
        where = self.flow.direction_is
        if where is None:
            standard = str(variable.attrs.get("standard_name", ""))
            where = "from" if standard.endswith("from_direction") else "to"
            if not standard.endswith(("_direction", "direction_of_sea_water_velocity")):
                self.remarks.append(
                    f"{direction} is taken as the direction to which the water flows: see "
                    "direction_is"
                )
        if where == "from":
            turn += np.pi
        return np.stack([size * np.sin(turn), size * np.cos(turn), 0 * size], axis=-1)


def _entry(
    variable: xr.DataArray, component: Component, key: str, other: set[str | None]
) -> xr.DataArray:
    labels = {
        str(dimension): labels_of(variable[dimension])
        for dimension in variable.dims
        if dimension not in other and dimension in variable.coords
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
    # longitudes count from -180 or from 0
    east = _EAST.fullmatch(str(axis.attrs.get("units", ""))) is not None
    for equal in (place + turn for turn in ((0.0, 360.0, -360.0) if east else (0.0,))):
        if low - slack <= equal <= high + slack:
            return int(np.argmin(np.abs(places - equal)))
    raise refusal(key, f"got {place:g}", f"be {low:g} to {high:g}")


def _left_over(
    variable: xr.DataArray, name: str, key: str, dimension: str, *, profile: bool
) -> ScenarioError:
    """Return the refusal of a dimension from which no entry is selected."""
    select = f"select = {{{dimension} = ...}}"
    if dimension not in variable.coords:
        last = variable.sizes[dimension] - 1
        subject, hint = dimension, f"Set {select}, an index from 0 to {last}."
    elif is_labelled(variable, dimension):
        texts = labels_of(variable[dimension])
        subject = f"{dimension} ({listed(texts)})"
        hint = f'Name an entry, such as "{name}[{texts[0]}]".'
    else:
        places = variable.coords[dimension]
        subject = f"{dimension} ({float(places.min()):g} to {float(places.max()):g})"
        vertical = "" if profile else f', or vertical = "{dimension}" for a profile'
        hint = f"Set {select}{vertical}."
    return refusal(key, f"{name} also has a dimension {subject}. {hint}")


def _at_place(dataset: xr.Dataset, flow: MeasuredFlow, names: list[str]) -> xr.Dataset:
    """Return the dataset at the place that the flow selects."""
    own = {flow.time, flow.vertical}
    others = {
        str(dimension)
        for name in names
        if name in dataset.variables
        for dimension in dataset[name].dims
        if dimension not in own and not is_labelled(dataset[name], str(dimension))
    }
    for dimension, place in flow.select.items():
        if dimension not in others:
            must = f"be {listed(sorted(others))}" if others else "be left out"
            raise refusal(f"select.{dimension}", "no dimension to select in", must)
        dataset = dataset.isel({dimension: _nearest(dataset, dimension, place)})
    return dataset


def read_selection(flow: MeasuredFlow, bed: float | None) -> FilledRecord:
    """Read the part of its file that a flow selects; ``bed`` is the height z of the bed (m)."""
    with read_dataset(flow.file) as dataset:
        frame = str(dataset.attrs.get("coord_sys", "")).lower()
        if frame in _ROTATED:
            hint = 'Rotate it: mhkit.dolfyn.rotate2(dataset, "earth").'
            text = f"the velocity is in the frame of the instrument (coord_sys = {shown(frame)})"
            raise refusal("file", text, "be in that of the earth", hint)
        wanted = [(f"velocity.{k}", each) for k, each in enumerate(flow.components)]
        named = [find(dataset, c.name, key, flow.file) for key, c in wanted if c is not None]
        clock = find(dataset, flow.time, "time", flow.file)
        level, upright, sign = None, "", 1.0
        if flow.vertical is not None:
            component = Component.of(flow.vertical)
            if component is None or component.entry:
                raise refusal("vertical", got(flow.vertical, "be the name of a variable"))
            upright, sign = find(dataset, component.name, "vertical", flow.file), component.sign
            check_count(dataset[upright].size, flow.file, upright)
            dataset = as_profile(dataset, clock, upright, flow.file)
        dataset = _at_place(dataset, flow, named)
        if dataset[clock].ndim > 1:  # as of a single station
            of_one = [each for each, size in dataset[clock].sizes.items() if size == 1]
            dataset = dataset.squeeze(of_one)
        along = only_dimension(dataset[clock], "time")
        if upright:
            formula = "formula_terms" in dataset[upright].attrs
            level = sigma_levels(dataset, upright) if formula else dataset[upright]
            level = level.squeeze(
                [each for each in level.dims if level.sizes[each] == 1 < level.ndim]
            )
            across = [str(each) for each in level.dims if each != along]
            upright = only_dimension(level, "vertical") if len(across) != 1 else across[0]
            level = level.transpose(..., upright)
        source = _Source(dataset, flow, along, upright or None)
        layers = dataset.sizes[upright] if upright else 1
        columns = 2 if flow.speed else sum(each is not None for _, each in wanted)
        check_count(dataset[clock].size * layers * columns, flow.file, "this current")
        time = seconds(dataset[clock], source.remarks)
        z = None if level is None else heights(level, sign, flow.origin, bed, source.remarks)
        if flow.speed and flow.direction:
            velocity, names = source.by_compass(flow.speed, flow.direction), [flow.speed] * 3
        else:
            parts = [
                np.zeros((time.size, layers)) if each is None else source.speeds(each, key)
                for key, each in wanted
            ]
            velocity, names = np.stack(parts, axis=-1), list(flow.velocity)
    if z is not None:
        z, velocity = _at_fixed_levels(z, velocity, source.remarks)
        inside = in_water(z, bed, source.remarks)
        z, velocity = z[inside], velocity[:, inside]
    return fill(time, z, velocity, names, source.remarks)


def _at_fixed_levels(
    z: Float[np.ndarray, "*time level"],
    velocity: Float[np.ndarray, "time level axis"],
    remarks: list[str],
) -> tuple[Float[np.ndarray, " level"], Float[np.ndarray, "time level axis"]]:
    """Return the mean heights of levels (m) that vary in time, and the velocity there."""
    if z.ndim == 1:
        return z, velocity
    mean = z.mean(axis=0)
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
