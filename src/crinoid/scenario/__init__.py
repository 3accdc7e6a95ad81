"""The description of a scenario: a strict model, to and from TOML.

Nothing here computes; a mistake in a scenario is a `ScenarioError` with one line that names the
key, what it got and what it takes.
"""

from __future__ import annotations

from typing import Any

from crinoid.scenario.arm import Arm, Section
from crinoid.scenario.base import Base
from crinoid.scenario.channel import (
    AngularChannel,
    ChannelLimits,
    ChannelName,
    Channels,
    LinearChannel,
)
from crinoid.scenario.control import Control, Coordinate, Pid, PidGains, Sensor
from crinoid.scenario.errors import Mistake, ScenarioError, counted, shown
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
from crinoid.scenario.library import builtin_files, builtin_names, builtin_text, load
from crinoid.scenario.load import DistributedLoad, Load, TipLoad
from crinoid.scenario.motion import FileMotion, Motion, SineMotion, TableMotion, VelocityMotion
from crinoid.scenario.obstacle import Capsule, Cylinder, Obstacle, Plane, Sphere
from crinoid.scenario.quantity import unit_of
from crinoid.scenario.scenario import Scenario
from crinoid.scenario.simulation import Output, Simulation
from crinoid.scenario.target import Target
from crinoid.scenario.tool import Tool
from crinoid.scenario.water import Water

__all__ = [
    "AngularChannel",
    "Arm",
    "Base",
    "Capsule",
    "ChannelLimits",
    "ChannelName",
    "Channels",
    "Control",
    "Coordinate",
    "Cylinder",
    "DistributedLoad",
    "FileMotion",
    "Flow",
    "GaussMarkovFlow",
    "GustFlow",
    "LinearChannel",
    "Load",
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
    "ShearFlow",
    "Simulation",
    "SineFlow",
    "SineMotion",
    "Sphere",
    "TableMotion",
    "Target",
    "TipLoad",
    "Tool",
    "TurbulenceFlow",
    "UniformFlow",
    "VelocityMotion",
    "Water",
    "WavesFlow",
    "builtin_files",
    "builtin_names",
    "builtin_text",
    "counted",
    "json_schema",
    "load",
    "shown",
]


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scenario, for editors that check TOML files.

    Editors show descriptions and no key of ours, so units stand in the descriptions as well.
    """
    schema = Scenario.model_json_schema()
    for table in (schema, *schema["$defs"].values()):
        for entry in table["properties"].values():
            unit = unit_of(entry)
            if unit and "description" in entry:
                entry["description"] += f" Unit: {unit}."
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
