"""Forecasts: what is known of the water ahead of time."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.seen import Seen
from crinoid.flow import Water
from crinoid.products import product

Foreseen = Float[Array, "ahead w"]


class Forecast(eqx.Module):
    """Tells the velocity of the water along the arm, now and at times ahead."""

    @abstractmethod
    def start(self, seen: Seen) -> Any:
        """Return its memory at the first call: a pytree of arrays."""

    @abstractmethod
    def ahead(self, memory: Any, seen: Seen) -> tuple[Any, Foreseen]:
        """Return its memory, and the water's velocity less that at the start, now and later (m/s).

        As `Along` has it.
        """


class Along(eqx.Module):
    """From velocities at stations along the arm to what a linear model of its drag takes."""

    shapes: Float[Array, "shape station"]
    """Weight of each shape in a velocity given at the stations."""
    tangents: Float[Array, "station d"]
    steady: Float[Array, "station d"]
    """Across the arm, the steady current in which the drag was linearised (m/s)."""

    def __call__(self, velocity: Float[Array, "station d"]) -> Float[Array, " w"]:
        """Return velocities by shapes: those that have the same drag there, then the true ones.

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
        return jnp.concatenate(
            [product(self.shapes, each).reshape(-1) for each in (alike, velocity)]
        )


class KnownWater(Forecast):
    """The water is known: the flows themselves, evaluated ahead along the arm at its start."""

    water: Water
    stations: Float[Array, "station d"]
    """Positions (m)."""
    along: Along
    begin: Float[Array, " w"]
    """Its value at the start."""
    lead: Float[Array, " ahead"]
    """How far it looks ahead (s), first not at all."""

    def start(self, seen: Seen) -> None:
        return None

    def ahead(self, memory: None, seen: Seen) -> tuple[None, Foreseen]:
        def at(time: Array) -> Float[Array, " w"]:
            flow = jax.vmap(lambda point: self.water.velocity(point, time))(self.stations)
            return self.along(flow) - self.begin

        return None, jax.vmap(at)(seen.time + self.lead)


class Passed(eqx.Module):
    """Readings so far."""

    readings: Float[Array, "kept p d"]
    """One for each call, the newest first (m/s)."""
    begin: Float[Array, " w"]
    """Its value at the start."""


class CarriedWater(Forecast):
    """The water is measured, and carried along the arm by the mean current."""

    along: Along
    weights: Float[Array, "ahead station sample d"]
    """Weight of each reading, less the mean current, in what a station will see."""
    mean: Float[Array, " d"]
    """Mean current (m/s)."""
    name: str = eqx.field(static=True)
    """Name of the sensor."""
    nearest: tuple[int, ...] = eqx.field(static=True)
    """Which of its points is upstream of each station."""
    stride: int = eqx.field(static=True)
    """Calls from one reading that counts to the next."""

    def start(self, seen: Seen) -> Passed:
        first = seen.readings[self.name].value.reshape(-1, self.mean.size)
        kept = (self.weights.shape[2] - 1) * self.stride + 1
        begin = self.along(first[jnp.asarray(self.nearest)])
        return Passed(jnp.broadcast_to(first, (kept, *first.shape)), begin)

    def ahead(self, memory: Passed, seen: Seen) -> tuple[Passed, Foreseen]:
        newest = seen.readings[self.name].value.reshape(1, -1, self.mean.size)
        readings = jnp.concatenate([newest, memory.readings[:-1]])
        away = readings[:: self.stride, jnp.asarray(self.nearest)] - self.mean
        flow = self.mean + jnp.sum(self.weights * jnp.moveaxis(away, 0, 1), axis=2)
        return Passed(readings, memory.begin), jax.vmap(self.along)(flow) - memory.begin
