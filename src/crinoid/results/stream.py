"""A growing netCDF file, readable at any time, even after the program was killed.

It is of the classic format: instants follow one another at its end, and a number in its head says
how many there are. That number is raised only once they are on the disk. A checkpoint lies in a
file next to it, which is replaced as a whole and is never later than the instants. Its name has a
key that the head of the file has too: another run replaces both at the same time.
"""

import os
import secrets
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from crinoid.foundation.atomic_file import atomic_write, remove_unfinished

_MAGIC = b"CDF\x02"
_KEY = "checkpoint_key"  # attribute
_BLOCK = 1 << 22  # bytes that are read at once
_LARGE = {"node", "edge"}
"""Dimensions that make a variable over time stay in the file until it is used."""
_DEFLATED = 1032
"""Largest ratio of the bytes of a variable to those in its file (zlib, "Maximum Compression")."""


class Stream:
    """Instants of a run in a file that grows.

    It is replaced once all that is given here is in its successor: the first instant with all that
    does not change, pieces of more instants, and the state after them and its time (s).
    """

    def __init__(
        self,
        path: Path,
        first: xr.Dataset,
        more: Iterable[xr.Dataset],
        leaves: Mapping[str, np.ndarray],
        wall_time: float,
    ) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path, self._first, self._key = path, first, secrets.token_hex(4)
        self._checkpoint = _checkpoint_path(path, self._key)
        head = first.assign_attrs({_KEY: self._key})
        with atomic_write(path) as temporary:
            head.to_netcdf(
                temporary, engine="netcdf4", format="NETCDF3_64BIT", unlimited_dims=["time"]
            )
            with netCDF4.Dataset(temporary) as file:
                self._instant = np.dtype(
                    [
                        (name, variable.dtype.newbyteorder(">"), variable.shape[1:])
                        for name, variable in file.variables.items()
                        if variable.dimensions[:1] == ("time",)
                    ]
                )
            self._begin = temporary.read_bytes().index(self._packed(first).tobytes())
            self._count = 1
            self._path = temporary
            for piece in more:
                self.append(piece)
            self.keep(leaves, wall_time)
        self._path = path
        remove_checkpoints(path)

    def append(self, piece: xr.Dataset) -> None:
        """Append instants to the file; they count from `keep` on."""
        instants = self._packed(piece)
        with _telling(self._path), self._path.open("r+b") as file:
            file.seek(self._begin + self._count * self._instant.itemsize)
            file.write(instants.view("u1").data)
        self._count += len(instants)

    def keep(self, leaves: Mapping[str, np.ndarray], wall_time: float) -> None:
        """Let the instants count, and replace the checkpoint."""
        with _telling(self._path), self._path.open("r+b") as file:
            os.fsync(file.fileno())
            file.seek(len(_MAGIC))
            file.write(struct.pack(">i", self._count))
            file.flush()
            os.fsync(file.fileno())
        with atomic_write(self._checkpoint) as temporary, temporary.open("wb") as file:
            named = {f"leaves/{name}": leaf for name, leaf in leaves.items()}
            np.savez(file, allow_pickle=False, wall_time=np.asarray(wall_time), **named)

    def dataset(self) -> xr.Dataset:
        """Return all instants; large variables stay in the file until they are used."""
        blocks = _Blocks(self._path, self._begin, self._instant, self._count)
        small: dict[str, np.ndarray] = {}
        found: dict[str, Any] = {}
        for name, variable in self._first.variables.items():
            data: Any = variable.values
            if "time" in variable.dims:
                shape = (self._count, *variable.shape[1:])
                if _LARGE & set(variable.dims):
                    read = partial(blocks.read, str(name), variable.dtype)
                    data = indexing.LazilyIndexedArray(_Lazy(shape, variable.dtype, read))
                else:
                    data = small[str(name)] = np.empty(shape, variable.dtype)
            found[str(name)] = xr.Variable(variable.dims, data, variable.attrs)
        for start, block in blocks.between(0, self._count):
            for name, values in small.items():
                values[start : start + len(block)] = block[name]
        return _with_coordinates(self._first, found)

    def _packed(self, piece: xr.Dataset) -> np.ndarray:
        """Return instants as they follow one another in the file."""
        instants = np.empty(piece.sizes["time"], self._instant)
        for name in self._instant.names or ():
            instants[name] = piece[name].values
        return instants


class _Blocks:
    """The instants of a file, read a block at a time; the last two are held.

    The variables of an instant are contiguous, so reading one reads the others too.
    """

    def __init__(self, path: Path, begin: int, instant: np.dtype[Any], count: int) -> None:
        self._path, self._begin, self._instant, self._count = path, begin, instant, count
        self._length = max(1, _BLOCK // instant.itemsize)
        self._held: dict[int, np.ndarray] = {}

    def between(self, low: int, high: int) -> Iterator[tuple[int, np.ndarray]]:
        """Yield the instants from one to another, in parts, each with the number of its first."""
        if not is_stream(self._path):
            raise OSError(f"{self._path}: no longer there as it was written")
        for number in range(low // self._length, -(-high // self._length)):
            first = number * self._length
            if number not in self._held:
                there = self._begin + first * self._instant.itemsize
                size = min(self._length, self._count - first)
                block = np.fromfile(self._path, self._instant, size, offset=there)
                self._held = dict(list(self._held.items())[-1:]) | {number: block}
            start, stop = max(low, first), min(high, first + self._length)
            yield start, self._held[number][start - first : stop - first]

    def read(self, name: str, dtype: np.dtype[Any], key: tuple[Any, ...]) -> np.ndarray:
        """Read some of a variable."""
        asked, *rest = key
        if not isinstance(asked, slice):
            one = slice(asked % self._count, asked % self._count + 1)
            return np.asarray(self.read(name, dtype, (one, *rest))[0])
        which = range(self._count)[asked]
        low, high = min(which, default=0), max(which, default=-1) + 1
        found = np.empty((high - low, *self._instant[name].shape), dtype)
        for start, block in self.between(low, high):
            found[start - low : start - low + len(block)] = block[name]
        return found[(slice(None, None, which.step), *rest)]


class _Lazy(BackendArray):
    """An array that is read from a file when, and as far as, it is asked for."""

    def __init__(
        self,
        shape: tuple[int, ...],
        dtype: np.dtype[Any],
        read: Callable[[tuple[Any, ...]], np.ndarray],
    ) -> None:
        self.shape, self.dtype, self._read = shape, dtype, read

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._read
        )


def open_lazily(path: Path) -> xr.Dataset:
    """Return the data of a file. Large variables stay on disk, and the file closes."""

    def read(name: str, key: tuple[Any, ...]) -> np.ndarray:
        with netCDF4.Dataset(path) as file:
            file.set_auto_mask(False)
            return np.asarray(file[name][key])

    # indexes would be read before their sizes are known
    with xr.open_dataset(
        path, engine="netcdf4", decode_times=False, create_default_indexes=False
    ) as stored:
        check_size(stored, path)
        found: dict[str, Any] = {}
        for name, variable in stored.variables.items():
            if "time" in variable.dims and _LARGE & set(variable.dims):
                lazy = _Lazy(variable.shape, variable.dtype, partial(read, str(name)))
                data = indexing.LazilyIndexedArray(lazy)
                found[str(name)] = xr.Variable(variable.dims, data, variable.attrs)
            else:
                found[str(name)] = variable.load()
        return _with_coordinates(stored, found)


def check_size(stored: xr.Dataset, path: Path) -> None:
    """Refuse a file whose variables are larger than it can hold, before any is read."""
    if stored.nbytes > _DEFLATED * path.stat().st_size:
        raise ValueError(f"its variables have {stored.nbytes} bytes, more than it can hold")


def is_stream(path: Path) -> bool:
    """Return whether a file grows, or was left by a killed program."""
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


def read_checkpoint(path: Path, dataset: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the checkpoint of a growing file; empty without one.

    Its time is put into the attribute ``wall_time`` of the data.
    """
    there = _checkpoint_path(path, str(dataset.attrs.pop(_KEY, "")))
    if not there.exists():
        return {}
    with np.load(there, allow_pickle=False) as file:
        found = {name: file[name] for name in file.files}
    dataset.attrs["wall_time"] = float(found.pop("wall_time"))
    return {name.removeprefix("leaves/"): leaf for name, leaf in found.items()}


def remove_checkpoints(path: Path) -> None:
    """Remove the checkpoints of earlier files of this name, and temporary files."""
    key = ""
    if is_stream(path):
        with suppress(OSError, AttributeError), netCDF4.Dataset(path) as file:
            key = file.getncattr(_KEY)
    own = _checkpoint_path(path, key)
    for each in path.parent.glob(_checkpoint_path(path, "*").name):
        if each != own:
            with suppress(OSError):
                each.unlink()
    remove_unfinished(_checkpoint_path(path, "*"))


def _checkpoint_path(path: Path, key: str) -> Path:
    return path.with_name(f"{path.stem}.{key}.checkpoint.npz")


def _with_coordinates(like: xr.Dataset, variables: Mapping[str, Any]) -> xr.Dataset:
    coords = {name: variables[str(name)] for name in like.coords}
    data = {name: variables[str(name)] for name in like.data_vars}
    return xr.Dataset(data, coords, like.attrs)


@contextmanager
def _telling(path: Path) -> Iterator[None]:
    """Name the folder of a file that cannot be written."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path.parent)) from error
