"""An experiment that is run again with other numbers, and set beside what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from crinoid.assembly.parameters import Parameters
from crinoid.assembly.prepared import Prepared
from crinoid.control import Playback
from crinoid.dynamics import Reason
from crinoid.identification.motion import Motion, motion
from crinoid.identification.reach import stuck, within_reach
from crinoid.identification.record import Record
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.scenario.errors import shown
from crinoid.simulation import Loop, closed_loop
from crinoid.space import AXES, POSE

__all__ = ["Comparison", "Experiment", "given_values"]

_STEP = 1e-5
"""Change of the logarithm of a number by which its effect on the arrays of an arm is found."""

Vector = Float[np.ndarray, " parameter"]


class Comparison(NamedTuple):
    """A run beside the record, at the times of the record."""

    computed: Float[np.ndarray, "time quantity"]
    """Computed coordinates (m, rad, 1); not a number where the run failed."""
    left: Float[np.ndarray, "time quantity"]
    """Measured less computed ones; angles the short way round."""
    slope: Float[np.ndarray, "time quantity parameter"]
    """Derivatives of what is computed by the logarithms of the numbers."""


def given_values(scenario: Scenario, keys: Sequence[str]) -> Vector:
    """Return the numbers of a scenario that a search begins with."""
    mistakes = [
        Mistake("--of", f"got {key} twice, takes each number once")
        for key in dict.fromkeys(keys)
        if keys.count(key) > 1
    ]
    values = [_value(scenario.to_dict(), key) for key in keys]
    for key, value in zip(keys, values, strict=True):
        if key.startswith("simulation."):
            mistakes.append(Mistake(key, "is of the computation, takes a number of the experiment"))
        elif value is None:
            scenario.with_values({key: 1.0})  # says what is wrong with a key that there is not
            text = f"is not given, takes a number to begin with: --set {key}=NUMBER"
            mistakes.append(Mistake(key, text))
        elif isinstance(value, list):
            text = f"got {shown(value)}, takes the key of one number such as {key}.0"
            mistakes.append(Mistake(key, text))
        elif not isinstance(value, float):
            mistakes.append(Mistake(key, f"got {shown(value)}, takes a number with a unit"))
        elif value == 0:
            text = "got 0, takes another number to begin with: it tells sign and size"
            mistakes.append(Mistake(key, text))
    if mistakes:
        raise ScenarioError(mistakes)
    return np.array(values, float)


def _value(document: Any, key: str) -> Any:
    """Return what stands under a dotted key of a document; None if nothing does."""
    for part in key.split("."):
        if isinstance(document, dict):
            document = document.get(part)
        elif isinstance(document, list) and part.isdecimal() and int(part) < len(document):
            document = document[int(part)]
        else:
            return None
    return document


class Experiment:
    """The run in which a record was taken.

    Commands that were recorded are given again; where there are none, the controller of the
    scenario acts as it was designed for the numbers to begin with.

    Parameters
    ----------
    scenario
        Arm, water, motion of the base, and the numbers to begin with.
    keys
        Keys of the numbers that are changed; they keep their sign.
    record
        What was measured.
    """

    def __init__(self, scenario: Scenario, keys: tuple[str, ...], record: Record) -> None:
        self.given = given_values(scenario, keys)
        self.scenario, self.keys, self.record = scenario, keys, record
        step, axes = scenario.simulation.time_step, scenario.arm.dimension
        there = record.time <= scenario.simulation.duration * (1 + 1e-9)
        self.time, self.measured = record.time[there], record.values[there]
        if self.measured.size <= len(keys):
            text = (
                f"got {self.measured.size} numbers within the run, at times from "
                f"{record.time[0]:.6g} s on; must be more than {len(keys)} from 0 s, where it "
                f"starts, to {scenario.simulation.duration:.6g} s (simulation.duration)"
            )
            raise ScenarioError([Mistake("RECORD", text)])
        self.steps = max(1, int(np.ceil(self.time[-1] / step - 1e-9)))
        self._before = np.clip((self.time / step).astype(int), 0, self.steps - 1)
        self._part = (self.time / step - self._before)[:, None]
        self._columns = [POSE[axes].index(name) for name in record.names]
        self._turns = np.array([axes == 2 and name == "angle" for name in record.names])
        _, tangents = self._arrays(np.zeros(len(keys)))
        effect = np.sum([_sizes(each) for each in jax.tree.leaves(tangents)], axis=0)
        idle = [key for key, size in zip(keys, effect, strict=True) if size == 0]
        if idle:
            text = "does not change how the arm moves, takes a number of arm, water or actuators"
            raise ScenarioError([Mistake(key, text) for key in idle])
        self._loop = _loop(scenario, record)

    def with_values(self, logs: Vector) -> Scenario:
        """Return the scenario with other numbers, by their logarithms over those given."""
        with np.errstate(over="ignore"):  # a trial may go anywhere
            values = self.given * np.exp(logs)
        return self.scenario.with_values(dict(zip(self.keys, map(float, values), strict=True)))

    def motion(self, logs: Vector) -> Motion | None:
        """Run it with other numbers; none where the scenario does not take these."""
        try:
            parameters, tangents = self._arrays(logs)
        except ScenarioError:
            return None
        still = self.scenario.simulation.start == "equilibrium"
        found = motion(self._loop, parameters, tangents, self.steps, still=still)
        return jax.tree.map(np.asarray, found)

    def compared(self, found: Motion | None) -> Comparison:
        """Set a run beside the record."""
        if found is None:
            none = np.full((*self.measured.shape, len(self.keys) + 1), np.nan)
            return Comparison(none[..., 0], none[..., 0], none[..., 1:])
        computed = self._seen(found.path)[:, self._columns]
        left = self.measured - computed
        left[:, self._turns] = (left[:, self._turns] + np.pi) % (2 * np.pi) - np.pi
        slope = np.stack([self._seen(each)[:, self._columns] for each in found.slope], axis=-1)
        return Comparison(computed, left, slope)

    def reached(self, found: Motion) -> tuple[Bool[np.ndarray, " time"], list[str]]:
        """Return the rows within reach of the arm, and notes (`within_reach`)."""
        axes, seen = self.scenario.arm.dimension, self._seen(found.path)
        names = [name for name in self.record.names if name in AXES[axes]]
        if not names or self.scenario.vehicle is not None:  # which may drift elsewhere
            return np.ones(self.time.size, bool), []
        tip = np.array([AXES[axes].index(name) for name in names])
        root, length = seen[:, len(POSE[axes]) + tip], float(seen[:, -1].max())
        return within_reach(names, self.measured[:, : len(names)], root, seen[:, tip], length)

    def rests(self, computed: Float[np.ndarray, "time quantity"]) -> Bool[np.ndarray, " time"]:
        """Tell which rows are of a marker that is stuck, by a fit (`stuck`)."""
        names = [name for name in self.record.names if name in AXES[self.scenario.arm.dimension]]
        if not names:
            return np.zeros(self.time.size, bool)
        places = slice(len(names))
        return stuck(self.measured[:, places], computed[:, places], self.scenario.arm.length)

    def trouble(self, found: Motion | None) -> str:
        """Return why a run failed; empty if it did not."""
        if found is None:
            return "the scenario does not take these numbers"
        if not found.at_rest:
            return "no equilibrium to start from was found"
        if found.converged:
            return ""
        time = int(found.steps) * self.scenario.simulation.time_step
        return f"failed at t = {time:.6g} s: {Reason(int(found.reason)).words}"

    def _seen(self, path: Any) -> Float[np.ndarray, "time seen"]:
        """Return a path at the times of the record, along straight lines."""
        path = np.asarray(path)
        before, after = path[self._before], path[self._before + 1]
        return np.asarray(before + self._part * (after - before))

    def _arrays(self, logs: Vector) -> tuple[Parameters, Parameters]:
        """Return the arrays of an arm, and their derivatives by the logarithms of the numbers."""
        parameters = Prepared(self.with_values(logs)).parameters
        tangents = []
        for step in _STEP * np.eye(len(self.keys)):
            more, less = (
                eqx.filter(
                    Prepared(self.with_values(logs + way * step)).parameters, eqx.is_inexact_array
                )
                for way in (1, -1)
            )
            tangents.append(jax.tree.map(_slope, more, less))
        return parameters, jax.tree.map(lambda *each: jnp.stack(each), *tangents)


def _slope(more: Any, less: Any) -> Any:
    # of what is infinite, such as no limit, nothing changes
    return jnp.where(more == less, 0.0, (more - less) / (2 * _STEP))


def _sizes(tangent: Any) -> Vector:
    return np.abs(np.asarray(tangent)).reshape(tangent.shape[0], -1).sum(axis=1)


def _loop(scenario: Scenario, record: Record) -> Loop:
    if record.commands is None:
        loop, _ = closed_loop(scenario)
        return loop
    at_each_step = {"control.rate_hz": 1 / scenario.simulation.time_step, "control.start": 0.0}
    player = Playback(*map(jnp.asarray, record.commands))
    loop, _ = closed_loop(scenario.with_values(at_each_step), controller=player)
    return loop
