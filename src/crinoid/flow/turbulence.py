"""Turbulence: a Gauss-Markov process in time, and frozen random Fourier modes."""

from collections.abc import Sequence
from itertools import accumulate
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.flow.flow import Everywhere, Flow, Jet, Point, Time, panels_of
from crinoid.foundation.fixed_numbers import POINTS_PER_CORRELATION_TIME, SPLINE_POINTS
from crinoid.numerics.piecewise import PiecewisePolynomial
from crinoid.numerics.ramp import Onset
from crinoid.numerics.small_matrices import long_product

# cos(2 pi r) = q p(q^2) and sin(2 pi r) = r (1/2 - |r|) s(q^2), with q = 1/4 - |r| and |r| <= 1/2:
# p and s interpolate at the Chebyshev points of q^2; the waves are off by less than 3e-16
_COSINE = (
    6.283185307179585, -41.341702240398284, 81.60524927557977, -76.70585968962867,
    42.05868995395094, -15.09450614073429, 3.817365633469135, -0.6925067010720717,
)  # fmt: skip
_SINE = (
    16.0, -59.827340834858965, 81.79285100476879, -58.623459205982584,
    25.938912913524156, -7.797432275400121, 1.6960073348462095, -0.2708479203034674,
)  # fmt: skip


def cosine(turns: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Return ``cos(2 pi turns)``, within 6e-16."""
    return cosine_and_sine(turns)[0]


@jax.custom_jvp
def cosine_and_sine(turns: Float[Array, "*n"]) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Return ``cos(2 pi turns)`` and ``sin(2 pi turns)``, within 6e-16.

    As each is the derivative of the other, reverse mode stores only these two.
    """
    rest = turns - jnp.round(turns)
    size = jnp.abs(rest)
    quarter = 0.25 - size
    square = quarter * quarter
    return quarter * _series(_COSINE, square), rest * (0.5 - size) * _series(_SINE, square)


@cosine_and_sine.defjvp
def _cosine_and_sine_jvp(
    primals: tuple[Array], tangents: tuple[Array]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    (cos, sin), angle = cosine_and_sine(*primals), 2 * jnp.pi * tangents[0]
    return (cos, sin), (-sin * angle, cos * angle)


def _series(coefficients: tuple[float, ...], value: Float[Array, "*n"]) -> Float[Array, "*n"]:
    total = jnp.full_like(value, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        total = total * value + coefficient
    return total


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
        points = np.arange(-SPLINE_POINTS, np.ceil(duration / step) + SPLINE_POINTS + 1)
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
    wave_vectors: Float[Array, "b m"]
    """Wave vector of each mode, along the axes of the arm (rad/m)."""
    relative_amplitudes: Float[Array, "b m"]
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
            jax.device_put(wave_number * direction[:, axes].T),
            jax.device_put(amplitude * normal[:, axes].T),
            jax.device_put(generator.random(modes)),
        )

    @property
    def drifts(self) -> bool:
        return True

    @property
    def uniform_mean(self) -> Point:
        return self.mean

    @property
    def amplitudes(self) -> Float[Array, "... b m"]:
        """Amplitude of each mode, along the axes of the arm (m/s)."""
        return jnp.linalg.norm(self.mean, axis=-1)[..., None, None] * self.relative_amplitudes

    def fully_on(self, point: Point, time: Time) -> Point:
        return self.mean + long_product(cosine(self._turns(point, time)), self.amplitudes.T)

    def displacement(self, time: Time) -> Point:
        return self.mean * self.onset.elapsed(time)

    def fully_on_jet(self, point: Point, time: Time) -> Jet:
        size, amplitudes = point.shape[0], self.amplitudes
        rates = (-amplitudes[:, None] * self.wave_vectors).reshape(size * size, -1)
        sums = _sums(*cosine_and_sine(self._turns(point, time)), amplitudes, rates)
        velocity, gradient = self.mean + sums[:size], sums[size:].reshape(size, size)
        # advected: d/dt = -(X' . grad)
        return Jet(velocity, gradient, -jnp.sum(gradient * self.onset(time) * self.mean, axis=-1))

    def _turns(self, point: Point, time: Time) -> Float[Array, " m"]:
        place = (point - self.displacement(time)) / (2 * jnp.pi)
        return sum(map(jnp.multiply, self.wave_vectors, place), start=self.phases)


@jax.custom_jvp
def _sums(
    cos: Float[Array, " m"],
    sin: Float[Array, " m"],
    even: Float[Array, "p m"],
    odd: Float[Array, "q m"],
) -> Float[Array, " sums"]:
    """Return the products of each row with the cosines or the sines.

    One loop sums all: the waves are never stored, and a compiler uses the width of its vectors.
    """
    terms = (*(cos * row for row in even), *(sin * row for row in odd))

    def add(a: tuple[Array, ...], b: tuple[Array, ...]) -> tuple[Array, ...]:
        return tuple(map(jnp.add, a, b))

    return jnp.stack(jax.lax.reduce(terms, (0.0,) * len(terms), add, (0,)))


_sums.defjvps(
    lambda change, _, cos, sin, even, odd: jnp.pad(long_product(change, even.T), (0, len(odd))),
    lambda change, _, cos, sin, even, odd: jnp.pad(long_product(change, odd.T), (len(even), 0)),
    lambda change, _, cos, sin, even, odd: jnp.pad(change @ cos, (0, len(odd))),
    lambda change, _, cos, sin, even, odd: jnp.pad(change @ sin, (len(even), 0)),
)


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
