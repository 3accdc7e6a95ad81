"""Means over seeds, paired differences and extremes: those of textbooks, and of made-up samples."""

import numpy as np
import pytest
from scipy import stats

from crinoid.results.extremes import Gumbel
from crinoid.results.metrics import MEASURES
from crinoid.studies.statistics import differences, means_of, records, row_means, seed_means


def test_the_interval_of_a_mean_is_that_of_student():
    # Student's own example of 1908: extra hours of sleep of ten patients by the second drug
    hours = np.array([1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4])
    mean = row_means(np.append(hours, np.nan)[None])
    assert mean.runs == 10
    assert mean.value == pytest.approx(2.33)
    expected = stats.ttest_1samp(hours, 0.0).confidence_interval(0.95)
    assert (mean.low[0], mean.high[0]) == pytest.approx(expected)
    assert np.isnan(row_means(hours[None, :1]).half)
    assert row_means(hours[None, :0]).runs == 0


def test_intervals_hold_the_mean_as_often_as_they_say():
    rng = np.random.default_rng(0)
    found = row_means(rng.normal(3.0, 2.0, (2000, 4)))
    held = (found.low <= 3.0) & (found.high >= 3.0)
    assert np.mean(held) == pytest.approx(0.95, abs=0.015)


def test_means_are_those_of_the_known_values_at_each_place():
    rng = np.random.default_rng(3)
    values, place = rng.random(300), rng.integers(0, 9, 300)
    values[rng.random(300) < 0.2] = np.nan
    values[place == 4] = np.nan
    found = means_of(values, place, 9)
    for at in range(9):
        some = values[(place == at) & np.isfinite(values)]
        assert found.runs[at] == some.size
        if at == 4:
            assert np.isnan(found.value[at])
            continue
        assert found.value[at] == some.mean()  # to the bit
        ends = stats.ttest_1samp(some, 0.0).confidence_interval(0.95)
        assert (found.low[at], found.high[at]) == pytest.approx(ends)


def test_a_difference_is_that_of_pairs():
    rng = np.random.default_rng(1)
    seeds = rng.normal(10.0, 5.0, 8)
    one, other = seeds + rng.normal(0.3, 0.2, 8), seeds + rng.normal(0.0, 0.2, 8)
    other[3] = np.nan
    known = np.isfinite(other)
    means, p_values = differences(np.stack([one, other]), other)
    expected = stats.ttest_rel(one[known], other[known])
    assert p_values[0] == pytest.approx(expected.pvalue)
    ends = means.low[0], means.high[0]
    assert ends == pytest.approx(expected.confidence_interval(0.95))
    assert means.runs[0] == 7
    assert p_values[0] < 0.05 < stats.ttest_ind(one[known], other[known]).pvalue
    assert means.value[1] == 0.0
    assert np.isnan(p_values[1])
    assert np.isnan(differences(one[None, :1], other[:1])[1])


def test_means_are_over_the_seeds_of_each_combination():
    rng = np.random.default_rng(2)
    varied = [{"a": a, "b": [1.0, b], "seed": s} for a in (1, 2) for b in (3, 4) for s in range(12)]
    numbers = {
        "rms_error": rng.random(48),
        "max_error": rng.gumbel(1.0, 0.2, 48),
        "deflection": np.full(48, np.nan),
    }
    numbers["rms_error"][5] = np.nan
    found = records(seed_means(varied, numbers, MEASURES))
    assert [(each["a"], each["b"][1], each["measure"]) for each in found] == [
        (a, b, name) for a in (1, 2) for b in (3, 4) for name in ("rms_error", "max_error")
    ]
    first = row_means(numbers["rms_error"][None, :12])
    assert [found[0][end] for end in ("runs", "mean", "low", "high")] == [
        *(11, first.value[0], first.low[0], first.high[0]),
    ]
    assert found[0]["extreme"] is None
    expected = Gumbel(numbers["max_error"][12:24]).return_level(100)
    assert (found[3]["extreme"], found[3]["extreme_low"], found[3]["extreme_high"]) == expected
    row = found[3]
    assert {"a": 1, "b": [1.0, 4], "measure": "max_error", "units": "m"}.items() <= row.items()
    assert row["low"] < row["mean"] < row["high"] < row["extreme"] < row["extreme_high"]


def test_without_seeds_there_are_means_of_a_grid_only():
    grid = [{"a": a, "b": b} for a in (1, 2) for b in (3, 4)]
    found = seed_means(grid, {"rms_error": np.arange(4.0)}, MEASURES)
    assert found["mean"].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert found["low"].isna().all()
    assert seed_means(grid[:3], {"rms_error": np.arange(3.0)}, MEASURES).empty
    assert seed_means(grid[:1], {"rms_error": np.arange(1.0)}, MEASURES).empty


def test_seeds_alone_give_one_combination():
    (row,) = records(
        seed_means([{"seed": 0}, {"seed": 1}], {"work": np.array([1.0, 3.0])}, MEASURES)
    )
    assert list(row)[:4] == ["measure", "units", "runs", "mean"]
    assert (row["runs"], row["mean"]) == (2, 2.0)
