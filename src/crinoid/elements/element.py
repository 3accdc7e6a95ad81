"""The one interface between physics and numerics: a force law on a short run of nodes."""

from abc import abstractmethod
from collections.abc import Callable
from operator import attrgetter
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.frames import Orientation, cross, dot

ENERGIES = ("kinetic", "elastic", "potential")
"""Stored energies of the ledger."""
WORKS = ("drag", "damping", "actuation", "loads", "added_mass", "tool", "contact")
"""Running works of the ledger: together they equal the change of the stored energies."""


class Motion(eqx.Module):
    """How ``k`` nodes move, and how the water moves where they are. SI units.

    The arrays have a leading axis, ``count``, for all windows of an element together. A node has
    ``b`` coordinates: its position along ``d`` axes and, of a spatial arm that spins, the angle by
    which the edge that ends at it has spun about itself (rad).
    """

    position: Float[Array, "*count k b"]
    """Positions (m), relative to the base's set position, and spins (rad)."""
    velocity: Float[Array, "*count k b"]
    """Velocities (m/s, rad/s)."""
    acceleration: Float[Array, "*count k b"]
    """Accelerations (m/s2, rad/s2)."""
    flow_velocity: Float[Array, "*count k d"]
    """Velocity of the undisturbed water at the nodes (m/s)."""
    flow_acceleration: Float[Array, "*count k d"]
    """Material acceleration Du/Dt of the undisturbed water at the nodes (m/s2)."""
    time: Float[Array, "*count"]
    """Time (s)."""
    orientation: Orientation | None = None
    """Orientation of the edges in space; None for elements that see positions only."""
    drive: Float[Array, "*count drive"] | None = None
    """Drives of the actuators (`crinoid.Actuator`), each in its own unit."""
    line: Float[Array, "*count line"] | None = None
    """Loads of lines (``crinoid.dynamics.lines``): tensions (N), pressures (Pa)."""

    def windows(
        self,
        take: Callable[[Array], Array],
        count: tuple[int, ...],
        width: int,
        *,
        turned: bool = False,
    ) -> "Motion":
        """Return the motion of ``count`` windows, which ``take`` cuts from the rows of an array.

        They have the first ``width`` coordinates, and the orientation of the edges if ``turned``.
        """
        return Motion(
            take(self.position[:, :width]),
            take(self.velocity[:, :width]),
            take(self.acceleration[:, :width]),
            take(self.flow_velocity),
            take(self.flow_acceleration),
            jnp.broadcast_to(self.time, count),
            jax.tree.map(take, self.orientation) if turned else None,
            *(
                None if all_ is None else jnp.broadcast_to(all_, (*count, all_.size))
                for all_ in (self.drive, self.line)
            ),
        )


class Course(eqx.Module):
    """How the motion of a window follows a correction of its nodes."""

    by_position: Float[Array, "*count"]
    """Change of the positions over the correction (1)."""
    by_velocity: Float[Array, "*count"]
    """Change of the velocities over the correction (1/s)."""
    by_acceleration: Float[Array, "*count"]
    """Change of the accelerations over the correction (1/s2)."""
    velocity_slope: Float[Array, "*count k d d"]
    """Derivative of the water's velocity along the axes of space, the last index (1/s)."""
    acceleration_slope: Float[Array, "*count k d d"] | None = None
    """Derivative of its material acceleration (1/s2); where it is left out, None."""
    stays: tuple[str, ...] = eqx.field(static=True, default=())
    """Which of position and velocity no correction changes."""

    def derivative(
        self,
        residual: Callable[[Motion], Float[Array, "k b"]],
        motion: Motion,
        direction: Float[Array, "k b"],
    ) -> Float[Array, "k b"]:
        """Return how a residual changes where the nodes are corrected along ``direction``."""
        change = self._tangent(motion, direction)
        changes = jax.tree.map(lambda x: x is not None, change, is_leaf=lambda x: x is None)
        moving, still = eqx.partition(motion, changes)
        return jax.jvp(lambda m: residual(eqx.combine(m, still)), (moving,), (change,))[1]

    def _tangent(self, motion: Motion, direction: Float[Array, "k b"]) -> Motion:
        """Return how the motion changes, with None for what stays as it is."""
        changes = {"acceleration": self.by_acceleration * direction}
        if "velocity" not in self.stays:
            changes["velocity"] = self.by_velocity * direction
        if "position" not in self.stays:
            moved = self.by_position * direction
            changes["position"] = moved
            flows = moved[:, None, : motion.flow_velocity.shape[-1]]
            changes["flow_velocity"] = jnp.sum(self.velocity_slope * flows, axis=-1)
            if self.acceleration_slope is not None:
                changes["flow_acceleration"] = jnp.sum(self.acceleration_slope * flows, axis=-1)
            if motion.orientation is not None:
                changes["orientation.director"] = _turning(motion, moved)
        still = jax.tree.map(lambda _: None, motion)
        return eqx.tree_at(
            lambda m: [attrgetter(name)(m) for name in changes],
            still,
            list(changes.values()),
            is_leaf=lambda x: x is None,
        )


def _turning(motion: Motion, moved: Float[Array, "k b"]) -> Float[Array, "k 3"]:
    """Return how the directors of a window turn; their twist an element works out from them."""
    assert motion.orientation is not None
    # of the edge that ends at the first node the window shows one end only
    edge, moving = jnp.diff(motion.position[:, :3], axis=0), jnp.diff(moved[:, :3], axis=0)
    length = jnp.sqrt(dot(edge, edge))[:, None]
    tangent, director = edge / length, motion.orientation.director[1:]
    turning = (moving - dot(moving, tangent)[:, None] * tangent) / length
    spin = (moved[1:, 3] + dot(motion.orientation.lean[1:], turning))[:, None]
    swept = spin * cross(tangent, director) - dot(director, turning)[:, None] * tangent
    return jnp.pad(swept, ((1, 0), (0, 0)))


class Element(eqx.Module):
    """A force law that repeats along the arm.

    Every field that is an array has the windows of ``stencil`` consecutive nodes as its leading
    axis; the methods see one window, without that axis. The sum of the residuals of all elements
    vanishes where the arm moves as it should:
    ``M a + (internal forces) - (forces from outside) = 0``.

    Only ``residual`` matters to the motion: its tangent matrix is taken by forward-mode
    differentiation. The rest keeps the energy ledger.
    """

    stencil: ClassVar[int]
    """How many consecutive nodes one window holds (1 to 3)."""
    spins: ClassVar[bool] = False
    """Whether this depends on the spin of edges in space; if not it sees positions only."""
    external: ClassVar[bool] = False
    """Whether this comes from outside, so that a static solve may bring it on step by step."""
    stored: ClassVar[str] = "potential"
    """Which of `crinoid.elements.ENERGIES` receives ``energy``."""
    worked: ClassVar[str] = "loads"
    """Which of `crinoid.elements.WORKS` receives what ``working`` does."""

    first: eqx.AbstractVar[int]
    """The node at which the first window starts; node 0 is the ghost behind the root."""

    @abstractmethod
    def residual(self, motion: Motion) -> Float[Array, "k b"]:
        """Return minus the force on each node (N) and about each edge (N m) of a window."""

    def energy(self, motion: Motion) -> Float[Array, ""]:
        """Return the energy that a window stores (J)."""
        return jnp.zeros(())

    def working(self, motion: Motion) -> Float[Array, "k b"] | None:
        """Return the force on each node (N, N m) whose work ``energy`` does not store.

        None where it stores the work of all.
        """
        return -self.residual(motion)


class Linearised(Element):
    """A force law with a tangent matrix of its own, where that is measured to be faster.

    At the start of a motion, where only accelerations are sought, ``residual`` is differentiated
    all the same.
    """

    @abstractmethod
    def jacobian(self, motion: Motion, course: Course) -> Float[Array, "k b k b"]:
        """Return d(residual)/d(correction) of a window."""
