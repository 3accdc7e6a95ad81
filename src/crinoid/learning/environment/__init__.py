"""The closed loop as environments of Gymnasium; importing this registers the ids of tasks."""

from dataclasses import dataclass, field
from typing import Any

try:
    from gymnasium.envs.registration import register, registry
except ImportError as error:
    raise ImportError('environments need Gymnasium: pip install "crinoid[learn]"') from error

__all__ = ["TASKS", "Task"]


@dataclass(frozen=True)
class Task:
    """A built-in scenario as a task with an id."""

    scenario: str  # name of the built-in scenario
    values: dict[str, Any] = field(default_factory=dict)  # other values of its keys
    draw: dict[str, tuple[float, float]] = field(default_factory=dict)  # keys that episodes draw
    success: dict[str, float] | None = None
    """Arguments of `crinoid.learning.environment.reward.Success`."""


_AT_TARGET = {"position": 0.02, "time": 1.0}
TASKS = {
    "crinoid/StationKeeping-v0": Task("station-keeping"),
    "crinoid/StationKeeping3D-v0": Task("station-keeping-3d"),
    # one target for each episode, in the box of the scenario's targets
    "crinoid/Reach-v0": Task(
        "reach",
        {
            "title": "Base and chambers bring a camera of 0.2 kg to a target",
            "target": {"tip": [0.4, -10.3]},
            "simulation.duration": 6.0,
        },
        {"target.tip.0": (0.35, 0.47), "target.tip.1": (-10.4, -10.2)},
        _AT_TARGET,
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
        _AT_TARGET,
    ),
    "crinoid/SwingUp-v0": Task("swing-up", success={"angle_deg": 3.0, "time": 3.0}),
}
"""Tasks by id."""

for _id in TASKS:
    if _id not in registry:
        register(
            _id,
            entry_point="crinoid.learning.environment.env:make_task",
            vector_entry_point="crinoid.learning.environment.vector:make_vec_task",
            kwargs={"task": _id},
        )
