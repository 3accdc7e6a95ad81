"""An actuator: a thruster at the tip that pushes along the arm."""

from typing import ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float
from pydantic import Field

from crinoid import Actuator, ActuatorParameters, Element, Input, Motion
from crinoid.tables import ActuatorTable, Newtons, Seconds


class Thruster(Actuator):
    """A thrust that follows its command to first order."""

    name: str = eqx.field(static=True)
    most: Float[Array, ""]
    """Largest thrust, either way (N)."""
    lag: Float[Array, ""]
    """Time constant (s)."""

    @property
    def inputs(self):
        return (Input(self.name, "N", "tension", -self.most, self.most),)

    def at_rest(self):
        return jnp.zeros(1)

    def advance(self, state, command, step):
        return command + (state - command) * jnp.exp(-step / self.lag)

    def drive(self, state):
        return state


class Thrust(Element):
    """Where a thruster acts: on the tip, along the last edge."""

    stencil: ClassVar[int] = 2
    worked: ClassVar[str] = "actuation"
    first: int = eqx.field(static=True)
    at: int = eqx.field(static=True)
    """Where the thrust stands among the drives of all actuators."""
    share: Float[Array, "*count"]
    """Share of the thrust, one a window."""

    def residual(self, motion: Motion) -> Float[Array, "2 d"]:
        edge = motion.position[1] - motion.position[0]
        force = self.share * motion.drive[self.at] * edge / jnp.sqrt(jnp.sum(edge**2))
        return jnp.stack([jnp.zeros_like(force), -force])


class ThrusterParameters(ActuatorParameters):
    """The numbers of a thruster."""

    most: Float[Array, ""]
    lag: Float[Array, ""]
    name: str = eqx.field(static=True)

    def assemble(self, rod, first):
        actuator = Thruster(self.name, self.most, self.lag)
        return actuator, (Thrust(rod.nodes - 1, first, jnp.ones(1)),)


class ThrusterActuator(ActuatorTable):
    """A thruster at the tip that pushes along the arm."""

    kind: Literal["thruster"] = Field(default="thruster", description="A thruster at the tip.")
    max_thrust: Newtons = Field(gt=0, description="Largest thrust, forward and backward.")
    time_constant: Seconds = Field(default=0.1, gt=0, description="Lag of the thrust.")

    def build(self, scenario):
        return ThrusterParameters(
            jnp.asarray(self.max_thrust), jnp.asarray(self.time_constant), self.called
        )
