"""Chart of contact of the arm with itself."""

import numpy as np
import pytest
import xarray as xr

from crinoid.results.metrics import MEASURES, RunStatistics
from crinoid.scenario import Scenario
from crinoid.view.figures.charts.summary import summary
from crinoid.view.figures.charts.touch import contact_chart, has_contact
from crinoid.view.figures.run import Run
from helpers.made_results import made_result

TIME = np.linspace(0.0, 2.0, 21)


def touching():
    """Return a run whose first and last edge press on each other from the middle on."""
    pressing = np.arange(TIME.size) >= 10
    force, gap = np.zeros((TIME.size, 5, 2)), np.full((TIME.size, 5), np.inf)
    force[pressing, 0], force[pressing, -1] = (0.0, 3.0), (0.0, -3.0)
    gap[:, 0] = gap[:, -1] = np.where(pressing, 4e-4, 0.02)
    return xr.Dataset(
        {"self_force": (("time", "edge", "axis"), force), "self_gap": (("time", "edge"), gap)},
        {"time": TIME, "axis": ["x", "z"]},
    )


def test_contact_with_itself_has_its_times_force_and_gap():
    run = Run(touching())
    assert has_contact(run)
    assert not has_contact(Run(touching().drop_vars("self_force")))
    when, pressed, apart = contact_chart(run).panels
    (row,) = when.rows
    assert row.name == "the arm itself: 1 s"
    assert row.spans == pytest.approx(np.array([[1.0, 2.0]]))
    assert pressed.traces[0].values[-1] == pytest.approx(3.0)  # the two press once
    assert apart.traces[0].values.min() == pytest.approx(4e-4)


def test_contact_with_itself_is_measured_and_in_the_table():
    result = made_result(Scenario(arm={"nodes": 6}, simulation={"duration": 2.0}))
    run = RunStatistics(result)
    names = ("self_contact_time", "max_self_force", "min_self_gap")
    assert [MEASURES[name].read(run) for name in names] == [None] * 3
    contact = touching().interp(time=result.dataset["time"], method="nearest")
    result.dataset = xr.merge([result.dataset, contact.drop_vars("axis")], join="override")
    run = RunStatistics(result)
    assert [MEASURES[name].read(run) for name in names] == pytest.approx([1.0, 3.0, 4e-4])
    rows = {row[0]: row[1:] for row in summary(result).rows}
    assert rows["time in contact with itself"] == ["1 s"]
    assert rows["largest force on itself"] == ["3 N"]
    assert "smallest gap from hull" not in rows
