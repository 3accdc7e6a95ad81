import math
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
import xarray as xr
from scipy.sparse.linalg import ArpackNoConvergence

import crinoid
from crinoid.assembly.control_loop import build_sensors
from crinoid.assembly.prepared import Prepared, at_rest
from crinoid.results.dataset import Instants, build_dataset
from crinoid.results.result import Result, ResultError
from crinoid.scenario import ScenarioError
from crinoid.simulation import LoopState, SimulationError, play
from crinoid.simulation import run as running
from crinoid.simulation.setup import set_up
from crinoid.simulation.sink import resume_state
from helpers.builtin import imbalance
from helpers.loops import assert_equal_runs
from helpers.loops import of_loop as scenario
from helpers.motion import natural_frequencies
from helpers.signals import usual_signals

signals = pytest.fixture(usual_signals, autouse=True)


def simulated(**values: object) -> xr.Dataset:
    return crinoid.simulate(scenario(**values)).dataset


@pytest.fixture(scope="module")
def result() -> Result:
    return crinoid.simulate(scenario())


def test_a_result_has_its_status_and_the_exact_multiples_of_the_interval(result):
    assert result.notes == []
    assert result.dataset.attrs["status"] == "ok"
    assert result.dataset.attrs["seed"] == 0
    np.testing.assert_allclose(result.dataset["time"], 0.02 * np.arange(101), atol=1e-13)


def test_derived_variables_follow_from_the_motion(result):
    dataset = result.dataset
    position = dataset["position"].values
    edges = np.diff(position, axis=1)
    length = np.linalg.norm(edges, axis=2)
    np.testing.assert_allclose(dataset["tangent"].values, edges / length[..., None])
    np.testing.assert_allclose(dataset["tip_position"].values, position[:, -1])
    miss = dataset["tip_position"].values - dataset["tip_target"].values
    np.testing.assert_allclose(dataset["tip_error"].values, np.hypot(*miss.T))
    # the root is where the base is
    pose = dataset["base_pose"].values
    np.testing.assert_allclose(position[:, 0] - [0.0, -10.0], pose[:, :2], atol=1e-15)
    # the moment in the clamp is what bends the arm there: EI (kappa - kappa_rest)
    still = crinoid.equilibrium(scenario()).dataset
    EI = math.pi / 4 * 0.02**4 * result.scenario.arm.youngs_modulus
    bend = EI * still["curvature"].values[0, 0]
    # strain 2 tan(turn / 2) of half an edge: moment and curvature differ at second order
    assert float(still["base_moment"][0]) == pytest.approx(bend, rel=1e-3)


def test_frequencies_are_those_of_the_state_at_the_start(result):
    system = crinoid.system(scenario())
    expected = natural_frequencies(system, system.equilibrium(), 3)
    for run in (result, result.uncontrolled):
        found = run.dataset["natural_frequency"].sel(mode=[1, 2, 3])
        np.testing.assert_allclose(found, expected, rtol=1e-9)
        assert not run.dataset["mode_shape"].sel(node=0).values.any()  # the base holds the root


def test_energy_balances(result):
    assert imbalance(result.uncontrolled.dataset) < 1e-4
    # under control the base's acceleration jumps at every command
    assert imbalance(result.dataset) < 1e-3


def test_control_can_be_switched_on_later():
    late = crinoid.simulate(scenario(control__start=1.0))
    command = late.dataset["base_command"]
    assert np.abs(command.sel(time=slice(None, 0.99)).values).max() == 0.0
    assert np.abs(command.sel(time=slice(1.02, None)).values).max() > 0.0
    ours, free = (run.dataset["position"].loc[:1.0] for run in (late, late.uncontrolled))
    np.testing.assert_array_equal(ours, free)
    # it takes up the error that it finds without a jolt, and its derivative starts from there
    assert float(late.dataset["tip_error"].sel(time=1.0)) > 1e-3
    assert np.abs(command.sel(time=1.02).values).max() < 1e-4


def test_results_do_not_depend_on_how_often_they_are_kept(result):
    rare = simulated(output__interval=0.5)
    np.testing.assert_array_equal(rare["position"].values, result.dataset["position"].values[::25])
    assert int(rare["steps"].sum()) == int(result.dataset["steps"].sum()) == 200
    assert int(rare["newton_iterations"].sum()) == int(result.dataset["newton_iterations"].sum())
    # an interval that does not divide the duration: the end is kept all the same
    uneven = simulated(output__interval=0.3)
    np.testing.assert_allclose(uneven["time"], [0, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8, 2.0])
    end = result.dataset["position"][-1]
    np.testing.assert_array_equal(uneven["position"][-1], end)
    # longer than a stretch of compiled time: the cost of the steps is still complete
    once = simulated(output__interval=2.0)
    np.testing.assert_array_equal(once["position"][-1], end)
    for name in ("steps", "newton_iterations"):
        assert int(once[name].sum()) == int(result.dataset[name].sum())
    assert float(once["residual"].max()) == float(result.dataset["residual"].max())


def test_a_stopped_run_continues_to_the_bit(result, tmp_path):
    part = crinoid.simulate(scenario(simulation__duration=0.7))
    part.save(tmp_path)
    assert_equal_runs(play(Prepared(scenario()), resume=Result.load(tmp_path)), result)


def test_a_run_that_stopped_between_two_kept_instants_counts_on():
    apart = {"output__interval": 0.3, "control__compare": False}
    part = crinoid.simulate(scenario(**apart, simulation__duration=0.7))
    np.testing.assert_allclose(part.dataset["time"], [0.0, 0.3, 0.6, 0.7])
    whole = play(Prepared(scenario(**apart)), resume=part).dataset
    xr.testing.assert_equal(whole, simulated(**apart))
    # a run that is complete has nothing to add
    again = play(Prepared(scenario(**apart, simulation__duration=0.7)), resume=part).dataset
    xr.testing.assert_equal(again, part.dataset)


DAMAGED_DATA = {
    "a variable is missing": (lambda data: data.drop_vars("curvature"), "it has no curvature"),
    "another kind": (lambda data: data.assign(tension=data.tension.astype(str)), "tension is of"),
    "nodes are cut": (lambda data: data.isel(node=slice(5)), "has the shape"),
    "instants are cut": (lambda data: data.isel(time=slice(9)), "not that of its last instant"),
    "an instant is lost": (lambda data: data.isel(time=np.r_[:9, 10:36]), "do not match"),
    "time runs back": (lambda data: data.assign_coords(time=-data["time"]), "not increase from 0"),
    "computed for ever": (lambda data: data.assign_attrs(wall_time=np.inf), "its wall_time is inf"),
    "another version": (lambda data: data.assign_attrs(crinoid_version="0"), "by crinoid 0 and"),
}
POSITION, VELOCITY = "state.motion.position", "state.motion.velocity"


def leaf(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[dict], dict]:
    """Return what changes one leaf of a state."""
    return lambda held: held | {name: np.asarray(change(held[name]))}


DAMAGED_STATE = {
    "no state": (lambda held: {}, "no state that this scenario can go on"),
    "another name": (
        lambda held: {name.replace("memory.slope", "old"): each for name, each in held.items()},
        "of memory.slope it has nothing",
    ),
    "another shape": (leaf("memory.slope", lambda x: x[:-1]), "of memory.slope it"),
    "no number": (leaf("memory.integral", lambda x: np.append(x[:-1], np.nan)), "is not a number"),
    "another count of steps": (leaf("steps", lambda x: x + 30), "do not match"),
    "another count since": (leaf("tally.steps", lambda x: x + 1), "do not match"),
    "another time": (leaf("state.motion.time", lambda x: x + 0.1), "last instant: time is"),
    "velocity for position": (
        lambda held: held | {POSITION: held[VELOCITY], VELOCITY: held[POSITION]},
        "not that of its last instant",
    ),
}


@pytest.fixture(scope="module")
def start() -> tuple[LoopState, xr.Dataset]:
    setup = set_up(Prepared(scenario()))
    carry, first = running.begin(setup.loop, setup.state)
    instant = Instants(setup.loop.system, running.one_instant(first))
    return carry, build_dataset(instant, scenario().arm.diameters)


@pytest.fixture(scope="module")
def part() -> Result:
    return crinoid.simulate(scenario(simulation__duration=0.7, control__compare=False))


@pytest.mark.parametrize("name", [*DAMAGED_DATA, *DAMAGED_STATE])
def test_a_damaged_run_is_not_continued(part, start, name):
    copy = Result(part.dataset.copy(deep=True), dict(part.checkpoint))
    resume_state(copy, *start, stride=2)  # undamaged it can be
    damage, reason = (DAMAGED_DATA | DAMAGED_STATE)[name]
    if name in DAMAGED_DATA:
        copy.dataset = damage(copy.dataset)
    else:
        copy.checkpoint = damage(copy.checkpoint)
    with pytest.raises(ResultError, match=reason) as caught:
        resume_state(copy, *start, stride=2)
    assert "\n" not in str(caught.value)


def test_a_delay_longer_than_the_run_does_not_keep_it_from_being_prolonged():
    # the readings under way are part of the state: as many in the short run as in the long one
    short, long = (
        build_sensors(scenario(sensor__delay=0.9, simulation__duration=duration))[0]
        for duration in (0.3, 1.2)
    )
    assert short.kept == long.kept == 92


@pytest.mark.slow
def test_a_run_off_the_main_thread_is_not_stopped_by_ctrl_c(result):
    short = scenario(simulation__duration=0.1, control__compare=False)
    handler = signal.getsignal(signal.SIGINT)
    with ThreadPoolExecutor(1) as pool:
        found = pool.submit(play, Prepared(short)).result()
    assert found.status == "ok"
    assert signal.getsignal(signal.SIGINT) == handler
    np.testing.assert_array_equal(
        found.dataset["position"][-1], result.dataset["position"].sel(time=0.1, method="nearest")
    )


def test_ctrl_c_stops_a_run_once_and_a_second_one_at_once():
    short = scenario(simulation__duration=0.5, control__compare=False)
    found = play(Prepared(short), report=lambda reached: signal.raise_signal(signal.SIGINT))
    assert found.status.startswith("interrupted at t = 0.")
    again = lambda reached: [signal.raise_signal(signal.SIGINT) for _ in range(2)]  # noqa: E731
    with pytest.raises(KeyboardInterrupt):
        play(Prepared(short), report=again)


def test_an_unsolvable_step_ends_the_run_and_keeps_earlier_instants():
    # one Newton iteration is not enough once the flow has turned the arm
    hopeless = scenario(
        simulation__max_iterations=1,
        simulation__max_halvings=0,
        simulation__start="rest",
        control__compare=False,
        flow__0__velocity=[5.0, 0.0],
    )
    with pytest.raises(SimulationError, match=r"failed at t = .* node \d+ .*time_step") as caught:
        crinoid.simulate(hopeless)
    kept = caught.value.result
    assert kept.status.startswith("failed at t = ")
    for name, variable in kept.dataset.data_vars.items():
        assert np.isfinite(variable.values).all(), name


def test_a_run_does_without_natural_frequencies_that_are_not_found(monkeypatch):
    def never(*_, **__):
        raise ArpackNoConvergence("no convergence (3 iterations)", np.zeros(0), np.zeros((0, 0)))

    monkeypatch.setattr("scipy.sparse.linalg.eigsh", never)
    result = crinoid.simulate(scenario(control__compare=False, simulation__duration=0.1))
    assert result.status == "ok"
    assert "natural_frequency" not in result.dataset
    (note,) = (note for note in result.notes if "no natural frequencies" in note)
    assert "no convergence" in note


# a level arm that nothing bends, whose tip so follows the slide along x and nothing else
LEVEL = {"base__tilt_deg": 0.0, "arm__density": 1025.0}


def test_gains_of_a_channel_that_moves_nothing_controlled_are_refused():
    with pytest.raises(ScenarioError, match=r"control\.pid\.slide: does nothing"):
        set_up(Prepared(scenario(**LEVEL, control__controlled=["z", "angle"])))
    # nor can one be the best of those that do nothing
    alone = scenario(**LEVEL, control__controlled=["z"], control__pid={"slide": {"kp": 0.3}})
    with pytest.raises(ScenarioError, match=r"control\.pid\.slide: does nothing"):
        set_up(Prepared(alone))
    # tilt moves both of them, and slide what is along it
    set_up(Prepared(scenario(**LEVEL, control__controlled=["x", "z", "angle"])))
    # on a pin, without weight, in still water: it may point anywhere
    free = scenario(
        **LEVEL,
        base__mount="pinned",
        base__channels={"slide": {}, "heave": {}},
        control__pid={"slide": {"kp": 0.3}, "heave": {"kp": 0.3}},
        simulation__start="rest",
    )
    with pytest.raises(ScenarioError, match=r"control\.mapping: .* nothing brings this arm back"):
        set_up(Prepared(free))


def test_identity_pairs_each_coordinate_of_the_tip_with_its_channel():
    gains = {"slide": 0.5, "heave": 0.3, "tilt": 0.7}
    case = scenario(
        control__compare=False,
        control__mapping="identity",
        control__controlled=["x", "z", "angle"],
        target__tip=[0.43, -10.2],
        target__angle_deg=-20.0,
        control__pid={name: {"kp": gain} for name, gain in gains.items()},
        base__channels={name: {} for name in gains},
        simulation__duration=0.2,
        output__interval=0.01,
    )
    whole = crinoid.simulate(case).dataset
    angle = whole["tip_angle_target"] - whole["tip_angle"]
    missed = np.column_stack([whole["tip_target"] - whole["tip_position"], angle])
    assert np.abs(missed[0]).min() > 1e-3
    assert list(whole["channel"].values) == list(gains)
    # of proportional gains alone, without a delay: the command of a step is of where it began
    commands = missed[:-1] * list(gains.values())
    np.testing.assert_allclose(whole["base_command"].values[1:], commands, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_arms_without_support_or_strength_have_no_equilibrium():
    floating = scenario(
        base__mount="pinned",
        base__channels={"slide": {}},
        control={"kind": "none"},
        arm__density=1000.0,
        simulation__max_iterations=3,
    ).with_values({"flow": [], "water.gravity": 0.0, "load": [{"kind": "tip", "moment": 1.0}]})
    with pytest.raises(SimulationError, match="no static equilibrium") as caught:
        crinoid.simulate(floating)
    assert "natural_frequency" not in caught.value.result.dataset
    limp = scenario(arm__youngs_modulus=0.4)
    with pytest.raises(SimulationError, match=r"^failed at t = 0 s: an edge .* the limit is 10;"):
        crinoid.equilibrium(limp)


@pytest.mark.slow
def test_a_joint_does_not_let_an_arm_hang_against_its_base():
    upright = crinoid.Scenario(
        arm={"dimension": 3, "nodes": 4}, base={"mount": "pinned", "tilt_deg": 90.0}
    )
    reason = "try a base that points less than 170 degrees from"
    with pytest.raises(SimulationError, match=reason):
        crinoid.equilibrium(upright)
    # the gains of a controller say nothing about the shape in which the search got stuck
    pid = {"kind": "pid", "controlled": ["x"], "pid": {"slide": {"kp": 1.0}}}
    held = {"simulation.start": "equilibrium", "base.channels": {"slide": {}}}
    held |= {"control": pid | {"mapping": "identity"}}
    assert reason in play(Prepared(upright.with_values(held))).failure


def test_several_cases_are_not_one_run():
    several = scenario(vary={"arm.length": [0.4, 0.5]})
    batch = partial(crinoid.simulate_batch, seeds=2)
    for command in (crinoid.simulate, crinoid.equilibrium, crinoid.closed_loop, batch):
        with pytest.raises(ValueError, match="several cases"):
            command(several)


def test_an_equilibrium_carries_no_load_of_a_flow_that_is_just_turning():
    # at t = 0 the water stands still everywhere, on its way to flow upward
    swinging = {"flow__1__amplitude": [0.0, 0.4], "flow__1__frequency_hz": 1.0}
    still = scenario(**LEVEL, **swinging, flow__0__velocity=[0.0, 0.0])
    found = crinoid.equilibrium(still).dataset
    np.testing.assert_allclose(found["tip_position"].values[0], [0.5, -10.0], atol=1e-9)
    np.testing.assert_allclose(found["base_force"].values[0], 0.0, atol=1e-8)


@pytest.mark.release
@pytest.mark.parametrize("duration", [0.58, 0.7])
def test_a_table_that_ends_with_the_run_moves_the_base_to_the_last(duration):
    # sums of time steps that round-off carries past the end of the table
    table = {"kind": "table", "channel": "heave", "time": [0.0, duration], "value": [0.0, 0.1]}
    moving = {"base__motion": [table], "simulation__duration": duration}
    moving |= {"simulation__start": "rest"}
    dataset = simulated(**moving, control__compare=False)
    speed = dataset["velocity"].sel(node=0, axis="z").values
    np.testing.assert_allclose(speed, 0.1 / duration, rtol=1e-9)
    # the pose is what the servos do and what is prescribed
    prescribed = dataset["base_pose"] - dataset["base_servo"]
    heave = 0.1 * dataset["time"] / duration
    np.testing.assert_allclose(prescribed.sel(channel="heave"), heave, atol=1e-12)
    assert float(np.abs(prescribed.drop_sel(channel="heave")).max()) < 1e-15
    assert float(np.abs(dataset["base_servo"].sel(channel="tilt")).max()) > 1e-4


def test_the_gain_margin_is_where_a_run_begins_to_swing_by_itself():
    still = scenario(
        flow__0__velocity=[0.0, 0.0],
        flow__1__amplitude=[0.0, 1e-4],
        arm__youngs_modulus=5e6,
        arm__damping_time=0.05,
        control__compare=False,
        simulation__duration=10.0,
    )
    most = set_up(Prepared(still)).open_loop.margin().gain
    late = {}
    for share in (0.9, 1.1):
        gains = {
            f"control.pid.{name}.{term}": share * most * getattr(given, term)
            for name, given in still.control.pid.present.items()
            for term in ("kp", "ki", "kd")
        }
        run = crinoid.simulate(still.with_values(gains))
        error = run.dataset["tip_error"].values
        third = error.size // 3
        late[share] = error[-third:].max() / error[third : 2 * third].max()
        assert any("grow by themselves" in note for note in run.notes) == (share > 1)
    assert late[0.9] < 1.2
    assert late[1.1] > 2.0


@pytest.mark.release
def test_a_target_that_the_submarine_carries_is_held_however_late_the_readings():
    # a reading of 50 ms ago and a target of now would hold the tip 15 mm ahead
    scenario = crinoid.Scenario(
        arm={"nodes": 5, "youngs_modulus": 1e8},
        water={"density": 0.0, "gravity": 0.0},
        base={
            "channels": {"heave": {"bandwidth_hz": 10.0}},
            "motion": [{"channel": "heave", "kind": "velocity", "velocity": 0.3}],
        },
        target={"frame": "base"},
        sensor={"delay": 0.05},
        control={"kind": "pid", "controlled": ["z"], "pid": {"heave": {"ki": 2.0}}},
        simulation={"duration": 4.0, "start": "rest"},
    ).with_values({"control.compare": False})
    data = crinoid.simulate(scenario).dataset
    height = data["tip_target"].sel(axis="z")
    assert float(height[-1] - height[0]) > 0.9
    assert float(data["tip_error"].sel(time=slice(2.0, None)).max()) < 1e-3


def test_the_equilibrium_of_a_scenario_that_feeds_forward_needs_no_controller():
    circle = {"path": "circle", "radius": 0.1, "period": 5.0, "feed_forward": True}
    still = at_rest(scenario(target=circle))
    assert still.control.kind == "none"
    assert not still.target.feeds_forward
