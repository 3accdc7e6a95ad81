"""Wave numbers of linear surface waves on a mean current."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.foundation.fixed_numbers import WAVE_NUMBER_CHANGE, WAVE_NUMBER_STEPS
from crinoid.numerics.dispersion import deep_wave_number, dispersion


def wave_number(frequency: Any, depth: Any, gravity: Any, current: Any = 0.0) -> Float[Array, " f"]:
    """Solve the dispersion relation ``omega = sigma + k U`` for ``k`` (rad/m); traceable.

    ``sigma^2 = g k tanh(k h)``. ``current`` is ``U`` along the direction of travel (m/s). Against
    it, of two solutions the one whose energy travels on; NaN of a wave that it stops.
    """

    def improved(number: Array, given: tuple[Array, ...]) -> Array:
        frequency, depth, gravity, current = given
        sigma, group = dispersion(number, depth, gravity, jnp)
        return number + (frequency - sigma - number * current) / (group + current)

    given = tuple(jnp.asarray(each, float) for each in (frequency, depth, gravity, current))
    omega, height, pull, speed = fixed = jax.lax.stop_gradient(given)
    # sigma is at most that of deep and of shallow water: so both numbers are too small, and as
    # the residual is concave Newton's method only rises from there
    shallow = omega / (jnp.sqrt(pull * height) + speed)
    first = jnp.maximum(deep_wave_number(omega, pull, speed), shallow)

    def rises(state: tuple[Array, Array, Array]) -> Array:
        count, before, now = state
        moved = jnp.abs(now - before) > WAVE_NUMBER_CHANGE * now
        return (count < WAVE_NUMBER_STEPS) & jnp.any(moved)

    def rise(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        count, _, now = state
        return count + 1, now, improved(now, fixed)

    start = (jnp.asarray(0), first, improved(first, fixed))
    _, _, found = jax.lax.while_loop(rises, rise, start)
    # one more step has the derivative of the solution
    return improved(found, given)
