"""Simulate and control a soft robotic arm in moving water."""

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

from crinoid import showing
from crinoid.version import __version__

if TYPE_CHECKING:
    from crinoid.actuation import Actuator, Input
    from crinoid.assembly.actuator import ActuatorParameters
    from crinoid.assembly.flow import flow_onset
    from crinoid.assembly.load import load_onset
    from crinoid.assembly.plan import Plan
    from crinoid.assembly.prepared import parameters, system
    from crinoid.assembly.system import assemble
    from crinoid.batch import simulate_batch
    from crinoid.control import Controller, Measurand, Seen, Sensor
    from crinoid.dynamics import Outcome, State, System
    from crinoid.elements import Element, Motion
    from crinoid.environment.make import make_env, make_vec_env
    from crinoid.flow import Flow
    from crinoid.onset import Onset
    from crinoid.result import Result
    from crinoid.scenario import Scenario, ScenarioError
    from crinoid.scenario.library import load
    from crinoid.simulation import (
        SimulationError,
        closed_loop,
        equilibrium,
        modes,
        rollout,
        simulate,
        with_parameters,
    )

_HOMES = {
    "Actuator": "crinoid.actuation",
    "ActuatorParameters": "crinoid.assembly.actuator",
    "Controller": "crinoid.control",
    "Element": "crinoid.elements",
    "Flow": "crinoid.flow",
    "Input": "crinoid.actuation",
    "Measurand": "crinoid.control",
    "Motion": "crinoid.elements",
    "Onset": "crinoid.onset",
    "Outcome": "crinoid.dynamics",
    "Plan": "crinoid.assembly.plan",
    "Seen": "crinoid.control",
    "Sensor": "crinoid.control",
    "State": "crinoid.dynamics",
    "System": "crinoid.dynamics",
    "flow_onset": "crinoid.assembly.flow",
    "load_onset": "crinoid.assembly.load",
    "Result": "crinoid.result",
    "Scenario": "crinoid.scenario",
    "ScenarioError": "crinoid.scenario",
    "SimulationError": "crinoid.simulation",
    "closed_loop": "crinoid.simulation",
    "equilibrium": "crinoid.simulation",
    "load": "crinoid.scenario",
    "modes": "crinoid.simulation",
    "rollout": "crinoid.simulation",
    "simulate": "crinoid.simulation",
    "simulate_batch": "crinoid.batch",
    "make_env": "crinoid.environment.make",
    "make_vec_env": "crinoid.environment.make",
    "system": "crinoid.assembly.prepared",
    "assemble": "crinoid.assembly.system",
    "parameters": "crinoid.assembly.prepared",
    "with_parameters": "crinoid.simulation",
}
"""The module of each public name, loaded when the name is used first."""

__all__ = [
    "Actuator",
    "ActuatorParameters",
    "Controller",
    "Element",
    "Flow",
    "Input",
    "Measurand",
    "Motion",
    "Onset",
    "Outcome",
    "Plan",
    "Result",
    "Scenario",
    "ScenarioError",
    "Seen",
    "Sensor",
    "SimulationError",
    "State",
    "System",
    "__version__",
    "assemble",
    "closed_loop",
    "equilibrium",
    "flow_onset",
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
]

# Round-off of 32 bits would drown the stretch of a stiff arm. JAX reads the variable when it is
# imported, which takes longer than to answer `crinoid --help` and is left to what computes.
if "jax" in sys.modules:
    sys.modules["jax"].config.update("jax_enable_x64", True)
else:
    os.environ["JAX_ENABLE_X64"] = "1"


# XLA runs a program on the CPU as a list of small functions, and calling these takes longer than
# what they do for arrays as small as an arm's. Loops of up to so many bytes become one function.
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
    import_module("crinoid.environment")

showing.shown_by = lambda: cast("showing.Showing", import_module("crinoid.notebook"))


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'crinoid' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
