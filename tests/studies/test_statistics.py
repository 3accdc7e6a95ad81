"""Means over seeds, paired differences and extremes: those of textbooks, and of made-up samples."""

import numpy as np
import pytest
from scipy import stats

from crinoid.results.extremes import Gumbel
from crinoid.results.metrics import MEASURES
from crinoid.studies.statistics import Difference, Mean, mean_row, seed_means


def test_the_interval_of_a_mean_is_that_of_student():
    # Student's own example of 1908: extra hours of sleep of ten patients by the second drug
    hours = np.array([1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4])
    mean = Mean.of(np.append(hours, np.nan))
    assert mean.seeds == 10
    assert mean.value == pytest.approx(2.33)
    expected = stats.ttest_1samp(hours, 0.0).confidence_interval(0.95)
    assert mean[1:3] == pytest.approx(expected)
    assert np.isnan(Mean.of(hours[:1]).half)
    assert Mean.of(hours[:0]).seeds == 0


def test_intervals_hold_the_mean_as_often_as_they_say():
    rng = np.random.default_rng(0)
    found = [Mean.of(rng.normal(3.0, 2.0, 4)) for _ in range(2000)]
    assert np.mean([each.low <= 3.0 <= each.high for each in found]) == pytest.approx(
        0.95, abs=0.015
    )


def test_a_difference_is_that_of_pairs():
    rng = np.random.default_rng(1)
    seeds = rng.normal(10.0, 5.0, 8)
    one, other = seeds + rng.normal(0.3, 0.2, 8), seeds + rng.normal(0.0, 0.2, 8)
    other[3] = np.nan
    known = np.isfinite(other)
    found, expected = Difference.of(one, other), stats.ttest_rel(one[known], other[known])
    assert found.p_value == pytest.approx(expected.pvalue)
    assert found.mean[1:3] == pytest.approx(expected.confidence_interval(0.95))
    assert found.mean.seeds == 7
    assert found.p_value < 0.05 < stats.ttest_ind(one[known], other[known]).pvalue
    alone = Difference.of(one, one)
    assert alone.mean.value == 0.0
    assert np.isnan(alone.p_value)
    assert np.isnan(Difference.of(one[:1], other[:1]).p_value)


def test_means_are_over_the_seeds_of_each_combination():
    rng = np.random.default_rng(2)
    varied = [{"a": a, "b": [1.0, b], "seed": s} for a in (1, 2) for b in (3, 4) for s in range(12)]
    numbers = {
        "rms_error": rng.random(48),
        "max_error": rng.gumbel(1.0, 0.2, 48),
        "deflection": np.full(48, np.nan),
    }
    numbers["rms_error"][5] = np.nan
    found = seed_means(varied, numbers)
    assert [(each.values["a"], each.values["b"][1], each.name) for each in found] == [
        (a, b, name) for a in (1, 2) for b in (3, 4) for name in ("rms_error", "max_error")
    ]
    assert found[0].mean == Mean.of(numbers["rms_error"][:12])
    assert found[0].mean.seeds == 11
    assert found[0].extreme is None
    assert found[3].extreme == Gumbel(numbers["max_error"][12:24]).return_level(100)
    row = mean_row(found[3], MEASURES["max_error"])
    assert {"a": 1, "b": [1.0, 4], "measure": "max_error", "units": "m"}.items() <= row.items()
    assert row["low"] < row["mean"] < row["high"] < row["extreme"] < row["extreme_high"]
    assert mean_row(found[0], MEASURES["rms_error"])["extreme"] == ""


def test_without_seeds_there_are_means_of_a_grid_only():
    grid = [{"a": a, "b": b} for a in (1, 2) for b in (3, 4)]
    found = seed_means(grid, {"rms_error": np.arange(4.0)})
    assert [each.mean.value for each in found] == [0.0, 1.0, 2.0, 3.0]
    assert all(np.isnan(each.mean.half) for each in found)
    assert seed_means(grid[:3], {"rms_error": np.arange(3.0)}) == []
    assert seed_means(grid[:1], {"rms_error": np.arange(1.0)}) == []
