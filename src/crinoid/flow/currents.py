"""Currents: steady, oscillating, gusts, shear, and measured records."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.flow.flow import Everywhere, Flow, Point, Time, displacement
from crinoid.numerics.piecewise import PiecewisePolynomial
from crinoid.numerics.ramp import Onset
from crinoid.numerics.small_matrices import product


class Uniform(Everywhere):
    """Uniform steady current: ``u = velocity``."""

    steady: ClassVar[bool] = True
    onset: Onset
    uniform_velocity: Float[Array, " b"]
    """Velocity (m/s)."""

    @property
    def uniform_mean(self) -> Point:
        return self.uniform_velocity

    def at(self, time: Time) -> Point:
        return self.uniform_velocity

    def displacement(self, time: Time) -> Point:
        return self.uniform_velocity * self.onset.elapsed(time)


class Sine(Everywhere):
    """Oscillating current: ``u = amplitude sin(2 pi f t + phase)``."""

    steady: ClassVar[bool] = False

    onset: Onset
    amplitude: Float[Array, " b"]
    """Amplitude of the velocity (m/s)."""
    frequency: Float[Array, ""]
    """Frequency (Hz)."""
    phase: Float[Array, ""]
    """Phase at time zero (rad)."""

    def at(self, time: Time) -> Point:
        angle = 2 * jnp.pi * self.frequency * time + self.phase
        return self.amplitude * jnp.sin(angle)

    def displacement(self, time: Time) -> Point:
        onset, turn = self.onset, 2 * jnp.pi * self.frequency
        # not `clip`, which has half the slope at its ends
        since = jnp.where(time < onset.stop, time, onset.stop) - onset.start
        since = jnp.where(since > 0, since, 0.0)
        # in the ramp sin(a) (1 - cos(b)) / 2 is a sum of three sines
        own = jnp.pi / jnp.where(onset.ramp_time > 0, onset.ramp_time, 1.0)
        rates = turn + own * np.array([0.0, 0.0, 1.0, -1.0])
        passed = jnp.where(since < onset.ramp_time, since, onset.ramp_time)
        spans = jnp.stack([since, passed, passed, passed])
        half = 0.5 * rates * spans
        begin = turn * onset.start + self.phase
        paths = spans * jnp.sinc(half / jnp.pi) * jnp.sin(begin + half)
        return self.amplitude * jnp.sum(np.array([1.0, -0.5, -0.25, -0.25]) * paths)


class Gust(Everywhere):
    """The 1-cosine gust: ``u = peak (1 - cos(2 pi s)) / 2`` with ``s = (t - start) / duration``.

    Zero before its start and after its duration (the discrete gust of IEC 61400-1).
    """

    steady: ClassVar[bool] = False

    onset: Onset
    peak: Float[Array, " b"]
    """Velocity at the middle of the gust (m/s)."""
    duration: Float[Array, ""]
    """Length of the gust (s)."""

    def at(self, time: Time) -> Point:
        return self.peak * (0.5 - 0.5 * jnp.cos(2 * jnp.pi * self._share(time)))

    def path(self, time: Time) -> Point:
        share = self._share(time)
        swing = jnp.sin(2 * jnp.pi * share) / (2 * jnp.pi)
        return 0.5 * self.peak * self.duration * (share - swing)

    def _share(self, time: Time) -> Float[Array, ""]:
        """Return the elapsed share of the gust."""
        return jnp.clip((time - self.onset.start) / self.duration, 0.0, 1.0)


class Shear(Flow):
    """Steady current that depends on the height above the bed."""

    steady: ClassVar[bool] = True
    onset: Onset
    reference_velocity: Float[Array, " b"]
    """Velocity at the reference height (m/s)."""
    reference_height: Float[Array, ""]
    """Height above the bed at which the reference velocity is reached (m)."""
    bed: Float[Array, ""]
    """Upward coordinate of the sea bed (m)."""


class PowerShear(Shear):
    """Power-law profile ``u = velocity (h / h_ref)^exponent``, h the height above the bed."""

    exponent: Float[Array, ""]
    """Exponent of the height (1)."""

    def fully_on(self, point: Point, time: Time) -> Point:
        height = point[-1] - self.bed
        above = height > 0
        # the power has an infinite slope at the bed: keep the unused branch finite
        relative = jnp.where(above, height, self.reference_height) / self.reference_height
        return jnp.where(above, relative**self.exponent, 0.0) * self.reference_velocity


class LogarithmicShear(Shear):
    """Logarithmic profile ``u = velocity ln(h / z_0) / ln(h_ref / z_0)``; 0 below z_0."""

    roughness_length: Float[Array, ""]
    """Roughness length of the bed (m)."""

    def fully_on(self, point: Point, time: Time) -> Point:
        relative = jnp.maximum((point[-1] - self.bed) / self.roughness_length, 1.0)
        scale = jnp.log(self.reference_height / self.roughness_length)
        return jnp.log(relative) / scale * self.reference_velocity


class MeasuredPoint(Flow):
    """Record at one position, advected past the arm: ``u = record(t - slowness . (x - met))``.

    With ``slowness = U / |U|^2`` the pattern of the current drifts unchanged at its mean velocity
    U: the frozen turbulence of G. I. Taylor, The spectrum of turbulence, Proc. R. Soc.
    A 164 (1938). With zero the water moves as one. A record with a given phase speed travels and
    is not carried by the water.
    """

    steady: ClassVar[bool] = False

    onset: Onset
    record: PiecewisePolynomial
    """Velocity (m/s) over the time of the run (s)."""
    met: Float[Array, " b"]
    """Position of the record (m)."""
    slowness: Float[Array, " b"]
    """Delay of the record over distance (s/m)."""
    carried: bool = eqx.field(static=True)
    """Whether the record drifts with the water at its mean velocity."""
    panels: int = eqx.field(static=True, default=1)
    """Panels of the quadrature of its ramp."""

    @property
    def drifts(self) -> bool:
        return self.carried

    def fully_on(self, point: Point, time: Time) -> Point:
        return self.record(time - product(self.slowness, point - self.met))

    def displacement(self, time: Time) -> Point:
        if self.carried:  # only the mean is uniform
            mean = self.slowness / jnp.sum(self.slowness**2)
            return mean * self.onset.elapsed(time)
        return displacement(self.onset, self.record.integral, time, self.panels)


class MeasuredProfile(Flow):
    """Record at several heights, uniform at each height: cubic in time and in height.

    In height it is Hermite's cubic between two levels, so that a look-up needs these two only; its
    slope is continuous between the outermost levels, and beyond them it is constant. With a
    slowness it travels, as `MeasuredPoint` does.
    """

    steady: ClassVar[bool] = False

    onset: Onset
    record: PiecewisePolynomial
    """Velocity (m/s) and its slope in z (1/s) of each level, over the time of the run (s)."""
    levels: Float[Array, " level"]
    """Heights z (m), increasing, two or more."""
    met: Float[Array, " b"] | None = None
    """Position at which it is met without delay (m); None: it is uniform at each height."""
    slowness: Float[Array, " b"] | None = None
    """Delay of the record over distance (s/m)."""

    def fully_on(self, point: Point, time: Time) -> Point:
        if self.slowness is not None and self.met is not None:
            time = time - product(self.slowness, point - self.met)
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
