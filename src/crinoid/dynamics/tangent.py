"""The matrix of a Newton step: the chain of nodes, bordered by the bodies that it touches."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid import chain

HELD = 2
"""The ghost node and the root: their motion is prescribed, not solved for."""

Rows = Float[Array, "rows b"]


class Border(eqx.Module):
    """What couples ``f`` free bodies to the nodes and to themselves."""

    of_nodes: Float[Array, "n b f b"]
    """d(residual of the nodes) / d(correction of the bodies)."""
    of_bodies: Float[Array, "f b n b"]
    """d(residual of the bodies) / d(correction of the nodes)."""
    corner: Float[Array, "f b f b"]


class Tangent(eqx.Module):
    """d(residual)/d(correction), with the rows of nodes and then obstacles.

    Of the obstacles only the free ones are solved for: rows ``free`` among them.
    """

    bands: chain.Bands
    border: Border | None
    free: tuple[int, ...] = eqx.field(static=True)

    def solve(self, rhs: Rows) -> Rows:
        """Solve for what is not prescribed; the other rows come back as zero."""
        num_nodes, size = self.bands.shape[0], rhs.shape[1]
        nodes = rhs[HELD:num_nodes]
        bands = self.bands[HELD:]
        answer = jnp.zeros_like(rhs)
        if self.border is None:
            return answer.at[HELD:num_nodes].set(chain.solve(bands, nodes))
        # block elimination: the nodes' answer to their own load and to each move of a body
        unknowns = len(self.free) * size
        moves = self.border.of_nodes[HELD:].reshape(*nodes.shape, unknowns)
        alone, followed = jnp.split(
            chain.solve(bands, jnp.concatenate([nodes[..., None], moves], axis=-1)), [1], axis=-1
        )
        back = self.border.of_bodies[:, :, HELD:].reshape(unknowns, -1)
        corner = self.border.corner.reshape(unknowns, unknowns)
        rows = num_nodes + jnp.asarray(self.free)
        schur = corner - back @ followed.reshape(-1, unknowns)
        bodies = jnp.linalg.solve(schur, rhs[rows].reshape(-1) - back @ alone.reshape(-1))
        answer = answer.at[HELD:num_nodes].set(alone[..., 0] - followed @ bodies)
        return answer.at[rows].set(bodies.reshape(-1, size))
