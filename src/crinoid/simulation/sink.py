"""Instants of a run on their way into a result: in memory, or in a file that grows meanwhile."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr

from crinoid.pieces import join, pieces
from crinoid.record import Record
from crinoid.result import RESULT, UNCONTROLLED, attributes, named_leaves
from crinoid.simulation.loop import LoopState
from crinoid.stream import Stream

__all__ = ["Sink"]

_EVERY = 4.0
"""Seconds of computing after which a file is brought up to date."""
_MOST_HELD = 6_000_000
"""Bytes of instants after which they are put into the file already, not to count before that."""

Build = Callable[[Record, float | None], xr.Dataset]
"""From instants, and the angle of the tip just before them (rad), to their data."""


class Sink:
    """Takes the instants of a run.

    Parameters
    ----------
    first
        The first instant.
    build
        What makes data of instants.
    path
        The file that is to grow, none to hold all in memory. It is written once the run has lasted
        for some seconds.
    attributes
        Attributes of that file.
    """

    def __init__(
        self, first: Record, build: Build, path: Path | None, attributes: dict[str, Any]
    ) -> None:
        self._build, self._path, self._attributes = build, path, attributes
        self._records, self._held = [first], 0
        self._kept: xr.Dataset | None = None
        self._stream: Stream | None = None
        self._angle: float | None = None
        self._written = 0.0
        """Wall time of the run when the file was last brought up to date (s)."""

    def go_on(self, kept: xr.Dataset, carry: LoopState, wall_time: float) -> None:
        """Begin with what an earlier run kept, the first instant included, up to a state."""
        first, self._written = self._take(), wall_time
        self._angle = float(kept["tip_angle"][-1])
        if self._path is None:
            self._kept = kept
            return
        names = [str(name) for name, data in first.data_vars.items() if "time" in data.dims]
        more = pieces(kept.isel(time=slice(1, None)), names)
        self._stream = self._begun(self._path, first, more, carry, wall_time)

    def append(self, record: Record) -> None:
        """Take some more instants, if there are any."""
        if record.time.size:
            self._records.append(record)
            self._held += sum(leaf.nbytes for leaf in jax.tree.leaves(record))

    def look(self, carry: LoopState, wall_time: float) -> None:
        """Bring the file up to date if it is time to: instants, and a checkpoint."""
        due = wall_time - self._written > _EVERY
        if self._path is not None and (due or self._held > _MOST_HELD):
            self._write(self._path, carry, wall_time, due)

    def close(self, carry: LoopState, wall_time: float) -> xr.Dataset:
        """Return all instants, with the file up to date if there is one."""
        if self._path is not None and self._stream is not None:
            self._write(self._path, carry, wall_time, True)
            return self._stream.dataset()
        parts = [] if self._kept is None else [self._kept]
        if self._records:
            parts.append(self._take())
        return join(parts)

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
            self._stream = self._begun(path, first, [more], carry, wall_time)
            self._written = wall_time

    def _begun(
        self,
        path: Path,
        first: xr.Dataset,
        more: Iterable[xr.Dataset],
        carry: LoopState,
        wall_time: float,
    ) -> Stream:
        first = first.assign_attrs(self._attributes)
        return Stream(path, first, more, named_leaves(carry), wall_time)

    def _take(self) -> xr.Dataset:
        """Return the data of the instants that are held, and hold them no more."""
        whole = jax.tree.map(lambda *parts: np.concatenate(parts), *self._records)
        self._records.clear()  # a long run fills the memory
        self._held = 0
        data = self._build(whole, self._angle)
        self._angle = float(data["tip_angle"][-1])
        return data
