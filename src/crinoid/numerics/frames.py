"""Material frames of a rod in space, and vector algebra.

A frame is a tangent ``t`` and a director ``m_1`` normal to it; ``m_2 = t x m_1`` completes it.
Frames move by parallel transport, the rotation from one tangent to another without a component
about either, plus a spin about the tangent (Bergou et al. 2008, section 4.2; 2010, section 4). So
the spin of an edge is a coordinate in addition to the positions of its ends.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.numerics.small_matrices import product

Vectors = Float[Array, "... 3"]
Vector = Float[Array, " b"]
Numbers = Float[Array, "..."]


def dot(a: Float[Array, "... d"], b: Float[Array, "... d"]) -> Numbers:
    """Return the scalar products of vectors."""
    return jnp.sum(a * b, axis=-1)


def cross(a: Array, b: Array) -> Array:
    """Return the vector products of vectors in space."""
    (x, y, z), (u, v, w) = (tuple(each[..., i] for i in range(3)) for each in (a, b))
    return jnp.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def transport(vector: Vectors, before: Vectors, after: Vectors) -> Vectors:
    """Transport vectors normal to a unit tangent ``before`` in parallel to a tangent ``after``.

    For opposite tangents it is undefined, and the result not finite.
    """
    share = dot(vector, after) / (1.0 + dot(before, after))
    return vector - share[..., None] * (before + after)


def spun(director: Vectors, tangent: Vectors, angle: Numbers) -> Vectors:
    """Rotate directors about their tangents, from ``m_1`` toward ``m_2``."""
    cos, sin = jnp.cos(angle)[..., None], jnp.sin(angle)[..., None]
    return cos * director + sin * cross(tangent, director)


def sinc(squared: Array) -> Array:
    """Return ``sin(a) / a`` of a squared angle, differentiable at zero."""
    small = squared < 1e-3
    angle = jnp.sqrt(jnp.where(small, 1.0, squared))
    series = 1.0 - squared / 6 * (1.0 - squared / 20 * (1.0 - squared / 42))
    return jnp.where(small, series, jnp.sin(angle) / angle)


def rotated(frame: Float[Array, "3 3"], rotation: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Rotate a frame by a rotation vector (Rodrigues's formula)."""
    squared = jnp.sum(rotation**2)
    swung = cross(rotation, frame)
    versine = 0.5 * sinc(0.25 * squared) ** 2
    return frame + sinc(squared) * swung + versine * cross(rotation, swung)


def turned(attitude: Float[Array, "d d"], rotation: Vector) -> Float[Array, "d d"]:
    """Turn an attitude about its own axes: by an angle in the plane, else a vector (rad)."""
    if rotation.size == 1:
        cosine, sine = jnp.cos(rotation[0]), jnp.sin(rotation[0])
        turn = jnp.stack([jnp.stack([cosine, -sine]), jnp.stack([sine, cosine])])
    else:
        turn = rotated(jnp.eye(3), rotation).T
    return product(attitude, turn)


def rotation_velocity(rate: Vector, points: Float[Array, "*many d"]) -> Float[Array, "*many d"]:
    """Return the velocities of points of a body that rotates about the origin."""
    return rate[0] * rotate_90(points) if rate.size == 1 else cross(rate, points)


def moments(
    levers: Float[Array, "*many d"], forces: Float[Array, "*many d"]
) -> Float[Array, "*many turns"]:
    """Return the moments of forces on levers about the origin."""
    if levers.shape[-1] == 3:
        return cross(levers, forces)
    return (levers[..., 0] * forces[..., 1] - levers[..., 1] * forces[..., 0])[..., None]


def angle_between(before: Vectors, after: Vectors, tangent: Vectors) -> Numbers:
    """Return the angle about a tangent from one director to another (rad, up to half a turn)."""
    return jnp.arctan2(dot(tangent, cross(before, after)), dot(before, after))


def twist_between(
    before: Vectors, last: Vectors, tangents: tuple[Vectors, Vectors], expected: Numbers
) -> Numbers:
    """Return the twist (rad) from the director of one edge to that of the next.

    Of the angles modulo a full turn it is the one nearest to ``expected``.
    """
    behind, ahead = tangents
    wrapped = angle_between(transport(before, behind, ahead), last, ahead)
    return wrapped + 2 * jnp.pi * jnp.round((expected - wrapped) / (2 * jnp.pi))


class Orientation(eqx.Module):
    """Orientation of the edges of a shape, by the node at which they end."""

    director: Float[Array, "*count n 3"]
    """Material director m_1 of each edge."""
    twist: Float[Array, "*count n"]
    """Twist at each node, between the edges that end and begin there (rad)."""
    lean: Float[Array, "*count n 3"]
    """Spin of each director about its tangent, over a change ``dt`` of the tangent: ``lean . dt``.

    Directors spin by that much at fixed spins, because transport from the tangent at the start of a
    step differs from transport from the latest one by the area between both paths on the sphere.
    """


class Frames(eqx.Module):
    """Frames of the edges of a rod of ``n`` nodes, from which those of a later shape follow.

    Row ``i`` is the edge that ends at node ``i``; the first row is unused. Frames are transported
    from the start of a step: transport along the straight path differs from that along the true one
    by the cube of the step only.
    """

    tangent: Float[Array, "n 3"]
    director: Float[Array, "n 3"]
    spin: Float[Array, " n"]
    """Spin of each edge about its axis since the start (rad)."""
    reference_twist: Float[Array, " n"]
    """Twist at each node, between the edges that end and begin there, less their spins (rad).

    It changes little from step to step, and so resolves the number of full turns.
    """

    @staticmethod
    def of(position: Float[Array, "n b"], orientation: Orientation) -> "Frames":
        """Build the frames of a shape from its orientation."""
        director, twist = orientation.director, orientation.twist
        tangent = tangents(position)
        normal = director - dot(director, tangent)[:, None] * tangent  # round-off adds up
        spin = position[:, 3]
        return Frames(
            tangent,
            normal / jnp.sqrt(dot(normal, normal))[:, None],
            spin,
            twist - jnp.pad(spin[2:] - spin[1:-1], 1),
        )

    def at(self, position: Float[Array, "n b"]) -> Orientation:
        """Return the orientation of the edges of a shape."""
        tangent = tangents(position)
        transported = transport(self.director, self.tangent, tangent)
        director = spun(transported, tangent, position[:, 3] - self.spin)
        behind, ahead = slice(1, -1), slice(2, None)
        twist = twist_between(
            director[behind],
            director[ahead],
            (tangent[behind], tangent[ahead]),
            self.reference_twist[behind] + position[ahead, 3] - position[behind, 3],
        )
        facing = 1.0 + dot(self.tangent, tangent)
        lean = cross(tangent, self.tangent) / facing[:, None]
        return Orientation(director, jnp.pad(twist, 1), lean)

    def spin_to(self, end: int, tangent: Float[Array, "3"], director: Float[Array, "3"]) -> Array:
        """Return the spin of the edge ending at a node for a given tangent and director."""
        transported = transport(self.director[end], self.tangent[end], tangent)
        return self.spin[end] + angle_between(transported, director, tangent)


def tangents(position: Float[Array, "n b"]) -> Float[Array, "n 3"]:
    """Return the direction of the edge that ends at each node; the first row is the second."""
    edge = position[1:, :3] - position[:-1, :3]
    tangent = edge / jnp.sqrt(dot(edge, edge))[:, None]
    return jnp.concatenate([tangent[:1], tangent])


@jax.custom_jvp
def unit(vector: Vector) -> tuple[Vector, Float[Array, ""]]:
    """Return the direction and the length of a vector."""
    length = jnp.sqrt(jnp.sum(vector * vector))
    return vector / length, length


@unit.defjvp
def _unit_jvp(at: tuple[Vector], by: tuple[Vector]) -> Any:
    # written by hand: automatic differentiation of the lines above is three times as long
    direction, length = unit(*at)
    (change,) = by
    longer = jnp.sum(direction * change)
    return (direction, length), ((change - longer * direction) / length, longer)


def rotate_90(vector: Float[Array, "... 2"]) -> Float[Array, "... 2"]:
    """Rotate planar vectors by a right angle, from +x toward +z."""
    return jnp.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def beyond(before: Vector, last: Vector) -> Vector:
    """Extrapolate two directions by half an edge beyond the last one."""
    middle, _ = unit(before + last)
    return 2.0 * jnp.sum(middle * last) * last - middle
