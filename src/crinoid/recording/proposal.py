"""The table ``[[flow]]`` that plays a file, as its attributes and names are understood."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import cf_xarray  # noqa: F401  # the accessor `cf` of datasets
import xarray as xr

from crinoid.recording.numbers import labels_of
from crinoid.recording.selection import is_labelled
from crinoid.recording.texts import listed, short
from crinoid.recording.units import velocity_factor
from crinoid.scenario.errors import refusal

_NAMES = {
    "time": ("time", "ocean_time", "datetime", "date", "timestamp", "time_utc", "date_time"),
    "level": (
        *("depth", "deph", "deptht", "depthu", "dep", "depth_cell", "elevation", "z", "height"),
        *("depth_m", "bin_depth", "cell_depth", "hab", "mab", "height_above_bed"),
        *("height_above_bottom", "range", "s_rho", "sigma", "siglay", "lev", "level", "altitude"),
    ),
    "east": (
        *("u", "uo", "water_u", "ewct", "vozocrtx", "u_eastward", "ucur", "u_velocity", "east"),
        *("vel_east", "velocity_east", "east_velocity", "velocity_e", "ve", "e"),
    ),
    "north": (
        *("v", "vo", "water_v", "nsct", "vomecrty", "v_northward", "vcur", "v_velocity", "north"),
        *("vel_north", "velocity_north", "north_velocity", "velocity_n", "vn", "n"),
    ),
    "up": ("w", "wo", "vcsp", "up", "vel_up", "velocity_up", "up_velocity", "vu", "w_velocity"),
    "speed": ("speed", "spd", "hcsp", "current_speed", "cspd", "velocity_magnitude"),
    "direction": ("direction", "dir", "hcdt", "current_direction", "cdir", "drct"),
}
"""Usual names of each role, in small letters."""
_STANDARD = {
    "time": ("time",),
    "level": ("depth", "height", "altitude", "height_above_sea_floor", "ocean_s_coordinate_g2"),
    "east": ("eastward_sea_water_velocity", "sea_water_x_velocity", "eastward_velocity"),
    "north": ("northward_sea_water_velocity", "sea_water_y_velocity", "northward_velocity"),
    "up": ("upward_sea_water_velocity", "upward_velocity"),
    "speed": ("sea_water_speed",),
    "direction": (
        *("sea_water_velocity_to_direction", "sea_water_velocity_from_direction"),
        "direction_of_sea_water_velocity",
    ),
}
"""CF standard names of each role."""
_OWN_AXES = re.compile(r"instrument|\b(sea_water_)?[xy][-_ ]velocity", re.I)
"""Words of components that are not toward the east and the north."""
_OTHER = re.compile(r"wind|wave|stokes|barotropic", re.I)
"""Words in the standard names of what moves the water, or is no current at a depth."""
_SPREAD = re.compile(r"standard_deviation|variance|range", re.I)
"""Words in the cell methods of numbers that are no velocities."""
_REVERSED = ("downward", "southward", "westward")
"""First words of the standard names of components that point the other way."""
_LABELS = {"east": ("E", "east", "East"), "north": ("N", "north"), "up": ("U", "U1", "up")}
"""Labels of a dimension of components."""


def roles(dataset: xr.Dataset) -> dict[str, str]:
    """Return the variable of each role: time, level, east, north, up, speed and direction.

    A component may be an entry of a labelled dimension, such as ``vel[E]``.
    """
    known = dataset.cf.standard_names
    bounds = {dataset[name].attrs.get("bounds") for name in dataset.variables}
    fit = [str(n) for n in dataset.variables if n not in bounds and _fits(dataset[n])]
    small = {re.sub(r"[- ]+", "_", name.strip().lower()): name for name in fit}
    small |= {name: name for name in fit}
    found: dict[str, str] = {}
    for role, names in _NAMES.items():
        standard = [
            str(each) for name in _STANDARD[role] for each in known.get(name, ()) if each in fit
        ]
        usual = [small[name] for name in (*names, *_STANDARD[role]) if name in small]
        candidates = [*standard, *usual]
        if role == "level" and "time" in found:  # the depth of an instrument is over time alone
            clock = set(dataset[found["time"]].dims)
            candidates = [n for n in candidates if set(dataset[n].dims) - clock] or candidates
        if candidates:
            found[role] = candidates[0]
    if found.get("east", "").lower() != "e" and found.get("north", "").lower() == "n":
        del found["north"]  # a count
    axes = dataset.cf.coordinates | dataset.cf.axes
    for role, keys in (("time", ("time", "T")), ("level", ("vertical", "Z"))):
        for name in (str(each) for key in keys for each in axes.get(key, ())):
            found.setdefault(role, name)
    dated = [name for name in fit if " since " in str(dataset[name].attrs.get("units"))]
    if len(dated) == 1:
        found.setdefault("time", dated[0])
    return found if "east" in found or "speed" in found else found | _labelled(dataset)


def _fits(variable: xr.DataArray) -> bool:
    """Return whether a variable may be a part of a current, by its attributes."""
    other = _OTHER.search(str(variable.attrs.get("standard_name", "")))
    return not other and not _SPREAD.search(str(variable.attrs.get("cell_methods", "")))


def _labelled(dataset: xr.Dataset) -> dict[str, str]:
    """Return components that are entries of a labelled dimension."""
    for variable in dataset.data_vars.values():
        for dimension in map(str, variable.dims):
            moves = velocity_factor(str(variable.attrs.get("units", ""))) is not None
            if moves and is_labelled(variable, dimension):
                texts = labels_of(variable[dimension])
                entries = {role: _first(texts, names) for role, names in _LABELS.items()}
                if entries["east"]:
                    return {role: f"{variable.name}[{e}]" for role, e in entries.items() if e}
    return {}


def _first(there: Iterable[str], wanted: Iterable[str]) -> str:
    return next((each for each in wanted if each in there), "")


def propose(dataset: xr.Dataset, file: str) -> dict[str, Any]:
    """Return the keys of a table ``[[flow]]`` that plays a file.

    The x axis points east; where components are along the axes of an instrument or a grid, it is
    the first of these.

    Raises
    ------
    ScenarioError
        If no variable looks like a time or like a velocity.
    """
    found = roles(dataset)
    names = listed([str(name) for name in dataset.variables])
    for role, words in (("time", "a time"), ("velocity", "a velocity")):
        if role not in found and (role == "time" or not {"east", "speed"} & set(found)):
            text = f"{short(file)} contains {names}"
            raise refusal("file", text, f"have {words} under a usual name, or name it in [[flow]]")
    keys: dict[str, Any] = {"kind": "measured", "file": file}
    if found["time"] != "time":
        keys["time"] = found["time"]
    if "east" in found:
        attributes = dataset[found["east"].partition("[")[0]].attrs
        named = " ".join(str(attributes.get(key, "")) for key in ("standard_name", "long_name"))
        compass = "north" in found and not _OWN_AXES.search(named)
        wanted = ("east", "north", "up") if compass else ("east", "up")
        keys["velocity"] = [_signed(dataset, found.get(role, "0")) for role in wanted]
        if compass:
            keys["heading_deg"] = 90.0
        first = found["east"]
    else:
        if "direction" not in found:
            text = f"{short(file)} has {found['speed']} without a direction"
            raise refusal("file", text, "have the components of the velocity, or a direction")
        keys |= {"speed": found["speed"], "direction": found["direction"], "heading_deg": 90.0}
        first = found["speed"]
    velocity = dataset[first.partition("[")[0]]
    level, clock = found.get("level"), dataset[found["time"]]
    if level is not None:
        same = [each for each in dataset[level].dims if each in velocity.dims]
        flat = dataset[level].dims == clock.dims and clock.size > 1
        varies = flat and clock.ndim == 1 and len(set(clock.values.tolist())) < clock.size
        if (set(same) - set(clock.dims)) or varies:
            keys["vertical"] = level
    axes = {*clock.dims, *(dataset[level].dims if "vertical" in keys and level else ())}
    select = {
        str(each): _middle(dataset, str(each))
        for each in velocity.dims
        if each not in axes and velocity.sizes[each] > 1 and not is_labelled(velocity, str(each))
    }
    return keys | ({"select": select} if select else {})


def _signed(dataset: xr.Dataset, name: str) -> str:
    """Return the name of a component, with a minus sign if it points down, south or west."""
    attributes = dataset[name].attrs if name in dataset.variables else {}
    turned = str(attributes.get("standard_name", "")).startswith(_REVERSED)
    down = attributes.get("positive") == "down" or "positive down" in str(
        attributes.get("long_name", "")
    )
    return f"-{name}" if turned or down else name


def _middle(dataset: xr.Dataset, dimension: str) -> float:
    """Return the place in the middle of a dimension: its coordinate, or its index."""
    middle = dataset.sizes[dimension] // 2
    if dimension in dataset.coords:
        return float(dataset[dimension].values[middle])
    return float(middle)
