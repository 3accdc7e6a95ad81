"""Friction of a thread in its channel.

With Coulomb friction in its channel the tension of a thread falls along the arm by
``dT = -mu T s dtheta`` (Euler-Eytelwein, the capstan), where ``theta`` is the angle by which its
path turns in space and ``s`` the direction in which it slides, 1 toward the root. By ``dx`` of
sliding it changes as ``ds = (1 - s sign(dx)) dx / x_0`` (Dahl 1968; of tendons in sheaths Do et
al. 2014, Mechatronics 24(1)), so that a thread that stops keeps its tension.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.foundation.fixed_numbers import EVEN


class Sliding(NamedTuple):
    """Memory of the friction of threads, for each lane."""

    direction: Float[Array, "*count lane"]
    """``s`` at the start of the last step."""
    before: Float[Array, "*count lane"]
    """Path at the start of the last step (m)."""
    path: Float[Array, "*count lane"]
    """Path at its end (m)."""
    wrap: Float[Array, "*count lane"]
    """Angle by which the path turns, at its end (rad)."""
    factor: Float[Array, "*count lane"]
    """Tension over that at the root end, in the last step."""


class Capstan(NamedTuple):
    """Friction on the way from the root end to each lane, at the start of a step."""

    friction: Float[Array, "*count lane"]
    """``mu theta``."""
    direction: Float[Array, "*count lane"]
    """Mean of ``s`` over the angle ``theta``."""
    reach: Float[Array, "*count lane"]
    """Mean of the length beyond, over ``x_0``."""


class Rubbing(NamedTuple):
    """Memory of the friction of threads during a step."""

    sliding: Sliding
    """At its start."""
    capstan: Capstan

    def factor(self, path: Float[Array, " lane"]) -> Float[Array, " lane"]:
        """Return the tension over that at the root end, from the paths at the end of the step.

        In the step a thread slides as if all of it lengthened as it does here. So the change is
        local, and not smaller than the true one: sticking threads are stable, and damped.
        """
        hold = self.capstan
        slid = -hold.reach * (path / self.sliding.path - 1.0)
        return jnp.exp(-hold.friction * slide(hold.direction, slid))


def slide(
    direction: Float[Array, "*count lane"], slid: Float[Array, "*count lane"]
) -> Float[Array, "*count lane"]:
    """Return the direction of sliding after sliding toward the root, over ``x_0``."""
    size = jnp.sqrt(slid**2 + EVEN**2)
    return direction * jnp.exp(EVEN - size) - slid * jnp.expm1(-size) / size
