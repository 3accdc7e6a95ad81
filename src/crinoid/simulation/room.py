"""Whether a run has room: in memory, or on the disk that takes it."""

import shutil
from pathlib import Path

from crinoid.elements import ENERGIES, WORKS
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.space import AXES, CHANNELS
from crinoid.variables import numbers, of_dimension

__all__ = ["check_room", "room_for"]

_MAX_BYTES = 8e9
_AT_THE_END = 2.7
"""Times that memory holds a number where a result is put together, measured."""


def check_room(scenario: Scenario, into: Path | None) -> None:
    """Refuse a run that keeps more than memory, or the disk that it is written to, can take."""
    nodes, runs = scenario.arm.nodes, _runs(scenario)
    instants = scenario.simulation.steps // scenario.output_steps + 1
    whole = _bytes(scenario, large=True)
    # of a run on the disk, memory holds what has one number an instant
    held = whole if into is None else _bytes(scenario, large=False)
    _refuse(instants, nodes, held * (_AT_THE_END + runs - 1), _MAX_BYTES, "of memory")
    if into is not None:
        folder = next(each for each in (into, *into.resolve().parents) if each.is_dir())
        free = shutil.disk_usage(folder).free
        _refuse(instants, nodes, whole * runs, float(free), f"on the disk of {folder}")


def room_for(scenario: Scenario) -> int:
    """Return how many such runs memory can hold, at least one."""
    return max(1, int(_MAX_BYTES / (_bytes(scenario, large=True) * _runs(scenario))))


def _runs(scenario: Scenario) -> int:
    return 1 + (scenario.control.kind != "none" and scenario.control.compare)


def _bytes(scenario: Scenario, *, large: bool) -> float:
    """Return the size of the instants that a run keeps, with what is large or without."""
    dimension, nodes = scenario.arm.dimension, scenario.arm.nodes
    sizes = {
        "node": nodes,
        "edge": nodes - 1,
        "axis": len(AXES[dimension]),
        "bending": 2,
        "channel": len(CHANNELS[dimension]),
        "kind": len(ENERGIES) + len(WORKS),
        "obstacle": len(scenario.obstacle),
    }
    parts = {"obstacles": scenario.obstacle, "tool": scenario.tool}
    without = [name for name, found in parts.items() if not found]
    there = of_dimension(dimension, without=without).values()
    kept = [variable for variable in there if large or not variable.large]
    instants = scenario.simulation.steps // scenario.output_steps + 1
    return 8.0 * instants * numbers(kept, sizes)


def _refuse(instants: int, nodes: int, size: float, most: float, where: str) -> None:
    if size > most:
        text = f"keeps {instants} instants of {nodes} nodes, which need about {size / 1e9:.3g} GB "
        text += f"{where}; takes a longer one, for {most / 1e9:.3g} GB or less"
        raise ScenarioError([Mistake("output.interval", text)])
