"""Water with adjustable current and turbulence."""

from collections.abc import Sequence
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
    """A flow times a factor, and moved."""

    onset: Onset
    flow: Flow
    factor: Float[Array, ""]
    shift: Float[Array, " d"]
    """By how much it is moved (m)."""

    @property
    def steady(self) -> bool:  # type: ignore[override]
        """Whether it stays as it is, its onset aside."""
        return self.flow.steady

    @property
    def drifts(self) -> bool:
        """Whether it is a pattern that drifts past."""
        return self.flow.drifts

    def displacement(self, time: Time) -> Float[Array, "..."]:
        """Return how far its uniform part has moved the water (m)."""
        return self.factor * self.flow.displacement(time)

    def fully_on(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s), its onset aside."""
        return self.factor * self.flow.fully_on(point - self.shift, time)

    def jet(self, point: Point, time: Time) -> Jet:
        """Return the velocity with its derivatives."""
        return self.flow.jet(point - self.shift, time).times(self.factor, jnp.zeros(()))


def stirred(
    described: Sequence[Flow],
    now: Sequence[Flow] | None,
    knobs: Knobs,
    place: Float[np.ndarray, " d"],
    time: float,
) -> tuple[Flow, ...]:
    """Return flows as the knobs have them.

    Turbulence is what a scenario with that mean, intensity and length scale would draw. At one
    place a pattern that drifts continues without a jump, though it moves at another speed from
    now on, or has other eddies.

    Parameters
    ----------
    described
        The flows of the scenario.
    now
        The flows up to this time; None at the start.
    knobs
        The new settings.
    place
        Where the patterns continue, in the world (m).
    time
        When the knobs change (s).
    """
    flows = [_turned(flow, knobs, place) for flow in described]
    if now is None:
        return tuple(flows)
    instant = jnp.asarray(time)
    moved, moves = (
        np.asarray(sum((flow.displacement(instant) for flow in each), np.zeros(place.size)))
        for each in (now, flows)
    )
    for index, (before, after) in enumerate(zip(now, flows, strict=True)):
        if isinstance(before, Turbulence) and isinstance(after, Turbulence):
            phases = np.asarray(before.phases)
            angle = np.asarray(before.wave_vectors) @ (place - moved)
            angle -= np.asarray(after.wave_vectors) @ (place - moves)
            if angle.any():
                phases = np.mod(phases + angle / (2 * np.pi), 1.0)
            flows[index] = replace(after, phases=array(phases))
        elif isinstance(before, Scaled) and isinstance(after, Scaled) and after.drifts:
            others = moved - moves - before.displacement(instant) + after.displacement(instant)
            flows[index] = replace(after, shift=before.shift + others)
    return tuple(flows)


def _turned(flow: Flow, knobs: Knobs, place: Float[np.ndarray, " d"]) -> Flow:
    """Return a flow as the knobs have it, with the phases of the scenario."""
    if not isinstance(flow, Turbulence):
        return Scaled(flow.onset, flow, array(knobs.current), array(np.zeros(place.size)))
    return replace(
        flow,
        mean=knobs.current * flow.mean,
        wave_vectors=flow.wave_vectors / knobs.length_scale,
        amplitudes=knobs.current * knobs.intensity * flow.amplitudes,
    )
