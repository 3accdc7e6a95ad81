"""The tasks that have an id: built-in scenarios, what they draw, and when they are done."""

from dataclasses import dataclass, field
from typing import Any

try:
    from gymnasium.envs.registration import register, registry
except ImportError as error:
    raise ImportError('environments need Gymnasium: pip install "crinoid[learn]"') from error

__all__ = ["TASKS", "Task", "register_tasks"]


@dataclass(frozen=True)
class Task:
    """An environment with an id."""

    scenario: str
    """Name of the built-in scenario."""
    values: dict[str, Any] = field(default_factory=dict)
    """Values of its keys that differ."""
    draw: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Keys that each episode draws."""
    success: dict[str, float] | None = None
    """When it is done: what `crinoid.environment.success.Success` takes."""


_THERE = {"position": 0.02, "time": 1.0}
TASKS = {
    "crinoid/StationKeeping-v0": Task("station-keeping"),
    "crinoid/StationKeeping3D-v0": Task("station-keeping-3d"),
    # one target for each episode, in the box of those of the scenario
    "crinoid/Reach-v0": Task(
        "reach",
        {
            "title": "Base and chambers bring a camera of 0.2 kg to a target",
            "target": {"tip": [0.4, -10.3]},
            "simulation.duration": 6.0,
        },
        {"target.tip.0": (0.35, 0.47), "target.tip.1": (-10.4, -10.2)},
        _THERE,
    ),
    "crinoid/Reach3D-v0": Task(
        "reach-3d",
        {
            "title": "Base and chambers bring a camera of 0.2 kg to a target, in space",
            "target": {"tip": [0.4, 0.0, -10.3]},
            "simulation.duration": 6.0,
        },
        {
            "target.tip.0": (0.34, 0.44),
            "target.tip.1": (-0.08, 0.08),
            "target.tip.2": (-10.4, -10.22),
        },
        _THERE,
    ),
    "crinoid/SwingUp-v0": Task("swing-up", success={"angle_deg": 3.0, "time": 3.0}),
}
"""By id."""


def register_tasks() -> None:
    """Make their ids known to Gymnasium, once."""
    for name in TASKS:
        if name not in registry:
            register(
                name,
                entry_point="crinoid.environment.make:make_task",
                vector_entry_point="crinoid.environment.make:make_vec_task",
                kwargs={"task": name},
            )
