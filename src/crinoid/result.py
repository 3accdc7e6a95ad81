"""What a run gives: an `xarray.Dataset` with units, and the state to go on from."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from crinoid.base import CHANNELS
from crinoid.dynamics import System
from crinoid.elements import ENERGIES, WORKS
from crinoid.record import Record
from crinoid.scenario import Scenario
from crinoid.version import __version__

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


def describe(scenario: Scenario) -> dict[str, Any]:
    """Return the attributes that every result of a scenario has."""
    return {
        "Conventions": "CF-1.11",
        "title": scenario.title or "crinoid simulation",
        "source": f"crinoid {__version__}",
        "crinoid_version": __version__,
        "scenario": scenario.to_toml(),
        "seed": scenario.seed,
    }


def join(parts: Sequence[xr.Dataset]) -> xr.Dataset:
    """Put the stretches of one run after each other."""
    if len(parts) == 1:
        return parts[0]
    whole = xr.concat(parts, "time", data_vars="minimal", coords="minimal", compat="override")
    whole["tip_angle"].values = np.unwrap(whole["tip_angle"].values)
    return whole


def build_dataset(scenario: Scenario, system: System, kept: Record) -> xr.Dataset:
    """Turn saved instants into a dataset with names, units and what follows from the motion."""
    rod = system.rod
    origin = np.asarray(system.forces.origin)
    edges = np.diff(kept.position, axis=1)
    lengths = np.linalg.norm(edges, axis=2, keepdims=True)
    tangent = edges / lengths
    stretching = np.sum(tangent * np.diff(kept.velocity, axis=1), axis=2)
    rest_length, EA = np.asarray(rod.rest_length), np.asarray(rod.EA)
    strain = lengths[..., 0] / rest_length - 1
    tension = EA * (strain + float(rod.damping_time) * stretching / rest_length)
    miss = kept.tip[:, :2] - kept.wanted[:, :2]
    axes = ("x", "z")

    quantities: dict[str, tuple[tuple[str, ...], ArrayLike, str, str]] = {
        "position": (("time", "node", "axis"), kept.position + origin, "m", "place of the nodes"),
        "velocity": (("time", "node", "axis"), kept.velocity, "m s-1", "velocity of the nodes"),
        "acceleration": (
            ("time", "node", "axis"),
            kept.acceleration,
            "m s-2",
            "acceleration of the nodes",
        ),
        "tangent": (("time", "edge", "axis"), tangent, "1", "direction of the edges"),
        "curvature": (
            ("time", "node"),
            _curvature(scenario, system, kept, tangent),
            "m-1",
            "curvature, positive from x toward z",
        ),
        "tension": (("time", "edge"), tension, "N", "axial force in the edges, tension positive"),
        "tip_position": (("time", "axis"), kept.tip[:, :2], "m", "place of the tip"),
        "tip_target": (("time", "axis"), kept.wanted[:, :2], "m", "where the tip should be"),
        "tip_angle": (("time",), np.unwrap(kept.tip[:, 2]), "rad", "direction of the tip"),
        "tip_angle_target": (
            ("time",),
            kept.wanted[:, 2],
            "rad",
            "where the tip should point",
        ),
        "tip_error": (
            ("time",),
            np.linalg.norm(miss, axis=1),
            "m",
            "distance of the tip from where it should be",
        ),
        "flow_velocity": (
            ("time", "node", "axis"),
            kept.flow_velocity,
            "m s-1",
            "velocity of the undisturbed water at the nodes",
        ),
        "flow_speed": (
            ("time", "node"),
            np.linalg.norm(kept.flow_velocity, axis=2),
            "m s-1",
            "speed of the undisturbed water at the nodes",
        ),
        "base_command": (
            ("time", "channel"),
            kept.command,
            "",
            "command of the base channels, from the set pose",
        ),
        "base_pose": (
            ("time", "channel"),
            kept.pose,
            "",
            "displacement of the base channels from the set pose",
        ),
        "base_force": (("time", "axis"), kept.base_force, "N", "force of the arm on the submarine"),
        "base_moment": (
            ("time",),
            kept.base_moment,
            "N m",
            "moment of the arm on the submarine about the root, positive from x toward z",
        ),
        "energy": (
            ("time", "kind"),
            kept.energy,
            "J",
            "stored energies, and works done on the arm since the start",
        ),
        "steps": (("time",), kept.steps, "1", "time steps since the instant before"),
        "newton_iterations": (
            ("time",),
            kept.iterations,
            "1",
            "Newton iterations since the instant before",
        ),
        "residual": (
            ("time",),
            kept.residual,
            "N",
            "largest force imbalance of a node since the instant before",
        ),
    }
    dataset = xr.Dataset(
        {
            name: (dims, values, {"units": units, "long_name": meaning})
            for name, (dims, values, units, meaning) in quantities.items()
        },
        coords={
            "time": ("time", kept.time, {"units": "s", "long_name": "time", "axis": "T"}),
            "axis": ("axis", list(axes), {"long_name": "x forward, z up"}),
            "channel": ("channel", list(CHANNELS), {"long_name": "base channel"}),
            "kind": ("kind", [*ENERGIES, *WORKS], {"long_name": "kind of energy or work"}),
            "arc_length": (
                "node",
                np.asarray(rod.arc_length),
                {"units": "m", "long_name": "distance from the root along the arm at rest"},
            ),
            "diameter": (
                "node",
                np.asarray(rod.diameter),
                {"units": "m", "long_name": "diameter that the water sees"},
            ),
            "channel_unit": (
                "channel",
                ["m", "m", "rad"],
                {"long_name": "unit of base_command and base_pose"},
            ),
        },
    )
    dataset["flow_speed"].attrs["standard_name"] = "sea_water_speed"
    for name in ("base_command", "base_pose"):
        dataset[name].attrs["units"] = "m or rad"
        dataset[name].attrs["comment"] = "slide and heave in m, tilt in rad: see channel_unit"
    return dataset


def _curvature(scenario: Scenario, system: System, kept: Record, tangent: np.ndarray) -> np.ndarray:
    base = float(system.base.tilt) + kept.pose[:, 2]
    clamp = np.stack([np.cos(base), np.sin(base)], axis=1)[:, None]
    before = np.concatenate([clamp, tangent[:, :-1]], axis=1)
    turn = before[..., 0] * tangent[..., 1] - before[..., 1] * tangent[..., 0]
    bend = 2 * turn / (1 + np.sum(before * tangent, axis=2))
    inner = bend / np.asarray(system.rod.voronoi_length[:-1])
    if scenario.base.mount == "pinned":
        inner[:, 0] = np.asarray(system.rod.rest_curvature)[0]  # free of moment
    tip = 2 * inner[:, -1:] - inner[:, -2:-1]  # no window reaches round the tip: carry on
    return np.concatenate([inner, tip], axis=1)
