"""Surface waves."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.flow.flow import Flow, Point, Time
from crinoid.flow.jet import Jet
from crinoid.flow.turns import cosine, sine
from crinoid.onset import Onset
from crinoid.products import product

_LOWEST, _HIGHEST = 0.5, 4.0
"""Where the spectrum is cut, over its peak frequency: all but 0.5 % of it lie between."""


class Waves(Flow):
    """Linear (Airy) waves on water of finite depth, with the still surface at z = 0.

    With ``theta = k (heading . x) - omega t + phase`` and the elevation ``sum a cos(theta)``,
    level and upward velocity are sums of ``a omega C cos(theta)``, along the heading, and
    ``a omega S sin(theta)``, where ``C, S = cosh, sinh(k (z + h)) / sinh(k h)`` (Dean and
    Dalrymple 1991, chapter 3). Above the still surface the water moves as it does there, and
    below the bed as on it.
    """

    onset: Onset
    depth: Float[Array, ""]
    """Depth of the water (m)."""
    heading: Float[Array, " level"]
    """Level components of the unit vector along which the waves travel."""
    amplitudes: Float[Array, " m"]
    """Amplitudes of the elevation (m)."""
    frequencies: Float[Array, " m"]
    """Angular frequencies (rad/s)."""
    wave_numbers: Float[Array, " m"]
    """Wave numbers at these frequencies (rad/m)."""
    phases: Float[Array, " m"]
    """Phases, in turns."""

    @staticmethod
    def of(
        onset: Onset,
        *,
        significant_height: float,
        peak_period: float,
        heading: Float[np.ndarray, " level"],
        gamma: float,
        components: int,
        depth: float,
        gravity: float,
        generator: np.random.Generator,
    ) -> "Waves":
        """Draw waves with a JONSWAP spectrum (Hasselmann et al. 1973).

        Each component has the same energy, and a frequency somewhere in the band that holds
        this share of the spectrum; no period is common to all. The components' variance is
        ``(significant_height / 4)^2`` exactly. SI units; ``heading`` as in the class.
        """
        relative = np.linspace(_LOWEST, _HIGHEST, 4001)
        density = jonswap(relative, gamma)
        below = np.append(0.0, np.cumsum(density[1:] + density[:-1]))
        shares = (np.arange(components) + generator.random(components)) / components
        frequencies = np.interp(shares, below / below[-1], relative) * 2 * np.pi / peak_period
        amplitude = significant_height / 4 * np.sqrt(2 / components)
        return Waves(
            onset,
            jax.device_put(np.asarray(depth, float)),
            jax.device_put(heading),
            jax.device_put(np.full(components, amplitude)),
            jax.device_put(frequencies),
            jax.device_put(wave_number(frequencies, depth, gravity)),
            jax.device_put(generator.random(components)),
        )

    def elevation(self, point: Point, time: Time) -> Float[Array, ""]:
        """Return the height of the surface over (or under) a point (m)."""
        return self.onset(time) * product(cosine(self._turns(point, time)), self.amplitudes)

    def fully_on(self, point: Point, time: Time) -> Point:
        return product(self._shapes(point, time), self._weights())

    def fully_on_jet(self, point: Point, time: Time) -> Jet:
        size = point.shape[0]
        weights = self._weights()
        rates = self._rates(weights).reshape(weights.shape[0], -1)
        together = product(self._shapes(point, time), jnp.concatenate([weights, rates], axis=1))
        velocity, rates = together[:size], together[size:].reshape(size, size + 1)
        # where the height is held, it changes nothing
        held = (point[-1] > 0) | (point[-1] < -self.depth)
        moving = jnp.where(held, 1.0 - np.eye(size)[-1], 1.0)
        return Jet(velocity, rates[:, :size] * moving, rates[:, size])

    def _turns(self, point: Point, time: Time) -> Float[Array, " m"]:
        along = self.wave_numbers * product(self.heading, point[:-1])
        return self.phases + (along - self.frequencies * time) / (2 * jnp.pi)

    def _shapes(self, point: Point, time: Time) -> Float[Array, " shapes"]:
        """Return ``C cos, C sin, S cos, S sin`` of all components."""
        height = jnp.clip(point[-1], -self.depth, 0.0)
        # no growing exponential, so that deep water does not overflow
        from_surface = jnp.exp(self.wave_numbers * height)
        from_bed = jnp.exp(-self.wave_numbers * (height + 2 * self.depth))
        share = -1 / jnp.expm1(-2 * self.wave_numbers * self.depth)
        turns = self._turns(point, time)
        across, up = share * (from_surface + from_bed), share * (from_surface - from_bed)
        cos, sin = cosine(turns), sine(turns)
        return jnp.concatenate([across * cos, across * sin, up * cos, up * sin])

    def _weights(self) -> Float[Array, "shapes b"]:
        """Return what each shape adds to the velocity."""
        speed = self.amplitudes * self.frequencies
        level = speed[:, None] * jnp.append(self.heading, 0.0)
        upward = speed[:, None] * jnp.append(0 * self.heading, 1.0)
        return jnp.concatenate([level, 0 * level, 0 * level, upward])

    def _rates(self, weights: Float[Array, "shapes b"]) -> Float[Array, "shapes b b+1"]:
        """Return the weights of the derivatives along space and time, as the last axis."""
        count = self.amplitudes.shape[0]
        c_cos, c_sin, s_cos, s_sin = weights.reshape(4, count, -1)
        # along the level axes and time cos' = -k sin, sin' = k cos; upward C' = k S, S' = k C
        turned = jnp.stack([c_sin, -c_cos, s_sin, -s_cos])[..., None]
        lifted = jnp.stack([s_cos, s_sin, c_cos, c_sin])[..., None]
        level = self.wave_numbers[:, None] * self.heading
        none = jnp.zeros((count, 1))
        around = jnp.concatenate([level, none, -self.frequencies[:, None]], axis=1)
        up = jnp.concatenate([0 * level, self.wave_numbers[:, None], none], axis=1)
        derived = turned * around[:, None] + lifted * up[:, None]
        return derived.reshape(*weights.shape, -1)


def jonswap(relative: Float[np.ndarray, " f"], gamma: float) -> Float[np.ndarray, " f"]:
    """Return the spectral density, up to a factor, at frequencies over the peak's."""
    width = np.where(relative <= 1, 0.07, 0.09)
    peak = gamma ** np.exp(-0.5 * ((relative - 1) / width) ** 2)
    return relative**-5.0 * np.exp(-1.25 * relative**-4.0) * peak


def wave_number(
    frequency: Float[np.ndarray, " f"], depth: float, gravity: float
) -> Float[np.ndarray, " f"]:
    """Solve the dispersion relation ``omega^2 = g k tanh(k h)`` for ``k`` (rad/m)."""
    wanted = frequency**2 * depth / gravity
    number = wanted / np.sqrt(np.tanh(wanted))  # within a twentieth (Eckart 1952)
    for _ in range(5):  # Newton's method doubles the digits each time
        tanh = np.tanh(number)
        residual = number * tanh - wanted
        number = number - residual / (tanh + number * (1 - tanh**2))
    return number / depth
