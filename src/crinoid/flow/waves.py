"""Surface waves."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.flow.flow import Flow, Jet, Point, Time
from crinoid.flow.turbulence import cosine, cosine_and_sine
from crinoid.foundation.fixed_numbers import (
    DEEP_WATER,
    SPECTRUM_HIGHEST,
    SPECTRUM_LOWEST,
    WAVE_NUMBER_CHANGE,
    WAVE_NUMBER_STEPS,
)
from crinoid.numerics.ramp import Onset
from crinoid.numerics.small_matrices import product


class Waves(Flow):
    """Linear (Airy) waves on water of finite depth, with the still surface at z = 0.

    With ``theta = k (heading . x) - omega t + phase`` and the elevation ``sum a cos(theta)``,
    level and upward velocity are sums of ``a sigma C cos(theta)``, along the heading, and
    ``a sigma S sin(theta)``, where ``C, S = cosh, sinh(k (z + h)) / sinh(k h)`` (Dean and
    Dalrymple 1991, chapter 3). Above the still surface the water moves as at the surface,
    below the bed as on it. In still water ``sigma = omega``; on a uniform current ``U`` waves have
    ``omega = sigma + k heading . U`` at a fixed point (Peregrine 1976, Adv. Appl. Mech. 16).
    """

    steady: ClassVar[bool] = False
    onset: Onset
    depth: Float[Array, ""]
    """Depth of the water (m)."""
    heading: Float[Array, " level"]
    """Level components of the unit vector along which the waves travel."""
    amplitudes: Float[Array, " m"]
    """Amplitudes of the elevation (m)."""
    frequencies: Float[Array, " m"]
    """Angular frequencies at a fixed point (rad/s)."""
    phases: Float[Array, " m"]
    """Phases, in turns."""
    intrinsic_frequencies: Float[Array, " m"] | None = None
    """Angular frequencies seen from the current that carries the waves (rad/s)."""
    wave_numbers: Float[Array, " m"] | None = None
    """Wave numbers at these frequencies (rad/m); None, as both, before `carried`."""

    @staticmethod
    def of(
        onset: Onset,
        *,
        significant_height: float,
        peak_period: float,
        heading: Sequence[float] | Float[np.ndarray, " level"],
        gamma: float,
        components: int,
        depth: float,
        gravity: float,
        generator: np.random.Generator,
        current: float = 0.0,
    ) -> "Waves":
        """Draw waves with a JONSWAP spectrum (Hasselmann et al. 1973).

        Each component has the same energy, and a random frequency in the band with this share
        of the spectrum; no period is common to all. The components' variance is
        ``(significant_height / 4)^2`` exactly. SI units; ``heading`` as in the class. On a
        ``current`` along the heading the spectrum is that at a fixed point. Components that cannot
        travel against it are left out.
        """
        stop = stopped(-current, depth, gravity) * (1 - 1e-9)
        highest = min(SPECTRUM_HIGHEST, stop * peak_period / (2 * np.pi))
        relative = np.linspace(SPECTRUM_LOWEST, highest, 4001)
        density = jonswap(relative, gamma)
        below = np.append(0.0, np.cumsum(density[1:] + density[:-1]))
        shares = (np.arange(components) + generator.random(components)) / components
        frequencies = np.interp(shares, below / below[-1], relative) * 2 * np.pi / peak_period
        amplitude = significant_height / 4 * np.sqrt(2 / components)
        amplitudes, phases = np.full(components, amplitude), generator.random(components)
        numbers = (depth, heading, amplitudes, frequencies, phases)
        return Waves(onset, *(jax.device_put(np.asarray(each, float)) for each in numbers))

    @staticmethod
    def regular(
        onset: Onset,
        *,
        height: float,
        period: float,
        heading: Sequence[float] | Float[np.ndarray, " level"],
        phase: float,
        depth: float | None,
        gravity: float,
        current: float = 0.0,
    ) -> "Waves":
        """Return one Airy wave, with its crest at the origin at t = 0 for ``phase = 0`` (rad).

        SI units; without a depth the water is deep. ``heading`` as in the class.
        """
        frequency = np.array([2 * np.pi / period])
        if depth is None:
            # of so many wavelengths nothing is felt of the bed, to the last digit
            depth = DEEP_WATER * 2 * np.pi / float(deep_wave_number(frequency, gravity, current)[0])
        numbers = (depth, heading, [height / 2], frequency, [phase / (2 * np.pi)])
        return Waves(onset, *(jax.device_put(np.asarray(each, float)) for each in numbers))

    def carried(self, current: Point, gravity: Float[Array, ""]) -> "Waves":
        """Return the waves on a mean current (m/s) under gravity (m/s2), with wave numbers."""
        along = product(self.heading, current[:-1])
        number = wave_number(self.frequencies, self.depth, gravity, along)
        intrinsic = self.frequencies - number * along
        return replace(self, intrinsic_frequencies=intrinsic, wave_numbers=number)

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

    @property
    def _numbers(self) -> Float[Array, " m"]:
        assert self.wave_numbers is not None, "waves need `carried` first"
        return self.wave_numbers

    def _turns(self, point: Point, time: Time) -> Float[Array, " m"]:
        along = self._numbers * product(self.heading, point[:-1])
        return self.phases + (along - self.frequencies * time) / (2 * jnp.pi)

    def _shapes(self, point: Point, time: Time) -> Float[Array, " shapes"]:
        """Return ``C cos, C sin, S cos, S sin`` of all components."""
        height = jnp.clip(point[-1], -self.depth, 0.0)
        # no growing exponential, so that deep water does not overflow
        from_surface = jnp.exp(self._numbers * height)
        from_bed = jnp.exp(-self._numbers * (height + 2 * self.depth))
        share = -1 / jnp.expm1(-2 * self._numbers * self.depth)
        across, up = share * (from_surface + from_bed), share * (from_surface - from_bed)
        cos, sin = cosine_and_sine(self._turns(point, time))
        return jnp.concatenate([across * cos, across * sin, up * cos, up * sin])

    def _weights(self) -> Float[Array, "shapes b"]:
        """Return the coefficients of the shapes in the velocity."""
        assert self.intrinsic_frequencies is not None
        speed = self.amplitudes * self.intrinsic_frequencies
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
        level = self._numbers[:, None] * self.heading
        none = jnp.zeros((count, 1))
        around = jnp.concatenate([level, none, -self.frequencies[:, None]], axis=1)
        up = jnp.concatenate([0 * level, self._numbers[:, None], none], axis=1)
        derived = turned * around[:, None] + lifted * up[:, None]
        return derived.reshape(*weights.shape, -1)


def on_currents(flows: tuple[Flow, ...], gravity: Float[Array, ""]) -> tuple[Flow, ...]:
    """Return flows whose waves ride on the mean of those that are uniform; traceable.

    Waves that have wave numbers keep them.
    """
    means = [flow.uniform_mean for flow in flows if flow.uniform_mean is not None]

    return tuple(
        flow.carried(sum(means, jnp.zeros(flow.heading.size + 1)), gravity)
        if isinstance(flow, Waves) and flow.wave_numbers is None
        else flow
        for flow in flows
    )


def jonswap(relative: Float[np.ndarray, " f"], gamma: float) -> Float[np.ndarray, " f"]:
    """Return the spectral density, up to a factor, at frequencies over the peak's."""
    width = np.where(relative <= 1, 0.07, 0.09)
    peak = gamma ** np.exp(-0.5 * ((relative - 1) / width) ** 2)
    return relative**-5.0 * np.exp(-1.25 * relative**-4.0) * peak


def deep_wave_number(frequency: Any, gravity: Any, current: Any = 0.0) -> Any:
    """Return `wave_number` in deep water: the root of ``sqrt(g k) + k U = omega``."""
    return (2 * frequency / (1 + (1 + 4 * current * frequency / gravity) ** 0.5)) ** 2 / gravity


def wave_number(frequency: Any, depth: Any, gravity: Any, current: Any = 0.0) -> Float[Array, " f"]:
    """Solve the dispersion relation ``omega = sigma + k U`` for ``k`` (rad/m); traceable.

    ``sigma^2 = g k tanh(k h)``. ``current`` is ``U`` along the direction of travel (m/s). Against
    it, of two solutions the one whose energy travels on; NaN of a wave that it stops.
    """

    def improved(number: Array, given: tuple[Array, ...]) -> Array:
        frequency, depth, gravity, current = given
        sigma, group = _dispersion(number, depth, gravity, jnp)
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


def stopped(against: float, depth: float | None, gravity: float) -> float:
    """Return the lowest frequency at a fixed point that a current stops waves of (rad/s).

    ``against`` is its speed against the waves (m/s); infinite if it does not run against them.
    Where waves are stopped their energy travels as fast as the water comes.
    """
    if against <= 0:
        return np.inf
    if depth is not None and against >= np.sqrt(gravity * depth):
        return 0.0

    def at(number: float) -> tuple[float, float]:
        sigma, group = _dispersion(np.array([number]), depth, gravity)
        return float(sigma[0]), float(group[0])

    low, high = 0.0, gravity / (4 * against**2)  # that of deep water
    if depth is not None:
        high = max(high, 1 / depth)
        while at(high)[1] > against:
            high *= 2
        for _ in range(100):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if at(middle)[1] > against else (low, middle)
    return at(high)[0] - high * against


def _dispersion(number: Any, depth: Any, gravity: Any, xp: Any = np) -> tuple[Any, Any]:
    """Return the frequency from the water (rad/s) and the speed of the energy (m/s)."""
    if depth is None:
        sigma = xp.sqrt(gravity * number)
        return sigma, sigma / (2 * number)
    tanh = xp.tanh(number * depth)
    sigma = xp.sqrt(gravity * number * tanh)
    return sigma, gravity * (tanh + number * depth * (1 - tanh**2)) / (2 * sigma)
