"""A session: a run whose commands, current and motion of the base come from outside."""

import copy
import os
import pickle
import signal
import time
import warnings
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.results.result import ResultError
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation import sink
from crinoid.simulation.external import ExternalSignals, checked_command

SCENARIO = Scenario.from_toml(
    """
    [arm]
    nodes = 5
    youngs_modulus = 5e5
    section = { EA = 600.0 }
    [base]
    tilt_deg = -30
    channels = { slide = {}, tilt = {} }
    [[flow]]
    kind = "turbulence"
    mean = [0.2, 0.05]
    intensity = 0.2
    length_scale = 0.3
    modes = 8
    [sensor]
    delay = 0.03
    noise_position = 0.002
    [[sensors]]
    kind = "wrench"
    rate_hz = 30.0
    [simulation]
    duration = 1.0
    [output]
    interval = 0.01
    [control]
    kind = "pid"
    compare = false
    rate_hz = 40.0
    controlled = ["x", "angle"]
    mapping = "identity"
    pid = { slide = { kp = 0.3, ki = 2.0 }, tilt = { ki = 2.0, kd = 0.05 } }
    """
)
EXTERNAL = ["current", "base"]


@pytest.fixture(scope="module")
def shared() -> crinoid.Session:
    return crinoid.Session(SCENARIO, external=EXTERNAL)


@pytest.fixture
def session(shared: crinoid.Session) -> crinoid.Session:
    """Give each test the session at its start."""
    shared.paced = False
    shared.reset()
    return shared


def played(session: crinoid.Session, run: crinoid.Result) -> list[crinoid.ControllerInput]:
    """Play the recorded commands of a run; return what a controller sees at each command."""
    commands, found = run.dataset["base_command"].values, [session.seen]
    while not session.ended:
        step = round(session.time / SCENARIO.simulation.time_step)
        found.append(
            session.step(commands[step + 1, [0, 2]])
        )  # in force during the step that follows
    return found


@pytest.mark.slow
def test_recorded_commands_give_the_motion_of_the_run_to_round_off(session):
    run = crinoid.simulate(SCENARIO)
    seen = played(session, run)
    result = session.result()
    assert result.status == "ok"
    for name in ("tip_position", "position", "base_force", "base_servo", "sensor_reading"):
        assert np.array_equal(result.dataset[name], run.dataset[name])
    assert result.scenario.control.kind == "custom"
    assert len(seen) == 41  # at 40 Hz, while two or three time steps are between two commands
    # what it sees is what its sensors know then, and not the truth
    at = run.dataset.sel(time=[each.time for each in seen[:-1]], method="nearest")
    known = np.stack([each.measured for each in seen[:-1]])
    truth = np.hstack([at["tip_position"], at["tip_angle"].values[:, None]])
    assert 1e-4 < np.abs(known - truth)[:, :2].max() < 0.02
    assert all(abs(each.time - each.measurement_time - 0.03) < 0.011 for each in seen[2:])
    assert seen[-1].readings["wrench"].value.shape == (3,)


@pytest.mark.slow
def test_a_session_that_was_saved_continues_as_if_it_had_not_stopped(session, tmp_path):
    def step(of: crinoid.Session) -> None:
        when = of.next_time
        of.step(
            {"slide": 0.02 * np.sin(9 * when)},
            current=[0.1 * np.sin(5 * when), 0.0],
            base={"heave": 0.03 * np.sin(7 * when)},
        )

    for _ in range(15):
        step(session)
    session.result().save(tmp_path)
    for _ in range(15):
        step(session)
    other = crinoid.Session(SCENARIO, external=EXTERNAL, resume=tmp_path)
    assert other.time == pytest.approx(0.38)  # the time step of the 15th command
    for _ in range(15):
        step(other)
    whole, joined = session.result().dataset, other.result().dataset
    assert np.array_equal(whole["tip_position"], joined["tip_position"])
    assert whole["time"].size == joined["time"].size == 1 + round(session.time / 0.01)
    assert np.array_equal(whole["time"], joined["time"])

    with pytest.raises(ScenarioError, match=r"resume: got a result of another scenario"):
        crinoid.Session(SCENARIO, seed=7, external=EXTERNAL, resume=tmp_path)
    with pytest.raises(ScenarioError, match=r"resume: .* of a session with the same external"):
        crinoid.Session(SCENARIO, external=["base"], resume=tmp_path)
    with pytest.raises(ResultError, match="no such result"):
        crinoid.Session(SCENARIO, external=EXTERNAL, resume=tmp_path / "nothing")


def test_inputs_are_those_that_can_move_in_commands_and_in_what_is_seen(session):
    assert [each.name for each in session.inputs] == ["slide", "tilt"]
    seen = session.step({"tilt": 0.1})
    assert seen.command.tolist() == [0.0, 0.1]
    assert seen.upper.tolist() == [float(each.upper) for each in session.inputs]
    assert seen.lower.shape == seen.feedforward.shape == (2,)
    assert str(session).splitlines() == [
        "Session: at 0.03 of 1 s",
        "  inputs    slide (m), tilt (rad)",
        "  readings  tip.x (m), tip.z (m), tip.angle (rad), wrench.force_x (N), "
        "wrench.force_z (N), wrench.moment_y (N m)",
        "  command   every 0.025 s",
        "  external  current, base",
    ]


def test_a_result_so_far_is_that_of_a_run_of_this_duration(session):
    early = session.result()
    assert early.status == "interrupted at t = 0 s"
    for _ in range(20):
        session.step([0.05, 0.1])
    result = session.result()
    assert result.status == "ok"
    assert result.scenario.simulation.duration == pytest.approx(0.5)
    assert result.dataset["time"].values[-1] == pytest.approx(0.5)
    assert result.dataset["base_servo"].values[-1, 0] == pytest.approx(0.05, rel=0.05)
    session.step({"tilt": 0.0})
    command = session.result().dataset["base_command"].values
    assert command[-1].tolist() == [0.05, 0.0, 0.0]  # what is not named stays
    assert session.result().dataset["time"].size == command.shape[0] == 54


@pytest.mark.slow
def test_current_and_base_from_outside_act_as_those_of_a_scenario(session):
    """First order in the time step: the rate of the current jumps from period to period."""
    for _ in range(40):
        now = session.next_time
        current, swing = 0.1 * np.sin(4 * now) ** 2, 0.02 * np.sin(4 * now) ** 2
        speed = 0.02 * 4 * np.sin(8 * now)
        session.step([0, 0], current=[current, 0.0], base={"heave": (swing, speed)})
    times = np.linspace(0, 1, 201)
    swings = 0.02 * np.sin(4 * times) ** 2
    table = {"kind": "table", "channel": "heave", "time": times.tolist(), "value": swings.tolist()}
    half = {"kind": "sine", "amplitude": [-0.05, 0.0], "frequency_hz": 4 / np.pi}
    half |= {"phase_deg": 90.0}  # sin^2 is half of 1 - cos of twice the angle
    flows = [*SCENARIO.to_dict()["flow"], half, {"kind": "uniform", "velocity": [0.05, 0.0]}]
    values = {"control.kind": "none", "flow": flows, "base.motion": [table]}
    run = crinoid.simulate(SCENARIO.with_values(values)).dataset
    found = session.result().dataset
    still = np.ptp(run["tip_position"].values[:, 1])
    assert still > 0.01
    assert np.abs(found["base_pose"] - run["base_pose"]).max() < 2e-6
    assert np.abs(found["tip_position"] - run["tip_position"]).max() < 2e-2 * still


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"command": [1]}, r"command: got 1 number; must be 2: slide \(m\), tilt \(rad\)"),
        ({"command": [[1, 2]]}, r"command: got the shape \(1, 2\); must be 2: slide \(m\), tilt"),
        ({"command": {"lift": 1}}, 'command: got "lift"; must be "slide" or "tilt"$'),
        ({"command": {"heave": 0}}, 'must be "slide" or "tilt". Add a table base.channels.heave.'),
        ({"command": [0, np.nan]}, "command: got .* must be finite"),
        ({"command": {"slide": "fast"}}, "command.slide: got .* must be numbers"),
        ({"current": [1.0]}, r"current: got the shape \(1,\); must be \(2,\)"),
        ({"base": {"x": 1.0}}, 'base: got "x"; must be "slide", "heave" or "tilt"'),
        ({"base": {"heave": (1.0, np.inf)}}, "base.heave: got .* must be finite"),
        ({"command": np.zeros(2, complex)}, "command: got .* must be numbers"),
        ({"command": np.zeros(2, object)}, "command: got .* must be numbers"),
        ({"command": ["0", "0"]}, "command: got .* must be numbers"),
        ({"command": [10**400, 0]}, "command: got .* must be numbers"),
        ({"command": {"slide": True}}, "command.slide: got true; must be numbers"),
        ({"command": {"slide": None}}, "command.slide: got None; must be numbers"),
        ({"base": [0.1]}, r"base: got \[0.1\]; must be numbers by the names of channels"),
        ({"base": {"heave": (1.0, [2.0])}}, "base.heave: got .* must be numbers"),
    ],
)
def test_a_wrong_value_is_refused_and_changes_nothing(session, given, text):
    with pytest.raises(ValueError, match=text):
        session.step(**({"command": [0, 0]} | given))
    assert session.time == 0
    assert np.array_equal(session.seen.command, np.zeros(2))


def test_a_command_for_no_input_is_refused():
    with pytest.raises(ValueError, match='command: got "tilt"; must be left out'):
        checked_command({"tilt": 1.0}, (), ())


PINNED = SCENARIO.with_values(
    {"base.mount": "pinned", "base.channels": {"slide": {}}, "control": {"rate_hz": 40.0}}
)


@pytest.mark.parametrize(
    ("external", "case", "text"),
    [
        (["wind"], SCENARIO, r'external: got "wind"; must be "current" or "base"'),
        ("base", crinoid.load("floating"), r'got "base"; must be left out with vehicle\.mass'),
        (["current"], SCENARIO, "base: got .* must be named in external"),
        (["base"], SCENARIO, "current: got .* must be named in external"),
        (EXTERNAL, PINNED, 'base: got "tilt"; must be "slide" or "heave"'),
    ],
)
def test_wrong_kinds_of_signals_are_refused(external, case, text):
    with pytest.raises(ValueError, match=text):
        ExternalSignals(external, case).advance(0.0, 0.1, [0.0, 0.0], {"tilt": 0.0})


def test_a_step_that_fails_says_so_and_keeps_what_was_computed(session):
    session.step([0, 0])
    with pytest.raises(crinoid.SimulationError, match=r"failed at t = 0\.\d+ s") as found:
        session.step([0, 0], base={"heave": 1e7})
    assert found.value.result.dataset["time"].size >= 4
    with pytest.raises(RuntimeError, match=r"the session has ended: .*Call reset\(\)"):
        session.step([0, 0])
    session.reset()
    session.step([0, 0])
    assert not session.ended


def test_the_session_ends_with_the_duration_of_the_scenario(session):
    while not session.ended:
        session.step([0, 0])
    assert session.ended == "simulation.duration = 1 s is over"
    with pytest.raises(RuntimeError, match="is over"):
        session.step([0, 0])


def test_what_is_kept_of_a_step_is_packed_in_the_memory_of_the_host(session, monkeypatch):
    monkeypatch.setattr(sink, "_LOOSE", 8)
    for _ in range(36):
        session.step([0, 0])
    held = session._sink._records
    assert len(held) < 1 + 36 // 8 + 8
    assert all(leaf.base is None for leaf in jax.tree.leaves(held[1:]))
    steps = np.diff(session.result().dataset["time"])
    np.testing.assert_allclose(steps, 0.01)


def test_threads_take_turns(session):
    def some(_: int) -> list[float]:
        return [float(session.step({"tilt": 0.0}).time) for _ in range(15)]

    with ThreadPoolExecutor(2) as pool:
        times = np.concatenate(list(pool.map(some, range(2))))
    assert len(set(times)) == 30
    assert (np.diff(session.result().dataset["time"]) > 0).all()


@pytest.mark.parametrize("copy_of", [pickle.dumps, copy.copy, copy.deepcopy])
def test_a_session_is_not_copied(session, copy_of):
    with pytest.raises(TypeError, match=r"^Session: cannot be copied or pickled\."):
        copy_of(session)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_fork_is_refused_and_does_not_hang(session):
    read, write = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # JAX's, of the fork
        child = os.fork()
    if not child:
        signal.alarm(20)
        try:
            session.step([0, 0])
        except RuntimeError as error:
            os.write(write, str(error).encode())
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    assert b'multiprocessing.get_context("spawn")' in os.read(read, 1000)
    os.close(read)
    os.close(write)
    session.step([0, 0])  # here it goes on


def test_a_paced_session_keeps_the_wall_clock_and_says_how_late_it_was(session):
    session.step([0, 0])
    session.reset()
    session.paced = True
    start = time.perf_counter()
    for _ in range(12):
        session.step([0, 0])
    assert time.perf_counter() - start >= session.time
    calm = session.late
    assert calm.steps == 12
    time.sleep(0.1)
    session.step([0, 0])
    assert session.late.late >= 1
    assert session.late.largest >= 0.1 - session.period
    assert "of 13 paced steps ended late, by at most" in session.result().notes[-1]
    session.pause()
    time.sleep(0.3)
    session.step([0, 0])
    assert session.late.last < 0.2  # the pause does not count


@pytest.mark.release
def test_in_space_with_a_target_that_the_base_carries():
    """A target in the frame of the base moves with it, in late readings as well."""
    values = {
        "arm": {"nodes": 5, "dimension": 3},
        "base.position": [0.0, 0.0, -10.0],
        "target.frame": "base",
        "sensor.delay": 0.03,
        "simulation.duration": 0.6,
        "simulation.start": "rest",
        "output.interval": 0.01,
        "control": {"rate_hz": 50.0, "compare": False},
    }
    session = crinoid.Session(Scenario().with_values(values), external=EXTERNAL)
    reference = session.seen.reference
    while not session.ended:
        now = session.next_time
        swing = {"sway": 0.03 * np.sin(6 * now) ** 2, "pan": 0.2 * np.sin(6 * now) ** 2}
        seen = session.step([], current=[0.0, 0.05, 0.0], base=swing)
        assert np.abs(seen.reference - reference).max() < 1e-12
    data = session.result().dataset
    assert np.ptp(data["tip_target"].values[:, 1]) > 0.05
    # a reading counts from where the base was when it was taken: 0.03 s or three saved instants ago
    tip = data["tip_position"].values[-4] - data["base_pose"].values[-4, :3] - [0.0, 0.0, -10.0]
    angle = data["base_pose"].values[-4, 3]
    there = [
        np.cos(angle) * tip[0] + np.sin(angle) * tip[1],
        np.cos(angle) * tip[1] - np.sin(angle) * tip[0],
    ]
    late = session.seen.time - session.seen.measurement_time
    assert late == pytest.approx(0.03)
    assert session.seen.measured[:2] == pytest.approx(there, abs=1e-9)


class TestSignals:
    """Values from outside, between two instants and before them."""

    def test_a_current_is_linear_and_its_displacement_is_the_integral(self):
        signals = ExternalSignals(["current"], SCENARIO)
        signals.advance(0.0, 0.2, [0.4, 0.0], None)
        signals.advance(0.2, 0.5, [0.1, -0.3], None)
        (flow,) = signals.flows
        for when, velocity in ((0.2, [0.4, 0.0]), (0.35, [0.25, -0.15]), (0.5, [0.1, -0.3])):
            assert flow.velocity(jnp.zeros(2), jnp.asarray(when)) == pytest.approx(velocity)
        moved = [0.04 + 0.075, -0.045]
        assert flow.displacement(jnp.asarray(0.5)) == pytest.approx(moved)
        rate = flow.jet(jnp.zeros(2), jnp.asarray(0.3)).rate
        assert rate == pytest.approx([-1.0, -1.0])

    def test_a_motion_goes_through_its_points_with_their_velocities(self):
        signals, times = ExternalSignals(["base"], SCENARIO), np.cumsum([0.02, 0.03, 0.025, 0.025])
        for begin, end in zip([0.0, *times[:-1]], times, strict=True):
            heave = (end**3, 3 * end**2)
            signals.advance(begin, end, None, {"heave": heave, "tilt": end})
        slide, heave, tilt = signals.motions
        for when in np.linspace(0.02, 0.1, 7):  # exact for a cubic
            value, speed, second = heave.derivatives(jnp.asarray(when))
            assert [value, speed, second] == pytest.approx([when**3, 3 * when**2, 6 * when])
        assert tilt.derivatives(jnp.asarray(0.1))[:2] == pytest.approx((0.1, 1.0))
        assert slide.derivatives(jnp.asarray(0.1)) == (0.0, 0.0, 0.0)
        # of the time of the oldest reading as well, which counts from where the base was then
        assert heave.displacement(jnp.asarray(0.045)) == pytest.approx(0.045**3)

    def test_the_base_rests_before_the_first_command(self):
        signals = ExternalSignals(["base"], SCENARIO)
        signals.advance(5.0, 5.02, None, {"heave": 0.02})
        _, heave, _ = signals.motions
        for when in (0.0, 4.9, 5.0):
            assert heave.displacement(jnp.asarray(when)) == pytest.approx(0.0, abs=1e-15)
        assert heave.derivatives(jnp.asarray(5.0))[1] == pytest.approx(0.0, abs=1e-12)
        assert heave.displacement(jnp.asarray(5.02)) == pytest.approx(0.02)
