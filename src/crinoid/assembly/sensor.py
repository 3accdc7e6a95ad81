"""From the description of sensors to what the controller sees."""

import math
from collections.abc import Sequence

import jax
import numpy as np

from crinoid.assembly.door import made
from crinoid.assembly.numbers import array
from crinoid.assembly.obstacle import edges_within
from crinoid.control import (
    BaseWrench,
    Clock,
    ContactForce,
    Inclination,
    Measurand,
    Sensor,
    Shape,
    TipPose,
    WaterVelocity,
)
from crinoid.scenario import Scenario
from crinoid.scenario import sensor as tables
from crinoid.space import POSE

Numbers = float | Sequence[float]
"""One for each value, or one for all."""


def build_sensors(scenario: Scenario) -> tuple[Sensor, ...]:
    """Return the sensor of the tip and the further ones of a scenario."""
    tip, axes = scenario.sensor, scenario.arm.dimension
    turns = len(POSE[axes]) - axes
    noise, resolution = (
        [position] * axes + [np.deg2rad(angle)] * turns
        for position, angle in (
            (tip.noise_position, tip.noise_angle_deg),
            (tip.resolution_position, tip.resolution_angle_deg),
        )
    )
    sensors = [build_sensor(scenario, 0, tip, "tip", TipPose(), noise, resolution)]
    for index, table in enumerate(scenario.sensors, start=1):
        given = scenario, index, table, table.called, *_measured(table, scenario)
        sensors.append(made(f"sensor {table.called}", Sensor, build_sensor, *given))
    return tuple(sensors)


def build_sensor(
    scenario: Scenario,
    index: int,
    table: tables.Reading,
    name: str,
    measurand: Measurand,
    noise: Numbers,
    resolution: Numbers,
) -> Sensor:
    """Return a sensor.

    Parameters
    ----------
    scenario
        What it is part of, with the seed of its noise.
    index
        Its number: no two sensors have the same noise.
    table
        When it reads.
    name
        Under which the controller finds its readings.
    measurand
        What it measures.
    noise, resolution
        Standard deviation and step of each value, or one for all, in SI units.
    """
    rate, axes = scenario.rate_hz(table.rate_hz), scenario.arm.dimension
    size = len(measurand.names(axes))
    key = jax.random.key(scenario.seed)
    return Sensor(
        name=name,
        measurand=measurand,
        clock=Clock(array(1.0 / rate)),
        delay=array(table.delay),
        noise=array(np.broadcast_to(noise, size)),
        resolution=array(np.broadcast_to(resolution, size)),
        key=jax.random.fold_in(key, index) if index else key,
        # where the rate does not divide the time step samples may bunch: one more is under way
        kept=int(np.ceil(table.delay * rate)) + 2,
    )


def _measured(table: tables.SensorTable, scenario: Scenario) -> tuple[Measurand, Numbers, Numbers]:
    """Return what a sensor measures, with noise and resolution of its values."""
    match table:
        case tables.ShapeSensor():
            return Shape(array(table.stations)), table.noise, table.resolution
        case tables.WrenchSensor():
            axes = scenario.arm.dimension
            forces, moments = (axes, 1 if axes == 2 else 3)
            noise, resolution = (
                [force] * forces + [moment] * moments
                for force, moment in (
                    (table.noise_force, table.noise_moment),
                    (table.resolution_force, table.resolution_moment),
                )
            )
            return BaseWrench(), noise, resolution
        case tables.CurrentSensor():
            return WaterVelocity(array(table.points)), table.noise, table.resolution
        case tables.InclinationSensor():
            return (
                Inclination(array(table.stations)),
                math.radians(table.noise_deg),
                math.radians(table.resolution_deg),
            )
        case tables.ContactSensor():
            inside = edges_within(table.span, scenario.arm.nodes)
            return ContactForce(inside), table.noise, table.resolution
        case _:
            return made(f"sensor {table.called}", 3, table.build, scenario)
