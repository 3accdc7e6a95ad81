"""Geometry that several elements share."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Vector = Float[Array, " b"]


@jax.custom_jvp
def unit(vector: Vector) -> tuple[Vector, Float[Array, ""]]:
    """Return the direction and the length of a vector."""
    length = jnp.sqrt(jnp.sum(vector * vector))
    return vector / length, length


@unit.defjvp
def _unit_jvp(at: tuple[Vector], by: tuple[Vector]) -> Any:
    # as one would write it down: what follows from the lines above is three times as long
    direction, length = unit(*at)
    (change,) = by
    longer = jnp.sum(direction * change)
    return (direction, length), ((change - longer * direction) / length, longer)


def turned(vector: Float[Array, "... 2"]) -> Float[Array, "... 2"]:
    """Turn planar vectors by a right angle, from +x toward +z."""
    return jnp.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def beyond(before: Vector, last: Vector) -> Vector:
    """Return the direction half an edge past the last of two: their turn is carried on."""
    middle, _ = unit(before + last)
    return 2.0 * jnp.sum(middle * last) * last - middle


def bend_strain(tangent: Float[Array, "..."], secant: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return the strain of a bend from tangent and secant of half its angle.

    ``(2 tan(a / 2) + 4 sin(a / 2)) / 3``, Snell's and Huygens's bounds of the arc put together:
    the angle ``a`` itself but for ``a^5 / 320``, yet without bound as the edges fold onto each
    other. The binormal ``2 tan(a / 2)`` alone would stiffen a bend by ``a^2 / 3``.
    """
    return 2.0 / 3.0 * tangent * (1.0 + 2.0 / secant)


def smooth_speed(squared: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return the root of a squared speed, with a derivative at rest.

    The rounding is 1e-9 m/s wide: above 1e-6 m/s it changes a drag force by less than 1e-6 of it.
    """
    return jnp.sqrt(squared + 1e-18)
