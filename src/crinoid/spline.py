"""Piecewise cubic functions of time, as arrays that compiled code can evaluate and derive."""

from __future__ import annotations

from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

_EVEN = 1e-9
"""Part of a spacing by which even knots may be off: round-off."""


class PiecewiseCubic(eqx.Module):
    """A function of time with values of shape ``(c,)``; held constant outside its knots.

    Built from any SciPy piecewise cubic (`CubicSpline`, `PchipInterpolator`, ...), so how the
    points are joined is the caller's choice.
    """

    knots: Float[Array, " k"]
    coefficients: Float[Array, "4 k-1 c"]
    even: bool = eqx.field(static=True)
    """Whether the knots lie evenly, so that a piece is found without a search."""

    def __init__(self, interpolant: PPoly) -> None:
        coefficients = np.asarray(interpolant.c, float)
        knots = np.asarray(interpolant.x, float)
        # a time so near a knot may be given to the piece beside it, which goes on from there with
        # the same slope and curvature, or for less smooth ones nearly so
        spacing = (knots[-1] - knots[0]) / (knots.size - 1)
        ideal = knots[0] + spacing * np.arange(knots.size)
        self.even = bool(np.abs(knots - ideal).max() <= _EVEN * spacing)
        self.knots = jnp.asarray(knots)
        self.coefficients = jnp.asarray(coefficients.reshape(*coefficients.shape[:2], -1))

    def __call__(self, time: Float[Array, ""] | float) -> Float[Array, " c"]:
        """Return the value at ``time`` (s)."""
        return self.columns(time, 0, self.coefficients.shape[2])

    def columns(
        self, time: Float[Array, ""] | float, first: Int[Array, ""] | int, count: int
    ) -> Float[Array, " {count}"]:
        """Return ``count`` entries of the value at ``time`` (s), from ``first`` on.

        Of a value with many entries only those that are asked for are looked up.
        """
        begin, end = self.knots[0], self.knots[-1]
        # not `clip`, which has half the slope at the knots at both ends; and a time that round-off
        # puts past the end still moves
        slack = 1e-9 * (end - begin)
        time = jnp.where(time < begin - slack, begin, jnp.where(time > end + slack, end, time))
        if self.even:
            found = jnp.floor((time - begin) * (self._last + 1) / (end - begin)).astype(jnp.int32)
        else:
            found = jnp.searchsorted(self.knots, time, side="right").astype(jnp.int32) - 1
        piece = jnp.clip(found, 0, self._last)
        start = [jnp.asarray(index, jnp.int32) for index in (0, piece, first)]
        polynomials = jax.lax.dynamic_slice(self.coefficients, start, (4, 1, count))
        cubic, square, linear, constant = polynomials[:, 0]
        since = time - self.knots[piece]
        return ((cubic * since + square) * since + linear) * since + constant

    @property
    def _last(self) -> int:
        return self.knots.shape[0] - 2
