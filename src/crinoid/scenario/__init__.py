"""The description of a scenario: a strict model, to and from TOML.

Nothing here computes; a mistake in a scenario is a `ScenarioError` with one line that names the
key, what it got and what it takes.
"""

from crinoid.scenario.actuator import Actuator, ActuatorTable
from crinoid.scenario.arm import Arm, Section
from crinoid.scenario.base import Base
from crinoid.scenario.chamber import Chamber, Tendon
from crinoid.scenario.channel import (
    AngularChannel,
    ChannelLimits,
    ChannelName,
    Channels,
    LinearChannel,
)
from crinoid.scenario.control import Control, ControllerTable, Coordinate, Pid, PidGains
from crinoid.scenario.errors import Mistake, ScenarioError, counted, one_of, shown
from crinoid.scenario.flow import (
    Flow,
    GaussMarkovFlow,
    GustFlow,
    MeasuredFlow,
    ShearFlow,
    SineFlow,
    TurbulenceFlow,
    UniformFlow,
    WavesFlow,
)
from crinoid.scenario.flow_table import FlowTable
from crinoid.scenario.library import builtin_files, builtin_names, builtin_text, load
from crinoid.scenario.load import DistributedLoad, Load, LoadTable, TipLoad
from crinoid.scenario.motion import FileMotion, Motion, SineMotion, TableMotion, VelocityMotion
from crinoid.scenario.obstacle import Capsule, Cylinder, Obstacle, Plane, Sphere
from crinoid.scenario.scenario import Scenario
from crinoid.scenario.schema import json_schema
from crinoid.scenario.sensor import (
    ContactSensor,
    CurrentSensor,
    InclinationSensor,
    Sensor,
    Sensors,
    SensorTable,
    ShapeSensor,
    WrenchSensor,
)
from crinoid.scenario.simulation import Output, Simulation
from crinoid.scenario.target import Target
from crinoid.scenario.tool import Tool
from crinoid.scenario.vehicle import Vehicle
from crinoid.scenario.water import Water

__all__ = [
    "Actuator",
    "ActuatorTable",
    "AngularChannel",
    "Arm",
    "Base",
    "Capsule",
    "Chamber",
    "ChannelLimits",
    "ChannelName",
    "Channels",
    "ContactSensor",
    "Control",
    "ControllerTable",
    "Coordinate",
    "CurrentSensor",
    "Cylinder",
    "DistributedLoad",
    "FileMotion",
    "Flow",
    "FlowTable",
    "GaussMarkovFlow",
    "GustFlow",
    "InclinationSensor",
    "LinearChannel",
    "Load",
    "LoadTable",
    "MeasuredFlow",
    "Mistake",
    "Motion",
    "Obstacle",
    "Output",
    "Pid",
    "PidGains",
    "Plane",
    "Scenario",
    "ScenarioError",
    "Section",
    "Sensor",
    "SensorTable",
    "Sensors",
    "ShapeSensor",
    "ShearFlow",
    "Simulation",
    "SineFlow",
    "SineMotion",
    "Sphere",
    "TableMotion",
    "Target",
    "Tendon",
    "TipLoad",
    "Tool",
    "TurbulenceFlow",
    "UniformFlow",
    "Vehicle",
    "VelocityMotion",
    "Water",
    "WavesFlow",
    "WrenchSensor",
    "builtin_files",
    "builtin_names",
    "builtin_text",
    "counted",
    "json_schema",
    "load",
    "one_of",
    "shown",
]
