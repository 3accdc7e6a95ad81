"""What built-in scenarios are there to show."""

import numpy as np
import pytest

import crinoid
from crinoid.results.effort import input_use
from crinoid.results.errors import angle_error, tip_error

STORED = ["kinetic", "elastic", "potential"]
"""Kinds of energy that are no works."""


def assert_held(result, channels):
    """The tip keeps its position and its direction, and all channels have a part in it."""
    assert result.dataset.attrs["status"] == "ok"
    for error in (tip_error, angle_error):
        held, free = error(result), error(result.uncontrolled)
        assert held.rms <= 0.20 * free.rms
        # far better than an arm that is only set once where the mean current carries it
        assert held.rms <= 0.25 * free.fluctuation
    use = input_use(result)
    assert list(use) == channels
    for name, (rms, low, high) in use.items():
        turns = name in ("pan", "tilt")
        assert rms > (np.deg2rad(1) if turns else 0.002)
        assert -low < (np.deg2rad(45) if turns else 0.15)
        assert high < (np.deg2rad(45) if turns else 0.15)


def imbalance(data):
    """Return by how much the energy ledger is out, as a share of the largest work."""
    change = data["energy"] - data["energy"].isel(time=0)
    works = change.drop_sel(kind=STORED)
    defect = np.abs(change.sel(kind=STORED).sum("kind") - works.sum("kind"))
    return float(defect.max() / np.abs(works).max())


def besides_lock_in(result):
    """Return the notes of a run besides that on vortices, in whose range most currents are."""
    return [note for note in result.notes if not note.startswith("vortex shedding may lock in")]


def assert_traced(name, **changes):
    """The tip is near its target on a circle, and would be far behind without feed-forward."""
    scenario = crinoid.load(name, ["control.compare=false"]).with_values(changes)
    result = crinoid.simulate(scenario)
    assert besides_lock_in(result) == []
    traced = tip_error(result)
    assert traced.rms < 0.005
    # all the way round, 50 mm from its middle
    target = result.dataset["tip_target"].sel(time=slice(2.0, 22.0)).values
    assert np.linalg.norm(target - target.mean(axis=0), axis=1) == pytest.approx(0.05, rel=0.02)
    behind = tip_error(crinoid.simulate(scenario.with_values({"target.feed_forward": False})))
    assert behind.rms > 2 * traced.rms
    assert behind.rms > 0.008
