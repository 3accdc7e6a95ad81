"""Threads along the arm: tendons that pull, and chambers whose fluid pushes.

A thread runs at an offset ``d`` from the axis, in the material frame of the section. Over a node
its path advances by ``v = (l - kappa . d) t + tau t x d + dd``: ``l`` is half of the edge on either
side, ``kappa`` and ``tau`` the integrated strains, and ``dd`` the change of ``d`` in the
section, for a route that tapers or winds (the path of a cable in a Cosserat rod, over the length of
a node: Renda et al. 2020, IEEE Robotics and Automation Letters 5(3)). A tension ``T`` on a path of
length ``sum |v|`` does the work ``-T d(sum |v|)``; a chamber of section ``A`` under a pressure
``p`` is a thread that pushes, ``T = -p A``, as its volume is ``A sum |v|``.

The strains are those of `crinoid.elements.Bend`: a tension bends a straight arm to the circle that
is exact in them, however large the bend.

Friction in the channel is that of `crinoid.elements.tendon_friction`.
"""

from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.elements.node import Node
from crinoid.elements.tendon_friction import Capstan, Rubbing, Sliding, slide
from crinoid.foundation.fixed_numbers import ADHESION, EVEN
from crinoid.numerics.frames import dot
from crinoid.numerics.small_matrices import product


class Threads(Element):
    """All threads of an arm; a window is a node between two edges.

    Each thread that runs past a node has a lane there. With friction the memory is ``Sliding``.
    """

    stencil: ClassVar[int] = 3
    spins: ClassVar[bool] = True
    relative: ClassVar[bool] = True
    external: ClassVar[bool] = True
    worked: ClassVar[str] = "actuation"
    first: int = eqx.field(static=True)
    at: int = eqx.field(static=True)
    """Index of the first drive of these threads in `crinoid.Motion.drive`."""
    pull: Float[Array, "*count lane drive"]
    """Tension in a lane per unit of each positive drive (N)."""
    push_back: Float[Array, "*count lane drive"]
    """Tension in a lane per unit of each negative drive, as a positive number (N)."""
    pretension: Float[Array, "*count lane"]
    """Tension in a lane at drives of 0 (N)."""
    hold: Float[Array, "*count lane line"]
    """Tension in a lane per load of each line: 1 of a tendon, minus the area of a chamber (m2)."""
    offset: Float[Array, "*count lane way"]
    """Offset of each lane toward m_1 and m_2; in the plane the one upward of the axis (m)."""
    change: Float[Array, "*count lane way"]
    """Change of the offset over the node (m)."""
    routed: Float[Array, "*count lane"]
    """1 for a route; 0 for a lane that only bends, the limit of small strains."""
    stiffening: Float[Array, "*count way drive"]
    """Bending stiffness ``EI / l`` that each drive adds (N m)."""
    rest_strain: Float[Array, "*count way"]
    """Bend without load (rad)."""
    share: Float[Array, "*count 2"]
    """Share of the edges before and behind a node that the node owns."""
    friction: Float[Array, "*count lane"] | None = None
    """Coefficient ``mu`` of each lane (1); None of an arm without friction."""
    winding: Float[Array, "*count lane way"] | None = None
    """Change of the slope of the offset along the arm, over the length of an edge (1)."""
    cover: Float[Array, "*count lane thread"] | None = None
    """Share of the node that each thread covers in each lane, to sum along the threads."""

    def prepared(self, memory: Sliding, step: Float[Array, "*count"]) -> Rubbing:
        assert self.cover is not None
        assert self.friction is not None
        cover = self.cover

        def on_lanes(threads: Float[Array, "count thread"]) -> Float[Array, "count lane"]:
            return jnp.sum(threads[:, None] * (cover > 0), axis=-1)

        def on_threads(lanes: Float[Array, "count lane"]) -> Float[Array, "count thread"]:
            return jnp.sum(lanes[..., None] * cover, axis=1)

        def up_to(each: Float[Array, "count thread"]) -> Float[Array, "count thread"]:
            return jnp.cumsum(each, axis=0) - 0.5 * each

        lengthened, length = on_threads(memory.path - memory.before), on_threads(memory.path)
        total = jnp.sum(length, axis=0)
        slid = (up_to(lengthened) - jnp.sum(lengthened, axis=0)) / (ADHESION * total)
        direction = slide(memory.direction, on_lanes(slid))
        wrap = on_threads(memory.wrap)
        turn = up_to(wrap)
        mean = up_to(on_threads(direction * memory.wrap)) / (turn + EVEN)
        reach = up_to(wrap * (total - up_to(length))) / (ADHESION * total * (turn + EVEN))
        moves = step[:, None] > 0
        # between steps the factor of the last one, with which the arm is in balance
        capstan = Capstan(
            jnp.where(moves, self.friction * on_lanes(turn), -jnp.log(memory.factor)),
            jnp.where(moves, on_lanes(mean), 1.0),
            jnp.where(moves, on_lanes(reach), 0.0),
        )
        return Rubbing(memory._replace(direction=direction, before=memory.path), capstan)

    def slid(self, before: Sliding, now: Sliding) -> Rubbing:
        """Return the memory in a shape at rest, to which threads slid from another in one go."""
        start = now._replace(direction=before.direction, before=before.path)
        sliding, capstan = self.prepared(start, jnp.ones(now.path.shape[0]))
        # all friction is that of the way so far, none that of a correction
        return Rubbing(sliding, capstan._replace(reach=jnp.zeros_like(now.path)))

    @property
    def remembers(self) -> bool:
        return self.friction is not None

    def steady(self, motion: Motion) -> Sliding:
        path, wrap = self._wrapped(motion)
        if motion.memory is None:
            return Sliding(jnp.zeros_like(path), path, path, wrap, jnp.ones_like(path))
        start = motion.memory.sliding
        return Sliding(start.direction, path, path, wrap, motion.memory.factor(path))

    def advance(self, motion: Motion) -> Sliding:
        path, wrap = self._wrapped(motion)
        start, factor = motion.memory.sliding, motion.memory.factor(path)
        return start._replace(path=path, wrap=wrap, factor=factor)

    def _wrapped(self, motion: Motion) -> tuple[Float[Array, " lane"], Float[Array, " lane"]]:
        """Return path (m) and turn (rad) of each lane."""
        node = Node.of(motion)
        strains, (along, aside) = node.strains, self._advance(node.strains, node.length)
        path = jnp.sqrt(along**2 + dot(aside, aside))
        assert self.winding is not None
        # the direction of the path turns in the section and, across the arm and along it, with it
        bend = strains[: self.winding.shape[1]]
        turned = along[:, None] * (jnp.sum(self.share) * self.winding + bend)
        if self.winding.shape[1] == 2:
            turned += strains[2] * _around(aside)
        squares = jnp.sum(turned**2, axis=-1) + jnp.sum(aside * bend, axis=-1) ** 2
        return path, jnp.sqrt(squares / path**2 + EVEN**2) - EVEN

    def without_friction(self) -> "Threads":
        """Return the same threads in channels without friction."""
        return replace(self, friction=None, winding=None, cover=None)

    def at_root(self, mean: Float[Array, " line"], memory: Rubbing | None) -> Float[Array, " line"]:
        """Return the load of each line at its root end, from the mean along its path."""
        if memory is None:
            return mean
        each = self.hold * memory.sliding.path[..., None]
        reduced = each * memory.sliding.factor[..., None]
        return mean * jnp.sum(each, axis=(0, 1)) / jnp.sum(reduced, axis=(0, 1))

    def residual(self, motion: Motion) -> Float[Array, "3 b"]:
        node, tension = Node.of(motion), self.tension(motion)
        if motion.memory is not None:
            tension = tension * motion.memory.factor(self._paths(node.strains, node.length))
        _, slopes = jax.vjp(self._worked, node.strains, node.length)
        stresses, pulls = slopes(tension)
        stiff = self._stiffened(motion)
        bent = stiff * (node.strains[: stiff.size] - self.rest_strain)
        return node.forces(stresses.at[: stiff.size].add(bent), pulls)

    def _worked(
        self, strains: Float[Array, " s"], lengths: Float[Array, "2"]
    ) -> Float[Array, " lane"]:
        """Return the path on which each lane does work: that of one that only bends is its bend."""
        bends = -product(self.offset, strains[: self.offset.shape[1]])
        return jnp.where(self.routed > 0, self._paths(strains, lengths), bends)

    def _paths(
        self, strains: Float[Array, " s"], lengths: Float[Array, "2"]
    ) -> Float[Array, " lane"]:
        """Return the path of each lane over a node (m)."""
        along, aside = self._advance(strains, lengths)
        return jnp.sqrt(along**2 + dot(aside, aside))

    def _advance(
        self, strains: Float[Array, " s"], lengths: Float[Array, "2"]
    ) -> tuple[Float[Array, " lane"], Float[Array, "lane way"]]:
        """Return the advance ``v`` of each lane along the arm and to its side (m)."""
        ways = self.offset.shape[1]
        along = dot(self.share, lengths) - product(self.offset, strains[:ways])
        return along, self.change if ways == 1 else self.change + strains[2] * _around(self.offset)

    def path(
        self, strains: Float[Array, " s"], lengths: Float[Array, "2"]
    ) -> Float[Array, " line"]:
        """Return the path of each line over a node: length (m), or minus volume (m3), from strains.

        From the strains of the node and the lengths of the edges before and behind it.
        """
        return product(self._paths(strains, lengths), self.hold)

    def measure(self, motion: Motion) -> Float[Array, " line"]:
        """Return the `path` in a window."""
        node = Node.of(motion)
        return self.path(node.strains, node.length)

    def _stiffened(self, motion: Motion) -> Float[Array, " way"]:
        """Return the bending stiffness that the drives add (N m)."""
        assert motion.drive is not None
        drive = motion.drive[self.at : self.at + self.stiffening.shape[-1]]
        # at 0 the slope of an increasing drive
        return product(self.stiffening, jnp.where(drive < 0, -drive, drive))

    def tension(self, motion: Motion) -> Float[Array, " lane"]:
        """Return the tension in each lane of a window, at its root end (N)."""
        assert motion.drive is not None
        drive = motion.drive[self.at : self.at + self.pull.shape[-1]]
        pulled = self.pull * jnp.maximum(drive, 0.0) + self.push_back * jnp.maximum(-drive, 0.0)
        total = self.pretension + jnp.sum(pulled, axis=-1)
        return total if motion.line is None else total + product(self.hold, motion.line)


def _around(offset: Float[Array, "lane 2"]) -> Float[Array, "lane 2"]:
    """Return ``t x d``."""
    return jnp.stack([-offset[:, 1], offset[:, 0]], axis=-1)
