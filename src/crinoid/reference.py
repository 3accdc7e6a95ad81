"""Where the nodes of an arm lie without load, in the plane and in space."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.frames import rotated, sinc, transport


class Reference(eqx.Module):
    """The arm without load: ``n`` nodes and ``e = n - 1`` edges along a curve, no stiffness.

    A statics search and a run that begins at rest start from it, and strains are told per length of
    it. What it takes to bend and stretch the arm away from it is held by the elements alone.
    """

    rest_length: Float[Array, " e"]
    """Length of each edge at rest (m)."""
    rest_curvature: Float[Array, "n ..."]
    """Curvature without load (1/m), positive from +x toward +z; in space toward m_1 and m_2."""
    rest_twist: Float[Array, " n"] | None
    """In space, twist without load, from m_1 toward m_2 (rad/m)."""

    @property
    def axes(self) -> int:
        """Number of axes that the arm moves along: 2 or 3."""
        return 2 if self.rest_twist is None else 3

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return self.rest_length.shape[0] + 1

    @property
    def length(self) -> Float[Array, ""]:
        """Length at rest (m)."""
        return jnp.sum(self.rest_length)

    @property
    def arc_length(self) -> Float[Array, " n"]:
        """Distance of each node from the root, along the arm at rest (m)."""
        return jnp.concatenate([jnp.zeros(1), jnp.cumsum(self.rest_length)])

    @property
    def voronoi_length(self) -> Float[Array, " n"]:
        """Length that each node owns: half of each edge beside it (m)."""
        half = self.rest_length / 2
        return jnp.pad(half, (0, 1)) + jnp.pad(half, (1, 0))

    @property
    def strain_length(self) -> Float[Array, "n strain"]:
        """Length over which each node gathers its bend, or both of them and the twist (m).

        For the twist that which it owns. For a bend this with the end correction of Gregory's rule
        at the root (to second differences: Hildebrand 1974, Introduction to Numerical Analysis,
        chapter 5). There the moment is largest and falls steeply; the trapezoid rule would make an
        arm of 11 nodes a hundredth too soft. At the tip no moment is left to correct.
        """
        correction = self.rest_length[0] * jnp.array([-1 / 8, 1 / 6, -1 / 24])[: self.nodes]
        bent = self.voronoi_length + jnp.pad(correction, (0, self.nodes - correction.size))
        lengths = [bent] if self.axes == 2 else [bent, bent, self.voronoi_length]
        return jnp.stack(lengths, axis=1)

    @property
    def rest_strain(self) -> Float[Array, "n strain"]:
        """Curvature without load (1/m); in space both and the twist (rad/m)."""
        if self.rest_twist is None:
            return self.rest_curvature[:, None]
        return jnp.concatenate([self.rest_curvature, self.rest_twist[:, None]], axis=1)

    @property
    def chord_length(self) -> Float[Array, " e"]:
        """Distance of the ends of each edge without load (m).

        An edge stands for a piece of a curve, in space of a helix with the mean of the strains at
        its two nodes: the nodes then lie on the natural shape itself.
        """
        strain = _between(self.rest_strain)
        share, rest = _of_arc(0.5 * self.rest_length, jnp.sum(strain**2, axis=1))
        along = 0.0 if self.axes == 2 else rest * (1 + share) * strain[:, 2] ** 2
        return self.rest_length * jnp.sqrt(share**2 + along)

    @property
    def rest_turn(self) -> Float[Array, " n"]:
        """How far a planar arm turns at each node without load (rad)."""
        half = 0.5 * self.rest_length * _between(self.rest_curvature)
        return jnp.pad(half, (0, 1)) + jnp.pad(half, (1, 0))

    def rest_shape(self, tilt: float | Array) -> Float[Array, "n 2"]:
        """Return the nodes of a planar arm without load, its root at the origin."""
        angles = tilt + jnp.cumsum(self.rest_turn[:-1])
        edges = self.chord_length[:, None] * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1)
        return jnp.concatenate([jnp.zeros((1, 2)), jnp.cumsum(edges, axis=0)])

    def rest_frames(
        self, frame: Float[Array, "3 3"]
    ) -> tuple[Float[Array, "n 3"], Float[Array, "e 3"]]:
        """Return nodes and directors m_1 of a spatial arm without load, its root at the origin.

        The clamp's ``frame`` has the rows ``t, m_1, m_2``. Along an edge the frame turns steadily
        about an axis that it keeps; the edge has the director of its middle.
        """
        _, (chords, directors) = jax.lax.scan(
            _follow, frame, (self.rest_length, _between(self.rest_strain))
        )
        return jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(chords, axis=0)]), directors


def _follow(
    frame: Float[Array, "3 3"], edge: tuple[Array, Array]
) -> tuple[Array, tuple[Array, Array]]:
    """Turn the frame along an edge, of which the length and the strains are given.

    Returns also the edge's chord and director. Defined here, it is traced and compiled only once.
    """
    length, (toward_1, toward_2, twist) = edge
    rate = toward_1 * frame[2] - toward_2 * frame[1] + twist * frame[0]
    middle = rotated(frame, 0.5 * length * rate)
    share, rest = _of_arc(0.5 * length, jnp.sum(rate**2))
    chord = length * (share * middle[0] + rest * twist * rate)
    tangent = chord / jnp.sqrt(jnp.sum(chord**2))
    director = transport(middle[1], middle[0], tangent)
    return rotated(middle, 0.5 * length * rate), (chord, director)


def _between(nodal: Float[Array, "n ..."]) -> Float[Array, "n-1 ..."]:
    return 0.5 * (nodal[:-1] + nodal[1:])


def _of_arc(half: Array, squared_rate: Array) -> tuple[Array, Array]:
    """Return ``q = sin(a) / a`` of half the angle ``a`` of an arc, and ``(1 - q) / rate^2``."""
    squared = squared_rate * half**2
    share, small = sinc(squared), squared < 1e-3
    series = (1.0 - squared / 20 * (1.0 - squared / 42 * (1.0 - squared / 72))) / 6
    rest = (1.0 - share) / jnp.where(small, 1.0, squared)
    return share, half**2 * jnp.where(small, series, rest)
