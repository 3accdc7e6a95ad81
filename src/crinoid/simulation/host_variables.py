"""Variables of an arm in a co-simulation: names, units, meanings and values."""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from crinoid.assembly.prepared import Prepared
from crinoid.foundation.axes import ANGLES, AXES, CHANNELS
from crinoid.results.record import Record
from crinoid.scenario import Scenario
from crinoid.scenario.real_numbers import real_numbers
from crinoid.simulation.external import moved_channels
from crinoid.simulation.session import Session

DURATION = "simulation.duration"
_NO_PARAMETERS = ("simulation", "output", "control")
"""Tables whose numbers belong to the computation, or to the controller that the host replaces."""


Values = Callable[[Session, Record], ArrayLike]
"""From a session and the record of its present instant to numbers."""


class HostVariable(NamedTuple):
    """A variable of a co-simulation."""

    name: str
    unit: str
    """Unit, of results or of a scenario; "1" or empty for a plain number."""
    meaning: str
    start: float | int | None = None
    """Value at the start, of an input or a parameter; a whole number for the seed."""
    shape: tuple[int, ...] = ()  # shape of an array; empty for a number


class Outputs(NamedTuple):
    """Numbers that one quantity has, in its order; or a single array."""

    variables: tuple[HostVariable, ...]
    of: Values
    """Their values."""

    def values(self, session: Session, record: Record) -> dict[str, Any]:
        """Return the value of each variable, by name."""
        found = np.asarray(self.of(session, record), float)
        if self.variables[0].shape:
            return {self.variables[0].name: found}
        numbers = np.ravel(found).tolist()
        return {each.name: value for each, value in zip(self.variables, numbers, strict=True)}


def channels_of(scenario: Scenario) -> list[tuple[str, str]]:
    """Return the name and the unit of each channel of the base."""
    names = CHANNELS[scenario.arm.dimension]
    return [(name, "rad" if name in ANGLES else "m") for name in names]


def inputs_of(prepared: Prepared) -> list[HostVariable]:
    """Return the inputs: commands, the external current, and the motion of a base that is held."""
    scenario = prepared.scenario
    found = [
        HostVariable(
            f"command_{each.name}",
            each.unit,
            f"command of {each.name}, from {float(each.lower):g} to {float(each.upper):g}",
            0.0,
        )
        for each in prepared.system.inputs
        if each.lower < each.upper
    ]
    for axis in AXES[scenario.arm.dimension]:
        text = f"external current along {axis}, which is added to the scenario's"
        found.append(HostVariable(f"current_{axis}", "m s-1", text, 0.0))
    felt = moved_channels(scenario) if not scenario.floats else ()
    for name, unit in (each for each in channels_of(scenario) if each[0] in felt):
        text = f"external displacement of the base in {name}, which is added to the scenario's"
        found.append(HostVariable(f"base_{name}", unit, text, 0.0))
    return found


def parameters_of(scenario: Scenario) -> list[HostVariable]:
    """Return the parameters: the seed, the duration, and real numbers of the scenario by key."""
    found = [
        HostVariable("seed", "", "Seed of everything random.", scenario.seed),
        HostVariable(DURATION, "s", "Latest time.", scenario.simulation.duration),
    ]
    return found + [
        HostVariable(each.key, each.unit, each.meaning, each.value)
        for each in real_numbers(scenario)
        if each.key.partition(".")[0] not in _NO_PARAMETERS
    ]


def outputs_of(prepared: Prepared) -> list[Outputs]:
    """Return the outputs by quantity; the shape of the arm is the last one."""
    scenario = prepared.scenario
    count, nodes, channels = scenario.arm.dimension, scenario.arm.nodes, channels_of(scenario)
    tip, *others = prepared.sensors
    pose, forces = tip.measurand.names(count), [(axis, "N") for axis in AXES[count]]
    moment, moments = "base_moment", [("", "N m")]
    if count == 3:
        moment, moments = "base_moment_", [(axis, "N m") for axis in AXES[3]]
    own = "in the frame of the target"
    newest = f"newest known pose of the tip, {own}"
    rows: list[tuple[str, Iterable[tuple[str, str]], str, Values]] = [
        ("tip_", pose, "pose of the tip in the world", lambda _, now: now.tip),
        ("target_", pose, f"pose for the tip, {own}", lambda session, _: session.seen.reference),
        ("measured_", pose, newest, lambda session, _: session.seen.measured),
        ("base_force_", forces, "force of the arm on its base", lambda _, now: now.base_force),
        (moment, moments, "moment of the arm on its base", lambda _, now: now.base_moment),
        ("base_pose_", channels, "displacement of the base", lambda _, now: now.pose),
        ("max_curvature", [("", "m-1")], "largest curvature", _largest_curvature),
    ]
    if scenario.floats:
        rows.append(("vehicle_pose_", channels, "displacement of the vehicle", _vehicle_pose))
    for each in others:
        text = f"newest known reading of {each.name}"
        rows.append((f"{each.name}.", each.measurand.names(count), text, _reading(each.name)))
    found = [
        Outputs(
            tuple(
                HostVariable(f"{prefix}{name}", unit, f"{meaning}: {name}" if name else meaning)
                for name, unit in parts
            ),
            of,
        )
        for prefix, parts, meaning, of in rows
    ]
    shape = HostVariable("shape", "m", "position of each node in the world", None, (nodes, count))
    where = Outputs((shape,), lambda session, now: now.position + session.loop.system.forces.origin)
    return [*found, where]


def _largest_curvature(_: Session, now: Record) -> ArrayLike:
    bent = np.asarray(now.curvature)
    return np.max(np.linalg.norm(bent.reshape(bent.shape[0], -1), axis=1))


def _vehicle_pose(_: Session, now: Record) -> ArrayLike:
    assert now.vehicle is not None
    return now.vehicle.pose


def _reading(name: str) -> Values:
    return lambda session, _: session.seen.readings[name].value
