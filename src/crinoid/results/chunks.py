"""Processing of a result in pieces of time, to bound the memory."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

_NUMBERS = 1 << 15  # nodes times instants of a piece: a few megabytes of vectors


def piece_length(dataset: xr.Dataset) -> int:
    """Return how many instants a piece has: by the number of nodes alone, as sums depend on it."""
    return max(1, _NUMBERS // max(1, dataset.sizes.get("node", 1)))


def pieces(
    dataset: xr.Dataset, names: Iterable[str], *, overlap: bool = False
) -> Iterator[xr.Dataset]:
    """Yield some variables of a run, which may lie in a file, in pieces of time, in memory.

    With ``overlap`` each piece but the first begins with the last instant of the one before.
    """
    part, length = dataset[list(names)], piece_length(dataset)
    if dataset.sizes["time"] <= length:  # cutting is slower than most uses of a piece
        yield part.load()
        return
    for start in range(0, dataset.sizes["time"], length):
        begin = start - 1 if overlap and start else start
        yield part.isel(time=slice(begin, start + length)).load()


def chosen_pieces(
    dataset: xr.Dataset, names: Iterable[str], records: Int[np.ndarray, " chosen"]
) -> Iterator[xr.Dataset]:
    """Yield instants of a run by their rising numbers, one piece after the other."""
    first = 0
    for piece in pieces(dataset, names):
        last = first + piece.sizes["time"]
        here = records[(records >= first) & (records < last)] - first
        if here.size:
            yield piece.isel(time=here)
        first = last


def unwrap_from(angle: Float[np.ndarray, " time"], before: float | None) -> np.ndarray:
    """Return angles (rad) without jumps of whole turns, from the one before on.

    Turns are counted, not summed up: so it does not matter to the bit where a run is cut.
    """
    start = angle[:1] if before is None else np.array([before])
    turns = np.cumsum(np.round(np.diff(angle, prepend=start) / (2 * np.pi)))
    return angle - 2 * np.pi * turns


def join(parts: Sequence[xr.Dataset]) -> xr.Dataset:
    """Concatenate the parts of one run, without the variables that only the first one has."""
    if len(parts) == 1:
        return parts[0]
    parts = [part[list(parts[-1].data_vars)] for part in parts]
    return xr.concat(parts, "time", data_vars="minimal", coords="minimal", compat="override")
