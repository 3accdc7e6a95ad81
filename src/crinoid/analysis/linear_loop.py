"""A control loop as one linear system in discrete time: arm, actuators, sensors and controller.

The arm with its actuators is the linear model of a time step (`crinoid.System.transition`) over a
control period, in the mean current, and in still water where the current comes to rest at times.
A reading comes as late as the newest known one is on average, in whole time steps. A controller of
any kind is its derivatives by readings, states of the actuators and its memory (`jax.jacfwd`), for
an arm at rest with the tip at its target, within all limits. The model includes the hold, images
of fast motions, damping by the integrator, all sensors, and inputs that hand over to others. A
sensor slower than the controller counts at each command.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Complex, Float, Int

from crinoid.analysis.sampled_plant import GROWS, SampledPlant, System
from crinoid.assembly.prepared import Prepared
from crinoid.compilation import ONCE, compiled
from crinoid.control import Reading, Target
from crinoid.dynamics import State
from crinoid.scenario.errors import got, refusal
from crinoid.simulation.loop import Loop
from crinoid.simulation.loop_margin import INDENTED, OpenLoop, around
from crinoid.simulation.setup import Setup, set_up

_GRID = 1500
_LOWEST = 1e-5  # lowest frequency looked at, over the highest
_WIDEST = 5e-3
"""Distance from a resonance, over it, from which on the even frequencies are as close."""
_SETTLED = 2.0  # how long a controller has run when it is linearised (s)
_FAR = 1e6  # by how much limits are moved away, over themselves and 1


class LinearLoop(NamedTuple):
    """A loop that is cut at the commands, and its poles when it is closed."""

    open: OpenLoop
    inputs: tuple[str, ...]  # names of the inputs that are driven
    poles: Complex[np.ndarray, " pole"]
    """Poles of the closed loop (1/s), the one that dies down last first; of the weakest water."""
    water: str  # the weakest water (`OpenLoop.weakest`)


class LinearPlant(NamedTuple):
    """Arm, actuators and sensors over a control period."""

    systems: dict[str, System]
    """From commands to readings and states of the actuators, in each water."""
    inputs: tuple[str, ...]
    period: float  # time between two commands (s)
    frequency: Float[np.ndarray, " f"]  # where its response is known (Hz)
    response: Complex[np.ndarray, "water f output input"]

    @staticmethod
    def of(setup: Setup) -> LinearPlant:
        """Return that of a scenario about the state in which its arm starts."""
        waters, systems, period = setup.prepared.facts.waters, {}, 0.0
        for water, current in waters.items():
            plant = SampledPlant.of(setup, current)
            systems[water], period = plant.from_commands().minimal(), plant.period
        poles = np.concatenate([np.linalg.eigvals(each.A) for each in systems.values()])
        frequency = _frequencies(poles, 1 / period)
        names = tuple(each.name for each in setup.loop.system.inputs)
        found = LinearPlant(systems, names, period, frequency, np.zeros((0, 0, 0, 0), complex))
        responses = [each.response(found.shift) for each in systems.values()]
        return found._replace(response=np.stack(responses))

    @property
    def shift(self) -> Complex[np.ndarray, " f"]:
        """What one period multiplies a motion by at each frequency, on the indented contour."""
        return np.exp(2 * np.pi * (1j + INDENTED) * self.frequency * self.period)

    def every(self, count: int) -> LinearPlant:
        """Return the plant at one of ``count`` frequencies, and at all close to resonances."""
        apart = np.diff(np.log(self.frequency), prepend=-np.inf, append=np.inf)
        close = np.minimum(apart[1:], apart[:-1]) < 0.9 * np.median(apart)
        kept = close | (np.arange(self.frequency.size) % count == 0)
        return self._replace(frequency=self.frequency[kept], response=self.response[:, kept])

    def transfer(self, controller: System) -> OpenLoop:
        """Return the loop by a controller, cut open, without knowing if it is stable closed."""
        own = controller.minimal()
        driven = _driven(own)
        answer = own.response(self.shift)[:, driven]
        loops = -answer @ self.response[..., driven]
        return OpenLoop(self.frequency, loops, np.zeros_like(loops[:, 0].real), tuple(self.systems))

    def poles(self, controller: System) -> dict[str, Complex[np.ndarray, " pole"]]:
        """Return the poles of the loop closed by a controller (1/s), in each water."""
        own, found = controller.minimal(), {}
        driven = _driven(own)
        for water, plant in self.systems.items():
            plant = plant._replace(B=plant.B[:, driven], D=plant.D[:, driven]).minimal()
            arm = plant.A + plant.B @ own.D[driven] @ plant.C
            closed = np.block([[arm, plant.B @ own.C[driven]], [own.B @ plant.C, own.A]])
            values = np.linalg.eigvals(closed).astype(complex)
            values = values[np.argsort(-np.abs(values))]
            # others are gone after a period
            found[water] = np.log(values[np.abs(values) > 0]) / self.period
        return found

    def closed(self, controller: System) -> LinearLoop:
        """Close the loop by a controller."""
        poles, loop = self.poles(controller), self.transfer(controller)
        water = max(poles, key=lambda each: poles[each][0].real)
        stable = bool(poles[water][0].real * self.period <= GROWS)
        water = loop.weakest if stable else water
        names = tuple(self.inputs[index] for index in _driven(controller.minimal()))
        return LinearLoop(loop._replace(stable=stable), names, poles[water], water)


def linear_loop(prepared: Prepared) -> LinearLoop:
    """Return the loop of a scenario about the state in which its arm starts."""
    control = prepared.scenario.control
    if not control.acts:
        raise refusal("control.kind", got("none", 'be a controller, such as "pid"'))
    setup = set_up(prepared)
    plant = LinearPlant.of(setup)
    controller = linear_controller(setup.loop, setup.state, plant.period)
    if not all(np.isfinite(part).all() for part in controller):
        text = got(control.kind, "be a controller with derivatives where the arm is at rest")
        raise refusal("control.kind", text)
    return plant.closed(controller)


def _driven(controller: System) -> Int[np.ndarray, " driven"]:
    return np.flatnonzero((controller.C != 0).any(axis=1) | (controller.D != 0).any(axis=1))


def linear_controller(loop: Loop, state: State, period: float) -> System:
    """Return the controller, from readings and the states of the actuators to commands."""
    calls = jnp.asarray(int(_SETTLED / period) + 2)
    slopes = _slopes(loop, state, calls)
    (of_memory, of_seen, of_last), (memory, seen, last) = jax.tree.map(np.asarray, slopes)
    # the last command is a state of the controller as well
    A = np.block([[memory, last], [of_memory, of_last]])
    B, C = np.concatenate([seen, of_seen]), np.hstack([of_memory, of_last])
    return System(A, B, C, of_seen)


@compiled(**ONCE)
def _slopes(loop: Loop, state: State, calls: Int[Array, ""]) -> tuple[tuple[Array, ...], ...]:
    """Return the derivatives of command and memory by memory, input and last command."""
    begin = loop.start(state)
    still = jnp.zeros(len(loop.system.inputs))
    first = loop.seen(state, begin.sensors, still)
    ages = {"tip": first.time - first.measurement_time} | {
        name: first.time - reading.measurement_time for name, reading in first.readings.items()
    }
    first = replace(
        first,
        reference=first.measured,
        feedforward=still,
        target=Target(first.measured, None, (), loop.target.carrier),
        lower=first.lower - _FAR * (1 + jnp.abs(first.lower)),
        upper=first.upper + _FAR * (1 + jnp.abs(first.upper)),
    )
    sampled = zip(loop.sensors, begin.sensors, strict=True)
    read = [sensor.reading(samples, state.time).value for sensor, samples in sampled]
    values, shaped_values = ravel_pytree(read)
    numbers, others = eqx.partition(first.actuators, eqx.is_inexact_array)
    followers, shaped_followers = ravel_pytree(numbers)

    def seen_at(index: Array, values: Array, followers: Array, last: Array) -> Any:
        time = first.time + index * loop.clock.period
        tip, *readings = shaped_values(values)
        actuators = eqx.combine(shaped_followers(followers), others)
        base, _, _ = loop.system.base.pose(first.time, actuators[0])
        return replace(
            first,
            time=time,
            measurement_time=time - ages["tip"],
            measured=loop.target.to_frame(tip, first.time),
            base=base,
            command=last,
            actuators=actuators,
            readings={
                sensor.name: Reading(value, time - ages[sensor.name])
                for sensor, value in zip(loop.sensors[1:], readings, strict=True)
            },
        )

    def call(index: Array, carry: tuple[Any, Array]) -> tuple[Any, Array]:
        memory, last = carry
        command, memory = loop.controller.command(memory, seen_at(index, values, followers, last))
        return memory, command

    carry = (loop.controller.start(first), still)
    carry = jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype), carry)
    memory, last = jax.lax.fori_loop(0, calls, call, carry)
    numbers, rest = eqx.partition(memory, eqx.is_inexact_array)
    remembered, shaped_memory = ravel_pytree(numbers)

    def change(remembered: Array, seen: Array, last: Array) -> tuple[Array, Array]:
        memory = eqx.combine(shaped_memory(remembered), rest)
        now = seen_at(calls, seen[: values.size], seen[values.size :], last)
        command, memory = loop.controller.command(memory, now)
        return command, ravel_pytree(eqx.filter(memory, eqx.is_inexact_array))[0]

    both = jnp.concatenate([values, followers])
    return jax.jacfwd(change, argnums=(0, 1, 2))(remembered, both, last)


def _frequencies(poles: Complex[np.ndarray, " pole"], rate: float) -> Float[np.ndarray, " f"]:
    """Return a grid of frequencies, even by octaves and dense near resonances (Hz)."""
    highest = 0.5 * rate
    grid = [np.geomspace(_LOWEST * highest, highest, _GRID)]
    swinging = poles[(poles.imag > 0) & (np.abs(poles) > 0)]
    speed = np.log(swinging) * rate / (2 * np.pi)
    for each in speed[np.abs(speed.real) < 0.1 * speed.imag]:
        width = max(abs(each.real), INDENTED * each.imag)
        grid.append(each.imag + around(width, max(4 * width, _WIDEST * each.imag)))
    found = np.unique(np.concatenate(grid))
    return found[(found > 0) & (found <= highest)]
