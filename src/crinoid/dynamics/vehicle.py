"""Floating submarine: a rigid body to which the arm is clamped.

It has the last two rows of unknowns of a time step: its centre of mass, and its rotation since the
start of the step in body axes (one number in the plane). Unrotated, its axes are those of the
world.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.base import Prescribed
from crinoid.dynamics.rows import CENTRE, GHOST, ROOT, ROTATION, SPIN, Rows
from crinoid.elements import Motion
from crinoid.elements.water import smooth_speed
from crinoid.numerics.frames import Frames, cross, dot, moments, rotation_velocity
from crinoid.numerics.small_matrices import product

Vector = Float[Array, " d"]
Turns = Float[Array, " turns"]
Held = Float[Array, "2 b"]


class VehicleKinematics(eqx.Module):
    """Motion of a vehicle: its centre of mass in world axes, its rotation in body axes."""

    attitude: Float[Array, "d d"]
    position: Vector
    velocity: Vector
    acceleration: Vector
    rate: Turns
    """Angular velocity (rad/s)."""
    angular_acceleration: Turns
    """Angular acceleration (rad/s2)."""

    @staticmethod
    def of(
        attitude: Float[Array, "d d"],
        turns: int,
        position: Rows,
        velocity: Rows,
        acceleration: Rows,
    ) -> "VehicleKinematics":
        """Read the rows of a vehicle; of its rotation the first ``turns`` entries count."""
        axes = attitude.shape[0]
        return VehicleKinematics(
            attitude,
            position[CENTRE, :axes],
            velocity[CENTRE, :axes],
            acceleration[CENTRE, :axes],
            velocity[ROTATION, :turns],
            acceleration[ROTATION, :turns],
        )

    def to_world(self, held: Prescribed, frames: Frames | None) -> tuple[Held, Held, Held]:
        """Return the motion of ghost node and root in world axes."""
        axes = self.position.size
        place, speed, gain = held.position, held.velocity[:, :axes], held.acceleration[:, :axes]
        swing = rotation_velocity(self.rate, place)
        moving = speed + swing
        points_acceleration = (
            gain
            + rotation_velocity(self.rate, 2 * speed + swing)
            + rotation_velocity(self.angular_acceleration, place)
        )
        rows = [
            middle + product(vectors, self.attitude.T)
            for middle, vectors in (
                (self.position, place),
                (self.velocity, moving),
                (self.acceleration, points_acceleration),
            )
        ]
        if held.frame is None:
            return rows[0], rows[1], rows[2]
        assert frames is not None
        tangent, director = held.frame[:2]
        lever = place[ROOT] - place[GHOST]
        swept = (speed[ROOT] - speed[GHOST]) / jnp.sqrt(dot(lever, lever))
        spins = (
            frames.spin_to(ROOT, product(self.attitude, tangent), product(self.attitude, director)),
            held.velocity[ROOT, SPIN] + dot(self.rate, tangent),
            held.acceleration[ROOT, SPIN]
            + dot(self.angular_acceleration, tangent)
            + dot(self.rate, swept),
        )
        position, velocity, acceleration = (
            jnp.pad(row, ((0, 0), (0, 1))).at[ROOT, SPIN].set(spin)
            for row, spin in zip(rows, spins, strict=True)
        )
        return position, velocity, acceleration

    def resultant(self, held: Prescribed, forces: Held) -> tuple[Vector, Turns]:
        """Return force (N, world axes) and moment (N m, body axes) of forces on the held nodes."""
        axes = self.position.size
        on_nodes = forces[:, :axes]
        moment = jnp.sum(moments(held.position, product(on_nodes, self.attitude)), axis=0)
        if held.frame is not None:
            moment = moment + forces[ROOT, SPIN] * held.frame[0]
        return jnp.sum(on_nodes, axis=0), moment


class Thrusters(eqx.Module):
    """Station-keeping thrusters: a PD law along and about the vehicle's axes, with limits.

    All zero without thrusters.
    """

    stiffness: Vector  # N/m
    damping: Vector  # N s/m
    turn_stiffness: Turns  # N m/rad
    turn_damping: Turns  # N m s/rad
    max_force: Float[Array, ""]
    max_moment: Float[Array, ""]

    def __call__(self, kinematics: VehicleKinematics, set_point: Vector) -> tuple[Vector, Turns]:
        """Return force (N) and moment (N m) in the vehicle's axes."""
        turn = kinematics.attitude
        off = product(kinematics.position - set_point, turn)
        error = turn_of(turn)
        force = -self.stiffness * off - self.damping * product(kinematics.velocity, turn)
        moment = -self.turn_stiffness * error - self.turn_damping * kinematics.rate
        return (
            jnp.clip(force, -self.max_force, self.max_force),
            jnp.clip(moment, -self.max_moment, self.max_moment),
        )


class VehicleOutput(eqx.Module):
    """Pose and thrust of a vehicle."""

    pose: Float[Array, "*t channel"]
    """Displacement of its centre of mass (m, rad; `crinoid.foundation.axes.CHANNELS`)."""
    force: Float[Array, "*t d"]
    """Thrust along its axes (N)."""
    moment: Float[Array, "*t turns"]
    """Moment of the thrusters about its axes (N m)."""


class Vehicle(eqx.Module):
    """Rigid body in water, with its added mass (Fossen 2011, chapter 6).

    With the slip ``s = v - u`` and the angular velocity ``w`` in body axes, the added mass has the
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
    linear_drag: Vector | None = None
    """Drag along its axes over ``s`` (N s/m)."""
    angular_linear_drag: Turns | None = None
    """Drag about its axes over ``w`` (N m s)."""

    @property
    def reach(self) -> Float[Array, ""]:
        """Radius of gyration (m)."""
        return jnp.sqrt(jnp.max(self.inertia) / self.mass)

    def residual(
        self, kinematics: VehicleKinematics, flow_velocity: Vector, flow_acceleration: Vector
    ) -> tuple[Vector, Turns]:
        """Return minus the unbalanced force (N, world axes) and moment (N m, body axes)."""
        turn, rate = kinematics.attitude, kinematics.rate
        slip = product(kinematics.velocity - flow_velocity, turn)
        gain = product(kinematics.acceleration - flow_acceleration, turn)
        gain -= rotation_velocity(rate, slip)
        water = self.added_mass * slip
        drag = self.drag * smooth_speed(slip**2) * slip
        if self.linear_drag is not None:
            drag = drag + self.linear_drag * slip
        thrust, steering = self.thrusters(kinematics, self.offset)
        along = self.added_mass * gain + rotation_velocity(rate, water) + drag - thrust
        force = self.mass * kinematics.acceleration - self.displaced * flow_acceleration
        force = force + product(turn, along)
        up = jnp.asarray(np.eye(slip.size)[-1])
        whole = self.inertia + self.added_inertia
        righting = (
            self.displaced * self.gravity * self.metacentric_height * moments(up, product(up, turn))
        )
        angular_drag = self.angular_drag * smooth_speed(rate**2) * rate
        if self.angular_linear_drag is not None:
            angular_drag = angular_drag + self.angular_linear_drag * rate
        moment = (
            whole * kinematics.angular_acceleration
            + moments(slip, water)
            + angular_drag
            - righting
            - steering
        )
        if rate.size == 3:
            moment = moment + cross(rate, whole * rate)
        return force + (self.mass - self.displaced) * self.gravity * up, moment

    def vehicle_output(self, motion: Motion, attitude: Float[Array, "d d"]) -> VehicleOutput:
        """Return pose and thrust of the vehicle."""
        rows = motion.position, motion.velocity, motion.acceleration
        kinematics = VehicleKinematics.of(attitude, self.inertia.size, *rows)
        angles = motion.position[ROTATION, :1] if self.offset.size == 2 else _angles(attitude)
        pose = jnp.concatenate([kinematics.position - self.offset, angles])
        return VehicleOutput(pose, *self.thrusters(kinematics, self.offset))

    def clamp(self, held: Prescribed) -> Prescribed:
        """Return the motion of a clamp from the centre of mass, given where the vehicle starts."""
        return Prescribed(held.position - self.offset, held.velocity, held.acceleration, held.frame)


def turn_of(rotation: Float[Array, "d d"]) -> Turns:
    """Return the rotation vector of a small rotation (rad), else the sine of its angle."""
    if rotation.shape[0] == 2:
        return rotation[1, :1]
    difference = rotation - rotation.T
    return 0.5 * jnp.stack([difference[2, 1], difference[0, 2], difference[1, 0]])


def _angles(attitude: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Return pan, tilt and roll of a rotation (rad; `crinoid.base.Base`)."""
    tangent, director = attitude[:, 0], attitude[:, 1]
    pan, tilt = jnp.arctan2(tangent[1], tangent[0]), jnp.arcsin(jnp.clip(tangent[2], -1.0, 1.0))
    port = jnp.stack([-jnp.sin(pan), jnp.cos(pan), jnp.zeros(())])
    roll = jnp.arctan2(dot(director, cross(tangent, port)), dot(director, port))
    return jnp.stack([pan, tilt, roll])


def unknowns(axes: int, width: int) -> tuple[int, ...]:
    """Return the indices of a vehicle's unknowns among its two flattened rows."""
    turns = 1 if axes == 2 else 3
    return (*range(axes), *range(width, width + turns))
