"""A sensor: the distance of the tip from a transponder."""

from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Float
from pydantic import Field

from crinoid import Measurand
from crinoid.tables import Metres, Position, SensorTable


class Range(Measurand):
    """Distance of the tip from a fixed point (m)."""

    transponder: Float[Array, " d"]
    """In the world (m)."""

    def of(self, system, state):
        away = system.tip(state)[: self.transponder.size] - self.transponder
        return jnp.sqrt(jnp.sum(away**2, keepdims=True))

    def names(self, axes):
        return (("range", "m"),)


class RangeSensor(SensorTable):
    """Distance of the tip from a transponder on the reef."""

    kind: Literal["range"] = Field(default="range", description="Distance from a transponder.")
    transponder: Position = Field(description="Where the transponder is.")
    noise: Metres = Field(default=0.0, ge=0, description="Standard deviation of the noise.")

    def build(self, scenario):
        return Range(jnp.asarray(self.transponder)), self.noise, 0.0
