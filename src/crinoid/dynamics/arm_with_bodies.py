"""An arm in the water with the bodies around it: obstacles, vehicle, contacts of far parts."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.arm import Arm
from crinoid.dynamics.far_contact import FarContact
from crinoid.dynamics.obstacles import Obstacles
from crinoid.dynamics.rows import BOUNDARY_NODES, CENTRE, ROTATION, RowLayout
from crinoid.dynamics.threads import LengthControlledThreads
from crinoid.dynamics.vehicle import Mount, Vehicle, unknowns
from crinoid.elements import Motion
from crinoid.flow import Water

Rows = Float[Array, "rows b"]
Points = Float[Array, "rows d"]


class ArmWithBodies(Arm):
    """Elements of an arm, the water around them, obstacles, and a floating vehicle.

    ``origin`` (m) is the origin of the arm's coordinates in the world: small coordinates have small
    round-off at any depth.
    """

    water: Water
    origin: Float[Array, " d"]
    obstacles: Obstacles | None = None
    drive: Float[Array, " drive"] | None = None
    """Drives of the actuators, if there are any."""
    vehicle: Vehicle | None = None
    """The submarine, if it floats; otherwise the motion of the base is prescribed."""
    lines: LengthControlledThreads | None = None
    """Tendons of given length and chambers of given content among the elements."""
    mount: Mount | None = None
    """Clamp of the arm on a vehicle; None while the vehicle is held still."""
    far_contacts: tuple[FarContact, ...] = ()
    """Contact of the arm with itself and with the hull, where it counts."""

    @property
    def rows(self) -> RowLayout:
        """Rows of nodes, obstacles and vehicle."""
        count = 0 if self.obstacles is None else self.obstacles.count
        return RowLayout.of(count, turning=self.turns, vehicle=self.vehicle is not None)

    @property
    def turns(self) -> bool:
        """Whether some obstacles are free, so that all have a row for their rotation."""
        return self.obstacles is not None and self.obstacles.bodies is not None

    def nodes(self, rows: Rows) -> Float[Array, "n b"]:
        """Return the rows of the nodes."""
        return rows[self.rows.nodes]

    def unknown(self, rows: Rows, turn: Array | float = 1.0) -> Float[Array, "unknown b"]:
        """Return the rows of unknowns: free nodes, free obstacles, a vehicle.

        Rotations are scaled by ``turn``, one number for each as in ``reach``, or one for all.
        """
        parts = [self.nodes(rows)[BOUNDARY_NODES:]]
        factors = jnp.broadcast_to(turn, self.reach.shape)
        if self.free:
            parts.append(rows[self.free_rows])
            rotations = rows[self.rows.rotations][np.array(self.free, int)]
            parts.append(factors[: len(self.free), None] * rotations)
        if self.mount is not None:
            parts.append(jnp.stack([rows[CENTRE], factors[-1] * rows[ROTATION]]))
        return parts[0] if len(parts) == 1 else jnp.concatenate(parts)

    @property
    def reach(self) -> Float[Array, " body"]:
        """Radii of gyration of the free obstacles and of the vehicle (m)."""
        found = []
        if self.free and self.obstacles is not None and self.obstacles.bodies is not None:
            found.append(self.obstacles.bodies.body.reach)
        if self.vehicle is not None:
            found.append(self.vehicle.reach[None])
        return jnp.concatenate(found) if found else jnp.zeros(0)

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the free obstacles."""
        return () if self.obstacles is None else self.obstacles.free

    @property
    def free_rows(self) -> Int[np.ndarray, " f"]:
        """Rows of the free obstacles."""
        return self.rows.obstacle(np.array(self.free, int))

    def extra(self, size: int) -> tuple[int, ...]:
        """Return the indices of unknowns of free bodies, in rows of ``size`` after the nodes."""
        free: tuple[int, ...] = ()
        if self.free and self.obstacles is not None and self.obstacles.bodies is not None:
            free = self.obstacles.bodies.unknowns(size)
        if self.mount is None:
            return free
        first = 0 if self.obstacles is None else self.obstacles.rows
        return (*free, *(first * size + i for i in unknowns(self.axes, size)))

    @property
    def axes(self) -> int:
        """Number of axes of a position."""
        return self.origin.shape[0]

    def flow_velocity(self, points: Points, time: Array) -> Points:
        """Return the velocity of the water at points (m/s)."""
        return jax.vmap(lambda point: self.water.velocity(self.origin + point, time))(points)

    def attitude(self, rows: Rows) -> Float[Array, "d d"] | None:
        """Return the attitude of a moving vehicle from the positions of all rows."""
        return None if self.mount is None else self.mount.attitude_at(rows)

    def obstacle_attitude(self, motion: Motion) -> Float[Array, "m d d"] | None:
        """Return the attitude of the obstacles, if some are free."""
        if self.obstacles is None or self.obstacles.bodies is None:
            return None
        return self.obstacles.bodies.attitude(motion.position[self.rows.obstacle_rows])

    def body_gaps(self, rows: Rows) -> Float[Array, " pair"] | None:
        """Return the gap of each pair of a free obstacle with another one (m)."""
        if self.obstacles is None or self.obstacles.bodies is None:
            return None
        return self.obstacles.bodies.gaps(rows[self.rows.obstacle_rows])

    def gaps(self, rows: Rows) -> Float[Array, "m e"] | None:
        """Return the distance of each obstacle from each edge (m)."""
        if self.obstacles is None:
            return None
        return self.obstacles.gaps(rows[self.rows.arm_and_obstacles])

    def far_contacts_at(self, rows: Rows) -> tuple[FarContact, ...]:
        """Return the contacts of far parts for the positions of all rows."""
        attitude = self.attitude(rows) if self.far_contacts else None
        return tuple(each.turned(attitude) for each in self.far_contacts)

    def far_gaps(self, rows: Rows) -> tuple[Array, ...]:
        """Return the gaps of the contacts of far parts (m)."""
        return tuple(each.gaps(rows, self.axes) for each in self.far_contacts_at(rows))

    def touches(self, rows: Rows) -> Bool[Array, ""]:
        """Return whether far parts are in contact."""
        gaps = zip(self.far_contacts, self.far_gaps(rows), strict=True)
        return jnp.any(jnp.stack([jnp.any(gap < far.contact.skin) for far, gap in gaps]))
