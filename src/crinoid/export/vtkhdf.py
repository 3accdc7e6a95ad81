"""A run for ParaView: the arm as a line with all that is known along it, and what is about it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from crinoid.export.parts import parts_of
from crinoid.export.poly import poly_file
from crinoid.export.pose import at_nodes, unit_vectors
from crinoid.export.source import Source
from crinoid.export.things import Thing
from crinoid.pieces import chosen_pieces
from crinoid.report.view import in_space
from crinoid.variables import LARGE

KINDS = ("target", "base", "obstacle", "tool")
"""Kinds of things by their number in a file."""
_STILL = ("arc_length", "keulegan_carpenter")
"""Variables at nodes that do not change."""
_AT_ONCE = 1 << 19
"""Points of things that are worked out at a time."""

Report = Callable[[int], None]
"""Is told how many instants are written."""
Named = Iterator[tuple[str, str, Float[np.ndarray, "time ..."]]]
"""Names, units and values."""


def write_arm(source: Source, path: Path, report: Report) -> list[str]:
    """Write the arm as one line through its nodes, with all that the result has along it.

    Returns
    -------
    list of str
        Sentences on numbers that are not finite.
    """
    data, records = source.data, source.records
    nodes, lacking = data.sizes["node"], []
    with poly_file(path, source.attributes, data["time"].values[records], nodes) as poly:
        poly.cells("Lines", np.arange(nodes)[None])
        if "diameter" in data:
            poly.still("PointData", "radius", data["diameter"].values / 2, "m")
        for name in _STILL:
            if name in data:
                unit = str(data[name].attrs.get("units", ""))
                poly.still("PointData", name, data[name].values, unit)
        for name, unit, values in _at_instants(data, records):
            poly.field(name, values, unit)
            lacking += [] if np.isfinite(values).all() else [name]
        at = 0
        for piece in chosen_pieces(data, _names_along(data), records):
            poly.points(at, in_space(piece, "position"))
            for name, unit, values in _along_arm(piece):
                poly.at_points(name, at, values, unit)
                lacking += [] if np.isfinite(values).all() else [name]
            at += piece.sizes["time"]
            report(at)
    if not lacking:
        return []
    return [f"numbers that are not finite stay so in {', '.join(dict.fromkeys(lacking))}"]


def write_things(source: Source, things: list[Thing], path: Path) -> None:
    """Write what is about the arm as surfaces: of each triangle ``thing`` and ``kind`` by number.

    Numbers of kinds are those of `KINDS`.
    """
    before = np.cumsum([0, *(len(thing.mesh.points) for thing in things)])
    triangles = [each.mesh.triangles + at for each, at in zip(things, before, strict=False)]
    counts, points, instants = [len(each) for each in triangles], int(before[-1]), source.records
    with poly_file(path, source.attributes, source.data["time"].values[instants], points) as poly:
        poly.cells("Polygons", np.concatenate(triangles))
        poly.still("CellData", "thing", np.repeat(np.arange(len(things)), counts))
        kinds = [KINDS.index(each.kind) for each in things]
        poly.still("CellData", "kind", np.repeat(kinds, counts))
        length = max(1, _AT_ONCE // points)
        for at in range(0, instants.size, length):
            some = slice(at, at + length)
            places = np.concatenate([each.points(some) for each in things], axis=1)
            poly.points(at, places.astype("f4"))  # to be looked at, and many


def _names_along(data: xr.Dataset) -> list[str]:
    return [str(n) for n, v in data.data_vars.items() if "time" in v.dims and LARGE & {*v.dims}]


def _at_instants(data: xr.Dataset, records: Int[np.ndarray, " chosen"]) -> Named:
    """Yield what the whole run has at each instant: vectors, or else one number each."""
    for name, variable in data.data_vars.items():
        if "time" in variable.dims and not LARGE & {*variable.dims} and variable.dtype.kind in "fi":
            yield from _parts(str(name), variable.isel(time=records))


def _along_arm(piece: xr.Dataset) -> Named:
    """Yield what is along the arm over time, what edges have as well, at the nodes."""
    for name, variable in piece.data_vars.items():
        if name == "position":
            continue
        if "bending" in variable.dims:
            yield str(name), str(variable.attrs.get("units", "")), _size(variable)
        for part, unit, values in _parts(str(name), variable):
            if "edge" not in variable.dims:
                yield part, unit, values
                continue
            nodes = at_nodes(values)
            yield part, unit, unit_vectors(nodes) if nodes.ndim == 3 else nodes


def _size(bent: xr.DataArray) -> Float[np.ndarray, "time node"]:
    return np.linalg.norm(bent.transpose("time", "node", "bending").values, axis=-1)


def _parts(name: str, variable: xr.DataArray) -> Named:
    """Yield the parts of a variable, vectors whole and in space."""
    kept = [dim for dim in ("time", "node", "edge", "axis") if dim in variable.dims]
    for part in parts_of(variable, kept):
        # the format takes no dots and slashes in names
        label = re.sub(r"\W", "_", "_".join((name, *part.labels)))
        values = part.of(variable).transpose(*kept)
        if "axis" in kept:
            yield label, part.unit, in_space(values.to_dataset(name="part"), "part")
        else:
            yield label, part.unit, np.asarray(values.values, float)
