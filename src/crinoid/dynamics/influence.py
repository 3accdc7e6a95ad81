"""How the inputs move an arm at rest, and its tip with it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.dynamics.tangent import HELD, LineStiffness, Tangent


class Influence(NamedTuple):
    """Small moves of the inputs: what they do to the ends of an arm and along it. SI units."""

    held: Float[Array, "2 b channel"]
    """How the ghost node and the root follow the channels of the base."""
    loads: Float[Array, "n b drive"]
    """Forces on the nodes that come with the drives of the other actuators."""
    tip: Float[Array, "pose 3 d"]
    """How the tip's pose follows the last three nodes."""
    lines: LineStiffness | None = None
    """Stiffness of tendons of given length and closed chambers; None: there are none."""

    def static(self, stiffness: chain.Bands) -> Float[Array, "pose input"]:
        """Return how the tip's pose follows inputs that move slowly."""
        moved = jnp.zeros((*self.loads.shape[:2], self.held.shape[2])).at[:HELD].set(self.held)
        forced = jnp.concatenate([-_product(stiffness, moved), self.loads], axis=-1)
        nodes = jnp.concatenate([moved, jnp.zeros_like(self.loads)], axis=-1)
        if self.lines is None:
            nodes = nodes.at[HELD:].set(chain.solve(stiffness[HELD:], forced[HELD:]))
        else:
            loads = jnp.einsum("lnb,nbc->lc", self.lines.follow, moved)
            taut = -jnp.einsum("nbl,lc->nbc", self.lines.pull, loads)
            forced = forced.at[..., : moved.shape[2]].add(taut)
            tangent = Tangent(stiffness, None, ()).coupled(self.lines)
            nodes += jax.vmap(tangent.solve, -1, -1)(forced)
        last = nodes[-self.tip.shape[1] :, : self.tip.shape[2]]
        return jnp.sum(self.tip[..., None] * last, axis=(1, 2))


def _product(
    bands: chain.Bands, columns: Float[Array, "n b channel"]
) -> Float[Array, "n b channel"]:
    return jax.vmap(lambda column: chain.matvec(bands, column), -1, -1)(columns)
