"""The linear model of arm, actuators and sensors against the closed loop in time."""

import json
import sys
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.io import loadmat
from scipy.linalg import block_diag

import crinoid
from crinoid.analysis.linear_loop import linear_loop
from crinoid.analysis.linearisation import find_state_space
from crinoid.analysis.sampled_plant import System as LinearSystem
from crinoid.analysis.state_space import StateSpaceModel
from crinoid.assembly.prepared import Prepared
from crinoid.cli.linearise import _poles_table
from crinoid.control import Controller
from crinoid.dynamics import LocalCoordinates, System
from crinoid.dynamics.coordinate_names import actuator_names, arm_names
from crinoid.results.own_files import is_own
from crinoid.scenario import Scenario
from crinoid.simulation.setup import set_up
from helpers.command import refused, succeeded
from helpers.figures import assert_shows_something
from helpers.refusals import mistake

QUICK = {"max_speed": 10.0, "max_acceleration": 1e3}
TURNING = {"max_speed_deg": 1e3, "max_acceleration_deg": 1e5, "range_deg": [-60.0, 60.0]}
CHANNELS = {"slide": {"range": [-0.3, 0.3]} | QUICK, "tilt": TURNING, "pan": TURNING}
SCENARIO = {
    "title": "a linear arm",
    "arm": {"dimension": 3, "nodes": 5, "youngs_modulus": 4e5, "damping_time": 0.05},
    "base": {"tilt_deg": 40.0, "channels": CHANNELS},
    "chamber": [
        {"offset": 0.008, "area": 2e-4, "max_pressure": 3e4}
        | {"time_constant": 0.05, "pressure": 1.5e4}
    ],
    "flow": [{"kind": "uniform", "velocity": [0.2, 0.15, -0.1]}],
    # two time steps to a command; readings of one and a half, two, half and no periods ago
    "sensor": {"rate_hz": 100.0, "delay": 0.03},
    "sensors": [
        {"kind": "shape", "stations": [0.5], "rate_hz": 50.0, "delay": 0.04},
        {"kind": "wrench", "rate_hz": 100.0, "delay": 0.01},
        {"kind": "current", "points": [[0.1, 0.05, 0.1]], "rate_hz": 50.0},
    ],
    "control": {"kind": "none", "rate_hz": 50.0},
    "simulation": {"time_step": 0.01, "tolerance": 1e-13},
}

PERIODS = 6


class Playback(Controller):
    """Gives commands from a table."""

    commands: jax.Array

    def start(self, seen):
        return jnp.asarray(0)

    def command(self, memory, seen):
        return self.commands[memory], memory + 1


@eqx.filter_jit
def played(loop, steps, state, arm, actuators, commands, water):
    """Run a loop from a state nearby, with commands and currents of each period.

    Returned are readings, pose of the tip and drives at each command, and the last state.
    """
    base = LocalCoordinates(loop.system, state)
    state = base.at(base.arm + arm, base.actuators + actuators)
    # as if the servos had rested for a time step: the first one of a run is another one
    state = eqx.tree_at(lambda each: each.servo.span, state, loop.system.time_step)
    loop = replace(loop, controller=Playback(commands))
    begin = replace(loop.start(state), books=None)

    def tick(carry, index):
        current = water[index // steps]
        moving = eqx.tree_at(
            lambda each: each.system.forces.water.flows[0].uniform_velocity, loop, current
        )
        seen = moving.seen(carry.state, moving.sensed(carry), carry.command)
        values = [seen.measured, *(each.value for each in seen.readings.values())]
        values += [loop.system.tip(carry.state)]
        states = (carry.state.servo, *carry.state.actuators)
        values += [one.drive(own) for one, own in zip(loop.system.followers, states, strict=True)]
        carry, outcome = moving.step(carry)
        return carry, (jnp.concatenate(values), outcome.converged)

    end, (outputs, good) = jax.lax.scan(tick, begin, jnp.arange(PERIODS * steps))
    return outputs[::steps], jnp.concatenate(base.read(end.state)), jnp.all(good)


def errors(scenario):
    """Return the largest errors of the model over the changes, for changes of two sizes."""
    prepared = Prepared(Scenario(**scenario))
    model, setup = find_state_space(prepared), set_up(prepared, notes=False)
    loop, steps = setup.loop, round(model.period / 0.01)
    coordinates = LocalCoordinates(loop.system, setup.state)
    names = [name for name, _ in arm_names(coordinates) + actuator_names(coordinates)]
    size, axes = coordinates.arm.size, model.current.size
    moves = [f"command_{each.name}" in model.inputs for each in loop.system.inputs]
    shown = np.concatenate([np.ones(len(model.outputs) - sum(moves), bool), moves])
    at = [names.index(name) for name in model.states if " ago" not in name]

    draw = np.random.default_rng(0)
    typical = {"m": 1e-5, "rad": 1e-4, "m s-1": 1e-4, "rad s-1": 1e-3}
    x = np.zeros(model.order)
    for index, unit in enumerate(model.state_units[: len(at)]):
        x[index] = typical.get(unit, 1e-3) * draw.standard_normal()
    inputs = 1e-3 * draw.standard_normal((PERIODS, len(model.inputs)))
    inputs[:, -axes:] = 0.0  # a uniform current does not accelerate

    def run(by):
        change, commands = np.zeros(len(names)), np.zeros((PERIODS, len(moves)))
        change[at] = by * x[: len(at)]
        commands[:, moves] = by * inputs[:, : sum(moves)]
        water = model.current + by * inputs[:, sum(moves) : -axes]
        arm, actuators = (jnp.asarray(part) for part in np.split(change, [size]))
        given = (setup.state, arm, actuators, jnp.asarray(commands), jnp.asarray(water))
        outputs, end, good = played(loop, steps, *given)
        assert good
        return np.asarray(outputs)[:, shown], np.asarray(end)[at]

    rest, end_of_rest = run(0.0)
    np.testing.assert_allclose(rest[0], model.operating_outputs, rtol=0, atol=1e-9)
    found = []
    for by in (0.2, 0.1):
        seen, end = run(by)
        z = by * x
        for index, name in enumerate(model.states[len(at) :], len(at)):  # known from the start
            z[index] = (seen - rest)[0, model.outputs.index(name.partition(" ")[0])]
        expected = []
        for u in by * inputs:
            expected.append(model.C @ z + model.D @ u)
            z = model.A @ z + model.B @ u
        changes = [*(seen - rest).T, *(end - end_of_rest)[:, None]]
        linear = [*np.array(expected).T, *z[: len(at), None]]
        largest = [np.abs(each).max() for each in linear]
        assert min(largest) > 0
        found.append(
            np.array([np.abs(a - b).max() for a, b in zip(changes, linear, strict=True)]) / largest
        )
    return model, *found


@pytest.mark.slow
def test_the_model_is_the_closed_loop_to_first_order():
    model, whole, half = errors(SCENARIO)
    assert whole.max() < 0.1
    # relative to the change the error falls with it
    large = whole > 1e-4
    assert large.sum() > 20
    np.testing.assert_allclose(half[large] / whole[large], 0.5, rtol=0.1)
    assert half[~large].max() < 1e-4
    assert model.stable
    assert len({*model.states}) == model.order


# --- one model for several tests ----------------------------------------------------------------

LOOP = Scenario(
    title="a loop",
    arm={"nodes": 5, "youngs_modulus": 4e5, "damping_time": 0.05},
    base={
        "tilt_deg": 90.0,
        "channels": {"slide": {"range": [-0.3, 0.3]}, "tilt": {"range_deg": [-30.0, 60.0]}},
    },
    flow=[{"kind": "uniform", "velocity": [0.05, 0.0]}],
    sensor={"delay": 0.02},
    control={
        "kind": "pid",
        "controlled": ["x", "angle"],
        "pid": {
            "slide": {"kp": 0.07, "ki": 1.4, "kd": 0.014},
            "tilt": {"kp": 0.07, "ki": 0.7, "kd": 0.014},
        },
    },
)


@pytest.fixture(scope="module")
def model():
    return crinoid.linearise(LOOP)


def test_a_model_says_its_names_and_poles_in_a_few_lines():
    turn = 2 * np.pi * 0.5 * 0.1  # a vibration of 0.5 Hz in a period of 0.1 s, and a lag of 0.2 s
    swing = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    A = block_diag(np.exp(-0.05) * swing, np.exp(-0.5))
    model = StateSpaceModel.of(
        LinearSystem(A, np.ones((3, 1)), np.ones((1, 3)), np.zeros((1, 1))),
        title="A tank",
        period=0.1,
        current=np.array([0.2, 0.0]),
        states=("x", "v", "lag"),
        inputs=("command_tilt",),
        outputs=("share",),
        state_units=("m", "m s-1", ""),
        input_units=("rad",),
        output_units=("1",),
        operating_states=np.zeros(3),
        operating_inputs=np.zeros(1),
        operating_outputs=np.zeros(1),
        input_scales=np.ones(1),
    )
    assert str(model).splitlines() == [
        'Linear model of "A tank": 3 states over 0.1 s, stable, in water of 0.2, 0 m/s',
        "  states   x (m), v (m s-1), lag",
        "  inputs   command_tilt (rad)",
        "  outputs  share",
        "  poles    0.5 Hz (damping 0.16), fades in 0.2 s",
    ]
    assert "  reduced  error bound " in str(model.reduced(2))
    assert '<th scope="row">inputs</th><td>command_tilt (rad)</td>' in model._repr_html_()


@pytest.mark.slow
def test_names_units_and_the_operating_point(model):
    assert model.inputs[:3] == ("command_slide", "command_tilt", "current_x")
    assert model.input_units == ("m", "rad", "m s-1", "m s-1", "m s-2", "m s-2")
    assert model.outputs[2:5] == ("measured_tip_angle", "tip_x", "tip_z")
    at = dict(zip(model.states, model.state_units, strict=True))
    assert at["vx_node_1"] == "m s-1"
    assert at["measured_tip_angle 2 periods ago"] == "rad"
    values = dict(zip(model.outputs, model.operating_outputs, strict=True))
    length = LOOP.arm.length
    assert values["tip_z"] == pytest.approx(LOOP.base.position[-1] + length, rel=1e-3)
    tip = model.operating_states[model.states.index("z_node_4")]
    assert tip == pytest.approx(values["tip_z"] - LOOP.base.position[-1])
    assert model.operating_inputs.tolist() == [0, 0, 0.05, 0, 0, 0]
    assert model.period == 0.01
    assert model.stable


def test_the_steady_response_is_the_static_jacobian(model):
    setup = set_up(Prepared(LOOP), notes=False)
    system, state = setup.loop.system, setup.state
    small, influence = (
        eqx.filter_jit(find)(system, state) for find in (System.linearise, System.influence)
    )
    jacobian = np.asarray(influence.static(small[0]))
    gain = model.response(np.zeros(1))[0].real
    tip = [model.outputs.index(f"tip_{name}") for name in ("x", "z", "angle")]
    still = jacobian[:, [0, 2]]
    # the current stiffens the arm a little
    np.testing.assert_allclose(gain[tip, :2], still, rtol=0.05, atol=1e-3)
    np.testing.assert_allclose(gain[:3], gain[tip], atol=1e-9)  # delays do not count
    np.testing.assert_allclose(gain[-2:, :2], np.eye(2), atol=1e-9)


def test_the_error_of_a_reduced_model_is_below_twice_the_sum_of_its_discarded_values(model):
    frequency = np.geomspace(0.01, 50.0, 100)
    whole = model.response(frequency)
    last = np.inf
    for order in (4, 8, 12, model.usual_order):
        least = model.reduced(order)
        assert least.order == order
        assert least.states[-1] == f"state_{order - 1}"
        error = (whole - least.response(frequency)) / model.output_scales[:, None]
        error = np.linalg.norm(error * model.input_scales, ord=2, axis=(1, 2)).max()
        assert model.lasting == 0
        assert least.error_bound == 2 * model.hankel[order:].sum()
        assert 1e-3 * least.error_bound < error <= least.error_bound < last
        last = least.error_bound
    assert last < 1e-2 * model.hankel[0]


def test_python_control_finds_the_margins_of_crinoid(model):
    control = pytest.importorskip("control", reason="needs python-control")
    margin = linear_loop(Prepared(LOOP)).open.margin()
    pid, period = set_up(Prepared(LOOP)).loop.controller, model.period
    given = zip(
        *(np.asarray(part) for part in (pid.kp, pid.ki, pid.kd, pid.filter_time)), strict=True
    )
    each = [
        kp
        + control.tf([ki * period, 0], [1, -1], period)
        + control.tf([kd, -kd], [lag + period, -lag], period)
        for kp, ki, kd, lag in given
    ]
    moves = [0, 2]
    controller = control.append(*(control.ss(each[row]) for row in moves))
    plant = model.to_control()
    assert plant.input_labels == list(model.inputs)
    assert plant.state_labels == list(model.states)
    errors = np.asarray(pid.mapping)[moves] @ np.eye(3, plant.noutputs)
    loop = controller * (errors * plant * np.eye(plant.ninputs, 2))

    def grows(by):
        return np.abs(control.feedback(by * loop, np.eye(2)).poles()).max() > 1 + 1e-9

    # the eigenvalues are joined by straight lines between the frequencies of crinoid
    assert not grows(margin.gain * (1 - 1e-3))
    assert grows(margin.gain * (1 + 1e-3))
    frequency = np.geomspace(0.8, 1.25, 200) * 2 * np.pi * margin.phase_frequency
    response = np.moveaxis(control.frequency_response(loop, frequency).complex, -1, 0)
    values = np.linalg.eigvals(response)
    near = np.unravel_index(np.argmin(np.abs(np.abs(values) - 1)), values.shape)
    assert np.abs(values[near]) == pytest.approx(1.0, abs=1e-2)
    angle = np.abs(np.pi - np.mod(np.angle(values[near]), 2 * np.pi))
    assert angle == pytest.approx(margin.phase, rel=0.02)


def test_without_python_control_one_line_says_what_to_install(model, monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ImportError, match=r'pip install "crinoid\[control\]"'):
        model.to_control()


READERS = {
    "npz": np.load,
    "mat": lambda path: loadmat(path, squeeze_me=True),
    "json": lambda path: json.loads(path.read_text()),
}


@pytest.mark.parametrize("ending", READERS)
def test_files_give_back_what_they_were_given(model, ending, tmp_path):
    path = tmp_path / f"model.{ending}"
    least = model.reduced(6)
    least.save(path)
    read = READERS[ending](path)
    for name in ("A", "B", "C", "D", "hankel", "operating_outputs", "current", "output_scales"):
        np.testing.assert_array_equal(np.asarray(read[name]), getattr(least, name), err_msg=name)
    for name in ("states", "inputs", "output_units"):
        assert [str(each) for each in read[name]] == list(getattr(least, name))
    assert float(read["period"]) == 0.01
    assert bool(read["stable"])
    assert is_own(path)


def test_what_cannot_be_is_refused_in_one_line(model, tmp_path):
    for call, argument, line in (
        (model.reduced, 0, "order: got 0; must be 1 to "),
        (model.reduced, model.order, f"order: got {model.order}; must be 1 to "),
        (model.reduced(4).reduced, 2, "order: got 2; must be left out of a reduced model"),
        (model.save, tmp_path / "model.csv", 'path: got "model.csv"; must end with ".npz"'),
        (crinoid.linearise, LOOP.with_values({"simulation.max_iterations": 1}), "simulation.start"),
    ):
        assert mistake(call, argument).startswith(line)


def test_a_pole_on_the_unit_circle_lasts(model):
    eigenvalues = np.zeros(model.order)
    eigenvalues[:4] = 1.0 + 1e-8, 1.0 - 1e-8, 1.01, np.exp(-0.02)
    A = np.diag(eigenvalues)
    table = _poles_table(replace(model, A=A))
    assert [*table.columns[3].cells] == ["lasts", "grows", "0.5"]


def test_crinoid_linearise_prints_saves_and_draws(model, tmp_path, monkeypatch):
    # the command's own programs would be compiled again
    monkeypatch.setattr("crinoid.cli.linearise.find_state_space", lambda _: model)
    (tmp_path / "loop.toml").write_text(LOOP.to_toml())
    arguments = ("linearise", tmp_path / "loop.toml", "--out", tmp_path)
    succeeded(*arguments)
    assert_shows_something(tmp_path / "response.png")
    assert (tmp_path / "linear-model.npz").exists()
    output = succeeded(*arguments, "--to", "mat", "--order", "8")
    assert not (tmp_path / "linear-model.npz").exists()
    assert "8 states over 0.01 s, stable" in output
    assert loadmat(tmp_path / "linear-model.mat")["A"].shape == (8, 8)
    assert "wrote" in succeeded("report", tmp_path / "response.nc")
    assert "--order: got 0; must be at least 1" in refused(*arguments, "--order", "0")


@pytest.mark.release
def test_an_arm_in_space_with_vortices_has_names_for_all_states():
    # vortices have a memory, the model has none
    quick = ["arm.nodes=5", 'simulation.start="rest"', 'control.kind="none"']
    found = crinoid.linearise(crinoid.load("station-keeping-3d", quick))
    assert len({*found.states}) == found.order
    assert "spin_edge_0" in found.states
    assert not any(name.startswith("memory") for name in found.states)
    assert found.stable
