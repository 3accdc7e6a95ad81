"""Real numbers of scenarios, with their keys, units and meanings."""

import pytest

from crinoid.scenario import builtin_names, load
from crinoid.scenario.document import value_at
from crinoid.scenario.kinds import unit_at
from crinoid.scenario.real_numbers import real_numbers
from crinoid.scenario.scenario import scenario_schema


@pytest.mark.parametrize("name", builtin_names())
def test_real_numbers_have_the_values_and_units_of_their_keys(name):
    scenario = load(name)
    found = {each.key: each for each in real_numbers(scenario)}
    document = scenario.to_dict()
    for key, each in found.items():
        assert (type(each.value), each.value) == (float, value_at(document, key))
        assert each.meaning
    for key in ("arm.length", "base.position.1", "water.density", "water.drag_normal"):
        assert found[key].unit == unit_at(scenario_schema(), key)
    # a change of all by key gives the scenario again
    assert scenario.with_values({key: each.value for key, each in found.items()}) == (
        scenario.with_values({})
    )


def test_words_whole_numbers_and_long_lists_are_none():
    keys = {each.key for each in real_numbers(load("octopus"))}
    assert {"chamber.0.area", "chamber.0.max_pressure", "chamber.0.span.1"} <= keys
    assert not {"arm.nodes", "seed", "base.mount", "chamber.0.schedule.time.0"} & keys
    assert value_at(load("octopus").to_dict(), "chamber.0.schedule.time.3") is not None
