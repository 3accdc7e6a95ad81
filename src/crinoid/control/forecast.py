"""Forecasts of the water along the arm."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.controller import ControllerInput
from crinoid.flow import Water
from crinoid.numerics.small_matrices import product

Foreseen = Float[Array, "ahead w"]


class Forecast(eqx.Module):
    """Forecast of the water along the arm, now and at times ahead."""

    @abstractmethod
    def start(self, seen: ControllerInput) -> Any:
        """Return its memory at the first call: a pytree of arrays."""

    @abstractmethod
    def ahead(self, memory: Any, seen: ControllerInput) -> tuple[Any, Foreseen]:
        """Return its memory, and how the water moves now and later, as `Along` has it.

        Less that at the start.
        """


class Along(eqx.Module):
    """Projection of the water at stations along the arm onto the inputs of a linear model."""

    shapes: Float[Array, "shape station"]
    """Weight of each shape in numbers given at the stations."""
    tangents: Float[Array, "station d"]
    steady: Float[Array, "station d"]
    """Across the arm, the steady current in which the drag was linearised (m/s)."""

    def __call__(
        self, velocity: Float[Array, "station d"], acceleration: Float[Array, "station d"]
    ) -> Float[Array, " w"]:
        """Return by shapes velocities that have the same drag there (m/s), then accelerations.

        Drag grows with the square of the velocity across the arm, ``|u| u``; in a current ``U`` it
        changes by ``2 U`` times a change along ``U``, and by ``U`` times one across it.
        """
        inline = jnp.sum(velocity * self.tangents, axis=1, keepdims=True) * self.tangents
        across = velocity - inline
        current = jnp.sqrt(jnp.sum(self.steady**2, axis=1, keepdims=True))
        direction = self.steady / current
        main = jnp.sum(across * direction, axis=1, keepdims=True) * direction
        speed = jnp.sqrt(jnp.sum(across**2, axis=1, keepdims=True))
        alike = inline + speed / current * (across - 0.5 * main)
        parts = [product(self.shapes, each).reshape(-1) for each in (alike, acceleration)]
        return jnp.concatenate(parts)


class KnownWater(Forecast):
    """Forecast of known water: the flows, evaluated ahead along the arm at its start."""

    water: Water
    hastening: Water
    """Flows that accelerate their water."""
    stations: Float[Array, "station d"]
    """Positions (m)."""
    along: Along
    begin: Float[Array, " w"]
    """Its value at the start."""
    lead: Float[Array, " ahead"]
    """Preview times (s), the first 0."""

    def start(self, seen: ControllerInput) -> None:
        return None

    def ahead(self, memory: None, seen: ControllerInput) -> tuple[None, Foreseen]:
        def at(time: Array) -> Float[Array, " w"]:
            velocity = jax.vmap(lambda point: self.water.velocity(point, time))(self.stations)
            found = jax.vmap(lambda point: self.hastening.current(point, time))(self.stations)
            return self.along(velocity, found.acceleration) - self.begin

        return None, jax.vmap(at)(seen.time + self.lead)


class ReadingHistory(eqx.Module):
    """Readings so far."""

    readings: Float[Array, "kept p d"]
    """One for each call, the newest first (m/s)."""
    begin: Float[Array, " w"]
    """Its value at the start."""


class FrozenTurbulenceForecast(Forecast):
    """Forecast from measured water: its statistics give the water along the arm, now and later.

    Most of all, the mean current carries it along.
    """

    along: Along
    weights: Float[Array, "ahead kind=2 station d sample p d"]
    """Weight of each reading, less the mean current, in velocity and acceleration at a station."""
    mean: Float[Array, " d"]
    """Mean current (m/s)."""
    name: str = eqx.field(static=True)
    """Name of the sensor."""
    stride: int = eqx.field(static=True)
    """Calls from one reading that counts to the next."""

    def start(self, seen: ControllerInput) -> ReadingHistory:
        first = seen.readings[self.name].value.reshape(-1, self.mean.size)
        kept = (self.weights.shape[4] - 1) * self.stride + 1
        readings = jnp.broadcast_to(first, (kept, *first.shape))
        return ReadingHistory(readings, self._flow(readings)[0])

    def ahead(
        self, memory: ReadingHistory, seen: ControllerInput
    ) -> tuple[ReadingHistory, Foreseen]:
        newest = seen.readings[self.name].value.reshape(1, -1, self.mean.size)
        readings = jnp.concatenate([newest, memory.readings[:-1]])
        return ReadingHistory(readings, memory.begin), self._flow(readings) - memory.begin

    def _flow(self, readings: Float[Array, "kept p d"]) -> Foreseen:
        away = (readings[:: self.stride] - self.mean).reshape(-1)
        flow = product(self.weights.reshape(-1, away.size), away).reshape(self.weights.shape[:4])
        return jax.vmap(lambda each: self.along(self.mean + each[0], each[1]))(flow)
