"""Tool: a rigid body at the tip."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.elements.water import smooth_speed
from crinoid.numerics.frames import cross, dot, rotate_90, unit
from crinoid.numerics.ramp import Onset
from crinoid.rod import Rod

_Points = Float[Array, "2 d"]


class Tool(Element):
    """Rigid body clamped to the last edge: inertia, weight, buoyancy, drag and added mass.

    Its centre of mass lies beyond the tip, ``c = x_tip + offset t``, with the direction ``t`` of
    the last edge. So ``dc/dt`` and ``d2c/dt2`` follow from the nodes without approximation, and
    the forces on the nodes are those of a rigid body (Kane and Levinson 1985, section 6.1): the
    force at the centre of mass and the moment about it, each times its partial velocity by a node,

    ``F = (m + m_a) d2c/dt2 - (rho V + m_a) Du/Dt - 1/2 rho C_d A |w| w + (m - rho V) g``,
    ``M = J dw/dt + w x J w``.

    The water is that at the tip. Its work counts as external, as stored energies are those of the
    arm alone. So the balance of energy closes when the body is taken up or let go, without a jump
    of velocity: it moves with the tip before and after.
    """

    stencil: ClassVar[int] = 2
    spins: ClassVar[bool] = True
    external: ClassVar[bool] = True
    worked: ClassVar[str] = "tool"
    first: int = eqx.field(static=True)
    mass: Float[Array, "*count"]
    inertia: Float[Array, "*count turns"]
    """Moments of inertia about the centre of mass (kg m2): in the plane one, in space three, about
    the edge and about its directors m_1 and m_2."""
    displaced: Float[Array, "*count"]
    """Mass of the water that it displaces (kg)."""
    added_mass: Float[Array, "*count"]
    """Added mass, equal in all directions (kg)."""
    drag: Float[Array, "*count"]
    """Drag over ``|w| w`` (kg/m)."""
    weight: Float[Array, "*count"]
    """Weight less buoyancy (N)."""
    offset: Float[Array, "*count"]
    """Distance of the centre of mass beyond the tip (m)."""
    held: Onset
    """Time in which it acts, if no touch decides that; otherwise its memory has that time."""

    @staticmethod
    def of(
        rod: Rod,
        *,
        mass: float | Array,
        density: float | Array = 0.0,
        gravity: float | Array = 0.0,
        inertia: float | Array = 0.0,
        volume: float | Array = 0.0,
        added_mass: float | Array = 0.0,
        drag_area: float | Array = 0.0,
        offset: float | Array = 0.0,
        held: Onset | None = None,
    ) -> "Tool":
        """Build a tool of given mass (kg) at the tip of a rod, by default always held.

        ``density`` (kg/m3) is that of the water, ``drag_area`` (m2) counts times its coefficient.
        In space a single ``inertia`` (kg m2) counts for all axes.
        """

        def one(value: float | Array) -> Float[Array, "1"]:
            return jnp.asarray(value, float).reshape(1)

        displaced = jnp.asarray(density) * volume
        turns = 1 if rod.axes == 2 else 3
        held = held or Onset.of()
        return Tool(
            rod.nodes - 1,
            mass=one(mass),
            inertia=jnp.broadcast_to(jnp.asarray(inertia, float), (1, turns)),
            displaced=one(displaced),
            added_mass=one(added_mass),
            drag=one(0.5 * jnp.asarray(density) * drag_area),
            weight=one((mass - displaced) * gravity),
            offset=one(offset),
            held=Onset.of(held.start, held.ramp_time, held.stop, shape=(1,)),
        )

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        axes = motion.flow_velocity.shape[-1]
        rows = (motion.position, motion.velocity, motion.acceleration)
        place, velocity, acceleration = (row[:, :axes] for row in rows)

        def rates(place: _Points, velocity: _Points) -> tuple[Array, Array]:
            return jax.jvp(self._stance, (place,), (velocity,))

        (stance, rate), (_, second) = jax.jvp(rates, (place, velocity), (velocity, acceleration))
        tangent, (_, length) = stance[1], unit(place[1] - place[0])
        force = self._force(motion, rate[0], second[0])
        if motion.orientation is None:
            about = jnp.sum(rotate_90(tangent) * second[1])
            couple, torque = self.inertia[0] * about / length * rotate_90(tangent), None
        else:
            moment = self._moment(motion, stance[1], rate[1], second[1])
            couple, torque = cross(moment, tangent) / length, dot(moment, tangent)
        couple += self.offset / length * (force - jnp.sum(force * tangent) * tangent)
        total = jnp.stack([-couple, force + couple])
        if torque is not None:
            total = jnp.c_[total, jnp.stack([jnp.zeros(()), torque])]
        held = self.held if motion.memory is None else motion.memory
        return held.whole(motion.time) * total

    def _stance(self, place: _Points) -> _Points:
        """Return the centre of mass (m) and the direction of the edge."""
        tangent, _ = unit(place[1] - place[0])
        return jnp.stack([place[1] + self.offset * tangent, tangent])

    def _force(self, motion: Motion, velocity: Array, acceleration: Array) -> Float[Array, " d"]:
        """Return minus the force at the centre of mass (N)."""
        relative = motion.flow_velocity[1] - velocity
        drag = self.drag * smooth_speed(jnp.sum(relative**2)) * relative
        froude_krylov = (self.displaced + self.added_mass) * motion.flow_acceleration[1]
        inertia = (self.mass + self.added_mass) * acceleration
        return inertia - froude_krylov - drag + self.weight * np.eye(drag.size)[-1]

    def _moment(
        self, motion: Motion, tangent: Array, rate: Array, second: Array
    ) -> Float[Array, "3"]:
        """Return the rate of change of the angular momentum about the centre of mass (N m)."""
        assert motion.orientation is not None
        director = motion.orientation.director[1]
        axes = jnp.stack([tangent, director, cross(tangent, director)])
        spin, spin_up = motion.velocity[1, 3], motion.acceleration[1, 3]
        turning = cross(tangent, rate) + spin * tangent
        angular_acceleration = cross(tangent, second) + spin_up * tangent + spin * rate

        def momentum(rate: Array) -> Array:
            along = self.inertia * jnp.sum(axes * rate, axis=1)
            return jnp.sum(along[:, None] * axes, axis=0)

        return momentum(angular_acceleration) + cross(turning, momentum(turning))
