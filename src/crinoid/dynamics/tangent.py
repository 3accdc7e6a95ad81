"""The matrix of a Newton step: the chain of nodes, bordered by the bodies that it touches."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.products import product

HELD = 2
"""The ghost node and the root: their motion is prescribed, not solved for."""

Rows = Float[Array, "_ b"]


class Border(eqx.Module):
    """Blocks that couple ``f`` free bodies to the nodes and to themselves."""

    of_nodes: Float[Array, "n b f b"]
    """d(residual of the nodes) / d(correction of the bodies)."""
    of_bodies: Float[Array, "f b n b"]
    """d(residual of the bodies) / d(correction of the nodes)."""
    corner: Float[Array, "f b f b"]

    def transposed(self) -> "Border":
        """Return the border of the transposed matrix."""
        swapped = (self.of_bodies, self.of_nodes, self.corner)
        return Border(*(jnp.einsum("icjd->jdic", block) for block in swapped))


class Tangent(eqx.Module):
    """d(residual)/d(correction), with the rows of nodes and then obstacles.

    Of the obstacles only the free ones are solved for: rows ``free`` among them.
    """

    bands: chain.Bands
    border: Border | None
    free: tuple[int, ...] = eqx.field(static=True)

    def solve(self, rhs: Rows) -> Rows:
        """Solve for what is not prescribed; the other rows come back as zero."""
        num_nodes = self.bands.shape[0]
        bands, nodes = self.bands[HELD:], rhs[HELD:num_nodes]
        answer = jnp.zeros_like(rhs)
        if self.border is None:
            return answer.at[HELD:num_nodes].set(chain.solve(bands, nodes))
        rows = num_nodes + jnp.asarray(self.free)
        border = Border(
            self.border.of_nodes[HELD:], self.border.of_bodies[:, :, HELD:], self.border.corner
        )
        nodes, bodies = jax.lax.custom_linear_solve(
            lambda x: _matvec(bands, border, *x),
            (nodes, rhs[rows]),
            solve=lambda _, b: _eliminate(bands, border, *b),
            transpose_solve=lambda _, b: _eliminate(
                chain.transpose(bands), border.transposed(), *b
            ),
        )
        return answer.at[HELD:num_nodes].set(nodes).at[rows].set(bodies, unique_indices=True)

    def on_held(self, change: Rows) -> Float[Array, "held b"]:
        """Return how the forces on what is prescribed follow a change of the rest."""
        near = 2 * HELD  # as far as elements reach
        forces = chain.matvec(self.bands[:near], change[:near])[:HELD]
        if self.border is None:
            return forces
        bodies = change[self.bands.shape[0] + jnp.asarray(self.free)]
        return forces + jnp.einsum("icjd,jd->ic", self.border.of_nodes[:HELD], bodies)


def _matvec(bands: chain.Bands, border: Border, nodes: Rows, bodies: Rows) -> tuple[Rows, Rows]:
    return (
        chain.matvec(bands, nodes) + jnp.einsum("icjd,jd->ic", border.of_nodes, bodies),
        jnp.einsum("icjd,jd->ic", border.of_bodies, nodes)
        + jnp.einsum("icjd,jd->ic", border.corner, bodies),
    )


def _eliminate(bands: chain.Bands, border: Border, nodes: Rows, bodies: Rows) -> tuple[Rows, Rows]:
    """Solve by block elimination: the nodes' answer to their own load and to each body's move."""
    moves = border.of_nodes.reshape(*nodes.shape, -1)
    answers = chain.solve(bands, jnp.concatenate([nodes[..., None], moves], axis=-1))
    alone, followed = answers[..., 0], answers[..., 1:]
    back = border.of_bodies.reshape(bodies.size, -1)
    followed = followed.reshape(-1, bodies.size)
    schur = border.corner.reshape(bodies.size, -1) - product(back, followed)
    moved = _solve(schur, bodies.reshape(-1) - product(back, alone.reshape(-1)))
    return alone - product(followed, moved).reshape(alone.shape), moved.reshape(bodies.shape)


def _solve(matrix: Float[Array, "k k"], rhs: Float[Array, " k"]) -> Float[Array, " k"]:
    """Solve by Gauss-Jordan elimination, without pivots: a body's inertia rules its own column.

    In place of a routine for large matrices, see `crinoid.products`.
    """

    def clear(i: Array, rows: Array) -> Array:
        pivot = rows[i] / rows[i, i]
        return (rows - rows[:, i, None] * pivot).at[i].set(pivot)

    return jax.lax.fori_loop(0, rhs.size, clear, jnp.c_[matrix, rhs])[:, -1]
