"""Text of a scenario with other numbers: comments stay, and it reads back as the scenario meant."""

import pytest
import tomlkit

from crinoid.scenario import Scenario, ScenarioText, builtin_names, builtin_text

ODD = """\
# what it is
title = "odd"   # a title
arm.length = 0.5 # dotted
flow = [
  {kind="uniform", velocity=[0.1, 0.2]}, # first
  {kind="uniform", velocity=[0.1,
     0.3 # inner
  ]},
]
[control] # out of order
kind="pid"
[control.pid]
slide = {kp = 0.1, ki = 1.0}
[base.channels.slide]
[[load]]
kind="tip"
force = [0.0, 1.0]   # N
[arm.section] # between the loads
EI = 0.2
[[load]]
kind="tip"
force = [0.0, 2.0]   # second
"""


# commands of one case refuse a study
@pytest.mark.parametrize("name", [name for name in builtin_names() if name != "constant-load"])
def test_numbers_change_and_comments_stay(name):
    text = ScenarioText(name, ["water.drag_normal=1.3"])
    values = {"arm.density": 1111.0, "arm.damping_time": 0.07}
    found = text.with_values(values, "numbers by me")
    assert Scenario.from_toml(found) == text.scenario.with_values(values)
    given = builtin_text(name).splitlines()
    comments = {line.partition("#")[2] for line in given}
    assert comments <= {line.partition("#")[2] for line in found.splitlines()}
    assert found.startswith("# numbers by me\n")
    # lines that nothing changes are there in their order
    kept = [line for line in given if "density" not in line and "damping_time" not in line]
    lines = iter(found.splitlines())
    moved = ("file =", "weights =", "drag_normal")
    assert all(line in lines for line in kept if line and not line.startswith(moved))


def test_every_form_of_toml_keeps_its_comments(tmp_path):
    path = tmp_path / "odd.toml"
    path.write_text(ODD)
    settings = ['load.2={kind="tip",force=[0.0,0.1]}', "seed=4", "simulation.duration=3"]
    text = ScenarioText(path, settings)
    values = {
        "arm.length": 0.55,
        "arm.density": 1000.0,
        "arm.section.EI": 0.31,
        "flow.1.velocity.1": 0.25,
        "control.pid.slide.ki": 0.5,
        "load.1.force.1": 2.5,
        "load.2.force.0": 0.01,
    }
    found = text.with_values(values, "odd")
    assert Scenario.from_toml(found) == text.scenario.with_values(values)
    for line in ("arm.length = 0.55 # dotted", "     0.25 # inner", "[arm.section] # between"):
        assert line in found
    assert "slide = {kp = 0.1, ki = 0.5}" in found
    assert "velocity=[0.1, 0.2]}, # first" in found
    assert 'title = "odd"   # a title' in found


def test_a_relative_file_is_absolute_in_the_new_text(tmp_path):
    (tmp_path / "current.csv").write_text("time,u\n0,0.1\n1,0.2\n")
    path = tmp_path / "own.toml"
    path.write_text('[[flow]]\nkind = "measured"\nfile = "current.csv" # mine\n')
    text = ScenarioText(path)
    found = text.with_values({"arm.length": 0.4}, "far away")
    assert f'file = "{tmp_path / "current.csv"}" # mine' in found
    assert Scenario.from_toml(found) == text.scenario.with_values({"arm.length": 0.4})


def test_a_text_that_reads_back_as_another_scenario_is_not_written(monkeypatch):
    """Rather without comments than wrong: a writer of TOML may have faults."""
    monkeypatch.setattr(tomlkit, "dumps", lambda document: "[arm]\nlength = 7.0\n")
    text = ScenarioText("curl")
    found = text.with_values({"arm.length": 0.6}, "numbers")
    assert Scenario.from_toml(found) == text.scenario.with_values({"arm.length": 0.6})
