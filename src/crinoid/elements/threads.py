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

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.elastic import Turn, by_nodes
from crinoid.elements.element import Course, Element, Linearised, Motion
from crinoid.elements.geometry import unit
from crinoid.elements.spatial import NodeStrain, SpatialEdge, applied, on_nodes


class Threads(Element):
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

    def residual(self, motion: Motion) -> Float[Array, "3 b"]:
        assert motion.orientation is not None
        tension = self.tension(motion)
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

    def tension(self, motion: Motion) -> Float[Array, " lane"]:
        """Return the tension in each lane of a window (N)."""
        assert motion.drive is not None
        drive = motion.drive[self.at : self.at + self.pull.shape[-1]]
        pulled = self.pull * jnp.maximum(drive, 0.0) + self.push_back * jnp.maximum(-drive, 0.0)
        return jnp.sum(pulled, axis=-1)


class PlanarThreads(Threads, Linearised):
    """Threads in the plane, with a tangent by hand: it is faster (``benchmarks/chambers.py``)."""

    spins: ClassVar[bool] = False

    def residual(self, motion: Motion) -> Float[Array, "3 2"]:
        path = self._path(motion)
        return path.bending * path.by_strain + path.axial * path.by_length

    def jacobian(self, motion: Motion, course: Course) -> Float[Array, "3 2 3 2"]:
        path = self._path(motion)
        turn, strain, length = path.turn, path.by_strain, path.by_length
        # how the slopes change: by -d ds + dl along the path of each lane
        bending = path.of_offset[2] * strain - path.of_offset[1] * length
        axial = path.of_offset[0] * length - path.of_offset[1] * strain
        steered = strain[:, :, None, None] * bending + length[:, :, None, None] * axial
        curved = turn.growth * turn.hessian + turn.growth_slope * (
            turn.gradient[:, :, None, None] * turn.gradient
        )
        return course.by_position * (
            steered + path.bending * curved + path.axial * path.length_curved
        )

    def _path(self, motion: Motion) -> "_Path":
        position, offset = motion.position, self.offset[:, 0]
        turn = Turn.of(position)
        edges = [unit(position[end] - position[end - 1]) for end in (1, 2)]
        parts = [share * length for share, (_, length) in zip(self.share, edges, strict=True)]
        along = parts[0] + parts[1] - turn.strain * offset
        path = jnp.sqrt(along**2 + self.change[:, 0] ** 2)
        tension, routed = self.tension(motion), self.routed > 0
        slope = jnp.where(routed, along / path, 1.0)
        bent = tension * jnp.where(routed, self.change[:, 0] ** 2 / path**3, 0.0)
        pulls = [share * direction for share, (direction, _) in zip(self.share, edges, strict=True)]
        curved = [
            share / length * (jnp.eye(2) - direction[:, None] * direction)
            for share, (direction, length) in zip(self.share, edges, strict=True)
        ]
        return _Path(
            turn=turn,
            bending=-jnp.sum(tension * slope * offset),
            axial=jnp.sum(tension * self.routed * slope),
            by_strain=turn.growth * turn.gradient,
            by_length=jnp.stack([-pulls[0], pulls[0] - pulls[1], pulls[1]]),
            length_curved=by_nodes(*curved),
            of_offset=tuple(jnp.sum(bent * offset**power) for power in range(3)),
        )


class _Path(NamedTuple):
    """The path of the threads at a node, weighed by their tensions."""

    turn: Turn
    bending: Float[Array, ""]
    """Slope of the work by the strain (N m)."""
    axial: Float[Array, ""]
    """Slope of the work by the length (N)."""
    by_strain: Float[Array, "3 2"]
    """Derivative of the strain by the positions (1/m)."""
    by_length: Float[Array, "3 2"]
    length_curved: Float[Array, "3 2 3 2"]
    """Second derivative of the length by the positions (1/m)."""
    of_offset: tuple[Float[Array, ""], ...]
    """Second slopes of the work by the path along the arm, times powers 0 to 2 of the offset."""
