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
from crinoid.assembly.control_design import observer_model
from crinoid.assembly.observer import AugmentedModel, ReadingNoise, ReadingSchedule
from crinoid.assembly.observer_outputs import observer_outputs
from crinoid.assembly.plan import AssembledScenario
from crinoid.assembly.prepared import Prepared
from crinoid.control import Estimate, ObserverOutputs, pose_error
from crinoid.foundation.atomic_file import FilePath
from crinoid.foundation.axes import AXES
from crinoid.foundation.result_variables import quantity
from crinoid.inverse.actuator_motion import actuator_motion
from crinoid.inverse.readings import Readings, read_readings
from crinoid.numerics.kalman import Correction, stationary_covariance
from crinoid.recording.texts import listed
from crinoid.results.dataset import describe, described
from crinoid.scenario import ScenarioError, got, refusal
from crinoid.scenario.library import Source
from crinoid.simulation.setup import set_up

_SIGMAS = 2.0
"""Standard deviations within which innovations are counted."""
_TAIL = 0.025
"""Probability beyond each end of the interval of the mean square."""

Ticks = Float[np.ndarray, " tick"]
Values = Float[np.ndarray, "tick y"]


def estimate(scenario: Source, record: FilePath) -> xr.Dataset:
    """Estimate tip, shape and current from a log, by the observer of LQG control.

    Parameters
    ----------
    scenario
        The experiment: a scenario, the name of a built-in one, or a file. Its controller does not
        matter.
    record
        A table with a column ``time`` and readings, or the folder of a result.

    Returns
    -------
    xarray.Dataset
        Estimates with standard deviations, and innovations, in SI units. Its attributes have the
        consistency of the innovations.

    Raises
    ------
    ScenarioError
        If the scenario or the record is not valid.
    """
    return estimated(Prepared(scenario), Path(record))


def estimated(prepared: Prepared, path: Path) -> xr.Dataset:
    """Return the estimate of a prepared scenario from the record at a path."""
    plan = _plan(prepared)
    record = read_readings(path, plan.scenario, plan.sensors, plan.inputs)
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
    scenario = prepared.scenario
    inputs = (*scenario.base.channels.present, *scenario.thread_names)
    inputs = scenario.control.lqg.inputs or inputs
    model, parts = observer_model(plan, inputs, schedule)
    noise = ReadingNoise.of(plan, model, parts)
    pairs = zip(arrivals, noise.sizes, strict=True)
    measured = np.hstack([each.values(size) for each, size in pairs])
    numbers = actuator_motion(plan, record, time)[:, list(model.kept)] - model.at_rest
    changes = _less_values(plan, measured, arrivals[0].taken, noise)
    outputs = observer_outputs(plan, model, parts.outputs, np.zeros_like(parts.move))
    filtered = _filtered(parts, noise.variance, outputs, numbers, changes)
    found = _outputs(plan, outputs, filtered, numbers, time)
    data = _dataset(plan, scenario.arm.dimension, time, found, filtered, measured)
    notes = [*prepared.notes(), *record.notes]
    if record.commands is None and (still := [one for one in inputs if one not in record.states]):
        notes.append(f"no commands or states of {listed(still)}, which count as at rest")
    data.attrs = (
        describe(scenario) | {"status": "ok", "notes": "\n".join(notes)} | _consistency(filtered)
    )
    return data


def _plan(prepared: Prepared) -> AssembledScenario:
    """Return the plan of a scenario about the state in which its arm starts, without control."""
    values: dict[str, object] = {"control.kind": "none", "output.variables": None}
    if prepared.scenario.target.feed_forward:
        values["target.feed_forward"] = False
    still = prepared.with_scenario(prepared.scenario.with_values(values))
    setup = set_up(still, notes=False)
    if not setup.outcome.converged:
        text = got("equilibrium", 'be "rest" where the arm has no equilibrium')
        raise ScenarioError.of("simulation.start", text)
    return setup.plan


class _Arrival(NamedTuple):
    """Readings of a sensor at the calls of an observer."""

    readings: Readings | None
    newest: Int[np.ndarray, " tick"]
    """Row of the newest reading that is known at each call; -1 before the first one."""
    fresh: Bool[np.ndarray, " tick"]
    age: int
    """How old new readings are on average, in control periods."""

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
    plan: AssembledScenario, measured: Values, taken: Ticks, noise: ReadingNoise
) -> Values:
    """Return readings less those where the model is linear about, in the frame of the target."""
    target, size = plan.target, noise.sizes[0]
    assert target is not None
    begin = array(noise.values[:size])

    def change(pose: Array, time: Array) -> Array:
        return pose_error(target.to_frame(pose, time), begin)

    tip = jax.jit(jax.vmap(change))(array(measured[:, :size]), array(taken))
    return np.hstack([np.asarray(tip), measured[:, size:] - noise.values[size:]])


class _Filtered(NamedTuple):
    """Filtered states, their deviations, and innovations, of each call."""

    states: Float[np.ndarray, "tick z"]
    deviations: tuple[np.ndarray, np.ndarray, np.ndarray]
    """Standard deviations of tip and nodes, square root of the covariance of the current."""
    innovation: Values
    """New readings less those expected; nan without a new one."""
    innovation_std: Values
    squared: Ticks
    """Squares of the innovations, normalised by their covariance and summed up."""


def _filtered(
    parts: AugmentedModel,
    variance: Float[np.ndarray, " y"],
    outputs: ObserverOutputs,
    actuators: Float[np.ndarray, "tick s"],
    readings: Values,
) -> _Filtered:
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
        deviations.append(
            (
                outputs.tip.std_of(covariance),
                outputs.position.std_of(covariance),
                current.spread_of(covariance),
            )
        )
    tip, position, flow = (np.stack(each) for each in zip(*deviations, strict=True))
    return _Filtered(np.stack(states), (tip, position, flow), innovation, spread, squared)


def _outputs(
    plan: AssembledScenario,
    outputs: ObserverOutputs,
    filtered: _Filtered,
    actuators: Float[np.ndarray, "tick s"],
    time: Ticks,
) -> Estimate:
    """Return tip, shape and current at each call, in the world."""
    carrier = None if plan.target is None else plan.target.carrier

    def at(state: Array, numbers: Array, deviations: tuple[Array, ...], time: Array) -> Estimate:
        def fields(each: Any) -> tuple[Any, ...]:
            return each.tip.std, each.position.std, each.flow_velocity.spread

        found = eqx.tree_at(fields, outputs, deviations).of(state, numbers)
        return found if carrier is None else found.in_world(carrier, time)

    given = filtered.states, actuators, filtered.deviations, time
    return jax.jit(jax.vmap(at))(*jax.tree.map(array, given))


def _dataset(
    plan: AssembledScenario,
    axes: int,
    time: Ticks,
    found: Estimate,
    filtered: _Filtered,
    measured: Values,
) -> xr.Dataset:
    assert found.position is not None
    assert found.flow_velocity is not None
    tip = {"value": np.array(found.tip.value), "std": np.asarray(found.tip.std)}
    if axes == 2:
        tip["value"][:, 2] = np.unwrap(tip["value"][:, 2])
    variables: dict[str, Any] = {}
    for ending, part in (("", "value"), ("_std", "std")):
        pointing = ("angle", tip[part][:, 2]) if axes == 2 else ("direction", tip[part][:, 3:])
        for name, values in (
            ("tip_position", tip[part][:, :axes]),
            (f"tip_{pointing[0]}", pointing[1]),
            ("position", getattr(found.position, part)),
            ("flow_velocity", getattr(found.flow_velocity, part)),
        ):
            full = f"estimated_{name}{ending}"
            variables[full] = quantity(full, np.asarray(values), axes)
    by_reading = "time reading"
    variables |= described(
        [
            ("sensor_reading", by_reading, "", measured, "new readings; nan without one"),
            (
                "innovation",
                by_reading,
                "",
                filtered.innovation,
                "new readings less those expected; nan without a new one",
            ),
            (
                "innovation_std",
                by_reading,
                "",
                filtered.innovation_std,
                "standard deviation of innovation",
            ),
            (
                "normalised_innovation_squared",
                "time",
                "1",
                filtered.squared,
                "squares of the innovations over their covariance, summed over the new readings",
            ),
        ]
    )
    names = [
        (f"{sensor.name}.{name}", unit)
        for sensor in plan.sensors
        for name, unit in sensor.measurand.names(axes)
    ]
    lengths = np.concatenate([np.zeros(1), np.cumsum(plan.system.reference.rest_length)])
    along = "distance from the root along the arm at rest"
    coordinates = described(
        [
            ("time", "time", "s", time, "time"),
            ("axis", "axis", "", list(AXES[axes]), ""),
            ("arc_length", "node", "m", lengths, along),
            ("reading", "reading", "", [name for name, _ in names], "sensor and value"),
            ("reading_unit", "reading", "", [unit for _, unit in names], "unit of readings"),
        ]
    )
    return xr.Dataset(variables, coordinates)


def _consistency(filtered: _Filtered) -> dict[str, Any]:
    """Return how the innovations compare with their covariance (Bar-Shalom et al. 2001).

    The sum of their normalised squares follows a chi-squared law with as many degrees of freedom as
    readings, where the model is right.
    """
    from scipy.special import chdtri  # slow to load

    new = np.isfinite(filtered.innovation)
    count = int(new.sum())
    near = np.abs(filtered.innovation[new]) <= _SIGMAS * filtered.innovation_std[new]
    return {
        "readings_used": count,
        "mean_square": float(filtered.squared.sum() / count),
        "mean_square_low": float(chdtri(count, 1 - _TAIL) / count),
        "mean_square_high": float(chdtri(count, _TAIL) / count),
        "within_two_std": float(near.mean()),
    }
