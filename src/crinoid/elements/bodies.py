"""Free bodies: rigid spheres and capsules in the water."""

from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.elements.element import Law, Motion
from crinoid.elements.rigid import Pose
from crinoid.elements.soft_skin import rows_of
from crinoid.elements.water import smooth_speed
from crinoid.foundation.fixed_numbers import CROSS_FLOW_DRAG, SPHERE_DRAG
from crinoid.numerics.frames import cross, moments, rotation_velocity
from crinoid.numerics.small_matrices import product

_STATIONS, _SHARES = np.polynomial.legendre.leggauss(4)


class Body(Law):
    """Inertia, weight, buoyancy, drag, added mass and Froude-Krylov force of a free body.

    A sphere, or a capsule: a cylinder of length ``l`` with half a sphere at each end. With the slip
    ``s = v - u``, the added mass ``M_a`` and the inertia ``J`` (Fossen 2011, chapter 6):

    ``m a + M_a (a - Du/Dt) + w x M_a s - M_a (w x s) = rho V Du/Dt - drag - (m - rho V) g``,
    ``J dw/dt + w x J w + s x M_a s = -(moment of the drag) + rho V g h (k x z)``.

    Added mass and inertia are those of the spheroid with the capsule's length and diameter, over
    the water that each displaces (Lamb 1932, sections 114 and 115). The ends have the drag of a
    sphere; the cylinder between them has drag across its axis only, as if each piece were alone
    (cross-flow principle, Hoerner 1965, 3-11). So the water does not resist a turn about the axis
    of a capsule, nor that of a sphere. The water is that at the centre. Buoyancy acts at the height
    ``h`` above the centre of mass, along ``k``: upward at the start, turning with the body.

    The memory is its `Pose`.
    """

    spins: ClassVar[bool] = True
    balanced: ClassVar[slice] = slice(1)
    mass: Float[Array, "*count"]
    """Mass (kg)."""
    displaced: Float[Array, "*count"]
    """Mass of the water that it displaces (kg)."""
    drag: Float[Array, "*count"]
    """Drag of its ends over ``|s| s`` (kg/m)."""
    weight: Float[Array, "*count"]
    """Weight less buoyancy (N)."""
    inertia: Float[Array, "*count turns turns"]
    """Moments of inertia in its axes, with that of the water (kg m2)."""
    axis: Float[Array, "*count d"]
    """Axis of a capsule, in its axes; zero of a sphere, or across the plane."""
    half_length: Float[Array, "*count"]
    """Half of ``l`` (m)."""
    side_drag: Float[Array, "*count"]
    """Drag of its cylinder over ``|s_n| s_n``, ``s_n`` across its axis (kg/m)."""
    added_mass: Float[Array, "*count 2"]
    """Added mass along its axis and across (kg)."""
    righting: Float[Array, "*count"]
    """Righting moment when it lies on its side (N m)."""

    @staticmethod
    def of(
        *,
        mass: Float[Array, " m"],
        radius: Float[Array, " m"],
        inertia: Float[Array, "m turns turns"],
        half_axis: Float[Array, "m d"] | None = None,
        length: Float[Array, " m"] | float = 0.0,
        metacentric_height: Float[Array, " m"] | float = 0.0,
        density: float | Array,
        gravity: float | Array,
    ) -> "Body":
        """Build bodies in water of a density (kg/m3).

        ``mass`` in kg, ``radius`` in m, ``inertia`` in their axes in kg m2; ``length`` (m) is
        that of the cylinder, ``half_axis`` (m) half of its part in the plane of the arm, and
        ``metacentric_height`` (m) that of the centre of buoyancy above the centre of mass.
        """
        turns = inertia.shape[-1]
        axes = 2 if turns == 1 else 3
        half = jnp.zeros((mass.size, axes)) if half_axis is None else half_axis
        length = jnp.broadcast_to(jnp.asarray(length, float), mass.shape)
        size = jnp.sqrt(jnp.sum(half**2, axis=1, keepdims=True))
        axis = half / jnp.where(size > 0, size, 1.0)
        displaced = density * (4 / 3 * jnp.pi * radius**3 + jnp.pi * radius**2 * length)
        along, across, turned = spheroid_coefficients(1 + 0.5 * length / radius)
        water = turned * capsule_inertia(displaced, radius, length)[1]
        if turns == 1:  # about y: none of a capsule across the plane
            swept = jnp.sum(axis**2, axis=1)[:, None, None]
        else:
            swept = jnp.eye(3) - axis[:, :, None] * axis[:, None, :]
        return Body(
            mass,
            displaced,
            0.5 * density * SPHERE_DRAG * jnp.pi * radius**2,
            (mass - displaced) * gravity,
            inertia + water[:, None, None] * swept,
            axis,
            0.5 * size[:, 0],
            0.5 * density * CROSS_FLOW_DRAG * 2 * radius * length,
            displaced[:, None] * jnp.stack([along, across], axis=1),
            displaced * gravity * metacentric_height,
        )

    @property
    def reach(self) -> Float[Array, "*count"]:
        """Largest radius of gyration (m)."""
        largest = jnp.max(jnp.diagonal(self.inertia, axis1=-2, axis2=-1), axis=-1)
        return jnp.sqrt(largest / self.mass)

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        pose: Pose = motion.memory
        axes, turns = motion.flow_velocity.shape[1], pose.turn.size
        body = pose.motion(motion.position, motion.velocity)
        axis = product(body.attitude, self.axis)

        def added(vector: Float[Array, " d"]) -> Float[Array, " d"]:
            more = self.added_mass[0] - self.added_mass[1]
            return self.added_mass[1] * vector + more * product(axis, vector) * axis

        def swung(vector: Float[Array, " d"]) -> Float[Array, " d"]:
            return rotation_velocity(body.spin, vector)

        acceleration, flow = motion.acceleration[0, :axes], motion.flow_acceleration[0]
        slip = body.velocity - motion.flow_velocity[0]
        momentum = added(slip)
        water = added(acceleration - flow) + swung(momentum) - added(swung(slip))
        stations = self.half_length * jnp.asarray(_STATIONS)[:, None]
        slips = slip + stations * swung(axis)
        slips = slips - product(slips, axis)[:, None] * axis
        speeds = smooth_speed(jnp.sum(slips**2, axis=1))
        drags = self.side_drag * (0.5 * _SHARES * speeds)[:, None] * slips
        drag = self.drag * smooth_speed(jnp.sum(slip**2)) * slip + jnp.sum(drags, axis=0)
        up = jnp.eye(axes)[-1]
        force = self.mass * acceleration - self.displaced * flow + water + drag + self.weight * up
        moment = moments(slip, momentum) + jnp.sum(moments(stations * axis, drags), axis=0)
        moment -= self.righting * moments(body.attitude[:, -1], up)
        spin_up = motion.acceleration[1, :turns]
        if turns == 1:
            turning = self.inertia[0] * spin_up + moment
        else:
            inertia = product(product(body.attitude, self.inertia), body.attitude.T)
            turning = product(inertia, spin_up) + cross(body.spin, product(inertia, body.spin))
            turning = turning + moment
        width = motion.position.shape[1]
        return jnp.concatenate([rows_of(force, width), rows_of(turning, width)])


def capsule_inertia(mass: Any, radius: Any, length: Any) -> tuple[Any, Any]:
    """Return the moments of inertia of a homogeneous capsule along and across its axis (kg m2).

    ``length`` is that of its cylinder (m); that of a sphere is 0.
    """
    share = length / (length + 4 / 3 * radius)
    cylinder, ends = share * mass, (1 - share) * mass
    ball = 0.4 * radius**2
    along = cylinder * radius**2 / 2 + ends * ball
    across = cylinder * (length**2 / 12 + radius**2 / 4) + ends * (
        ball + length**2 / 4 + 0.375 * length * radius
    )
    return along, across


def spheroid_coefficients(slenderness: Array) -> tuple[Array, Array, Array]:
    """Return coefficients of added mass of a prolate spheroid by its length over its diameter.

    They are its added mass along and across, and its added inertia across, over mass and inertia
    of the water that it displaces (Lamb 1932, sections 114 and 115): 1/2, 1/2 and 0 of a sphere.
    """
    squared = 1 - 1 / slenderness**2  # the eccentricity e
    nearly = squared < 0.1
    root = jnp.sqrt(jnp.where(nearly, 0.5, squared))
    # (artanh e - e - e^3 / 3) / e^5
    exact = (jnp.arctanh(root) - root - root**3 / 3) / root**5
    series = sum(squared**n / (2 * n + 5) for n in range(12))
    tail = jnp.where(nearly, series, exact)
    alpha = 2 * (1 - squared) * (1 / 3 + squared * tail)
    beta = 1 - alpha / 2
    # (beta - alpha) / e^2, without cancellation
    apart = 1 - 3 * tail + 3 * squared * tail
    turned = squared**2 * apart / ((2 - squared) * (2 - (2 - squared) * apart))
    return alpha / (2 - alpha), beta / (2 - beta), turned
