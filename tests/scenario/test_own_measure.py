"""Measures of packages: which functions a scenario may name, and which numbers they may return."""

import sys

import numpy as np
import pytest
import xarray as xr

from crinoid.results.metrics import MEASURES, measures_of
from crinoid.scenario import Scenario, ScenarioError
from helpers.refusals import mistake

PACKAGE = '''
import numpy as np

def reach(run):
    """How far it came.

    More words.
    """
    return run["x"].max()

reach.units = "m"

def span(run):
    return np.ptp(run["x"].values)

span.long_name = "from end to end"
span.units = "m"

def plain(run): return 3
def nothing(run): return None
def rms_error(run): return 1.0
def array(run): return run["x"].values
def nan(run): return float("nan")
def broken(run): return run["tip"]
def unit(run): return 1.0
unit.units = 3
'''
RUN = xr.Dataset({"x": ("time", [0.5, 2.0, 1.0])})


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Install the package for the time of a test."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "reefs.py").write_text(PACKAGE)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    sys.modules.pop("reefs", None)  # of another test
    yield
    sys.modules.pop("reefs", None)


def measures(*names):
    scenario = Scenario(output={"measures": [f"reefs:{name}" for name in names]})
    return {name: each for name, each in measures_of(scenario).items() if name not in MEASURES}


@pytest.mark.usefixtures("package")
def test_a_measure_has_the_name_unit_and_meaning_of_its_function():
    found = measures("reach", "span", "plain")
    assert [(name, each.unit, each.meaning) for name, each in found.items()] == [
        ("reach", "m", "How far it came"),
        ("span", "m", "from end to end"),
        ("plain", "1", "plain"),
    ]
    scenario = Scenario(output={"measures": ["reefs:reach"]})
    assert Scenario.from_toml(scenario.to_toml()) == scenario


@pytest.mark.usefixtures("package")
def test_it_returns_a_finite_number_or_none():
    scenario = Scenario(output={"measures": [f"reefs:{n}" for n in ("reach", "span", "nothing")]})
    own = scenario.output.own_measures(())
    assert [own[name].of(RUN) for name in ("reach", "span", "nothing")] == [2.0, 1.5, None]
    assert type(own["span"].of(RUN)) is float


@pytest.mark.usefixtures("package")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("array", "returned an array of shape (3,); must return a finite number, or None"),
        ("nan", "returned nan; must return a finite number, or None"),
        ("broken", "failed: KeyError: "),
    ],
)
def test_anything_else_is_one_line(name, words):
    own = Scenario(output={"measures": [f"reefs:{name}"]}).output.own_measures(())
    with pytest.raises(ScenarioError) as caught:
        own[name].of(RUN)
    (line,) = caught.value.lines
    assert line.startswith(f"output.measures.0: {name} of the run {words}")


@pytest.mark.usefixtures("package")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("reefs:fathom", "AttributeError: module 'reefs' has no attribute 'fathom'"),
        ("reefs:unit", "TypeError: its attributes units and long_name must be texts"),
        ("reefs:rms_error", "must name a function whose name no other measure has"),
        ("os:getcwd", "ImportError: os is a part of Python"),
    ],
)
def test_a_function_that_cannot_be_used_is_named(name, words):
    with pytest.raises(ScenarioError) as caught:
        measures_of(Scenario(output={"measures": [name]}))
    (line,) = caught.value.lines
    assert line.startswith(f'output.measures.0: got "{name}"; must ')
    assert words in line


def test_a_module_of_the_working_directory_is_no_package(tmp_path, monkeypatch):
    (tmp_path / "local_reef.py").write_text("raise SystemExit('imported')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    with pytest.raises(ScenarioError, match="no installed package is named 'local_reef'"):
        measures_of(Scenario(output={"measures": ["local_reef:reach"]}))


def test_reading_a_scenario_imports_nothing_and_checks_the_form():
    assert Scenario(output={"measures": ["nowhere.at:all"]}).output.measures == ("nowhere.at:all",)
    line = mistake(Scenario, output={"measures": ["reefs.reach"]})
    assert line == 'output.measures.0: got "reefs.reach"; must be text as module:function'


@pytest.mark.usefixtures("package")
def test_a_number_of_numpy_is_a_number():
    (own,) = Scenario(output={"measures": ["reefs:plain"]}).output.own_measures(()).values()
    for given in (np.float32(2.0), np.int64(2), np.array(2.0), xr.DataArray(2.0)):
        assert own._replace(function=lambda run, given=given: given).of(RUN) == 2.0
