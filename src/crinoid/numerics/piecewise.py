"""Piecewise polynomials of time for compiled code."""

from __future__ import annotations

from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

_EVEN = 1e-9  # tolerance of even knots, over their spacing


class PiecewisePolynomial(eqx.Module):
    """Piecewise polynomial of time with values of shape ``(c,)``; constant outside its knots.

    Built from any SciPy piecewise polynomial (``CubicSpline``, `shape_preserving`, ...).
    """

    knots: Float[Array, " k"]
    coefficients: Float[Array, "order k-1 c"]  # highest power first
    sums: Float[Array, "k-1 c"]  # integral from the first knot to the start of each piece
    even: bool = eqx.field(static=True)
    """Whether the knots are evenly spaced, so that no search is needed."""

    def __init__(self, interpolant: PPoly) -> None:
        coefficients = np.asarray(interpolant.c, float)
        knots = np.asarray(interpolant.x, float)
        # a time so near a knot may fall into the adjacent piece: its slope and curvature are close
        spacing = (knots[-1] - knots[0]) / (knots.size - 1)
        ideal = knots[0] + spacing * np.arange(knots.size)
        self.even = bool(np.abs(knots - ideal).max() <= _EVEN * spacing)
        self.knots = jnp.asarray(knots)
        self.coefficients = jnp.asarray(coefficients.reshape(*coefficients.shape[:2], -1))
        powers = np.arange(len(coefficients), 0, -1)[:, None]
        widths = np.diff(knots) ** powers / powers
        pieces = np.einsum("ok,okc->kc", widths, np.asarray(self.coefficients))
        self.sums = jnp.asarray(np.cumsum(pieces, axis=0) - pieces)

    def __call__(self, time: Float[Array, ""] | float) -> Float[Array, " c"]:
        """Return the value at ``time`` (s)."""
        return self.columns(time, 0, self.coefficients.shape[2])

    def integral(self, time: Float[Array, ""] | float) -> Float[Array, " c"]:
        """Return the integral from the first knot to ``time`` (s)."""
        inside, piece = self._locate(time)
        since = inside - self.knots[piece]
        value = jnp.zeros_like(self.sums[0])
        for power, coefficient in zip(
            range(self.coefficients.shape[0], 0, -1), self.coefficients[:, piece], strict=True
        ):
            value = (value + coefficient / power) * since
        return self.sums[piece] + value + self(time) * (time - inside)

    def columns(
        self, time: Float[Array, ""] | float, first: Int[Array, ""] | int, count: int
    ) -> Float[Array, " {count}"]:
        """Return only ``count`` entries of the value at ``time`` (s), from ``first`` on."""
        time, piece = self._locate(time)
        order = self.coefficients.shape[0]
        start = [jnp.asarray(index, jnp.int32) for index in (0, piece, first)]
        polynomials = jax.lax.dynamic_slice(self.coefficients, start, (order, 1, count))
        value, *rest = polynomials[:, 0]
        since = time - self.knots[piece]
        for coefficient in rest:
            value = value * since + coefficient
        return value

    def _locate(self, time: Float[Array, ""] | float) -> tuple[Float[Array, ""], Int[Array, ""]]:
        """Return a time clamped to the outermost knots, and its piece."""
        begin, end = self.knots[0], self.knots[-1]
        # not `clip`, which has half the slope at both ends; with slack, so that round-off past the
        # end does not remove the slope
        slack = 1e-9 * (end - begin)
        time = jnp.where(time < begin - slack, begin, jnp.where(time > end + slack, end, time))
        if self.even:
            found = jnp.floor((time - begin) * (self._last + 1) / (end - begin)).astype(jnp.int32)
        else:
            found = jnp.searchsorted(self.knots, time, side="right").astype(jnp.int32) - 1
        return time, jnp.clip(found, 0, self._last)

    @property
    def _last(self) -> int:
        return self.knots.shape[0] - 2


def shape_preserving(times: Float[np.ndarray, " k"], values: Float[np.ndarray, " k *c"]) -> PPoly:
    """Interpolate points in time by monotone quintics.

    The curve never overshoots its points, and its second derivative is continuous. The slopes at
    the points are those of F. N. Fritsch and J. Butland (SIAM J. Sci. Stat. Comput. 5 (1984)
    300-304), the second derivatives a mean of those of cubics with these slopes on either side.
    Where a quintic's Bernstein coefficients are not monotone, which would suffice for the curve,
    slopes and second derivatives are reduced at its ends.
    """
    from scipy.interpolate import BPoly, PchipInterpolator, PPoly  # slow to load

    times, values = np.asarray(times, float), np.asarray(values, float)
    step = np.diff(times).reshape(-1, *[1] * (values.ndim - 1))
    rise = np.diff(values, axis=0)
    slope = np.asarray(PchipInterpolator(times, values)(times, 1))
    first, last = slope[:-1], slope[1:]
    bend = np.zeros_like(values)
    weight = np.zeros((times.size, *step.shape[1:]))
    for ends, cubic in (
        (slice(None, -1), (6 * rise / step - 4 * first - 2 * last) / step),
        (slice(1, None), (4 * last + 2 * first - 6 * rise / step) / step),
    ):
        bend[ends] += cubic / step
        weight[ends] += 1 / step
    bend /= weight
    # the coefficients are y0, y0 + h s0/5, y0 + 2 h s0/5 + h^2 k0/20, likewise from the other end;
    # the second step from either end limits each second derivative ...
    for ends, sign in ((slice(None, -1), 1.0), (slice(1, None), -1.0)):
        falls = sign * rise <= 0
        flat = rise == 0
        limit = -sign * 4 * slope[ends] / step
        limited = np.where(falls, np.minimum(bend[ends], limit), np.maximum(bend[ends], limit))
        bend[ends] = np.where(flat, 0.0, limited)
    # ... and the middle step has the rest of the rise
    steps = [
        np.abs(2 * step * slope[ends] / 5 + sign * step**2 * bend[ends] / 20)
        for ends, sign in ((slice(None, -1), 1.0), (slice(1, None), -1.0))
    ]
    total = steps[0] + steps[1]
    share = np.where(total > np.abs(rise), np.abs(rise) / np.where(total > 0, total, 1.0), 1.0)
    least = np.ones_like(values)
    least[:-1] = share
    least[1:] = np.minimum(least[1:], share)
    curve = BPoly.from_derivatives(times, np.stack([values, least * slope, least * bend], axis=1))
    return PPoly.from_bernstein_basis(curve)


def between(interpolant: PPoly, first: float, last: float) -> PPoly:
    """Return the pieces from one time to another (s)."""
    from scipy.interpolate import PPoly

    knots = interpolant.x
    start = max(int(np.searchsorted(knots, first, side="right")) - 1, 0)
    stop = min(int(np.searchsorted(knots, last, side="left")), knots.size - 1)
    stop = max(stop, start + 1)
    return PPoly(interpolant.c[:, start:stop], knots[start : stop + 1])
