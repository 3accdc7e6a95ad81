"""A session that is simulated while its numbers change: knobs do what they say, it is recorded."""

import logging
import threading

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
from crinoid.numerics.piecewise import PiecewisePolynomial
from crinoid.numerics.ramp import Onset
from crinoid.results.result import Result
from crinoid.results.scene.data import in_three
from crinoid.scenario import Scenario, ScenarioError
from crinoid.view.figures import write_report
from crinoid.view.live.adjustable import AdjustableNumbers, adjusted_flows
from crinoid.view.live.clock import RealTimeClock
from crinoid.view.live.interactive import (
    InteractiveBodies,
    ShiftedTarget,
    StartError,
    kinds_for,
    shift_to,
)
from crinoid.view.live.session import LiveSession

SCENARIO = """
title = "a small arm"
flow = [
  {kind="uniform", velocity=[0.1, 0.0]},
  {kind="turbulence", mean=[0.2, 0.05], intensity=0.2, length_scale=0.3, modes=16},
]
arm = {nodes=5, youngs_modulus=5e5, section={EA=600.0}}
base = {tilt_deg=-30, channels={slide={}, tilt={}}}
simulation = {duration=2.0}
[control]
kind = "pid"
controlled = ["x", "angle"]
mapping = "identity"
pid = {slide={kp=0.3, ki=2.0}, tilt={ki=2.0, kd=0.05}}
"""
CHAMBER = "[[chamber]]\noffset = 0.011\narea = 3.0e-4\nmax_pressure = 3.0e5\n"

pytestmark = pytest.mark.usefixtures("coarse")


@pytest.fixture(scope="module")
def used() -> LiveSession:
    return LiveSession(Scenario.from_toml(SCENARIO))


@pytest.fixture
def session(used: LiveSession) -> LiveSession:
    """Give each test the session as its scenario has it, at its start."""
    used.stop_recording()
    used.reset()
    used.control("pid")
    used.adjust(current=1.0, intensity=1.0, length_scale=1.0, gains=1.0, stiffness=1.0)
    used.drag(None)
    used.reset()
    return used


def stopped(session: LiveSession) -> Result:
    result = session.stop_recording()
    assert result is not None
    return result


def recorded(session: LiveSession, steps: int = 30) -> Result:
    session.start_recording()
    while steps > 0:
        steps -= session.advance(min(steps, 7))
    return stopped(session)


def has_note(result: Result, *words: str) -> bool:
    return any(all(word in note for word in words) for note in result.notes)


def assert_runs_alike(result: Result, *names: str) -> None:
    """Fail unless a run of the scenario that was recorded gives the same."""
    run = crinoid.simulate(result.scenario)
    for name in names:
        found, expected = (each.dataset[name].values for each in (result, run))
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)


@pytest.mark.slow
def test_an_untouched_recording_equals_a_run(session, tmp_path):
    result = recorded(session)
    assert result.status == "ok"
    wanted = {"simulation.duration": 0.3, "control.compare": False}
    assert result.scenario == session.scenario.with_values(wanted)
    run = crinoid.simulate(result.scenario)
    assert set(result.dataset.variables) == set(run.dataset.variables)
    numbers = {"residual", "newton_iterations", "error_estimate"}
    for name, data in run.dataset.drop_vars(numbers, errors="ignore").variables.items():
        if data.dtype.kind == "f":
            atol = 1e-8 * (float(np.abs(data.values).max(initial=0.0)) or 1.0)
            np.testing.assert_allclose(result.dataset[name], data, 1e-6, atol, err_msg=name)
    assert result.notes == run.notes
    result.save(tmp_path)
    written = {path.name for path in write_report(tmp_path)}
    assert {"report.html", "shape.png", "tip_error.png", "commands.png"} <= written
    assert "contact.png" not in written  # of debris that nobody threw


@pytest.mark.slow
@pytest.mark.parametrize(
    ("numbers", "values"),
    [
        ({"stiffness": 2.5}, {"arm.youngs_modulus": 2.5 * 5e5, "arm.section.EA": 1500.0}),
        ({"gains": 1.5}, {"control.pid.slide.kp": 1.5 * 0.3, "control.pid.tilt.ki": 3.0}),
        ({"current": 1.5}, {"flow.0.velocity": [1.5 * 0.1, 0.0], "flow.1.mean": [0.3, 0.075]}),
        ({"intensity": 0.5}, {"flow.1.intensity": 0.1}),
        ({"length_scale": 2.0}, {"flow.1.length_scale": 0.6}),
    ],
    ids=lambda given: "-".join(given),
)
def test_a_knob_acts_like_that_number_in_the_scenario(session, numbers, values):
    session.adjust(**numbers)
    result = recorded(session, 20)
    described = result.scenario.to_dict()
    for key, value in values.items():
        found = described
        for part in key.split("."):
            found = found[int(part) if part.isdecimal() else part]
        assert found == pytest.approx(value), key
    assert_runs_alike(result, "position", "tip_target", "base_command", "flow_velocity")


@pytest.mark.slow
def test_no_current_is_still_water(session):
    assert np.abs(session.look().flow).max() > 0.1
    session.adjust(current=0.0)
    session.advance(5)
    assert not session.look().flow.any()
    result = recorded(session, 10)
    assert result.scenario.flow == ()
    assert not result.dataset["flow_velocity"].values.any()


@pytest.mark.release
def test_turbulence_continues_where_a_knob_turns(session):
    session.advance(60)
    now, place = session.state.state.time, jnp.asarray(session.scenario.base.position)

    def water():
        return session.loop.system.forces.water.velocity(place, now)

    before = water()
    session.adjust(length_scale=0.5)
    np.testing.assert_allclose(water(), before, atol=1e-12)
    session.adjust(current=0.5)
    np.testing.assert_allclose(water(), 0.5 * before, atol=1e-12)


def test_a_record_that_drifts_continues_too():
    times = np.linspace(-9.0, 9.0, 40)
    curve = PiecewisePolynomial(CubicSpline(times, np.stack([np.sin(times), 0 * times], axis=1)))
    still, drift, steady = (jnp.asarray(each) for each in ([0.0, 0.0], [2.0, 0.0], [0.3, 0.1]))
    measured = MeasuredPoint(Onset.of(), curve, still, drift, carried=True)
    flows = (Uniform(Onset.of(), steady), measured)
    place, time = jnp.asarray([0.2, -3.0]), jnp.asarray(3.0)
    now = None
    for current in (1.0, 0.4, 0.9):
        now = adjusted_flows(flows, now, AdjustableNumbers(current=current), np.asarray(place), 3.0)
        velocity = Water(now).velocity(place, time) / current
        np.testing.assert_allclose(velocity, Water(flows).velocity(place, time), rtol=1e-12)


@pytest.mark.slow
def test_a_change_compiles_nothing_and_a_reset_restores_the_start_to_the_bit(session, caplog):
    def touch() -> list:
        session.adjust(current=0.7, intensity=1.2, stiffness=1.3, gains=0.8)
        session.drag([0.3, -0.2])
        session.pull([0.2, 0.0])
        session.throw()
        session.advance(4)
        session.look()
        session.reset()
        return jax.tree.leaves(session.state)

    first = touch()
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        again = touch()
        session.advance(3)
    assert not [each for each in caplog.messages if "Compiling" in each]
    for before, after in zip(first, again, strict=True):
        np.testing.assert_array_equal(before, after)


@pytest.mark.slow
def test_debris_hits_the_arm_and_its_recording_opens(session, tmp_path):
    session.advance(10)
    session.start_recording()
    session.throw()
    approach = np.asarray(session.state.state.obstacle_velocity)[-1]
    session.advance(60)
    assert session.look().touched > 0
    leaving = np.asarray(session.state.state.obstacle_velocity)[-1]
    assert np.linalg.norm(leaving - approach) > 0.5 * np.linalg.norm(approach)  # it bounced
    result = stopped(session)
    assert result.status == "ok"
    assert len(result.scenario.obstacle) == 1
    last = result.dataset.isel(time=-1, obstacle=0)
    assert last["contact_time"].values > 0
    assert np.linalg.norm(last["contact_impulse"].values) > 1e-3
    assert last["contact_closest"].values < 1e-3
    assert has_note(result, "debris", "t = 0.1 s")
    result.save(tmp_path)
    assert {"report.html", "contact.png"} <= {path.name for path in write_report(tmp_path)}
    session.reset()
    assert not session.look().touched
    session.advance(30)  # what nobody throws stays where it is
    parked = np.asarray(session.bodies.debris.parked) - session.scenario.base.position
    np.testing.assert_array_equal(session.look().obstacles[-1], in_three(parked))


@pytest.mark.slow
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_pull_moves_the_tip_and_becomes_a_load_of_the_scenario(session, side):
    session.start_recording()
    session.advance(10)
    edge = np.diff(np.asarray(session.state.state.position)[-2:], axis=0)[0]
    force = side * 0.6 * np.array([-edge[1], edge[0]]) / np.linalg.norm(edge)
    session.pull(force.tolist())
    session.advance(8)
    pulled = session.look()
    np.testing.assert_allclose(pulled.pull, in_three(force))
    result = stopped(session)
    load = result.scenario.load[-1]
    assert (list(load.force), load.start) == (force.tolist(), pytest.approx(0.1))
    assert_runs_alike(result, "position")
    session.reset()
    session.advance(18)
    moved = pulled.nodes[-1] - session.look().nodes[-1]
    along = moved @ in_three(force) / np.linalg.norm(force)
    assert along > 1e-3
    assert along > 0.9 * np.linalg.norm(moved)
    session.pull(force.tolist())
    session.advance(120)
    assert not session.look().pull.any()  # it is over


@pytest.mark.slow
def test_a_dragged_target_stays_where_it_is(session):
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
    shift = shift_to(ShiftedTarget.of(path, 2), np.array([0.3, -0.3]), 2.0)
    np.testing.assert_allclose(shift, [0.3 - 0.6, -0.2])
    dragged = eqx.tree_at(lambda x: x.shift, ShiftedTarget.of(path, 2), jnp.asarray(shift))
    np.testing.assert_allclose(dragged(jnp.asarray(2.0)), [0.3, -0.3, 0.0], atol=1e-15)
    np.testing.assert_allclose(dragged(jnp.asarray(3.0)), [0.4, -0.3, 0.0], atol=1e-15)


@pytest.mark.release
def test_another_controller_takes_over(session):
    session.advance(40)
    commands = np.asarray(session.state.command)
    assert commands.any()
    session.start_recording()
    session.control("none")
    session.advance(10)
    assert not np.asarray(session.state.command).any()
    result = stopped(session)
    assert result.scenario.control.kind == "none"
    assert has_note(result, "controller (t = 0.4 s)")
    session.control("pid")
    session.advance(1)
    assert np.abs(session.state.command).max() < 0.1 * np.abs(commands).max()  # no bump
    session.advance(100)
    assert np.asarray(session.state.command).any()


@pytest.mark.slow
def test_a_controller_that_does_not_suit_the_scenario_is_refused(session):
    with pytest.raises(ScenarioError, match="mapping"):
        session.control("lqg")
    assert session.kind == "pid"
    assert session.advance(3) == 3
    assert kinds_for(session.scenario) == ("none", "pid", "lqg", "mpc")
    assert kinds_for(Scenario()) == ("none",)


@pytest.mark.slow
def test_a_step_that_fails_stops_the_session_until_its_reset(session):
    session.advance(10)
    session.start_recording()
    session.pull([0.0, 1e9])
    session.advance(120)
    assert session.halted.startswith("failed at t = 0.")
    assert "\n" not in session.halted
    assert session.advance(5) == 0
    result = session.stop_recording()
    assert result is None or result.status.startswith("failed at t = 0.")
    session.reset()
    assert (session.halted, session.advance(5)) == ("", 5)


@pytest.mark.slow
def test_a_note_says_when_a_number_changed(session):
    session.start_recording()
    for stiffness in (2.0, 3.0):
        session.advance(10)
        session.adjust(stiffness=stiffness)
    session.advance(10)
    result = stopped(session)
    assert result.status == "ok"
    assert has_note(result, "stiffness (t = 0.1 to 0.2 s)")
    assert result.scenario.arm.youngs_modulus == pytest.approx(1.5e6)
    assert "natural_frequency" not in result.dataset


@pytest.mark.slow
def test_a_recording_has_two_steps_and_a_later_one_says_so_and_balances(session):
    session.start_recording()
    session.advance(1)
    assert session.stop_recording() is None
    session.advance(32)
    result = recorded(session, 30)
    assert result.status == "ok"
    np.testing.assert_allclose(np.diff(result.dataset["time"].values), 0.02, rtol=1e-9)
    assert not result.dataset["energy"].sel(kind="drag").values[0]
    assert not has_note(result, "ledger")
    assert has_note(result, "recorded live from t = 0.34 s on")


@pytest.mark.slow
def test_a_frame_shows_the_state(session):
    session.advance(30)
    frame, state, system = session.look(), session.state.state, session.loop.system
    np.testing.assert_array_equal(frame.nodes[:, [0, 2]], np.asarray(state.position)[1:])
    assert not frame.nodes[:, 1].any()
    tip, target = np.asarray(system.tip(state)), np.asarray(session.loop.target(state.time))
    assert frame.error == pytest.approx(np.linalg.norm((tip - target)[:2]), rel=1e-12)
    assert frame.time == float(state.time)


@pytest.mark.slow
def test_without_an_equilibrium_a_reset_keeps_the_start_and_a_session_is_refused(
    session, monkeypatch
):
    begun = session.look().nodes
    monkeypatch.setattr(
        "crinoid.view.live.session.find_state",
        lambda *_: (session.state.state, Outcome.of_nothing(converged=False)),
    )
    session.adjust(stiffness=0.2)
    assert "no equilibrium with these numbers" in session.reset()
    np.testing.assert_array_equal(session.look().nodes, begun)
    hasty = session.scenario.with_values({"simulation.max_iterations": 1})
    with pytest.raises(StartError, match="no static equilibrium"):
        LiveSession(hasty)


@pytest.mark.slow
def test_props_suit_the_scenario_and_a_session_ends_with_its_tables(session, monkeypatch):
    assert session.bodies.duration == 3600.0
    thin = session.scenario.with_values({"arm.section.diameter": 0.0})
    assert InteractiveBodies.suited_to(thin, {}).debris is None
    monkeypatch.setattr(session, "bodies", session.bodies._replace(debris=None))
    with pytest.raises(ScenarioError, match="surface to hit"):
        session.throw()
    table = {"channel": "slide", "kind": "table", "time": [0.0, 2.0], "value": [0.0, 0.1]}
    moved = session.scenario.with_values({"base.motion": [table]})
    assert InteractiveBodies.suited_to(moved, {}).duration == 2.0
    monkeypatch.setattr(session, "bodies", session.bodies._replace(duration=0.2))
    assert session.advance(50) == 20
    assert session.halted.startswith("over at t = 0.2 s")


@pytest.mark.release
def test_an_arm_in_space_is_hit_pulled_and_recorded():
    scenario = Scenario(
        arm={"dimension": 3, "nodes": 4, "youngs_modulus": 5e5},
        flow=[{"kind": "uniform", "velocity": [0.0, 0.0, 0.2]}],
        simulation={"duration": 1.0, "start": "rest"},
    )
    session = LiveSession(scenario)
    result = recorded(session, 20)
    assert result.status == "ok"
    assert result.scenario == scenario.with_values({"simulation.duration": 0.2})
    session.drag([0.3, 0.1, 0.1])
    np.testing.assert_allclose(session.look().target, [0.3, 0.1, 0.1], atol=1e-12)
    before = session.look().nodes[-1]
    session.pull([0.0, session.tip_force, 0.0])  # across the current and the weight
    session.advance(30)
    assert (session.look().nodes[-1] - before)[1] > 1e-3
    session.throw()
    session.advance(60)
    assert session.look().touched > 0


class Watched:
    """A pace that a test looks at."""

    def __init__(self, session, watched=1):
        self.seen, self.kept, self._news = [], [], threading.Condition()
        self.clock = RealTimeClock(session, self._show, self._keep)
        self.clock.viewers = watched
        self.clock.start()

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


@pytest.mark.slow
def test_a_session_keeps_pace_pauses_and_runs_on(session):
    watched = Watched(session, watched=0)
    first = watched.wait(lambda seen: True)
    assert (first.frame.time, first.running, first.factor) == (0.0, False, 0.0)
    watched.clock.viewers = 1
    watched.clock.wake()
    assert watched.wait(lambda seen: seen.frame.time > 0.2).running
    watched.clock.running = False
    watched.clock.request("look", lambda session: None)
    rested = watched.wait(lambda seen: not seen.running)
    watched.clock.request("turn", lambda session: session.adjust(stiffness=2.0))
    watched.clock.request("turn", lambda session: session.adjust(stiffness=3.0))
    watched.clock.request("record", watched.clock.toggle_recording)
    begun = watched.wait(lambda seen: seen.recording is not None)
    assert begun.frame.time - rested.frame.time < 0.02
    watched.clock.running = True
    watched.clock.wake()
    watched.wait(lambda seen: seen.frame.time > rested.frame.time + 0.3)
    watched.clock.request("reset", watched.clock.reset)
    watched.wait(lambda _: watched.clock.message == ("kept it", False))
    watched.clock.request("record", watched.clock.toggle_recording)
    watched.wait(lambda seen: (seen.recording or 0.0) > 0.1)
    watched.clock.stop()
    assert watched.clock.error is None
    assert len(watched.kept) == 2  # one at the reset, one at the end
    assert session.numbers.stiffness == 3.0


@pytest.mark.slow
def test_a_failure_is_shown_and_ends_nothing(session):
    watched = Watched(session)
    clock = watched.clock
    clock.request("pull", lambda session: session.pull([0.0, 1e9]))
    failed = watched.wait(lambda seen: clock.message[0] and not seen.running)
    text, wrong = clock.message
    assert text.startswith("failed at t = ")
    assert text.endswith(". Press Reset.")
    assert (wrong, failed.running) == (True, False)
    clock.request("refuse", lambda session: session.control("lqg"))
    clock.request("reset", clock.reset)
    watched.wait(lambda seen: seen.running and seen.frame.time > 0.05)
    clock.stop()
    assert clock.error is None
