"""From the description of a sensor to what the controller sees of the tip."""

import jax
import numpy as np

from crinoid.assembly.numbers import array
from crinoid.control import Clock, Sensor
from crinoid.scenario import Scenario
from crinoid.space import POSE


def build_sensor(scenario: Scenario) -> Sensor:
    """Return the sensor of a scenario."""
    sensor = scenario.sensor
    rate = scenario.sensor_rate_hz
    axes = scenario.arm.dimension
    turns = len(POSE[axes]) - axes
    noise = [sensor.noise_position] * axes + [np.deg2rad(sensor.noise_angle_deg)] * turns
    return Sensor(
        clock=Clock(array(1.0 / rate)),
        delay=array(sensor.delay),
        noise=array(noise),
        key=jax.random.key(scenario.seed),
        # where the rate does not divide the time step samples may bunch: one more is under way
        kept=int(np.ceil(sensor.delay * rate)) + 2,
    )
