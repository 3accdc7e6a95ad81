"""Sine and cosine of an angle in turns: for flows that are sums of hundreds of waves.

The library functions of the compiler work on one number at a time; these few products and sums
it does on as many as the processor takes at once. Counting in turns makes the reduction of a
large angle exact: taking off whole turns is a subtraction without round-off.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

# sin(2 pi v) = v p(v^2) for |v| <= 1/4: p interpolates at the Chebyshev points of v^2 and is off
# by less than 1e-18
_SINE = (
    6.283185307179586,
    -41.341702240399755,
    81.60524927607362,
    -76.70585975282492,
    42.058693925428685,
    -15.0946416761179,
    3.8199280942271643,
    -0.7177337921413454,
    0.10089695501646812,
)


@jax.custom_jvp
def cosine(turns: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Return ``cos(2 pi turns)``, within 4e-16."""
    return _wave(turns, 0.0)


@jax.custom_jvp
def sine(turns: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Return ``sin(2 pi turns)``, within 4e-16."""
    return _wave(turns, 0.25)


cosine.defjvps(lambda tangent, _, turns: -2 * jnp.pi * sine(turns) * tangent)
sine.defjvps(lambda tangent, _, turns: 2 * jnp.pi * cosine(turns) * tangent)


@jax.custom_jvp
def cosine_and_sine(turns: Float[Array, "*n"]) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Return both.

    Each is the derivative of the other: reverse mode keeps these two arrays and no more.
    """
    return cosine(turns), sine(turns)


@cosine_and_sine.defjvp
def _cosine_and_sine_jvp(
    primals: tuple[Array], tangents: tuple[Array]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    (cos, sin), angle = cosine_and_sine(*primals), 2 * jnp.pi * tangents[0]
    return (cos, sin), (-sin * angle, cos * angle)


def _wave(turns: Float[Array, "*n"], crest: float) -> Float[Array, "*n"]:
    """Return a wave that crests at ``crest`` (turns)."""
    away = jnp.abs(turns - jnp.round(turns - crest) - crest)
    quarter = 0.25 - away  # cos(2 pi away) = sin(2 pi quarter)
    square = quarter * quarter
    series = jnp.full_like(square, _SINE[-1])
    for coefficient in _SINE[-2::-1]:
        series = series * square + coefficient
    return quarter * series
