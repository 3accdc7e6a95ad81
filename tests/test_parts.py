"""Parts of a user's own in `crinoid.simulate`: what goes wrong with them is told."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.parts import Parts
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.sensor import build_sensors
from crinoid.dynamics import Reason
from crinoid.elements import DistributedLoad
from crinoid.status import Status
from physics import arm

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
        late = jnp.abs(seen.time - seen.taken)
        command = jnp.zeros_like(seen.command).at[0].set(slide)
        return command, jnp.stack([calls, jnp.maximum(memory[1], late)])


@pytest.fixture(scope="module")
def failed():
    with pytest.raises(crinoid.SimulationError) as caught:
        crinoid.simulate(SCENARIO, controller=Scripted())
    return caught.value.result


def test_a_command_that_is_no_number_is_told_with_its_input(failed):
    assert failed.status == (
        "failed at t = 0.25 s: the controller commanded nan for slide, which is no number"
    )


def test_a_controller_is_called_when_it_is_due_and_its_command_cut_off(failed):
    # from 0.1 s on, 20 times a second: at 0.1, 0.15, 0.2 and 0.25
    np.testing.assert_array_equal(failed.checkpoint["memory"], [4.0, 0.0])
    command = failed.dataset["base_command"].sel(channel="slide")
    time = command["time"].values
    np.testing.assert_array_equal(command.values[time < 0.105], 0.0)
    np.testing.assert_allclose(command.values[(time > 0.115) & (time < 0.245)], 0.1)


def test_the_result_says_that_the_controller_was_passed(failed):
    assert failed.scenario.control.kind == "custom"
    with pytest.raises(crinoid.ScenarioError, match="which takes a controller passed"):
        crinoid.simulate(failed.scenario)


def test_an_element_that_does_not_fit_is_refused():
    rod = crinoid.system(SCENARIO.with_values({"arm.nodes": 9})).reference
    load = DistributedLoad(1, *[jnp.zeros(8)] * 2, jnp.zeros((8, 2)), crinoid.Onset.of(shape=(8,)))
    assert rod.nodes == 9
    line = r"DistributedLoad \(element 6\): got 8 windows of 2 nodes from node 1 on; must be within"
    with pytest.raises(crinoid.ScenarioError, match=line):
        _ = Prepared(SCENARIO, Parts(elements=(load,))).system


def test_gradients_take_parts():
    class Flood(crinoid.Flow):
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


@pytest.mark.parametrize("iterations", [1, 20])
def test_a_step_can_raise_where_it_does_not_count(iterations):
    system = arm(nodes=3, gravity=9.81, max_iterations=iterations, tolerance=1e-12)
    command = jnp.zeros(len(system.inputs))
    advance = eqx.filter_jit(lambda s, h: s.step(s.rest(), command, h, throw=True))
    step = jnp.asarray(0.05)
    if iterations == 20:
        _, outcome = advance(system, step)
        assert Reason(int(outcome.reason)) is Reason.NONE
        return
    with pytest.raises(Exception, match="Newton's method found no balance of forces"):
        jax.block_until_ready(advance(system, step))
    _, outcome = eqx.filter_jit(lambda s, h: s.step(s.rest(), command, h))(system, step)
    assert Reason(int(outcome.reason)) is Reason.IMBALANCE


def test_a_status_is_told_by_its_first_word():
    assert Status.of("failed at t = 1 s: too fast") is Status.FAILED
    assert Status.of("ok") is Status.OK
    assert Status.of("done") is None
    assert Status.of(None) is None


class Broken(crinoid.Flow):
    """A flow that is no number from a time on."""

    onset: crinoid.Onset

    def fully_on(self, point, time):
        return jnp.where(time > 0.155, jnp.nan, 0.0) * jnp.ones(2)


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
    table = {"kind": "wrench", "name": "range"}
    watched = SCENARIO.with_values({"sensors": [table]})
    (_, sensor) = build_sensors(watched)
    again = eqx.tree_at(lambda s: s.delay, sensor, jnp.asarray(0.0))
    again = replace(again, name=name)
    with pytest.raises(ValueError, match=f"two sensors are called {name}"):
        crinoid.simulate(watched, sensors=[again])
