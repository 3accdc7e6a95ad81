import math
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from scipy.sparse.linalg import ArpackNoConvergence

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.sensor import build_sensors
from crinoid.dataset import Instants, build_dataset
from crinoid.dynamics import Outcome
from crinoid.metrics import tip_error
from crinoid.programs import Program, Store
from crinoid.programs.store import STORE
from crinoid.result import Result, ResultError
from crinoid.scenario import ScenarioError
from crinoid.simulation import LoopState, SimulationError, at_rest, play
from crinoid.simulation import run as running
from crinoid.simulation.ahead import compile_ahead
from crinoid.simulation.continuation import restored
from crinoid.simulation.setup import set_up
from crinoid.simulation.stretch import CAPACITY, stretch

# one shape of arm, flows and controller for all tests: they share their compiled code
SCENARIO = """
[arm]
nodes = 11
youngs_modulus = 5e5
[base]
tilt_deg = -30
[base.channels.slide]
[base.channels.tilt]
[[flow]]
kind = "uniform"
velocity = [0.2, 0.0]
ramp_time = 1.0
[[flow]]
kind = "sine"
amplitude = [0.05, 0.02]
frequency_hz = 0.5
[control]
kind = "pid"
[control.pid.slide]
kp = 0.3
ki = 2.0
[control.pid.tilt]
kp = 0.3
ki = 2.0
kd = 0.05
[simulation]
duration = 2.0
"""


def scenario(**values: object) -> crinoid.Scenario:
    keys = {key.replace("__", "."): value for key, value in values.items()}
    return crinoid.Scenario.from_toml(SCENARIO).with_values(keys)


@pytest.fixture(scope="module")
def result() -> Result:
    return crinoid.simulate(scenario())


def test_every_variable_has_units_and_the_contract_s_dimensions(result):
    dataset = result.dataset
    expected = {
        "position": ("time", "node", "axis"),
        "velocity": ("time", "node", "axis"),
        "acceleration": ("time", "node", "axis"),
        "tangent": ("time", "edge", "axis"),
        "curvature": ("time", "node"),
        "tension": ("time", "edge"),
        "tip_position": ("time", "axis"),
        "tip_target": ("time", "axis"),
        "tip_angle": ("time",),
        "tip_error": ("time",),
        "base_command": ("time", "channel"),
        "base_servo": ("time", "channel"),
        "sensor_reading": ("time", "reading"),
        "base_pose": ("time", "channel"),
        "base_force": ("time", "axis"),
        "base_moment": ("time",),
        "flow_velocity": ("time", "node", "axis"),
        "energy": ("time", "kind"),
        "natural_frequency": ("mode",),
        "mode_shape": ("mode", "node", "axis"),
        "reynolds_number": ("time", "node"),
        "reduced_velocity": ("time", "node"),
        "keulegan_carpenter": ("node",),
        "newton_iterations": ("time",),
        "residual": ("time",),
    }
    for name, dims in expected.items():
        assert dataset[name].dims == dims, name
    for name, variable in dataset.data_vars.items():
        # of several units: see channel_unit and reading_unit
        mixed = not {"channel", "reading"}.isdisjoint(variable.dims)
        assert mixed == ("units" not in variable.attrs), name
        assert variable.attrs["long_name"], name
        assert np.isfinite(variable.values).all(), name
    assert dataset["flow_speed"].attrs["standard_name"] == "sea_water_speed"
    assert dataset.attrs["status"] == "ok"
    assert dataset.attrs["seed"] == 0
    assert list(dataset["axis"].values) == ["x", "z"]


def test_times_are_the_exact_multiples_of_the_interval(result):
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
    expected = system.natural_frequencies(system.equilibrium(), count=3)
    for run in (result, result.uncontrolled):
        found = run.dataset["natural_frequency"].sel(mode=[1, 2, 3])
        np.testing.assert_allclose(found, expected, rtol=1e-9)
        assert not run.dataset["mode_shape"].sel(node=0).values.any()  # the base holds the root


def test_an_arm_that_hangs_in_a_current_at_lock_in_has_a_note(result):
    assert result.notes == []
    diameter, reduced_velocity = 0.04, 6.0
    first = float(result.dataset["natural_frequency"][0])  # of nearly the same arm
    slow = scenario(base__tilt_deg=-90, simulation__duration=12.0).with_values(
        {
            "flow.0.velocity": [reduced_velocity * first * diameter, 0.0],
            "flow.0.ramp_time": 0.0,
            "flow.1.amplitude": [0.0, 0.0],
        }
    )
    free = crinoid.simulate(slow).uncontrolled
    assert float(free.dataset["reduced_velocity"].mean()) == pytest.approx(6.0, rel=0.1)
    assert len(free.notes) == 1
    assert free.notes[0].startswith("vortex shedding may lock in to mode 1 (")


def test_energy_balances(result):
    def defect(run: Result) -> float:
        energy = run.dataset["energy"]
        stored = energy.sel(kind=["kinetic", "elastic", "potential"]).sum("kind")
        works = energy.sel(kind=["drag", "damping", "actuation", "loads", "added_mass"])
        off = (stored - stored[0] - works.sum("kind")).values
        return float(np.abs(off).max() / np.abs(works.values).max())

    assert defect(result.uncontrolled) < 1e-4
    # under control the base's acceleration jumps at every command
    assert defect(result) < 1e-3


def test_the_comparison_is_the_same_run_with_the_base_at_rest(result):
    other = result.uncontrolled
    assert np.abs(other.dataset["base_command"].values).max() == 0.0
    alone = crinoid.simulate(scenario(control__kind="none")).dataset
    np.testing.assert_allclose(other.dataset["position"], alone["position"], atol=1e-12)


def test_control_can_be_switched_on_later():
    late = crinoid.simulate(scenario(control__start=1.0))
    command = late.dataset["base_command"]
    assert np.abs(command.sel(time=slice(None, 0.99)).values).max() == 0.0
    assert np.abs(command.sel(time=slice(1.02, None)).values).max() > 0.0
    before = slice(None, 1.0)
    np.testing.assert_array_equal(
        late.dataset["position"].sel(time=before),
        late.uncontrolled.dataset["position"].sel(time=before),
    )
    # it takes up the error that it finds without a jolt, and its derivative starts from there
    assert float(late.dataset["tip_error"].sel(time=1.0)) > 1e-3
    assert np.abs(command.sel(time=1.02).values).max() < 1e-4


def test_results_do_not_depend_on_how_often_they_are_kept(result):
    rare = crinoid.simulate(scenario(output__interval=0.5)).dataset
    np.testing.assert_array_equal(rare["position"].values, result.dataset["position"].values[::25])
    assert int(rare["steps"].sum()) == int(result.dataset["steps"].sum()) == 200
    assert int(rare["newton_iterations"].sum()) == int(result.dataset["newton_iterations"].sum())
    # an interval that does not divide the duration: the end is kept all the same
    uneven = crinoid.simulate(scenario(output__interval=0.3)).dataset
    np.testing.assert_allclose(uneven["time"], [0, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8, 2.0])
    np.testing.assert_array_equal(
        uneven["position"].values[-1], result.dataset["position"].values[-1]
    )


def test_seeds_change_the_noise_and_nothing_else():
    noisy = {"sensor__noise_position": 1e-3, "control__compare": False}
    first = crinoid.simulate(scenario(**noisy)).dataset
    again = crinoid.simulate(scenario(**noisy)).dataset
    other = crinoid.simulate(scenario(**noisy, seed=1)).dataset
    np.testing.assert_array_equal(first["position"], again["position"])
    assert np.abs(first["base_command"].values - other["base_command"].values).max() > 1e-5
    np.testing.assert_array_equal(first["position"][0], other["position"][0])


def test_targets_can_move_and_are_held_at_the_ends():
    moving = scenario(target__time=[0.5, 1.5], target__tip=[[0.4, -10.2], [0.42, -10.2]])
    target = crinoid.simulate(moving).dataset["tip_target"]
    np.testing.assert_allclose(target.sel(time=slice(0, 0.5)), [[0.4, -10.2]] * 26)
    np.testing.assert_allclose(target.sel(time=slice(1.5, None)), [[0.42, -10.2]] * 26)
    assert (np.diff(target.values[:, 0]) >= 0).all()


def test_a_target_on_its_way_is_taken_up_without_a_jolt():
    path = {"target__time": [0.5, 1.5], "target__tip": [[0.4, -10.2], [0.42, -10.2]]}
    late = scenario(**path, control__start=0.9, control__compare=False, output__interval=0.01)
    command = crinoid.simulate(late).dataset["base_command"].values
    changes = np.abs(np.diff(command, axis=0)).max(axis=0)
    driven = changes > 0
    assert driven.sum() == 2
    assert np.all(changes[driven] < 0.05 * np.abs(command).max(axis=0)[driven])


def test_a_result_comes_back_from_its_file(result, tmp_path):
    paths = result.save(tmp_path)
    assert [path.name for path in paths] == ["result.nc", "uncontrolled.nc"]
    with xr.open_dataset(paths[0]) as dataset:
        xr.testing.assert_identical(dataset.load(), result.dataset)
    back = Result.load(tmp_path)
    assert back.scenario == scenario()
    assert tip_error(back.uncontrolled) == tip_error(result.uncontrolled)
    # no half-written or temporary file is left behind
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result.nc", "uncontrolled.nc"]


def test_files_that_are_no_results_are_refused(tmp_path):
    with pytest.raises(ResultError, match="no such result"):
        Result.load(tmp_path)
    (tmp_path / "result.nc").write_text("not netCDF")
    with pytest.raises(ResultError, match="not a result of crinoid"):
        Result.load(tmp_path)


def test_a_run_goes_on_from_where_it_stopped_as_if_it_had_not(result, tmp_path):
    part = crinoid.simulate(scenario(simulation__duration=0.7))
    part.save(tmp_path)
    whole = play(Prepared(scenario()), resume=Result.load(tmp_path))
    for mine, other in ((whole, result), (whole.uncontrolled, result.uncontrolled)):
        assert set(mine.dataset.variables) == set(other.dataset.variables)
        for name in other.dataset.variables:
            np.testing.assert_array_equal(mine.dataset[name], other.dataset[name], str(name))
        assert mine.notes == other.notes


def test_a_run_that_goes_on_needs_no_program_of_its_own(result, part, monkeypatch):
    kinds = []

    def watched(*args: object) -> object:
        kinds.append([jax.typeof(leaf) for leaf in jax.tree.leaves(args)])
        return stretch(*args)

    stretch = running.stretch
    monkeypatch.setattr(running, "stretch", watched)
    short = scenario(control__compare=False, simulation__duration=0.8)
    play(Prepared(short))
    fresh = len(kinds)
    play(Prepared(short), resume=part)
    assert len(kinds) >= fresh + 2 >= 4
    assert all(kind == kinds[0] for kind in kinds)


def test_a_run_that_stopped_between_two_kept_instants_counts_on():
    apart = {"output__interval": 0.3, "control__compare": False}
    part = crinoid.simulate(scenario(**apart, simulation__duration=0.7))
    np.testing.assert_allclose(part.dataset["time"], [0.0, 0.3, 0.6, 0.7])
    whole = play(Prepared(scenario(**apart)), resume=part).dataset
    unbroken = crinoid.simulate(scenario(**apart)).dataset
    for name in unbroken.variables:
        np.testing.assert_array_equal(whole[name], unbroken[name], str(name))
    # a run that is complete has nothing to add
    again = play(Prepared(scenario(**apart, simulation__duration=0.7)), resume=part).dataset
    for name in part.dataset.variables:
        np.testing.assert_array_equal(again[name], part.dataset[name], str(name))


def _without(*names: str) -> Callable[[Result], None]:
    def tamper(part: Result) -> None:
        part.dataset = part.dataset.drop_vars(names)

    return tamper


def _with(name: str, change: Callable[[np.ndarray], object]) -> Callable[[Result], None]:
    def tamper(part: Result) -> None:
        variable = part.dataset[name]
        part.dataset[name] = (variable.dims, np.asarray(change(variable.values.copy())))

    return tamper


def _state(name: str, change: Callable[[np.ndarray], object]) -> Callable[[Result], None]:
    def tamper(part: Result) -> None:
        part.checkpoint[name] = np.asarray(change(part.checkpoint[name].copy()))

    return tamper


def _swapped(one: str, other: str) -> Callable[[Result], None]:
    def tamper(part: Result) -> None:
        leaves = part.checkpoint
        leaves[one], leaves[other] = leaves[other], leaves[one]

    return tamper


def _not_a_number(values: np.ndarray) -> np.ndarray:
    values.flat[-1] = np.nan
    return values


TAMPERED = {
    "a variable is missing": (_without("curvature"), "it has no curvature"),
    "a coordinate is missing": (_without("arc_length"), "it has no arc_length"),
    "another kind": (_with("tension", lambda x: x.astype(str)), "its tension is of <U"),
    "nodes are cut": (
        lambda part: setattr(part, "dataset", part.dataset.isel(node=slice(5))),
        "has the shape",
    ),
    "instants are cut": (
        lambda part: setattr(part, "dataset", part.dataset.isel(time=slice(9))),
        "not that of its last instant",
    ),
    "an instant is lost": (
        lambda part: setattr(part, "dataset", part.dataset.isel(time=np.r_[:9, 10:36])),
        "do not go together",
    ),
    "time runs back": (_with("time", lambda x: x[::-1]), "its time does not increase from 0"),
    "computed for ever": (
        lambda part: part.dataset.attrs.update(wall_time=np.inf),
        "its wall_time is inf",
    ),
    "another version": (
        lambda part: part.dataset.attrs.update(crinoid_version="0.0.1"),
        "saved by crinoid 0.0.1 and this is",
    ),
    "no state": (lambda part: part.checkpoint.clear(), "no state that this scenario can go on"),
    "a state of another name": (
        lambda part: part.checkpoint.update(old=part.checkpoint.pop("memory.slope")),
        "of memory.slope it has nothing",
    ),
    "a state of another shape": (_state("memory.slope", lambda x: x[:-1]), "of memory.slope it"),
    "a state that is not a number": (
        _state("memory.integral", _not_a_number),
        "memory.integral is not a number",
    ),
    "another count of steps": (_state("steps", lambda x: x + 30), "do not go together"),
    "another count since": (_state("tally.steps", lambda x: x + 1), "do not go together"),
    "counts of one": (
        _state("steps", lambda x: 0 * x + 1),
        "it holds 36 instants and a state after 1 time step, ",
    ),
    "another time": (_state("state.motion.time", lambda x: x + 0.1), "last instant: time is"),
    "velocity for position": (
        _swapped("state.motion.velocity", "state.motion.position"),
        "not that of its last instant",
    ),
}


@pytest.fixture(scope="module")
def begun() -> tuple[LoopState, xr.Dataset]:
    setup = set_up(Prepared(scenario()))
    carry, first = running.begin(setup.loop, setup.state)
    instant = Instants(setup.loop.system, running.one_instant(first))
    return carry, build_dataset(instant, scenario().arm.diameters)


@pytest.fixture(scope="module")
def part() -> Result:
    return crinoid.simulate(scenario(simulation__duration=0.7, control__compare=False))


@pytest.mark.parametrize("kind", ["pid", "none"])
def test_what_is_compiled_ahead_is_what_the_run_takes(tmp_path, monkeypatch, kind):
    given = []
    monkeypatch.setattr(Program, "will_compile", lambda *_: True)
    monkeypatch.setattr(Program, "compile_ahead", lambda program, *args: given.append(args))
    prepared = Prepared(scenario(control__kind=kind))
    compile_ahead(prepared)
    setup = set_up(prepared)
    carry, _ = running.begin(setup.loop, setup.state)
    token = STORE.set(Store(tmp_path))
    args = (setup.loop, carry, carry.steps, jnp.asarray(3, int), CAPACITY)
    ahead, asked = (stretch._key(*jax.tree.flatten((each, {}))) for each in (*given, args))
    STORE.reset(token)
    assert asked is not None
    assert ahead == asked


@pytest.mark.parametrize(("tamper", "reason"), TAMPERED.values(), ids=TAMPERED.keys())
def test_what_is_not_whole_is_not_gone_on_with(part, begun, tmp_path, tamper, reason):
    copy = Result(part.dataset.copy(deep=True), part.checkpoint)
    restored(copy, *begun, stride=2)  # as it is it can be
    tamper(copy)
    with pytest.raises(ResultError, match=reason) as caught:
        restored(copy, *begun, stride=2)
    assert "\n" not in str(caught.value)


def test_a_delay_longer_than_the_run_does_not_keep_it_from_being_prolonged():
    # the readings under way are part of the state: as many in the short run as in the long one
    short, long = (
        build_sensors(scenario(sensor__delay=0.9, simulation__duration=duration))[0]
        for duration in (0.3, 1.2)
    )
    assert short.kept == long.kept == 92


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


def test_an_arm_that_stretches_as_no_material_does_fails():
    limp = scenario(**{"arm.youngs_modulus": 0.4})
    with pytest.raises(SimulationError, match=r"^failed at t = 0 s: an edge .* no arm bears 10;"):
        crinoid.equilibrium(limp)


def test_a_start_that_failed_compiles_no_time_steps(monkeypatch):
    def stretch(*_: object) -> None:
        raise AssertionError("compiled")

    monkeypatch.setattr(running, "stretch", stretch)
    never = Outcome.of_nothing(converged=False)
    setup = set_up(Prepared(scenario()))._replace(outcome=never)
    monkeypatch.setattr(running, "set_up", lambda scenario: setup)
    failed = play(Prepared(scenario()))
    assert failed.failure.startswith("failed at t = 0 s")
    assert failed.uncontrolled.failure.startswith("failed at t = 0 s")


def test_a_step_that_cannot_be_solved_ends_the_run_with_what_there_is():
    # one Newton iteration is not enough once the flow has turned the arm
    hopeless = scenario(
        simulation__max_iterations=1, simulation__max_halvings=0, control__compare=False
    )
    hopeless = hopeless.with_values({"flow.0.velocity": [5.0, 0.0], "simulation.start": "rest"})
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
    told = [note for note in result.notes if "no natural frequencies" in note]
    assert len(told) == 1
    assert "no convergence" in told[0]


# a level arm that nothing bends, whose tip so follows the slide along x and nothing else
LEVEL = {"base__tilt_deg": 0.0, "arm__density": 1025.0}


def test_gains_of_a_channel_that_moves_nothing_of_what_is_controlled_are_refused():
    with pytest.raises(ScenarioError, match=r"control\.pid\.slide: does nothing"):
        set_up(Prepared(scenario(**LEVEL, control__controlled=["z", "angle"])))
    # nor can one be the best of those that do nothing
    with pytest.raises(ScenarioError, match=r"control\.pid\.slide: does nothing"):
        set_up(
            Prepared(
                scenario(**LEVEL, control__controlled=["z"], control__pid={"slide": {"kp": 0.3}})
            )
        )
    # tilt moves both of them, and slide what is along it
    set_up(Prepared(scenario(**LEVEL, control__controlled=["x", "z", "angle"])))


def test_a_mapping_of_an_arm_that_nothing_holds_in_place_is_refused():
    # on a pin, without weight, in still water: it may point anywhere
    gains = {"slide": {"kp": 0.3}, "heave": {"kp": 0.3}}
    free = scenario(
        **LEVEL,
        base__mount="pinned",
        base__channels={"slide": {}, "heave": {}},
        control__pid=gains,
        simulation__start="rest",
    )
    with pytest.raises(ScenarioError, match=r"control\.mapping: .* nothing brings this arm back"):
        set_up(Prepared(free))


def test_identity_pairs_each_coordinate_of_the_tip_with_its_channel():
    gains = {"slide": 0.5, "heave": 0.3, "tilt": 0.7}
    case = scenario(
        control__compare=False, control__mapping="identity",
        control__controlled=["x", "z", "angle"], target__tip=[0.43, -10.2], target__angle_deg=-20.0,
        control__pid={name: {"kp": gain} for name, gain in gains.items()},
        base__channels={name: {} for name in gains},
        simulation__duration=0.2, output__interval=0.01,
    )  # fmt: skip
    whole = crinoid.simulate(case).dataset
    missed = np.column_stack(
        [
            whole["tip_target"].values - whole["tip_position"].values,
            whole["tip_angle_target"].values - whole["tip_angle"].values,
        ]
    )
    assert np.abs(missed[0]).min() > 1e-3
    assert list(whole["channel"].values) == list(gains)
    # of proportional gains alone, without a delay: the command of a step is of where it began
    commands = missed[:-1] * list(gains.values())
    np.testing.assert_allclose(whole["base_command"].values[1:], commands, rtol=0, atol=1e-12)


def test_an_arm_that_nothing_holds_has_no_equilibrium():
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


def test_a_joint_does_not_let_an_arm_hang_against_its_base():
    upright = crinoid.Scenario(
        arm={"dimension": 3, "nodes": 4}, base={"mount": "pinned", "tilt_deg": 90.0}
    )
    reason = "try a base that points less than 170 degrees from"
    with pytest.raises(SimulationError, match=reason):
        crinoid.equilibrium(upright)
    # the gains of a controller say nothing about the shape in which the search got stuck
    held = upright.with_values(
        {
            "simulation.start": "equilibrium",
            "base.channels": {"slide": {}},
            "control": {
                "kind": "pid",
                "controlled": ["x"],
                "mapping": "identity",
                "pid": {"slide": {"kp": 1.0}},
            },
        }
    )
    assert reason in play(Prepared(held)).failure


def test_several_cases_are_not_one_run():
    several = crinoid.Scenario.from_toml(SCENARIO + '[vary]\n"arm.length" = [0.4, 0.5]\n')
    for command in (crinoid.simulate, crinoid.equilibrium):
        with pytest.raises(ValueError, match="several cases"):
            command(several)


def test_the_public_core_steps_and_differentiates():
    system = crinoid.system(scenario())
    state = system.equilibrium()

    def height(tilt: jax.Array) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        def one(state, _):
            state, outcome = system.step(state, jnp.zeros(3).at[2].set(tilt))
            return state, (state.time, outcome.converged)

        end, told = jax.lax.scan(one, state, None, length=5)
        return system.tip(end)[1], told

    value_and_slope = jax.jit(jax.value_and_grad(height, has_aux=True))
    (_, (times, converged)), slope = value_and_slope(0.01)
    ends = [value_and_slope(tilt)[0][0] for tilt in (0.01 - 1e-5, 0.01 + 1e-5)]
    assert float(slope) == pytest.approx(float(ends[1] - ends[0]) / 2e-5, rel=1e-5)
    assert bool(converged.all())
    assert float(times[0]) == 0.01


def test_an_equilibrium_carries_no_load_of_a_flow_that_is_just_turning():
    # at t = 0 the water stands still everywhere, on its way to flow upward
    swinging = {"flow__1__amplitude": [0.0, 0.4], "flow__1__frequency_hz": 1.0}
    calm = {"flow__0__velocity": [0.0, 0.0]}
    still = scenario(**calm, **swinging, base__tilt_deg=0.0, arm__density=1025.0)
    found = crinoid.equilibrium(still).dataset
    np.testing.assert_allclose(found["tip_position"].values[0], [0.5, -10.0], atol=1e-9)
    np.testing.assert_allclose(found["base_force"].values[0], 0.0, atol=1e-8)


@pytest.mark.parametrize("duration", [0.58, 0.7])
def test_a_table_that_ends_with_the_run_moves_the_base_to_the_last(duration):
    # sums of time steps that round-off carries past the end of the table
    table = {"kind": "table", "channel": "heave", "time": [0.0, duration], "value": [0.0, 0.1]}
    moving = scenario(base__motion=[table], simulation__duration=duration, control__compare=False)
    dataset = crinoid.simulate(moving).dataset
    speed = dataset["velocity"].sel(node=0, axis="z").values
    np.testing.assert_allclose(speed, 0.1 / duration, rtol=1e-9)
    # the pose is what the servos do and what is prescribed
    prescribed = dataset["base_pose"] - dataset["base_servo"]
    heave = 0.1 * dataset["time"] / duration
    np.testing.assert_allclose(prescribed.sel(channel="heave"), heave, atol=1e-12)
    assert float(np.abs(prescribed.drop_sel(channel="heave")).max()) < 1e-15
    assert float(np.abs(dataset["base_servo"].sel(channel="tilt")).max()) > 1e-4


def test_a_long_interval_between_kept_instants_changes_nothing(result):
    # longer than a stretch of compiled time: the cost of the steps is still all told
    once = crinoid.simulate(scenario(output__interval=2.0)).dataset
    np.testing.assert_array_equal(
        once["position"].values[-1], result.dataset["position"].values[-1]
    )
    for name in ("steps", "newton_iterations"):
        assert int(once[name].sum()) == int(result.dataset[name].sum())
    assert float(once["residual"].max()) == float(result.dataset["residual"].max())


def test_a_checkpoint_of_another_loop_is_refused(result):
    still = crinoid.equilibrium(scenario())
    with pytest.raises(ResultError, match="no state that this scenario can go on from"):
        play(Prepared(scenario()), resume=still)


def test_the_gain_margin_is_where_a_run_begins_to_swing_by_itself():
    calm = {"flow__0__velocity": [0.0, 0.0], "flow__1__amplitude": [0.0, 1e-4]}
    still = scenario(
        **calm,
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


def test_a_target_that_the_submarine_carries_is_held_however_late_the_readings():
    # a reading of 50 ms ago beside a target of now would hold the tip 15 mm ahead
    scenario = crinoid.Scenario(
        arm={"nodes": 5, "youngs_modulus": 1e8},
        water={"density": 0.0, "gravity": 0.0},
        base={
            "channels": {"heave": {"bandwidth_hz": 10.0}},
            "motion": [{"channel": "heave", "kind": "velocity", "velocity": 0.3}],
        },
        target={"frame": "base"},
        sensor={"delay": 0.05},
        control={
            "kind": "pid",
            "controlled": ["z"],
            "compare": False,
            "pid": {"heave": {"ki": 2.0}},
        },
        simulation={"duration": 4.0},
    )
    data = crinoid.simulate(scenario).dataset
    assert float(data["tip_target"].sel(axis="z")[-1] - data["tip_target"].sel(axis="z")[0]) > 0.9
    assert float(data["tip_error"].sel(time=slice(2.0, None)).max()) < 1e-3


def test_the_equilibrium_of_a_scenario_that_feeds_forward_needs_no_controller():
    circle = {"path": "circle", "radius": 0.1, "period": 5.0, "feed_forward": True}
    scenario = crinoid.Scenario.from_toml(SCENARIO).with_values({"target": circle})
    still = at_rest(scenario)
    assert still.control.kind == "none"
    assert not still.target.feeds_forward
