"""Contact of the arm with the hull of its vehicle: a capsule that moves with the vehicle."""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Motion
from crinoid.elements.rigid import VehiclePose
from crinoid.elements.self_contact import carried
from crinoid.elements.soft_skin import SoftSkin, closest_of_cores, size, surfaces
from crinoid.foundation.fixed_numbers import EASE, SKIN
from crinoid.numerics.frames import cross, rotate_90, rotation_velocity, unit
from crinoid.numerics.small_matrices import product
from crinoid.rod import Rod


class HullContact(SoftSkin):
    """Contact of an edge with a rigid capsule behind the root of the arm.

    A window has the two nodes of the edge, ghost node and root, which are two points of the hull's
    axis: one behind its nose, and its nose. On a floating vehicle, to which channels may move the
    root, the vehicle's two rows follow, and the memory is its `VehiclePose`. The force law is that
    of `Contact`, friction included.

    The forces on the edge act back on the hull. The window has this reaction, force and moment, as
    forces on ghost node and root, which the vehicle holds, so both momenta are kept.
    """

    spins: ClassVar[bool] = True
    balanced: ClassVar[slice] = slice(2)  # a reaction at the clamp has a short lever
    arm_radius: Float[Array, "*count"]
    """Radius of the edge (m)."""
    strength: Float[Array, "*count"]
    friction: Float[Array, "*count"]
    mass: Float[Array, "*count"]
    length: Float[Array, "*count"]
    """Length of the hull from end to end (m)."""
    radius: Float[Array, "*count"]
    """Radius of the hull (m)."""
    axis: Float[Array, "*count 2 d"] | None = None
    """Both points of its axis from the centre of mass, in the axes of a floating vehicle (m)."""

    @staticmethod
    def of(
        rod: Rod,
        first: int,
        *,
        length: Float[Array, ""],
        diameter: Float[Array, ""],
        friction: Float[Array, ""],
        mass: Float[Array, ""],
        axis: Float[Array, "2 d"] | None = None,
    ) -> "HullContact":
        """Pair the edges of a rod from ``first`` on with a hull.

        ``length`` and ``diameter`` (m) are those of the hull, ``mass`` (kg) that of the vehicle,
        infinite for a prescribed motion.
        """
        arm_radius, strength = surfaces(rod)
        edge_mass = rod.edge_mass[first:, 1]
        same = (jnp.broadcast_to(x, edge_mass.shape) for x in (friction, length, diameter / 2))
        rubs, long, radius = same
        return HullContact(
            arm_radius[first:],
            strength[first:],
            rubs,
            1 / (1 / edge_mass + 1 / mass),
            long,
            radius,
            None if axis is None else jnp.broadcast_to(axis, (*edge_mass.shape, *axis.shape)),
        )

    @property
    def skin(self) -> Float[Array, "*count"]:
        return SKIN * self.arm_radius

    @property
    def between_axes(self) -> Float[Array, "*count"]:
        return self.arm_radius + self.radius

    def travel(self, moved: Float[Array, "k b"]) -> Float[Array, ""]:
        # of a hull that turns little in a step: root, or centre of mass
        places = moved[:, :3]
        return jnp.max(size(places[:2] - places[3 if len(moved) == 4 else 4]))

    def gap(self, position: Float[Array, "k b"], pose: VehiclePose | None) -> Float[Array, ""]:
        return self._closest(position[:2, :3], self._points(position, pose))[0]

    def _points(
        self, position: Float[Array, "k b"], pose: VehiclePose | None
    ) -> Float[Array, "2 d"]:
        """Return both points of the hull's axis (m)."""
        places = position[:, :3]
        if self.axis is None or pose is None:
            return places[2:4]
        return places[4] + product(self.axis, pose.attitude_at(position[5]).T)

    def _moving(self, motion: Motion) -> Float[Array, "2 b"]:
        """Return the velocities of these points; in space also the spin about the axis."""
        velocity, pose = motion.velocity, motion.memory
        if self.axis is None or pose is None:
            return velocity[2:4]
        axes, rate = self.axis.shape[1], velocity[5, : pose.turn.size]
        attitude = pose.attitude_at(motion.position[5])
        moving = velocity[4, :axes] + product(rotation_velocity(rate, self.axis), attitude.T)
        if axes == 2:
            return moving
        forward, _ = unit(self.axis[1] - self.axis[0])
        return jnp.pad(moving, ((0, 0), (0, 1))).at[1, 3].set(product(rate, forward))

    def on_edge(self, motion: Motion) -> Float[Array, "2 b"]:
        """Return the forces on the two nodes (N); in space also the torque about the edge (N m)."""
        axes = motion.flow_velocity.shape[-1]
        ends, moving = motion.position[:2, :axes], self._moving(motion)
        axis = self._points(motion.position, motion.memory)
        gap, slopes, share, outward = self._closest(ends, axis)
        lever = -self.arm_radius * outward
        point = ends[0] + share * (ends[1] - ends[0]) + lever
        along, swing = carried(axis, jnp.ones(()), point - axis[1], moving), motion.velocity[:2]
        # the rate of the gap: the eased distance of a rigid hull depends on the relative motion
        at_nodes = jnp.stack([carried(axis, jnp.ones(()), end - axis[1], moving) for end in ends])
        pressing = self.damped(gap, jnp.sum(slopes * (swing[:, :axes] - at_nodes)))

        def slide(velocity: Float[Array, "2 b"]) -> Float[Array, " d"]:
            return carried(ends, share, lever, velocity) - along

        # the forces that do the work of friction, by the transpose of the sliding
        sliding, spread = jax.vjp(slide, swing)
        sliding = sliding - product(sliding, outward) * outward
        (rubbed,) = spread(self.rubbing(pressing, sliding))
        return rubbed.at[:, :axes].add(pressing * slopes)

    def residual(self, motion: Motion) -> Float[Array, "k b"]:
        """Return minus the forces on the edge, and minus the reaction on ghost node and root."""
        axes = motion.flow_velocity.shape[-1]
        places, pushed = motion.position[:, :axes], self.on_edge(motion)
        forces, levers = pushed[:, :axes], places[:2] - places[3]
        ghost = places[2] - places[3]
        far = product(ghost, ghost)
        if axes == 2:
            turns = levers[:, 0] * forces[:, 1] - levers[:, 1] * forces[:, 0]
            behind = jnp.sum(turns) * rotate_90(ghost) / far
        else:
            edge, _ = unit(places[1] - places[0])
            moment = jnp.sum(cross(levers, forces), axis=0) + pushed[1, axes] * edge
            behind = cross(moment, ghost) / far
        reaction = -jnp.stack([behind, jnp.sum(forces, axis=0) - behind])
        if axes == 3:
            about = product(moment, ghost) / jnp.sqrt(far)
            reaction = jnp.concatenate([reaction, jnp.stack([0 * about, about])[:, None]], axis=1)
        rest = jnp.zeros((motion.position.shape[0] - 4, pushed.shape[1]))
        return -jnp.concatenate([pushed, reaction, rest])

    def _closest(
        self, ends: Float[Array, "2 d"], axis: Float[Array, "2 d"]
    ) -> tuple[Array, Array, Array, Array]:
        """Return the gap, its gradient by the nodes, its place on the edge, and its direction.

        The direction is a unit vector from the hull's axis to the edge.
        """
        forward, _ = unit(axis[1] - axis[0])
        edge = ends[1] - ends[0]
        half = (0.5 * self.length - self.radius) * forward
        apart = ends[0] - axis[1] + 0.5 * self.length * forward
        share, along = closest_of_cores(edge, half, apart)
        off = share - 0.5
        between = apart + share * edge - along * half
        eased = EASE * off**2 * edge
        distance = jnp.sqrt(
            product(between, between) + product(eased, edge) + jnp.finfo(float).tiny
        )
        slopes = jnp.stack([(1 - share) * between - eased, share * between + eased]) / distance
        outward, _ = unit(between)
        return distance - self.arm_radius - self.radius, slopes, share, outward
