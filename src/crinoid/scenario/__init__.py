"""Scenario: a strict model of a run, to and from TOML; computes nothing.

May import ``control`` and lower folders.

Nothing here computes; a mistake in a scenario is a `ScenarioError` with one line that names the
key, its value, the right value and the remedy.
"""

from crinoid.scenario.actuator import Chamber as Chamber
from crinoid.scenario.actuator import Tendon as Tendon
from crinoid.scenario.controller import PidGains as PidGains
from crinoid.scenario.errors import Mistake as Mistake
from crinoid.scenario.errors import ScenarioError as ScenarioError
from crinoid.scenario.errors import counted as counted
from crinoid.scenario.errors import got as got
from crinoid.scenario.errors import one_of as one_of
from crinoid.scenario.errors import percent as percent
from crinoid.scenario.errors import refusal as refusal
from crinoid.scenario.errors import shown as shown
from crinoid.scenario.flow import GustFlow as GustFlow
from crinoid.scenario.flow import MeasuredFlow as MeasuredFlow
from crinoid.scenario.flow import ShearFlow as ShearFlow
from crinoid.scenario.flow import SineFlow as SineFlow
from crinoid.scenario.flow import UniformFlow as UniformFlow
from crinoid.scenario.flow_table import FlowTable as FlowTable
from crinoid.scenario.library import ScenarioText as ScenarioText
from crinoid.scenario.library import builtin_files as builtin_files
from crinoid.scenario.library import builtin_names as builtin_names
from crinoid.scenario.library import builtin_text as builtin_text
from crinoid.scenario.library import load as load
from crinoid.scenario.load import DistributedLoad as DistributedLoad
from crinoid.scenario.load import Load as Load
from crinoid.scenario.load import LoadTable as LoadTable
from crinoid.scenario.load import TipLoad as TipLoad
from crinoid.scenario.obstacle import Mesh as Mesh
from crinoid.scenario.obstacle import Obstacle as Obstacle
from crinoid.scenario.obstacle import Plane as Plane
from crinoid.scenario.obstacle import Seabed as Seabed
from crinoid.scenario.random_flow import GaussMarkovFlow as GaussMarkovFlow
from crinoid.scenario.random_flow import TurbulenceFlow as TurbulenceFlow
from crinoid.scenario.scenario import Scenario as Scenario
from crinoid.scenario.schema import json_schema as json_schema
from crinoid.scenario.ship_wake import ShipWakeFlow as ShipWakeFlow
from crinoid.scenario.simulation import Simulation as Simulation
from crinoid.scenario.target import Target as Target
from crinoid.scenario.tool import Tool as Tool
from crinoid.scenario.vehicle import Vehicle as Vehicle
from crinoid.scenario.waves import SeaState as SeaState
from crinoid.scenario.waves import SurfaceWaves as SurfaceWaves
