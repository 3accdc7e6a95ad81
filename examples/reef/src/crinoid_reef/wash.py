"""A current: the wash of a thruster."""

from typing import ClassVar, Literal

import jax.numpy as jnp
from jaxtyping import Array, Float
from pydantic import Field

from crinoid import Flow, Onset, flow_onset
from crinoid.tables import FlowTable, Metres, Velocity


class Wash(Flow):
    """``u = peak exp(-((z - centre) / width)^2)``: a level stream of Gaussian profile."""

    steady: ClassVar[bool] = True
    onset: Onset
    peak: Float[Array, " d"]
    centre: Float[Array, ""]
    """Height of the fastest water (m)."""
    width: Float[Array, ""]
    """Distance from there at which the velocity has fallen to 1/e (m)."""

    def fully_on(self, point, time):
        return self.peak * jnp.exp(-(((point[-1] - self.centre) / self.width) ** 2))


class WashFlow(FlowTable):
    """A level stream: ``velocity * exp(-((z - centre) / width)**2)``."""

    kind: Literal["wash"] = Field(default="wash", description="A level stream.")
    velocity: Velocity = Field(description="Velocity at the centre.")
    centre: Metres = Field(description="Height z of the centre.")
    width: Metres = Field(gt=0, description="Half width, where it has fallen to 1/e.")

    def build(self, scenario, generator):
        numbers = map(jnp.asarray, (self.velocity, self.centre, self.width))
        return Wash(flow_onset(self), *numbers)
