"""Currents as they were measured."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.flow.flow import Flow, Point, Time, displacement
from crinoid.onset import Onset
from crinoid.products import product
from crinoid.spline import PiecewisePolynomial


class MeasuredPoint(Flow):
    """A record at one position, carried past the arm: ``u = record(t - slowness . (x - met))``.

    With ``slowness = U / |U|^2`` the pattern of the current drifts along unchanged at its mean
    velocity U: the frozen turbulence of G. I. Taylor, The spectrum of turbulence, Proc. R. Soc.
    A 164 (1938). With zero the water moves as one.
    """

    onset: Onset
    record: PiecewisePolynomial
    """Velocity (m/s) over the time of the run (s)."""
    met: Float[Array, " b"]
    """Position at which the record is met at its own time (m)."""
    slowness: Float[Array, " b"]
    """Delay of the record over distance (s/m)."""
    carried: bool = eqx.field(static=True)
    """Whether there is one."""
    panels: int = eqx.field(static=True, default=1)
    """Panels of the quadrature of its ramp."""

    @property
    def drifts(self) -> bool:
        return self.carried

    def fully_on(self, point: Point, time: Time) -> Point:
        return self.record(time - product(self.slowness, point - self.met))

    def displacement(self, time: Time) -> Point:
        if self.carried:  # of its fluctuation only the mean is the same everywhere
            mean = self.slowness / jnp.sum(self.slowness**2)
            return mean * self.onset.elapsed(time)
        return displacement(self.onset, self.record.integral, time, self.panels)


class MeasuredProfile(Flow):
    """A record at several heights, the same everywhere at a height: cubic in time and in height.

    In height it is Hermite's cubic between two levels, so that a look-up touches these two only;
    its slope is continuous. Below the first level and above the last one it stays constant.
    """

    onset: Onset
    record: PiecewisePolynomial
    """Over the time of the run (s); of each level in turn velocity (m/s) and its slope in z (1/s).

    The slopes of the first and the last level are zero.
    """
    levels: Float[Array, " level"]
    """Heights z (m), increasing, two or more."""

    def fully_on(self, point: Point, time: Time) -> Point:
        height = point[-1]
        # few enough to be compared all at once; the outermost levels bound nothing
        below = jnp.sum(height >= self.levels[1:-1])
        width = point.shape[0]
        values = self.record.columns(time, below * 2 * width, 4 * width)
        lower, slope_lower, upper, slope_upper = values.reshape(4, width)
        bottom = self.levels[below]
        thickness = self.levels[below + 1] - bottom
        # `where`, as `clip` has half the slope at its ends
        share = (height - bottom) / thickness
        share = jnp.where(share < 0, 0.0, jnp.where(share > 1, 1.0, share))
        rest = 1 - share
        return rest**2 * ((1 + 2 * share) * lower + share * thickness * slope_lower) + share**2 * (
            (1 + 2 * rest) * upper - rest * thickness * slope_upper
        )
