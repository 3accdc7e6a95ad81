"""One tick of the closed loop: sensor, controller, base, arm."""

import time
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.assembly.door import check_controller
from crinoid.compilation import OFTEN, compiled
from crinoid.control import (
    Clock,
    Controller,
    ControllerInput,
    Estimate,
    FeedForward,
    Reading,
    Sensor,
    SensorState,
    Target,
)
from crinoid.dynamics import EnergyAccount, Outcome, State, StepStatistics, System

__all__ = ["controller_cpu_time"]


class LoopState(eqx.Module):
    """State of the closed loop, which one tick hands to the next."""

    state: State
    books: EnergyAccount | None  # energies, works and impulses; None in differentiable runs
    sensors: tuple[SensorState, ...]
    memory: Any  # memory of the controller
    ticks: Int[Array, ""]  # commands given so far
    command: Float[Array, " input"]
    steps: Int[Array, ""]  # time steps taken so far
    tally: StepStatistics  # sums over the time steps since the last instant that was saved


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
    """None where the target does not move, or without feed-forward."""
    enabled: Bool[Array, ""]
    """Where false the commands stay zero: the same compiled loop runs without control."""

    def start(self, state: State) -> LoopState:
        """Close the loop around an arm."""
        sensors = tuple(
            sensor.start(sensor.measurand.of(self.system, state)) for sensor in self.sensors
        )
        command = jnp.zeros(len(self.system.inputs))
        seen = self.seen(state, sensors, command)
        check_controller(self.controller, seen, self.system.inputs, self.system.reference.nodes)
        return LoopState(
            state,
            EnergyAccount.of(self.system.forces, state),
            sensors,
            self.controller.start(seen),
            jnp.asarray(0),
            command,
            jnp.asarray(0),
            StepStatistics.of_nothing(),
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
    ) -> ControllerInput:
        """Return what the controller sees of a state."""
        time, inputs = state.time, self.system.inputs
        tip, *others = (
            sensor.reading(samples, time)
            for sensor, samples in zip(self.sensors, sensors, strict=True)
        )
        feedforward, compared = jnp.zeros_like(command), time
        if self.feed_forward is not None or self.target.carrier is not None:
            # the tip was not to be any farther yet when it was measured
            compared = tip.measurement_time
        if self.feed_forward is not None:
            feedforward = self.feed_forward(self.target, time)
        base, _, _ = self.system.base.pose(time, state.servo)
        return ControllerInput(
            time=time,
            # where the submarine carries the target along, it carries the arm as well
            measured=self.target.to_frame(tip.value, compared),
            measurement_time=tip.measurement_time,
            reference=self.target.in_frame(compared),
            feedforward=feedforward,
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

    def estimate(self, carry: LoopState) -> tuple[Estimate | None, Float[Array, ""] | None]:
        """Return the estimate of an observer in the world, and the time of its command (s).

        None without an observer, nan before the first command.
        """
        found = self.controller.estimate(carry.memory)
        if found is None:
            return None, None
        step, carrier = self.system.time_step, self.target.carrier
        time = self.command_step(carry.ticks - 1) * step
        if carrier is not None:
            found = found.in_world(carrier, time)
        given = carry.ticks > 0
        return jax.tree.map(lambda each: jnp.where(given, each, jnp.nan), (found, time))

    def command_step(self, earlier: Int[Array, ""]) -> Int[Array, ""]:
        """Return the time step before which the command after ``earlier`` ones is given."""
        begin, step = self.switched_on, self.system.time_step
        near = jnp.ceil((earlier * self.clock.period + begin) / step).astype(int)
        candidates = jnp.maximum(near + np.arange(-1, 2), 0)
        due = self.clock.due(earlier, candidates * step - begin)  # it rounds in its own way
        return candidates[jnp.argmax(due)]

    def tick(self, carry: LoopState) -> tuple[LoopState, Outcome]:
        """Advance by one time step; sensors and controller act if their time has come.

        The outcome is that of the last solve.
        """
        commanded = self._commanded(carry)
        assert carry.books is not None
        state, books, progress = self.system.advance_with_account(
            carry.state, carry.books, commanded.command, before=carry.tally
        )
        return self._advanced(commanded, state, books, progress)

    def step(self, carry: LoopState) -> tuple[LoopState, Outcome]:
        """Advance like `tick`, but without books, and differentiable in both modes.

        A time step that fails is not cut into shorter ones: its outcome says so, and the state that
        comes back should not be used.
        """
        commanded = self._commanded(carry)
        state, outcome = self.system.step(carry.state, commanded.command)
        return self._advanced(commanded, state, None, carry.tally.with_solve(outcome))

    def sensed(self, carry: LoopState) -> tuple[SensorState, ...]:
        """Return the sensors when those have measured whose time has come, and no others."""
        state = carry.state

        def sampled(sensor: Sensor, samples: SensorState) -> SensorState:
            return jax.lax.cond(
                sensor.clock.due(samples.ticks, state.time),
                lambda: sensor.sample(samples, sensor.measurand.of(self.system, state), state.time),
                lambda: samples,
            )

        return tuple(map(sampled, self.sensors, carry.sensors))

    def _commanded(self, carry: LoopState) -> LoopState:
        """Return the loop when sensors and controller have acted, before the arm has moved."""
        before, sensors = carry.state, self.sensed(carry)
        due = self.clock.due(carry.ticks, before.time - self.switched_on)

        def act() -> tuple[Array, Any]:
            seen = self.seen(before, sensors, carry.command)
            first, begin = carry.ticks == 0, self.controller.start(seen)
            memory = jax.tree.map(lambda a, b: jnp.where(first, a, b), begin, carry.memory)
            command, memory = self.controller.command(memory, seen)
            return jnp.clip(command, seen.lower, seen.upper), memory

        command, memory = jax.lax.cond(
            due & self.enabled, act, lambda: (carry.command, carry.memory)
        )
        return replace(
            carry, sensors=sensors, memory=memory, ticks=carry.ticks + due, command=command
        )

    def _advanced(
        self,
        commanded: LoopState,
        state: State,
        books: EnergyAccount | None,
        progress: StepStatistics,
    ) -> tuple[LoopState, Outcome]:
        """Return the loop when the arm has moved, and the outcome of the last solve."""
        assert progress.outcome is not None
        converged = progress.outcome.converged
        steps = commanded.steps + converged
        # counted, not summed up: round-off of a sum would grow with the number of steps
        counted = jnp.where(converged, steps * self.system.time_step, state.time)
        state = eqx.tree_at(lambda s: s.motion.time, state, counted)
        tally = replace(progress, outcome=None)
        after = replace(commanded, state=state, books=books, steps=steps, tally=tally)
        return after, progress.outcome


_OF_INPUTS = ("feedforward", "command", "lower", "upper")
"""Fields of what a controller sees that have a number for each input."""


@compiled(**OFTEN)
def see(
    loop: Loop, state: LoopState, rows: Int[Array | np.ndarray, " input"]
) -> tuple[ControllerInput, Int[Array, ""], Int[Array, ""]]:
    """Return what a controller of some inputs sees, and the time steps of two commands.

    These are the present one and the next.
    """
    seen = loop.seen(state.state, loop.sensed(state), state.command)
    seen = replace(seen, **{name: getattr(seen, name)[rows] for name in _OF_INPUTS})
    return seen, loop.command_step(state.ticks), loop.command_step(state.ticks + 1)


_MIN_TIME = 0.05
"""Shortest CPU time of a measurement (s), which makes the call of the program negligible."""
_REPEATS = 5
_MOST_CALLS = 1 << 20
_PERTURBATION = 1e-3  # by how much readings differ from one call to the next, in their units


def controller_cpu_time(loop: Loop, state: State) -> float:
    """Return the CPU time of one command of a controller (s).

    The compiled controller alone, called many times in a row inside one program, which runs on one
    core: each call has the memory of the one before, the next time, and readings that differ a
    little. The median of five measurements of at least 0.05 s each; what other programs do at the
    same time does not count. The time to build `crinoid.ControllerInput` does not count either.
    """
    calls = 16
    _run(loop, state, calls)  # compiles
    while (took := _run(loop, state, calls)) < _MIN_TIME and calls < _MOST_CALLS:
        calls = min(_MOST_CALLS, int(calls * min(16.0, 1.5 * _MIN_TIME / max(took, 1e-6)) + 1))
    return float(np.median([_run(loop, state, calls) for _ in range(_REPEATS)])) / calls


def _run(loop: Loop, state: State, calls: int) -> float:
    started = time.process_time()
    jax.block_until_ready(_commands(loop, state, jnp.asarray(calls)))
    return time.process_time() - started


@compiled(**OFTEN)
def _commands(loop: Loop, state: State, calls: Int[Array, ""]) -> Float[Array, " input"]:
    """Give commands in a row, and return the sum of them."""
    begin = loop.start(state)
    first = loop.seen(state, begin.sensors, begin.command)

    def call(index: Int[Array, ""], carry: tuple[Any, Array, Array]) -> tuple[Any, Array, Array]:
        memory, command, total = carry
        late = index * loop.clock.period
        perturbation = _PERTURBATION * jnp.sin(0.7 * index)
        seen = replace(
            first,
            time=first.time + late,
            measurement_time=first.measurement_time + late,
            measured=first.measured + perturbation,
            command=command,
            readings={
                name: Reading(reading.value + perturbation, reading.measurement_time + late)
                for name, reading in first.readings.items()
            },
        )
        command, memory = loop.controller.command(memory, seen)
        command = jnp.clip(command, seen.lower, seen.upper)
        return memory, command, total + command

    zero = jnp.zeros_like(begin.command)
    carry = (loop.controller.start(first), zero, zero)
    carry = jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype), carry)
    return jax.lax.fori_loop(0, calls, call, carry)[2]
