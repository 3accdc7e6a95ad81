"""Everything that one step hands to the next."""

import equinox as eqx
from jaxtyping import Array, Float

from crinoid.base import Base, ServoState


class State(eqx.Module):
    """The motion of the arm at one time. SI units; places are relative to the base's set position.

    Node 0 is the ghost behind the root, node 1 the root.
    """

    time: Float[Array, ""]
    position: Float[Array, "n b"]
    velocity: Float[Array, "n b"]
    acceleration: Float[Array, "n b"]
    servo: ServoState
    flow_velocity: Float[Array, "n b"]
    """Velocity of the undisturbed water at the nodes (m/s)."""
    reaction: Float[Array, "2 b"]
    """Force of the base on the ghost node and the root (N)."""
    energy: Float[Array, " energy"]
    """Stored energies, in the order of `crinoid.elements.ENERGIES` (J)."""
    power: Float[Array, " work"]
    """Power that flows into the arm, in the order of `crinoid.elements.WORKS` (W)."""
    work: Float[Array, " work"]
    """Work done on the arm since the start, in the same order (J)."""

    @property
    def base_force(self) -> Float[Array, " b"]:
        """Force of the arm on the submarine (N)."""
        return Base.wrench(self.position[:2], self.reaction)[0]

    @property
    def base_moment(self) -> Float[Array, ""]:
        """Moment of the arm on the submarine about the root (N m)."""
        return Base.wrench(self.position[:2], self.reaction)[1]
