"""Estimation of tip, shape and current from a log: the Kalman filter of LQG control."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
import xarray as xr
from jaxtyping import Array, Bool, Float, Int

from crinoid.assembly.arrays import array
from crinoid.assembly.control_design import inputs_of, observer_model
from crinoid.assembly.observer import AugmentedModel, ReadingSchedule, reading_noise
from crinoid.assembly.observer_outputs import observer_outputs
from crinoid.assembly.plan import AssembledScenario
from crinoid.assembly.prepared import Prepared, require_one_case
from crinoid.control import Estimate, ObserverOutputs, pose_error
from crinoid.foundation.atomic_file import FilePath
from crinoid.inverse.actuator_motion import actuator_motion
from crinoid.inverse.estimate_dataset import Filtered, Ticks, Values, consistency, estimate_dataset
from crinoid.inverse.readings import ReadingRecord, Readings, read_readings
from crinoid.numerics.kalman import Correction, stationary_covariance
from crinoid.recording.texts import listed
from crinoid.results.dataset import describe
from crinoid.scenario import got, refusal
from crinoid.scenario.library import Source
from crinoid.simulation.setup import set_up


def estimate(scenario: Source, record: FilePath) -> xr.Dataset:
    """Estimate tip, shape and current from a log, by the observer of LQG control.

    Parameters
    ----------
    scenario : Scenario, str or path
        The experiment: a scenario, the name of a built-in one, or a file. Its controller does not
        matter.
    record : str or path
        A table with a column ``time`` and readings, a log of ROS, or the folder of a result.

    Returns
    -------
    xarray.Dataset
        Estimates with standard deviations, and innovations, in SI units. Its attributes have the
        consistency of the innovations.

    Raises
    ------
    ScenarioError
        If the scenario or the record is not valid.
    ValueError
        If the scenario describes several cases.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "simulation.duration=0.2"])
    >>> files = crinoid.simulate(scenario).save("results/still-water")
    >>> found = crinoid.estimate(scenario, "results/still-water")
    >>> found.estimated_tip_position[-1].round(2).values.tolist()  # x, z (m)
    [0.46, -9.83]
    """
    return estimated(Prepared(scenario), Path(record))


def estimated(prepared: Prepared, path: Path) -> xr.Dataset:
    """Return the estimate of a prepared scenario from the record at a path."""
    require_one_case(prepared.scenario)
    scenario = prepared.scenario
    inputs = inputs_of(scenario, scenario.control.lqg, "lqg")
    plan = _plan(prepared)
    record = read_readings(path, plan.scenario, plan.sensors, plan.inputs)
    _require_whole(plan, record.readings[0])
    begin, end = record.ends
    if end - begin < 2 * plan.period * (1 - 1e-9):
        must = f"last at least two control periods, {2 * plan.period:.6g} s"
        raise refusal("RECORD", f"got readings over {end - begin:.6g} s", must)
    # the tip's sensor comes first; others without readings have none under way
    used = [index for index, each in enumerate(record.readings) if each is not None or not index]
    plan = replace(plan, sensors=tuple(plan.sensors[index] for index in used))
    time = begin + plan.period * np.arange(int((end - begin) / plan.period + 1e-6) + 1)
    arrivals = [
        _Arrival.of(record.readings[index], time, float(sensor.delay), plan.period)
        for index, sensor in zip(used, plan.sensors, strict=True)
    ]
    schedule = ReadingSchedule(
        np.stack([each.fresh for each in arrivals], axis=1), tuple(each.age for each in arrivals)
    )
    if not schedule.fresh.any():
        raise refusal("RECORD", "got readings that arrive after its end", "last longer")
    model, parts = observer_model(plan, inputs, schedule)
    variance, values = reading_noise(plan, model, parts)
    pairs = zip(arrivals, plan.sensors, strict=True)
    measured = np.hstack([each.values(sensor.noise.shape[0]) for each, sensor in pairs])
    numbers = actuator_motion(plan, record, time)[:, list(model.kept)] - model.at_rest
    changes = _less_values(plan, measured, arrivals[0].taken, values)
    outputs = observer_outputs(plan, model, parts.outputs, np.zeros_like(parts.move))
    filtered = _filtered(parts, variance, outputs, numbers, changes)
    found = _outputs(plan, outputs, filtered, numbers, time)
    data = estimate_dataset(plan, time, found, filtered, measured)
    notes = [*prepared.notes(), *record.notes, *_notes_on_inputs(plan, record, inputs)]
    about = {"status": "ok", "notes": "\n".join(notes)}
    data.attrs = describe(scenario) | about | consistency(filtered)
    return data


def _notes_on_inputs(
    plan: AssembledScenario, record: ReadingRecord, inputs: tuple[str, ...]
) -> list[str]:
    """Return notes on inputs that the record lacks, and on those that the observer lacks."""
    notes, known = [], {*record.commanded, *record.states}
    if still := [name for name in inputs if name not in known]:
        notes.append(f"no commands or states of {listed(still)}, which count as at rest")
    moved = {*record.states}
    if record.commands is not None:
        every = [each.name for each in plan.inputs]
        moved |= {every[k] for k in np.flatnonzero(record.commands.values.any(axis=0))}
    if left := sorted(moved - {*inputs}):
        text = f"commands and states of {listed(left)} are left out: control.lqg.inputs has"
        notes.append(f"{text} {listed([*inputs])}")
    return notes


def _require_whole(plan: AssembledScenario, tip: Readings | None) -> None:
    """Refuse vectors with missing coordinates where the frame of the target turns them."""
    if tip is None or plan.target.carrier is None:
        return
    axes = plan.scenario.arm.dimension
    for vectors in (tip.values[:, :axes], tip.values[:, axes:]):
        there = np.isfinite(vectors)
        if (there.any(axis=1) & ~there.all(axis=1)).any():
            text = "got readings of the tip with some of its coordinates only"
            must = 'have all of them with target.frame = "base"'
            raise refusal("RECORD", text, must, 'Or set target.frame to "world".')


def _plan(prepared: Prepared) -> AssembledScenario:
    """Return the plan of a scenario about the state in which its arm starts, without control."""
    still = prepared.scenario.with_values(
        prepared.scenario.idle_values | {"output.variables": None}
    )
    setup = set_up(prepared.with_scenario(still), notes=False)
    if not setup.outcome.converged:
        text = got("equilibrium", 'be "rest" where the arm has no equilibrium')
        raise refusal("simulation.start", text)
    return setup.plan


class _Arrival(NamedTuple):
    """Readings of a sensor at the calls of an observer."""

    readings: Readings | None
    newest: Int[np.ndarray, " tick"]
    """Row of the newest reading that is known at each call; -1 before the first one."""
    fresh: Bool[np.ndarray, " tick"]
    age: int  # how old new readings are on average, in control periods

    @staticmethod
    def of(readings: Readings | None, time: Ticks, delay: float, period: float) -> _Arrival:
        """Find the readings that are known at some times (s)."""
        if readings is None:
            return _Arrival(None, np.full(time.size, -1), np.zeros(time.size, bool), 0)
        known = time - delay + 1e-6 * period
        newest = np.searchsorted(readings.time, known, side="right") - 1
        fresh = np.diff(newest, prepend=-1) > 0
        age = time[fresh] - readings.time[newest[fresh]]
        usual = float(age.mean()) if age.size else 0.0
        return _Arrival(readings, newest, fresh, round(usual / period))

    @property
    def taken(self) -> Ticks:
        """Time at which the newest reading was measured (s); 0 without one."""
        none = np.zeros(self.newest.size)
        return none if self.readings is None else self.readings.time[np.maximum(self.newest, 0)]

    def values(self, size: int) -> Values:
        """Return the new readings at each call; nan without one."""
        found = np.full((self.newest.size, size), np.nan)
        if self.readings is not None:
            found[self.fresh] = self.readings.values[self.newest[self.fresh]]
        return found


def _less_values(
    plan: AssembledScenario, measured: Values, taken: Ticks, values: Float[np.ndarray, " y"]
) -> Values:
    """Return readings less those where the model is linear about, in the frame of the target."""
    target, size = plan.target, plan.sensors[0].noise.shape[0]
    begin = array(values[:size])

    def change(pose: Array, time: Array) -> Array:
        return pose_error(target.to_frame(pose, time), begin)

    tip = jax.jit(jax.vmap(change))(array(measured[:, :size]), array(taken))
    return np.hstack([np.asarray(tip), measured[:, size:] - values[size:]])


def _filtered(
    parts: AugmentedModel,
    variance: Float[np.ndarray, " y"],
    outputs: ObserverOutputs,
    actuators: Float[np.ndarray, "tick s"],
    readings: Values,
) -> Filtered:
    """Run the filter from an arm that the current moves; a missing reading changes nothing."""
    covariance = stationary_covariance(parts.move, parts.noise)
    state = np.zeros(covariance.shape[0])
    innovation, spread = np.full_like(readings, np.nan), np.full_like(readings, np.nan)
    squared, states, deviations = np.zeros(len(readings)), [], []
    current = outputs.flow_velocity
    assert current is not None
    for tick, (numbers, read) in enumerate(zip(actuators, readings, strict=True)):
        if tick:
            before = actuators[tick - 1]
            state = parts.move @ state + parts.held @ before + parts.driven @ numbers
            covariance = parts.move @ covariance @ parts.move.T + parts.noise
        new = np.isfinite(read)
        if new.any():
            step = Correction.of(covariance, parts.expect[new], variance[new])
            surprise = (read - parts.expect @ state - parts.follow @ numbers)[new]
            state, covariance = state + step.gain @ surprise, step.covariance
            innovation[tick, new], spread[tick, new] = surprise, np.sqrt(np.diag(step.innovation))
            squared[tick] = surprise @ np.linalg.solve(step.innovation, surprise)
        states.append(state)
        spans = (each.std_of(covariance) for each in (outputs.tip, outputs.position))
        deviations.append((*spans, current.spread_of(covariance)))
    tip, position, flow = (np.stack(each) for each in zip(*deviations, strict=True))
    return Filtered(np.stack(states), (tip, position, flow), innovation, spread, squared)


def _outputs(
    plan: AssembledScenario,
    outputs: ObserverOutputs,
    filtered: Filtered,
    actuators: Float[np.ndarray, "tick s"],
    time: Ticks,
) -> Estimate:
    """Return tip, shape and current at each call, in the world."""
    carrier = plan.target.carrier

    def at(state: Array, numbers: Array, deviations: tuple[Array, ...], time: Array) -> Estimate:
        def fields(each: Any) -> tuple[Any, ...]:
            return each.tip.std, each.position.std, each.flow_velocity.spread

        found = eqx.tree_at(fields, outputs, deviations).of(state, numbers)
        return found if carrier is None else found.in_world(carrier, time)

    given = filtered.states, actuators, filtered.deviations, time
    return jax.jit(jax.vmap(at))(*jax.tree.map(array, given))
