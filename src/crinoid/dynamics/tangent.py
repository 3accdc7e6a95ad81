"""The matrix of a Newton step: the chain of nodes, bordered by the unknowns that are no nodes."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.products import product, solve

HELD = 2
"""The ghost node and the root: their motion is prescribed, not solved for."""

Rows = Float[Array, "_ b"]
Extra = Float[Array, " p"]


class Border(eqx.Module):
    """Blocks that couple ``p`` unknowns beside the chain to the nodes and to themselves."""

    of_nodes: Float[Array, "n b p"]
    """d(residual of the nodes) / d(the other unknowns)."""
    of_extra: Float[Array, "p n b"]
    """d(residual of the other unknowns) / d(correction of the nodes)."""
    corner: Float[Array, "p p"]

    def of_free(self) -> "Border":
        """Return the border of the nodes that are solved for."""
        return Border(self.of_nodes[HELD:], self.of_extra[:, HELD:], self.corner)

    def transposed(self) -> "Border":
        """Return the border of the transposed matrix."""
        return Border(
            jnp.moveaxis(self.of_extra, 0, -1), jnp.moveaxis(self.of_nodes, -1, 0), self.corner.T
        )


class Beside(eqx.Module):
    """Where the unknowns of a tangent stand among all rows."""

    nodes: int = eqx.field(static=True)
    """How many rows are nodes."""
    extra: tuple[int, ...] = eqx.field(static=True)
    """Entries solved for among the rows after them."""
    lines: int = eqx.field(static=True)
    """Unknowns without a row."""

    def taken(self, rows: Rows) -> tuple[Rows, Extra]:
        """Return the rows of free nodes, and the other unknowns."""
        if not self.extra and not self.lines:
            return rows[HELD : self.nodes], jnp.zeros(0)
        beside = rows[self.nodes :].reshape(-1)[jnp.asarray(self.extra, int)]
        return rows[HELD : self.nodes], jnp.append(beside, jnp.zeros(self.lines))

    def rows(self, nodes: Rows, extra: Extra, shape: tuple[int, ...]) -> Rows:
        """Return all rows, zero where they are not solved for."""
        if not self.extra:
            return jnp.pad(nodes, ((HELD, shape[0] - self.nodes), (0, 0)))
        at = jnp.asarray(self.extra, int)
        others = jnp.zeros((shape[0] - self.nodes) * shape[1])
        others = others.at[at].set(extra[: at.size], unique_indices=True)
        held = jnp.zeros((HELD, shape[1]))
        return jnp.concatenate([held, nodes, others.reshape(-1, shape[1])])


class Eliminated(eqx.Module):
    """A bordered matrix after block elimination, the nodes first."""

    bands: chain.Factors
    back: Float[Array, "p nb"] | None
    """Rows of the other unknowns in the columns of the nodes; None where there are none."""
    followed: Float[Array, "n b p"] | None
    """Answers of the nodes to each of the other unknowns."""
    schur: Float[Array, "p p"] | None
    """Matrix of the other unknowns when the nodes are eliminated."""

    @staticmethod
    def of(bands: chain.Bands, border: Border | None) -> "Eliminated":
        """Eliminate the blocks of a matrix."""
        factors = chain.factorised(bands)
        if border is None:
            return Eliminated(factors, None, None, None)
        followed = chain.substituted(factors, border.of_nodes)
        back = border.of_extra.reshape(border.of_extra.shape[0], -1)
        schur = border.corner - product(back, followed.reshape(-1, back.shape[0]))
        return Eliminated(factors, back, followed, schur)

    def solve(self, nodes: Rows, extra: Extra) -> tuple[Rows, Extra]:
        """Solve for the nodes and the other unknowns."""
        alone = chain.substituted(self.bands, nodes)
        if self.schur is None:
            return alone, extra
        assert self.back is not None
        assert self.followed is not None
        # a body's inertia rules its own column: no pivots
        moved = solve(self.schur, extra - product(self.back, alone.reshape(-1)))
        return alone - product(self.followed, moved), moved


class Factorised(eqx.Module):
    """A tangent made ready to be solved."""

    matrix: Eliminated
    beside: Beside

    @staticmethod
    def blank(nodes: int, size: int, extra: tuple[int, ...], lines: int) -> "Factorised":
        """Return the place for one, with nothing in it."""
        free, p = nodes - HELD, len(extra) + lines
        parts: tuple[Array | None, ...] = (None, None, None)
        if p:
            parts = tuple(map(jnp.zeros, ((p, free * size), (free, size, p), (p, p))))
        return Factorised(Eliminated(chain.blank(free, size), *parts), Beside(nodes, extra, lines))

    def solve(self, rhs: Rows) -> Rows:
        """Solve for what is not prescribed; the other rows come back as zero."""
        return self.beside.rows(*self.matrix.solve(*self.beside.taken(rhs)), rhs.shape)


class LineStiffness(NamedTuple):
    """Stiffness of lines beside that of the bands: ``pull . follow``."""

    pull: Float[Array, "rows b line"]
    """Force lacking on everything that has a row, per load."""
    follow: Float[Array, "line n b"]
    """How the loads follow the nodes."""


class Tangent(eqx.Module):
    """d(residual)/d(correction), with the rows of nodes and then of whatever else moves.

    Of these rows the entries ``extra`` are solved for, counted from the first row after the nodes.
    """

    bands: chain.Bands
    border: Border | None
    extra: tuple[int, ...] = eqx.field(static=True)
    lines: int = eqx.field(static=True, default=0)
    """How many unknowns without a row come last in the border: they follow from the nodes."""

    def solve(self, rhs: Rows) -> Rows:
        """Solve for what is not prescribed; the other rows come back as zero."""
        bands, beside = self.bands[HELD:], self._beside
        nodes, extra = beside.taken(rhs)
        if self.border is None:
            return beside.rows(chain.solve(bands, nodes), extra, rhs.shape)
        border = self.border.of_free()
        nodes, extra = jax.lax.custom_linear_solve(
            lambda x: _matvec(bands, border, *x),
            (nodes, extra),
            solve=lambda _, b: Eliminated.of(bands, border).solve(*b),
            transpose_solve=lambda _, b: Eliminated.of(
                chain.transpose(bands), border.transposed()
            ).solve(*b),
        )
        return beside.rows(nodes, extra, rhs.shape)

    def factorised(self) -> Factorised:
        """Return the tangent made ready to be solved again and again."""
        border = None if self.border is None else self.border.of_free()
        return Factorised(Eliminated.of(self.bands[HELD:], border), self._beside)

    @property
    def _beside(self) -> Beside:
        return Beside(self.bands.shape[0], self.extra, self.lines)

    def bordered(
        self,
        columns: Float[Array, "rows b p"],
        push: Callable[[Float[Array, "held b"]], Extra],
        extra: tuple[int, ...],
    ) -> "Tangent":
        """Add ``p`` unknowns that move what is held, and are pushed by the forces on it.

        ``columns`` are the derivatives of all residuals by them. Their own residual is, by the
        residual of what is held, ``push``, which is linear.
        """
        num_nodes, _, size, _ = self.bands.shape
        before = self.border
        if before is None:
            before = _no_border(num_nodes, size)
        at = (*self.extra, *extra)
        beside = columns[num_nodes:].reshape(-1, len(extra))[jnp.asarray(at)]
        each = jax.vmap(push, -1, -1)
        of_extra = jax.vmap(each, -1, -1)(_of_held(self.bands))
        back = each(before.of_nodes[:HELD])
        border = Border(
            jnp.concatenate([before.of_nodes, columns[:num_nodes]], axis=2),
            jnp.concatenate([before.of_extra, of_extra]),
            jnp.concatenate([jnp.concatenate([before.corner, back]), beside], axis=1),
        )
        return Tangent(self.bands, border, at)

    def coupled(self, lines: LineStiffness) -> "Tangent":
        """Add the loads of lines as unknowns that follow the nodes.

        So a force that depends on all nodes stays out of the bands: ``(K + C R) dq`` is
        ``K dq + C df`` with ``R dq - df = 0``.
        """
        columns, follows = lines
        num_nodes, _, size, _ = self.bands.shape
        at = jnp.asarray(self.extra, int)
        before = self.border or _no_border(num_nodes, size)
        beside = columns[num_nodes:].reshape(-1, columns.shape[-1])[at]
        none, own = jnp.zeros_like(beside.T), -jnp.eye(columns.shape[-1])
        corner = [[before.corner, beside], [none, own]]
        border = Border(
            jnp.concatenate([before.of_nodes, columns[:num_nodes]], axis=2),
            jnp.concatenate([before.of_extra, follows]),
            jnp.block(corner),
        )
        return Tangent(self.bands, border, self.extra, columns.shape[-1])

    @property
    def of_lines(self) -> LineStiffness | None:
        """Stiffness that lines add to that of the nodes."""
        if self.border is None or not self.lines:
            return None
        moved = len(self.extra)
        return LineStiffness(self.border.of_nodes[..., moved:], self.border.of_extra[moved:])

    def on_held(self, change: Rows) -> Float[Array, "held b"]:
        """Return how the forces on what is prescribed follow a change of the rest."""
        near = 2 * HELD  # as far as elements reach
        forces = chain.matvec(self.bands[:near], change[:near])[:HELD]
        if self.border is None:
            return forces
        num_nodes, moved = self.bands.shape[0], len(self.extra)
        extra = change[num_nodes:].reshape(-1)[jnp.asarray(self.extra, int)]
        lines = jnp.einsum("pnb,nb->p", self.border.of_extra[moved:], change[:num_nodes])
        return forces + product(self.border.of_nodes[:HELD], jnp.append(extra, lines))


def _no_border(num_nodes: int, size: int) -> Border:
    none = jnp.zeros((num_nodes, size, 0))
    return Border(none, jnp.moveaxis(none, -1, 0), jnp.zeros((0, 0)))


def _of_held(bands: chain.Bands) -> Float[Array, "held b n b"]:
    """Return the rows of what is held, written out."""
    num_nodes = bands.shape[0]
    rows = [jnp.moveaxis(bands[i, 2 - i :], 0, 1) for i in range(HELD)]
    return jnp.stack(
        [jnp.pad(row, ((0, 0), (0, num_nodes - row.shape[1]), (0, 0))) for row in rows]
    )


def _matvec(bands: chain.Bands, border: Border, nodes: Rows, extra: Extra) -> tuple[Rows, Extra]:
    return (
        chain.matvec(bands, nodes) + product(border.of_nodes, extra),
        jnp.einsum("pnb,nb->p", border.of_extra, nodes) + product(border.corner, extra),
    )
