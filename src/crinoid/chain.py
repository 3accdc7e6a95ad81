"""Block-banded algebra of a chain: what couples near neighbours, and nothing else.

Nodes stand in a row; each carries ``b`` unknowns. Whatever acts on ``k <= 3`` consecutive nodes
adds a ``(k, b, k, b)`` block to the matrix, which is therefore block pentadiagonal. It is kept as
``bands`` of shape ``(n, 5, b, b)``: ``bands[i, d]`` couples node ``i`` to node ``i + d - 2``;
entries that point outside the chain have no meaning and are ignored.

The solve pairs the nodes, which makes the matrix block tridiagonal, and eliminates block rows
from both ends toward the middle at the same time (block LU, Golub and Van Loan, Matrix
Computations, 4th ed., section 4.5; from two ends: Babuska 1972). The work grows with ``n``.
Cyclic reduction would need fewer dependent operations; it unrolls into a program that grows with
the logarithm of ``n``, where this one is two short loops whatever ``n`` is.
"""

from collections.abc import Iterable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.products import product

Bands = Float[Array, "n 5 b b"]
Blocks = Float[Array, "n m m"]
Vectors = Float[Array, "n b"]


def gather(nodes: Float[Array, "n ..."], first: int, count: int, stencil: int) -> Array:
    """Return the ``(count, stencil, ...)`` windows of ``nodes`` that start at ``first``."""
    return jnp.stack([nodes[first + i : first + i + count] for i in range(stencil)], axis=1)


def scatter(windows: Float[Array, "count k b"], first: int, num_nodes: int) -> Vectors:
    """Add windows back onto the nodes: the transpose of `gather`."""
    _, stencil, size = windows.shape
    return sum(
        (_place(windows[:, i], first + i, num_nodes) for i in range(stencil)),
        start=jnp.zeros((num_nodes, size), windows.dtype),
    )


def assemble(blocks: Iterable[tuple[int, Float[Array, "_ _ b _ b"]]], num_nodes: int) -> Bands:
    """Add up the blocks of windows that start at the given nodes."""
    diagonals: list[Array | None] = [None] * 5
    for first, block in blocks:
        stencil, size = block.shape[1:3]
        if stencil > 3:
            raise ValueError(f"a window spans at most 3 nodes, got {stencil}")
        for i in range(stencil):
            for j in range(stencil):
                placed = _place(block[:, i, :, j], first + i, num_nodes)
                held = diagonals[j - i + 2]
                diagonals[j - i + 2] = placed if held is None else held + placed
    empty = jnp.zeros((num_nodes, size, size))
    return jnp.stack([empty if d is None else d for d in diagonals], axis=1)


def matvec(bands: Bands, nodes: Float[Array, "n b *columns"]) -> Float[Array, "n b *columns"]:
    """Multiply the banded matrix by a vector on the nodes, or by several columns of them."""
    num_nodes = bands.shape[0]
    padded = jnp.pad(nodes, [(2, 2)] + [(0, 0)] * (nodes.ndim - 1))
    return sum(
        (jnp.einsum("nij,nj...->ni...", bands[:, d], padded[d : d + num_nodes]) for d in range(5)),
        start=jnp.zeros_like(nodes),
    )


def transpose(bands: Bands) -> Bands:
    """Return the bands of the transposed matrix."""
    num_nodes = bands.shape[0]
    padded = jnp.pad(bands, ((2, 2), (0, 0), (0, 0), (0, 0)))
    rows = [padded[d : d + num_nodes, 4 - d].swapaxes(-1, -2) for d in range(5)]
    return jnp.stack(rows, axis=1)


@jax.jit
def solve(bands: Bands, rhs: Float[Array, "n b *columns"]) -> Float[Array, "n b *columns"]:
    """Solve the banded system for one or several columns; differentiable in both modes.

    Blocks are inverted without pivoting between the unknowns of different nodes, which is safe
    for the matrices of an arm near a stable state. A singular matrix gives infinities or NaN:
    the caller judges the answer by its residual.
    """
    return jax.lax.custom_linear_solve(
        lambda nodes: matvec(bands, nodes),
        rhs,
        solve=lambda _, b: _solve(bands, b),
        transpose_solve=lambda _, b: _solve(transpose(bands), b),
    )


def begun_with(first: Float[Array, "m b"], nodes: Vectors) -> Vectors:
    """Return ``nodes`` with others in the place of the first ones."""
    return jnp.concatenate([first, nodes[first.shape[0] :]])


def widened(rows: Float[Array, "n _"], width: int) -> Vectors:
    """Return rows with zeros behind them, up to a width."""
    return jnp.pad(rows, ((0, 0), (0, width - rows.shape[1])))


def _within(bands: Bands) -> Bands:
    """Clear the entries that point outside the chain."""
    node = jnp.arange(bands.shape[0])[:, None] + jnp.arange(-2, 3)
    inside = (node >= 0) & (node < bands.shape[0])
    return jnp.where(inside[..., None, None], bands, 0.0)


def _place(rows: Array, first: int, num_nodes: int) -> Array:
    margins = [(first, num_nodes - first - rows.shape[0])] + [(0, 0)] * (rows.ndim - 1)
    return jnp.pad(rows, margins)


def _solve(bands: Bands, rhs: Float[Array, "n b *columns"]) -> Float[Array, "n b *columns"]:
    num_nodes, _, size, _ = bands.shape
    shape, rhs = rhs.shape, rhs.reshape(num_nodes, size, -1)
    # the tip is followed by nodes that nothing couples, up to an even number of pairs
    missing = -num_nodes % 4
    nobody = jnp.zeros((missing, 5, size, size)).at[:, 2].set(jnp.eye(size))
    bands = jnp.concatenate([_within(bands), nobody])
    rhs = jnp.pad(rhs, ((0, missing), (0, 0), (0, 0)))
    pairs = bands.reshape(-1, 2, 5, size, size)
    outside = jnp.zeros_like(pairs[:, 0, 0])

    def coupling(offset: int) -> Blocks:
        # node `row` of a pair meets node `column` of the pair `offset` further on
        return jnp.concatenate(
            [
                jnp.concatenate(
                    [
                        pairs[:, row, d + 2] if abs(d) <= 2 else outside
                        for column in (0, 1)
                        for d in [2 * offset + column - row]
                    ],
                    axis=-1,
                )
                for row in (0, 1)
            ],
            axis=-2,
        )

    columns = rhs.reshape(-1, 2 * size, rhs.shape[-1])
    solution = _eliminate(coupling(-1), coupling(0), coupling(1), columns)
    return solution.reshape(-1, size, rhs.shape[-1])[:num_nodes].reshape(shape)


def _eliminate(
    lower: Blocks, main: Blocks, upper: Blocks, rhs: Float[Array, "n m c"]
) -> Float[Array, "n m c"]:
    """Solve a block tridiagonal system of an even number of rows from both its ends at once."""
    half = main.shape[0] // 2
    size = main.shape[-1]

    def ends(from_root: Array, from_tip: Array) -> Array:
        return jnp.stack([from_root[:half], from_tip[half:][::-1]], axis=1)

    def forward(before: Array, row: tuple[Array, ...]) -> tuple[Array, Array]:
        behind, here, ahead, known = row
        # x_here = reduced[..., size:] - reduced[..., :size] x_ahead
        inflow = product(behind, before)
        reduced = product(
            _inverse(here - inflow[..., :size]),
            jnp.concatenate([ahead, known - inflow[..., size:]], axis=-1),
        )
        return reduced, reduced

    def backward(ahead: Array, reduced: Array) -> tuple[Array, Array]:
        here = reduced[..., size:] - product(reduced[..., :size], ahead)
        return here, here

    last, reduced = jax.lax.scan(
        forward,
        jnp.zeros((2, size, size + rhs.shape[-1])),
        (ends(lower, upper), ends(main, main), ends(upper, lower), ends(rhs, rhs)),
    )
    coupling, known = last[..., :size], last[..., size:]
    meeting = _inverse(jnp.eye(size) - product(coupling[0], coupling[1]))
    near = product(meeting, known[0] - product(coupling[0], known[1]))
    far = known[1] - product(coupling[1], near)
    _, halves = jax.lax.scan(backward, jnp.stack([far, near]), reduced, reverse=True)
    return jnp.concatenate([halves[:, 0], halves[::-1, 1]])


def _inverse(block: Float[Array, "... m m"]) -> Float[Array, "... m m"]:
    """Invert small blocks by halves (Schur complement), which vectorises over all of them."""
    size = block.shape[-1]
    if size == 1:
        return 1.0 / block
    half = size // 2
    a, b = block[..., :half, :half], block[..., :half, half:]
    c, d = block[..., half:, :half], block[..., half:, half:]
    a_inverse = _inverse(a)
    a_b = product(a_inverse, b)
    c_a = product(c, a_inverse)
    schur = _inverse(d - product(c, a_b))
    corner = product(a_b, schur)
    return jnp.concatenate(
        [
            jnp.concatenate([a_inverse + product(corner, c_a), -corner], axis=-1),
            jnp.concatenate([-product(schur, c_a), schur], axis=-1),
        ],
        axis=-2,
    )
