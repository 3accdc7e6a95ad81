"""Sequence of phases from its tables."""

import numpy as np

from crinoid.assembly.arrays import array
from crinoid.assembly.plan import AssembledScenario
from crinoid.control import Sequence
from crinoid.scenario import Mistake, ScenarioError, got, one_of
from crinoid.scenario.sensor import ContactSensor


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
    sensors = [each.called for each in scenario.sensors if isinstance(each, ContactSensor)]

    value = np.full((len(phases), len(inputs)), np.nan)
    force = np.zeros((len(phases), len(sensors)))
    for row, phase in enumerate(phases):
        for key, given, names, table in (
            ("inputs", phase.inputs, inputs, value),
            ("until", phase.until, sensors, force),
        ):
            for name, number in given.items():
                if name in names:
                    table[row, names.index(name)] = number
                    continue
                must = f"be of {one_of(names)}" if names else "be left out without a contact sensor"
                mistakes.append(Mistake(f"control.sequence.{row}.{key}.{name}", got(number, must)))
        for name, number, unit, each in zip(inputs, value[row], scale, plan.inputs, strict=True):
            low, high = float(each.lower) / unit, float(each.upper) / unit
            if number < low or number > high:
                text = got(number, f"be from {low:.6g} to {high:.6g}, the range of this input")
                mistakes.append(Mistake(f"control.sequence.{row}.inputs.{name}", text))
    if mistakes:
        raise ScenarioError(mistakes)
    return Sequence(
        value=array(np.nan_to_num(value) * scale),
        moves=array(np.isfinite(value)),
        duration=array([phase.duration for phase in phases]),
        force=array(force),
        sensors=tuple(sensors),
    )
