"""Waves of a passing ship."""

from collections.abc import Sequence
from dataclasses import fields

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from crinoid.flow.flow import Jet, Point, Time
from crinoid.flow.waves import Waves
from crinoid.foundation.fixed_numbers import SPECTRUM_HIGHEST
from crinoid.numerics.dispersion import dispersion
from crinoid.numerics.ramp import Onset

_STEEPEST = (SPECTRUM_HIGHEST**2 - 1) ** 0.5
"""Largest tangent of the angle between waves and course."""


class ShipWake(Waves):
    """Kelvin's transverse and divergent waves of a thin ship on a straight course.

    Behind a ship at the origin that moves along x at the speed ``U``, the elevation in deep water
    is ``Re int A exp(i k (x cos b + y sin b)) db`` over half a turn, with ``k = g / (U cos b)^2``
    (Havelock 1934, Proc. R. Soc. A 144). The integral is a sum over ``tan b``. Ahead of the ship it
    has a mirrored pattern, so the wake sets in from the passing on, where the elevation is 0. The
    sum recurs soon after the run, so its deviation is about that in the run.
    """

    passing: Onset = eqx.field(kw_only=True)
    """Ramp from the passing to before the first waves arrive."""

    @staticmethod
    def passed(
        onset: Onset,
        *,
        speed: float,
        direction: float,
        distance: float,
        time: float,
        length: float,
        beam: float,
        draught: float,
        place: Sequence[float],
        components: int,
        depth: float | None,
        gravity: float,
        current: Sequence[float],
    ) -> "ShipWake":
        """Return the wake of a ship that passes a level ``place`` at a ``time`` and a ``distance``.

        SI units. Speed and ``direction`` (rad) are over the ground; a positive distance has the
        place to port. The amplitudes are those of deep water, in any depth. Others as in `Waves`.
        """
        course = np.array([np.cos(direction), np.sin(direction)])
        drift = np.pad(np.asarray(current, float), (0, 2 - len(current)))
        through = speed * course - drift
        least = gravity / float(through @ through)
        tangents, step = np.linspace(-_STEEPEST, _STEEPEST, components, retstep=True)
        angles = np.arctan2(through[1], through[0]) + np.arctan(tangents)
        headings = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        numbers = deep = least * (1 + tangents**2)
        if depth is not None:
            for _ in range(100):
                numbers = deep * np.tanh(numbers * depth)
        rates = numbers * speed * (headings @ course)
        # the outer quarters fall to 0
        fall = np.clip(4 * np.abs(tangents) / _STEEPEST - 3, 0, 1)
        sizes = amplitude(tangents, least, length, beam, draught) / (1 + tangents**2)
        sizes *= step * (0.5 + 0.5 * np.cos(np.pi * fall))
        away = distance * np.array([-course[1], course[0]]) + speed * time * course
        phases = numbers * (headings @ away) / (2 * np.pi) + 0.25 * np.sign(sizes)
        # a current may stop short waves
        travels = (dispersion(numbers, depth, gravity)[1] + headings @ drift > 0) & (rates > 0)
        waves = Waves.of(
            onset,
            headings=headings[travels, : len(current)],
            amplitudes=np.abs(sizes[travels]),
            frequencies=rates[travels],
            phases=phases[travels],
            depth=depth,
            gravity=gravity,
            current=current,
            origin=place,
        )
        parts = {each.name: getattr(waves, each.name) for each in fields(waves)}
        return ShipWake(**parts, passing=Onset.of(time, abs(distance) / speed))

    @property
    def onsets(self) -> tuple[Onset, ...]:
        return (self.onset, self.passing)

    def elevation(self, point: Point, time: Time) -> Float[Array, ""]:
        return self.passing(time) * super().elevation(point, time)

    def fully_on(self, point: Point, time: Time) -> Point:
        return self.passing(time) * super().fully_on(point, time)

    def fully_on_jet(self, point: Point, time: Time) -> Jet:
        return super().fully_on_jet(point, time).times(*self.passing.with_rate(time))


def amplitude(
    tangents: Float[np.ndarray, " m"], number: float, length: float, beam: float, draught: float
) -> Float[np.ndarray, " m"]:
    """Return Michell's amplitude ``A / i`` (m/rad) of a parabolic (Wigley) hull, in closed form.

    ``A = -(2 / pi) k_0 sec^3 b int int f_x exp(k z - i k x cos b) dx dz`` with the half-breadth
    ``f = beam / 2 (1 - (2 x / length)^2) (1 - (z / draught)^2)``, ``tangents`` of the angles ``b``
    and ``number``, ``k_0 = g / U^2`` (Michell 1898, Phil. Mag. 45; Tuck, Scullen and Lazauskas
    2002, 24th Symp. Naval Hydrodynamics).
    """
    secant = np.sqrt(1 + tangents**2)
    half, sunk = number * secant * length / 2, number * secant**2 * draught
    along = (np.sin(half) / half - np.cos(half)) / half
    down = 1 - 2 * (1 - np.exp(-sunk) * (1 + sunk)) / sunk**2
    return -4 * beam * secant * along * down / np.pi
