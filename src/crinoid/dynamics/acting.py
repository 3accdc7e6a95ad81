"""Forces that act in a context: residual, motion of all rows, gaps of contacts."""

from dataclasses import fields, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.dynamics import windows
from crinoid.dynamics.arm import Arm, prepared
from crinoid.dynamics.contact_group import ContactGroup
from crinoid.dynamics.context import Context
from crinoid.dynamics.forces import Forces, Points
from crinoid.dynamics.free_bodies import FreeBodies
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import BOUNDARY_NODES, CENTRE, ROTATION, VEHICLE_ROWS, Rows
from crinoid.dynamics.vehicle import VehicleKinematics, unknowns
from crinoid.dynamics.windows import Surroundings
from crinoid.elements import Motion, Pose, VehiclePose
from crinoid.elements.soft_skin import rows_of
from crinoid.flow import Current, Water
from crinoid.numerics import banded


class ActingForces(Forces):
    """All forces on an arm and on the bodies around it, in a context.

    The larger methods are compiled functions, traced once and not at each call in a program.
    """

    context: Context = eqx.field(kw_only=True)
    held: tuple[windows.Held, ...] = eqx.field(kw_only=True)
    """Memory of the elements, prepared for the step."""

    @staticmethod
    def of(forces: Forces, context: Context) -> "ActingForces":
        """Return the forces in a context."""
        laws = {each.name: getattr(forces, each.name) for each in fields(Forces)}
        held = prepared(forces.elements, context)
        return ActingForces(**laws, context=replace(context, memory=(), step=None), held=held)

    @property
    def arm(self) -> Arm:
        """The elements, each with its memory."""
        return Arm(tuple(zip(self.elements, self.held, strict=True)))

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the obstacles that are free, and not held."""
        return () if self.context.frozen_at is not None else super().free

    @property
    def moving_bodies(self) -> FreeBodies | None:
        """The free obstacles, unless they are held."""
        return self.obstacles.bodies if self.free and self.obstacles is not None else None

    @property
    def pose(self) -> Pose | None:
        """Attitude of the obstacles at the start of the step, where some are free."""
        if self.obstacles is None or self.obstacles.bodies is None:
            return None
        return self.context.pose or Pose.unturned(self.obstacles.count, self.axes)

    @property
    def heading(self) -> VehiclePose | None:
        """Attitude of a floating vehicle at the start of the step."""
        if self.vehicle is None:
            return None
        return self.context.heading or VehiclePose.at_start(self.axes)

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
        if self.context.clamp is not None:
            parts.append(jnp.stack([rows[CENTRE], factors[-1] * rows[ROTATION]]))
        return parts[0] if len(parts) == 1 else jnp.concatenate(parts)

    @property
    def reach(self) -> Float[Array, " body"]:
        """Radii of gyration of the free obstacles and of the vehicle (m)."""
        found = []
        if (bodies := self.moving_bodies) is not None:
            found.append(bodies.body.reach)
        if self.vehicle is not None:
            found.append(self.vehicle.reach[None])
        return jnp.concatenate(found) if found else jnp.zeros(0)

    def body_unknowns(self, size: int) -> tuple[int, ...]:
        """Return the indices of unknowns of free bodies, in rows of ``size`` after the nodes."""
        return () if self.moving_bodies is None else self.moving_bodies.unknowns(size)

    def extra(self, size: int) -> tuple[int, ...]:
        """Return the indices of unknowns of free bodies and a vehicle, likewise."""
        if self.context.clamp is None:
            return self.body_unknowns(size)
        first = 0 if self.obstacles is None else self.obstacles.rows
        own = (first * size + i for i in unknowns(self.axes, size))
        return (*self.body_unknowns(size), *own)

    def attitude(self, rows: Rows) -> Float[Array, "d d"] | None:
        """Return the attitude of a moving vehicle from the positions of all rows."""
        if self.context.clamp is None or self.heading is None:
            return None
        return self.heading.attitude_at(rows[ROTATION])

    def obstacle_attitude(self, motion: Motion) -> Float[Array, "m d d"] | None:
        """Return the attitude of the obstacles, if some are free."""
        if self.pose is None:
            return None
        rotations = motion.position[self.rows.rotations]
        return jax.vmap(lambda pose, row: pose.attitude_at(row))(self.pose, rotations)

    def near_contacts(self, rows: Rows) -> list[ContactGroup]:
        """Return the contacts of obstacles with edges, on the rows of an array."""
        if self.obstacles is None:
            return []
        return self.obstacles.groups(self.num_nodes(rows), self.pose)

    def body_contacts(self, rows: Rows) -> list[ContactGroup]:
        """Return the contacts of free obstacles with other ones, on the rows of an array."""
        if self.obstacles is None or self.obstacles.bodies is None or self.pose is None:
            return []
        return self.obstacles.bodies.groups(self.num_nodes(rows), self.pose)

    def groups(self, rows: Rows) -> list[windows.LawGroup]:
        """Return all laws on the rows of an array, in groups, without contacts of far parts."""
        found = [*windows.groups(self.arm.laws, self.axes), *self.near_contacts(rows)]
        if (bodies := self.moving_bodies) is not None:
            assert self.pose is not None
            found.append(bodies.law(self.num_nodes(rows), self.pose))
            found += self.body_contacts(rows)
        return found

    def gaps(self, rows: Rows) -> Float[Array, "m e"] | None:
        """Return the distance of each obstacle from each edge (m)."""
        if self.obstacles is None:
            return None
        return self.obstacles.by_obstacle([each.gaps(rows) for each in self.near_contacts(rows)])

    def body_gaps(self, rows: Rows) -> Float[Array, " pair"] | None:
        """Return the gap of each pair of a free obstacle with another one (m)."""
        if self.obstacles is None or self.obstacles.bodies is None:
            return None
        gaps = [each.gaps(rows) for each in self.body_contacts(rows)]
        return jnp.concatenate([jnp.zeros(0), *gaps])

    def far_gaps(self, rows: Rows) -> tuple[Array, ...]:
        """Return the gaps of the contacts of far parts (m)."""
        return tuple(each.gaps(rows, self.heading) for each in self.far_contacts)

    def touches(self, rows: Rows) -> Bool[Array, ""]:
        """Return whether far parts are in contact."""
        gaps = zip(self.far_contacts, self.far_gaps(rows), strict=True)
        return jnp.any(jnp.stack([jnp.any(gap < far.contact.skin) for far, gap in gaps]))

    @eqx.filter_jit
    def surroundings(self, stage: StepMap, correction: Rows) -> Surroundings:
        """Return the water around the rows for a correction."""
        position = self._points(stage.position + stage.by_position * correction)
        frozen_at = self.context.frozen_at
        sea = self.water if frozen_at is None else Water(self.water.flows, frozen_at)

        def current(point: Float[Array, " d"]) -> Current:
            return sea.current(self.origin + point, stage.time)

        water, slope = jax.vmap(current)(position), None
        # needed for an equilibrium only
        if frozen_at is not None:
            slope = jax.vmap(jax.jacfwd(lambda point: current(point).acceleration))(position)
        velocity, acceleration = water.velocity, water.acceleration
        return Surroundings(position, velocity, acceleration, water.velocity_slope, slope)

    @eqx.filter_jit
    def motion(self, stage: StepMap, correction: Rows, around: Surroundings) -> Motion:
        """Return the motion of all rows and of the water there, for a correction."""
        rows = (
            stage.position + stage.by_position * correction,
            stage.velocity + stage.by_velocity * correction,
            stage.acceleration + stage.by_acceleration * correction,
        )
        return self.moving_rows(stage, rows, around)

    def moving_rows(self, stage: StepMap, rows: tuple[Rows, ...], around: Surroundings) -> Motion:
        """Return the motion from all rows except those clamped on a vehicle."""
        position, velocity, acceleration = rows
        frames, clamp = stage.frames, self.context.clamp
        if clamp is not None:
            held = self._kinematics(rows).to_world(clamp, frames)
            position, velocity, acceleration = (
                banded.with_first_rows(first, row) for row, first in zip(rows, held, strict=True)
            )
        motion = Motion(
            position,
            velocity,
            acceleration,
            *around.at(self._points(position)),
            stage.time,
            None if frames is None else frames.at(self.nodes(position)),
            self.context.drive,
        )
        if self.lines is None:
            return motion
        return replace(motion, line=self.lines.loads(self.arm, motion))

    @eqx.filter_jit
    def residual(
        self, motion: Motion, load_factor: Array | None = None
    ) -> tuple[Rows, Float[Array, " b"]]:
        """Return the residual of each row, and the largest single force in it of each column (N).

        The column of spins has torques (N m).
        """
        shape = motion.position.shape
        total, largest = jnp.zeros(shape), jnp.zeros(shape[1])

        def added(group: windows.LawGroup) -> tuple[Rows, Float[Array, " b"]]:
            forces = group.residuals(motion, load_factor)
            most = jnp.max(jnp.abs(forces[:, :, group.balanced]), axis=(0, 1, 2))
            rows = group.scatter(jnp.sum(forces, axis=1), shape)
            return rows, jnp.pad(most, (0, shape[1] - most.size))

        found = [added(group) for group in self.groups(motion.position)]
        found += [far.where_pressing(motion, self.heading, added) for far in self.far_contacts]
        for rows, most in found:
            total, largest = total + rows, jnp.maximum(largest, most)
        if self.context.clamp is not None:
            pushed = self.on_vehicle(motion, total[:BOUNDARY_NODES])
            total = jnp.concatenate([total[:-VEHICLE_ROWS], pushed])
        return total, largest

    def on_vehicle(
        self, motion: Motion, held: Float[Array, "held b"], *, alone: bool = True
    ) -> Float[Array, "2 b"]:
        """Return the residual of the vehicle's rows for forces on the clamp.

        Without the forces on the vehicle ``alone`` it is linear in these.
        """
        vehicle, clamp = self.vehicle, self.context.clamp
        assert vehicle is not None
        assert clamp is not None
        kinematics = self._kinematics(rows_of_motion(motion))
        force, moment = kinematics.resultant(clamp, held)
        if alone:
            own = vehicle.residual(
                kinematics, motion.flow_velocity[CENTRE], motion.flow_acceleration[CENTRE]
            )
            force, moment = force + own[0], moment + own[1]
        width = held.shape[1]
        return jnp.concatenate([rows_of(force, width), rows_of(moment, width)])

    def _kinematics(self, rows: tuple[Rows, ...]) -> VehicleKinematics:
        """Return the motion of the vehicle from position, velocity and acceleration of all rows."""
        attitude, heading = self.attitude(rows[0]), self.heading
        assert attitude is not None
        assert heading is not None
        return VehicleKinematics.of(attitude, heading.turn.size, *rows)

    def _points(self, rows: Rows) -> Points:
        """Return the position of each row; that of a rotation is the centre of mass."""
        points = rows[:, : self.axes]
        if self.turns:
            points = points.at[self.rows.rotations].set(points[self.rows.obstacles])
        return points if self.vehicle is None else points.at[ROTATION].set(points[CENTRE])


def rows_of_motion(motion: Motion) -> tuple[Any, Any, Any]:
    """Return position, velocity and acceleration of all rows."""
    return motion.position, motion.velocity, motion.acceleration
