"""Windows of rows by an index array: gather them, and add vectors and blocks to their rows.

The last axis of an index array has the ``k`` rows of a window. The axes before are the grid of the
windows ``w``, one or two (edges by obstacles). On two, each column changes along one of them.

Rows that follow on each other are slices, which XLA fuses with other operations. An index that is
known at run time only, or has many pieces, needs a slow loop.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

Index = Int[np.ndarray, "*grid k"] | Int[Array, "w k"]

_MOST_PIECES = 4  # largest number of slices in place of a loop


def gather(rows: Float[Array, "n ..."], index: Index) -> Float[Array, "w k ..."]:
    """Return the windows of rows."""

    def column(place: int) -> Array:
        axis, along = _line(index[..., place])
        pieces = _pieces(along)
        found = jnp.concatenate([rows[piece] for piece in pieces]) if pieces else rows[along]
        if index.ndim == 2:
            return found
        found, inner = jnp.expand_dims(found, 1 - axis), found.shape[1:]
        return jnp.broadcast_to(found, (*index.shape[:-1], *inner)).reshape(-1, *inner)

    return jnp.stack([column(place) for place in range(index.shape[-1])], axis=1)


def scatter(windows: Float[Array, "w k ..."], index: Index, count: int) -> Float[Array, "n ..."]:
    """Add windows to ``count`` rows: the transpose of `gather`."""

    def column(place: int) -> Array:
        values, inner = windows[:, place], windows.shape[2:]
        axis, along = _line(index[..., place])
        if index.ndim > 2:
            values = jnp.sum(values.reshape(*index.shape[:-1], *inner), axis=1 - axis)
        pieces = _pieces(along)
        if not pieces:
            return jnp.zeros((count, *inner)).at[along].add(values)
        ends = np.cumsum([piece.stop - piece.start for piece in pieces])
        parts = jnp.split(values, ends[:-1])
        firsts = [piece.start for piece in pieces]
        placed = (place_at((n,), x, (count,)) for n, x in zip(firsts, parts, strict=True))
        return functools.reduce(jnp.add, placed)

    return functools.reduce(jnp.add, map(column, range(index.shape[-1])))


def scatter_blocks(
    blocks: Float[Array, "w k b l b"], rows: Index, columns: Index, shape: tuple[int, int]
) -> Float[Array, "n b m b"]:
    """Add the blocks of windows to a matrix, of rows by columns.

    On a grid of two axes all rows change along one of them, and all columns.
    """
    size = blocks.shape[2]
    if rows.ndim > 2:
        # of each index only its axis of the grid
        axes = [_axis(index) for index in (rows, columns)]
        blocks = blocks.reshape(*rows.shape[:-1], *blocks.shape[1:])
        rows, columns = (
            np.moveaxis(np.asarray(index), axis, 0)[:, 0]
            for index, axis in zip((rows, columns), axes, strict=True)
        )
        if axes[0] != axes[1]:
            by_row = scatter(jnp.moveaxis(blocks, (axes[0], 2, 3), (0, 1, 2)), rows, shape[0])
            by_both = scatter(jnp.moveaxis(by_row, (2, 3), (0, 1)), columns, shape[1])
            return jnp.moveaxis(by_both, 0, 2)
        blocks = jnp.sum(blocks, axis=1 - axes[0])
    none = jnp.zeros((shape[0], size, shape[1], size))
    pairs = rows[:, :, None], columns[:, None, :]
    return none.at[pairs[0], :, pairs[1]].add(jnp.moveaxis(blocks, 3, 2))


def place_at(first: tuple[int, ...], part: Array, shape: tuple[int, ...]) -> Array:
    """Return an array of zeros with a part that starts at ``first`` along the leading axes."""
    leading = zip(first, shape, part.shape, strict=False)
    margins = [(start, whole - start - size, 0) for start, whole, size in leading]
    margins += [(0, 0, 0)] * (part.ndim - len(margins))
    return jax.lax.pad(part, np.zeros((), part.dtype), margins)


def _line(index: Int[np.ndarray, "*grid"] | Int[Array, " w"]) -> tuple[int, np.ndarray | Array]:
    """Return the axis of the grid along which an index changes, and the index there."""
    if index.ndim == 1:
        return 0, index
    axis = 0 if (index == index[:, :1]).all() else 1
    assert axis == 0 or (index == index[:1]).all()
    return axis, np.moveaxis(np.asarray(index), axis, 0)[:, 0]


def _axis(index: Index) -> int:
    """Return the axis of the grid along which all columns of an index array change."""
    (axis,) = {_line(index[..., place])[0] for place in range(index.shape[-1])}
    return axis


def _pieces(index: Int[np.ndarray, " w"] | Int[Array, " w"]) -> list[slice]:
    """Return an index as slices; none where a loop serves better."""
    if not isinstance(index, np.ndarray):
        return []
    parts = np.split(index, np.flatnonzero(np.diff(index) != 1) + 1)
    if index.size == 0 or index.min() < 0 or len(parts) > _MOST_PIECES:
        return []
    return [slice(int(part[0]), int(part[-1]) + 1) for part in parts]
