"""A session that is simulated while its numbers change: knobs do what they say, it is recorded."""

import logging
import threading
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import crinoid
from crinoid.control import Line, Target
from crinoid.dynamics import Outcome
from crinoid.flow import MeasuredPoint, Uniform, Water
from crinoid.live.frame import in_three
from crinoid.live.knobs import Knobs
from crinoid.live.meshes import capsule, tube, tube_triangles, turned
from crinoid.live.pace import Pace
from crinoid.live.part import CAPACITY, StartError, kinds_for
from crinoid.live.props import Props
from crinoid.live.session import Session
from crinoid.live.target import Shifted, shift_to
from crinoid.live.water import stirred
from crinoid.onset import Onset
from crinoid.programs import Program, Store
from crinoid.programs.store import STORE
from crinoid.report import write_report
from crinoid.result import Result
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation.stretch import stretch
from crinoid.spline import PiecewisePolynomial

SCENARIO = """
title = "a small arm"
[arm]
nodes = 5
youngs_modulus = 5e5
[arm.section]
EA = 600.0
[base]
tilt_deg = -30
[base.channels.slide]
[base.channels.tilt]
[[flow]]
kind = "uniform"
velocity = [0.1, 0.0]
[[flow]]
kind = "turbulence"
mean = [0.2, 0.05]
intensity = 0.2
length_scale = 0.3
modes = 16
[control]
kind = "pid"
controlled = ["x", "angle"]
mapping = "identity"
[control.pid.slide]
kp = 0.3
ki = 2.0
[control.pid.tilt]
ki = 2.0
kd = 0.05
[simulation]
duration = 2.0
"""


@pytest.fixture(scope="module")
def session() -> Session:
    return Session(Scenario.from_toml(SCENARIO))


@pytest.fixture(autouse=True)
def _as_described(request: pytest.FixtureRequest) -> None:
    """Give each test a session as its scenario has it, at its start."""
    if "session" in request.fixturenames:
        session = request.getfixturevalue("session")
        session.stop_recording()
        session.reset()
        session.control("pid")
        session.turn(current=1.0, intensity=1.0, length_scale=1.0, gains=1.0, stiffness=1.0)
        session.drag(None)
        session.reset()


def recorded(session: Session, steps: int = 30) -> Result:
    session.start_recording()
    while steps > 0:
        steps -= session.advance(min(steps, 7))
    result = session.stop_recording()
    assert result is not None
    return result


def assert_same(found: Result, run: Result) -> None:
    """Fail unless two results hold the same, but for round-off."""
    assert set(found.dataset.variables) == set(run.dataset.variables)
    for name, data in run.dataset.variables.items():
        if data.dtype.kind == "f":
            scale = float(np.abs(data.values).max(initial=0.0)) or 1.0
            np.testing.assert_allclose(
                found.dataset[name].values, data.values, rtol=1e-6, atol=1e-8 * scale, err_msg=name
            )


CHAMBER = """
[[chamber]]
offset = 0.011
area = 3.0e-4
max_pressure = 3.0e5
"""


@pytest.mark.parametrize("more", ["", CHAMBER], ids=["no chamber", "a chamber"])
def test_what_is_compiled_ahead_is_what_the_session_takes(tmp_path, monkeypatch, more):
    given = []
    monkeypatch.setattr(Program, "will_compile", lambda *_: True)
    monkeypatch.setattr(Program, "compile_ahead", lambda program, *args: given.append(args))
    monkeypatch.setattr(Session, "_compile", lambda _: None)
    session = Session(Scenario.from_toml(SCENARIO + more))
    steps = session.state.steps
    asked = (session.loop, session.state, steps, jnp.asarray(3, int), CAPACITY)
    token = STORE.set(Store(tmp_path))
    ahead, asked = (stretch._key(*jax.tree.flatten((each, {}))) for each in (*given, asked))
    STORE.reset(token)
    assert asked is not None
    assert ahead == asked


def test_what_was_recorded_untouched_is_what_a_run_gives(session, tmp_path):
    result = recorded(session)
    assert result.status == "ok"
    wanted = {"simulation.duration": 0.3, "control.compare": False}
    assert result.scenario == session.scenario.with_values(wanted)
    run = crinoid.simulate(result.scenario)
    numbers = {"residual", "newton_iterations", "error_estimate"}
    assert_same(
        Result(result.dataset.drop_vars(numbers, errors="ignore")),
        Result(run.dataset.drop_vars(numbers, errors="ignore")),
    )
    assert result.notes == run.notes
    result.save(tmp_path)
    written = {path.name for path in write_report(tmp_path)}
    assert {"report.html", "shape.png", "tip_error.png", "commands.png"} <= written
    assert "contact.png" not in written  # of debris that nobody threw


@pytest.mark.parametrize(
    ("knobs", "values"),
    [
        ({"stiffness": 2.5}, {"arm.youngs_modulus": 2.5 * 5e5, "arm.section.EA": 1500.0}),
        ({"gains": 1.5}, {"control.pid.slide.kp": 1.5 * 0.3, "control.pid.tilt.ki": 3.0}),
        ({"current": 1.5}, {"flow.0.velocity": [1.5 * 0.1, 0.0], "flow.1.mean": [0.3, 0.075]}),
        (
            {"intensity": 0.5, "length_scale": 2.0},
            {"flow.1.intensity": 0.1, "flow.1.length_scale": 0.6},
        ),
    ],
    ids=lambda given: "-".join(given),
)
def test_a_knob_gives_what_a_scenario_with_that_number_gives(session, knobs, values):
    session.turn(**knobs)
    result = recorded(session, 20)
    told = result.scenario.to_dict()
    for key, value in values.items():
        found = told
        for part in key.split("."):
            found = found[int(part) if part.isdecimal() else part]
        assert found == pytest.approx(value)
    run = crinoid.simulate(result.scenario)
    for name in ("position", "tip_target", "base_command", "flow_velocity"):
        np.testing.assert_allclose(
            result.dataset[name].values, run.dataset[name].values, rtol=1e-7, atol=1e-9
        )


def test_no_current_is_still_water(session):
    assert np.abs(session.look().flow).max() > 0.1
    session.turn(current=0.0)
    session.advance(5)
    assert not session.look().flow.any()
    result = recorded(session, 10)
    assert result.scenario.flow == ()
    assert not result.dataset["flow_velocity"].values.any()


def test_turbulence_goes_on_from_what_it_was(session):
    session.advance(60)
    now, place = session.state.state.time, jnp.asarray(session.scenario.base.position)
    before = session.loop.system.forces.water.velocity(place, now)
    session.turn(length_scale=0.5)
    after = session.loop.system.forces.water.velocity(place, now)
    np.testing.assert_allclose(after, before, atol=1e-12)
    session.turn(current=0.5)
    halved = session.loop.system.forces.water.velocity(place, now)
    np.testing.assert_allclose(halved, 0.5 * before, atol=1e-12)


def test_a_record_that_drifts_continues_too():
    def numbers(*values):
        return [jnp.asarray(value, float) for value in values]

    times = np.linspace(-9.0, 9.0, 40)
    curve = PiecewisePolynomial(CubicSpline(times, np.stack([np.sin(times), 0 * times], axis=1)))
    uniform = Uniform(Onset.of(), *numbers([0.3, 0.1]))
    flows = (uniform, MeasuredPoint(Onset.of(), curve, *numbers([0, 0], [2, 0]), carried=True))
    place, time = np.array([0.2, -3.0]), 3.0
    now = None
    for current in (1.0, 0.4, 0.9):
        now = stirred(flows, now, Knobs(current=current), place, time)
        velocity = Water(now).velocity(*numbers(place, time)) / current
        expected = Water(flows).velocity(*numbers(place, time))
        np.testing.assert_allclose(velocity, expected, rtol=1e-12)


def test_reset_gives_the_start_to_the_bit(session):
    begun = jax.tree.leaves(session.state)
    session.advance(20)
    session.throw()
    session.pull([0.0, 1.0])
    session.advance(20)
    session.reset()
    for before, after in zip(begun, jax.tree.leaves(session.state), strict=True):
        np.testing.assert_array_equal(before, after)


def test_nothing_is_compiled_when_something_is_changed(session, caplog):
    def touch() -> None:
        session.turn(current=0.7, intensity=1.2, stiffness=1.3, gains=0.8)
        session.drag([0.3, -0.2])
        session.pull([0.2, 0.0])
        session.throw()
        session.advance(4)
        session.look()
        session.reset()

    touch()
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        touch()
        session.advance(3)
    assert not [each for each in caplog.messages if "Compiling" in each]


def test_debris_hits_the_arm(session):
    session.advance(10)
    session.start_recording()
    session.throw()
    approach = np.asarray(session.state.state.obstacle_velocity)[-1]
    session.advance(60)
    assert session.look().touched > 0
    leaving = np.asarray(session.state.state.obstacle_velocity)[-1]
    assert np.linalg.norm(leaving - approach) > 0.5 * np.linalg.norm(approach)  # it bounced
    result = session.stop_recording()
    assert result is not None
    assert result.status == "ok"
    assert len(result.scenario.obstacle) == 1
    assert result.dataset["contact_time"].values[-1, 0] > 0
    assert np.linalg.norm(result.dataset["contact_impulse"].values[-1, 0]) > 1e-3
    assert any("debris" in note and "t = 0.1 s" in note for note in result.notes)
    assert result.dataset["contact_closest"].values[-1, 0] < 1e-3
    session.reset()
    assert not session.look().touched
    session.advance(30)  # what nobody throws stays where it is
    parked = np.asarray(session.props.debris.parked) - session.scenario.base.position
    np.testing.assert_array_equal(session.look().obstacles[-1], in_three(parked))


def test_a_recording_with_debris_opens(session, tmp_path):
    session.start_recording()
    session.throw()
    session.advance(40)
    result = session.stop_recording()
    assert result is not None
    result.save(tmp_path)
    assert {"report.html", "contact.png"} <= {path.name for path in write_report(tmp_path)}


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_pull_moves_the_tip_along_it(session, side):
    session.advance(10)
    edge = np.diff(np.asarray(session.state.state.position)[-2:], axis=0)[0]
    force = side * 0.6 * np.array([-edge[1], edge[0]]) / np.linalg.norm(edge)
    session.start_recording()
    session.pull(force.tolist())
    session.advance(8)
    pulled = session.look()
    np.testing.assert_allclose(pulled.pull, in_three(force))
    result = session.stop_recording()
    assert result is not None
    load = result.scenario.load[-1]
    assert (list(load.force), load.start) == (force.tolist(), pytest.approx(0.1))
    session.reset()
    session.advance(18)
    moved = pulled.nodes[-1] - session.look().nodes[-1]
    along = moved @ in_three(force) / np.linalg.norm(force)
    assert along > 1e-3
    assert along > 0.9 * np.linalg.norm(moved)
    session.pull(force.tolist())
    session.advance(120)
    assert not session.look().pull.any()  # it is over


def test_a_recorded_pull_is_a_load_of_the_scenario(session):
    session.start_recording()
    session.pull([0.0, 0.4])
    session.advance(20)
    result = session.stop_recording()
    assert result is not None
    run = crinoid.simulate(result.scenario)
    np.testing.assert_allclose(
        result.dataset["position"].values, run.dataset["position"].values, rtol=1e-7, atol=1e-9
    )


def test_the_target_is_where_it_was_dragged(session):
    was = session.look().target
    session.drag([0.35, -0.25])
    np.testing.assert_allclose(session.look().target, [0.35, 0.0, -0.25], atol=1e-12)
    result = recorded(session, 10)
    tip = np.array([0.35, -0.25]) + session.scenario.base.position
    np.testing.assert_allclose(result.dataset["tip_target"].values[-1], tip)
    np.testing.assert_allclose(result.scenario.target.tip, tip)
    session.drag(None)
    np.testing.assert_array_equal(session.look().target, was)


def test_a_path_is_dragged_as_a_whole():
    line = Line(jnp.asarray([0.4, -0.1]), jnp.asarray([0.1, 0.0]), Onset.of())
    path = Target(jnp.asarray([0.4, -0.1, 0.0]), line, (0, 1))
    shift = shift_to(Shifted.of(path, 2), np.array([0.3, -0.3]), 2.0)
    np.testing.assert_allclose(shift, [0.3 - 0.6, -0.2])
    dragged = eqx.tree_at(lambda x: x.shift, Shifted.of(path, 2), jnp.asarray(shift))
    np.testing.assert_allclose(dragged(jnp.asarray(2.0)), [0.3, -0.3, 0.0], atol=1e-15)
    np.testing.assert_allclose(dragged(jnp.asarray(3.0)), [0.4, -0.3, 0.0], atol=1e-15)


def test_another_controller_takes_over(session):
    session.advance(40)
    commands = np.asarray(session.state.command)
    assert commands.any()
    session.start_recording()
    session.control("none")
    session.advance(10)
    assert not np.asarray(session.state.command).any()
    result = session.stop_recording()
    assert result is not None
    assert result.scenario.control.kind == "none"
    assert any("controller (t = 0.4 s)" in note for note in result.notes)
    session.control("pid")
    session.advance(1)
    assert np.abs(session.state.command).max() < 0.1 * np.abs(commands).max()  # no bump
    session.advance(100)
    assert np.asarray(session.state.command).any()


def test_a_controller_that_does_not_go_with_it_is_refused(session):
    with pytest.raises(ScenarioError, match="mapping"):
        session.control("lqg")
    assert session.kind == "pid"
    assert session.advance(3) == 3
    assert kinds_for(session.scenario) == ("none", "pid", "lqg", "mpc")
    assert kinds_for(Scenario()) == ("none",)


def test_a_step_that_fails_stops_it_and_reset_goes_on(session):
    session.advance(10)
    session.start_recording()
    session.pull([0.0, 1e9])
    for _ in range(30):
        session.advance(5)
    assert session.halted.startswith("failed at t = 0.")
    assert "\n" not in session.halted
    assert session.advance(5) == 0
    result = session.stop_recording()
    assert result is None or result.status.startswith("failed at t = 0.")
    session.reset()
    assert (session.halted, session.advance(5)) == ("", 5)


def test_numbers_changed_while_it_is_recorded_are_told(session):
    session.start_recording()
    session.advance(10)
    session.turn(stiffness=2.0)
    session.advance(10)
    session.turn(stiffness=3.0)
    session.advance(10)
    result = session.stop_recording()
    assert result is not None
    assert result.status == "ok"
    assert any("stiffness (t = 0.1 to 0.2 s)" in note for note in result.notes)
    assert result.scenario.arm.youngs_modulus == pytest.approx(1.5e6)
    assert "natural_frequency" not in result.dataset


def test_a_later_recording_says_so_and_its_books_balance(session):
    session.advance(33)
    result = recorded(session, 30)
    assert result.status == "ok"
    np.testing.assert_allclose(np.diff(result.dataset["time"].values), 0.02, rtol=1e-9)
    works = [kind for kind in result.dataset["kind"].values if kind not in ("kinetic",)]
    assert not result.dataset["energy"].sel(kind="drag").values[0]
    assert works
    assert not any("ledger" in note for note in result.notes)
    assert any("recorded live from t = 0.34 s on" in note for note in result.notes)


def test_too_short_a_recording_is_none(session):
    session.start_recording()
    session.advance(1)
    assert session.stop_recording() is None


def test_what_is_shown_is_what_the_state_has(session):
    session.advance(30)
    frame, state, system = session.look(), session.state.state, session.loop.system
    np.testing.assert_array_equal(frame.nodes[:, [0, 2]], np.asarray(state.position)[1:])
    assert not frame.nodes[:, 1].any()
    tip, target = np.asarray(system.tip(state)), np.asarray(session.loop.target(state.time))
    assert frame.error == pytest.approx(np.linalg.norm((tip - target)[:2]), rel=1e-12)
    assert frame.time == float(state.time)


def test_numbers_without_an_equilibrium_start_from_that_of_the_scenario(session, monkeypatch):
    begun = session.look().nodes
    monkeypatch.setattr(
        "crinoid.live.session.find_start",
        lambda *_: (session.state.state, Outcome.of_nothing(converged=False)),
    )
    session.turn(stiffness=0.2)
    assert "no equilibrium with these numbers" in session.reset()
    np.testing.assert_array_equal(session.look().nodes, begun)


def test_a_scenario_without_a_start_is_refused(session):
    heavy = {"load": [{"kind": "tip", "force": [0.0, -1e6]}]}
    with pytest.raises(StartError, match="no static equilibrium"):
        Session(session.scenario.with_values(heavy))


def test_props_go_with_what_a_scenario_is(session):
    assert session.props.duration == 3600.0
    thin = session.scenario.with_values({"arm.section.diameter": 0.0})
    assert Props.beside(thin).debris is None
    table = {"channel": "slide", "kind": "table", "time": [0.0, 1.0, 2.0], "value": [0.0, 0.1, 0.0]}
    assert Props.beside(session.scenario.with_values({"base.motion": [table]})).duration == 2.0


def test_an_arm_without_a_surface_cannot_be_hit(session, monkeypatch):
    monkeypatch.setattr(session, "props", replace(session.props, debris=None))
    with pytest.raises(ScenarioError, match="no surface"):
        session.throw()


def test_it_ends_where_the_tables_of_the_scenario_do(session, monkeypatch):
    monkeypatch.setattr(session, "props", replace(session.props, duration=0.2))
    assert session.advance(50) == 20
    assert session.halted.startswith("over at t = 0.2 s")


def test_an_arm_in_space_is_hit_pulled_and_recorded():
    scenario = Scenario(
        arm={"dimension": 3, "nodes": 4, "youngs_modulus": 5e5},
        flow=[{"kind": "uniform", "velocity": [0.0, 0.2, 0.0]}],
        simulation={"duration": 1.0},
    )
    session = Session(scenario)
    result = recorded(session, 20)
    assert result.status == "ok"
    assert result.scenario == scenario.with_values({"simulation.duration": 0.2})
    session.drag([0.3, 0.1, 0.1])
    np.testing.assert_allclose(session.look().target, [0.3, 0.1, 0.1], atol=1e-12)
    before = session.look().nodes[-1]
    session.pull([0.0, session.tip_force, 0.0])
    session.advance(30)
    assert (session.look().nodes[-1] - before)[1] > 1e-3
    session.throw()
    session.advance(60)
    assert session.look().touched > 0


class Watched:
    """A pace that a test looks at."""

    def __init__(self, session, watched=1):
        self.seen, self.kept, self._news = [], [], threading.Condition()
        self.pace = Pace(session, self._show, self._keep)
        self.pace.watched = watched
        self.pace.start()

    def _show(self, seen):
        with self._news:
            self.seen.append(seen)
            self._news.notify_all()

    def _keep(self, result):
        self.kept.append(result)
        return "kept it"

    def wait(self, condition):
        """Wait for an instant."""
        with self._news:
            assert self._news.wait_for(lambda: self.seen and condition(self.seen[-1]), timeout=60)
        return self.seen[-1]


def test_it_keeps_pace_pauses_and_goes_on(session):
    watched = Watched(session, watched=0)
    first = watched.wait(lambda seen: True)
    assert (first.frame.time, first.running, first.factor) == (0.0, False, 0.0)
    watched.pace.watched = 1
    watched.pace.wake()
    assert watched.wait(lambda seen: seen.frame.time > 0.2).running
    watched.pace.running = False
    watched.pace.ask("look", lambda session: None)
    rested = watched.wait(lambda seen: not seen.running)
    watched.pace.ask("turn", lambda session: session.turn(stiffness=2.0))
    watched.pace.ask("turn", lambda session: session.turn(stiffness=3.0))
    watched.pace.ask("record", watched.pace.toggle_recording)
    assert (
        watched.wait(lambda seen: seen.recording is not None).frame.time - rested.frame.time < 0.02
    )
    watched.pace.running = True
    watched.pace.wake()
    watched.wait(lambda seen: seen.frame.time > rested.frame.time + 0.3)
    watched.pace.ask("reset", watched.pace.reset)
    watched.wait(lambda seen: seen.said == "kept it")
    watched.pace.ask("record", watched.pace.toggle_recording)
    watched.wait(lambda seen: (seen.recording or 0.0) > 0.1)
    watched.pace.stop()
    assert watched.pace.error is None
    assert len(watched.kept) == 2  # one at the reset, one at the end
    assert session.knobs.stiffness == 3.0


def test_what_fails_is_said_and_ends_nothing(session):
    watched = Watched(session)
    watched.pace.ask("pull", lambda session: session.pull([0.0, 1e9]))
    failed = watched.wait(lambda seen: seen.said)
    assert failed.said.startswith("failed at t = ")
    assert failed.wrong
    assert not failed.running

    def refuse(session):
        raise ScenarioError([])

    watched.pace.ask("refuse", refuse)
    watched.pace.ask("reset", watched.pace.reset)
    watched.wait(lambda seen: seen.running and seen.frame.time > 0.05)
    watched.pace.stop()
    assert watched.pace.error is None


def test_a_tube_is_round_and_closed():
    nodes = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.05], [0.25, 0.0, 0.15]])
    points, triangles = tube(nodes, np.full(4, 0.01)), tube_triangles(4)
    assert triangles.min() == 0
    assert triangles.max() == len(points) - 1
    first = points[: len(points) // 18]
    np.testing.assert_allclose(np.linalg.norm(first - nodes[0], axis=1), 0.01)
    np.testing.assert_allclose(points[-1], points[-2], atol=1e-12)  # the end is a point
    corners, faces = capsule(np.array([0.0, 0.2, 0.0]), 0.05)
    assert faces.max() == len(corners) - 1
    away = corners - np.clip(corners[:, 1:2], -0.2, 0.2) * [0.0, 1.0, 0.0]
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 0.05)


@pytest.mark.parametrize("axis", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [0.3, -0.5, 0.2]])
def test_a_turn_brings_z_to_a_direction(axis):
    found = turned(np.array([[0.0, 0.0, 2.0], [0.5, 0.0, 0.0]]), np.array(axis, float))
    along = np.array(axis) / np.linalg.norm(axis)
    np.testing.assert_allclose(found[0], 2 * along, atol=1e-12)
    assert found[1] @ along == pytest.approx(0.0, abs=1e-12)
