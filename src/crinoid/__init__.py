"""Simulate and control a soft robotic arm in moving water."""

from typing import TYPE_CHECKING, Any

import jax

# round-off of 32 bits would drown the stretch of a stiff arm
jax.config.update("jax_enable_x64", True)

from crinoid.scenario import Scenario, ScenarioError, load  # noqa: E402
from crinoid.version import __version__  # noqa: E402

if TYPE_CHECKING:
    from crinoid.result import Result
    from crinoid.simulation import SimulationError, equilibrium, simulate

__all__ = [
    "Result",
    "Scenario",
    "ScenarioError",
    "SimulationError",
    "__version__",
    "equilibrium",
    "load",
    "simulate",
]


def __getattr__(name: str) -> Any:
    # reading and checking a scenario should not wait for all that runs one
    if name == "Result":
        from crinoid.result import Result

        return Result
    if name in {"SimulationError", "equilibrium", "simulate"}:
        import crinoid.simulation

        return getattr(crinoid.simulation, name)
    raise AttributeError(f"module 'crinoid' has no attribute {name!r}")
