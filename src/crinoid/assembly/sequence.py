"""Sequence of phases from its tables."""

import jax
import numpy as np

from crinoid.assembly.arrays import array
from crinoid.assembly.plan import AssembledScenario
from crinoid.control import Sequence
from crinoid.scenario import Mistake, ScenarioError, got, one_of
from crinoid.scenario.sensor import ContactSensor

_ROUND_OFF = 1e-9  # excess over a limit from turning degrees into radians (degrees)


def build_sequence(plan: AssembledScenario) -> Sequence:
    """Return the controller of a scenario with phases.

    Raises
    ------
    ScenarioError
        If a phase names an input or a sensor that does not exist, or a value out of range.
    """
    scenario, mistakes = plan.scenario, list[Mistake]()
    phases = scenario.control.sequence
    # a turn is in degrees, and its key says so
    turns = [each.unit == "rad" for each in plan.inputs]
    scale = np.where(turns, np.pi / 180, 1.0)
    inputs = [each.name + "_deg" * turn for each, turn in zip(plan.inputs, turns, strict=True)]
    low, high = plan.limits / scale
    moving = [name for name, least, most in zip(inputs, low, high, strict=True) if least < most]
    sensors = [each.called for each in scenario.sensors if isinstance(each, ContactSensor)]

    value = np.full((len(phases), len(inputs)), np.nan)
    force = np.zeros((len(phases), len(sensors)))
    for row, phase in enumerate(phases):
        for key, given, names in (
            ("inputs", phase.inputs, moving),
            ("until", phase.until, sensors),
        ):
            for name, number in given.items():
                place, must = f"control.sequence.{row}.{key}.{name}", ""
                if name not in names:
                    must = f"be of {one_of(names)}" if names else "be left out: there is none"
                elif key == "until":
                    force[row, sensors.index(name)] = number
                else:
                    at = inputs.index(name)
                    value[row, at] = number
                    if not low[at] - _ROUND_OFF <= number <= high[at] + _ROUND_OFF:
                        must = f"be from {low[at]:.6g} to {high[at]:.6g}, the range of this input"
                if must:
                    mistakes.append(Mistake(place, got(number, must)))
    if mistakes:
        raise ScenarioError(mistakes)
    # after the last phase, in which a touch may have stopped them, inputs keep their commands
    value = np.pad(value, ((0, 1), (0, 0)), constant_values=np.nan)
    force = np.pad(force, ((0, 1), (0, 0)))
    moves = np.isfinite(value)  # each value of a scenario is finite
    return Sequence(
        value=array(np.where(moves, value, 0.0) * scale),
        moves=jax.device_put(moves),
        duration=array([*(phase.duration for phase in phases), 1.0]),
        force=array(force),
        sensors=tuple(sensors),
    )
