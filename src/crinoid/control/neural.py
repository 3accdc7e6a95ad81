"""Neural control: a trained network in place of a controller."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.controller import Controller
from crinoid.control.observation import Observation
from crinoid.control.policy import Policy
from crinoid.control.seen import Command, Seen


class NeuralMemory(eqx.Module):
    """Numbers that a neural controller carries from one call to the next."""

    pose: Float[Array, " pose"]
    """Pose of the tip that was seen last."""
    averages: Float[Array, "average entry"]
    """Running averages of what was observed."""
    features: Float[Array, " feature"]
    """Features that the last command is of."""
    speed: Float[Array, " driven"]
    """Speed of the last command over the greatest one, before it was cut to that."""


class Neural(Controller):
    """Moves the commands as a network says that was trained in simulation (Tong et al. 2024)."""

    observation: Observation
    policy: Policy

    def start(self, seen: Seen) -> NeuralMemory:
        observed = self.observation(seen, seen.measured)
        averages = self.policy.start(observed)
        features = self.policy.features(averages, observed)
        return NeuralMemory(seen.measured, averages, features, jnp.zeros(self.policy.fastest.size))

    def command(self, memory: NeuralMemory, seen: Seen) -> tuple[Command, NeuralMemory]:
        after = self.remembered(memory, seen)
        return self.moved(after, seen, self.policy.speed(after.features))

    def remembered(self, memory: NeuralMemory, seen: Seen) -> NeuralMemory:
        """Return the memory when it has observed."""
        observed = self.observation(seen, memory.pose)
        features = self.policy.features(memory.averages, observed)
        averages = self.policy.remembered(memory.averages, observed)
        return NeuralMemory(seen.measured, averages, features, memory.speed)

    def moved(
        self, memory: NeuralMemory, seen: Seen, speed: Float[Array, " driven"]
    ) -> tuple[Command, NeuralMemory]:
        """Return the commands that move at a speed, over the greatest one and cut to that."""
        rows = jnp.asarray(self.observation.driven, int)
        wanted = seen.command[rows] + self.policy.fastest * jnp.tanh(speed)
        held = jnp.clip(wanted, seen.lower[rows], seen.upper[rows])
        return jnp.zeros_like(seen.command).at[rows].set(held), replace(memory, speed=speed)
