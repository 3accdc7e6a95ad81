"""The table ``[[flow]]`` that plays a file, as its attributes and names are understood."""

import re
from collections import defaultdict
from typing import Any

import cf_xarray  # noqa: F401  # the accessor `cf` of datasets
import numpy as np
import xarray as xr

from crinoid.recording.numbers import labels_of
from crinoid.recording.selection import is_labelled
from crinoid.recording.texts import listed, short
from crinoid.recording.units import velocity_factor
from crinoid.scenario.errors import refusal

_NAMES = {
    "time": "time ocean_time datetime date timestamp time_utc date_time",
    "level": "depth height altitude height_above_sea_floor ocean_s_coordinate_g2 deph deptht "
    "depthu dep depth_cell elevation z depth_m bin_depth cell_depth hab mab height_above_bed "
    "height_above_bottom range s_rho sigma siglay lev level",
    "east": "eastward_sea_water_velocity sea_water_x_velocity eastward_velocity u uo water_u ewct "
    "vozocrtx u_eastward ucur u_velocity east vel_east velocity_east east_velocity velocity_e ve e",
    "north": "northward_sea_water_velocity sea_water_y_velocity northward_velocity v vo water_v "
    "nsct vomecrty v_northward vcur v_velocity north vel_north velocity_north north_velocity "
    "velocity_n vn n",
    "up": "upward_sea_water_velocity upward_velocity w wo vcsp up vel_up velocity_up up_velocity "
    "vu w_velocity",
    "speed": "sea_water_speed speed spd hcsp current_speed cspd velocity_magnitude",
    "direction": "sea_water_velocity_to_direction sea_water_velocity_from_direction "
    "direction_of_sea_water_velocity direction dir hcdt current_direction cdir drct",
}
"""CF standard names and usual names of each role, in small letters, the first ones first."""
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
    bounds = {dataset[name].attrs.get("bounds") for name in dataset.variables}
    fit = [str(n) for n in dataset.variables if n not in bounds and _fits(dataset[n])]
    named: dict[str, list[str]] = defaultdict(list)
    for name in fit:
        named[str(dataset[name].attrs.get("standard_name", ""))].append(name)
    for name in sorted(fit, key=lambda name: name.lower() != name):  # in small letters first
        named[re.sub(r"[- ]+", "_", name.strip().lower())].append(name)
    axes = dataset.cf.coordinates | dataset.cf.axes
    dated = [name for name in fit if " since " in str(dataset[name].attrs.get("units"))]
    others = {
        "time": [*axes.get("time", ()), *axes.get("T", ()), *(dated if len(dated) == 1 else ())],
        "level": [*axes.get("vertical", ()), *axes.get("Z", ())],
    }
    found: dict[str, str] = {}
    for role, names in _NAMES.items():
        candidates = [each for name in names.split() for each in named[name]]
        candidates += map(str, others.get(role, ()))
        if role == "level" and "time" in found:  # the depth of an instrument is over time alone
            clock = set(dataset[found["time"]].dims)
            candidates = [n for n in candidates if set(dataset[n].dims) - clock] or candidates
        if candidates:
            found[role] = candidates[0]
    if found.get("east", "").lower() != "e" and found.get("north", "").lower() == "n":
        del found["north"]  # a count
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
                found = {
                    role: f"{variable.name}[{label}]"
                    for role, labels in _LABELS.items()
                    for label in reversed(labels)
                    if label in texts
                }
                if "east" in found:
                    return found
    return {}


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
    text = f"{short(file)} contains {listed([str(name) for name in dataset.variables])}"
    if "time" not in found or not {"east", "speed"} & set(found):
        lacking = "a velocity, or a height and a period of waves," if "time" in found else "a time"
        raise refusal("file", text, f"have {lacking} under a usual name, or name it in [[flow]]")
    if "east" not in found and "direction" not in found:
        raise refusal("file", text, f"have a direction, or components, with {found['speed']}")
    keys: dict[str, Any] = {"kind": "measured", "file": file}
    if found["time"] != "time":
        keys["time"] = found["time"]
    velocity = dataset[found.get("east", found.get("speed", "")).partition("[")[0]]
    if "east" in found:
        named = " ".join(str(velocity.attrs.get(key, "")) for key in ("standard_name", "long_name"))
        compass = "north" in found and not _OWN_AXES.search(named)
        wanted = ("east", "north", "up") if compass else ("east", "up")
        keys["velocity"] = [_signed(dataset, found.get(role, "0")) for role in wanted]
        keys |= {"heading_deg": 90.0} if compass else {}
    else:
        keys |= {"speed": found["speed"], "direction": found["direction"], "heading_deg": 90.0}
    clock = dataset[found["time"]]
    axes = {*clock.dims}
    if level := found.get("level"):
        dims = set(dataset[level].dims)
        flat = dims == axes and clock.ndim == 1 < clock.size
        if (dims & {*velocity.dims}) - axes or (flat and np.unique(clock).size < clock.size):
            keys["vertical"] = level
            axes |= dims
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
    down = "positive down" in str(attributes.get("long_name", ""))
    return f"-{name}" if turned or down or attributes.get("positive") == "down" else name


def _middle(dataset: xr.Dataset, dimension: str) -> float:
    """Return the place in the middle of a dimension: its coordinate, or its index."""
    middle = dataset.sizes[dimension] // 2
    if dimension in dataset.coords and dataset[dimension].dims == (dimension,):
        return float(dataset[dimension].values[middle])
    return float(middle)
