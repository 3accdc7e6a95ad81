"""Loads that a user puts on the arm."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.elements.geometry import turned, unit
from crinoid.onset import Onset
from crinoid.rod import Rod

Vector = Sequence[float] | Array


class DistributedLoad(Element):
    """A force per length of the arm at rest: along its tangent, its normal, or a fixed direction.

    The first two follow the arm; the normal is the tangent turned from +x toward +z.
    """

    stencil: ClassVar[int] = 2
    external: ClassVar[bool] = True
    worked: ClassVar[str] = "loads"
    first: int = eqx.field(static=True)
    tangential: Float[Array, "*count"]
    """Force along the tangent on each end of an edge (N)."""
    normal: Float[Array, "*count"]
    """Force along the normal on each end of an edge (N)."""
    fixed: Float[Array, "*count b"]
    """Force that does not turn with the arm on each end of an edge (N)."""
    onset: Onset

    @staticmethod
    def of(
        rod: Rod,
        *,
        tangential: float | Array = 0.0,
        normal: float | Array = 0.0,
        fixed: Vector = (0.0, 0.0),
        onset: Onset | None = None,
    ) -> "DistributedLoad":
        """Build the load of a rod from its three parts (N/m), there from the start by default."""
        share = rod.rest_length / 2
        return DistributedLoad(
            1,
            jnp.asarray(tangential) * share,
            jnp.asarray(normal) * share,
            share[:, None] * jnp.asarray(fixed),
            _repeated(onset, share.shape),
        )

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        tangent, _ = unit(motion.position[1] - motion.position[0])
        force = self.tangential * tangent + self.normal * turned(tangent) + self.fixed
        return -self.onset(motion.time) * jnp.stack([force, force])


class TipLoad(Element):
    """A force and a moment on the tip.

    A dead force keeps its direction; a follower force is given in the directions it has on a
    straight arm along +x and turns with the arm's tip, whose direction is carried on from the
    last two edges (the last edge alone would point where the arm does half an edge earlier). The
    moment, positive from +x toward +z, is a couple on the ends of the last edge, normal to it.
    """

    stencil: ClassVar[int] = 3
    external: ClassVar[bool] = True
    worked: ClassVar[str] = "loads"
    first: int = eqx.field(static=True)
    dead_force: Float[Array, "*count b"]
    follower_force: Float[Array, "*count b"]
    moment: Float[Array, "*count"]
    onset: Onset

    @staticmethod
    def of(
        rod: Rod,
        *,
        dead_force: Vector = (0.0, 0.0),
        follower_force: Vector = (0.0, 0.0),
        moment: float | Array = 0.0,
        onset: Onset | None = None,
    ) -> "TipLoad":
        """Build the load (N, N m) on the tip of a rod, there from the start by default."""
        return TipLoad(
            rod.nodes - 2,
            jnp.asarray(dead_force, float)[None],
            jnp.asarray(follower_force, float)[None],
            jnp.asarray(moment, float)[None],
            _repeated(onset, (1,)),
        )

    def residual(self, motion: Motion) -> Float[Array, "3 b"]:
        before, _ = unit(motion.position[1] - motion.position[0])
        last, length = unit(motion.position[2] - motion.position[1])
        tip, _ = unit(1.5 * last - 0.5 * before)
        follower = self.follower_force[0] * tip + self.follower_force[1] * turned(tip)
        couple = self.moment / length * turned(last)
        force = jnp.stack([jnp.zeros_like(couple), -couple, self.dead_force + follower + couple])
        return -self.onset(motion.time) * force


def _repeated(onset: Onset | None, shape: tuple[int, ...]) -> Onset:
    onset = onset or Onset.of()
    return Onset.of(onset.start, onset.ramp_time, onset.stop, shape=shape)
