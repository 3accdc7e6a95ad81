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
import numpy as np
from jaxtyping import Array, Float

from crinoid.elements.elastic import Turn, by_nodes
from crinoid.elements.element import Course, Linearised, Motion
from crinoid.elements.geometry import unit
from crinoid.elements.spatial import (
    NodeStrain,
    SpatialEdge,
    across,
    observed,
    on_nodes,
    slopes_on_nodes,
)
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
    hold: Float[Array, "*count lane line"]
    """Tension in a lane per load of each line: 1 of a tendon, minus the area of a chamber (m2)."""
    offset: Float[Array, "*count lane way"]
    """Offset of each lane toward m_1 and m_2; in the plane the one upward of the axis (m)."""
    change: Float[Array, "*count lane way"]
    """Change of the offset over the node (m)."""
    routed: Float[Array, "*count lane"]
    """1 for a route; 0 for a lane that bends only, which is the limit of small strains."""
    stiffening: Float[Array, "*count way drive"]
    """Bending stiffness ``EI / l`` that each drive adds (N m)."""
    rest_strain: Float[Array, "*count way"]
    """Bend without load (rad)."""
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
        moment = product(slope[:3], product(strain.axes, strain.map))
        turned = _turned(strain)
        by_strain = product(turned.T, product(curvature, turned))
        by_turn, by_mean = strain.moment_slopes(product(slope[:3], strain.axes), moment)

        def own(edge: SpatialEdge, end: int) -> Float[Array, "4 4"]:
            steered = slope[3] * self.share[end] / edge.length * across(edge.tangent)
            return jnp.pad(steered, (0, 1)) + (2 * end - 1) * edge.force_slope(moment)

        swung = self._swings(a, b, motion.orientation.lean)
        by_a = product(by_strain + jnp.pad(by_turn - by_mean, (0, 1)), swung[0])
        by_b = product(by_strain + jnp.pad(by_turn + by_mean, (0, 1)), swung[1])
        acts = self._swings(a, b, jnp.zeros((3, 3)))
        return course.by_position * slopes_on_nodes(
            (acts[0].T, acts[1].T), (by_a, by_b), (own(a, 0), own(b, 1))
        )

    def _swings(
        self, a: SpatialEdge, b: SpatialEdge, lean: Float[Array, "3 3"]
    ) -> tuple[Float[Array, "4 4"], Float[Array, "4 4"]]:
        """Return how the relative turn of the edges, and the length, follow each of them."""
        parts = []
        for end, edge in enumerate((a, b)):
            lengthened = jnp.append(self.share[end] * edge.tangent, 0.0)
            turning = (2 * end - 1) * edge.turning(lean[end + 1])
            parts.append(jnp.concatenate([turning, lengthened[None]]))
        return parts[0], parts[1]

    def _work(
        self,
        motion: Motion,
        strains: Float[Array, " s"],
        before: Float[Array, ""],
        behind: Float[Array, ""],
    ) -> tuple[Float[Array, " s+1"], Float[Array, "s+1 s+1"]]:
        """Return first and second derivatives of the work of the tensions along their paths.

        Together with the energy ``1/2 K s^2`` of what the drives add to the bending stiffness.

        By the strains of the node and the length of arm that it stands for: moments (N m) and a
        pull (N), and their slopes.
        """
        tension, routed = self.tension(motion), self.routed > 0
        path, lever, slopes = self._lanes(strains, before, behind)
        curvature = lever[:, :, None] * lever[:, None, :]
        if self.offset.shape[1] == 2:
            wound = jnp.sum(self.offset**2, axis=-1)
            curvature += wound[:, None, None] * np.diag([0.0, 0.0, 1.0, 0.0])
        curvature = curvature - slopes[:, :, None] * slopes[:, None, :]
        bent = tension * self.routed / path
        slope = jnp.where(routed[:, None], slopes, jnp.pad(lever[:, :-1], ((0, 0), (0, 1))))
        stiff = self._stiffened(motion)
        bending = stiff * (strains[: stiff.size] - self.rest_strain)
        more = (0, strains.size + 1 - stiff.size)
        return (
            jnp.sum(tension[:, None] * slope, axis=0) + jnp.pad(bending, more),
            jnp.sum(bent[:, None, None] * curvature, axis=0) + jnp.diag(jnp.pad(stiff, more)),
        )

    def _lanes(
        self, strains: Float[Array, " s"], before: Float[Array, ""], behind: Float[Array, ""]
    ) -> tuple[Float[Array, " lane"], Float[Array, "lane s+1"], Float[Array, "lane s+1"]]:
        """Return path of each lane (m), and derivatives of ``v . t`` and the path.

        By the strains, and by the length of arm that the node stands for.
        """
        along, aside = self._advance(strains, before, behind)
        path = jnp.sqrt(along**2 + jnp.sum(aside**2, axis=-1))
        none, one = jnp.zeros_like(self.offset[:, :1]), jnp.ones_like(self.offset[:, :1])
        twists = self.offset.shape[1] == 2
        lever = jnp.concatenate([-self.offset, *([none] * twists), one], axis=-1)
        slopes = (along / path)[:, None] * lever
        if twists:
            winding = jnp.sum(aside * _around(self.offset), axis=-1) / path
            slopes += winding[:, None] * np.eye(4)[2]
        return path, lever, slopes

    def _advance(
        self, strains: Float[Array, " s"], before: Float[Array, ""], behind: Float[Array, ""]
    ) -> tuple[Float[Array, " lane"], Float[Array, "lane way"]]:
        """Return how far each lane runs along the arm and to its side (m): ``v``."""
        along = self.share[0] * before + self.share[1] * behind
        along = along - jnp.sum(self.offset * strains[: self.offset.shape[1]], axis=-1)
        if self.offset.shape[1] == 1:
            return along, self.change
        return along, self.change + strains[2] * _around(self.offset)

    def path(
        self, strains: Float[Array, " s"], before: Float[Array, ""], behind: Float[Array, ""]
    ) -> Float[Array, " line"]:
        """Return what each line measures past a node: its length (m), or minus its volume (m3).

        From the strains of the node and the lengths of the edges before and behind it.
        """
        along, aside = self._advance(strains, before, behind)
        return product(jnp.sqrt(along**2 + jnp.sum(aside**2, axis=-1)), self.hold)

    def measured(self, motion: Motion) -> Float[Array, " line"]:
        """Return `path` in a window."""
        a, b, strain = observed(motion)
        return self.path(strain.strains, a.length, b.length)

    def measured_slope(self, motion: Motion) -> Float[Array, "line 3 b"]:
        """Return the derivative of `measured` by positions and spins."""
        assert motion.orientation is not None
        a, b, strain = observed(motion)
        _, _, slopes = self._lanes(strain.strains, a.length, b.length)
        by_strain = product(self.hold.T, product(slopes, _turned(strain)))
        ends = self._swings(a, b, motion.orientation.lean)
        on_a, on_b = (product(by_strain, swung).T for swung in ends)
        return jnp.moveaxis(on_nodes(on_a, on_b), -1, 0)

    def _stiffened(self, motion: Motion) -> Float[Array, " way"]:
        """Return what the drives add to the bending stiffness (N m)."""
        assert motion.drive is not None
        drive = motion.drive[self.at : self.at + self.stiffening.shape[-1]]
        # at 0 the slope of a drive that goes up
        return product(self.stiffening, jnp.where(drive < 0, -drive, drive))

    def tension(self, motion: Motion) -> Float[Array, " lane"]:
        """Return the tension in each lane of a window (N)."""
        assert motion.drive is not None
        drive = motion.drive[self.at : self.at + self.pull.shape[-1]]
        pulled = self.pull * jnp.maximum(drive, 0.0) + self.push_back * jnp.maximum(-drive, 0.0)
        total = jnp.sum(pulled, axis=-1)
        return total if motion.line is None else total + product(self.hold, motion.line)


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

    def measured(self, motion: Motion) -> Float[Array, " line"]:
        ends = _edges(motion.position)
        return self.path(Turn.of(motion.position).strain[None], ends[0][1], ends[1][1])

    def measured_slope(self, motion: Motion) -> Float[Array, "line 3 2"]:
        turn, ends = Turn.of(motion.position), _edges(motion.position)
        _, _, slopes = self._lanes(turn.strain[None], ends[0][1], ends[1][1])
        by_strain, by_length = product(self.hold.T, slopes).T[:, :, None, None]
        return by_strain * turn.growth * turn.gradient + by_length * self._lengthened(ends)

    def _lengthened(self, ends: list[tuple[Array, Array]]) -> Float[Array, "3 2"]:
        """Return the derivative of the length by the positions."""
        before, behind = self.share[0] * ends[0][0], self.share[1] * ends[1][0]
        return jnp.stack([-before, before - behind, behind])


def _turned(strain: NodeStrain) -> Float[Array, "4 4"]:
    """Return how the strains follow the relative turn of the edges, and the length itself."""
    turned = product(strain.axes, strain.map)
    return jnp.pad(turned, (0, 1)) + np.diag([0.0, 0.0, 0.0, 1.0])


def _around(offset: Float[Array, "lane 2"]) -> Float[Array, "lane 2"]:
    """Return ``t x d``."""
    return jnp.stack([-offset[:, 1], offset[:, 0]], axis=-1)


def _edges(position: Float[Array, "3 2"]) -> list[tuple[Array, Array]]:
    """Return direction and length of the edges between nodes."""
    return [unit(position[end] - position[end - 1]) for end in (1, 2)]
