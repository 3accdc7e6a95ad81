"""VTKHDF of a run: the arm as a line with its variables, and rigid bodies as surfaces."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from crinoid.foundation.result_variables import LARGE
from crinoid.results.chunks import chosen_pieces
from crinoid.results.scene.bodies import RigidBody, rigid_bodies
from crinoid.results.scene.data import in_space
from crinoid.results.scene.mesh import at_nodes, unit_vectors
from crinoid.view.export.source import Files, Report, Shapes, Source
from crinoid.view.export.table import parts_of

_CELLS = ("Vertices", "Lines", "Polygons", "Strips")

Numbers = Float[np.ndarray, "..."] | Int[np.ndarray, "..."]
PointNumbers = Float[np.ndarray, "time point ..."]


class PolyData:
    """Moving points, joined by constant cells, in an empty file; ``time`` is in s."""

    def __init__(self, file: netCDF4.Dataset, time: Numbers, points: int) -> None:
        self._file, self._count, self._points = file, time.size, points
        self._root = file.createGroup("VTKHDF")
        self._root.setncattr("Version", np.array([2, 0], "i8"))
        self._root.setncattr("Type", "PolyData")
        self._steps = self._root.createGroup("Steps")
        self._steps.setncattr("NSteps", np.int64(time.size))
        none, per_kind = np.zeros(time.size, "i8"), np.zeros((time.size, len(_CELLS)), "i8")
        self._moving = points * np.arange(time.size)
        self._put(self._steps, "Values", time)
        self._put(self._steps, "PartOffsets", none)
        self._put(self._steps, "NumberOfParts", none + 1)
        self._put(self._steps, "PointOffsets", self._moving)
        self._put(self._steps, "CellOffsets", per_kind)
        self._put(self._steps, "ConnectivityIdOffsets", per_kind)
        self._put(self._root, "NumberOfPoints", np.array([points]))

    def cells(self, kind: str, corners: Int[np.ndarray, "cell corner"]) -> None:
        """Join points by cells of one kind, `"Lines"` or `"Polygons"`."""
        for name in _CELLS:
            here = corners if name == kind else np.empty((0, 0), int)
            group, (count, each) = self._root.createGroup(name), here.shape
            self._put(group, "NumberOfCells", np.array([count]))
            self._put(group, "NumberOfConnectivityIds", np.array([here.size]))
            self._put(group, "Connectivity", here.ravel())
            self._put(group, "Offsets", each * np.arange(count + 1))

    def still(self, group: str, name: str, values: Numbers, unit: str = "") -> None:
        """Write constant numbers of points (`"PointData"`) or cells (`"CellData"`)."""
        self._put(self._root, f"{group}/{name}", values, unit)
        self._put(self._steps, f"{group}Offsets/{name}", np.zeros(self._count, "i8"))

    def field(self, name: str, values: Float[np.ndarray, "time ..."], unit: str) -> None:
        """Write numbers of the whole at each instant."""
        self._put(self._root, f"FieldData/{name}", values, unit)
        self._put(self._steps, f"FieldDataOffsets/{name}", np.arange(self._count))
        parts = values[0].size
        self._put(self._steps, f"FieldDataSizes/{name}", np.tile([parts, 1], (self._count, 1)))

    def points(self, at: int, places: Float[np.ndarray, "time point axis=3"]) -> None:
        """Write the points (m) from an instant on, in the precision of the places."""
        self._grow("Points", at, places, "m")

    def at_points(self, name: str, at: int, values: PointNumbers, unit: str) -> None:
        """Write numbers of points from an instant on."""
        if not at:
            self._put(self._steps, f"PointDataOffsets/{name}", self._moving)
        self._grow(f"PointData/{name}", at, values, unit)

    def _grow(self, name: str, at: int, values: PointNumbers, unit: str) -> None:
        rows = values.reshape(-1, *values.shape[2:])
        if not at:
            shape = (self._count * self._points, *rows.shape[1:])
            self._make(self._root, name, shape, rows.dtype, unit)
        first = at * self._points
        self._root[name][first : first + len(rows)] = rows

    def _put(self, group: netCDF4.Group, name: str, values: Numbers, unit: str = "") -> None:
        made = self._make(group, name, values.shape, values.dtype, unit)
        if values.size:
            made[:] = values

    def _make(self, group: Any, name: str, shape: tuple[int, ...], kind: Any, unit: str) -> Any:
        """Create a variable; its dimensions, which HDF5 lacks, have the names of their sizes."""
        dims = [f"of_{size}" for size in shape]
        for dim, size in zip(dims, shape, strict=True):
            if dim not in self._file.dimensions:
                self._file.createDimension(dim, size or None)  # only an unlimited one can be empty
        made = group.createVariable(name, kind, dims)
        if unit:
            made.setncattr("units", unit)
        return made


@contextmanager
def poly_data(path: Path, source: Source, points: int) -> Iterator[PolyData]:
    """Write a file of the instants of a source, whose attributes are at its root."""
    with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
        file.set_fill_off()
        file.setncatts(source.attributes)
        time = np.asarray(source.data["time"].values[source.records], float)
        yield PolyData(file, time, points)


KINDS = ("target", "base", "obstacle", "tool")  # kinds of things by their number in a file
_STILL = ("arc_length", "keulegan_carpenter")  # constant variables at nodes
_BATCH = 1 << 19  # points of surfaces that are computed in one call

Named = Iterator[tuple[str, str, Float[np.ndarray, "time ..."]]]  # names, units and values


def write_vtkhdf(source: Shapes, files: Files, report: Report) -> list[str]:
    """Write the arm and the bodies around it; return notes on numbers that are not finite."""
    arm, surroundings = files
    notes = write_arm(source, arm, report)
    write_bodies(source, rigid_bodies(source.scene, source.run), surroundings)
    return notes


def write_arm(source: Source, path: Path, report: Report) -> list[str]:
    """Write the arm as one line through its nodes, with all variables along it; return notes."""
    data, records = source.data, source.records
    nodes, lacking = data.sizes["node"], []
    with poly_data(path, source, nodes) as poly:
        poly.cells("Lines", np.arange(nodes)[None])
        if "diameter" in data:
            poly.still("PointData", "radius", data["diameter"].values / 2, "m")
        for name in _STILL:
            if name in data:
                unit = str(data[name].attrs.get("units", ""))
                poly.still("PointData", name, data[name].values, unit)
        for whole, variable in data.data_vars.items():
            dims = {*variable.dims}
            if "time" in dims and not LARGE & dims and variable.dtype.kind in "fi":
                for name, unit, values in _parts(str(whole), variable.isel(time=records)):
                    poly.field(name, values, unit)
                    lacking += [] if np.isfinite(values).all() else [name]
        at = 0
        names = [
            str(n) for n, v in data.data_vars.items() if "time" in v.dims and LARGE & {*v.dims}
        ]
        for piece in chosen_pieces(data, names, records):
            poly.points(at, in_space(piece, "position"))
            for name, unit, values in _along_arm(piece):
                poly.at_points(name, at, values, unit)
                lacking += [] if np.isfinite(values).all() else [name]
            at += piece.sizes["time"]
            report(at, records.size)
    if not lacking:
        return []
    return [f"numbers that are not finite stay so in {', '.join(dict.fromkeys(lacking))}"]


def write_bodies(source: Source, bodies: list[RigidBody], path: Path) -> None:
    """Write rigid bodies as surfaces: of each triangle its body and its place in `KINDS`."""
    meshes = [body.shape.mesh() for body in bodies]
    before = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    triangles = [mesh.triangles + at for mesh, at in zip(meshes, before, strict=False)]
    counts, points, instants = [len(each) for each in triangles], int(before[-1]), source.records
    with poly_data(path, source, points) as poly:
        poly.cells("Polygons", np.concatenate(triangles))
        poly.still("CellData", "thing", np.repeat(np.arange(len(bodies)), counts))
        kinds = [KINDS.index(each.kind) for each in bodies]
        poly.still("CellData", "kind", np.repeat(kinds, counts))
        length = max(1, _BATCH // points)
        for at in range(0, instants.size, length):
            some = slice(at, at + length)
            moved = [
                body.paths(mesh.points, some) for body, mesh in zip(bodies, meshes, strict=True)
            ]
            places = np.concatenate(moved, axis=1)
            poly.points(at, places.astype("f4"))  # for display only, and many


def _along_arm(piece: xr.Dataset) -> Named:
    """Yield variables along the arm over time, those of edges also at the nodes."""
    for name, variable in piece.data_vars.items():
        if name == "position":
            continue
        if "bending" in variable.dims:
            bent = variable.transpose("time", "node", "bending").values
            yield str(name), str(variable.attrs.get("units", "")), np.linalg.norm(bent, axis=-1)
        for part, unit, values in _parts(str(name), variable):
            if "edge" not in variable.dims:
                yield part, unit, values
                continue
            nodes = at_nodes(values)
            yield part, unit, unit_vectors(nodes) if nodes.ndim == 3 else nodes


def _parts(name: str, variable: xr.DataArray) -> Named:
    """Yield the parts of a variable; vectors are whole and in space."""
    kept = [dim for dim in ("time", "node", "edge", "axis") if dim in variable.dims]
    for part in parts_of(variable, kept):
        # names in the format have no dots and slashes
        label = re.sub(r"\W", "_", "_".join((name, *part.labels)))
        values = part.of(variable).transpose(*kept)
        if "axis" in kept:
            yield label, part.unit, in_space(values.to_dataset(name="part"), "part")
        else:
            yield label, part.unit, np.asarray(values.values, float)
