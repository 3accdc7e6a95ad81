"""Simulation of a recorded experiment with other parameters, and its sensitivities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.assembly.parameters import Parameters
from crinoid.assembly.prepared import Prepared
from crinoid.compilation import ONCE, SOMETIMES, compiled
from crinoid.control import Playback
from crinoid.dynamics import Outcome, Reason, State, System
from crinoid.foundation.axes import AXES, POSE
from crinoid.inverse.recorded_motion import RecordedMotion, stuck, within_reach
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.scenario.document import value_at
from crinoid.scenario.errors import got
from crinoid.simulation import Loop, closed_loop, rollout, with_parameters

_STEP = 1e-5
"""Step of the logarithm of a parameter in the differences of an arm's arrays."""

Vector = Float[np.ndarray, " parameter"]


class TipMotion(NamedTuple):
    """Motion of the tip in a run, with its sensitivities."""

    path: Float[Array, "instant output"]
    """Pose of the tip, place of the root (m) and length (m) at the ends of the time steps."""
    sensitivity: Float[Array, "parameter instant output"]
    """Derivatives of the path by the parameters."""
    at_rest: Bool[Array, ""]
    """Whether an initial state was found."""
    converged: Bool[Array, ""]
    reason: Int[Array, ""]
    """Why the first time step that did not converge failed (`crinoid.dynamics.Reason`)."""
    steps: Int[Array, ""]
    """Number of time steps that succeeded."""


@compiled(**ONCE)
def _start(
    loop: Loop, parameters: Parameters, tangents: Parameters, *, equilibrium: bool
) -> tuple[State, State, Outcome]:
    """Return the initial state, its derivatives by the parameters, and the solver's outcome.

    The arm starts in equilibrium, or at rest without loads. ``tangents`` are the derivatives of the
    arrays, with the parameters as first axis, and None for constant leaves.
    """
    numbers, others = eqx.partition(parameters, eqx.is_inexact_array)

    def start(numbers: Parameters) -> tuple[State, tuple[State, Outcome]]:
        system = with_parameters(loop, eqx.combine(numbers, others)).system
        state, found = (
            system.find_equilibrium()
            if equilibrium
            else (system.rest(), Outcome.of_nothing(converged=True))
        )
        values, rest = eqx.partition(state, eqx.is_inexact_array)
        return values, (rest, found)

    def along(tangent: Parameters) -> tuple[State, State, tuple[State, Outcome]]:
        return jax.jvp(start, (numbers,), (tangent,), has_aux=True)

    values, slope, (rest, found) = jax.vmap(along, out_axes=(None, 0, None))(tangents)
    return eqx.combine(values, rest), slope, found


@compiled(**SOMETIMES)
def _follow(
    loop: Loop,
    parameters: Parameters,
    tangents: Parameters,
    state: State,
    state_tangents: State,
    at_rest: Bool[Array, ""],
    steps: int,
) -> TipMotion:
    """Return the motion from an initial state."""
    both, others = eqx.partition((parameters, state), eqx.is_inexact_array)

    def run(both: tuple[Parameters, State]) -> tuple[Array, tuple[Outcome, Array]]:
        numbers, start = eqx.combine(both, others)
        changed = with_parameters(loop, numbers)
        system = changed.system
        done = rollout(changed, start, steps, observe=lambda _, now: _output(system, now.state))
        path = jnp.concatenate([_output(system, start)[None], done.kept])
        return path, (done.outcome, done.end.steps)

    def along(tangent: tuple[Parameters, State]) -> tuple[Array, Array, tuple[Outcome, Array]]:
        return jax.jvp(run, (both,), (tangent,), has_aux=True)

    # the primal motion is computed once for all directions
    out = (None, 0, None)
    path, slope, (outcome, count) = jax.vmap(along, out_axes=out)((tangents, state_tangents))
    return TipMotion(path, slope, at_rest, outcome.converged, outcome.reason, count)


def _output(system: System, state: State) -> Float[Array, " output"]:
    nodes = state.position[1:]  # the first node is behind the root
    length = jnp.linalg.norm(jnp.diff(nodes, axis=0), axis=1).sum()
    return jnp.concatenate([system.tip(state), system.forces.origin + nodes[0], length[None]])


class RecordComparison(NamedTuple):
    """Comparison of a run with the record, at the times of the record."""

    computed: Float[np.ndarray, "time quantity"]
    """Computed coordinates (m, rad, 1); not a number if the run failed."""
    residual: Float[np.ndarray, "time quantity"]
    """Measured minus computed coordinates; angles modulo a full turn."""
    sensitivity: Float[np.ndarray, "time quantity parameter"]
    """Derivatives of the computed coordinates by the logarithms of the parameters."""


def given_values(scenario: Scenario, keys: Sequence[str]) -> Vector:
    """Return the initial parameters of an identification."""
    mistakes = [
        Mistake("--of", f"got {key} twice; must name each parameter once")
        for key in dict.fromkeys(keys)
        if keys.count(key) > 1
    ]
    values = [value_at(scenario.to_dict(), key) for key in keys]
    for key, value in zip(keys, values, strict=True):
        if key.startswith("simulation."):
            text = "is a setting of the computation. Name a parameter of the experiment."
            mistakes.append(Mistake(key, text))
        elif value is None:
            scenario.with_values({key: 1.0})  # raises if the key does not exist
            text = f"has no initial value. Set one: --set {key}=NUMBER"
            mistakes.append(Mistake(key, text))
        elif isinstance(value, list):
            text = got(value, "be a single number", f"Name one of them, such as {key}.0.")
            mistakes.append(Mistake(key, text))
        elif not isinstance(value, float):
            mistakes.append(Mistake(key, got(value, "be a real number")))
        elif value == 0:
            text = got(0, "be another number to start from", "It sets the sign and the scale.")
            mistakes.append(Mistake(key, text))
    if mistakes:
        raise ScenarioError(mistakes)
    return np.array(values, float)


class Experiment:
    """Simulation of the recorded experiment with other parameters.

    Recorded commands are played back. Without any, the controller of the scenario acts, as designed
    for the initial parameters. The scenario has the initial parameters, which keep their sign.
    """

    def __init__(self, scenario: Scenario, keys: tuple[str, ...], record: RecordedMotion) -> None:
        self.initial = given_values(scenario, keys)
        self.scenario, self.keys, self.record = scenario, keys, record
        step, axes = scenario.simulation.time_step, scenario.arm.dimension
        within = record.time <= scenario.simulation.duration * (1 + 1e-9)
        self.time, self.measured = record.time[within], record.values[within]
        if self.measured.size <= len(keys):
            text = (
                f"got {self.measured.size} numbers within the run, at times from "
                f"{record.time[0]:.6g} s on; must be more than {len(keys)} from 0 s, where it "
                f"starts, to {scenario.simulation.duration:.6g} s (simulation.duration)"
            )
            raise ScenarioError.of("RECORD", text)
        self.steps = max(1, int(np.ceil(self.time[-1] / step - 1e-9)))
        self._before = np.clip((self.time / step).astype(int), 0, self.steps - 1)
        self._part = (self.time / step - self._before)[:, None]
        self._axes = [name for name in record.names if name in AXES[axes]]
        self._columns = [POSE[axes].index(name) for name in record.names]
        self._angles = np.array([axes == 2 and name == "angle" for name in record.names])
        _, tangents = self._arrays(np.zeros(len(keys)))
        leaves = [np.abs(np.asarray(each)) for each in jax.tree.leaves(tangents)]
        effect = np.sum([leaf.reshape(len(keys), -1).sum(axis=1) for leaf in leaves], axis=0)
        idle = [key for key, size in zip(keys, effect, strict=True) if size == 0]
        if idle:
            text = "does not affect the motion. Name a parameter of arm, water or actuators."
            raise ScenarioError([Mistake(key, text) for key in idle])
        self._loop = _loop(scenario, record)

    def with_values(self, logs: Vector) -> Scenario:
        """Return the scenario for the logarithms of the parameters, over their initial values."""
        with np.errstate(over="ignore"):  # a trial may be far off
            values = self.initial * np.exp(logs)
        return self.scenario.with_values(dict(zip(self.keys, map(float, values), strict=True)))

    def motion(self, logs: Vector) -> TipMotion | None:
        """Run with other parameters; None if they are outside of the scenario's ranges."""
        try:
            parameters, tangents = self._arrays(logs)
        except ScenarioError:
            return None
        loop, equilibrium = self._loop, self.scenario.simulation.start == "equilibrium"
        state, slope, found = _start(loop, parameters, tangents, equilibrium=equilibrium)
        run = _follow(loop, parameters, tangents, state, slope, found.converged, self.steps)
        return jax.tree.map(np.asarray, run)

    def compare(self, found: TipMotion | None) -> RecordComparison:
        """Compare a run with the record."""
        if found is None:
            none = np.full((*self.measured.shape, len(self.keys) + 1), np.nan)
            return RecordComparison(none[..., 0], none[..., 0], none[..., 1:])
        computed = self._sample(found.path)[:, self._columns]
        residual = self.measured - computed
        residual[:, self._angles] = (residual[:, self._angles] + np.pi) % (2 * np.pi) - np.pi
        slopes = [self._sample(each)[:, self._columns] for each in found.sensitivity]
        return RecordComparison(computed, residual, np.stack(slopes, axis=-1))

    def within_reach(self, found: TipMotion) -> tuple[Bool[np.ndarray, " time"], list[str]]:
        """Return the rows within reach of the arm, and notes."""
        axes, path = self.scenario.arm.dimension, self._sample(found.path)
        names = self._axes
        if not names or self.scenario.vehicle is not None:  # a vehicle may drift
            return np.ones(self.time.size, bool), []
        tip = np.array([AXES[axes].index(name) for name in names])
        root, length = path[:, len(POSE[axes]) + tip], float(path[:, -1].max())
        return within_reach(names, self.measured[:, : len(names)], root, path[:, tip], length)

    def stuck(self, computed: Float[np.ndarray, "time quantity"]) -> Bool[np.ndarray, " time"]:
        """Return the rows of a marker that is stuck, from a fit."""
        if not self._axes:
            return np.zeros(self.time.size, bool)
        places = slice(len(self._axes))
        return stuck(self.measured[:, places], computed[:, places], self.scenario.arm.length)

    def failure(self, found: TipMotion | None) -> str:
        """Return why a run failed; empty if it did not."""
        if found is None:
            return "the parameters are outside of the scenario's ranges"
        if not found.at_rest:
            return "no initial equilibrium was found"
        if found.converged:
            return ""
        time = int(found.steps) * self.scenario.simulation.time_step
        return f"failed at t = {time:.6g} s: {Reason(int(found.reason)).words}"

    def _sample(self, path: Any) -> Float[np.ndarray, "time output"]:
        """Return a path at the times of the record, by linear interpolation."""
        path = np.asarray(path)
        before, after = path[self._before], path[self._before + 1]
        return np.asarray(before + self._part * (after - before))

    def _arrays(self, logs: Vector) -> tuple[Parameters, Parameters]:
        """Return the arrays of the arm, and their derivatives by the parameters' logarithms."""
        parameters = Prepared(self.with_values(logs)).parameters
        tangents = []
        for step in _STEP * np.eye(len(self.keys)):
            ends = (Prepared(self.with_values(logs + s * step)).parameters for s in (1, -1))
            plus, minus = (eqx.filter(each, eqx.is_inexact_array) for each in ends)
            tangents.append(jax.tree.map(_difference, plus, minus))
        return parameters, jax.tree.map(lambda *each: jnp.stack(each), *tangents)


def _difference(plus: Any, minus: Any) -> Any:
    # an absent limit is infinite, and constant
    return jnp.where(plus == minus, 0.0, (plus - minus) / (2 * _STEP))


def _loop(scenario: Scenario, record: RecordedMotion) -> Loop:
    if record.commands is None:
        return closed_loop(scenario)[0]
    at_each_step = {"control.rate_hz": 1 / scenario.simulation.time_step, "control.start": 0.0}
    player = Playback(*map(jnp.asarray, record.commands))
    return closed_loop(scenario.with_values(at_each_step), controller=player)[0]
