"""Oscillators of shed vortices, which follow the oscillation of the arm in the water."""

from abc import abstractmethod
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.foundation.fixed_numbers import AVERAGED_PERIODS, FIRST_WAKE, STILL_SPEED

Scalar = Float[Array, "*count"]
Length = Float[Array, "..."]
"""Of a step, the same for several oscillators (s)."""


class Oscillation(NamedTuple):
    """Flow and motion of the arm at a place, along one direction."""

    shedding: Scalar
    """``U / D`` (1/s)."""
    speed: Scalar
    """``U`` (m/s)."""
    diameter: Scalar  # m
    direction: Float[Array, "*count d"]
    """Unit vector of the oscillation."""
    relative: Float[Array, "*count d"]
    """Velocity of the water relative to the arm (m/s)."""
    acceleration: Scalar
    """Acceleration of the arm relative to the water, along the direction (m/s2)."""


class Oscillator(eqx.Module):
    """Oscillator of the vortices at a place; ``harmonic`` times the frequency of shedding."""

    harmonic: eqx.AbstractVar[Scalar]

    @abstractmethod
    def start(self, angle: Scalar, at: Oscillation) -> Any:
        """Return the state at the start, from the phase of the signal (rad) and the motion."""

    @abstractmethod
    def advance(self, state: Any, at: Oscillation, step: Length) -> Any:
        """Return the state after a step of given length (s), from the motion at its end."""

    @abstractmethod
    def signal(self, state: Any, step: Length) -> Scalar:
        """Return the force over ``1/2 rho D U^2 C`` after a step, predicted from the state before.

        1 is the amplitude on a fixed cylinder. The prediction is of second order.
        """

    @abstractmethod
    def phase(self, state: Any) -> Scalar:
        """Return the phase of the signal (rad)."""


class Synchronised(NamedTuple):
    """State of `Synchronisation`."""

    angle: Scalar
    """Phase of the lift (rad)."""
    rate: Scalar
    """Its rate (rad/s)."""
    flows: Float[Array, "*count 3 d"]
    """Velocity of the water relative to the arm: now, its mean, the mean of this mean (m/s)."""
    mean_squares: Float[Array, "*count 2"]
    """Mean squares of the oscillation's velocity (m2/s2) and acceleration (m2/s4)."""
    squares: Float[Array, "*count 2"]
    """Present squares of both."""


class Synchronisation(Oscillator):
    """Phase oscillator that follows the arm's velocity where the frequencies are near.

    ``phi' = 2 pi (U / D) (centre + range sin(phi_v - phi))``, signal ``cos phi``, with the phase
    ``phi_v = atan2(-y'' / y''_rms, y' / y'_rms)`` of the arm (Thorsen, Saevik and Larsen 2014,
    Journal of Fluids and Structures 51, eq. 12 and 13). The means are over five shedding periods.
    That of the flow is taken twice, which shifts no phase: one mean alone would by 2 degrees.
    """

    harmonic: Scalar
    centre: Scalar
    """Frequency of shedding over ``U / D`` out of lock-in."""
    range: Scalar
    """Half the width of lock-in, over ``U / D``."""

    def start(self, angle: Scalar, at: Oscillation) -> Synchronised:
        flows = jnp.stack([at.relative] * 3, axis=-2)
        velocity, squares = self._oscillating(flows, at)
        rate = self._rate(angle, velocity, squares, at)
        return Synchronised(angle, rate, flows, squares, squares)

    def advance(self, state: Synchronised, at: Oscillation, step: Length) -> Synchronised:
        left = jnp.exp(-step * self.harmonic * self.centre * at.shedding / AVERAGED_PERIODS)

        def mean(past: Array, before: Array, after: Array) -> Array:
            return left[..., None] * past + (1.0 - left[..., None]) * 0.5 * (before + after)

        once = mean(state.flows[..., 1, :], state.flows[..., 0, :], at.relative)
        twice = mean(state.flows[..., 2, :], state.flows[..., 1, :], once)
        flows = jnp.stack([at.relative, once, twice], axis=-2)
        velocity, squares = self._oscillating(flows, at)
        means = mean(state.mean_squares, state.squares, squares)
        # Heun's method
        guess = self._rate(state.angle + step * state.rate, velocity, means, at)
        angle = state.angle + 0.5 * step * (state.rate + guess)
        rate = self._rate(angle, velocity, means, at)
        return Synchronised(angle, rate, flows, means, squares)

    def signal(self, state: Synchronised, step: Length) -> Scalar:
        return jnp.cos(state.angle + step * state.rate)

    def phase(self, state: Synchronised) -> Scalar:
        return state.angle

    def _oscillating(
        self, flows: Float[Array, "*count 3 d"], at: Oscillation
    ) -> tuple[Scalar, Float[Array, "*count 2"]]:
        """Return the oscillation's velocity (m/s), and the squares of it and its acceleration."""
        velocity = jnp.sum((flows[..., 2, :] - flows[..., 0, :]) * at.direction, axis=-1)
        return velocity, jnp.stack([velocity**2, at.acceleration**2], axis=-1)

    def _rate(
        self, angle: Scalar, velocity: Scalar, means: Float[Array, "*count 2"], at: Oscillation
    ) -> Scalar:
        frequency = 2.0 * jnp.pi * self.harmonic * at.shedding
        still = STILL_SPEED * at.speed
        floor = jnp.finfo(float).tiny
        own = jnp.sqrt(
            (means[..., 1] + (self.centre * frequency * still) ** 2 + floor)
            / (means[..., 0] + still**2 + floor)
        )
        # of a still arm the phase is 0
        cosine, sine, none = own * velocity, -at.acceleration, own * still
        size = jnp.sqrt(cosine**2 + sine**2 + none**2 + floor)
        ahead = (sine * jnp.cos(angle) - (cosine + none) * jnp.sin(angle)) / size
        return frequency * (self.centre + self.range * ahead)


class Wake(NamedTuple):
    """State of `WakeOscillator`."""

    variable: Float[Array, "*count 2"]
    """The wake variable ``q`` and its rate (1/s)."""
    frequency: Scalar
    """Circular frequency of shedding (rad/s)."""
    forcing: Scalar
    """Forcing by the arm (1/s2)."""


class WakeOscillator(Oscillator):
    """Van der Pol oscillator that the arm's acceleration drives.

    ``q'' + damping W (q^2 - 1) q' + W^2 q = (coupling / D) y''`` with ``W = 2 pi strouhal U / D``
    and the signal ``q / 2`` (Facchinetti, de Langre and Biolley 2004, Journal of Fluids and
    Structures 19, eq. 9 and 18). A step is one of the classical Runge-Kutta method, with W and y''
    linear in between.
    """

    harmonic: Scalar
    strouhal: Scalar
    """Frequency of shedding over ``U / D``."""
    coupling: Scalar
    damping: Scalar

    def start(self, angle: Scalar, at: Oscillation) -> Wake:
        frequency, forcing = self._frequency(at), self._forcing(at)
        turned = jnp.stack([jnp.cos(angle), -frequency * jnp.sin(angle)], axis=-1)
        return Wake(FIRST_WAKE * turned, frequency, forcing)

    def advance(self, state: Wake, at: Oscillation, step: Length) -> Wake:
        return self._advance(state, self._frequency(at), self._forcing(at), step)

    def _advance(self, state: Wake, frequency: Scalar, forcing: Scalar, step: Length) -> Wake:
        def rate(share: float, variable: Array) -> Array:
            W = state.frequency + share * (frequency - state.frequency)
            force = state.forcing + share * (forcing - state.forcing)
            q, speed = variable[..., 0], variable[..., 1]
            slowed = self.damping * W * (q**2 - 1.0) * speed + W**2 * q
            return jnp.stack([speed, force - slowed], axis=-1)

        y, h = state.variable, step[..., None]
        a = rate(0.0, y)
        b = rate(0.5, y + 0.5 * h * a)
        c = rate(0.5, y + 0.5 * h * b)
        d = rate(1.0, y + h * c)
        return Wake(y + h / 6.0 * (a + 2.0 * (b + c) + d), frequency, forcing)

    def signal(self, state: Wake, step: Length) -> Scalar:
        after = self._advance(state, state.frequency, state.forcing, step)
        return 0.5 * after.variable[..., 0]

    def phase(self, state: Wake) -> Scalar:
        q, speed = state.variable[..., 0], state.variable[..., 1]
        return jnp.arctan2(-speed, state.frequency * q)

    def _frequency(self, at: Oscillation) -> Scalar:
        return 2.0 * jnp.pi * self.harmonic * self.strouhal * at.shedding

    def _forcing(self, at: Oscillation) -> Scalar:
        return self.coupling / at.diameter * at.acceleration
