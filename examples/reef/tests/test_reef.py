"""The parts of the package, alone and in a run."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from crinoid_reef.measures import reach
from crinoid_reef.range import Range
from crinoid_reef.tether import Tether
from crinoid_reef.thruster import ThrusterParameters
from crinoid_reef.wash import Wash

import crinoid
from crinoid.results.metrics import measured
from crinoid.results.table import summary
from crinoid.scenario import json_schema

SCENARIO = Path(__file__).parents[1] / "reef.toml"


@pytest.fixture(scope="module")
def result():
    return crinoid.simulate(crinoid.load(SCENARIO))


def test_every_kind_is_taken_up_and_written_again():
    scenario = crinoid.load(SCENARIO)
    assert [each.kind for each in scenario.load] == ["tether"]
    assert crinoid.Scenario.from_toml(scenario.to_toml()) == scenario
    assert scenario.with_values({"load.0.stiffness": 0.3}).load[0].stiffness == 0.3


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        ("load.0.stiffness=-1", "load.0.stiffness: got -1; must be a number above 0 (N/m)"),
        ("load.0.stiffnes=1", "load.0.stiffnes: unknown key; did you mean load.0.stiffness?"),
        ("flow.0.width='wide'", 'flow.0.width: got "wide"; must be a number above 0 (m)'),
        ("sensors.0.noise=-1", "sensors.0.noise: got -1; must be a number of 0 or more (m)"),
        ("actuator.0.max_thrust=0", "actuator.0.max_thrust: got 0; must be a number above 0 (N)"),
        ("control.homing.rate=0", "control.homing.rate: got 0; must be a number above 0 (1/s)"),
        ("control.homing=3", "control.homing: got 3; must be a table"),
        (
            "actuator.0.name='slide'",
            'actuator.0.name: got "slide"; must differ from the name of a chamber, tendon or '
            "channel",
        ),
        (
            "load.0.kind='rope'",
            'load.0.kind: got "rope"; must be "distributed", "tether" or "tip". '
            "Other kinds come from installed packages.",
        ),
    ],
)
def test_a_mistake_gets_one_line(setting, line):
    with pytest.raises(crinoid.ScenarioError) as caught:
        crinoid.load(SCENARIO, [setting])
    assert line in caught.value.lines


@pytest.mark.parametrize("key", ["sensor", "thruster"])
def test_the_controller_refuses_what_is_not_there(key):
    scenario = crinoid.load(SCENARIO, [f"control.homing.{key}='nope'"])
    with pytest.raises(
        crinoid.ScenarioError, match=f'control.homing.{key}: got "nope"; must be one'
    ):
        crinoid.simulate(scenario)


def test_the_schema_has_every_kind():
    tables = json_schema()["$defs"]
    for name in ("TetherLoad", "WashFlow", "RangeSensor", "ThrusterActuator", "HomingController"):
        assert name in tables
    assert "Unit: N/m." in tables["TetherLoad"]["properties"]["stiffness"]["description"]


def test_the_tether_lifts_a_cantilever():
    # k h / (k + 3 EI / L^3)
    stiffness, height, EI, length = 0.06, 1e-3, 0.01, 0.5
    beam = crinoid.Scenario(
        arm={"nodes": 11, "length": length, "section": {"EI": EI, "EA": 1e4}},
        water={"density": 0.0, "gravity": 0.0},
        load=[{"kind": "tether", "stiffness": stiffness, "anchor": [length, height - 10.0]}],
    )
    rise = crinoid.equilibrium(beam).dataset["tip_position"].values[-1, 1] + 10.0
    expected = stiffness * height / (stiffness + 3 * EI / length**3)
    assert rise == pytest.approx(expected, rel=2e-3)


def test_the_wash_is_fastest_at_its_centre():
    wash = Wash(crinoid.Onset.of(), jnp.array([0.5, 0.0]), jnp.array(-10.0), jnp.array(0.2))
    for above, speed in ((0.0, 0.5), (0.2, 0.5 * np.exp(-1))):
        found = wash.velocity(jnp.array([0.3, above - 10.0]), jnp.array(0.0))
        np.testing.assert_allclose(found, [speed, 0.0], rtol=1e-12)


def test_the_thrust_follows_with_its_lag():
    numbers = ThrusterParameters(jnp.asarray(0.5), jnp.asarray(0.1), "thruster")
    scenario = crinoid.Scenario(arm={"nodes": 3})
    thruster, _ = numbers.assemble(crinoid.system(scenario).reference, 0)
    state = thruster.advance(thruster.at_rest(), jnp.array([0.2]), jnp.asarray(0.1))
    np.testing.assert_allclose(state, [0.2 * (1 - np.exp(-1))], rtol=1e-12)
    assert float(thruster.inputs[0].upper) == 0.5


def test_the_log_of_the_meter_is_played(tmp_path):
    log = tmp_path / "meter.csv"
    log.write_text("REEF METER 7\n" + "".join(f"{k} 20.0 5.0 {k}\n" for k in range(30)))
    scenario = crinoid.Scenario(
        arm={"nodes": 3},
        flow=[{"kind": "measured", "file": str(log), "phase_speed": 1e6}],
        simulation={"duration": 5.0},
    )
    water = crinoid.system(scenario).forces.water
    found = water.current(jnp.array([0.0, -10.0]), jnp.array(4.0)).velocity
    np.testing.assert_allclose(found, [0.2, 0.04], atol=1e-6)


def test_the_controller_reaches_target_and_range(result):
    data = result.dataset
    assert result.status == "ok"
    # integral action undoes the error at its rate
    error = data["tip_error"].values
    assert error[-1] < 0.5 * error.max()
    assert set(map(str, data["input"].values)) == {"thruster"}
    thrust = data["actuator_state"].sel(input="thruster").values
    assert np.all(np.abs(thrust) <= 0.5)
    measured = data["sensor_reading"].sel(reading="range.range").values
    away = np.linalg.norm(data["tip_position"].values - [0.8, -10.0], axis=1)
    np.testing.assert_allclose(measured[1:], away[1:], atol=5e-3)
    command = data["actuator_command"].sel(input="thruster").values
    np.testing.assert_allclose(
        command[1:], np.clip(2.0 * (measured[1:] - 0.3), -0.5, 0.5), atol=2e-2
    )


def test_the_measure_is_in_the_table_and_in_a_batch(result):
    expected = result.dataset["tip_position"].sel(axis="x").values.max()
    assert measured(result).numbers["reach"] == expected
    rows = {name: cells for name, *cells in summary(result).rows}
    assert rows["reach"] == [f"{1e3 * expected:.3g} mm"]
    batch = crinoid.simulate_batch(result.scenario, {"load.0.stiffness": [0.2, 0.3]})
    assert batch["reach"].attrs == {"units": "m", "long_name": reach.__doc__.rstrip(".")}
    assert batch["reach"].values[0] == expected != batch["reach"].values[1]


def test_parts_can_be_passed_without_a_scenario_that_names_them():
    bare = crinoid.Scenario(
        arm={"nodes": 6, "length": 0.5},
        control={"compare": False},
        simulation={"duration": 0.1},
    )
    onset = crinoid.Onset.of()
    tether = Tether.of(
        crinoid.system(bare).reference,
        stiffness=jnp.asarray(0.2),
        anchor=jnp.array([0.5, 0.1]),
        onset=onset,
    )
    wash = Wash(onset, jnp.array([0.2, 0.0]), jnp.array(-10.0), jnp.array(0.2))
    found = crinoid.simulate(bare, elements=[tether], flows=[wash])
    assert found.status == "ok"
    root = found.dataset["flow_velocity"].values[-1, 0]
    np.testing.assert_allclose(root, [0.2, 0.0], rtol=1e-12)
    assert Range(jnp.array([0.0, 0.0])).names(2) == (("range", "m"),)
