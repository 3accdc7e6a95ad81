"""Sequential control: phases, each of which ends after a time or at a touch."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from crinoid.control.controller import SLACK, Command, Controller, ControllerInput
from crinoid.numerics.ramp import Onset


class SequenceMemory(eqx.Module):
    """Memory of a sequence: its present phase."""

    phase: Int[Array, ""]
    """Index of the phase, from 0."""
    begin: Float[Array, ""]
    """Time when it began (s)."""
    initial: Command
    """Command when it began."""


class Sequence(Controller):
    """Sequence of phases: in each, inputs move to values along half a cosine.

    A phase ends after its duration. One with contact forces ends when its sensors feel them: before
    that time inputs stop where they are, and after it they wait at their values.
    """

    value: Float[Array, "phase input"]
    """Commands at the end of each phase, in the units of the inputs."""
    moves: Bool[Array, "phase input"]
    """Inputs that a phase moves; others keep their command."""
    duration: Float[Array, " phase"]
    """Time in which inputs reach their values (s)."""
    force: Float[Array, "phase sensor"]
    """Contact forces that end a phase (N); 0: none."""
    sensors: tuple[str, ...] = eqx.field(static=True)
    """Names of the contact sensors."""

    def start(self, seen: ControllerInput) -> SequenceMemory:
        return SequenceMemory(jnp.asarray(0), seen.time, seen.command)

    def command(
        self, memory: SequenceMemory, seen: ControllerInput
    ) -> tuple[Command, SequenceMemory]:
        phase, elapsed = memory.phase, seen.time - memory.begin
        share = Onset.of(0.0, self.duration[phase])(elapsed)
        value = jnp.where(self.moves[phase], self.value[phase], memory.initial)
        command = memory.initial + share * (value - memory.initial)

        felt = [jnp.sum(seen.readings[name].value ** 2) for name in self.sensors]
        force = self.force[phase]
        touched = jnp.all(jnp.asarray(felt) >= force**2)
        over = jnp.where(jnp.any(force > 0), touched, elapsed > self.duration[phase] - SLACK)
        over &= phase + 1 < self.duration.size
        following = SequenceMemory(phase + 1, seen.time, command)
        return command, jax.tree.map(lambda a, b: jnp.where(over, a, b), following, memory)
