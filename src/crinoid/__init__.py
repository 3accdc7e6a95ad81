"""Simulate and control a soft robotic arm in moving water."""

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from crinoid.foundation.version import __version__

if TYPE_CHECKING:
    from crinoid.actuation import Actuator, Input
    from crinoid.analysis.equilibria import equilibria
    from crinoid.analysis.linearisation import linearise
    from crinoid.analysis.vibrations import modes
    from crinoid.assembly.actuators import ActuatorParameters
    from crinoid.assembly.arrays import flow_onset, load_onset
    from crinoid.assembly.plan import AssembledScenario
    from crinoid.assembly.prepared import parameters, system
    from crinoid.assembly.system import assemble
    from crinoid.control import Controller, ControllerInput, Measurand, Sensor
    from crinoid.dynamics import Outcome, State, System
    from crinoid.elements import Element, Motion
    from crinoid.flow import Flow
    from crinoid.inverse.estimation import estimate
    from crinoid.learning.environment.env import make_env
    from crinoid.learning.environment.vector import make_vec_env
    from crinoid.numerics.ramp import Onset
    from crinoid.results.result import Result
    from crinoid.scenario import Scenario, ScenarioError
    from crinoid.scenario.library import load
    from crinoid.simulation import (
        Session,
        SimulationError,
        closed_loop,
        equilibrium,
        rollout,
        simulate,
        with_parameters,
    )
    from crinoid.studies.batch import simulate_batch
    from crinoid.view.figures import write_report

_HOMES = {
    "Actuator": "crinoid.actuation",
    "ActuatorParameters": "crinoid.assembly.actuators",
    "Controller": "crinoid.control",
    "Element": "crinoid.elements",
    "Flow": "crinoid.flow",
    "Input": "crinoid.actuation",
    "Measurand": "crinoid.control",
    "Motion": "crinoid.elements",
    "Onset": "crinoid.numerics.ramp",
    "Outcome": "crinoid.dynamics",
    "AssembledScenario": "crinoid.assembly.plan",
    "ControllerInput": "crinoid.control",
    "Sensor": "crinoid.control",
    "State": "crinoid.dynamics",
    "System": "crinoid.dynamics",
    "flow_onset": "crinoid.assembly.arrays",
    "load_onset": "crinoid.assembly.arrays",
    "Result": "crinoid.results.result",
    "Scenario": "crinoid.scenario",
    "ScenarioError": "crinoid.scenario",
    "Session": "crinoid.simulation",
    "SimulationError": "crinoid.simulation",
    "closed_loop": "crinoid.simulation",
    "equilibria": "crinoid.analysis.equilibria",
    "equilibrium": "crinoid.simulation",
    "linearise": "crinoid.analysis.linearisation",
    "estimate": "crinoid.inverse.estimation",
    "load": "crinoid.scenario",
    "modes": "crinoid.analysis.vibrations",
    "rollout": "crinoid.simulation",
    "simulate": "crinoid.simulation",
    "simulate_batch": "crinoid.studies.batch",
    "make_env": "crinoid.learning.environment.env",
    "make_vec_env": "crinoid.learning.environment.vector",
    "system": "crinoid.assembly.prepared",
    "assemble": "crinoid.assembly.system",
    "parameters": "crinoid.assembly.prepared",
    "with_parameters": "crinoid.simulation",
    "write_report": "crinoid.view.figures",
}
"""The module of each public name, loaded when the name is used first."""

__all__ = [
    "Actuator",
    "ActuatorParameters",
    "AssembledScenario",
    "Controller",
    "ControllerInput",
    "Element",
    "Flow",
    "Input",
    "Measurand",
    "Motion",
    "Onset",
    "Outcome",
    "Result",
    "Scenario",
    "ScenarioError",
    "Sensor",
    "Session",
    "SimulationError",
    "State",
    "System",
    "__version__",
    "assemble",
    "closed_loop",
    "equilibria",
    "equilibrium",
    "estimate",
    "flow_onset",
    "linearise",
    "load",
    "load_onset",
    "make_env",
    "make_vec_env",
    "modes",
    "parameters",
    "rollout",
    "simulate",
    "simulate_batch",
    "system",
    "with_parameters",
    "write_report",
]

# Round-off of 32 bits would drown the stretch of a stiff arm. JAX reads the variable when it is
# imported, which is slower than `crinoid --help` and left to the modules that compute.
if "jax" in sys.modules:
    sys.modules["jax"].config.update("jax_enable_x64", True)
else:
    os.environ["JAX_ENABLE_X64"] = "1"


# XLA asks for a bug report where a program compiles for minutes; `crinoid.compilation` logs a line
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")

# XLA runs a program on the CPU as a list of small functions, and their calls cost more than
# their work on arrays as small as an arm's. Loops of up to so many bytes become one function.
# LLVM, which compiles it, must then forget all that it knew of loops when it unrolls one: to forget
# the loops around it alone, it looks through the whole function each time. Written out are loops of
# up to 8 turns, the coordinates of two nodes in space; one over the nodes is faster as a loop.
_LOOPS = "xla_cpu_small_while_loop_byte_threshold"
_given = os.environ.get("XLA_FLAGS", "")
if _LOOPS not in _given:
    _options = f"{_LOOPS}={1 << 24},-forget-scev-loop-unroll,-unroll-full-max-count=8"
    os.environ["XLA_FLAGS"] = f"{_given} --xla_backend_extra_options={_options}".strip()


# `gymnasium.make("crinoid:crinoid/Reach-v0")` imports this, to find the id afterwards
if "gymnasium" in sys.modules:
    import_module("crinoid.learning.environment")


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'crinoid' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
