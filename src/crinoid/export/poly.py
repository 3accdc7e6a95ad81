"""Files in Kitware's format VTKHDF, which ParaView opens as a series over time.

They hold poly data after version 2.0 of the format (https://docs.vtk.org, "VTKHDF file format"),
and are written as netCDF-4, which is HDF5. What netCDF needs for itself lies outside of the group
``VTKHDF``, where readers do not look.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from jaxtyping import Float, Int

_VERSION = (2, 0)
_CELLS = ("Vertices", "Lines", "Polygons", "Strips")

Numbers = Float[np.ndarray, "..."] | Int[np.ndarray, "..."]


class Poly:
    """Points that move over time, joined by cells that stay.

    Parameters
    ----------
    file
        The file, which is empty.
    time
        Instants (s).
    points
        Number of points.
    """

    def __init__(
        self, file: netCDF4.Dataset, time: Float[np.ndarray, " time"], points: int
    ) -> None:
        self._file, self._count, self._points = file, time.size, points
        self._root = file.createGroup("VTKHDF")
        self._root.setncattr("Version", np.array(_VERSION, "i8"))
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
        """Give points (`"PointData"`) or cells (`"CellData"`) numbers that do not change."""
        self._put(self._root, f"{group}/{name}", values, unit)
        self._put(self._steps, f"{group}Offsets/{name}", np.zeros(self._count, "i8"))

    def field(self, name: str, values: Float[np.ndarray, "time ..."], unit: str) -> None:
        """Give the whole numbers at each instant."""
        self._put(self._root, f"FieldData/{name}", values, unit)
        self._put(self._steps, f"FieldDataOffsets/{name}", np.arange(self._count))
        parts = values[0].size
        self._put(self._steps, f"FieldDataSizes/{name}", np.tile([parts, 1], (self._count, 1)))

    def points(self, at: int, places: Float[np.ndarray, "time point axis=3"]) -> None:
        """Place the points (m) from an instant on, in the precision of the places."""
        self._grow("Points", at, places, "m")

    def at_points(
        self, name: str, at: int, values: Float[np.ndarray, "time point ..."], unit: str
    ) -> None:
        """Give points numbers from an instant on."""
        if not at:
            self._put(self._steps, f"PointDataOffsets/{name}", self._moving)
        self._grow(f"PointData/{name}", at, values, unit)

    def _grow(
        self, name: str, at: int, values: Float[np.ndarray, "time point ..."], unit: str
    ) -> None:
        rows = values.reshape(-1, *values.shape[2:])
        if not at:
            self._make(
                self._root, name, (self._count * self._points, *rows.shape[1:]), rows.dtype, unit
            )
        first = at * self._points
        self._root[name][first : first + len(rows)] = rows

    def _put(self, group: netCDF4.Group, name: str, values: Numbers, unit: str = "") -> None:
        made = self._make(group, name, values.shape, values.dtype, unit)
        if values.size:
            made[:] = values

    def _make(
        self,
        group: netCDF4.Group,
        name: str,
        shape: tuple[int, ...],
        kind: Any,
        unit: str,
    ) -> Any:
        """Make a variable; dimensions, which only netCDF knows, are named after their sizes."""
        dims = [f"of_{size}" for size in shape]
        for dim, size in zip(dims, shape, strict=True):
            if dim not in self._file.dimensions:
                self._file.createDimension(dim, size or None)  # only without limit it may be empty
        made = group.createVariable(name, kind, dims)
        if unit:
            made.setncattr("units", unit)
        return made


@contextmanager
def poly_file(
    path: Path, attributes: Mapping[str, str], time: Float[np.ndarray, " time"], points: int
) -> Iterator[Poly]:
    """Write a file whose root has some attributes."""
    with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
        file.set_fill_off()
        file.setncatts(attributes)
        yield Poly(file, np.asarray(time, float), points)
