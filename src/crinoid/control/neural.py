"""Neural control: a trained network in place of a controller."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import Actuator, drives
from crinoid.control.controller import Command, Controller, ControllerInput
from crinoid.control.target import pose_error
from crinoid.numerics.small_matrices import product


class Dense(eqx.Module):
    """A layer: ``weight x + bias``."""

    weight: Float[Array, "out in"]
    bias: Float[Array, " out"]

    def __call__(self, x: Float[Array, " in"]) -> Float[Array, " out"]:
        return product(self.weight, x) + self.bias


class Policy(eqx.Module):
    """Commands by what was observed, now and before.

    The past enters as running averages of each observation over several times (a gamma memory of
    order one: de Vries and Principe, Neural Networks 5 (1992) 565-576); a feature is the difference
    of two of them that follow each other. What comes out is a linear function of the features
    and a network of them, added up, and says how fast each command moves.
    """

    centre: Float[Array, " entry"]
    """Usual value of each number that is observed, in its unit."""
    usual: Float[Array, " feature"]
    """One over the usual size of each feature."""
    kept: Float[Array, " average"]
    """Share of an average that is left after a control period, the shortest first."""
    linear: Float[Array, "driven feature"]
    layers: tuple[Dense, ...]
    """All but the last are followed by a hyperbolic tangent."""
    swing: Float[Array, " driven"]
    """Usual speed of each command, over the fastest one."""
    fastest: Float[Array, " driven"]
    """Largest move of each command in a period, in its unit."""

    def start(self, observed: Float[Array, " entry"]) -> Float[Array, "average entry"]:
        """Return the averages of what has been observed for ever."""
        return jnp.broadcast_to(observed, (self.kept.size, observed.size))

    def update_memory(
        self, averages: Float[Array, "average entry"], observed: Float[Array, " entry"]
    ) -> Float[Array, "average entry"]:
        """Return the averages a control period later."""
        return observed + self.kept[:, None] * (averages - observed)

    def features(
        self, averages: Float[Array, "average entry"], observed: Float[Array, " entry"]
    ) -> Float[Array, " feature"]:
        """Return the inputs of the network."""
        ladder = jnp.concatenate([observed[None], averages, self.centre[None]])
        return jnp.ravel(ladder[:-1] - ladder[1:]) * self.usual

    def speed(self, features: Float[Array, " feature"]) -> Float[Array, " driven"]:
        """Return how fast commands are to move, over the fastest; beyond 1 as well."""
        hidden = features
        for layer in self.layers[:-1]:
            hidden = jnp.tanh(layer(hidden))
        return self.swing * (product(self.linear, features) + self.layers[-1](hidden))


AHEAD = 0.5
"""Preview of a moving target (s)."""


class Observation(eqx.Module):
    """Flat array of a controller's input; ``crinoid.assembly.neural`` names it."""

    actuators: tuple[Actuator, ...]
    """Actuators other than the servos of the base."""
    period: Float[Array, ""]
    """Time between two commands (s)."""
    axes: int = eqx.field(static=True)
    driven: tuple[int, ...] = eqx.field(static=True)
    """Indices of the inputs that can move."""
    servos: tuple[int, ...] = eqx.field(static=True)
    """Indices of those that are channels of the base."""
    carried: tuple[int, ...] = eqx.field(static=True)
    """Channels of the base that a prescribed motion moves."""
    ahead: bool = eqx.field(static=True)
    """Whether the target moves."""

    def __call__(
        self, seen: ControllerInput, before: Float[Array, " pose"]
    ) -> Float[Array, " entry"]:
        """Return the numbers; ``before`` is the pose of the tip seen a control period earlier."""
        servo, *others = seen.actuators
        error = pose_error(seen.reference, seen.measured)
        pointing = error[self.axes :]
        if self.axes == 2:
            pointing = jnp.concatenate([jnp.sin(pointing), jnp.cos(pointing)])
        rows = np.array(self.servos, int)
        parts = [
            error[: self.axes],
            pointing,
            pose_error(seen.measured, before) / self.period,
            servo.position[rows],
            servo.velocity[rows],
            seen.base[np.array(self.carried, int)],
            drives(self.actuators, others),
            seen.command[np.array(self.driven)],
            *(reading.value for reading in seen.readings.values()),
        ]
        if self.ahead:
            now, later = (seen.target.in_frame(seen.time + after) for after in (0.0, AHEAD))
            parts.append((later - now)[: self.axes])
        return jnp.concatenate([part for part in parts if part is not None])


class NeuralMemory(eqx.Module):
    """Memory of a neural controller."""

    pose: Float[Array, " pose"]
    """Pose of the tip that was seen last."""
    averages: Float[Array, "average entry"]
    """Running averages of what was observed."""
    features: Float[Array, " feature"]
    """Features that the last command is of."""
    speed: Float[Array, " driven"]
    """Speed of the last command over the greatest one, before it was cut to that."""


class Neural(Controller):
    """Controller by a network that was trained in simulation (Tong et al. 2024)."""

    observation: Observation
    policy: Policy

    def start(self, seen: ControllerInput) -> NeuralMemory:
        observed = self.observation(seen, seen.measured)
        averages = self.policy.start(observed)
        features = self.policy.features(averages, observed)
        return NeuralMemory(seen.measured, averages, features, jnp.zeros(self.policy.fastest.size))

    def command(self, memory: NeuralMemory, seen: ControllerInput) -> tuple[Command, NeuralMemory]:
        after = self.update_memory(memory, seen)
        return self.act(after, seen, self.policy.speed(after.features))

    def update_memory(self, memory: NeuralMemory, seen: ControllerInput) -> NeuralMemory:
        """Return the memory when it has observed."""
        observed = self.observation(seen, memory.pose)
        features = self.policy.features(memory.averages, observed)
        averages = self.policy.update_memory(memory.averages, observed)
        return NeuralMemory(seen.measured, averages, features, memory.speed)

    def act(
        self, memory: NeuralMemory, seen: ControllerInput, speed: Float[Array, " driven"]
    ) -> tuple[Command, NeuralMemory]:
        """Return the commands that move at a speed, over the greatest one and cut to that."""
        rows = jnp.asarray(self.observation.driven, int)
        wanted = seen.command[rows] + self.policy.fastest * jnp.tanh(speed)
        held = jnp.clip(wanted, seen.lower[rows], seen.upper[rows])
        return jnp.zeros_like(seen.command).at[rows].set(held), replace(memory, speed=speed)
