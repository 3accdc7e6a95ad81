"""Water whose current and turbulence are turned up and down while it flows."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.numbers import array
from crinoid.flow import Flow, Turbulence
from crinoid.flow.flow import Point, Time
from crinoid.flow.jet import Jet
from crinoid.live.knobs import Knobs
from crinoid.onset import Onset

__all__ = ["Scaled", "stirred"]


class Scaled(Flow):
    """A flow times a factor."""

    onset: Onset
    flow: Flow
    factor: Float[Array, ""]

    @property
    def steady(self) -> bool:  # type: ignore[override]
        """Whether it stays as it is, its onset aside."""
        return self.flow.steady

    @property
    def drifts(self) -> bool:
        """Whether it is a pattern that drifts past."""
        return self.flow.drifts

    def fully_on(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s), its onset aside."""
        return self.factor * self.flow.fully_on(point, time)

    def jet(self, point: Point, time: Time) -> Jet:
        """Return the velocity with its derivatives."""
        return self.flow.jet(point, time).times(self.factor, jnp.zeros(()))


def stirred(
    described: Flow, now: Flow | None, knobs: Knobs, place: Float[np.ndarray, " d"], time: float
) -> Flow:
    """Return a flow as the knobs have it.

    Turbulence is what a scenario with that mean, intensity and length scale would draw. As it
    drifts at another speed, or has other eddies, from now on, its pattern goes on from what it is
    at one place.

    Parameters
    ----------
    described
        The flow of the scenario.
    now
        As it has flowed up to this time; None at the start.
    knobs
        How it is to flow.
    place
        Where the pattern goes on as it is, in the world (m).
    time
        When it changes (s).
    """
    if not isinstance(described, Turbulence):
        return Scaled(described.onset, described, array(knobs.current))
    mean = knobs.current * np.asarray(described.mean)
    wave_vectors = np.asarray(described.wave_vectors) / knobs.length_scale
    phases = np.asarray(described.phases)
    if now is not None:
        assert isinstance(now, Turbulence)
        before = np.asarray(now.wave_vectors) @ (place - time * np.asarray(now.mean))
        after = wave_vectors @ (place - time * mean)
        phases = np.asarray(now.phases)
        if (before != after).any():
            phases = np.mod(phases + (before - after) / (2 * np.pi), 1.0)
    return replace(
        described,
        mean=array(mean),
        wave_vectors=array(wave_vectors),
        amplitudes=array(knobs.current * knobs.intensity * np.asarray(described.amplitudes)),
        phases=array(phases),
    )
