"""One tick of the closed loop: sensor, controller, base, arm."""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from crinoid.assembly.door import check_controller
from crinoid.control import Clock, Controller, FeedForward, Seen, Sensor, SensorState, Target
from crinoid.dynamics import Books, Outcome, Progress, State, System


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
    books: Books | None
    """Energies, works and impulses; None in what is differentiated, which leaves them out."""
    sensors: tuple[SensorState, ...]
    memory: Any
    """Memory of the controller."""
    ticks: Int[Array, ""]
    """Commands given so far."""
    command: Float[Array, " input"]
    steps: Int[Array, ""]
    """Time steps taken so far."""
    tally: Tally
    """Tally of the time steps since the last instant that was saved."""


class Loop(eqx.Module):
    """An arm with what controls it."""

    system: System
    sensors: tuple[Sensor, ...]
    """The first one measures the tip's pose."""
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
        sensors = tuple(
            sensor.start(sensor.measurand.of(self.system, state)) for sensor in self.sensors
        )
        command = jnp.zeros(len(self.system.inputs))
        seen = self.seen(state, sensors, command)
        check_controller(self.controller, seen, self.system.inputs)
        return LoopState(
            state,
            Books.of(self.system.forces, state),
            sensors,
            self.controller.start(seen),
            jnp.asarray(0),
            command,
            jnp.asarray(0),
            Tally.of_nothing(),
        )

    @property
    def readings(self) -> list[tuple[str, str]]:
        """Name and unit of each value that the sensors give, one behind the other."""
        axes = self.system.forces.axes
        return [
            (f"{sensor.name}.{name}", unit)
            for sensor in self.sensors
            for name, unit in sensor.measurand.names(axes)
        ]

    def seen(
        self, state: State, sensors: tuple[SensorState, ...], command: Float[Array, " input"]
    ) -> Seen:
        """Return what the controller sees of a state."""
        time, inputs = state.time, self.system.inputs
        tip, *others = (
            sensor.reading(samples, time)
            for sensor, samples in zip(self.sensors, sensors, strict=True)
        )
        forward, compared = jnp.zeros_like(command), time
        if self.feed_forward is not None or self.target.carrier is not None:
            # the tip was not to be any farther yet when it was measured
            compared = tip.taken
        if self.feed_forward is not None:
            forward = self.feed_forward(self.target, time)
        base, _, _ = self.system.base.pose(time, state.servo)
        return Seen(
            time=time,
            # where the submarine carries the target along, it carries the arm as well
            measured=self.target.seen(tip.value, compared),
            taken=tip.taken,
            wanted=self.target.in_frame(compared),
            forward=forward,
            target=self.target,
            base=base,
            command=command,
            actuators=(state.servo, *state.actuators),
            lower=jnp.stack([each.lower for each in inputs]),
            upper=jnp.stack([each.upper for each in inputs]),
            readings={
                sensor.name: reading
                for sensor, reading in zip(self.sensors[1:], others, strict=True)
            },
        )

    def tick(self, carry: LoopState) -> tuple[LoopState, Progress]:
        """Advance by one time step; sensors and controller act if their time has come."""
        told = self._told(carry)
        assert carry.books is not None
        state, books, progress = self.system.advance_with_books(
            carry.state, carry.books, told.command
        )
        return self._after(told, state, books, progress), progress

    def step(self, carry: LoopState) -> tuple[LoopState, Outcome]:
        """Advance like `tick`, but without books, and differentiable in both modes.

        A time step that fails is not cut into shorter ones: its outcome says so, and the state that
        comes back should not be used.
        """
        told = self._told(carry)
        state, outcome = self.system.step(carry.state, told.command)
        one = outcome.converged.astype(int)
        progress = Progress(outcome, outcome.residual, outcome.error, one, outcome.iterations)
        return self._after(told, state, None, progress), outcome

    def sensed(self, carry: LoopState) -> tuple[SensorState, ...]:
        """Return the sensors when those have measured whose time has come."""
        return tuple(
            self._sampled(sensor, samples, carry.state)
            for sensor, samples in zip(self.sensors, carry.sensors, strict=True)
        )

    def _told(self, carry: LoopState) -> LoopState:
        """Return the loop when sensors and controller have acted, before the arm has moved."""
        before, sensors = carry.state, self.sensed(carry)
        due = self.clock.due(carry.ticks, before.time - self.switched_on)

        def act() -> tuple[Array, Any]:
            seen = self.seen(before, sensors, carry.command)
            memory = _choose(carry.ticks == 0, self.controller.start(seen), carry.memory)
            command, memory = self.controller.command(memory, seen)
            return jnp.clip(command, seen.lower, seen.upper), memory

        command, memory = jax.lax.cond(
            due & self.enabled, act, lambda: (carry.command, carry.memory)
        )
        return replace(
            carry, sensors=sensors, memory=memory, ticks=carry.ticks + due, command=command
        )

    def _after(
        self, told: LoopState, state: State, books: Books | None, progress: Progress
    ) -> LoopState:
        """Return the loop when the arm has moved."""
        converged = progress.outcome.converged
        steps = told.steps + converged
        # counted, not summed up: round-off of a sum would grow with the number of steps
        counted = jnp.where(converged, steps * self.system.time_step, state.time)
        state = eqx.tree_at(lambda s: s.motion.time, state, counted)
        tally = told.tally.with_step(progress)
        return replace(told, state=state, books=books, steps=steps, tally=tally)

    def _sampled(self, sensor: Sensor, samples: SensorState, state: State) -> SensorState:
        """Return the samples of a sensor, which measures when it is due and at no other step."""
        return jax.lax.cond(
            sensor.clock.due(samples.ticks, state.time),
            lambda: sensor.sample(samples, sensor.measurand.of(self.system, state), state.time),
            lambda: samples,
        )


def _choose(condition: Bool[Array, ""], new: Any, old: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)
