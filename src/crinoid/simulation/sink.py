"""Instants of a run on their way into a result: in memory, or in a file that grows meanwhile."""

import math
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import jax
import numpy as np
import xarray as xr

from crinoid.elements import ENERGIES, WORKS
from crinoid.foundation.axes import AXES, CHANNELS
from crinoid.foundation.result_variables import numbers, of_dimension
from crinoid.results.chunks import join, pieces
from crinoid.results.record import Record
from crinoid.results.result import RESULT, UNCONTROLLED, UNFINISHED, Result, ResultError
from crinoid.results.result_file import attributes, named_leaves
from crinoid.results.stream import Stream
from crinoid.scenario import Scenario, counted, refusal
from crinoid.simulation.loop import LoopState

__all__ = ["Sink", "require_space", "runs_in_memory"]

_MAX_BYTES = 8e9
_AT_THE_END = 2.7  # copies of a number in memory while a result is assembled, as measured


def require_space(scenario: Scenario, into: Path | None) -> None:
    """Refuse a run that keeps more than memory, or the disk that it is written to, can take."""
    nodes, runs = scenario.arm.nodes, 1 + scenario.control.compared
    instants = scenario.simulation.steps // scenario.output_steps + 1
    whole = _bytes(scenario, large=True)
    # of a run on the disk, memory contains only variables with one number an instant
    held = whole if into is None else _bytes(scenario, large=False)
    _refuse(instants, nodes, held * (_AT_THE_END + runs - 1), _MAX_BYTES, "of memory")
    if into is not None:
        folder = next(each for each in (into, *into.resolve().parents) if each.is_dir())
        free = shutil.disk_usage(folder).free
        _refuse(instants, nodes, whole * runs, float(free), f"on the disk of {folder}")


def runs_in_memory(scenario: Scenario) -> int:
    """Return the number of runs of a scenario whose saved instants fit into 8 GB, at least one."""
    runs = 1 + scenario.control.compared
    return max(1, int(_MAX_BYTES / (runs * _bytes(scenario, large=True))))


def _bytes(scenario: Scenario, *, large: bool) -> float:
    """Return the size of the saved instants of a run, with large variables or without."""
    dimension, nodes = scenario.arm.dimension, scenario.arm.nodes
    sizes = {
        "node": nodes,
        "edge": nodes - 1,
        "axis": len(AXES[dimension]),
        "bending": 2,
        "channel": len(CHANNELS[dimension]),
        "kind": len(ENERGIES) + len(WORKS),
        "obstacle": len(scenario.obstacle),
    }
    parts: dict[str, object] = {
        "obstacles": scenario.obstacle,
        "bodies": any(obstacle.free for obstacle in scenario.obstacle),
        "tool": scenario.tool,
        "vortices": scenario.water.vortices,
        "self": scenario.contact.self_,
        "hull": scenario.hull,
        "estimate": scenario.control.settings.observes,
    }
    without = [name for name, found in parts.items() if not found]
    there = of_dimension(dimension, without=without).values()
    kept = [variable for variable in there if large or not variable.large]
    instants = scenario.simulation.steps // scenario.output_steps + 1
    return 8.0 * instants * numbers(kept, sizes)


def _refuse(instants: int, nodes: int, size: float, most: float, where: str) -> None:
    if size > most:
        text = f"keeps {instants} instants of {nodes} nodes, which need about {size / 1e9:.3g} GB "
        text += f"{where}; must fit into {most / 1e9:.3g} GB. Raise it."
        raise refusal("output.interval", text)


_SAME = 1e-9  # difference, of the largest number of its kind, that is round-off


def resume_state(
    earlier: Result, start: LoopState, first: xr.Dataset, stride: int
) -> tuple[LoopState, xr.Dataset]:
    """Return the state in which an earlier result ended, and its instants up to there.

    ``first`` has what there is to be at each instant, ``stride`` time steps apart.
    """
    carry, kept = earlier.restore(start), earlier.dataset
    _check_variables(kept, first)
    for name, leaf in earlier.checkpoint.items():
        if leaf.dtype.kind == "f" and np.isnan(leaf).any():
            raise ResultError(f"its state cannot be gone on from: {name} is not a number")
    instants = 1 + int(carry.steps) // stride
    cut = earlier.status == UNFINISHED
    if cut:  # the file may be ahead of its checkpoint
        kept = kept.isel(time=slice(instants))
    if not (cut and int(carry.tally.steps)):  # else the state is later than any instant
        _check_last(kept, carry)
    _check_steps(kept, carry, stride, cut=cut)
    # if it stopped between two instants that are kept, its last one is not among them
    return carry, kept.isel(time=slice(instants))


def _check_variables(kept: xr.Dataset, first: xr.Dataset) -> None:
    sizes = dict(first.sizes) | {"time": kept.sizes["time"]}
    for name, wanted in first.variables.items():
        found = kept.variables.get(name)
        if found is None:
            raise ResultError(f"it has no {name}, which output.variables may have left out")
        shape = tuple(sizes[dim] for dim in wanted.dims)
        if (found.dims, found.shape) != (wanted.dims, shape):
            raise ResultError(f"its {name} has the shape {found.shape}, not {shape}")
        kinds = {found.dtype.kind, wanted.dtype.kind}
        if len(kinds) > 1 and not kinds <= set("OUT"):
            raise ResultError(f"its {name} is of {found.dtype}, not {wanted.dtype}")
    time, wall_time = kept["time"].values, float(kept.attrs["wall_time"])
    if not np.isfinite(time).all() or (np.diff(time) <= 0).any() or time[0] != 0:
        raise ResultError("its time does not increase from 0 on")
    if not math.isfinite(wall_time) or wall_time < 0:
        raise ResultError(f"its wall_time is {wall_time}")


def _check_last(kept: xr.Dataset, carry: LoopState) -> None:
    """Refuse a state that is not that of the last instant."""
    state = carry.state
    saved = {
        "time": state.time,
        "velocity": state.velocity[1:],
        "acceleration": state.acceleration[1:],
        "base_command": carry.command[: kept.sizes["channel"]],
    }
    if "actuator_command" in kept:
        saved["actuator_command"] = carry.command[kept.sizes["channel"] :]
    last = {name: kept[name].values[-1] for name in [*saved, "position"]}
    last["work"] = kept["energy"].sel(kind=list(WORKS)).values[-1]
    scales = {name: float(np.abs(value).max(initial=0.0)) for name, value in last.items()}
    assert carry.books is not None
    saved["work"] = carry.books.work
    # nodes are kept from the world's origin, and stepped from the base's
    saved["position"] = np.diff(state.position[1:], axis=0)
    last["position"] = np.diff(last["position"], axis=0)
    for name, leaf in saved.items():
        if not np.allclose(leaf, last[name], rtol=0, atol=_SAME * scales[name]):
            raise ResultError(f"its state is not that of its last instant: {name} is another")


def _check_steps(kept: xr.Dataset, carry: LoopState, stride: int, *, cut: bool) -> None:
    """Refuse counts that do not go with each other."""
    steps, since = int(carry.steps), int(carry.tally.steps)
    whole, left = divmod(steps, stride)
    instants = 1 + whole + (since > 0 and not cut)
    if steps < 0 or since < left or kept.sizes["time"] != instants:
        after = f"{counted(steps, 'time step')}, {since} of them since the last kept instant"
        held = counted(kept.sizes["time"], "instant")
        raise ResultError(f"it has {held} and a state after {after}, which do not match")


_EVERY = 4.0  # seconds of computing after which a file is brought up to date
_MOST_HELD = 6_000_000
"""Bytes of instants after which they are put into the file already, not to count before that."""
_LOOSE = 64
"""Records that are put into one, as many small arrays need more memory than their numbers."""

Build = Callable[[Record, float | None], xr.Dataset]
"""From instants, and the angle of the tip just before them (rad), to their data."""


class Sink:
    """Sink of the instants of a run, of which ``build`` makes data.

    ``path`` is the file that is to grow, none to hold all in memory. It is written once the run has
    lasted for some seconds.
    """

    def __init__(self, first: Record, build: Build, path: Path | None) -> None:
        self._path = path
        self._build = build
        self._records, self._held, self._loose = [first], 0, 0
        self._kept: xr.Dataset | None = None
        self._stream: Stream | None = None
        self._angle: float | None = None
        self._written = 0.0
        """Wall time of the run when the file was last brought up to date (s)."""

    def resume(self, earlier: Result, start: LoopState, stride: int) -> tuple[LoopState, float]:
        """Begin with what an earlier run kept, the first instant included (`resume_state`).

        Returns the state in which it ended, and its wall time (s).
        """
        first = self._take()
        carry, kept = resume_state(earlier, start, first, stride)
        self._written = wall_time = earlier.dataset.attrs["wall_time"]
        self._angle = float(kept["tip_angle"][-1])
        if self._path is None:
            self._kept = kept
        else:
            names = [str(name) for name, data in first.data_vars.items() if "time" in data.dims]
            more = pieces(kept.isel(time=slice(1, None)), names)
            self._stream = Stream(self._path, first, more, named_leaves(carry), wall_time)
        return carry, wall_time

    def append(self, record: Record) -> None:
        """Take some more instants, if there are any."""
        if record.time.size:
            self._records.append(record)
            self._loose += 1
            if self._loose == _LOOSE:
                self._records[-_LOOSE:], self._loose = [_whole(self._records[-_LOOSE:])], 0
            self._held += sum(leaf.nbytes for leaf in jax.tree.leaves(record))

    def look(self, carry: LoopState, wall_time: float) -> None:
        """Bring the file up to date if it is time to: instants, and a checkpoint."""
        due = wall_time - self._written > _EVERY
        if self._path is not None and (due or self._held > _MOST_HELD):
            self._write(self._path, carry, wall_time, due)

    def close(self, carry: LoopState, wall_time: float) -> xr.Dataset:
        """Return all instants, with the file up to date if there is one; more may follow."""
        if self._path is not None and self._stream is not None:
            self._write(self._path, carry, wall_time, True)
            return self._stream.dataset()
        parts = [] if self._kept is None else [self._kept]
        if self._records:
            parts.append(self._take())
        self._kept = join(parts)
        return self._kept

    def _write(self, path: Path, carry: LoopState, wall_time: float, due: bool) -> None:
        piece = self._take() if self._records else None
        if self._stream is not None:
            if piece is not None:
                self._stream.append(piece)
            if due:
                self._stream.keep(named_leaves(carry), wall_time)
                self._written = wall_time
        elif piece is not None:
            if path.name == RESULT and attributes(path.with_name(UNCONTROLLED)):
                path.with_name(UNCONTROLLED).unlink()  # that of an earlier run
            first, more = piece.isel(time=slice(0, 1)), piece.isel(time=slice(1, None))
            self._stream = Stream(path, first, [more], named_leaves(carry), wall_time)
            self._written = wall_time

    def _take(self) -> xr.Dataset:
        """Return the data of the instants that are held, and hold them no more."""
        whole = _whole(self._records)
        self._records.clear()  # a long run fills the memory
        self._held = self._loose = 0
        data = self._build(whole, self._angle)
        self._angle = float(data["tip_angle"][-1])
        return data


def _whole(records: Sequence[Record]) -> Record:
    return jax.tree.map(lambda *parts: np.concatenate(parts), *records)
