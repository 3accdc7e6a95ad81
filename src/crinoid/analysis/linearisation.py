"""Linearisation of arm, actuators and sensors about the state in which an arm starts."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.analysis.sampled_plant import SampledPlant
from crinoid.analysis.sampled_plant import System as LinearSystem
from crinoid.analysis.state_space import StateSpaceModel
from crinoid.assembly.arrays import array
from crinoid.assembly.linear import in_steady_water
from crinoid.assembly.prepared import Prepared, require_one_case
from crinoid.compilation import ONCE, compiled
from crinoid.control import Sensor
from crinoid.dynamics import LocalCoordinates, State, System
from crinoid.dynamics.coordinate_names import Names, actuator_names, arm_names
from crinoid.dynamics.resting import stand
from crinoid.flow import Uniform
from crinoid.flow.flow import Everywhere
from crinoid.foundation.axes import AXES
from crinoid.numerics.ramp import Onset
from crinoid.scenario.errors import counted
from crinoid.scenario.library import Source
from crinoid.simulation.loop import Loop
from crinoid.simulation.setup import set_up

_USUAL = 0.1  # usual change of the water's velocity (m/s), and of its acceleration (m/s2)


def linearise(scenario: Source, *, order: int | None = None) -> StateSpaceModel:
    """Linearise arm, actuators and sensors over a control period.

    About the still arm in the shape in which it starts, in the mean current; in still water
    without one. Inputs are the commands of all inputs that can move, and the water: its velocity
    along each axis, uniform along the arm, and its acceleration. Outputs are the readings as late
    as a controller knows them, the pose of the tip, and the drives of the inputs.

    Parameters
    ----------
    scenario : Scenario, str or path
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file. Its
        controller and target do not count.
    order : int
        Number of states to reduce the model to; all by default.

    Returns
    -------
    crinoid.analysis.state_space.StateSpaceModel
        Matrices with names and units of states, inputs and outputs.

    Raises
    ------
    ScenarioError
        If a file that the scenario names is not valid, the arm has no equilibrium, or the model
        cannot have this order.
    ValueError
        If the scenario describes several cases.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "simulation.duration=0.2"])
    >>> model = crinoid.linearise(scenario)
    >>> model.inputs[:3], model.stable
    (('command_slide', 'command_tilt', 'current_x'), True)
    >>> model.A.shape, model.period  # s
    ((29, 29), 0.01)
    """
    model = find_state_space(Prepared(scenario))
    return model if order is None else model.reduced(order)


def find_state_space(prepared: Prepared) -> StateSpaceModel:
    """Return the full model of a scenario."""
    require_one_case(prepared.scenario)
    prepared = prepared.with_scenario(prepared.scenario.with_values(prepared.scenario.idle_values))
    setup = set_up(prepared, notes=False)
    loop, system = setup.loop, setup.loop.system
    current = next(iter(prepared.facts.waters.values()))
    point = _operating_point(system, setup.state, array(current), loop.sensors)
    coordinates = LocalCoordinates(system, point.still)
    point = jax.tree.map(np.asarray, point)
    plant = SampledPlant.of(setup, current, point.by_water)
    whole = plant.system

    axes, followers = AXES[len(current)], point.actuators.size
    ranges = np.array([float(each.upper) - float(each.lower) for each in system.inputs])
    moves, count = ranges > 0, 2 * len(axes)
    inputs = [(f"command_{each.name}", each.unit) for each in system.inputs]
    inputs += [(f"current_{axis}", "m s-1") for axis in axes]
    inputs += [(f"current_acceleration_{axis}", "m s-2") for axis in axes]
    driven = np.concatenate([moves, np.ones(count, bool)])
    scales = np.where(np.isfinite(ranges), 0.5 * ranges, 1.0)

    readings = [(f"measured_{name.replace('.', '_')}", unit) for name, unit in loop.readings]
    pose = [(f"tip_{name}", unit) for name, unit in loop.sensors[0].measurand.names(len(axes))]
    outputs = readings + pose + [(each.name, each.unit) for each in system.inputs]
    seen = np.concatenate([np.ones(len(readings) + len(pose), bool), moves])
    true = np.zeros((len(pose) + moves.size, whole.A.shape[0]))
    true[: len(pose), : plant.observed.shape[1]] = plant.observed[: len(pose)]
    last = plant.observed.shape[1]
    true[len(pose) :, last - followers : last] = point.drives_by_actuators
    C = np.concatenate([whole.C[: len(readings)], true])
    D = np.pad(whole.D[: len(readings)], ((0, len(true)), (0, 0)))
    values = np.concatenate([plant.values, plant.values[: len(pose)], point.drives])

    states, at = _states(loop, coordinates, plant, readings)
    found = LinearSystem(whole.A, whole.B[:, driven], C[seen], D[np.ix_(seen, driven)])
    needed = found.needed
    state_names, state_units = _chosen(states, needed)
    input_names, input_units = _chosen(inputs, driven)
    output_names, output_units = _chosen(outputs, seen)
    from_rest = prepared.scenario.simulation.start == "rest"
    return StateSpaceModel.of(
        found.of_states(needed),
        title=prepared.scenario.title,
        period=plant.period,
        current=np.array(current),
        states=state_names,
        inputs=input_names,
        outputs=output_names,
        state_units=state_units,
        input_units=input_units,
        output_units=output_units,
        operating_states=np.concatenate([point.arm, point.actuators, at])[needed],
        operating_inputs=np.array([*np.zeros(moves.size), *current, *np.zeros(len(axes))])[driven],
        operating_outputs=values[seen],
        input_scales=np.concatenate([scales, np.full(count, _USUAL)])[driven],
        notes=("the model is about the arm without loads (simulation.start)",) * from_rest,
    )


def _states(
    loop: Loop, coordinates: LocalCoordinates, plant: SampledPlant, readings: Names
) -> tuple[Names, Float[np.ndarray, " late"]]:
    """Return the names of all states, and the values of those that are readings under way."""
    names, rows, first = arm_names(coordinates) + actuator_names(coordinates), [], 0
    for sensor in loop.sensors:
        own = range(first, first + sensor.noise.shape[0])
        for late in range(1, plant.late[first] + 1):
            taken = f"{counted(late, 'period')} ago"
            names += [(f"{readings[row][0]} {taken}", readings[row][1]) for row in own]
            rows += [*own]
        first = own.stop
    return names, plant.values[rows]


def _chosen(names: Names, kept: Bool[np.ndarray, " n"]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names and units of those that are kept."""
    found = [each for each, there in zip(names, kept, strict=True) if there]
    return tuple(name for name, _ in found), tuple(unit for _, unit in found)


class _Disturbance(Everywhere):
    """A change of the water's velocity, and its acceleration."""

    steady: ClassVar[bool] = False
    onset: Onset
    change: Float[Array, "2 d"]  # velocity (m/s) and acceleration (m/s2)
    since: Float[Array, ""]  # time at which the velocity has that value (s)

    def at(self, time: Float[Array, ""]) -> Float[Array, " d"]:
        return self.change[0] + self.change[1] * (time - self.since)


class _OperatingPoint(NamedTuple):
    """State that a model is linear about, and what a time step does not show of it."""

    still: State
    arm: Float[Array, " a"]  # coordinates of the arm
    actuators: Float[Array, " s"]  # numbers in the states of the actuators
    drives: Float[Array, " input"]  # drive of each input, in its unit
    drives_by_actuators: Float[Array, "input s"]
    by_water: Float[Array, "y c"]
    """Values of the sensors by velocity and acceleration of the water at the same instant."""


@compiled(**ONCE)
def _operating_point(
    system: System, state: State, current: Float[Array, " d"], sensors: tuple[Sensor, ...]
) -> _OperatingPoint:
    steady = Uniform(Onset.of(), current)
    still = stand(in_steady_water(system, steady), state)
    at = LocalCoordinates(in_steady_water(system, steady), still)

    def drives(actuators: Array) -> Array:
        each = zip(system.followers, at.driven(actuators), strict=True)
        return jnp.concatenate([one.drive(own) for one, own in each])

    def seen(change: Array) -> Array:
        stirred = in_steady_water(system, steady, _Disturbance(Onset.of(), change, still.time))
        near = LocalCoordinates(stirred, still).at(at.arm, at.actuators)
        return jnp.concatenate([each.measurand.of(stirred, near) for each in sensors])

    by_water = jax.jacfwd(seen)(jnp.zeros((2, current.size)))
    return _OperatingPoint(
        still,
        at.arm,
        at.actuators,
        drives(at.actuators),
        jax.jacfwd(drives)(at.actuators),
        by_water.reshape(by_water.shape[0], -1),
    )
