"""Prescribed loads: forces per length, and force and moment at the tip."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.numerics.banded import pad_columns
from crinoid.numerics.frames import beyond, cross, dot, rotate_90, spun, transport, unit
from crinoid.numerics.ramp import Onset
from crinoid.numerics.small_matrices import product
from crinoid.rod import Rod

Vector = Sequence[float] | Array


class DistributedLoad(Element):
    """Force per rest length of the arm: along its tangent, its normal, or a fixed direction.

    The first two are follower loads; the normal is the tangent rotated from +x toward +z, in space
    the director m_2.
    """

    stencil: ClassVar[int] = 2
    spins: ClassVar[bool] = True
    external: ClassVar[bool] = True
    first: int = eqx.field(static=True)
    tangential: Float[Array, "*count"]
    """Force along the tangent on each end of an edge (N)."""
    normal: Float[Array, "*count"]
    """Force along the normal on each end of an edge (N)."""
    fixed: Float[Array, "*count d"]
    """Dead force on each end of an edge (N)."""
    onset: Onset

    @staticmethod
    def of(
        rod: Rod,
        *,
        tangential: float | Array = 0.0,
        normal: float | Array = 0.0,
        fixed: Vector | None = None,
        onset: Onset | None = None,
    ) -> "DistributedLoad":
        """Build the load of a rod from its three parts (N/m), by default from the start on."""
        share = rod.rest_length / 2
        fixed = (0.0,) * rod.axes if fixed is None else fixed
        return DistributedLoad(
            1,
            jnp.asarray(tangential) * share,
            jnp.asarray(normal) * share,
            share[:, None] * jnp.asarray(fixed),
            _repeated(onset, share.shape),
        )

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        axes = self.fixed.shape[-1]
        tangent, _ = unit(motion.position[1, :axes] - motion.position[0, :axes])
        if motion.orientation is None:
            normal = rotate_90(tangent)
        else:
            normal = cross(tangent, motion.orientation.director[1])
        force = self.tangential * tangent + self.normal * normal + self.fixed
        both = pad_columns(jnp.stack([force, force]), motion.position.shape[1])
        return -self.onset(motion.time) * both


class TipLoad(Element):
    """A force and a moment on the tip.

    Dead loads keep their direction; follower loads are given for a straight arm along +x, and turn
    with the tip. The tip's frame is extrapolated from those of the last two edges (that of the last
    edge is the arm's half an edge before the tip). The moment is a couple on the ends of the last
    edge, normal to it, and in space a torque about it; in the plane it is positive from +x toward
    +z, in space by the right-hand rule.
    """

    stencil: ClassVar[int] = 3
    spins: ClassVar[bool] = True
    external: ClassVar[bool] = True
    first: int = eqx.field(static=True)
    dead_force: Float[Array, "*count d"]
    """Force that keeps its direction (N)."""
    follower_force: Float[Array, "*count d"]
    """Force that turns with the tip (N)."""
    moment: Float[Array, "*count turns"]
    """Dead moment: one number in the plane, a vector in space (N m)."""
    follower_moment: Float[Array, "*count turns"]
    """Moment that turns with the tip; in the plane equivalent to ``moment`` (N m)."""
    onset: Onset

    @staticmethod
    def of(
        rod: Rod,
        *,
        dead_force: Vector | None = None,
        follower_force: Vector | None = None,
        moment: float | Vector | None = None,
        follower_moment: float | Vector | None = None,
        onset: Onset | None = None,
    ) -> "TipLoad":
        """Build the load (N, N m) on the tip of a rod, by default from the start on."""

        def vector(given: float | Vector | None, size: int) -> Float[Array, "1 size"]:
            return jnp.asarray((0.0,) * size if given is None else given, float).reshape(1, size)

        turns = 1 if rod.axes == 2 else 3
        return TipLoad(
            rod.nodes - 2,
            vector(dead_force, rod.axes),
            vector(follower_force, rod.axes),
            vector(moment, turns),
            vector(follower_moment, turns),
            _repeated(onset, (1,)),
        )

    def residual(self, motion: Motion) -> Float[Array, "3 b"]:
        place = motion.position[:, : self.dead_force.shape[-1]]
        before, _ = unit(place[1] - place[0])
        last, length = unit(place[2] - place[1])
        tip = beyond(before, last)
        if motion.orientation is None:
            axes = jnp.stack([tip, rotate_90(tip)])
            moment = (self.moment + self.follower_moment)[0]
            couple, torque = moment / length * rotate_90(last), None
        else:
            # the last frame, transported to the tip's tangent and spun by half of the last twist
            director = motion.orientation.director
            m_1 = transport(director[2], last, tip)
            m_1 = spun(m_1, tip, 0.5 * motion.orientation.twist[1])
            axes = jnp.stack([tip, m_1, cross(tip, m_1)])
            moment = self.moment + product(self.follower_moment, axes)
            couple, torque = cross(moment, last) / length, dot(moment, last)
        follower = product(self.follower_force, axes)
        force = jnp.stack([jnp.zeros_like(couple), -couple, self.dead_force + follower + couple])
        force = pad_columns(force, motion.position.shape[1])
        if torque is not None:
            force = force.at[2, 3].set(torque)
        return -self.onset(motion.time) * force


def _repeated(onset: Onset | None, shape: tuple[int, ...]) -> Onset:
    onset = onset or Onset.of()
    return Onset.of(onset.start, onset.ramp_time, onset.stop, shape=shape)
