"""Threads along the arm: tendons that pull, and chambers whose fluid pushes.

A thread runs at an offset ``d`` from the axis, in the material frame of the section. Over a node
its path advances by ``v = (l - kappa . d) t + tau t x d + dd``: ``l`` is half of the edge on either
side, ``kappa`` and ``tau`` the strains that the node gathers, and ``dd`` the change of ``d`` in the
section, of a route that tapers or winds (the path of a cable in a Cosserat rod, over the length of
a node: Renda et al. 2020, IEEE Robotics and Automation Letters 5(3)). A tension ``T`` on a path of
length ``sum |v|`` does the work ``-T d(sum |v|)``; a chamber of section ``A`` under a pressure
``p`` is a thread that pushes, ``T = -p A``, as its volume is ``A sum |v|``.

The strains are those of `crinoid.elements.Bend` and `crinoid.elements.BendTwist`: a tension bends a
straight arm to the circle that is exact in them, however large the bend.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.elastic import Turn, by_nodes
from crinoid.elements.element import Course, Linearised, Motion
from crinoid.elements.geometry import unit
from crinoid.elements.spatial import SpatialEdge, across, observed, on_nodes, slopes_on_nodes
from crinoid.products import product


class Threads(Linearised):
    """All threads of an arm in space; a window is a node between two edges.

    Each thread that runs past a node has a lane there.
    """

    stencil: ClassVar[int] = 3
    spins: ClassVar[bool] = True
    external: ClassVar[bool] = True
    worked: ClassVar[str] = "actuation"
    first: int = eqx.field(static=True)
    at: int = eqx.field(static=True)
    """Where the drives of these threads begin in `crinoid.Motion.drive`."""
    pull: Float[Array, "*count lane drive"]
    """Tension in a lane per unit of each drive that is above 0 (N)."""
    push_back: Float[Array, "*count lane drive"]
    """Tension in a lane per unit of each drive that is below 0, as a positive number (N)."""
    offset: Float[Array, "*count lane way"]
    """Offset of each lane toward m_1 and m_2; in the plane the one upward of the axis (m)."""
    change: Float[Array, "*count lane way"]
    """Change of the offset over the node (m)."""
    routed: Float[Array, "*count lane"]
    """1 for a route; 0 for a lane that bends only, which is the limit of small strains."""
    share: Float[Array, "*count 2"]
    """Share of the edges before and behind a node that counts as its own."""

    def residual(self, motion: Motion) -> Float[Array, "3 4"]:
        a, b, strain = observed(motion)
        slope, _ = self._work(motion, strain.strains, a.length, b.length)
        moment = product(slope[:3], product(strain.axes, strain.map))
        pull = slope[3] * self.share
        return on_nodes(
            jnp.append(pull[0] * a.tangent, 0.0) - a.force(moment),
            jnp.append(pull[1] * b.tangent, 0.0) + b.force(moment),
        )

    def jacobian(self, motion: Motion, course: Course) -> Float[Array, "3 4 3 4"]:
        assert motion.orientation is not None
        a, b, strain = observed(motion)
        slope, curvature = self._work(motion, strain.strains, a.length, b.length)
        turned = product(strain.axes, strain.map)  # the strains by w
        moment = product(slope[:3], turned)
        # of moment and pull by w and the length
        turned = jnp.pad(turned, ((0, 1), (0, 1))).at[3, 3].set(1.0)
        by_strain = product(turned.T, product(curvature, turned))
        by_turn, by_mean = strain.moment_slopes(product(slope[:3], strain.axes), moment)

        def swing(edge: SpatialEdge, end: int, lean: Array) -> Float[Array, "4 4"]:
            sign, lengthened = 2 * end - 1, jnp.append(self.share[end] * edge.tangent, 0.0)
            return jnp.concatenate([sign * edge.turning(lean), lengthened[None]])

        def own(edge: SpatialEdge, end: int) -> Float[Array, "4 4"]:
            steered = slope[3] * self.share[end] / edge.length * across(edge.tangent)
            return jnp.pad(steered, (0, 1)) + (2 * end - 1) * edge.force_slope(moment)

        by_ends = [
            product(by_strain + jnp.pad(by_turn + sign * by_mean, (0, 1)), swung)
            for sign, swung in (
                (-1, swing(a, 0, motion.orientation.lean[1])),
                (1, swing(b, 1, motion.orientation.lean[2])),
            )
        ]
        still = jnp.zeros(3)
        return course.by_position * slopes_on_nodes(
            (swing(a, 0, still).T, swing(b, 1, still).T),
            (by_ends[0], by_ends[1]),
            (own(a, 0), own(b, 1)),
        )

    def _work(
        self,
        motion: Motion,
        strains: Float[Array, " s"],
        before: Float[Array, ""],
        behind: Float[Array, ""],
    ) -> tuple[Float[Array, " s+1"], Float[Array, "s+1 s+1"]]:
        """Return first and second derivatives of the work of the tensions along their paths.

        By the strains of the node and the length of arm that it stands for: moments (N m) and a
        pull (N), and their slopes.
        """
        tension, offset, ways = self.tension(motion), self.offset, self.offset.shape[1]
        along = self.share[0] * before + self.share[1] * behind
        along = along - jnp.sum(offset * strains[:ways], axis=-1)
        aside, levers, routed = self.change, [-offset], self.routed > 0
        none, one = jnp.zeros_like(offset[:, :1]), jnp.ones_like(offset[:, :1])
        if ways == 2:
            around = jnp.stack([-offset[:, 1], offset[:, 0]], axis=-1)
            aside = aside + strains[2] * around
            levers.append(none)
        lever = jnp.concatenate([*levers, one], axis=-1)
        path = jnp.sqrt(along**2 + jnp.sum(aside**2, axis=-1))
        slopes = (along / path)[:, None] * lever
        bent = tension * self.routed / path
        curvature = lever[:, :, None] * lever[:, None, :]
        if ways == 2:
            slopes = slopes.at[:, 2].set(jnp.sum(aside * around, axis=-1) / path)
            curvature = curvature.at[:, 2, 2].set(jnp.sum(offset**2, axis=-1))
        curvature = curvature - slopes[:, :, None] * slopes[:, None, :]
        bends = lever.at[:, -1].set(0.0)
        slope = jnp.where(routed[:, None], slopes, bends)
        return jnp.sum(tension[:, None] * slope, axis=0), jnp.sum(
            bent[:, None, None] * curvature, axis=0
        )

    def tension(self, motion: Motion) -> Float[Array, " lane"]:
        """Return the tension in each lane of a window (N)."""
        assert motion.drive is not None
        drive = motion.drive[self.at : self.at + self.pull.shape[-1]]
        pulled = self.pull * jnp.maximum(drive, 0.0) + self.push_back * jnp.maximum(-drive, 0.0)
        return jnp.sum(pulled, axis=-1)


class PlanarThreads(Threads):
    """Threads in the plane."""

    spins: ClassVar[bool] = False

    def residual(self, motion: Motion) -> Float[Array, "3 2"]:
        turn, ends = Turn.of(motion.position), _edges(motion.position)
        (bending, pull), _ = self._work(motion, turn.strain[None], ends[0][1], ends[1][1])
        return bending * turn.growth * turn.gradient + pull * self._lengthened(ends)

    def jacobian(self, motion: Motion, course: Course) -> Float[Array, "3 2 3 2"]:
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
        return course.by_position * (steered + slope[0] * curved + slope[1] * by_nodes(*swung))

    def _lengthened(self, ends: list[tuple[Array, Array]]) -> Float[Array, "3 2"]:
        """Return the derivative of the length by the positions."""
        before, behind = self.share[0] * ends[0][0], self.share[1] * ends[1][0]
        return jnp.stack([-before, before - behind, behind])


def _edges(position: Float[Array, "3 2"]) -> list[tuple[Array, Array]]:
    """Return direction and length of the edges between nodes."""
    return [unit(position[end] - position[end - 1]) for end in (1, 2)]
