"""The result of a run: an `xarray.Dataset` with units, and the state to go on from."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import netCDF4
import numpy as np
import xarray as xr

from crinoid.replacement import replacing
from crinoid.scenario import Scenario
from crinoid.version import __version__

RESULT = "result.nc"
UNCONTROLLED = "uncontrolled.nc"
_CHECKPOINT = "checkpoint"

_REQUIRED = {
    "time": ("time",),
    "position": ("time", "node", "axis"),
    "velocity": ("time", "node", "axis"),
    "acceleration": ("time", "node", "axis"),
    "tip_position": ("time", "axis"),
    "tip_target": ("time", "axis"),
    "tip_error": ("time",),
    "base_command": ("time", "channel"),
    "base_servo": ("time", "channel"),
    "base_force": ("time", "axis"),
    "energy": ("time", "kind"),
    "steps": ("time",),
    "newton_iterations": ("time",),
    "residual": ("time",),
}
"""Numbers without which a file is no result; there are more."""
_OVER = {
    "axis": "axis",
    "channel": "channel",
    "kind": "kind",
    "base_moment": "time",
    "tip_angle": "time",
}
"""Labels, and numbers that may have other dimensions as well, by a dimension of theirs."""

Tree = TypeVar("Tree")


class ResultError(ValueError):
    """A file that holds no result, or not one that can be gone on with."""


class Result:
    """A run: its data, how it ended, and the same case without control if that was run too.

    Parameters
    ----------
    dataset
        Its data.
    checkpoint
        The state at the end, as `named_leaves` gives it; nothing where there is none to go on from.
    uncontrolled
        The same case without control.
    """

    def __init__(
        self,
        dataset: xr.Dataset,
        checkpoint: Mapping[str, np.ndarray] | None = None,
        uncontrolled: Result | None = None,
    ) -> None:
        self.dataset = dataset
        self.checkpoint = dict(checkpoint or {})
        self.uncontrolled = uncontrolled

    @property
    def status(self) -> str:
        """``ok``, or what went wrong and when."""
        return str(self.dataset.attrs["status"])

    @property
    def notes(self) -> list[str]:
        """Notes on the run that its data do not give, a sentence each."""
        return str(self.dataset.attrs.get("notes", "")).splitlines()

    @property
    def digests(self) -> dict[str, str]:
        """The SHA-256 digest of each file that the run was made from."""
        lines = str(self.dataset.attrs.get("files", "")).splitlines()
        return {file: digest for digest, _, file in (line.partition("  ") for line in lines)}

    @property
    def failure(self) -> str:
        """Failure of this run or of the one without control; empty if neither failed."""
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
            If the state saved is of another version, or not of that shape.
        """
        version = self.dataset.attrs.get("crinoid_version")
        if version != __version__:
            raise ResultError(
                f"it was saved by crinoid {version} and this is {__version__}, "
                "which may compute otherwise: run it anew"
            )
        wanted, saved = named_leaves(like), self.checkpoint
        for name in dict.fromkeys([*wanted, *saved]):
            if _kind(wanted.get(name)) != _kind(saved.get(name)):
                raise ResultError(
                    "it holds no state that this scenario can go on from: of "
                    f"{name} it has {_kind(saved.get(name))}, not {_kind(wanted.get(name))}"
                )
        leaves = [jnp.asarray(saved[name]) for name in wanted]
        return jax.tree.unflatten(jax.tree.structure(like), leaves)

    def save(self, folder: Path) -> list[Path]:
        """Write ``result.nc``, and ``uncontrolled.nc`` if there is one, and return their paths.

        The files are replaced only once their successors are complete.

        Raises
        ------
        OSError
            If the folder cannot be written to, or the disk is full.
        """
        folder.mkdir(parents=True, exist_ok=True)
        runs = {RESULT: self}
        if self.uncontrolled is not None:
            runs[UNCONTROLLED] = self.uncontrolled
        with ExitStack() as stack:
            for name, run in runs.items():
                run._write(stack.enter_context(replacing(folder / name)))
        if self.uncontrolled is None and attributes(folder / UNCONTROLLED):  # of an earlier run
            (folder / UNCONTROLLED).unlink()
        return [folder / name for name in runs]

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
                name: ([f"d{number:03d}_{axis}" for axis in range(leaf.ndim)], leaf)
                for number, (name, leaf) in enumerate(self.checkpoint.items())
            },
            attrs={"crinoid_version": __version__},
        )
        self.dataset.to_netcdf(path, engine="netcdf4", encoding=encoding)
        leaves.to_netcdf(path, engine="netcdf4", mode="a", group=_CHECKPOINT)


def named_leaves(tree: Any) -> dict[str, np.ndarray]:
    """Return the arrays of a tree by their path in it, such as ``state.motion.position``."""
    return {
        jax.tree_util.keystr(path, simple=True, separator="."): np.asarray(leaf)
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree)
    }


def attributes(path: Path) -> dict[str, Any]:
    """Return the attributes of a file that crinoid wrote; none of any other, or of no file."""
    try:
        with netCDF4.Dataset(path) as file:
            found = {name: file.getncattr(name) for name in file.ncattrs()}
    except (OSError, RuntimeError, ValueError):
        return {}
    return found if "crinoid_version" in found else {}


def _read(path: Path) -> Result:
    try:
        with xr.open_dataset(path, engine="netcdf4", decode_times=False) as dataset:
            dataset.load()
        with xr.open_dataset(path, engine="netcdf4", group=_CHECKPOINT) as leaves:
            checkpoint = {str(name): leaf.values for name, leaf in leaves.data_vars.items()}
    except FileNotFoundError:
        raise ResultError(f"{path}: no such result") from None
    except Exception as error:  # a file that is broken makes its readers raise anything
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ResultError(f"{path}: not a result of crinoid ({reason})") from error
    for name, dims in _REQUIRED.items():
        if name not in dataset.variables:
            raise ResultError(f"{path}: not a result of crinoid, it has no {name}")
        if dataset[name].dims != dims or dataset[name].dtype.kind not in "fi":
            text = f"not a result of crinoid, its {name} is no array of numbers over "
            raise ResultError(f"{path}: {text}{', '.join(dims)}")
    for name, dim in _OVER.items():
        if name not in dataset.variables or dim not in dataset[name].dims:
            raise ResultError(f"{path}: not a result of crinoid, it has no {name} over {dim}")
    if not dataset.sizes["time"]:
        raise ResultError(f"{path}: not a result of crinoid, it holds no instant")
    for name, kind in {"status": str, "scenario": str, "wall_time": float}.items():
        if not isinstance(dataset.attrs.get(name), kind):
            raise ResultError(f"{path}: not a result of crinoid, it does not say its {name}")
    return Result(dataset, checkpoint)


def _kind(leaf: np.ndarray | None) -> str:
    if leaf is None:
        return "nothing"
    return f"an array {leaf.shape} of {leaf.dtype}" if leaf.ndim else f"a number, {leaf.dtype}"
