"""The numbers of a loop that change while it runs: all are arguments of its compiled step."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.assembly.arrays import array
from crinoid.assembly.parameters import Parameters
from crinoid.compilation import ONCE, compiled
from crinoid.control import Pid
from crinoid.flow import Flow, Turbulence
from crinoid.flow.flow import Jet, Point, Time
from crinoid.numerics.ramp import Onset
from crinoid.scenario import Scenario
from crinoid.simulation import Loop, with_parameters


class AdjustableNumbers(NamedTuple):
    """Multiples of numbers of a scenario; 1 is as it describes them."""

    current: float = 1.0  # multiple of the velocities of all flows
    intensity: float = 1.0  # multiple of the intensity of turbulence
    length_scale: float = 1.0  # multiple of the length scale of turbulence
    gains: float = 1.0  # multiple of the gains of a PID
    stiffness: float = 1.0
    """Multiple of Young's modulus, and of EA, EI and GJ where the scenario gives them."""

    @property
    def changed_names(self) -> tuple[str, ...]:
        """Names of those that are not 1."""
        return tuple(name for name, each in self._asdict().items() if each != 1.0)


SHARES: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "uniform": {"current": ("velocity",)},
    "shear": {"current": ("velocity",)},
    "gust": {"current": ("velocity",)},
    "sine": {"current": ("amplitude",)},
    "gauss-markov": {"current": ("mean", "standard_deviation")},
    "turbulence": {
        "current": ("mean",),
        "intensity": ("intensity",),
        "length_scale": ("length_scale",),
    },
    "waves": {"current": ("significant_height",)},
    "regular-wave": {"current": ("height",)},
}
"""Keys of each kind of flow that an adjustable number multiplies."""


def adjusted_scenario(scenario: Scenario, numbers: AdjustableNumbers) -> tuple[Scenario, list[str]]:
    """Return a scenario with adjusted numbers, and sentences on what none of its keys describes."""
    document, flows, notes = scenario.to_dict(), [], []
    for index, table in enumerate(document.get("flow", [])):
        shares = SHARES.get(table["kind"], {})
        if numbers.current == 0.0:
            continue
        for name, keys in shares.items():
            for key in keys:
                table[key] = _scaled(getattr(numbers, name), table.get(key))
        if numbers.current != 1.0 and not shares:
            times = f"{numbers.current:g} times that of its file"
            notes.append(f"the velocity of flow.{index} is {times}")
        flows.append(table)
    values: dict[str, Any] = {"flow": flows} if numbers.changed_names else {}
    arm = scenario.arm
    if numbers.stiffness != 1.0:
        values["arm.youngs_modulus"] = numbers.stiffness * arm.youngs_modulus
        for name in ("EA", "EI", "GJ"):
            if (given := getattr(arm.section, name)) is not None:
                values[f"arm.section.{name}"] = _scaled(numbers.stiffness, given)
    if numbers.gains != 1.0:
        for name, gains in scenario.control.gains.items():
            for key in ("kp", "ki", "kd"):
                values[f"control.pid.{name}.{key}"] = numbers.gains * getattr(gains, key)
    return (scenario.with_values(values) if values else scenario), notes


def _scaled(factor: float, value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [factor * each for each in value]
    return factor * value


PULL = {"ramp_time": 0.1, "lasts": 1.0}  # ramp time and duration of a pull at the tip (s)


class Pull(NamedTuple):
    """A force at the tip for a limited time."""

    force: tuple[float, ...]  # N
    start: float  # time at which it starts (s)

    @property
    def stop(self) -> float:
        """Time at which it ends (s)."""
        return self.start + PULL["lasts"]


NO_PULL = Pull((), 0.0)


def adjusted_parameters(
    parameters: Parameters, numbers: AdjustableNumbers, flows: Sequence[Flow], pull: Pull
) -> Parameters:
    """Return adjusted parameters, with flows of `adjusted_flows`; the last load is the pull."""
    arm, pid = parameters.arm, parameters.pid
    given = {name: getattr(arm.section, name) for name in ("EA", "EI", "GJ")}
    known = {name: value for name, value in given.items() if value is not None}
    stiff = {name: _times(numbers.stiffness, value) for name, value in known.items()}
    section = replace(arm.section, **stiff)
    modulus = _times(numbers.stiffness, arm.youngs_modulus)
    kp, ki, kd = (_times(numbers.gains, gain) for gain in (pid.kp, pid.ki, pid.kd))
    *others, load = parameters.load
    if pull.force:
        onset = Onset(*map(array, (pull.start, PULL["ramp_time"], pull.stop)))
        load = load | {"dead_force": array(pull.force), "onset": onset}
    arm = replace(arm, youngs_modulus=modulus, section=section)
    pid = replace(pid, kp=kp, ki=ki, kd=kd)
    return replace(parameters, arm=arm, pid=pid, flow=tuple(flows), load=(*others, load))


class LoopNumbers(NamedTuple):
    """Numbers of a loop that no key of a scenario describes."""

    parked: Bool[Array, ""]  # whether the debris is at rest: neither water nor weight moves it
    shift: Float[Array, " d"]  # shift of the target (m)
    switched_on: Float[Array, ""]  # time at which the controller was switched on (s)
    take_up: Float[Array, ""]  # time until a PID responds in full after that (s)


@compiled(**ONCE)
def with_numbers(
    loop: Loop, parameters: Parameters, loop_numbers: LoopNumbers, debris: bool
) -> Loop:
    """Return a loop with other numbers; with ``debris``, its last obstacle can be parked."""
    loop = with_parameters(loop, parameters)
    changed = loop_numbers.shift, loop_numbers.switched_on
    loop = eqx.tree_at(lambda x: (x.target.shift, x.switched_on), loop, changed)
    if isinstance(loop.controller, Pid):
        loop = eqx.tree_at(lambda x: x.controller.take_up, loop, loop_numbers.take_up)
    if debris:

        def held(values: Float[Array, "f ..."]) -> Float[Array, "f ..."]:
            return values.at[-1].set(jnp.where(loop_numbers.parked, 0.0, values[-1]))

        def moved_by(x: Any) -> list[Any]:
            body = x.system.forces.obstacles.bodies.body
            return [body.displaced, body.drag, body.weight, body.added_mass]

        loop = eqx.tree_at(moved_by, loop, [held(values) for values in moved_by(loop)])
    return loop


def _times(factor: float, number: Array) -> Array:
    return array(factor * np.asarray(number))


class ScaledFlow(Flow):
    """A flow multiplied by a factor and shifted in space."""

    onset: Onset
    flow: Flow
    factor: Float[Array, ""]
    shift: Float[Array, " d"]  # shift in space (m)

    @property
    def steady(self) -> bool:  # type: ignore[override]
        """Whether it is steady, its onset aside."""
        return self.flow.steady

    @property
    def drifts(self) -> bool:
        """Whether it is a pattern that drifts past."""
        return self.flow.drifts

    def displacement(self, time: Time) -> Float[Array, "..."]:
        """Return how far its uniform part has moved the water (m)."""
        return self.factor * self.flow.displacement(time)

    def fully_on(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s), its onset aside."""
        return self.factor * self.flow.fully_on(point - self.shift, time)

    def jet(self, point: Point, time: Time) -> Jet:
        """Return the velocity with its derivatives."""
        return self.flow.jet(point - self.shift, time).times(self.factor, jnp.zeros(()))


def adjusted_flows(
    described: Sequence[Flow],
    now: Sequence[Flow] | None,
    numbers: AdjustableNumbers,
    place: Float[np.ndarray, " d"],
    time: float,
) -> tuple[Flow, ...]:
    """Return the flows with adjusted numbers, without a jump from those of ``now`` at a place.

    Turbulence is the draw of a scenario with that mean, intensity and length scale. ``now`` are
    the flows until a time (s); None at the start. Patterns that drift continue from there without
    a jump at one place in the world (m), with another speed or other eddies.
    """
    flows = [_adjusted(flow, numbers, place) for flow in described]
    if now is None:
        return tuple(flows)
    instant = jnp.asarray(time)
    moved, moves = (
        np.asarray(sum((flow.displacement(instant) for flow in each), np.zeros(place.size)))
        for each in (now, flows)
    )
    for index, (before, after) in enumerate(zip(now, flows, strict=True)):
        if isinstance(before, Turbulence) and isinstance(after, Turbulence):
            phases = np.asarray(before.phases)
            angle = (place - moved) @ np.asarray(before.wave_vectors)
            angle -= (place - moves) @ np.asarray(after.wave_vectors)
            if angle.any():
                phases = np.mod(phases + angle / (2 * np.pi), 1.0)
            flows[index] = replace(after, phases=array(phases))
        elif isinstance(before, ScaledFlow) and isinstance(after, ScaledFlow) and after.drifts:
            others = moved - moves - before.displacement(instant) + after.displacement(instant)
            flows[index] = replace(after, shift=before.shift + others)
    return tuple(flows)


def _adjusted(flow: Flow, numbers: AdjustableNumbers, place: Float[np.ndarray, " d"]) -> Flow:
    """Return an adjusted flow with the phases of the scenario."""
    if not isinstance(flow, Turbulence):
        return ScaledFlow(flow.onset, flow, array(numbers.current), array(np.zeros(place.size)))
    mean, waves = numbers.current * flow.mean, flow.wave_vectors / numbers.length_scale
    amplitudes = numbers.intensity * flow.relative_amplitudes
    return replace(flow, mean=mean, wave_vectors=waves, relative_amplitudes=amplitudes)
