"""Reduction, observer and LQG control: solutions on paper, second solvers, and the closed loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_lyapunov
from scipy.optimize import lsq_linear

import crinoid
from crinoid.analysis.margins import find_margins
from crinoid.assembly.forecast import Fluctuation, fluctuations, vortex_shedding
from crinoid.assembly.linear import calm_current
from crinoid.assembly.observer import ReadingSchedule, values_in_current
from crinoid.assembly.prepared import Prepared
from crinoid.control import Braking, Clock, Sensor, TipPose, WaterVelocity
from crinoid.control.lqg import nearest
from crinoid.numerics.kalman import stationary_covariance, stationary_filter
from crinoid.numerics.signals_and_systems import balanced
from crinoid.results.errors import tip_error
from crinoid.results.saturation import limit_shares
from crinoid.scenario import Scenario
from crinoid.simulation.setup import set_up


def random_model(size, inputs, outputs, seed):
    draw = np.random.default_rng(seed)
    A = draw.standard_normal((size, size))
    A *= 0.97 / np.abs(np.linalg.eigvals(A)).max()
    return A, draw.standard_normal((size, inputs)), draw.standard_normal((outputs, size))


def transfer(A, B, C, angle):
    return C @ np.linalg.solve(np.exp(1j * angle) * np.eye(A.shape[0]) - A, B)


@pytest.mark.parametrize("kept", [2, 5, 9])
def test_a_reduced_model_errs_by_no_more_than_what_was_left_out(kept):
    model = random_model(12, 2, 3, 1)
    reduced = balanced(*model, share=0.0, most=kept)
    bound = 2 * reduced.hankel[kept:].sum()
    errors = [
        np.linalg.norm(transfer(*model, angle) - transfer(*reduced[:3], angle), 2)
        for angle in np.linspace(0, np.pi, 200)
    ]
    assert reduced.A.shape == (kept, kept)
    # Glover's bound, and it is not far from being reached
    assert bound / 50 < max(errors) <= bound


def test_a_motion_that_grows_is_kept_whole():
    A, B, C = random_model(8, 1, 1, 2)
    A[0], A[:, 0] = 0.0, 0.0
    A[0, 0] = 1.05
    basis = np.random.default_rng(3).standard_normal((8, 8))
    inverse = np.linalg.inv(basis)
    reduced = balanced(basis @ A @ inverse, basis @ B, C @ inverse, share=1e-3, most=4)
    assert np.abs(np.linalg.eigvals(reduced.A)).max() == pytest.approx(1.05, rel=1e-9)
    np.testing.assert_allclose(reduced.left @ reduced.right, np.eye(len(reduced.A)), atol=1e-9)


RATE = 2 * np.pi / 2.0
SWINGING = expm(RATE * np.array([[0.0, 1.0], [-1.0, -2 * 0.15]]))[0, 0]


@pytest.mark.parametrize(("damping", "expected"), [(None, np.exp(-0.5)), (0.15, SWINGING)])
def test_fluctuating_water_has_its_variance_and_its_memory(damping, expected):
    water = Fluctuation(np.ones(2), 2.0, damping)
    F, Q, S = water.process(0.01)
    spread = np.eye(F.shape[0])
    np.testing.assert_allclose(F @ spread @ F.T + Q, spread, atol=1e-12)
    stationary_covariance = (S @ np.linalg.matrix_power(F, 100) @ S.T).item()
    assert stationary_covariance == pytest.approx(expected, rel=1e-9)
    # and so has what a forecast takes for granted
    later = water.covariance(np.zeros((3, 2)), np.array([0.0, 1.0, -1.0]))
    same = np.array([1.0, expected, expected])
    np.testing.assert_allclose(later, same[:, None, None] * np.eye(2), rtol=1e-9, atol=1e-15)


def test_water_that_drifts_past_comes_later_downstream():
    record = Fluctuation(np.array([0.2, 0.1]), 2.0, slowness=np.array([4.0, 0.0]))
    here, there = (record.covariance(np.array([away, 0.3]), np.array(1.0)) for away in (0.25, 0.0))
    np.testing.assert_allclose(here, np.diag([0.04, 0.01]))
    np.testing.assert_allclose(there, np.exp(-0.5) * here)
    assert not record.accelerates


def test_drag_is_linear_about_the_water_of_calm_moments():
    current, steeper = calm_current(np.array([-0.06, 0.01]), np.array([0.2, 0.05]))
    speed = np.abs(np.random.default_rng(1).normal(0.06, 0.2, 400_000))
    assert current[0] == pytest.approx(-np.quantile(speed, 0.25), rel=0.02)
    assert current[1] == 0.01
    assert steeper * abs(current[0]) == pytest.approx(speed.mean(), rel=0.02)


def test_the_fluctuations_of_the_water_come_from_its_flows():
    swell, drift, rest = fluctuations(crinoid.load("station-keeping"), {}, (), 1.0)
    np.testing.assert_allclose(swell.deviation, [0.25 / np.sqrt(2), 0.0])
    assert swell.time == pytest.approx(1 / 0.0833)
    np.testing.assert_allclose(drift.deviation, 0.8 * 0.06)
    # the swell carries the eddies too, to and fro
    assert drift.time == pytest.approx(1.0 / np.hypot(0.06, 0.25 / np.sqrt(2)))
    np.testing.assert_allclose(drift.drift, [0.06, 0.0])
    assert drift.length == 1.0
    assert swell.accelerates
    assert (rest.deviation > 0).all()


def test_fluctuations_of_a_record_scale_with_how_it_is_played():
    played = crinoid.load("tidal-channel")
    slower = played.with_values({"flow.0.time_scale": 0.5, "flow.0.velocity_scale": 0.165})
    quick, slow = (
        fluctuations(scenario, Prepared(scenario).recordings, (), 1.0)[0]
        for scenario in (played, slower)
    )
    assert 0.5 < quick.time < 5  # `crinoid flow tidal-channel`: 1.5 s where it is played
    np.testing.assert_allclose(slow.deviation, quick.deviation / 2, rtol=1e-9)
    assert slow.time == pytest.approx(2 * quick.time, rel=1e-9)


def test_lift_of_vortices_is_a_velocity_across_arm_and_current_at_their_frequency():
    scenario = crinoid.load("station-keeping-3d", ["water.vortices.lift=0.6"]).with_values(
        {"flow": [{"kind": "uniform", "velocity": [0.05, 0.12, 0.0]}], "water.drag_normal": 1.2}
    )
    found = vortex_shedding(scenario, {}, np.array([1.0, 0.0, 0.0]))
    # of the current across the arm: 1/2 rho d C_l U^2 / sqrt(2) by 1/2 rho d C_d U
    np.testing.assert_allclose(found.deviation, [0, 0, 0.12 * 0.6 / np.sqrt(2) / 1.2])
    assert 1 / found.time == pytest.approx(np.sqrt(0.18**2 - 0.08**2) * 0.12 / 0.03)
    assert not found.accelerates
    calm = scenario.with_values({"water.vortices.model": "none"})
    assert vortex_shedding(calm, {}, np.eye(3)[0]) is None


def test_readings_arrive_as_often_and_as_late_as_sensors_say():
    def sensor(rate, delay):
        none, clock = jnp.zeros(1), Clock(jnp.asarray(1 / rate))
        key = jax.random.key(0)
        return Sensor("tip", TipPose(), clock, jnp.asarray(delay), none, none, key, 1)

    found = ReadingSchedule.of([sensor(100, 0.0), sensor(100, 0.02), sensor(25, 0.1)], 0.01, 0.01)
    assert found.age == (0, 2, 10)
    assert found.fresh[:, :2].all()
    assert found.fresh[:, 2].mean() == pytest.approx(0.25)


def test_the_observer_gain_is_that_of_the_riccati_equation():
    A, B, C = random_model(6, 2, 3, 4)
    noise = np.array([0.1, 0.2, 0.3])
    sets, gain, _ = stationary_filter(A, B @ B.T, C, noise, np.ones((5, 3), bool))
    assert sets.tolist() == [[True] * 3]
    # by going on until nothing changes
    spread = B @ B.T
    for _ in range(2000):
        ahead = A @ spread @ A.T + B @ B.T
        settled = ahead @ C.T @ np.linalg.inv(C @ ahead @ C.T + np.diag(noise))
        spread = ahead - settled @ C @ ahead
    np.testing.assert_allclose(gain[0], settled, atol=1e-8)
    # where readings of the last are rare, there are two gains
    fresh = np.array([[True, True, True], [True, True, False], [True, True, False]])
    sets, gain, _ = stationary_filter(A, B @ B.T, C, noise, fresh)
    both, alone = (gain[sets.tolist().index([True, True, rare])] for rare in (True, False))
    assert (alone[:, 2] == 0).all()
    assert (both[:, 2] != 0).all()


def test_the_covariance_is_that_of_the_gains_that_are_used():
    A, B, C = random_model(6, 2, 3, 4)
    noise = np.array([0.1, 0.2, 0.3])
    # two calls in turn have no reading of the last, and one gain for both
    fresh = np.array([[True] * 3, [True, True, False], [True, True, False], [False, True, False]])
    sets, gains, claimed = stationary_filter(A, B @ B.T, C, noise, fresh)
    every = [gains[sets.tolist().index(each)] for each in fresh.tolist()]
    spread = B @ B.T
    for _ in range(1000):
        mean = np.zeros_like(A)
        for gain in every:
            left = np.eye(6) - gain @ C
            spread = left @ (A @ spread @ A.T + B @ B.T) @ left.T + gain * noise @ gain.T
            mean += spread / len(every)
    np.testing.assert_allclose(claimed, mean, rtol=1e-9, atol=1e-12)


SMALL = {"arm.nodes": 9, "simulation.duration": 6.0, "control.compare": False}


def simulated(kind, name="station-keeping", **values):
    chosen = SMALL | {key.replace("__", "."): value for key, value in values.items()}
    result = crinoid.simulate(crinoid.load(name).with_values(chosen | {"control.kind": kind}))
    assert result.dataset.attrs["status"] == "ok"
    return result


def rms(kind, name="station-keeping", **values):
    return tip_error(simulated(kind, name, **values)).rms


@pytest.fixture(scope="module")
def alone():
    """Return the RMS tip error with LQG control and no sensor but that of the tip (m)."""
    return rms("lqg")


@pytest.mark.slow
def test_lqg_holds_the_tip_better_than_the_pid(alone):
    assert alone < 0.65 * rms("pid")


@pytest.mark.slow
def test_lqg_follows_a_moving_target_ahead_of_it():
    path = {"simulation__duration": 8.0, "flow__0__intensity": 0.01}
    ahead, late, pid = (
        rms(kind, "trace", target__feed_forward=forward, **path)
        for kind, forward in (("lqg", True), ("lqg", False), ("pid", True))
    )
    assert ahead < 0.1 * late
    assert ahead < 0.5 * pid
    assert ahead < 2e-4


@pytest.mark.release
def test_a_meter_of_the_current_does_no_harm(alone):
    """It measures other water than that at the arm, in which drag is not linear."""
    meter = {"kind": "current", "points": [[0.0, 0.25]], "noise": 0.005}
    assert rms("lqg", sensors=[meter]) < 1.1 * alone


def test_the_mean_current_is_at_the_axes_of_a_meter():
    def sensor(measurand, size):
        none, clock = jnp.zeros(size), Clock(jnp.asarray(0.01))
        return Sensor("any", measurand, clock, jnp.asarray(0.0), none, none, jax.random.key(0), 1)

    meter = sensor(WaterVelocity(jnp.zeros((2, 2))), 4)
    values = np.arange(1.0, 12.0)
    found = values_in_current((sensor(TipPose(), 3), meter, meter), values, np.array([0.3, -0.1]))
    assert found.tolist() == [1.0, 2.0, 3.0, *4 * [0.3, -0.1]]


@pytest.mark.release
def test_lqg_holds_where_inputs_are_at_their_limits_much_of_the_time():
    """In eddies of 0.2 m the base cannot accelerate as fast as the gain without limits asks."""
    eddies = {"mean": [0.15, 0.0], "intensity": 0.8, "length_scale": 0.2}
    water = {f"flow__1__{name}": value for name, value in eddies.items()}
    pid, lqg = (
        rms(kind, flow__0__amplitude=[0.0, 0.0], seed=1, **water) for kind in ("pid", "lqg")
    )
    assert lqg < pid


def test_the_best_moves_within_limits_are_those_of_a_second_solver():
    draw = np.random.default_rng(5)
    root = draw.standard_normal((4, 4))
    curved, wanted = root @ root.T + 0.1 * np.eye(4), 2 * draw.standard_normal(4)
    lower, upper = -np.ones(4), np.array([0.2, 1.0, 3.0, 0.5])
    found = nearest(*map(jnp.asarray, (wanted, lower, upper, curved)))
    half = np.linalg.cholesky(curved).T
    best = lsq_linear(half, half @ wanted, (lower, upper), tol=1e-14).x
    np.testing.assert_allclose(found, best, atol=1e-6)
    assert (np.abs(best - np.clip(wanted, lower, upper)) > 0.01).any()


def test_allowed_moves_end_within_limits_when_braked():
    braking = Braking.of(np.array([0.02]), np.array([0.001]), np.ones(1))
    value, moves = 0.0, [np.zeros(1)]
    for _ in range(200):  # always as fast up as is allowed
        room = jnp.array([value + 1.0]), jnp.array([0.6 - value])
        moves.append(np.asarray(braking.next(jnp.asarray(moves[-1]), *room)[1]))
        value += float(moves[-1][0])
        assert value <= 0.6 + 1e-12
    assert np.max(moves) == pytest.approx(0.02)
    assert value == pytest.approx(0.6, abs=1e-6)


@pytest.mark.release
@pytest.mark.parametrize("modulus", [2.8e6, 5.2e6])
def test_lqg_holds_an_arm_other_than_the_model_by_late_and_noisy_readings(modulus):
    """The model is of an arm of 4 MPa."""
    noisy = {"noise_position": 1e-3, "noise_angle_deg": 0.5, "delay": 0.1}
    values = SMALL | {"control.kind": "lqg"} | {f"sensor.{key}": noisy[key] for key in noisy}
    known = crinoid.load("station-keeping").with_values(values)
    controller = set_up(Prepared(known)).loop.controller
    true = known.with_values({"arm.youngs_modulus": modulus, "control.compare": True})
    result = crinoid.simulate(true, controller=controller)
    assert tip_error(result).maximum < 0.25 * tip_error(result.uncontrolled).maximum


@pytest.mark.release
def test_a_target_out_of_reach_leaves_commands_at_their_limits_and_the_arm_still():
    data = simulated(
        "lqg", target__tip=[0.45, -9.5], base__channels__slide__range=[-0.02, 0.02]
    ).dataset
    assert np.abs(data["base_command"].sel(channel="slide")).max() <= 0.02
    late = data["tip_position"].isel(time=slice(-50, None))
    assert float(late.std("time").max()) < 0.02


def test_an_unknown_input_and_a_mapping_are_refused():
    with pytest.raises(
        crinoid.ScenarioError, match=r"control\.lqg\.inputs.*tlit.*must be among.*tilt"
    ):
        simulated("lqg", control__lqg={"inputs": ["slide", "tlit"]})
    with pytest.raises(crinoid.ScenarioError, match=r"control\.mapping.*identity.*lqg"):
        simulated("lqg", control__mapping="identity")


REDUNDANT = """
[arm]
dimension = 3
length = 0.4
nodes = 5
radius = [0.015, 0.006]
youngs_modulus = 1.5e5
[base]
position = [0.0, 0.0, -10.0]
[base.channels]
slide = {}
sway = {}
heave = {}
pan = {}
tilt = {}
[[flow]]
kind = "uniform"
velocity = [0.0, 0.15, 0.0]
ramp_time = 2.0
[control]
kind = "lqg"
controlled = ["x", "y", "z"]
compare = false
[simulation]
duration = 12.0
"""


@pytest.mark.release
def test_inputs_that_move_the_tip_alike_stay_within_their_ranges(monkeypatch):
    # pan and sway move the tip to the side alike, tilt and heave up and down
    scenario = Scenario.from_toml(REDUNDANT)
    assert float(find_margins(Prepared(scenario))["modulus_margin"]) > 0.1
    result = crinoid.simulate(scenario)
    at_limit = max(met.range for met in limit_shares(result).values())
    assert at_limit < 0.1  # as the current rises
    late = result.dataset["tip_error"].values[-100:]
    assert late[-1] < late[0] < 0.01 * scenario.arm.length
    # without the pull they push against each other, and what they do among themselves is named
    monkeypatch.setattr("crinoid.assembly.optimal_control.SPARE", 0.0)
    found = find_margins(Prepared(scenario))
    assert float(found["modulus_margin"]) < 0.02
    assert "the inputs move together by" in found.attrs["notes"]
    assert "sway" in found.attrs["notes"] or "heave" in found.attrs["notes"]
    loose = crinoid.simulate(scenario)
    assert max(met.range for met in limit_shares(loose).values()) > 4 * at_limit
    assert late.max() < 0.5 * loose.dataset["tip_error"].values[-100:].max()


def test_an_arm_that_grows_by_itself_has_finite_deviations():
    assert np.isfinite(stationary_covariance(np.array([[1.2, 0.1], [0.0, 0.5]]), np.eye(2))).all()
    steady = np.array([[0.9, 0.1], [0.0, 0.5]])
    expected = solve_discrete_lyapunov(steady * 0.9999, np.eye(2))
    np.testing.assert_allclose(stationary_covariance(steady, np.eye(2)), expected, rtol=1e-9)
