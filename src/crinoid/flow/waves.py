"""Surface waves."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.flow.flow import Flow, Jet, Point, Time
from crinoid.flow.turbulence import cosine, cosine_and_sine
from crinoid.flow.wave_number import wave_number
from crinoid.foundation.fixed_numbers import DEEP_WATER, SPECTRUM_HIGHEST, SPECTRUM_LOWEST
from crinoid.numerics.dispersion import deep_wave_number, stopped
from crinoid.numerics.ramp import Onset
from crinoid.numerics.small_matrices import product

_ANGLES = 721  # directions of a turn, both ends included
_GOLDEN = (5**0.5 - 1) / 2


class Waves(Flow):
    """Linear (Airy) waves on water of finite depth, with the still surface at z = 0.

    With ``theta = k (heading . (x - origin)) - omega t + phase`` and the elevation
    ``sum a cos(theta)``, level and upward velocity are sums of ``a sigma C cos(theta)``, along the
    heading, and ``a sigma S sin(theta)``, where ``C, S = cosh, sinh(k (z + h)) / sinh(k h)`` (Dean
    and Dalrymple 1991, chapter 3). Above the still surface the water moves as at the surface,
    below the bed as on it. In still water ``sigma = omega``; on a uniform current ``U`` waves have
    ``omega = sigma + k heading . U`` at a fixed point (Peregrine 1976, Adv. Appl. Mech. 16).
    """

    steady: ClassVar[bool] = False
    onset: Onset
    depth: Float[Array, ""]
    """Depth of the water (m)."""
    origin: Float[Array, " level"]
    """Level coordinates of the point that the phases belong to (m)."""
    headings: Float[Array, "m level"]
    """Level components of the unit vector along which each component travels."""
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
        headings: Float[np.ndarray, "m level"],
        amplitudes: Float[np.ndarray, " m"],
        frequencies: Float[np.ndarray, " m"],
        phases: Float[np.ndarray, " m"],
        depth: float | None,
        gravity: float,
        current: Sequence[float],
        origin: Sequence[float] | None = None,
    ) -> "Waves":
        """Return the sum of components that can travel on a level ``current`` (m/s).

        SI units, ``phases`` in turns. Without a depth the water is deep.

        Raises
        ------
        ValueError
            If the current stops all components.
        """
        along = headings @ np.asarray(current, float)
        travels = frequencies < stopped(-along, depth, gravity) * (1 - 1e-9)
        if not travels.any():
            speed = float(np.linalg.norm(current))
            raise ValueError(f"the mean current of {speed:.3g} m/s stops all waves")
        headings, amplitudes, frequencies, phases, along = (
            each[travels] for each in (headings, amplitudes, frequencies, phases, along)
        )
        if depth is None:
            # at this depth, in wavelengths, the bed changes no digit
            numbers = deep_wave_number(frequencies, gravity, along)
            depth = DEEP_WATER * 2 * np.pi / float(np.min(numbers))
        place = np.zeros(headings.shape[1]) if origin is None else origin
        parts = (depth, place, headings, amplitudes, frequencies, phases)
        return Waves(onset, *(jax.device_put(np.asarray(each, float)) for each in parts))

    @staticmethod
    def jonswap(
        onset: Onset, *, significant_height: float, peak_period: float, gamma: float, **others: Any
    ) -> "Waves":
        """Draw waves with a JONSWAP spectrum (Hasselmann et al. 1973) at a fixed point.

        Their variance is ``(significant_height / 4)^2`` exactly. ``others`` as in `drawn`.
        """
        relative = np.linspace(SPECTRUM_LOWEST, SPECTRUM_HIGHEST, 4001)
        density, frequency = jonswap(relative, gamma), relative * 2 * np.pi / peak_period
        density *= (significant_height / 4) ** 2 / np.trapezoid(density, frequency)
        return Waves.drawn(onset, frequency=frequency, density=density, **others)

    @staticmethod
    def regular(
        onset: Onset, *, height: float, period: float, direction: float, phase: float, **water: Any
    ) -> "Waves":
        """Return one Airy wave, with its crest at the origin at t = 0 for ``phase = 0`` (rad).

        SI units. ``direction`` is that of travel (rad), ``water`` as in `of`.
        """
        return Waves.of(
            onset,
            headings=_headings(np.array([direction]), len(water["current"])),
            amplitudes=np.array([height / 2]),
            frequencies=np.array([2 * np.pi / period]),
            phases=np.array([phase / (2 * np.pi)]),
            **water,
        )

    @staticmethod
    def at_gauge(
        onset: Onset,
        *,
        direction: float,
        spreading: float | None,
        generator: np.random.Generator,
        **known: Any,
    ) -> "Waves":
        """Return components that are known at a gauge, with directions drawn as in `drawn`.

        ``known`` are the other arguments of `of`; ``origin`` is the place of the gauge.
        """
        turns = _about(direction, spreading, known["amplitudes"].size, generator)
        return Waves.of(onset, headings=_headings(turns, len(known["current"])), **known)

    @staticmethod
    def drawn(
        onset: Onset,
        *,
        frequency: Float[np.ndarray, " f"],
        density: Float[np.ndarray, "..."],
        direction: float | Float[np.ndarray, " direction"],
        spreading: float | None = None,
        components: int,
        generator: np.random.Generator,
        **water: Any,
    ) -> "Waves":
        """Draw waves with a spectrum at a fixed point.

        Each component has the same energy, a random frequency in the band with this share of the
        spectrum, and one direction, so that a point sees a stationary sea (Jefferys 1987, Appl.
        Ocean Res. 9). No period is common to all. The variance is that of the spectrum, also where
        a current stops some components, which are left out.

        Parameters
        ----------
        onset
            Onset in time.
        frequency
            Angular frequencies (rad/s), increasing.
        density
            Spectral density of the elevation (m2 s/rad), or with directions (m2 s/rad2).
        direction
            Direction of travel (rad, from x towards y): of all waves, or of each column of
            ``density``, increasing within a turn.
        spreading
            Of a density without directions, exponent s of their distribution about ``direction``,
            ``cos^2s(angle / 2)`` (Longuet-Higgins, Cartwright and Smith 1963); None: long crests.
        components
            Number of components.
        generator
            Generator of random numbers.
        water
            ``depth``, ``gravity`` and ``current`` as in `of`.
        """
        whole: Any = density
        if density.ndim > 1:
            turn = np.append(direction, np.ravel(direction)[0] + 2 * np.pi)
            directional = np.c_[density, density[:, :1]]
            whole = np.asarray(np.trapezoid(directional, turn))
        even = np.linspace(0, 1, max(1, 4000 // (frequency.size - 1)) * (frequency.size - 1) + 1)
        grid = np.interp(even, np.linspace(0, 1, frequency.size), frequency)
        along = np.interp(grid, frequency, whole)
        shares = (np.arange(components) + generator.random(components)) / components
        found, phases = _quantiles(grid, along, shares), generator.random(components)
        if density.ndim > 1:
            from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

            # straight lines would spread a narrow sea between few directions
            fine = np.linspace(turn[0], turn[-1], _ANGLES)
            rows = np.apply_along_axis(partial(np.interp, found, frequency), 0, directional)
            among = CubicSpline(turn, rows.T, bc_type="periodic")
            pairs = zip(np.maximum(among(fine), 0.0).T, _even(components, generator), strict=True)
            turns = np.array([_quantiles(fine, row, share) for row, share in pairs])
        else:
            turns = _about(float(direction), spreading, components, generator)
        amplitude = np.sqrt(2 * np.trapezoid(along, grid) / components)
        made = Waves.of(
            onset,
            headings=_headings(turns, len(water["current"])),
            amplitudes=np.full(components, amplitude),
            frequencies=found,
            phases=phases,
            **water,
        )
        share = made.amplitudes.size / components
        return replace(made, amplitudes=made.amplitudes / share**0.5)

    @property
    def deviation(self) -> float:
        """Standard deviation of the elevation (m)."""
        return float(np.sqrt(np.sum(np.square(self.amplitudes)) / 2))

    @property
    def mean_heading(self) -> Float[np.ndarray, " level"]:
        """Mean of the headings, weighted by the energy."""
        return np.average(self.headings, axis=0, weights=np.square(self.amplitudes))

    @property
    def energy_period(self) -> float:
        """The period with the energy, ``sum a^2 T / sum a^2`` (s)."""
        energy, rate = np.square(self.amplitudes), np.asarray(self.frequencies)
        return float(2 * np.pi * np.sum(energy / rate) / np.sum(energy))

    @property
    def onsets(self) -> tuple[Onset, ...]:
        """Factors of time of the elevation."""
        return (self.onset,)

    def carried(self, current: Point, gravity: Float[Array, ""]) -> "Waves":
        """Return the waves on a mean current (m/s) under gravity (m/s2), with wave numbers."""
        along = product(self.headings, current[:-1])
        number = wave_number(self.frequencies, self.depth, gravity, along)
        intrinsic = self.frequencies - number * along
        return replace(self, intrinsic_frequencies=intrinsic, wave_numbers=number)

    def elevation(self, point: Point, time: Time) -> Float[Array, ""]:
        """Return the height of the surface over (or under) a point (m)."""
        return self.onset(time) * product(cosine(self.turns(point, time)), self.amplitudes)

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

    def turns(self, point: Point, time: Time) -> Float[Array, " m"]:
        """Return ``theta`` of each component at a point (m) and a time (s), in turns."""
        along = self._numbers * product(self.headings, point[:-1] - self.origin)
        return self.phases + (along - self.frequencies * time) / (2 * jnp.pi)

    def _shapes(self, point: Point, time: Time) -> Float[Array, " shapes"]:
        """Return ``C cos, C sin, S cos, S sin`` of all components."""
        height = jnp.clip(point[-1], -self.depth, 0.0)
        # no growing exponential, so that deep water does not overflow
        from_surface = jnp.exp(self._numbers * height)
        from_bed = jnp.exp(-self._numbers * (height + 2 * self.depth))
        share = -1 / jnp.expm1(-2 * self._numbers * self.depth)
        across, up = share * (from_surface + from_bed), share * (from_surface - from_bed)
        cos, sin = cosine_and_sine(self.turns(point, time))
        return jnp.concatenate([across * cos, across * sin, up * cos, up * sin])

    def _weights(self) -> Float[Array, "shapes b"]:
        """Return the coefficients of the shapes in the velocity."""
        assert self.intrinsic_frequencies is not None
        speed = self.amplitudes * self.intrinsic_frequencies
        level = speed[:, None] * jnp.pad(self.headings, ((0, 0), (0, 1)))
        upward = speed[:, None] * np.eye(self.headings.shape[1] + 1)[-1]
        return jnp.concatenate([level, 0 * level, 0 * level, upward])

    def _rates(self, weights: Float[Array, "shapes b"]) -> Float[Array, "shapes b b+1"]:
        """Return the weights of the derivatives along space and time, as the last axis."""
        count = self.amplitudes.shape[0]
        c_cos, c_sin, s_cos, s_sin = weights.reshape(4, count, -1)
        # along the level axes and time cos' = -k sin, sin' = k cos; upward C' = k S, S' = k C
        turned = jnp.stack([c_sin, -c_cos, s_sin, -s_cos])[..., None]
        lifted = jnp.stack([s_cos, s_sin, c_cos, c_sin])[..., None]
        level = self._numbers[:, None] * self.headings
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
        flow.carried(sum(means, jnp.zeros(flow.headings.shape[1] + 1)), gravity)
        if isinstance(flow, Waves) and flow.wave_numbers is None
        else flow
        for flow in flows
    )


def jonswap(relative: Float[np.ndarray, " f"], gamma: float) -> Float[np.ndarray, " f"]:
    """Return the spectral density, up to a factor, at frequencies over the peak's."""
    width = np.where(relative <= 1, 0.07, 0.09)
    peak = gamma ** np.exp(-0.5 * ((relative - 1) / width) ** 2)
    return relative**-5.0 * np.exp(-1.25 * relative**-4.0) * peak


def _about(
    direction: float, spreading: float | None, count: int, generator: np.random.Generator
) -> Float[np.ndarray, " m"]:
    """Draw directions about one (rad); see `Waves.drawn`."""
    if spreading is None:
        return np.full(count, direction)
    away = np.linspace(-np.pi, np.pi, _ANGLES)
    shape = np.cos(0.5 * away) ** (2 * spreading)
    return direction + _quantiles(away, shape, _even(count, generator))


def _even(count: int, generator: np.random.Generator) -> Float[np.ndarray, " m"]:
    """Return shares that are even in each band of components: a sequence of Weyl."""
    return (generator.random() + _GOLDEN * np.arange(count)) % 1


def _headings(angles: Float[np.ndarray, " m"], axes: int) -> Float[np.ndarray, "m level"]:
    """Return the level components of directions (rad)."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, :axes]


def _quantiles(grid: Float[np.ndarray, " x"], density: Float[np.ndarray, " x"], shares: Any) -> Any:
    """Return where shares of the integral of a density lie below."""
    below = np.append(0.0, np.cumsum((density[1:] + density[:-1]) * np.diff(grid)))
    return np.interp(shares, below / below[-1], grid)
