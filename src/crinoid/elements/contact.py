"""Contact of the arm with rigid bodies."""

from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.elements.element import Motion
from crinoid.elements.soft_skin import SoftSkin, closest_of_cores, rows_of, size, surfaces
from crinoid.foundation.fixed_numbers import EASE, SKIN
from crinoid.numerics.frames import cross, moments, rotation_velocity, unit
from crinoid.numerics.small_matrices import product
from crinoid.rod import Rod


class Ball(NamedTuple):
    """Ball around the centre of mass of a tool at the tip, by which it touches. SI units."""

    radius: Float[Array, ""]
    offset: Float[Array, ""]
    """Distance of its centre beyond the tip (m)."""
    mass: Float[Array, ""]


class Contact(SoftSkin):
    """Contact of an edge, a capsule as thick as the arm, with one obstacle.

    A window has the two nodes of the edge and the obstacle's position. The obstacle is a sphere, a
    capsule whose core extends ``half_axis`` to both sides of its position (a cylinder has a very
    long core), or the half space behind a plane.

    The gap ``g`` is the least distance of the surfaces. Within a skin ``d``, a twentieth of the
    radius outside the arm's surface, a force ``F (1 - g / d)^4`` keeps them apart, the gradient of
    a potential: soft at first, and by far strong enough before the surfaces meet, where it is
    ``F = 32 E r^2``, with the modulus ``E`` that bends the arm.

    Where the point of least distance would jump from end to end of the edge, as for an arm that
    lies flat on a plane, it is drawn to the middle: the distance is the root of
    ``min_s |x(s) - c|^2 + EASE |e|^2 (s - 1/2)^2``. So its gradient is continuous, and the force
    does not change the momentum or the angular momentum of the two.

    A rough surface also damps: a dashpot ``2 SKIN_DAMPING sqrt(k m)``, by the skin's stiffness
    ``k`` at this depth and the reduced mass, acts against the rate of the gap and never pulls.
    Without it the skin chatters under an arm that slides.

    Friction is Coulomb's, ``-mu N v / sqrt(v^2 + creep^2)`` with the sliding velocity ``v`` of
    the surfaces: zero at rest, so a body that sticks creeps by less than 1 mm/s. It acts on the
    arm's surface, where the rotation of the edge adds to the velocity; its moment about the axis is
    a couple on the ends of the edge and, in space, a torque about it.

    Near free bodies, which turn, a window has a fourth row, the obstacle's rotation, and the memory
    is the obstacle's `Pose`, in whose axes ``half_axis`` then is. Friction sees its spin too, and
    acts on both at one point, on the arm's surface.

    The ball of a tool is a further window of the last edge: its centre is in the place of the
    nearest point of the axis, and the force there acts on the nodes as on a rigid lever.
    """

    spins: ClassVar[bool] = True
    balanced: ClassVar[slice] = slice(3)
    rest_length: Float[Array, "*count"]
    arm_radius: Float[Array, "*count"]
    strength: Float[Array, "*count"]
    """Force where the surfaces meet (N)."""
    radius: Float[Array, "*count"]
    half_axis: Float[Array, "*count d"]
    normal: Float[Array, "*count d"]
    """Outward normal of the half space; zero for round obstacles."""
    friction: Float[Array, "*count"]
    mass: Float[Array, "*count"]
    """Reduced mass of edge and obstacle (kg)."""
    ball: Bool[Array, "*count"] | None = None
    """Whether a window is that of the tool's ball; None without one."""
    beyond: Float[Array, "*count"] | None = None
    """Distance of the ball's centre beyond the tip, 0 of an edge (m)."""

    @staticmethod
    def of(
        rod: Rod,
        *,
        radius: Float[Array, " m"],
        half_axis: Float[Array, "m d"],
        normal: Float[Array, "m d"],
        friction: Float[Array, " m"],
        mass: Float[Array, " m"],
        tool: Ball | None = None,
    ) -> "Contact":
        """Pair every edge of a rod, and the ball of its tool, with every one of ``m`` obstacles.

        ``radius`` and ``half_axis`` in m, ``mass`` in kg, infinite for an immovable obstacle.
        """
        arm_radius, strength = surfaces(rod)
        rest_length, edge_mass = rod.rest_length, rod.edge_mass[:, 1]
        ball = beyond = None
        if tool is not None:
            edge_mass = jnp.append(edge_mass, edge_mass[-1] + tool.mass)
            beyond = jnp.append(jnp.zeros_like(arm_radius), tool.offset)
            ball = jnp.arange(beyond.size) == arm_radius.size
            arm_radius = jnp.append(arm_radius, tool.radius)
            rest_length, strength = (jnp.append(x, x[-1]) for x in (rest_length, strength))
        edges, obstacles = arm_radius.shape[0], radius.shape[0]

        def per_edge(values: Array) -> Array:
            return jnp.tile(values, obstacles)

        def per_obstacle(values: Array) -> Array:
            return jnp.repeat(values, edges, axis=0)

        return Contact(
            rest_length=per_edge(rest_length),
            arm_radius=per_edge(arm_radius),
            strength=per_edge(strength),
            radius=per_obstacle(radius),
            half_axis=per_obstacle(half_axis),
            normal=per_obstacle(normal),
            friction=per_obstacle(friction),
            mass=1 / (1 / per_edge(edge_mass) + 1 / per_obstacle(mass)),
            ball=None if ball is None else per_edge(ball),
            beyond=None if beyond is None else per_edge(beyond),
        )

    @property
    def axes(self) -> int:
        """Number of axes of a position; a further column of a row is an edge's spin."""
        return self.half_axis.shape[-1]

    @property
    def skin(self) -> Float[Array, "*count"]:
        """Distance from the arm's surface at which contact begins (m)."""
        return SKIN * self.arm_radius

    @property
    def between_axes(self) -> Float[Array, "*count"]:
        return self.arm_radius + self.radius

    def travel(self, moved: Float[Array, "k b"]) -> Float[Array, ""]:
        places = moved[:3, : self.axes]
        ends = places[:2]
        if self.beyond is not None:
            share = self.beyond / self.rest_length
            ends = jnp.concatenate([ends, (ends[1] + share * (ends[1] - ends[0]))[None]])
        travel = jnp.max(size(ends - places[2]))
        return travel + sum(size(self.half_axis) * size(turn) for turn in moved[3:])

    def gap(self, position: Float[Array, "k b"], pose: Any) -> Float[Array, ""]:
        half = self.half_axis
        if pose is not None:
            half = product(pose.attitude_at(position[3]), half)
        return self._touching(position[:3, : self.axes], half)[0]

    def residual(self, motion: Motion) -> Float[Array, "k b"]:
        return -self.push(motion)[1]

    def push(self, motion: Motion) -> tuple[Float[Array, ""], Float[Array, "k b"]]:
        """Return the gap (m), and the forces on the two nodes and on the obstacle (N).

        In space the last column of the far node's row is the torque about the edge (N m). The row
        of a rotation has the moment (N m).
        """
        places, velocity = motion.position[:3, : self.axes], motion.velocity[:3, : self.axes]
        body, half = None, self.half_axis
        if motion.memory is not None:
            body = motion.memory.motion(motion.position[2:], motion.velocity[2:])
            half = product(body.attitude, half)
        gap, slopes, share, by_half = self._touching(places, half)
        rate = jnp.sum(slopes * velocity)
        if body is not None:
            rate += product(by_half, rotation_velocity(body.spin, half))
        pressing = self.damped(gap, rate)
        edge, length = unit(places[1] - places[0])
        outward, _ = unit(-slopes[2])
        lever = -self.arm_radius * outward
        if self.beyond is not None:
            lever = lever + self.beyond * edge
        at_axis = jnp.stack([1 - share, share])
        # the edge turns at the rate edge x change: (e x c) x l = c (e . l) - e (c . l)
        change = (velocity[1] - velocity[0]) / length
        turning = change * product(edge, lever) - edge * product(change, lever)
        sliding = product(at_axis, velocity[:2]) + turning - velocity[2]
        spins = motion.position.shape[-1] > self.axes
        if spins:
            around = cross(edge, lever)
            sliding = sliding + motion.velocity[1, -1] * around
        if body is not None:
            reach = product(at_axis, places[:2]) + lever - places[2]
            sliding = sliding - rotation_velocity(body.spin, reach)
        sliding = sliding - product(sliding, outward) * outward
        rubbing = self.rubbing(pressing, sliding)
        # likewise the moment lever x rubbing, without its part about the edge
        couple = (rubbing * product(edge, lever) - lever * product(edge, rubbing)) / length
        rubbed = jnp.stack([at_axis[0] * rubbing - couple, at_axis[1] * rubbing + couple, -rubbing])
        forces = pressing * slopes + rubbed
        if spins:
            torque = jnp.stack([0 * gap, product(rubbing, around), 0 * gap])
            forces = jnp.concatenate([forces, torque[:, None]], axis=1)
        if body is not None:
            moment = moments(half, pressing * by_half) - moments(reach, rubbing)
            forces = jnp.concatenate([forces, rows_of(moment, forces.shape[1])])
        return gap, forces

    def _touching(
        self, position: Float[Array, "3 d"], half_axis: Float[Array, " d"]
    ) -> tuple[Array, Array, Array, Array]:
        """Return the same as `_closest`, of the edge or of the tool's ball."""
        if self.ball is None or self.beyond is None:
            return self._closest(position, half_axis)
        edge, length = unit(position[1] - position[0])
        centre = position[1] + self.beyond * edge
        places = jnp.where(self.ball, centre, position[:2])
        gap, slopes, share, by_half = self._closest(
            jnp.concatenate([places, position[2:]]), half_axis
        )
        push = slopes[0] + slopes[1]
        couple = self.beyond / length * (push - product(push, edge) * edge)
        on_ball = jnp.stack([-couple, push + couple, slopes[2]])
        return gap, jnp.where(self.ball, on_ball, slopes), jnp.where(self.ball, 1.0, share), by_half

    def _closest(
        self, position: Float[Array, "3 d"], half_axis: Float[Array, " d"]
    ) -> tuple[Array, Array, Array, Array]:
        """Return the gap, its gradient by the three positions, and its place along the edge.

        The last one is the gradient by the half axis of the obstacle.
        """
        near, far, place = position
        edge, apart = far - near, near - place
        flat = jnp.any(self.normal != 0)

        rise = product(self.normal, edge)
        pull = EASE * self.rest_length
        share_flat = jnp.clip(0.5 - rise / pull, 0.0, 1.0)
        height = (
            product(self.normal, apart) + share_flat * rise + 0.5 * pull * (share_flat - 0.5) ** 2
        )
        weights = jnp.stack([1 - share_flat, share_flat, -jnp.ones_like(share_flat)])
        slopes_flat = weights[:, None] * self.normal

        share, along = closest_of_cores(edge, half_axis, apart)
        off = share - 0.5
        between = apart + share * edge - along * half_axis
        eased = EASE * off**2 * edge
        # a plane has no distance from its position: keep the unused branch finite
        distance = jnp.sqrt(
            product(between, between) + product(eased, edge) + jnp.finfo(float).tiny
        )
        slopes = jnp.stack([(1 - share) * between - eased, share * between + eased, -between])

        return (
            jnp.where(flat, height, distance - self.radius) - self.arm_radius,
            jnp.where(flat, slopes_flat, slopes / distance),
            jnp.where(flat, share_flat, share),
            jnp.where(flat, 0.0, -along * between / distance),
        )
