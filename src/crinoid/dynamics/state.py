"""Everything that one step hands to the next."""

from typing import Any

import equinox as eqx
from jaxtyping import Array, Bool, Float

from crinoid.base import Base, ServoState
from crinoid.dynamics.grip import Grip
from crinoid.dynamics.newton import Kept
from crinoid.dynamics.vehicle import ROWS
from crinoid.elements import Motion
from crinoid.frames import Frames

Nodes = Any  # (n, d), of one state or of many at once, in JAX or NumPy


class State(eqx.Module):
    """How everything moves at one time. SI units; positions are relative to the base's set one.

    Node 0 is the ghost behind the root, node 1 the root. All that the next step needs is here; the
    works of the energy ledger and the impulses of contacts are `crinoid.dynamics.Books`.
    """

    motion: Motion
    """Motion of the nodes, in the rows after them of the obstacles and of a vehicle, and of the
    water at them."""
    ahead: Float[Array, "rows b"]
    """Auxiliary acceleration of generalized-alpha less the true one, over the last step (m/s3)."""
    servo: ServoState
    """State of the base's servos: its channels (m or rad) and how they move."""
    actuators: tuple[Any, ...]
    """States of the other actuators."""
    reaction: Float[Array, "2 b"]
    """Force of the base on the ghost node and the root (N), torque about the ghost edge (N m)."""
    gap: Float[Array, "m e"] | None
    """Distance of each obstacle from the surface of each edge (m)."""
    earlier: Float[Array, "5 rows b"]
    """Accelerations of the five steps before, the last one first, to guess the next one by."""
    guessed: Bool[Array, ""]
    """Whether Newton's method took its guess as it was in the last step."""
    kept: Kept
    """Tangent that Newton's method made last, to begin with in the next step."""
    attitude: Float[Array, "d d"] | None = None
    """Matrix from the axes of a vehicle that floats to those of the world."""
    grip: Grip | None = None
    """Grip of a tool that touches take up or let go; None where they do not."""

    @property
    def time(self) -> Any:
        """Time (s)."""
        return self.motion.time

    @property
    def position(self) -> Nodes:
        """Positions of the nodes (m)."""
        return self._nodes(self.motion.position)[..., : self._axes]

    @property
    def velocity(self) -> Nodes:
        """Velocities of the nodes (m/s)."""
        return self._nodes(self.motion.velocity)[..., : self._axes]

    @property
    def acceleration(self) -> Nodes:
        """Accelerations of the nodes (m/s2)."""
        return self._nodes(self.motion.acceleration)[..., : self._axes]

    @property
    def flow_velocity(self) -> Nodes:
        """Velocity of the undisturbed water at the nodes (m/s)."""
        return self._nodes(self.motion.flow_velocity)

    @property
    def frames(self) -> Frames | None:
        """In space the frames of the edges, from which a later shape takes its own."""
        orientation = self.motion.orientation
        if orientation is None:
            return None
        return Frames.of(self._nodes(self.motion.position), orientation)

    @property
    def base_force(self) -> Float[Array, "*many d"]:
        """Force of the arm on the submarine (N)."""
        return Base.wrench(self.position[..., :2, :], self.reaction)[0]

    @property
    def base_moment(self) -> Float[Array, "..."]:
        """Moment of the arm on the submarine about the root (N m); one number in the plane."""
        return Base.wrench(self.position[..., :2, :], self.reaction)[1]

    @property
    def obstacle_position(self) -> Any:
        """Positions of the obstacles (m), None where there are none."""
        return self._obstacles(self.motion.position)

    @property
    def obstacle_velocity(self) -> Any:
        """Velocities of the obstacles (m/s), None where there are none."""
        return self._obstacles(self.motion.velocity)

    @property
    def vehicle_position(self) -> Any:
        """Position of a vehicle's centre of mass (m), None where the base does not float."""
        return None if self.attitude is None else self.motion.position[..., -2, : self._axes]

    @property
    def vehicle_velocity(self) -> Any:
        """Velocity of a vehicle's centre of mass (m/s), None where the base does not float."""
        return None if self.attitude is None else self.motion.velocity[..., -2, : self._axes]

    @property
    def _axes(self) -> int:
        return int(self.motion.flow_velocity.shape[-1])

    def _obstacles(self, rows: Any) -> Any:
        if self.gap is None:
            return None
        return self._others(rows)[..., -self.gap.shape[-2] :, : self._axes]

    def _nodes(self, rows: Nodes) -> Nodes:
        rows = self._others(rows)
        return rows if self.gap is None else rows[..., : -self.gap.shape[-2], :]

    def _others(self, rows: Any) -> Any:
        return rows if self.attitude is None else rows[..., :-ROWS, :]
