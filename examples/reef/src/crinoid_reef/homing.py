"""A controller: the base undoes the tip's error, the thruster keeps a distance."""

from typing import Annotated

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float
from pydantic import Field

from crinoid import Controller, ControllerInput, ScenarioError
from crinoid.tables import ControllerTable, Metres, Mistake, Quantity, got

Command = Float[Array, " input"]


class Homing(Controller):
    """Moves the base at a speed in proportion to the error, and pushes in proportion to a range."""

    rate: Float[Array, ""]
    """Share of the error that is undone in a second (1/s)."""
    mapping: Float[Array, "input pose"]
    """Move of each input per error of the tip."""
    period: Float[Array, ""]
    distance: Float[Array, ""]
    """Range to keep (m)."""
    push: Command
    """Thrust per metre that the range is too large (N/m), 0 for the other inputs."""
    sensor: str = eqx.field(static=True)

    def start(self, seen: ControllerInput) -> Command:
        return jnp.zeros_like(seen.command)

    def command(self, memory: Command, seen: ControllerInput) -> tuple[Command, Command]:
        error = jnp.sum(self.mapping * (seen.reference - seen.measured), axis=1)
        moved = jnp.clip(memory + self.rate * self.period * error, seen.lower, seen.upper)
        too_far = seen.readings[self.sensor].value[0] - self.distance
        return moved + self.push * too_far, moved


class HomingController(ControllerTable):
    """Integral action of the base, and a thruster that keeps a range."""

    rate: Annotated[float, Quantity("1/s")] = Field(
        default=1.0, gt=0, description="Share of the error that is undone in a second."
    )
    thruster: str = Field(default="thruster", description="Name of the thruster.")
    sensor: str = Field(default="range", description="Name of the sensor of the range.")
    distance: Metres = Field(gt=0, description="Range to keep.")
    gain: Annotated[float, Quantity("N/m")] = Field(
        default=1.0, description="Thrust per metre that the range is too large."
    )

    def build(self, plan):
        inputs = [each.name for each in plan.inputs]
        known = {"thruster": inputs, "sensor": plan.readings}
        mistakes = [
            Mistake(f"control.homing.{key}", got(getattr(self, key), f"be one of {names}"))
            for key, names in known.items()
            if getattr(self, key) not in names
        ]
        if mistakes:
            raise ScenarioError(mistakes)
        thrusters = [name == self.thruster for name in inputs]
        return Homing(
            rate=jnp.asarray(self.rate),
            mapping=jnp.asarray(plan.mapping(plan.scenario.driven)),
            period=jnp.asarray(plan.period),
            distance=jnp.asarray(self.distance),
            push=jnp.where(jnp.asarray(thrusters), self.gain, 0.0),
            sensor=self.sensor,
        )
