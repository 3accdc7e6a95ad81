"""Arms that move themselves do their tasks under load: the built-in scenarios, one seed each."""

import numpy as np
import pytest

import crinoid
from benchmarks.tasks import TASKS
from crinoid.results.effort import driven

pytestmark = pytest.mark.release

SHORT = {"reach-3d": 8.0, "trace-3d": 12.0}
"""Tasks of which a part shows as much (s)."""


@pytest.mark.parametrize("name", TASKS)
def test_a_task_is_done(name):
    scenario = crinoid.load(name)
    duration = SHORT.get(name, scenario.simulation.duration)
    changes = {"control.compare": False, "simulation.duration": duration}
    scenario = scenario.with_values(changes)
    result = crinoid.simulate(scenario)
    assert result.dataset.attrs["status"] == "ok"
    found = TASKS[name](result.dataset, scenario)
    assert {key: score for key, score in found.items() if not score.good} == {}
    # base and chambers: all of them do a part of the work
    used = [np.ptp(driven(result.dataset, each)) for each in scenario.driven]
    assert min(used) > 1e-2


@pytest.mark.parametrize("name", ["octopus", "octopus-3d"])
def test_a_bend_travels_down_the_arm(name):
    scenario = crinoid.load(name).with_values({"simulation.duration": 5.0})
    data = crinoid.simulate(scenario).dataset
    assert len(scenario.chamber) == scenario.arm.nodes - 1  # one for each edge
    bend = np.abs(data["curvature"].values)
    bend = bend if bend.ndim == 2 else np.linalg.norm(bend, axis=-1)
    when = data["time"].values[np.argmax(bend[:, 2:-3], axis=0)]
    assert np.all(np.diff(when[1:-1]) > 0)
    # as fast as the chambers are filled: the next one 0.15 s later
    slope = np.polyfit(np.arange(when.size), when, 1)[0]
    assert slope == pytest.approx(0.15, rel=0.15)
    assert bend.max() > 5.0
