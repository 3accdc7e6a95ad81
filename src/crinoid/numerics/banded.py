"""Block-banded matrices of a chain of nodes.

Each node has ``b`` unknowns. An element on ``k <= 3`` consecutive nodes adds a ``(k, b, k, b)``
block to the matrix, which is therefore block pentadiagonal. It is stored as ``bands`` of shape
``(n, 5, b, b)``: ``bands[i, d]`` couples node ``i`` to node ``i + d - 2``; entries that point
outside the chain are ignored.

The solve pairs the nodes, which makes the matrix block tridiagonal, and eliminates block rows from
both ends toward the middle in parallel (block LU, Golub and Van Loan, Matrix Computations, 4th ed.,
section 4.5; from two ends: Babuska 1972). The work grows with ``n``. Cyclic reduction would need
fewer dependent operations, but it unrolls into a program that grows with the logarithm of ``n``;
this one is two short loops for any ``n``.
"""

import functools
from collections.abc import Iterable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.numerics.index_array import place_at
from crinoid.numerics.small_matrices import product

Bands = Float[Array, "n 5 b b"]
Blocks = Float[Array, "n m m"]
Vectors = Float[Array, "n b"]


def assemble(
    blocks: Iterable[tuple[int, Float[Array, "_ _ _ _ _"]]], num_nodes: int, size: int
) -> Bands:
    """Add up the blocks of windows that start at the given nodes, on the first unknowns of each."""
    placed = []
    for first, block in blocks:
        stencil = block.shape[1]
        if stencil > 3:
            raise ValueError(f"A window must span at most 3 nodes, got {stencil}.")
        by_row = block.transpose(1, 0, 3, 2, 4)
        shape = (num_nodes, 5, size, size)
        placed += [place_at((first + i, 2 - i, 0, 0), by_row[i], shape) for i in range(stencil)]
    return functools.reduce(jnp.add, placed)


def matvec(bands: Bands, nodes: Float[Array, "n b *columns"]) -> Float[Array, "n b *columns"]:
    """Multiply the banded matrix by a vector on the nodes, or by several columns of them."""
    num_nodes = bands.shape[0]
    padded = jnp.pad(nodes, [(2, 2)] + [(0, 0)] * (nodes.ndim - 1))
    return sum(
        (jnp.einsum("nij,nj...->ni...", bands[:, d], padded[d : d + num_nodes]) for d in range(5)),
        start=jnp.zeros_like(nodes),
    )


def dense(bands: Bands) -> Float[Array, "n b n b"]:
    """Return the whole matrix."""
    num_nodes, _, size, _ = bands.shape
    node = jnp.arange(num_nodes)[:, None]
    whole = jnp.zeros((num_nodes, size, num_nodes + 4, size))
    return whole.at[node, :, node + jnp.arange(5)].set(bands)[:, :, 2:-2]


def places(num_nodes: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column of each entry of bands in the whole matrix, some outside of it."""
    node, offset, i, j = np.indices((num_nodes, 5, size, size))
    return node * size + i, (node + offset - 2) * size + j


def transpose(bands: Bands) -> Bands:
    """Return the bands of the transposed matrix."""
    num_nodes = bands.shape[0]
    padded = jnp.pad(bands, ((2, 2), (0, 0), (0, 0), (0, 0)))
    rows = [padded[d : d + num_nodes, 4 - d].swapaxes(-1, -2) for d in range(5)]
    return jnp.stack(rows, axis=1)


class Factors(NamedTuple):
    """Factors of a banded matrix, from both ends toward the middle.

    With ``L``, ``D`` and ``U`` the blocks of a row that multiply the row behind, the row itself and
    the row ahead: ``x = inverse (rhs - L x_behind) - C x_ahead``.
    """

    inverse: Float[Array, "half 2 m m"]
    """``(D - L C_behind)^-1``, of rows from the root and from the tip."""
    behind: Float[Array, "half 2 m m"]
    """``L``, the blocks of the row behind."""
    ahead: Float[Array, "half 2 m m"]
    """``C = inverse U``"""
    meeting: Float[Array, "m m"]  # inverse of the Schur complement where both ends meet


@jax.jit
def solve(bands: Bands, rhs: Float[Array, "n b *columns"]) -> Float[Array, "n b *columns"]:
    """Solve the banded system for one or several columns; differentiable in both modes.

    Blocks are inverted without pivoting between the unknowns of different nodes, which is safe
    for the matrices of an arm near a stable state. A singular matrix gives infinities or NaN: check
    the residual.
    """
    return jax.lax.custom_linear_solve(
        lambda nodes: matvec(bands, nodes),
        rhs,
        solve=lambda _, b: substitute(factorise(bands), b),
        transpose_solve=lambda _, b: substitute(factorise(transpose(bands)), b),
    )


def factorise(bands: Bands) -> Factors:
    """Eliminate the blocks of a banded matrix, for any number of right-hand sides.

    A singular matrix gives infinities or NaN, as in `solve`.
    """
    num_nodes, _, size, _ = bands.shape
    # uncoupled nodes behind the tip, up to an even number of pairs
    missing = -num_nodes % 4
    padding = jnp.zeros((missing, 5, size, size)).at[:, 2].set(jnp.eye(size))
    pairs = jnp.concatenate([_within(bands), padding]).reshape(-1, 2, 5, size, size)
    outside = jnp.zeros_like(pairs[:, 0, 0])

    def coupling(offset: int) -> Blocks:
        def block(row: int, column: int) -> Blocks:
            # node `row` of a pair and node `column` of the pair `offset` further on
            d = 2 * offset + column - row
            return pairs[:, row, d + 2] if abs(d) <= 2 else outside

        return _joined([[block(row, column) for column in (0, 1)] for row in (0, 1)])

    lower, main, upper = coupling(-1), coupling(0), coupling(1)
    rows = (_ends(lower, upper), _ends(main, main), _ends(upper, lower))

    def forward(before: Array, row: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
        behind, here, ahead = row
        inverse = _inverse(here - product(behind, before))
        across = product(inverse, ahead)
        return across, (inverse, across)

    last, (inverse, coupled) = jax.lax.scan(forward, jnp.zeros((2, 2 * size, 2 * size)), rows)
    meeting = _inverse(jnp.eye(2 * size) - product(last[0], last[1]))
    return Factors(inverse, rows[0], coupled, meeting)


def substitute(factors: Factors, rhs: Float[Array, "n b *columns"]) -> Float[Array, "n b *columns"]:
    """Return the solution of a factorised system for one or several columns."""
    num_nodes, size = rhs.shape[:2]
    missing = -num_nodes % 4
    rows = jnp.pad(rhs.reshape(num_nodes, size, -1), ((0, missing), (0, 0), (0, 0)))
    rows = rows.reshape(-1, 2 * size, rows.shape[-1])

    def forward(before: Array, row: tuple[Array, ...]) -> tuple[Array, Array]:
        known, inverse, behind = row
        here = product(inverse, known - product(behind, before))
        return here, here

    def backward(further: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        known, ahead = row
        here = known - product(ahead, further)
        return here, here

    known = _ends(rows, rows)
    last, reduced = jax.lax.scan(
        forward, jnp.zeros_like(known[0]), (known, factors.inverse, factors.behind)
    )
    coupling = factors.ahead[-1]
    near = product(factors.meeting, last[0] - product(coupling[0], last[1]))
    far = last[1] - product(coupling[1], near)
    _, halves = jax.lax.scan(
        backward, jnp.stack([far, near]), (reduced, factors.ahead), reverse=True
    )
    solution = jnp.concatenate([halves[:, 0], halves[::-1, 1]])
    return solution.reshape(-1, size, rows.shape[-1])[:num_nodes].reshape(rhs.shape)


def blank(num_nodes: int, size: int) -> Factors:
    """Return factors of zeros."""
    m = 2 * size
    half = (num_nodes + -num_nodes % 4) // 4
    none = jnp.zeros((half, 2, m, m))
    return Factors(none, none, none, none[0, 0])


def with_first_rows(first: Float[Array, "m b"], nodes: Vectors) -> Vectors:
    """Return ``nodes`` with the first rows replaced."""
    return jnp.concatenate([first, nodes[first.shape[0] :]])


def pad_columns(rows: Float[Array, "n _"], width: int) -> Vectors:
    """Pad rows with columns of zeros up to a width."""
    return place_at((0, 0), rows, (rows.shape[0], width))


def _within(bands: Bands) -> Bands:
    """Clear the entries that point outside the chain."""
    node = jnp.arange(bands.shape[0])[:, None] + jnp.arange(-2, 3)
    inside = (node >= 0) & (node < bands.shape[0])
    return jnp.where(inside[..., None, None], bands, 0.0)


def _ends(from_root: Array, from_tip: Array) -> Array:
    """Return rows in the order from both ends toward the middle."""
    half = from_root.shape[0] // 2
    return jnp.stack([from_root[:half], from_tip[half:][::-1]], axis=1)


def _inverse(block: Float[Array, "... m m"]) -> Float[Array, "... m m"]:
    """Invert small blocks by halves (Schur complement), which vectorises over all of them."""
    size = block.shape[-1]
    if size == 1:
        return 1.0 / block
    if size == 2:
        adjugate = block[..., ::-1, ::-1].swapaxes(-1, -2) * np.array([[1.0, -1.0], [-1.0, 1.0]])
        return adjugate / jnp.sum(block[..., 0, :] * adjugate[..., 0], axis=-1)[..., None, None]
    half = size // 2
    a, b = block[..., :half, :half], block[..., :half, half:]
    c, d = block[..., half:, :half], block[..., half:, half:]
    a_inverse = _inverse(a)
    a_b = product(a_inverse, b)
    c_a = product(c, a_inverse)
    schur = _inverse(d - product(c, a_b))
    corner = product(a_b, schur)
    return _joined([[a_inverse + product(corner, c_a), -corner], [-product(schur, c_a), schur]])


def _joined(blocks: list[list[Array]]) -> Array:
    """Return matrices from their blocks; unlike `jnp.block`, without a call inside of loops."""
    return jnp.concatenate([jnp.concatenate(row, axis=-1) for row in blocks], axis=-2)
