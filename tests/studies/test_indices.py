"""Sobol's indices of a sweep, against those of a function that are known."""

import numpy as np
import pytest

from crinoid.scenario.library import load
from crinoid.studies.sweep.plan import SweepDesign
from crinoid.studies.sweep.sampling import indices_of

pytest.importorskip("SALib", reason="needs SALib")
KEYS = ("arm.length", "arm.radius", "water.density")
KNOWN = {"first": (0.3139, 0.4424, 0.0), "total": (0.5576, 0.4424, 0.2437)}
"""Indices of Ishigami's function with a = 7 and b = 0.1 (Ishigami and Homma 1990)."""


@pytest.fixture(scope="module")
def plan():
    spans = ["arm.length=0.4:0.6", "arm.radius=0.01:0.02", "water.density=1000.0:1030.0"]
    return SweepDesign.of(load("still-water"), spans, sampling="saltelli", count=1024, seeds=2)


@pytest.fixture(scope="module")
def values(plan):
    """Return Ishigami's function of the parts of ranges, and a little more for the second seed."""
    found = []
    for run in range(1, plan.runs + 1):
        values = plan.values(run)
        spans = [plan.varied[key] for key in KEYS]
        low, high = (np.array([span.at(part) for span in spans]) for part in (0.0, 1.0))
        x = np.pi * (2 * (np.array([values[key] for key in KEYS]) - low) / (high - low) - 1)
        y = np.sin(x[0]) + 7 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])
        found.append(y + 0.1 * (values["seed"] - 0.5))
    return np.array(found)


def test_points_come_in_blocks_that_change_one_number_each(plan):
    assert plan.runs == 1024 * (3 + 2) * 2
    points = plan.by_point(1.0 * np.arange(plan.runs))
    assert points.shape == (1024 * 5, 2)
    block = np.array([[plan.values(int(run) + 1)[key] for key in KEYS] for run in points[:5, 0]])
    first, last = block[0], block[4]
    for number in range(3):
        expected = np.where(np.arange(3) == number, last, first)
        np.testing.assert_array_equal(block[number + 1], expected)


def test_indices_are_those_of_a_function_that_is_known(plan, values):
    found = indices_of(plan.sampled, plan.by_point(values))
    assert [index.key for index in found] == list(KEYS)
    for index, first, total in zip(found, *KNOWN.values(), strict=True):
        assert index.first == pytest.approx(first, abs=0.02)
        assert index.total == pytest.approx(total, abs=0.02)
        assert abs(index.first - first) <= 1.5 * index.first_within
        assert abs(index.total - total) <= 1.5 * index.total_within
    assert found == indices_of(plan.sampled, plan.by_point(values))
    # blocks with an unknown run are left out
    some = values.copy()
    some[[3, 777]] = np.nan
    for one, other in zip(found, indices_of(plan.sampled, plan.by_point(some)), strict=True):
        assert one.first == pytest.approx(other.first, abs=0.03)
    assert indices_of(plan.sampled, plan.by_point(np.full_like(values, np.nan))) == []
    assert indices_of(plan.sampled, plan.by_point(np.ones_like(values))) == []
