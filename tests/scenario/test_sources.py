"""Scenarios by name or file, and folders as text, wherever Python users give them."""

import re

import numpy as np
import pytest

import crinoid
from crinoid.results.result import ResultError
from crinoid.scenario.library import scenario_of
from crinoid.studies.comparison import ControllerComparison
from crinoid.studies.sweep.plan import SweepDesign
from crinoid.view.figures import write_page

SMALL = "[arm]\nnodes = 4\n[simulation]\nduration = 0.05\n"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("sources") / "arm.toml"
    path.write_text(SMALL)
    return path


@pytest.fixture(scope="module")
def result(path):
    return crinoid.simulate(str(path))


def test_a_scenario_may_be_given_by_name_or_by_file(path):
    small = crinoid.Scenario.from_toml(SMALL)
    for source in (small, path, str(path)):
        assert scenario_of(source) == small
    assert scenario_of("floating") == crinoid.load("floating")


@pytest.mark.slow
def test_what_takes_a_scenario_takes_its_file(path, result):
    small = crinoid.Scenario.from_toml(SMALL)
    assert result.scenario == small
    assert crinoid.simulate(path).dataset.equals(result.dataset)
    resting = crinoid.equilibrium(path)
    assert resting.scenario.arm == small.arm
    assert crinoid.system(path).reference.nodes == 4
    assert float(crinoid.parameters(path).arm.length) == small.arm.length
    _, state = crinoid.closed_loop(str(path))
    np.testing.assert_allclose(
        state.motion.position[2:], resting.dataset["position"][0, 1:] + [0.0, 10.0], atol=1e-9
    )
    assert crinoid.modes(path, count=2).sizes["mode"] == 2
    assert crinoid.simulate_batch(path, seeds=1).sizes["run"] == 1
    assert ControllerComparison(str(path), ["none"], [0]).scenario == small
    assert SweepDesign.of(str(path), ["arm.length=0.4,0.5"]).runs == 2


def test_folders_may_be_text(result, tmp_path):
    folder = str(tmp_path / "out")
    assert [each.name for each in result.save(folder)] == ["result.nc"]
    again = crinoid.Result.load(folder)
    assert again.scenario == result.scenario
    assert again.dataset.equals(result.dataset)
    assert write_page(folder).name == "report.html"
    with pytest.raises(ResultError, match="no such result"):
        crinoid.Result.load(f"{folder}/nowhere")


def test_settings_may_be_a_mapping():
    listed = crinoid.load("floating", ["arm.length=0.3", "control.controlled=['x']"])
    values = {"arm.length": 0.3, "control.controlled": ["x"]}
    assert crinoid.load("floating", values) == listed
    with pytest.raises(crinoid.ScenarioError, match=r"^arm.lengt: unknown key; did you mean"):
        crinoid.load("floating", {"arm.lengt": 0.3})


def test_what_is_no_scenario_is_refused_in_one_line():
    line = "scenario: got 5; must be a Scenario, the name of a built-in one, or the path of"
    with pytest.raises(crinoid.ScenarioError, match=re.escape(line)):
        scenario_of(5)
