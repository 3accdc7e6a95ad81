"""Bordered matrix: the bands of the nodes, and blocks of the other unknowns, factorised."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.numerics import banded
from crinoid.numerics.small_matrices import product, solve

Rows = Float[Array, "_ b"]
Extra = Float[Array, " p"]


class Border(eqx.Module):
    """Blocks that couple ``p`` other unknowns to the nodes and to themselves."""

    of_nodes: Float[Array, "n b p"]
    """d(residual of the nodes) / d(the other unknowns)."""
    of_extra: Float[Array, "p n b"]
    """d(residual of the other unknowns) / d(correction of the nodes)."""
    corner: Float[Array, "p p"]

    def of_free(self) -> "Border":
        """Return the border of the free nodes."""
        return Border(
            self.of_nodes[BOUNDARY_NODES:], self.of_extra[:, BOUNDARY_NODES:], self.corner
        )

    def transposed(self) -> "Border":
        """Return the border of the transposed matrix."""
        return Border(
            jnp.moveaxis(self.of_extra, 0, -1), jnp.moveaxis(self.of_nodes, -1, 0), self.corner.T
        )


class UnknownLayout(eqx.Module):
    """Layout of the unknowns of a tangent among all rows."""

    nodes: int = eqx.field(static=True)
    """Number of nodes, the first rows."""
    extra: tuple[int, ...] = eqx.field(static=True)
    """Indices of unknowns among the flattened rows after the nodes."""
    lines: int = eqx.field(static=True)
    """Number of unknowns without a row."""

    def gather(self, rows: Rows) -> tuple[Rows, Extra]:
        """Return the rows of free nodes, and the other unknowns."""
        if not self.extra and not self.lines:
            return rows[BOUNDARY_NODES : self.nodes], jnp.zeros(0)
        # a line has no row: its zero is an entry too, as a constant has no derivative backward
        entries = (*(self.nodes * rows.shape[1] + i for i in self.extra), *[rows.size] * self.lines)
        padded = jnp.pad(rows.reshape(-1), (0, 1))
        return rows[BOUNDARY_NODES : self.nodes], padded[jnp.asarray(entries, int)]

    def scatter(self, nodes: Rows, extra: Extra, shape: tuple[int, ...]) -> Rows:
        """Return all rows, zero where there is no unknown."""
        if not self.extra:
            return jnp.pad(nodes, ((BOUNDARY_NODES, shape[0] - self.nodes), (0, 0)))
        at = jnp.asarray(self.extra, int)
        others = jnp.zeros((shape[0] - self.nodes) * shape[1])
        others = others.at[at].set(extra[: at.size], unique_indices=True)
        held = jnp.zeros((BOUNDARY_NODES, shape[1]))
        return jnp.concatenate([held, nodes, others.reshape(-1, shape[1])])


class BlockElimination(eqx.Module):
    """Block LU factors of a bordered matrix, the nodes eliminated first."""

    bands: banded.Factors
    back: Float[Array, "p nb"] | None
    """Rows of the other unknowns in the columns of the nodes, if there are any."""
    followed: Float[Array, "n b p"] | None
    """Solution of the nodes for the column of each other unknown."""
    schur: Float[Array, "p p"] | None
    """Schur complement of the other unknowns."""

    @staticmethod
    def of(bands: banded.Bands, border: Border | None) -> "BlockElimination":
        """Factorise a bordered matrix."""
        factors = banded.factorise(bands)
        if border is None:
            return BlockElimination(factors, None, None, None)
        followed = banded.substitute(factors, border.of_nodes)
        back = border.of_extra.reshape(border.of_extra.shape[0], -1)
        schur = border.corner - product(back, followed.reshape(-1, back.shape[0]))
        return BlockElimination(factors, back, followed, schur)

    def solve(self, nodes: Rows, extra: Extra) -> tuple[Rows, Extra]:
        """Solve for the nodes and the other unknowns."""
        alone = banded.substitute(self.bands, nodes)
        if self.schur is None:
            return alone, extra
        assert self.back is not None
        assert self.followed is not None
        # no pivots: inertia dominates the column of a body
        moved = solve(self.schur, extra - product(self.back, alone.reshape(-1)))
        return alone - product(self.followed, moved), moved


class TangentFactors(eqx.Module):
    """Factorised tangent, without contact of far parts."""

    matrix: BlockElimination
    layout: UnknownLayout

    @staticmethod
    def blank(nodes: int, size: int, extra: tuple[int, ...], lines: int) -> "TangentFactors":
        """Return factors of zeros in the shape of a tangent."""
        free, p = nodes - BOUNDARY_NODES, len(extra) + lines
        layout = UnknownLayout(nodes, extra, lines)
        parts: tuple[Array | None, ...] = (None, None, None)
        if p:
            parts = tuple(map(jnp.zeros, ((p, free * size), (free, size, p), (p, p))))
        return TangentFactors(BlockElimination(banded.blank(free, size), *parts), layout)

    def solve(self, rhs: Rows) -> Rows:
        """Solve for the unknowns; the other rows are zero."""
        return self.layout.scatter(*self.matrix.solve(*self.layout.gather(rhs)), rhs.shape)
