"""Turbulence: a Gauss-Markov process in time, and frozen random Fourier modes."""

from collections.abc import Sequence
from itertools import accumulate
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.flow.flow import Everywhere, Flow, Jet, Point, Time, panels_of
from crinoid.numerics.piecewise import PiecewisePolynomial
from crinoid.numerics.ramp import Onset
from crinoid.numerics.small_matrices import long_product

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
    """Return both; as each is the derivative of the other, reverse mode stores only these two."""
    return cosine(turns), sine(turns)


@cosine_and_sine.defjvp
def _cosine_and_sine_jvp(
    primals: tuple[Array], tangents: tuple[Array]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    (cos, sin), angle = cosine_and_sine(*primals), 2 * jnp.pi * tangents[0]
    return (cos, sin), (-sin * angle, cos * angle)


def _wave(turns: Float[Array, "*n"], crest: float) -> Float[Array, "*n"]:
    """Return a cosine with its crest at ``crest`` (turns)."""
    away = jnp.abs(turns - jnp.round(turns - crest) - crest)
    quarter = 0.25 - away  # cos(2 pi away) = sin(2 pi quarter)
    square = quarter * quarter
    series = jnp.full_like(square, _SINE[-1])
    for coefficient in _SINE[-2::-1]:
        series = series * square + coefficient
    return quarter * series


POINTS_PER_CORRELATION_TIME = 20
"""Sampling of the process: the spline through the points has 99.6 % of its variance."""
_MARGIN = 40
"""Points before and after the record, so that the ends of the spline do not affect it."""


class GaussMarkov(Everywhere):
    """Uniform flow; in time a Gauss-Markov (Ornstein-Uhlenbeck) process for each axis.

    Its correlation falls as ``exp(-|lag| / correlation_time)``. The process itself has no
    acceleration anywhere; it is drawn exactly at points in time, independent of the time step,
    joined by a cubic spline.
    """

    steady: ClassVar[bool] = False
    onset: Onset
    mean: Float[Array, " b"]
    """Mean velocity (m/s)."""
    standard_deviation: Float[Array, " b"]
    """Standard deviation of each component (m/s)."""
    record: PiecewisePolynomial
    """Deviation of the velocity from the mean, over the standard one, over time (s)."""

    @staticmethod
    def of(
        onset: Onset,
        *,
        mean: Sequence[float] | Float[np.ndarray, " b"],
        standard_deviation: float | Sequence[float] | Float[np.ndarray, "*b"],
        correlation_time: float,
        duration: float,
        generator: np.random.Generator,
    ) -> "GaussMarkov":
        """Draw a record from t = 0 to ``duration`` (s), past which the velocity is constant.

        ``mean`` (m/s) has an entry for each axis, ``standard_deviation`` (m/s) too, or one for all.
        A longer record of the same generator starts with the shorter one, and a spatial one equals
        the planar one along x and z.
        """
        from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

        mean = np.asarray(mean, float)
        step = correlation_time / POINTS_PER_CORRELATION_TIME
        points = np.arange(-_MARGIN, np.ceil(duration / step) + _MARGIN + 1)
        normal = generator.standard_normal((points.size, 2))
        if mean.size == 3:
            aside = generator.spawn(1)[0].standard_normal(points.size)
            normal = np.insert(normal, 1, aside, axis=1)
        # exact for any step: V <- a V + sqrt(1 - a^2) xi, a = exp(-step / T) (Gillespie 1996),
        # from the stationary distribution
        decay = np.exp(-step / correlation_time)
        drawn = np.sqrt(1 - decay**2) * normal
        drawn[0] = normal[0]
        wandering = np.array(list(accumulate(drawn, lambda value, new: decay * value + new)))
        record = PiecewisePolynomial(CubicSpline(step * points, wandering))
        deviation = np.broadcast_to(np.asarray(standard_deviation, float), mean.shape)
        panels = panels_of(float(onset.ramp_time), 4 * step)
        put = jax.device_put
        return GaussMarkov(onset, put(mean), put(deviation), record, panels=panels)

    @property
    def uniform_mean(self) -> Point:
        return self.mean

    def at(self, time: Time) -> Point:
        return self.mean + self.standard_deviation * self.record(time)

    def path(self, time: Time) -> Point:
        return self.mean * time + self.standard_deviation * self.record.integral(time)


# The spectrum is cut at these values of k L_e, and the rest is raised to the full variance. 6e-5 of
# the variance lie below, 3.2 % above, in eddies shorter than 1/36 of the length scale: these would
# average out over the thickness of an arm and the distance of its nodes, but not at points.
_LEAST, _MOST = 0.2, 300.0
# (1, 2, 3) powers of the root of g^4 = g + 1: multiples of these fill a cube evenly, any number
# of them and from any one on (the generalised golden ratio; Roberts 2018)
_EVENLY = 1.2207440846057596 ** -np.arange(1.0, 4.0)


class Turbulence(Flow):
    """Mean flow and frozen turbulence: ``u = mean + sum_m a_m cos(k_m . (x - X) + p_m)``.

    The mean and the other flows advect its eddies: ``X`` is the displacement of all uniform flow,
    here of the mean; `Water` adds the others.
    Random Fourier modes (Kraichnan 1970) with the spectrum of von Karman (1948). The amplitude
    of each mode is normal to its wave vector, so that the flow has no divergence. Turbulence is
    three-dimensional; a planar arm sees the cut ``y = 0`` through it.
    """

    steady: ClassVar[bool] = False
    onset: Onset
    mean: Float[Array, " b"]
    """Mean velocity (m/s)."""
    wave_vectors: Float[Array, "m b"]
    """Wave vector of each mode, along the axes of the arm (rad/m)."""
    relative_amplitudes: Float[Array, "m b"]
    """Amplitude of each mode, along the axes of the arm, over the magnitude of the mean."""
    phases: Float[Array, " m"]
    """Phases, in turns."""

    @staticmethod
    def of(
        onset: Onset,
        *,
        mean: Sequence[float] | Float[np.ndarray, " b"],
        intensity: float,
        length_scale: float,
        modes: int,
        generator: np.random.Generator,
    ) -> "Turbulence":
        """Draw turbulence.

        Parameters
        ----------
        mean
            Velocity (m/s) along x, z or along x, y, z.
        intensity
            Standard deviation of each component over the magnitude of ``mean``.
        length_scale
            Longitudinal integral scale (m).
        modes
            Number of Fourier modes.
        generator
            Generator of random numbers.
        """
        from scipy.special import betainc, gamma  # slow to load, and few scenarios need it

        mean = np.asarray(mean)

        # E(k) ~ (k L_e)^4 / (1 + (k L_e)^2)^(17/6), whose integral scale is
        # L_u = sqrt(pi) Gamma(5/6) / Gamma(1/3) L_e; the energy below k is an incomplete beta
        # function. One mode somewhere in each of many intervals that are equal in log k carries
        # the energy of the interval.
        energetic_length = length_scale * gamma(1 / 3) / (np.sqrt(np.pi) * gamma(5 / 6))
        bounds = np.geomspace(_LEAST, _MOST, modes + 1)
        energy = np.diff(betainc(5 / 2, 1 / 3, bounds**2 / (1 + bounds**2)))
        shift = generator.random(modes)
        wave_number = bounds[:-1] ** (1 - shift) * bounds[1:] ** shift / energetic_length

        direction, normal = _spread(modes, generator)
        # over three components: sum of a^2 / 2 = 3 intensity^2
        amplitude = intensity * np.sqrt(6 * energy / energy.sum())
        axes = [0, 2] if mean.size == 2 else [0, 1, 2]
        return Turbulence(
            onset,
            jax.device_put(mean),
            jax.device_put(wave_number[:, None] * direction[:, axes]),
            jax.device_put(amplitude[:, None] * normal[:, axes]),
            jax.device_put(generator.random(modes)),
        )

    @property
    def drifts(self) -> bool:
        return True

    @property
    def uniform_mean(self) -> Point:
        return self.mean

    @property
    def amplitudes(self) -> Float[Array, "... m b"]:
        """Amplitude of each mode, along the axes of the arm (m/s)."""
        return jnp.linalg.norm(self.mean, axis=-1)[..., None, None] * self.relative_amplitudes

    def fully_on(self, point: Point, time: Time) -> Point:
        return self.mean + long_product(cosine(self._turns(point, time)), self.amplitudes)

    def displacement(self, time: Time) -> Point:
        return self.mean * self.onset.elapsed(time)

    def fully_on_jet(self, point: Point, time: Time) -> Jet:
        size = point.shape[0]
        first = -self.amplitudes[:, :, None] * self.wave_vectors[:, None, :]
        first = first.reshape(len(first), -1)
        cos, sin = cosine_and_sine(self._turns(point, time))
        # two products for each point
        velocity = self.mean + long_product(cos, self.amplitudes)
        gradient = long_product(sin, first).reshape(size, size)
        # advected: d/dt = -(X' . grad)
        return Jet(velocity, gradient, -jnp.sum(gradient * self.onset(time) * self.mean, axis=-1))

    def _turns(self, point: Point, time: Time) -> Float[Array, " m"]:
        phase = long_product(self.wave_vectors, point - self.displacement(time))
        return self.phases + phase / (2 * jnp.pi)


def _spread(
    modes: int, generator: np.random.Generator
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m 3"]]:
    """Return unit vectors in all directions, and one normal to each of them.

    Directions and polarisations are spread evenly within any run of modes, so that every draw is
    nearly isotropic in any band of wave numbers; a random shift makes it so on average.
    """
    shares = (generator.random(3) + np.arange(modes)[:, None] * _EVENLY) % 1
    # a sphere has equal areas between equal steps of the cosine
    polar = np.arccos(2 * shares[:, 0] - 1)
    azimuth, polarisation = 2 * np.pi * shares[:, 1], np.pi * shares[:, 2]
    along = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
    across = np.stack([-np.sin(azimuth), np.cos(azimuth), 0 * azimuth], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    cos, sin = np.cos(polar)[:, None], np.sin(polar)[:, None]
    direction, southward = sin * along + cos * up, cos * along - sin * up
    cos, sin = np.cos(polarisation)[:, None], np.sin(polarisation)[:, None]
    return direction, cos * southward + sin * across
