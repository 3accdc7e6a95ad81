"""A submarine that floats: a rigid body that holds the arm and is pushed by it.

What floats has two rows in what a time step solves for, after all others: its centre of mass, and
its turn since the start of the step, in its own axes (one number in the plane). Its axes are those
of the world as long as it is not turned.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.base import Prescribed
from crinoid.elements import Motion
from crinoid.elements.geometry import smooth_speed, turned
from crinoid.frames import Frames, cross, dot, rotated
from crinoid.products import product

ROWS = 2
"""Rows of a vehicle: its centre of mass and its turn."""

Vector = Float[Array, " d"]
Turns = Float[Array, " turns"]
Held = Float[Array, "2 b"]
Rows = Float[Array, "rows b"]


class Mount(eqx.Module):
    """Where a vehicle holds the arm at the end of a step, and its attitude at the start."""

    held: Prescribed
    """Ghost node and root from the centre of mass, in the vehicle's axes."""
    attitude: Float[Array, "d d"]
    """Matrix from the vehicle's axes to the world's at the start of the step."""
    turn: Turns
    """Turn in the vehicle's row at the start of the step (rad)."""

    def ride(self, position: Rows, velocity: Rows, acceleration: Rows) -> "Ride":
        """Read how the vehicle moves from its rows, the last ones."""
        turns, axes = self.turn.size, self.attitude.shape[0]
        step = position[-1, :turns] - self.turn
        if axes == 2:
            cosine, sine = jnp.cos(step[0]), jnp.sin(step[0])
            turn = jnp.stack([jnp.stack([cosine, -sine]), jnp.stack([sine, cosine])])
        else:
            turn = rotated(jnp.eye(3), step).T
        return Ride(
            product(self.attitude, turn),
            position[-2, :axes],
            velocity[-2, :axes],
            acceleration[-2, :axes],
            velocity[-1, :turns],
            acceleration[-1, :turns],
        )


class Ride(eqx.Module):
    """How a vehicle moves: its centre of mass in the world, its turning in its own axes."""

    attitude: Float[Array, "d d"]
    position: Vector
    velocity: Vector
    acceleration: Vector
    rate: Turns
    """Angular velocity (rad/s)."""
    hastening: Turns
    """Angular acceleration (rad/s2)."""

    def carried(self, held: Prescribed, frames: Frames | None) -> tuple[Held, Held, Held]:
        """Return how the ghost node and the root move in the world that a mount holds."""
        axes = self.position.size
        place, speed, gain = held.position, held.velocity[:, :axes], held.acceleration[:, :axes]
        swing = swung(self.rate, place)
        moving = speed + swing
        hastened = gain + swung(self.rate, 2 * speed + swing) + swung(self.hastening, place)
        rows = [
            middle + product(vectors, self.attitude.T)
            for middle, vectors in (
                (self.position, place),
                (self.velocity, moving),
                (self.acceleration, hastened),
            )
        ]
        if held.frame is None:
            return rows[0], rows[1], rows[2]
        assert frames is not None
        tangent, director = held.frame[:2]
        lever = place[1] - place[0]
        swept = (speed[1] - speed[0]) / jnp.sqrt(dot(lever, lever))
        spins = (
            frames.spin_to(1, product(self.attitude, tangent), product(self.attitude, director)),
            held.velocity[1, 3] + dot(self.rate, tangent),
            held.acceleration[1, 3] + dot(self.hastening, tangent) + dot(self.rate, swept),
        )
        position, velocity, acceleration = (
            jnp.pad(row, ((0, 0), (0, 1))).at[1, 3].set(spin)
            for row, spin in zip(rows, spins, strict=True)
        )
        return position, velocity, acceleration

    def pushed(self, held: Prescribed, forces: Held) -> tuple[Vector, Turns]:
        """Return the force (N, in the world) and the moment (N m) of forces on the held nodes.

        The moment is about the centre of mass, in the vehicle's axes.
        """
        axes = self.position.size
        on_nodes = forces[:, :axes]
        moment = jnp.sum(moments(held.position, product(on_nodes, self.attitude)), axis=0)
        if held.frame is not None:
            moment = moment + forces[1, 3] * held.frame[0]
        return jnp.sum(on_nodes, axis=0), moment


class Thrusters(eqx.Module):
    """Thrusters that pull a vehicle back to where it started: proportional to distance and speed.

    Along and about the vehicle's axes, each up to a limit. All zero where there are none.
    """

    stiffness: Vector
    """N/m"""
    damping: Vector
    """N s/m"""
    turn_stiffness: Turns
    """N m/rad"""
    turn_damping: Turns
    """N m s/rad"""
    max_force: Float[Array, ""]
    max_moment: Float[Array, ""]

    def __call__(self, ride: Ride, set_point: Vector) -> tuple[Vector, Turns]:
        """Return force (N) and moment (N m) in the vehicle's axes."""
        turn = ride.attitude
        off = product(ride.position - set_point, turn)
        error = turn_of(turn)
        force = -self.stiffness * off - self.damping * product(ride.velocity, turn)
        moment = -self.turn_stiffness * error - self.turn_damping * ride.rate
        return (
            jnp.clip(force, -self.max_force, self.max_force),
            jnp.clip(moment, -self.max_moment, self.max_moment),
        )


class Voyage(eqx.Module):
    """Where a vehicle is, and what its thrusters do."""

    pose: Float[Array, "*t channel"]
    """Displacement from the start: `crinoid.space.CHANNELS`, of its centre of mass (m, rad)."""
    force: Float[Array, "*t d"]
    """Thrust along its axes (N)."""
    moment: Float[Array, "*t turns"]
    """Moment of the thrusters about its axes (N m)."""


class Vehicle(eqx.Module):
    """A rigid body in the water, with the water that it carries along (Fossen 2011, chapter 6).

    With the slip ``s = v - u`` and the angular velocity ``w`` in its axes, its water has the
    momentum ``p = M_a s`` and the angular momentum ``J_a w``; its force and moment are
    ``-(M_a ds/dt + w x p)`` and ``-(J_a dw/dt + w x J_a w + s x p)``.
    """

    mass: Float[Array, ""]
    inertia: Turns
    """Moments of inertia about its axes (kg m2)."""
    displaced: Float[Array, ""]
    """Mass of the water that it displaces (kg)."""
    added_mass: Vector
    """Along its axes (kg)."""
    added_inertia: Turns
    """About its axes (kg m2)."""
    drag: Vector
    """Drag along its axes over ``|s| s`` (kg/m)."""
    angular_drag: Turns
    """Drag about its axes over ``|w| w`` (N m s2)."""
    metacentric_height: Float[Array, ""]
    """Height of the centre of buoyancy above the centre of mass (m)."""
    gravity: Float[Array, ""]
    offset: Vector
    """Centre of mass at the start, in the arm's coordinates (m)."""
    thrusters: Thrusters

    @property
    def reach(self) -> Float[Array, ""]:
        """Radius of gyration (m): what a turn moves."""
        return jnp.sqrt(jnp.max(self.inertia) / self.mass)

    def residual(
        self, ride: Ride, flow_velocity: Vector, flow_acceleration: Vector
    ) -> tuple[Vector, Turns]:
        """Return minus the force (N) and, in its axes, minus the moment (N m) that are lacking."""
        turn, rate = ride.attitude, ride.rate
        slip = product(ride.velocity - flow_velocity, turn)
        gain = product(ride.acceleration - flow_acceleration, turn) - swung(rate, slip)
        water = self.added_mass * slip
        drag = self.drag * smooth_speed(slip**2) * slip
        thrust, steering = self.thrusters(ride, self.offset)
        along = self.added_mass * gain + swung(rate, water) + drag - thrust
        force = self.mass * ride.acceleration - self.displaced * flow_acceleration
        force = force + product(turn, along)
        up = jnp.asarray(np.eye(slip.size)[-1])
        whole = self.inertia + self.added_inertia
        righting = (
            self.displaced * self.gravity * self.metacentric_height * moments(up, product(up, turn))
        )
        angular_drag = self.angular_drag * smooth_speed(rate**2) * rate
        moment = whole * ride.hastening + moments(slip, water) + angular_drag - righting - steering
        if rate.size == 3:
            moment = moment + cross(rate, whole * rate)
        return force + (self.mass - self.displaced) * self.gravity * up, moment

    def voyage(self, motion: Motion, attitude: Float[Array, "d d"]) -> Voyage:
        """Return where the vehicle is, and what its thrusters do."""
        axes, turns = self.offset.size, self.inertia.size
        ride = Ride(
            attitude,
            motion.position[-2, :axes],
            motion.velocity[-2, :axes],
            motion.acceleration[-2, :axes],
            motion.velocity[-1, :turns],
            motion.acceleration[-1, :turns],
        )
        angles = motion.position[-1, :1] if axes == 2 else _angles(attitude)
        pose = jnp.concatenate([ride.position - self.offset, angles])
        return Voyage(pose, *self.thrusters(ride, self.offset))

    def mount(self, held: Prescribed, attitude: Float[Array, "d d"], turn: Turns) -> Mount:
        """Return the mount of what a base holds where the vehicle is not moved."""
        return Mount(
            Prescribed(held.position - self.offset, held.velocity, held.acceleration, held.frame),
            attitude,
            turn,
        )


def turn_of(rotation: Float[Array, "d d"]) -> Turns:
    """Return the turn of a rotation matrix (rad) if it is small, else the sine of it."""
    if rotation.shape[0] == 2:
        return rotation[1, :1]
    difference = rotation - rotation.T
    return 0.5 * jnp.stack([difference[2, 1], difference[0, 2], difference[1, 0]])


def swung(rate: Turns, points: Float[Array, "*many d"]) -> Float[Array, "*many d"]:
    """Return the velocities of points of a body that turns about the origin."""
    return rate[0] * turned(points) if rate.size == 1 else cross(rate, points)


def moments(
    levers: Float[Array, "*many d"], forces: Float[Array, "*many d"]
) -> Float[Array, "*many turns"]:
    """Return the moments of forces on levers about the origin."""
    if levers.shape[-1] == 3:
        return cross(levers, forces)
    return (levers[..., 0] * forces[..., 1] - levers[..., 1] * forces[..., 0])[..., None]


def _angles(attitude: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Return pan, tilt and roll of a rotation, as `crinoid.base.Base` takes them (rad)."""
    tangent, director = attitude[:, 0], attitude[:, 1]
    pan, tilt = jnp.arctan2(tangent[1], tangent[0]), jnp.arcsin(jnp.clip(tangent[2], -1.0, 1.0))
    port = jnp.stack([-jnp.sin(pan), jnp.cos(pan), jnp.zeros(())])
    roll = jnp.arctan2(dot(director, cross(tangent, port)), dot(director, port))
    return jnp.stack([pan, tilt, roll])


def unknowns(axes: int, width: int) -> tuple[int, ...]:
    """Return which entries of a vehicle's rows, one after the other, it moves along."""
    turns = 1 if axes == 2 else 3
    return (*range(axes), *range(width, width + turns))


def paired(force: Vector, moment: Turns, width: int) -> Held:
    """Return a force and a moment as the rows of a vehicle."""
    return jnp.stack([jnp.pad(part, (0, width - part.size)) for part in (force, moment)])
