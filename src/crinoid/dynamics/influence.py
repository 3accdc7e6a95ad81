"""How the inputs move an arm at rest, and its tip with it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.base import Base
from crinoid.dynamics import statics
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.state import State
from crinoid.dynamics.tangent import HELD, LineStiffness, Tangent
from crinoid.dynamics.tip import tip_pose
from crinoid.products import product


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
        moved = jnp.pad(self.held, ((0, self.loads.shape[0] - HELD), (0, 0), (0, 0)))
        forced = jnp.concatenate([-_product(stiffness, moved), self.loads], axis=-1)
        nodes = jnp.concatenate([moved, jnp.zeros_like(self.loads)], axis=-1)
        if self.lines is None:
            free = chain.solve(stiffness[HELD:], forced[HELD:])
            nodes = jnp.concatenate([nodes[:HELD], free])
        else:
            loads = jnp.einsum("lnb,nbc->lc", self.lines.follow, moved)
            taut = -jnp.einsum("nbl,lc->nbc", self.lines.pull, loads)
            forced = forced.at[..., : moved.shape[2]].add(taut)
            tangent = Tangent(stiffness, None, ()).coupled(self.lines)
            nodes += jax.vmap(tangent.solve, -1, -1)(forced)
        last = nodes[-self.tip.shape[1] :, : self.tip.shape[2]]
        return jnp.sum(self.tip[..., None] * last, axis=(1, 2))


def influence(base: Base, forces: Forces, state: State) -> Influence:
    """Return what small moves of the inputs do to the arm about ``state``, taken as still.

    ``forces`` are those in that state.
    """
    pose, _, _ = base.pose(state.time, state.servo)
    held = jax.vmap(lambda rate: base.moving(pose, rate)[1], out_axes=-1)(jnp.eye(pose.size))
    if state.attitude is not None:
        axes = forces.axes
        held = held.at[:, :axes].set(product(state.attitude, held[:, :axes]))
    rows = state.motion.position
    stage, none = statics.still(state.time, rows, state.frames), jnp.zeros_like(rows)
    forces = forces.frozen(state.time)
    around = forces.surroundings(stage, none)

    def balance(drive: Array) -> Float[Array, "n b"]:
        driven = forces.driven(drive)
        motion = driven.motion(stage, none, around)
        return -driven.nodes(driven.residual(motion)[0])

    loads = jnp.zeros((*forces.nodes(rows).shape, 0))
    if forces.drive is not None:
        loads = jax.jacfwd(balance)(forces.drive)
    lines = None
    if forces.lines is not None:
        lines = forces.tangent(stage, forces.motion(stage, none, around), around).of_lines
    return Influence(held, loads, jax.jacfwd(tip_pose)(state.position[-3:]), lines)


def _product(
    bands: chain.Bands, columns: Float[Array, "n b channel"]
) -> Float[Array, "n b channel"]:
    return jax.vmap(lambda column: chain.matvec(bands, column), -1, -1)(columns)
