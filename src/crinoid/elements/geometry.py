"""Plane geometry that several elements share."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Vector = Float[Array, " b"]


def unit(vector: Vector) -> tuple[Vector, Float[Array, ""]]:
    """Return the direction and the length of a vector."""
    length = jnp.sqrt(jnp.sum(vector * vector))
    return vector / length, length


def turned(vector: Float[Array, "... 2"]) -> Float[Array, "... 2"]:
    """Turn planar vectors by a right angle, from +x toward +z."""
    return jnp.stack([-vector[..., 1], vector[..., 0]], axis=-1)


def smooth_speed(squared: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return the root of a squared speed, with a derivative at rest.

    The rounding is 1e-9 m/s wide: above 1e-6 m/s it changes a drag force by less than 1e-6 of it.
    """
    return jnp.sqrt(squared + 1e-18)
