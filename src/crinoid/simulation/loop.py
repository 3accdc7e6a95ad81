"""One tick of the closed loop: sensor, controller, base, arm."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from crinoid.control import Clock, Controller, FeedForward, Sensor, Target
from crinoid.control.sensor import SensorState
from crinoid.dynamics import Books, Progress, State, System


class Tally(eqx.Module):
    """Cost and errors of time steps, summed up."""

    steps: Int[Array, ""]
    iterations: Int[Array, ""]
    residual: Float[Array, ""]
    """Largest imbalance that one of them ended with (N)."""
    error: Float[Array, ""]
    """Largest estimated local error of one of them (m)."""

    @staticmethod
    def of_nothing() -> "Tally":
        """Return the tally of no steps."""
        return Tally(jnp.asarray(0), jnp.asarray(0), jnp.zeros(()), jnp.zeros(()))

    def with_step(self, progress: Progress) -> "Tally":
        """Count in one more step, or the parts of it that succeeded."""
        return Tally(
            self.steps + progress.steps,
            self.iterations + progress.iterations,
            jnp.maximum(self.residual, progress.residual),
            jnp.maximum(self.error, progress.error),
        )


class LoopState(eqx.Module):
    """State of the closed loop, which one tick hands to the next."""

    state: State
    books: Books
    sensor: SensorState
    memory: Any
    """Memory of the controller."""
    ticks: Int[Array, ""]
    """Commands given so far."""
    command: Float[Array, " channel"]
    steps: Int[Array, ""]
    """Time steps taken so far."""
    tally: Tally
    """Tally of the time steps since the last instant that was saved."""


class Loop(eqx.Module):
    """An arm with what controls it."""

    system: System
    sensor: Sensor
    controller: Controller
    clock: Clock
    """Clock of the controller, from when it is switched on."""
    switched_on: Float[Array, ""]
    """When the controller is switched on (s)."""
    target: Target
    feed_forward: FeedForward | None
    """None where the target stands still, or is not to be followed at once."""
    enabled: Bool[Array, ""]
    """Where false the commands stay zero: the same compiled loop runs without control."""

    def start(self, state: State) -> LoopState:
        """Close the loop around an arm."""
        pose = self.system.tip(state)
        return LoopState(
            state,
            Books.of(self.system.forces, state),
            self.sensor.start(pose),
            self.controller.start(pose),
            jnp.asarray(0),
            jnp.zeros(len(self.system.inputs)),
            jnp.asarray(0),
            Tally.of_nothing(),
        )

    def tick(self, carry: LoopState) -> tuple[LoopState, Progress]:
        """Advance by one time step; sensor and controller act if their time has come."""
        time = carry.state.time
        sensor = self.sensor.sample(carry.sensor, self.system.tip(carry.state), time)
        reading = self.sensor.reading(sensor, time)
        due = self.clock.due(carry.ticks, time - self.switched_on)
        forward, compared = jnp.zeros(len(self.system.inputs)), time
        if self.feed_forward is not None or self.target.carrier is not None:
            # the tip was not to be any farther yet when it was measured
            compared = self.sensor.taken(sensor, time)
        if self.feed_forward is not None:
            forward = self.feed_forward(self.target, time)
        # where the submarine carries the target along, it carries the arm as well
        measured, wanted = self.target.seen(reading, compared), self.target.in_frame(compared)
        first = due & (carry.ticks == 0)
        before = _choose(first, self.controller.start(measured), carry.memory)
        command, memory = self.controller.command(before, measured, wanted, forward)
        memory = _choose(due, memory, carry.memory)
        command = jnp.where(due, jnp.where(self.enabled, command, 0.0), carry.command)
        state, books, progress = self.system.advance_with_books(carry.state, carry.books, command)
        steps = carry.steps + progress.outcome.converged
        # counted, not summed up: round-off of a sum would grow with the number of steps
        counted = jnp.where(progress.outcome.converged, steps * self.system.time_step, state.time)
        state = eqx.tree_at(lambda s: s.motion.time, state, counted)
        tally = carry.tally.with_step(progress)
        ticks = carry.ticks + due
        return LoopState(state, books, sensor, memory, ticks, command, steps, tally), progress


def _choose(condition: Bool[Array, ""], new: Any, old: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)
