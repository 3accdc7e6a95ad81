"""Turbulence that the water carries along."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.flow.flow import Flow, Point, Time
from crinoid.flow.jet import Jet
from crinoid.flow.turns import cosine, cosine_and_sine
from crinoid.onset import Onset
from crinoid.products import long_product

# The spectrum is cut where k L_e is below the first and above the second, and what is left is
# raised to the full variance. Below lie 6e-5 of the variance. Above lie 3.2 %, in eddies shorter
# than 1/36 of the length scale: over the thickness of an arm and the distance of its nodes these
# would average out, which a flow that is asked at points does not do for them.
_LEAST, _MOST = 0.2, 300.0
# (1, 2, 3) powers of the root of g^4 = g + 1: multiples of these fill a cube evenly, any number
# of them and from any one on (the generalised golden ratio; Roberts 2018)
_EVENLY = 1.2207440846057596 ** -np.arange(1.0, 4.0)


class Turbulence(Flow):
    """A mean flow and frozen turbulence: ``u = mean + sum_m a_m cos(k_m . (x - X) + p_m)``.

    The mean and the other flows carry its eddies: ``X`` is the displacement of all that is the
    same everywhere, here that of the mean; `Water` adds the others.
    Random Fourier modes (Kraichnan 1970) with the spectrum of von Karman (1948). The amplitude
    of each mode is normal to its wave vector, so that the flow has no divergence. Turbulence is
    three-dimensional; a planar arm sees the cut ``y = 0`` through it.
    """

    onset: Onset
    mean: Float[Array, " b"]
    """Mean velocity (m/s)."""
    wave_vectors: Float[Array, "m b"]
    """Wave vector of each mode, along the axes of the arm (rad/m)."""
    amplitudes: Float[Array, "m b"]
    """Amplitude of each mode, along the axes of the arm (m/s)."""
    phases: Float[Array, " m"]
    """Phases, in turns."""

    @staticmethod
    def of(
        onset: Onset,
        *,
        mean: Float[np.ndarray, " b"],
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
            What it is drawn from.
        """
        from scipy.special import betainc, gamma  # slow to load, and few scenarios need it

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
        # over three components: sum of a^2 / 2 = 3 (intensity |mean|)^2
        deviation = intensity * np.linalg.norm(mean)
        amplitude = deviation * np.sqrt(6 * energy / energy.sum())
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

    def fully_on(self, point: Point, time: Time) -> Point:
        return self.mean + long_product(cosine(self._turns(point, time)), self.amplitudes)

    def displacement(self, time: Time) -> Point:
        return self.mean * self.onset.elapsed(time)

    def fully_on_jet(self, point: Point, time: Time) -> Jet:
        size = point.shape[0]
        first = -self.amplitudes[:, :, None] * self.wave_vectors[:, None, :]
        first = first.reshape(len(first), -1)
        cos, sin = cosine_and_sine(self._turns(point, time))
        # two products are all that is done for each point
        velocity = self.mean + long_product(cos, self.amplitudes)
        gradient = long_product(sin, first).reshape(size, size)
        # carried along: d/dt = -(X' . grad)
        return Jet(velocity, gradient, -jnp.sum(gradient * self.onset(time) * self.mean, axis=-1))

    def _turns(self, point: Point, time: Time) -> Float[Array, " m"]:
        carried = long_product(self.wave_vectors, point - self.displacement(time))
        return self.phases + carried / (2 * jnp.pi)


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
