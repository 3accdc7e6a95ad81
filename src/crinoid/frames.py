"""Frames that turn along with a rod in space.

A frame is a tangent ``t`` and a director ``m_1`` normal to it; ``m_2 = t x m_1`` completes it.
Frames are carried on by parallel transport, the rotation from one tangent to another that does
not turn about either, plus a spin about the tangent (Bergou et al. 2008, section 4.2; 2010,
section 4). So the spin of an edge is a coordinate of its own beside the positions of its ends.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Vectors = Float[Array, "... 3"]
Numbers = Float[Array, "..."]


def dot(a: Vectors, b: Vectors) -> Numbers:
    """Return the scalar products of vectors."""
    return jnp.sum(a * b, axis=-1)


def cross(a: Array, b: Array, axis: int = -1) -> Array:
    """Return the vector products of vectors in space, whose components stand along an axis."""

    def following(vector: Array) -> Array:
        """Move ``y`` to where ``x`` is, ``z`` to ``y``, and ``x`` to ``z``."""
        parts = [jax.lax.slice_in_dim(vector, *at, axis=axis) for at in ((1, 3), (0, 1))]
        return jnp.concatenate(parts, axis=axis)

    return following(a * following(b) - following(a) * b)


def transport(vector: Vectors, before: Vectors, after: Vectors) -> Vectors:
    """Carry vectors that are normal to a unit tangent ``before`` over to a tangent ``after``.

    There is no one way to do so where the tangents oppose each other: what comes back is then not
    finite.
    """
    share = dot(vector, after) / (1.0 + dot(before, after))
    return vector - share[..., None] * (before + after)


def spun(director: Vectors, tangent: Vectors, angle: Numbers) -> Vectors:
    """Turn directors about their tangents, from ``m_1`` toward ``m_2``."""
    cos, sin = jnp.cos(angle)[..., None], jnp.sin(angle)[..., None]
    return cos * director + sin * cross(tangent, director)


def sinc(squared: Array) -> Array:
    """Return ``sin(a) / a`` of a squared angle, with derivatives at zero."""
    small = squared < 1e-3
    angle = jnp.sqrt(jnp.where(small, 1.0, squared))
    series = 1.0 - squared / 6 * (1.0 - squared / 20 * (1.0 - squared / 42))
    return jnp.where(small, series, jnp.sin(angle) / angle)


def rotated(frame: Float[Array, "3 3"], rotation: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Turn a frame by a rotation vector (Rodrigues's formula)."""
    squared = jnp.sum(rotation**2)
    swung = cross(rotation, frame)
    versine = 0.5 * sinc(0.25 * squared) ** 2
    return frame + sinc(squared) * swung + versine * cross(rotation, swung)


def angle_between(before: Vectors, after: Vectors, tangent: Vectors) -> Numbers:
    """Return the angle about a tangent from one director to another (rad, up to half a turn)."""
    return jnp.arctan2(dot(tangent, cross(before, after)), dot(before, after))


def twist_between(
    before: Vectors, last: Vectors, tangents: tuple[Vectors, Vectors], expected: Numbers
) -> Numbers:
    """Return the twist (rad) from the director of one edge to that of the next.

    Of the angles that are whole turns apart it is the one nearest to what is ``expected``.
    """
    behind, ahead = tangents
    wrapped = angle_between(transport(before, behind, ahead), last, ahead)
    return wrapped + 2 * jnp.pi * jnp.round((expected - wrapped) / (2 * jnp.pi))


class Orientation(eqx.Module):
    """How the edges of a shape stand, by the node at which they end."""

    director: Float[Array, "*count n 3"]
    """Material director m_1 of each edge."""
    twist: Float[Array, "*count n"]
    """Twist at each node, between the edges that end and begin there (rad)."""
    lean: Float[Array, "*count n 3"]
    """Spin of each director about its tangent, over a change ``dt`` of the tangent: ``lean . dt``.

    Directors spin by that much where positions change and spins do not, because transport from the
    tangent at the start of a step is not transport from the latest one (they differ by the area on
    the sphere between the two ways).
    """


class Frames(eqx.Module):
    """Frames of the edges of a rod of ``n`` nodes, from which those of a later shape follow.

    Row ``i`` is the edge that ends at node ``i``; the first row stands for nothing. Frames are
    carried over in time from where they were at the start of a step: over as little as that,
    transport along the straight way differs from that along the true one by the cube of the step.
    """

    tangent: Float[Array, "n 3"]
    director: Float[Array, "n 3"]
    spin: Float[Array, " n"]
    """Angle that each edge has spun about itself since the start (rad)."""
    reference_twist: Float[Array, " n"]
    """Twist at each node, between the edges that end and begin there, less their spins (rad).

    Changes little from step to step: this is what tells one and a half turns from a half.
    """

    @staticmethod
    def of(position: Float[Array, "n b"], orientation: Orientation) -> "Frames":
        """Build the frames of a shape whose orientation is known."""
        director, twist = orientation.director, orientation.twist
        tangent = tangents(position)
        normal = director - dot(director, tangent)[:, None] * tangent  # round-off adds up
        spin = position[:, 3]
        return Frames(
            tangent,
            normal / jnp.sqrt(dot(normal, normal))[:, None],
            spin,
            twist - _at_nodes(spin[2:] - spin[1:-1]),
        )

    def at(self, position: Float[Array, "n b"]) -> Orientation:
        """Return how the edges of a shape stand."""
        tangent = tangents(position)
        carried = transport(self.director, self.tangent, tangent)
        director = spun(carried, tangent, position[:, 3] - self.spin)
        behind, ahead = slice(1, -1), slice(2, None)
        twist = twist_between(
            director[behind],
            director[ahead],
            (tangent[behind], tangent[ahead]),
            self.reference_twist[behind] + position[ahead, 3] - position[behind, 3],
        )
        facing = 1.0 + dot(self.tangent, tangent)
        lean = cross(tangent, self.tangent) / facing[:, None]
        return Orientation(director, _at_nodes(twist), lean)

    def spin_to(self, end: int, tangent: Float[Array, "3"], director: Float[Array, "3"]) -> Array:
        """Return the spin at which the edge that ends at a node has a tangent and a director."""
        carried = transport(self.director[end], self.tangent[end], tangent)
        return self.spin[end] + angle_between(carried, director, tangent)


def tangents(position: Float[Array, "n b"]) -> Float[Array, "n 3"]:
    """Return the direction of the edge that ends at each node; the first row is the second."""
    edge = position[1:, :3] - position[:-1, :3]
    tangent = edge / jnp.sqrt(dot(edge, edge))[:, None]
    return jnp.concatenate([tangent[:1], tangent])


def _at_nodes(inner: Float[Array, " inner"]) -> Float[Array, " inner+2"]:
    """Fill up what is at the nodes between two edges: at the ends nothing bends or twists."""
    return jnp.pad(inner, 1)
