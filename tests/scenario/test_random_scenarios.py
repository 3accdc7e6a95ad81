"""Any scenario reads back as it was written."""

import random

import pytest

import crinoid
from crinoid.scenario import Scenario, ScenarioError, builtin_names
from helpers.random_scenarios import drawn, kinds, traits


@pytest.mark.slow
def test_any_scenario_reads_back_as_it_was_written():
    # every kind of motion with every channel would need thousands of scenarios
    wanted, seen = {kind for kind in kinds() if ".channel " not in kind}, set()
    wanted.remove("water.vortices.model none")  # it leaves the table out
    builtin = [crinoid.load(name) for name in builtin_names()]  # few draws suit `hybrid`
    for seed in range(-len(builtin), 2000):
        if seed >= 80 and wanted <= seen:
            break
        scenario = drawn(random.Random(seed)) if seed >= 0 else builtin[seed]
        if scenario is None:
            continue
        seen.update(traits(scenario))
        text = scenario.to_toml()
        again = Scenario.from_toml(text)
        assert again == scenario, f"seed {seed}:\n{text}"
        assert again.to_toml() == text
    assert wanted <= seen


def test_what_text_cannot_hold_is_refused_before_it_is_run():
    with pytest.raises(ScenarioError, match="got a scenario that TOML cannot hold; must read back"):
        crinoid.system(Scenario(title="\ud800"))
