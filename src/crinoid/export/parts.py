"""The parts of a variable of a result: a name and a unit for each channel, kind, node or axis."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
import xarray as xr


@dataclass(frozen=True)
class Part:
    """A part of a variable: places are chosen along some of its dimensions."""

    labels: tuple[str, ...]
    """Names of these places: ``slide``, ``kinetic``, ``x``; by number ``node3``."""
    unit: str
    """As CF writes it; empty where the result tells none."""
    place: tuple[tuple[str, int], ...]
    """Dimensions and numbers of these places."""

    def of(self, variable: xr.DataArray) -> xr.DataArray:
        """Return this part of a variable."""
        return variable.isel(dict(self.place), drop=True)


def parts_of(variable: xr.DataArray, kept: Collection[str]) -> Iterator[Part]:
    """Yield the parts of a variable, whole along the dimensions that are kept."""
    dims = [str(dim) for dim in variable.dims if dim not in kept]
    for places in np.ndindex(*(variable.sizes[dim] for dim in dims)):
        place = tuple(zip(dims, places, strict=True))
        labels = tuple(_label(variable, dim, number) for dim, number in place)
        yield Part(labels, _unit(variable, place), place)


def _label(variable: xr.DataArray, dim: str, number: int) -> str:
    if dim in variable.coords:
        return str(variable.coords[dim].values[number])
    return f"{dim}{number}"


def _unit(variable: xr.DataArray, place: tuple[tuple[str, int], ...]) -> str:
    """Return the unit of a part; a coordinate tells it where parts differ in theirs."""
    found = [
        str(variable.coords[f"{dim}_unit"].values[number])
        for dim, number in place
        if f"{dim}_unit" in variable.coords
    ]
    return str(variable.attrs.get("units", "")) or "".join(found)
