"""Simulation of a recorded experiment with other parameters, and its sensitivities."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from crinoid.assembly.parameters import Parameters
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.threads import ThreadParameters
from crinoid.control import Playback
from crinoid.dynamics import Reason
from crinoid.foundation.axes import AXES, POSE
from crinoid.inverse.experiment_record import ExperimentRecord, stuck, within_reach
from crinoid.inverse.marker import TIP, MarkerWeights
from crinoid.inverse.motion import ArmMotion, Numbers, follow, settle
from crinoid.inverse.unknowns import Unknowns, Vector
from crinoid.scenario import Scenario, ScenarioError, refusal
from crinoid.simulation import Loop, closed_loop

_STEP = 1e-5  # step of the logarithm of a parameter in the differences of an arm's arrays


class RecordComparison(NamedTuple):
    """Comparison of a run with the record, at the times of the record."""

    computed: Float[np.ndarray, "time quantity"]
    """Computed coordinates (m, rad, 1); not a number if the run failed."""
    residual: Float[np.ndarray, "time quantity"]
    """Measured minus computed coordinates; angles modulo a full turn."""
    sensitivity: Float[np.ndarray, "time quantity parameter"]
    """Derivatives of the computed coordinates by the logarithms of the parameters."""


class Experiment:
    """Simulation of a recorded experiment with other parameters.

    Recorded commands are played back. Without any, the controller of the scenario acts, as designed
    for the initial parameters. A hold is the equilibrium at t = 0 under its shares. The scenario
    has the initial parameters, which keep their sign, and the values of the experiment.
    """

    def __init__(self, scenario: Scenario, unknowns: Unknowns, record: ExperimentRecord) -> None:
        self.scenario, self.unknowns = scenario, unknowns
        step, axes = scenario.simulation.time_step, scenario.arm.dimension
        within = record.time <= scenario.simulation.duration * (1 + 1e-9)
        self.late = int((~within).sum())  # rows after the end of the run, which are left out
        self.record = record.rows(within)  # the rows within the run
        self.time, self.measured = self.record.time, self.record.values
        if self.record.holds is None:
            if not within.any():
                text = f"got no row within the run, at times from {record.time[0]:.6g} s on"
                until = f"{scenario.simulation.duration:.6g} s (simulation.duration)"
                raise refusal("RECORD", text, f"have rows from 0 s, where it starts, to {until}")
            self.steps = max(1, int(np.ceil(self.time[-1] / step - 1e-9)))
            self._before = np.clip((self.time / step).astype(int), 0, self.steps - 1)
            self._part = (self.time / step - self._before)[:, None]
        else:
            self._before, self._part = self.record.holds.of_row, np.zeros((self.time.size, 1))
        self._axes = [name for name in record.names if name in AXES[axes]]
        self._columns = [POSE[axes].index(name) for name in record.names]
        self._angles = np.array([axes == 2 and name == "angle" for name in record.names])
        count = len(unknowns.keys)
        (parameters, _), tangents = self._arrays(np.zeros(count))
        leaves = jax.tree.leaves(tangents)
        self.effects = np.sum([np.abs(leaf).reshape(count, -1).sum(1) for leaf in leaves], 0)
        """Whether each parameter affects the experiment: above 0 if so."""
        if self.record.holds is None:
            self._loop = _loop(scenario, self.record)
        else:
            self._check_shares(parameters)

    def motion(self, logs: Vector) -> ArmMotion | None:
        """Run with other parameters; None if they are outside of the scenario's ranges."""
        try:
            numbers, tangents = self._arrays(logs)
        except ScenarioError:
            return None
        if self.record.holds is not None:
            return settle(numbers, tangents, self.record.holds)
        equilibrium = self.scenario.simulation.start == "equilibrium"
        return follow(self._loop, numbers, tangents, self.steps, equilibrium=equilibrium)

    def compare(self, found: ArmMotion | None) -> RecordComparison:
        """Compare a run with the record."""
        if found is None:
            none = np.full((*self.measured.shape, len(self.unknowns.keys) + 1), np.nan)
            return RecordComparison(none[..., 0], none[..., 0], none[..., 1:])
        computed = self._sample(found.places.marker)
        residual = self.measured - computed
        residual[:, self._angles] = (residual[:, self._angles] + np.pi) % (2 * np.pi) - np.pi
        slopes = [self._sample(each) for each in found.sensitivity]
        return RecordComparison(computed, residual, np.stack(slopes, axis=-1))

    @property
    def tracks(self) -> list[Int[np.ndarray, " row"]]:
        """Rows of each marker, in the order of time."""
        marker = self.record.marker
        return [np.flatnonzero(marker == each) for each in np.unique(marker)]

    @property
    def quantities(self) -> list[str]:
        """Name of each measured coordinate, after that of the experiment."""
        name = self.record.name
        return [f"{name}.{each}" if name else each for each in self.record.names]

    @property
    def holds(self) -> list[str]:
        """Name of the hold of each row, empty of a motion."""
        holds = self.record.holds
        if holds is None:
            return [""] * self.time.size
        return [holds.names[each] for each in holds.of_row]

    @property
    def labels(self) -> list[str]:
        """Name of the marker of each row."""
        names = (TIP, *(marker.name for marker in self.record.markers))
        return [names[each] for each in self.record.marker]

    @property
    def _of_record(self) -> str:
        return f" of {self.record.name}" if self.record.name else ""

    def within_reach(self, found: ArmMotion) -> tuple[Bool[np.ndarray, " time"], list[str]]:
        """Return the rows within reach of the arm, and notes."""
        axes, names = self.scenario.arm.dimension, self._axes
        if not names or self.scenario.floats:  # a vehicle may drift
            return np.ones(self.time.size, bool), []
        columns = np.array([AXES[axes].index(name) for name in names])
        measured, computed = self.measured[:, : len(names)], self._sample(found.places.marker)
        root = np.asarray(found.places.root)[self._before][:, columns]
        length = float(found.places.length.max())
        subject = f"the {'markers' if self.record.marker.any() else 'tip'}{self._of_record}"
        return within_reach(subject, names, measured, root, computed[:, : len(names)], length)

    def stuck(self, computed: Float[np.ndarray, "time quantity"]) -> Bool[np.ndarray, " time"]:
        """Return the rows of a marker that is stuck, from a fit."""
        found = np.zeros(self.time.size, bool)
        if not self._axes:
            return found
        places = slice(len(self._axes))
        for rows in self.tracks:
            pair = self.measured[rows, places], computed[rows, places]
            found[rows] = stuck(*pair, self.scenario.arm.length)
        return found

    def failure(self, found: ArmMotion | None) -> str:
        """Return why a run failed; empty if it did not."""
        where = self._of_record
        if found is None:
            return f"the parameters{where} are outside of the scenario's ranges"
        if self.record.holds is not None and not found.at_rest:
            hold = self.record.holds.names[int(found.steps) - 1]
            return f"no equilibrium was found for hold {hold}{where}"
        if not found.at_rest:
            return f"no initial equilibrium{where} was found"
        if found.converged:
            return ""
        time = int(found.steps) * self.scenario.simulation.time_step
        return f"failed{where} at t = {time:.6g} s: {Reason(int(found.reason)).words}"

    def _sample(self, path: Any) -> Float[np.ndarray, "time quantity"]:
        """Return the coordinates in each row from those of all markers at all instants."""
        after = np.minimum(self._before + 1, len(path) - 1)
        ends = (np.asarray(path)[at, self.record.marker] for at in (self._before, after))
        before, behind = (end[:, self._columns] for end in ends)
        return np.asarray(before + self._part * (behind - before))

    def _arrays(self, logs: Vector) -> tuple[Numbers, Numbers]:
        """Return the arrays of the arm, and their derivatives by the parameters' logarithms."""

        def numbers(logs: Vector) -> Numbers:
            scenario = self.scenario.with_values(self.unknowns.values(logs))
            weights = MarkerWeights.of(self.record.markers, scenario)
            return Prepared(scenario).parameters, weights

        tangents = []
        for step in _STEP * np.eye(len(self.unknowns.keys)):
            ends = (eqx.filter(numbers(logs + s * step), eqx.is_inexact_array) for s in (1, -1))
            tangents.append(jax.tree.map(_difference, *ends))
        return numbers(logs), jax.tree.map(lambda *each: jnp.stack(each), *tangents)

    def _check_shares(self, parameters: Parameters) -> None:
        """Refuse a hold with a share outside of the limits of its chamber or tendon."""
        holds = self.record.holds
        assert holds is not None
        for hold, shares in zip(holds.names, holds.shares, strict=True):
            for thread, share in zip(holds.threads, shares, strict=True):
                threads = parameters.actuator[0]
                assert isinstance(threads, ThreadParameters)
                lower = float(threads.lower[thread])
                if not lower <= share <= 1:
                    text = f"{threads.names[thread]} is {share:.6g} of the largest in hold {hold}"
                    raise refusal("RECORD", text, f"be {lower:g} to 1")


def _difference(plus: Any, minus: Any) -> Any:
    # an absent limit is infinite, and constant
    return jnp.where(plus == minus, 0.0, (plus - minus) / (2 * _STEP))


def _loop(scenario: Scenario, record: ExperimentRecord) -> Loop:
    if record.commands is None:
        return closed_loop(scenario)[0]
    at_each_step = {"control.rate_hz": 1 / scenario.simulation.time_step, "control.start": 0.0}
    player = Playback(*map(jnp.asarray, record.commands))
    return closed_loop(scenario.with_values(at_each_step), controller=player)[0]
