"""What a run gives: an `xarray.Dataset` with units, and the state to go on from."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from crinoid.scenario import Scenario

RESULT = "result.nc"
UNCONTROLLED = "uncontrolled.nc"
_CHECKPOINT = "checkpoint"

Tree = TypeVar("Tree")


class ResultError(ValueError):
    """A file that holds no result, or not one that can be gone on with."""


class Result:
    """A run: its data, how it ended, and the same case without control if that was run too."""

    def __init__(
        self,
        dataset: xr.Dataset,
        checkpoint: Sequence[np.ndarray] = (),
        uncontrolled: Result | None = None,
    ) -> None:
        self.dataset = dataset
        self.checkpoint = list(checkpoint)
        self.uncontrolled = uncontrolled

    @property
    def status(self) -> str:
        """``ok``, or what went wrong and when."""
        return str(self.dataset.attrs["status"])

    @property
    def notes(self) -> list[str]:
        """What should be known of the run besides its data, a sentence each."""
        return str(self.dataset.attrs.get("notes", "")).splitlines()

    @property
    def failure(self) -> str:
        """What went wrong in this run or in the one without control; empty if nothing did."""
        other = self.uncontrolled.failure if self.uncontrolled is not None else ""
        return self.status if self.status.startswith("failed") else other

    @property
    def interrupted(self) -> bool:
        """Whether this run or the one without control was stopped before its end."""
        other = self.uncontrolled is not None and self.uncontrolled.interrupted
        return self.status.startswith("interrupted") or other

    @property
    def scenario(self) -> Scenario:
        """The scenario that was run."""
        return Scenario.from_toml(str(self.dataset.attrs["scenario"]))

    def restore(self, like: Tree) -> Tree:
        """Return the state at the end, in the shape of ``like``.

        Raises
        ------
        ResultError
            If the state saved is not of that shape.
        """
        wanted = [(leaf.shape, leaf.dtype) for leaf in map(np.asarray, jax.tree.leaves(like))]
        if wanted != [(leaf.shape, leaf.dtype) for leaf in self.checkpoint]:
            raise ResultError("it holds no state that this scenario can go on from")
        leaves = [jnp.asarray(leaf) for leaf in self.checkpoint]
        return jax.tree.unflatten(jax.tree.structure(like), leaves)

    def save(self, folder: Path) -> list[Path]:
        """Write ``result.nc``, and ``uncontrolled.nc`` if there is one, and return their paths.

        A file is replaced only once its successor is complete.

        Raises
        ------
        OSError
            If the folder cannot be written to.
        """
        folder.mkdir(parents=True, exist_ok=True)
        paths = [folder / RESULT]
        self._write(paths[0])
        if self.uncontrolled is not None:
            paths.append(folder / UNCONTROLLED)
            self.uncontrolled._write(paths[1])
        else:
            (folder / UNCONTROLLED).unlink(missing_ok=True)  # of an earlier run
        return paths

    @staticmethod
    def load(folder: Path) -> Result:
        """Read what `save` wrote.

        Raises
        ------
        ResultError
            If there is no result in the folder, or none that this version can read.
        """
        result = _read(folder / RESULT)
        if (folder / UNCONTROLLED).exists():
            result.uncontrolled = _read(folder / UNCONTROLLED)
        return result

    def _write(self, path: Path) -> None:
        encoding = {
            name: {"zlib": True, "complevel": 1}
            for name, variable in self.dataset.data_vars.items()
            if variable.ndim > 1
        }
        leaves = xr.Dataset(
            {
                f"leaf_{number:03d}": ([f"d{number:03d}_{axis}" for axis in range(leaf.ndim)], leaf)
                for number, leaf in enumerate(self.checkpoint)
            }
        )
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        os.close(handle)
        temporary = Path(name)
        try:
            self.dataset.to_netcdf(temporary, engine="netcdf4", encoding=encoding)
            leaves.to_netcdf(temporary, engine="netcdf4", mode="a", group=_CHECKPOINT)
            temporary.chmod(0o666 & ~_umask())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def _read(path: Path) -> Result:
    try:
        with xr.open_dataset(path, engine="netcdf4") as dataset:
            dataset.load()
        with xr.open_dataset(path, engine="netcdf4", group=_CHECKPOINT) as leaves:
            checkpoint = [leaves[name].values for name in sorted(map(str, leaves.data_vars))]
    except FileNotFoundError:
        raise ResultError(f"{path}: no such result") from None
    except (OSError, ValueError) as error:
        raise ResultError(f"{path}: not a result of crinoid ({error})") from error
    if "status" not in dataset.attrs or "scenario" not in dataset.attrs:
        raise ResultError(f"{path}: not a result of crinoid")
    return Result(dataset, checkpoint)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
