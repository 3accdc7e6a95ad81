"""Element: a force law on a few consecutive nodes, the interface of physics and numerics."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.numerics.frames import Orientation, cross, dot

ENERGIES = ("kinetic", "elastic", "potential")
"""Stored energies of the balance."""
WORKS = ("drag", "damping", "actuation", "loads", "added_mass", "tool", "contact")
"""Works of the balance: their sum equals the change of the stored energies."""


class Motion(eqx.Module):
    """Motion of ``k`` nodes and of the water there. SI units.

    The arrays have a leading axis, ``count``, for all windows of an element together. A node has
    ``b`` coordinates: its position along ``d`` axes and, in space, the spin: the angle by which the
    edge that ends at it has turned about its axis (rad).

    Attributes
    ----------
    position
        Positions (m), relative to the base's set position, and spins (rad).
    velocity
        Velocities (m/s, rad/s).
    acceleration
        Accelerations (m/s2, rad/s2).
    flow_velocity
        Velocity of the undisturbed water at the nodes (m/s).
    flow_acceleration
        Material acceleration Du/Dt of the undisturbed water at the nodes (m/s2).
    time
        Time (s).
    orientation
        Orientation of the edges in space; None for elements without spins.
    drive
        Drives of the actuators (`crinoid.Actuator`), each in its unit.
    line
        Loads of lines (``crinoid.dynamics.lines``): tensions (N), pressures (Pa).
    memory
        What the law of a window remembers (`Element.prepared`); None in an equilibrium.
    step
        Length of the step since that memory (s).

    Examples
    --------
    Node 0 is the ghost behind the root:

    >>> motion = crinoid.system("still-water").rest().motion
    >>> motion.position[:3].round(3).tolist()
    [[-0.025, 0.0], [0.0, 0.0], [0.025, 0.0]]
    """

    position: Float[Array, "*count k b"]
    velocity: Float[Array, "*count k b"]
    acceleration: Float[Array, "*count k b"]
    flow_velocity: Float[Array, "*count k d"]
    flow_acceleration: Float[Array, "*count k d"]
    time: Float[Array, "*count"]
    orientation: Orientation | None = None
    drive: Float[Array, "*count drive"] | None = None
    line: Float[Array, "*count line"] | None = None
    memory: Any = None
    step: Float[Array, "*count"] | None = None

    def remembering(self, memory: Any, step: Array | None) -> "Motion":
        """Return the motion of a window whose law has a memory."""
        return replace(self, memory=memory, step=step)

    def windows(
        self,
        take: Callable[[Array], Array],
        count: tuple[int, ...],
        width: int,
        *,
        oriented: bool = False,
    ) -> "Motion":
        """Return the motion of ``count`` windows, which ``take`` cuts from the rows of an array.

        With the first ``width`` coordinates, and the orientation of the edges if ``oriented``.
        """
        parts = [rows[:, :width] for rows in (self.position, self.velocity, self.acceleration)]
        parts += [self.flow_velocity, self.flow_acceleration]
        if oriented and (edges := self.orientation) is not None:
            nodes = edges.twist.shape[0]  # other bodies have rows too, but no edges
            parts = [part[:nodes] for part in parts]
            parts += [edges.director, edges.twist[:, None], edges.lean]
        # one slice for all fields: less to compile
        sizes = [part.shape[1] for part in parts]
        cut = jax.lax.split(taken := take(jnp.concatenate(parts, axis=1)), sizes, taken.ndim - 1)
        orientation = Orientation(cut[5], cut[6][..., 0], cut[7]) if len(cut) > 5 else None
        drive, line = (
            None if all_ is None else jnp.broadcast_to(all_, (*count, all_.size))
            for all_ in (self.drive, self.line)
        )
        time = jnp.broadcast_to(self.time, count)
        return Motion(cut[0], cut[1], cut[2], cut[3], cut[4], time, orientation, drive, line)


class TangentDirection(eqx.Module):
    """Direction of a tangent: change of the motion of a window per correction of its nodes."""

    by_position: Float[Array, "*count"]
    """Change of the positions over the correction (1)."""
    by_velocity: Float[Array, "*count"]
    """Change of the velocities over the correction (1/s)."""
    by_acceleration: Float[Array, "*count"]
    """Change of the accelerations over the correction (1/s2)."""
    velocity_slope: Float[Array, "*count k d d"]
    """Derivative of the water's velocity along the axes of space, the last index (1/s)."""
    acceleration_slope: Float[Array, "*count k d d"] | None = None
    """Derivative of its material acceleration (1/s2); None if it is omitted."""
    fixed_fields: tuple[str, ...] = eqx.field(static=True, default=())
    """Fields that no correction changes, of position and velocity."""

    def derivative(
        self,
        quantity: Callable[[Motion], Float[Array, "..."]],
        motion: Motion,
        direction: Float[Array, "k b"],
    ) -> Float[Array, "..."]:
        """Return the derivative of a quantity for a correction of the nodes along ``direction``."""
        change = self._tangent(motion, direction)
        changes = jax.tree.map(lambda x: x is not None, change, is_leaf=lambda x: x is None)
        moving, still = eqx.partition(motion, changes)
        return jax.jvp(lambda m: quantity(eqx.combine(m, still)), (moving,), (change,))[1]

    def _tangent(self, motion: Motion, direction: Float[Array, "k b"]) -> Motion:
        """Return the change of the motion, with None for unchanged fields."""
        changes = {"acceleration": self.by_acceleration * direction}
        if "velocity" not in self.fixed_fields:
            changes["velocity"] = self.by_velocity * direction
        if "position" not in self.fixed_fields:
            moved = self.by_position * direction
            changes["position"] = moved
            flows = moved[:, None, : motion.flow_velocity.shape[-1]]
            changes["flow_velocity"] = jnp.sum(self.velocity_slope * flows, axis=-1)
            if self.acceleration_slope is not None:
                changes["flow_acceleration"] = jnp.sum(self.acceleration_slope * flows, axis=-1)
            if motion.orientation is not None:
                turned = _turning(motion, moved)
                changes["orientation.director"], changes["orientation.twist"] = turned
        still = jax.tree.map(lambda _: None, motion)
        return eqx.tree_at(
            lambda m: [attrgetter(name)(m) for name in changes],
            still,
            list(changes.values()),
            is_leaf=lambda x: x is None,
        )


def _turning(
    motion: Motion, moved: Float[Array, "k b"]
) -> tuple[Float[Array, "k 3"], Float[Array, " k"]]:
    """Return the change of the directors of a window, and of the twists between its edges.

    The twist changes by the spins, and by ``1/2 k . (dt_a + dt_b)`` as the tangents turn, with the
    binormal ``k`` (Bergou et al. 2008, section 6).
    """
    assert motion.orientation is not None
    # the edge that ends at the first node is not in the window
    edge, moving = jnp.diff(motion.position[:, :3], axis=0), jnp.diff(moved[:, :3], axis=0)
    length = jnp.sqrt(dot(edge, edge))[:, None]
    tangent, director = edge / length, motion.orientation.director[1:]
    turning = (moving - dot(moving, tangent)[:, None] * tangent) / length
    spin = moved[1:, 3] + dot(motion.orientation.lean[1:], turning)
    swept = spin[:, None] * cross(tangent, director) - dot(director, turning)[:, None] * tangent
    before, after = tangent[:-1], tangent[1:]
    half = cross(before, after) / (1.0 + dot(before, after))[:, None]
    twisted = jnp.diff(spin) + dot(half, turning[:-1] + turning[1:])
    return jnp.pad(swept, ((1, 0), (0, 0))), jnp.pad(twisted, 1)[: moved.shape[0]]


class Law(eqx.Module):
    """A force law on windows of rows: of nodes, and of other bodies.

    Every field that is an array has the windows as its leading axis, if `window_axes` does not
    except it; the methods see one window, without that axis. The equation of motion is that the
    residuals of all laws add up to zero: ``M a + (internal forces) - (external forces) = 0``.
    Their tangent matrix follows by forward-mode differentiation.
    """

    spins: ClassVar[bool] = False
    """Whether it depends on the spin of edges in space; if not, it sees positions only."""
    relative: ClassVar[bool] = False
    """Whether it depends only on how its rows lie and move relative to each other."""
    balanced: ClassVar[slice] = slice(None)
    """Rows of a window whose forces count as those of the balance."""
    external: ClassVar[bool] = False
    """Whether it is an external force, which a static solve may apply in steps."""

    @abstractmethod
    def residual(self, motion: Motion) -> Float[Array, "k b"]:
        """Return minus the force on each row (N) and about each edge (N m) of a window."""

    @property
    def window_axes(self) -> Any:
        """Axes of its arrays along the windows, as for `jax.vmap`."""
        return 0


class Element(Law):
    """A force law that repeats along the arm, on windows of ``stencil`` consecutive nodes.

    Every field that is an array has the windows as its leading axis; the methods see one window,
    without that axis. Only ``residual`` affects the motion; ``energy`` and ``working`` serve the
    energy balance.

    A force law with a *memory*, such as a material that relaxes, also has the methods ``steady``
    and ``advance``. All methods then read the memory at the start of a time step from
    ``motion.memory``, and the length of the step (s) from ``motion.step``: both are None in an
    equilibrium and in its stiffness. The memory is any pytree of floats and follows from the motion
    at the end of the step, so it adds no unknowns.

    Examples
    --------
    A constant force at the tip of an arm of 5 nodes:

    >>> import equinox as eqx
    >>> class TipForce(crinoid.Element):
    ...     first: int = eqx.field(static=True)
    ...     force: jax.Array
    ...     stencil = 1
    ...
    ...     def residual(self, motion):
    ...         return -self.force
    >>> pull = TipForce(5, jnp.array([[[0.0, -0.1]]]))  # one window of one node (N)
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "control.start=0"])
    >>> session = crinoid.Session(scenario, elements=[pull])
    >>> session.seen.measured[:2].round(2).tolist()  # x, z (m)
    [0.48, -9.88]
    """

    stencil: ClassVar[int]
    """Number of consecutive nodes in a window (1 to 3)."""
    stored: ClassVar[str] = "potential"
    """Name in `crinoid.elements.ENERGIES` under which ``energy`` counts."""
    worked: ClassVar[str] = "loads"
    """Name in `crinoid.elements.WORKS` under which the work of ``working`` counts."""

    first: eqx.AbstractVar[int]
    """Node at which the first window starts; node 0 is the ghost behind the root."""

    def energy(self, motion: Motion) -> Float[Array, ""]:
        """Return the energy that a window stores (J)."""
        return jnp.zeros(())

    def working(self, motion: Motion) -> Float[Array, "k b"] | None:
        """Return the force on each node (N, N m) whose work ``energy`` does not store.

        None if it stores all work.
        """
        return -self.residual(motion)

    def prepared(self, memory: Any, step: Float[Array, "*count"]) -> Any:
        """Return ``motion.memory`` of a step from the memory at its start, of all windows.

        Once a step: for what does not depend on the motion in it.
        """
        return memory

    @property
    def remembers(self) -> bool:
        """Whether it has a memory."""
        return type(self).steady is not Element.steady

    def steady(self, motion: Motion) -> Any:
        """Return the memory of a window at the start of a run; None for a law without memory."""
        return None

    def advance(self, motion: Motion) -> Any:
        """Return the memory of a window at the end of the step, from the motion there.

        A step of length 0 changes nothing.
        """
        return None
