"""Parts of a user's own in `crinoid.simulate`: what goes wrong with them is told."""

import re
from dataclasses import replace
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.control_loop import build_sensors
from crinoid.assembly.plan import Parts
from crinoid.assembly.prepared import Prepared
from crinoid.dynamics import Reason
from crinoid.scenario.kinds import installed
from helpers.arms import arm
from helpers.paths import ROOT
from helpers.refusals import mistake

SCENARIO = crinoid.Scenario(
    arm={"nodes": 4},
    base={"channels": {"slide": {"range": [-0.1, 0.1]}, "tilt": {}}},
    control={"compare": False, "rate_hz": 20.0, "start": 0.1},
    simulation={"duration": 0.4},
    output={"interval": 0.01},
)


class Scripted(crinoid.Controller):
    """Counts its calls, asks for too much at first, and for what is no number at the end."""

    def start(self, seen):
        return jnp.zeros(2)

    def command(self, memory, seen):
        calls = memory[0] + 1
        slide = jnp.where(calls < 4, 5.0, jnp.nan)
        late = jnp.abs(seen.time - seen.measurement_time)
        command = jnp.zeros_like(seen.command).at[0].set(slide)
        return command, jnp.stack([calls, jnp.maximum(memory[1], late)])


@pytest.mark.slow
def test_a_passed_controller_is_called_when_due_and_named_where_it_fails():
    with pytest.raises(crinoid.SimulationError) as caught:
        crinoid.simulate(SCENARIO, controller=Scripted())
    failed = caught.value.result
    assert failed.status == (
        "failed at t = 0.25 s: the controller commanded nan for slide, which is no number"
    )
    # from 0.1 s on, 20 times a second: at 0.1, 0.15, 0.2 and 0.25
    np.testing.assert_array_equal(failed.checkpoint["memory"], [4.0, 0.0])
    command = failed.dataset["base_command"].sel(channel="slide")
    time = command["time"].values
    np.testing.assert_array_equal(command.values[time < 0.105], 0.0)
    np.testing.assert_allclose(command.values[(time > 0.115) & (time < 0.245)], 0.1)
    # the result says that it was passed
    assert failed.scenario.control.kind == "custom"
    with pytest.raises(crinoid.ScenarioError, match="which requires a controller"):
        crinoid.simulate(failed.scenario)


def test_gradients_reach_the_numbers_of_a_part():
    class Flood(crinoid.Flow):
        steady: ClassVar[bool] = True
        onset: crinoid.Onset
        speed: jax.Array

        def fully_on(self, point, time):
            return self.speed * jnp.array([1.0, 0.0])

    flow = Flood(crinoid.Onset.of(), jnp.asarray(0.2))
    system = Prepared(SCENARIO, Parts(flows=(flow,))).system

    def speed(value):
        flows = eqx.tree_at(lambda s: s.forces.water.flows[0].speed, system, value)
        return flows.forces.water.velocity(jnp.zeros(2), jnp.asarray(0.0))[0]

    assert float(jax.grad(speed)(jnp.asarray(0.3))) == 1.0


@pytest.mark.slow
def test_a_step_can_raise_where_it_does_not_count():
    @eqx.filter_jit
    def advance(system, *, throw):
        command = jnp.zeros(len(system.inputs))
        return system.step(system.rest(), command, jnp.asarray(0.05), throw=throw)

    def reason(iterations, *, throw):
        system = arm(nodes=3, gravity=9.81, max_iterations=iterations, tolerance=1e-12)
        return Reason(int(advance(system, throw=throw)[1].reason))

    assert reason(20, throw=True) is Reason.NONE
    assert reason(1, throw=False) is Reason.IMBALANCE
    with pytest.raises(Exception, match="Newton's method did not converge"):
        reason(1, throw=True)


class Broken(crinoid.Flow):
    """A flow that is no number from a time on."""

    steady: ClassVar[bool] = False
    onset: crinoid.Onset

    def fully_on(self, point, time):
        return jnp.where(time > 0.155, jnp.nan, 0.0) * jnp.ones(2)


@pytest.mark.slow
def test_a_flow_that_is_no_number_fails_and_keeps_what_was_computed():
    line = (
        r"failed at t = 0\.155 s: test_parts:Broken \(flow 0\) gives a velocity that is not finite"
    )
    with pytest.raises(crinoid.SimulationError, match=line) as caught:
        crinoid.simulate(SCENARIO, flows=[Broken(crinoid.Onset.of())])
    data = caught.value.result.dataset
    assert 0.15 < data["time"][-1] <= 0.155  # as far as shorter steps got
    assert np.isfinite(data["position"]).all()


@pytest.mark.parametrize("name", ["tip", "range"])
def test_two_sensors_of_one_name_are_refused(name):
    watched = SCENARIO.with_values({"sensors": [{"kind": "wrench", "name": "range"}]})
    (_, sensor) = build_sensors(watched)
    with pytest.raises(ValueError, match=f"two sensors are called {name}"):
        crinoid.simulate(watched, sensors=[replace(sensor, name=name)])


HOLD = """
import jax
import jax.numpy as jnp

import crinoid
from crinoid.tables import ControllerTable, Metres, Mistake, got


class Hold(crinoid.Controller):
    held: jax.Array

    def start(self, seen):
        return None

    def command(self, memory, seen):
        return self.held, None


class HoldTable(ControllerTable):
    height: Metres = 0.05
    observes = feeds_forward = False

    def drives(self, inputs):
        return tuple(name for name in inputs if name == "heave")

    def conflicts(self, scenario):
        if not scenario.driven:
            yield Mistake("control.kind", got("hold", "have base.channels.heave"))

    def build(self, plan):
        names = [each.name for each in plan.inputs]
        return Hold(jnp.array([self.height * (name in plan.scenario.driven) for name in names]))
"""
HELD = """
arm.nodes = 4
base.channels = {slide = {}, heave = {}}
target = {path = "line", velocity = [0.01, 0.0]}
control = {kind = "hold", compare = false, hold = {height = 0.02}}
simulation.duration = 0.6
"""


def test_a_controller_of_a_package_is_one_file_and_one_row(tmp_path, monkeypatch):
    package = tmp_path / "holding-1.dist-info"
    package.mkdir()
    (tmp_path / "holding.py").write_text(HOLD)
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: holding\nVersion: 1\n")
    (package / "entry_points.txt").write_text("[crinoid.controllers]\nhold = holding:HoldTable\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    installed.cache_clear()
    try:
        file = tmp_path / "held.toml"
        file.write_text(HELD)
        scenario = crinoid.load(file)
        assert scenario.driven == ("heave",)
        assert crinoid.Scenario.from_toml(scenario.to_toml()) == scenario
        for setting, line in {
            "base.channels={slide={}}": 'kind: got "hold"; must have base.channels.heave',
            "control.hold.height='high'": 'hold.height: got "high"; must be a number (m)',
        }.items():
            assert mistake(crinoid.load, file, [setting]) == f"control.{line}"
        # without an observer it has no estimate to save
        line = mistake(crinoid.load, file, ["output.variables=['estimated_position']"])
        assert line.startswith("output.variables.0")
        servo = crinoid.simulate(scenario).dataset["base_servo"].isel(time=-1)
        # the target moves, but this kind adds no feed-forward
        assert float(servo.sel(channel="slide")) == 0.0
        assert float(servo.sel(channel="heave")) == pytest.approx(0.02, abs=1e-4)
    finally:
        installed.cache_clear()


def test_kinds_of_controllers_are_compared_only_where_they_are_declared():
    known = {"scenario/control.py", "scenario/controller.py"}
    compared = re.compile(r"match .*control\.kind\b|control\.kind\s*(==|!=|in\b|not in\b)")
    source = ROOT / "src" / "crinoid"
    others = [
        name
        for file in sorted(source.rglob("*.py"))
        if (name := file.relative_to(source).as_posix()) not in known
        and compared.search(file.read_text())
    ]
    assert not others
