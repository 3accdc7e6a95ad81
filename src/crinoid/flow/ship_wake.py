"""Waves of a passing ship."""

import math
from collections.abc import Sequence
from dataclasses import fields

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.flow.flow import Jet, Point, Time
from crinoid.flow.waves import Waves, dispersion
from crinoid.foundation.fixed_numbers import SPECTRUM_HIGHEST
from crinoid.numerics.ramp import Onset

_TAPERED = 0.25
"""Share of the sum at each end in which amplitudes fall to 0."""
_STEEPEST = (SPECTRUM_HIGHEST**2 - 1) ** 0.5
"""Largest tangent of the angle between waves and course."""
_CUSP = 8**0.5
"""Distance that the first waves lag behind the ship, over their distance from its course."""


class ShipWake(Waves):
    """Kelvin's transverse and divergent waves of a ship on a straight course.

    In deep water, behind a ship at the origin that moves along x at the speed ``U``, the elevation
    is ``Re int A(theta) exp(i k (x cos theta + y sin theta)) d theta`` over a half turn, with
    ``k = g / (U cos theta)^2`` (Havelock 1934, Proc. R. Soc. A 144). The amplitude is that of a
    thin ship (Michell 1898, Phil. Mag. 45; Tuck, Scullen and Lazauskas 2002, 24th Symp. Naval
    Hydrodynamics) with the half-breadth ``b / 2 (1 - (2 x / l)^2) (1 - (z / d)^2)``, Wigley's
    parabolic hull.

    The integral is a sum over ``tan theta``. Ahead of the ship it has a mirrored pattern, so a ramp
    sets in with the passing, where the elevation of the sum is 0, and ends before the first waves
    arrive.
    """

    passing: Onset = eqx.field(kw_only=True)
    """Ramp of the wake from the passing on."""
    height: Float[Array, ""] = eqx.field(kw_only=True)
    """Height at the origin, from the lowest trough to the highest crest (m)."""

    @staticmethod
    def passed(
        onset: Onset,
        *,
        velocity: Sequence[float],
        distance: float,
        time: float,
        length: float,
        beam: float,
        draught: float,
        place: Sequence[float],
        duration: float,
        components: int,
        depth: float | None,
        gravity: float,
        current: Sequence[float],
    ) -> "ShipWake":
        """Return the wake of a ship that passes a place.

        Parameters
        ----------
        onset
            Onset of the flow, on top of that by the passing.
        velocity
            Velocity of the ship over the ground (m/s).
        distance
            Smallest distance (m), positive with the place on the port side.
        time
            Time at which the ship is nearest (s).
        length, beam, draught
            Of the hull, which points along its velocity through the water (m).
        place
            Level coordinates of the place (m).
        duration
            End of the run (s).
        components
            Number of waves, so many that their sum does not recur in the run.
        depth, gravity, current
            As in `Waves.of`. The amplitudes are those of deep water.
        """
        drift = np.pad(np.asarray(current, float), (0, 2 - len(current)))
        through, ground = np.asarray(velocity) - drift, math.hypot(*velocity)
        deepest = gravity / float(through @ through)
        tangents, step = np.linspace(-_STEEPEST, _STEEPEST, components, retstep=True)
        angles = np.arctan2(through[1], through[0]) + np.arctan(tangents)
        headings = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        numbers = deep = deepest * (1 + tangents**2)
        for _ in range(0 if depth is None else 100):
            numbers = deep * np.tanh(numbers * depth)
        # a current may stop short waves
        rates = numbers * (headings @ np.asarray(velocity))
        travels = (dispersion(numbers, depth, gravity)[1] + headings @ drift > 0) & (rates > 0)
        fall = np.clip((np.abs(tangents) / _STEEPEST - 1) / _TAPERED + 1, 0, 1)
        density = amplitude(tangents, deepest, length, beam, draught) / (1 + tangents**2)
        sizes = step * density * (0.5 + 0.5 * np.cos(np.pi * fall))
        # from the ship at t = 0 to the place
        away = np.array([[time, -distance / ground], [distance / ground, time]]) @ velocity
        phases = numbers * (headings @ away) / (2 * np.pi)
        phases += 0.25 * np.sign(sizes)
        parts = (each[travels] for each in (headings, np.abs(sizes), rates, phases))
        headings, sizes, rates, phases = parts
        # the highest waves arrive soon after the first
        begin, ramp = max(0.0, time), abs(distance) / ground
        end = max(begin, time + _CUSP * ramp) + 10 * 2 * np.pi / float(np.min(rates))
        times = np.linspace(begin, max(begin, min(end, duration)), 500)
        passing = Onset.of(time, ramp)
        surface = sizes @ np.cos(2 * np.pi * phases[:, None] - np.outer(rates, times))
        height = np.ptp(surface * np.asarray(jax.vmap(passing)(jnp.asarray(times))))
        waves = Waves.of(
            onset,
            headings=headings[:, : len(current)],
            amplitudes=sizes,
            frequencies=rates,
            phases=phases,
            depth=depth,
            gravity=gravity,
            current=current,
            origin=place,
        )
        inherited = {each.name: getattr(waves, each.name) for each in fields(waves)}
        return ShipWake(**inherited, passing=passing, height=jnp.asarray(height))

    @property
    def deviation(self) -> float:
        """Standard deviation (m) of a regular wave as high as the highest one of the wake."""
        return float(self.height) / 8**0.5

    def elevation(self, point: Point, time: Time) -> Float[Array, ""]:
        return self.passing(time) * super().elevation(point, time)

    def fully_on(self, point: Point, time: Time) -> Point:
        return self.passing(time) * super().fully_on(point, time)

    def fully_on_jet(self, point: Point, time: Time) -> Jet:
        return super().fully_on_jet(point, time).times(*self.passing.with_rate(time))


def amplitude(
    tangents: Float[np.ndarray, " m"], number: float, length: float, beam: float, draught: float
) -> Float[np.ndarray, " m"]:
    """Return Michell's free-wave amplitude ``A / i`` of a parabolic hull (m/rad).

    ``A = -(2 / pi) k_0 sec^3 int int f_x exp(k z - i k x cos) dx dz`` with the half-breadth ``f``
    from bow to stern and down to the draught, in closed form.

    ``tangents`` are those of the angles between waves and course, ``number`` is the wave number
    ``k_0 = g / U^2`` of transverse waves (rad/m).
    """
    secant = np.sqrt(1 + tangents**2)
    half, sunk = number * secant * length / 2, number * secant**2 * draught
    along = 2 * (np.sin(half) / half - np.cos(half)) / half  # of x sin(k x cos), over (l / 2)^2
    down = 1 - 2 * (1 - np.exp(-sunk) * (1 + sunk)) / sunk**2  # of the rest, times k
    return -2 * beam * secant * along * down / np.pi
