"""Contact of a free body with another body."""

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.elements.contact import Contact
from crinoid.elements.element import Motion
from crinoid.elements.rigid import Pose, RigidMotion
from crinoid.elements.soft_skin import eased_direction, rows_of, size
from crinoid.foundation.fixed_numbers import BODY_SKIN, SKIN_WEIGHTS
from crinoid.numerics.frames import moments, rotation_velocity, unit
from crinoid.numerics.small_matrices import product


class Pair(NamedTuple):
    """Two bodies that can touch; of the first one its middle, or a half of its core."""

    first: int
    second: int
    span: float
    """End of the first one's core, in half axes: 0 of a sphere, 1 or -1 of a capsule."""


class BodyContact(Contact):
    """Contact of a free body with another one, or with an obstacle of prescribed motion.

    The force law is that of `Contact`: the first body is a sphere, or one half of a capsule, in
    the place of the edge. So a capsule that lies on something touches it near both ends. A window
    has the two rows of the first body, then those of the second; the memory is the `Pose` of both.

    Contact begins where the surfaces meet: the skin, a fiftieth of the smaller radius, is within
    them, so that a body may start where it just touches another one. The force at the end of the
    skin is the arm's, plus a hundred weights of the lighter body, which sinks in by less than 1 %
    of its radius by itself. The coefficient of friction is the larger one.

    Both bodies also resist their relative angular velocity ``w``, by moments in proportion to the
    force ``N``: ``-l N w / sqrt(w^2 + (creep / R)^2)`` with the radius ``R`` of the first body, of
    the part of ``w`` along the surface (rolling) and of that about its normal (spinning). The
    lengths ``l`` are the larger ones of the two bodies.
    """

    balanced: ClassVar[slice] = slice(None, None, 2)
    end: Float[Array, "*count d"] = eqx.field(kw_only=True)
    """End of the first body's core, from its centre, in its axes (m)."""
    rolling: Float[Array, "*count"] = eqx.field(kw_only=True)
    """Moment of rolling resistance over the force (m)."""
    spinning: Float[Array, "*count"] = eqx.field(kw_only=True)
    """Moment of spinning friction over the force (m)."""

    @staticmethod
    def between(
        pairs: Sequence[Pair],
        *,
        radius: Float[Array, " m"],
        half_axis: Float[Array, "m d"],
        normal: Float[Array, "m d"],
        friction: Float[Array, " m"],
        rolling: Float[Array, " m"],
        spinning: Float[Array, " m"],
        mass: Float[Array, " m"],
        strength: Float[Array, ""],
        gravity: float | Array,
    ) -> "BodyContact":
        """Pair some of ``m`` bodies.

        ``radius``, ``half_axis``, ``rolling`` and ``spinning`` in m, ``mass`` in kg, infinite for
        an immovable body, ``strength`` that of the arm (N), ``gravity`` in m/s2.
        """
        first, second = (np.array([pair[side] for pair in pairs]) for side in (0, 1))
        end = jnp.array([pair.span for pair in pairs])[:, None] * half_axis[first]
        # the edge of a sphere has no length
        long = jnp.sqrt(jnp.sum(end**2 + jnp.finfo(float).tiny, axis=1))
        larger = (jnp.maximum(x[first], x[second]) for x in (friction, rolling, spinning))
        rubs, rolls, spins = larger
        pressed = SKIN_WEIGHTS * gravity * jnp.minimum(mass[first], mass[second])
        return BodyContact(
            jnp.maximum(long, radius[first]),
            radius[first],
            strength + pressed,
            radius[second],
            half_axis[second],
            normal[second],
            rubs,
            1 / (1 / mass[first] + 1 / mass[second]),
            end=end,
            rolling=rolls,
            spinning=spins,
        )

    @property
    def skin(self) -> Float[Array, "*count"]:
        round_too = jnp.minimum(self.arm_radius, self.radius)
        return BODY_SKIN * jnp.where(jnp.any(self.normal != 0, axis=-1), self.arm_radius, round_too)

    def travel(self, moved: Float[Array, "4 b"]) -> Float[Array, ""]:
        apart = size((moved[0] - moved[2])[: self.axes])
        return apart + size(moved[1]) * size(self.end) + size(moved[3]) * size(self.half_axis)

    def gap(self, position: Float[Array, "4 b"], pose: Any) -> Float[Array, ""]:
        # from the end of the skin, which begins where the surfaces meet
        one, other = _bodies(pose, position, 0 * position)
        return self._between(one, other)[0]

    def push(self, motion: Motion) -> tuple[Float[Array, ""], Float[Array, "4 b"]]:
        """Return the gap (m), and forces (N) and moments (N m) on the rows of both bodies."""
        one, other = _bodies(motion.memory, motion.position, motion.velocity)
        gap, slopes, share, by_half = self._between(one, other)
        end, half = product(one.attitude, self.end), product(other.attitude, self.half_axis)
        rate = (
            product(slopes[0] + slopes[1], one.velocity)
            + product(slopes[1], rotation_velocity(one.spin, end))
            + product(slopes[2], other.velocity)
            + product(by_half, rotation_velocity(other.spin, half))
        )
        pressing = self.damped(gap, rate)
        outward, _ = unit(-slopes[2])
        # both rub at one point, on the surface of the first
        lever = share * end - self.arm_radius * outward
        reach = one.position + lever - other.position
        sliding = one.velocity + rotation_velocity(one.spin, lever)
        sliding = sliding - other.velocity - rotation_velocity(other.spin, reach)
        sliding = sliding - product(sliding, outward) * outward
        rubbing = self.rubbing(pressing, sliding)
        on_one = pressing * (slopes[0] + slopes[1]) + rubbing
        resisted = pressing * self._resistance(one.spin - other.spin, outward)
        turns_one = moments(end, pressing * slopes[1]) + moments(lever, rubbing) + resisted
        turns_other = moments(half, pressing * by_half) - moments(reach, rubbing) - resisted
        parts = (on_one, turns_one, -on_one, turns_other)
        width = motion.position.shape[1]
        return gap, jnp.concatenate([rows_of(part, width) for part in parts])

    def _resistance(
        self, turning: Float[Array, " turns"], outward: Float[Array, " d"]
    ) -> Float[Array, " turns"]:
        """Return the moment against a relative angular velocity (rad/s), over the force (m)."""
        if turning.size == 1:
            return -self.rolling * eased_direction(self.arm_radius * turning)
        about = product(turning, outward) * outward
        rolls, spins = (eased_direction(self.arm_radius * x) for x in (turning - about, about))
        return -self.rolling * rolls - self.spinning * spins

    def _between(self, one: RigidMotion, other: RigidMotion) -> tuple[Array, Array, Array, Array]:
        """Return the gap and its gradients, as in `Contact`."""
        near = one.position
        places = jnp.stack([near, near + product(one.attitude, self.end), other.position])
        gap, slopes, share, by_half = self._closest(places, product(other.attitude, self.half_axis))
        return gap + self.skin, slopes, share, by_half


def _bodies(
    poses: tuple[Pose, Pose], position: Float[Array, "4 b"], velocity: Float[Array, "4 b"]
) -> tuple[RigidMotion, RigidMotion]:
    one, other = poses
    return one.motion(position[:2], velocity[:2]), other.motion(position[2:], velocity[2:])
