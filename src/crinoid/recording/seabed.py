"""Heights of a bed from files."""

import re

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.ndimage import spline_filter

from crinoid.recording.axes import counts_down, find, only_dimension
from crinoid.recording.numbers import Column, check_count, finite_numbers, quantity
from crinoid.recording.readers import read_dataset
from crinoid.recording.solid_shapes import profile, sheet
from crinoid.recording.solid_surface import SolidSurface, SplineOnGrid
from crinoid.recording.texts import short
from crinoid.recording.units import length_factor
from crinoid.scenario import Scenario, Seabed, counted, refusal, shown

_EVEN = 1e-3  # largest deviation of steps of a coordinate from even ones, over a step
_DEEPEST = 12e3  # largest height or depth (m)
_SHOWN, _PARTS = 1.5, 60  # half of the side of a bed as drawn, of the arm's length, and its parts
_SHEET, _DEEP = 0.08, 0.1
"""Half of the thickness by which a bed in a plane is drawn, and its depth, of the arm's length."""
_BATHYMETRY = re.compile(r"h|.*bathy.*", re.I)
"""Usual names of water depth, for variables without a standard name or direction."""
_FEWEST = 4  # least number of heights along an axis


def read_seabed(table: Seabed, scenario: Scenario) -> SolidSurface:
    """Read the heights of a bed, over x and y or, for a planar arm, along y = 0."""
    remarks: list[str] = []
    root = scenario.base.position[-1] - table.position[-1]
    places, values = _read(table, root, remarks)
    orders = [np.argsort(place) for place in places]
    places, values = [np.sort(place) for place in places], values[np.ix_(*orders)]
    _check_reach(table, scenario, places, remarks)
    low = np.array([place[0] for place in places])
    steps = np.array([np.ptp(place) / (place.size - 1) for place in places])
    # constant beyond its ends
    around = spline_filter(np.pad(values, 4, mode="edge"), order=3)
    spline = SplineOnGrid(around, low - 4 * steps, steps)
    if scenario.arm.dimension == 2 and len(places) == 2:
        along = spline.origin[0] + steps[0] * np.arange(len(around))
        heights = spline.at(np.stack([along, 0.0 * along], axis=1))
        spline = SplineOnGrid(spline_filter(heights, order=3), spline.origin[:1], steps[:1])
    elif scenario.arm.dimension == 3 and len(places) == 1:
        text = f"{table.height} has one dimension"
        raise refusal("height", text, "have those of x and y with arm.dimension = 3")
    length = scenario.arm.length
    level = (np.asarray(scenario.base.position) - np.asarray(table.position))[:-1]
    shown = [at + _SHOWN * length * np.linspace(-1, 1, _PARTS + 1) for at in level]
    height = spline.at(np.stack(np.meshgrid(*shown, indexing="ij"), axis=-1))
    if len(shown) == 1:
        shape = profile(shown[0], height, float(height.min()) - _DEEP * length, _SHEET * length)
    else:
        shape = sheet(shown[0], shown[1], height)
    return SolidSurface(spline, True, *shape, tuple(remarks))


def _read(table: Seabed, root: float, remarks: list[str]) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the coordinates and the heights of a file (m), whose origin is below the ``root``."""
    with read_dataset(table.file) as dataset:
        name = find(dataset, table.height, "height", table.file)
        check_count(dataset[name].size, table.file, name)
        variable = dataset[name].squeeze()
        keys = "xy" if variable.ndim > 1 else "x"
        names = [find(dataset, getattr(table, key), key, table.file) for key in keys]
        along = [only_dimension(dataset[each], key) for key, each in zip(keys, names, strict=True)]
        if sorted(along) != sorted(map(str, variable.dims)):
            has = ", ".join(map(str, variable.dims)) or "none"
            raise refusal("height", f"{name} has dimensions {has}", f"have {' and '.join(along)}")
        places = [_even(dataset[each], key) for key, each in zip(keys, names, strict=True)]
        column = Column("height", name, length_factor, "m", _DEEPEST)
        values = quantity(dataset, variable.transpose(*along), column, remarks)
    if missing := int(np.sum(~np.isfinite(values))):
        text = f"{name} has {counted(missing, 'missing value')}"
        hint = "Fill them: dataset.interpolate_na(...), or cut out a part without."
        raise refusal("height", text, "be a number at each place", hint)
    return places, -values if _are_depths(variable, values, root, remarks) else values


def _are_depths(variable: xr.DataArray, values: np.ndarray, root: float, said: list[str]) -> bool:
    """Return whether the heights of a bed below the ``root`` of the arm (m) count down."""
    down, name = counts_down(variable), str(variable.name)
    if down is None:
        middle = float(np.median(values))
        down = -middle < root and (middle >= root or bool(_BATHYMETRY.fullmatch(name)))
        if -middle < root:
            way = "depth, positive down" if down else "height, positive up"
            said.append(f'{name} is taken as a {way}: set its attribute positive to "up" or "down"')
    elif down and "positive" not in variable.attrs and values.max() <= 0:
        said.append(f"{name} is negative and is taken as a height")
        down = False
    return down


def _even(variable: xr.DataArray, key: str) -> Float[np.ndarray, " place"]:
    """Return a coordinate (m), whose steps must be even."""
    places, name = finite_numbers(variable, key, "places (m)").astype(float), variable.name
    units = str(variable.attrs.get("units", "")).strip()
    factor = length_factor(units or "m")
    if factor is None:
        hint = "Project longitudes and latitudes to m first, with pyproj say."
        raise refusal(key, f"{name} is in {shown(units)}", "be in a unit such as m", hint)
    if places.size < _FEWEST:
        text = f"{name} has {counted(places.size, 'place')}"
        raise refusal(key, text, f"have at least {_FEWEST}")
    steps = np.diff(places)
    if np.ptp(steps) > _EVEN * abs(steps.mean()):
        text = f"{name} has steps of {steps.min():.4g} to {steps.max():.4g}"
        raise refusal(key, text, "have even steps", f"Interpolate it: dataset.interp({name}=...).")
    return factor * places


def _check_reach(
    table: Seabed, scenario: Scenario, places: list[np.ndarray], remarks: list[str]
) -> None:
    """Refuse heights that are not below the base; say where they end within the arm's reach."""
    base, origin = (np.asarray(x, float)[:-1] for x in (scenario.base.position, table.position))
    at = [*(base - origin), 0.0]  # the last is y of a planar arm
    ends = [(float(place.min()), float(place.max())) for place in places]
    for axis, here, (low, high) in zip("xy", at, ends, strict=False):
        if not low <= here <= high:
            text = f"{short(table.file)} has heights at {axis} = {low:.6g} to {high:.6g} m"
            hint = "Set position: where the origin of the file's axes is."
            raise refusal("file", text, f"contain the base, at {axis} = {here:.6g} m there", hint)
    seen = zip(at[: base.size], ends, strict=False)
    room = min(min(here - low, high - here) for here, (low, high) in seen)
    if room < scenario.arm.length:
        text = f"heights end {room:.3g} m from the base: beyond, those of the nearest edge count"
        remarks.append(text)
