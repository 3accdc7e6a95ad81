"""Any scenario reads back as it was written."""

import random

import pytest
from hypothesis import assume, example, given, note, settings
from hypothesis import strategies as st

import crinoid
from crinoid.scenario import Scenario, ScenarioError
from random_scenarios import drawn, kinds, runnable, traits


def test_any_scenario_reads_back_as_it_was_written():
    seen = set()

    @settings(max_examples=200, derandomize=True, deadline=None)
    @given(st.integers(0, 2**64))
    @example(669)  # of what is rarely drawn, a hybrid controller
    def reads_back(seed):
        scenario = drawn(random.Random(seed))
        assume(scenario is not None)
        seen.update(traits(scenario))
        text = scenario.to_toml()
        note(text)
        again = Scenario.from_toml(text)
        assert again == scenario
        assert again.to_toml() == text

    reads_back()
    # every kind of motion with every channel would need some 1000
    assert {kind for kind in kinds() if ".channel " not in kind} <= seen


def test_small_scenarios_are_the_same_for_the_same_seed():
    text = runnable(1)
    assert text == runnable(1) != runnable(2)
    scenario = Scenario.from_toml(text)
    assert scenario.arm.nodes <= 7
    assert 0.2 <= scenario.simulation.duration <= 0.5


def test_what_text_cannot_hold_is_refused_before_it_is_run():
    with pytest.raises(ScenarioError, match="got a scenario that TOML cannot hold; must read back"):
        crinoid.system(Scenario(title="\ud800"))
