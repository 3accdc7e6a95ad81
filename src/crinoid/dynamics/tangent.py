"""Tangent matrix: the banded matrix of the nodes, bordered by the other unknowns."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.dynamics.bordered import BlockElimination, Border, TangentFactors, UnknownLayout
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.numerics import banded, index_array
from crinoid.numerics.small_matrices import product

Rows = Float[Array, "_ b"]
Extra = Float[Array, " p"]


class LineStiffness(NamedTuple):
    """Low-rank stiffness of lines, in addition to the bands: ``pull . follow``."""

    pull: Float[Array, "rows b line"]
    """Residual of all rows per load of a line."""
    follow: Float[Array, "line n b"]
    """Derivative of the loads by the nodes."""


class Tangent(eqx.Module):
    """d(residual)/d(correction), with the rows of the nodes and then of other bodies.

    The unknowns of these are the entries ``extra``, counted from the first row after the nodes.
    """

    bands: banded.Bands
    border: Border | None
    extra: tuple[int, ...] = eqx.field(static=True)
    lines: int = eqx.field(static=True, default=0)
    """Number of loads of lines, the last unknowns of the border, without a row."""
    far: Float[Array, "n b n b"] | None = None
    """Contact of the arm with itself, which couples far nodes and adds to the bands."""

    def solve(self, rhs: Rows) -> Rows:
        """Solve for the unknowns; the other rows are zero."""
        return self._either(rhs, self._solve_apart)

    def solve_touching(self, rhs: Rows) -> Rows | None:
        """Solve if far parts touch, which is not in the factors, else return zeros.

        None of an arm without such contact.
        """
        if self.far is None:
            return None
        return self._either(rhs, lambda *each: (jnp.zeros_like(each[0]), jnp.zeros_like(each[1])))

    def factorise(self) -> TangentFactors:
        """Return the factors of the tangent, without contact of far parts."""
        border = None if self.border is None else self.border.of_free()
        matrix = BlockElimination.of(self.bands[BOUNDARY_NODES:], border)
        return TangentFactors(matrix, self._layout)

    @property
    def touches(self) -> Bool[Array, ""]:
        """Whether far parts are in contact."""
        return jnp.asarray(False) if self.far is None else jnp.any(self.far != 0)

    def times_sizes(self, rows: Rows) -> Rows:
        """Return the product of absolute values: the largest effect of errors of these sizes."""
        num_nodes, moved = self.bands.shape[0], len(self.extra)
        sizes = jnp.abs(rows)
        nodes = sizes[:num_nodes]
        _, extra = self._layout.gather(sizes)
        # a sum of products, which XLA fuses: `banded.matvec` would cost 3 % of a step
        index = np.arange(num_nodes)[:, None] + np.arange(5)
        near = index_array.gather(jnp.pad(nodes, ((2, 2), (0, 0))), index)
        effect = jnp.sum(jnp.abs(self.bands) * near[:, :, None], axis=(1, 3))
        if self.far is not None:
            effect += jnp.einsum("nbmc,mc->nb", jnp.abs(self.far), nodes)
        if self.border is not None:
            border = jax.tree.map(jnp.abs, self.border)
            along = jnp.einsum("pnb,nb->p", border.of_extra, nodes)
            extra = extra.at[moved:].set(along[moved:])  # the loads of lines
            effect += product(border.of_nodes, extra)
            extra = along + product(border.corner, extra)
        return self._layout.scatter(effect[BOUNDARY_NODES:], extra, rows.shape)

    def _either(self, rhs: Rows, apart: Callable[[Rows, Extra], tuple[Rows, Extra]]) -> Rows:
        """Solve with contact of far parts, or by a function that serves while there is none."""

        def whole(nodes: Rows, extra: Extra) -> tuple[Rows, Extra]:
            found = jnp.linalg.solve(self._dense(), jnp.concatenate([nodes.reshape(-1), extra]))
            return found[: nodes.size].reshape(nodes.shape), found[nodes.size :]

        known = self._layout.gather(rhs)
        if self.far is None:
            found = apart(*known)
        else:
            found = jax.lax.cond(self.touches, lambda: whole(*known), lambda: apart(*known))
        return self._layout.scatter(*found, rhs.shape)

    def _solve_apart(self, nodes: Rows, extra: Extra) -> tuple[Rows, Extra]:
        """Solve without contact of far parts."""
        bands = self.bands[BOUNDARY_NODES:]
        if self.border is None:
            return banded.solve(bands, nodes), extra
        border = self.border.of_free()

        def times(unknowns: tuple[Rows, Extra]) -> tuple[Rows, Extra]:
            nodes, extra = unknowns
            along = jnp.einsum("pnb,nb->p", border.of_extra, nodes)
            pulled = banded.matvec(bands, nodes) + product(border.of_nodes, extra)
            return pulled, along + product(border.corner, extra)

        return jax.lax.custom_linear_solve(
            times,
            (nodes, extra),
            solve=lambda _, b: BlockElimination.of(bands, border).solve(*b),
            transpose_solve=lambda _, b: BlockElimination.of(
                banded.transpose(bands), border.transposed()
            ).solve(*b),
        )

    def _dense(self) -> Float[Array, "m m"]:
        """Return the matrix of the unknowns of an arm with contact of far parts.

        The pairs of far edges in contact are about as many as the nodes: to eliminate the bands
        first, and then a border of several unknowns a pair, is more work.
        """
        bands = self.bands[BOUNDARY_NODES:]
        count, _, size, _ = bands.shape
        assert self.far is not None
        nodes = self.far[BOUNDARY_NODES:, :, BOUNDARY_NODES:] + banded.dense(bands)
        nodes = nodes.reshape(count * size, -1)
        if self.border is None:
            return nodes
        border = self.border.of_free()
        p = border.corner.shape[0]
        columns, rows = border.of_nodes.reshape(-1, p), border.of_extra.reshape(p, -1)
        return jnp.block([[nodes, columns], [rows, border.corner]])

    @property
    def _layout(self) -> UnknownLayout:
        return UnknownLayout(self.bands.shape[0], self.extra, self.lines)

    def bordered(
        self,
        columns: Float[Array, "rows b p"],
        push: Callable[[Float[Array, "held b"]], Extra],
        extra: tuple[int, ...],
    ) -> "Tangent":
        """Add the ``p`` unknowns of a body to which the boundary nodes are clamped.

        ``columns`` has the derivatives of all residuals by them. Their residual is the linear
        function ``push`` of that of the boundary nodes.
        """
        num_nodes, _, size, _ = self.bands.shape
        before = self.border or _no_border(num_nodes, size)
        at = (*self.extra, *extra)
        own = columns[num_nodes:].reshape(-1, len(extra))[jnp.asarray(at)]
        each = jax.vmap(push, -1, -1)
        held = _of_held(self.bands)
        if self.far is not None:
            held += self.far[:BOUNDARY_NODES]
        of_extra = jax.vmap(each, -1, -1)(held)
        back = each(before.of_nodes[:BOUNDARY_NODES])
        border = Border(
            jnp.concatenate([before.of_nodes, columns[:num_nodes]], axis=2),
            jnp.concatenate([before.of_extra, of_extra]),
            jnp.concatenate([jnp.concatenate([before.corner, back]), own], axis=1),
        )
        return replace(self, border=border, extra=at)

    def coupled(self, lines: LineStiffness) -> "Tangent":
        """Add the loads of lines as unknowns, because they depend on all nodes.

        ``(K + C R) dq`` is ``K dq + C df`` with ``R dq - df = 0``.
        """
        columns, follows = lines
        num_nodes, _, size, _ = self.bands.shape
        at = jnp.asarray(self.extra, int)
        before = self.border or _no_border(num_nodes, size)
        on_others = columns[num_nodes:].reshape(-1, columns.shape[-1])[at]
        none, own = jnp.zeros_like(on_others.T), -jnp.eye(columns.shape[-1])
        corner = [[before.corner, on_others], [none, own]]
        border = Border(
            jnp.concatenate([before.of_nodes, columns[:num_nodes]], axis=2),
            jnp.concatenate([before.of_extra, follows]),
            jnp.block(corner),
        )
        return replace(self, border=border, lines=columns.shape[-1])

    @property
    def of_lines(self) -> LineStiffness | None:
        """Stiffness that lines and contact of far edges add to that of the nodes."""
        found = []
        if self.far is not None:
            n, size = self.far.shape[:2]
            every = jnp.eye(n * size).reshape(-1, n, size)
            found.append((self.far.reshape(n, size, -1), every))
        if self.border is not None and self.lines:
            moved = len(self.extra)
            found.append((self.border.of_nodes[..., moved:], self.border.of_extra[moved:]))
        if not found:
            return None
        pulls, follows = zip(*found, strict=True)
        return LineStiffness(jnp.concatenate(pulls, axis=-1), jnp.concatenate(follows))

    def on_held(self, change: Rows) -> Float[Array, "held b"]:
        """Return the change of the forces on the boundary nodes for a change of the rows."""
        near = 2 * BOUNDARY_NODES  # as far as elements reach
        forces = banded.matvec(self.bands[:near], change[:near])[:BOUNDARY_NODES]
        if self.far is not None:
            forces += jnp.einsum(
                "hbnc,nc->hb", self.far[:BOUNDARY_NODES], change[: self.far.shape[0]]
            )
        if self.border is None:
            return forces
        num_nodes, moved = self.bands.shape[0], len(self.extra)
        extra = change[num_nodes:].reshape(-1)[jnp.asarray(self.extra, int)]
        lines = jnp.einsum("pnb,nb->p", self.border.of_extra[moved:], change[:num_nodes])
        return forces + product(self.border.of_nodes[:BOUNDARY_NODES], jnp.append(extra, lines))


def _no_border(num_nodes: int, size: int) -> Border:
    none = jnp.zeros((num_nodes, size, 0))
    return Border(none, jnp.moveaxis(none, -1, 0), jnp.zeros((0, 0)))


def _of_held(bands: banded.Bands) -> Float[Array, "held b n b"]:
    """Return the rows of the boundary nodes as dense matrices."""
    num_nodes = bands.shape[0]
    rows = [jnp.moveaxis(bands[i, 2 - i :], 0, 1) for i in range(BOUNDARY_NODES)]
    return jnp.stack(
        [jnp.pad(row, ((0, 0), (0, num_nodes - row.shape[1]), (0, 0))) for row in rows]
    )
