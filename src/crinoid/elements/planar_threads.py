"""Threads along a planar arm."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.elastic import Turn, by_nodes
from crinoid.elements.element import Motion, TangentDirection
from crinoid.elements.threads import Threads
from crinoid.numerics.frames import unit
from crinoid.numerics.small_matrices import product


class PlanarThreads(Threads):
    """Threads in the plane."""

    spins: ClassVar[bool] = False

    def residual(self, motion: Motion) -> Float[Array, "3 2"]:
        turn, ends = Turn.of(motion.position), _edges(motion.position)
        (bending, pull), _ = self._work(motion, turn.strain[None], ends[0][1], ends[1][1])
        return bending * turn.growth * turn.gradient + pull * self._lengthened(ends)

    def jacobian(self, motion: Motion, direction: TangentDirection) -> Float[Array, "3 2 3 2"]:
        turn, ends = Turn.of(motion.position), _edges(motion.position)
        slope, curvature = self._work(motion, turn.strain[None], ends[0][1], ends[1][1])
        strained, lengthened = turn.growth * turn.gradient, self._lengthened(ends)
        bending = curvature[0, 0] * strained + curvature[0, 1] * lengthened
        pull = curvature[1, 0] * strained + curvature[1, 1] * lengthened
        steered = strained[:, :, None, None] * bending + lengthened[:, :, None, None] * pull
        curved = turn.growth * turn.hessian + turn.growth_slope * (
            turn.gradient[:, :, None, None] * turn.gradient
        )
        swung = [
            share / length * (jnp.eye(2) - direction[:, None] * direction)
            for share, (direction, length) in zip(self.share, ends, strict=True)
        ]
        return direction.by_position * (steered + slope[0] * curved + slope[1] * by_nodes(*swung))

    def _strained(
        self, motion: Motion
    ) -> tuple[Float[Array, " s"], Float[Array, ""], Float[Array, ""]]:
        ends = _edges(motion.position)
        return Turn.of(motion.position).strain[None], ends[0][1], ends[1][1]

    def measure_slope(self, motion: Motion) -> Float[Array, "line 3 2"]:
        turn, ends = Turn.of(motion.position), _edges(motion.position)
        _, _, slopes = self._lanes(turn.strain[None], ends[0][1], ends[1][1])
        by_strain, by_length = product(self.hold.T, slopes).T[:, :, None, None]
        return by_strain * turn.growth * turn.gradient + by_length * self._lengthened(ends)

    def _lengthened(self, ends: list[tuple[Array, Array]]) -> Float[Array, "3 2"]:
        """Return the derivative of the length by the positions."""
        before, behind = self.share[0] * ends[0][0], self.share[1] * ends[1][0]
        return jnp.stack([-before, before - behind, behind])


def _edges(position: Float[Array, "3 2"]) -> list[tuple[Array, Array]]:
    """Return direction and length of the edges between nodes."""
    return [unit(position[end] - position[end - 1]) for end in (1, 2)]
