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

from crinoid.elements.elastic import Turn
from crinoid.elements.element import Element, Motion
from crinoid.elements.geometry import unit
from crinoid.elements.spatial import NodeStrain, SpatialEdge, applied, on_nodes


class Threads(Element):
    """All threads of an arm, gathered by their routes; a window is a node between two edges.

    Threads that run along the same route share a lane: what pulls there is the sum of their
    tensions.
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

    def residual(self, motion: Motion) -> Float[Array, "3 b"]:
        assert motion.drive is not None
        drive = motion.drive[self.at : self.at + self.pull.shape[-1]]
        tension = jnp.sum(
            self.pull * jnp.maximum(drive, 0.0) + self.push_back * jnp.maximum(-drive, 0.0), axis=-1
        )
        if motion.orientation is None:
            return self._in_plane(motion.position, tension)
        return self._in_space(motion, tension)

    def _in_plane(
        self, position: Float[Array, "3 2"], tension: Float[Array, " lane"]
    ) -> Float[Array, "3 2"]:
        turn = Turn.of(position)
        (before, one), (behind, two) = (unit(position[i + 1] - position[i]) for i in (0, 1))
        along = self.share[0] * one + self.share[1] * two - turn.strain * self.offset[:, 0]
        path = jnp.sqrt(along**2 + self.change[:, 0] ** 2)
        slope = jnp.where(self.routed > 0, along / path, 1.0)
        bending = -jnp.sum(tension * slope * self.offset[:, 0])
        axial = jnp.sum(tension * self.routed * slope)
        first, second = axial * self.share[0] * before, axial * self.share[1] * behind
        stretching = jnp.stack([-first, first - second, second])
        return bending * turn.growth * turn.gradient + stretching

    def _in_space(self, motion: Motion, tension: Float[Array, " lane"]) -> Float[Array, "3 4"]:
        assert motion.orientation is not None
        a, b = SpatialEdge.of(motion, 1), SpatialEdge.of(motion, 2)
        strain = NodeStrain.of(a.tangent, b.tangent, a.director, motion.orientation.twist[1])
        strains, offset, change = strain.strains, self.offset, self.change
        along = self.share[0] * a.length + self.share[1] * b.length
        along = along - jnp.sum(offset * strains[:2], axis=-1)
        aside = change + strains[2] * jnp.stack([-offset[:, 1], offset[:, 0]], axis=-1)
        path = jnp.sqrt(along**2 + jnp.sum(aside**2, axis=-1))
        slope = jnp.where(self.routed > 0, along / path, 1.0)
        winding = self.routed * (aside[:, 1] * offset[:, 0] - aside[:, 0] * offset[:, 1]) / path
        bending = -jnp.sum((tension * slope)[:, None] * offset, axis=0)
        stress = jnp.append(bending, jnp.sum(tension * winding))
        moment = applied(strain.map, jnp.sum(stress[:, None] * strain.axes, axis=0))
        axial = jnp.sum(tension * self.routed * slope)
        pulls = (axial * self.share[0] * a.tangent, axial * self.share[1] * b.tangent)
        on_a, on_b = (jnp.append(pull, 0.0) for pull in pulls)
        return on_nodes(on_a - a.force(moment), on_b + b.force(moment))
