"""Model predictive control: its horizon against a simulation by hand, and in closed loop."""

import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.optimal_control import Regulator, blocks, condensed, straight
from crinoid.control import Along

# --- the horizon, without an arm ----------------------------------------------------------------


def problem(seed: int = 0) -> Regulator:
    """Draw an oscillator with two inputs, their values and the integral of its position."""
    draw = np.random.default_rng(seed)
    turn, states, inputs = 0.2, 2, 2
    arm = 0.98 * np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    drive, tip = draw.normal(size=(states, inputs)), draw.normal(size=(1, states))
    size = states + inputs + 1
    A, B = np.zeros((size, size)), np.zeros((size, inputs))
    A[:2, :2], A[:2, 2:4], B[:2] = arm, drive, drive
    A[2:4, 2:4] = B[2:4] = np.eye(inputs)
    A[4, :2], A[4, 4] = 0.01 * tip, 1.0
    cost = np.zeros((size, size))
    cost[:2, :2], cost[2:4, 2:4], cost[4, 4] = tip.T @ tip, 1e-3 * np.eye(inputs), 0.1
    rate = np.diag([1.0, 3.0])
    steady = np.zeros((size, inputs))
    steady[:2] = np.linalg.solve(np.eye(2) - arm, drive)
    steady[2:4] = np.eye(inputs)
    shift = np.zeros_like(B)
    shift[4] = -0.01 * tip @ steady[:2]
    return Regulator(A, B, cost, rate, steady, shift)


def spent(given: Regulator, lengths, start, moves, aims, water, pushed) -> float:
    """Return the cost of a horizon, simulated tick by tick."""
    z, total, (A, B, cost, rate, _, _), last = start.copy(), 0.0, given, given.to_come()
    each = np.repeat(moves.T, lengths.astype(int), axis=0)
    for tick, move in enumerate(each):
        at = given.steady @ aims[tick]
        z = A @ z + B @ move
        # the integral is that of the distance from where it should be
        z[-1] -= A[-1, :-1] @ at[:-1]
        z[:2] += pushed @ water[tick + 1]
        away = z - given.steady @ aims[tick + 1]
        weight = last if tick == len(each) - 1 else cost
        total += away @ weight @ away + move @ rate @ move
    return 0.5 * total


@pytest.mark.parametrize("lengths", [np.ones(6), blocks(20)], ids=["even", "blocks"])
def test_the_condensed_cost_is_that_of_a_simulated_horizon(lengths):
    given, draw, ticks = problem(), np.random.default_rng(1), int(lengths.sum())
    pushed = draw.normal(size=(2, 3))
    found = condensed(given, lengths, pushed)
    start, aims = draw.normal(size=5), draw.normal(size=(ticks + 1, 2))
    water, moves = draw.normal(size=(ticks + 1, 3)), draw.normal(size=(2, lengths.size))
    gradient = found.by_state @ start
    gradient += np.einsum("iktd,td->ik", found.by_aim, aims)
    gradient += np.einsum("iktw,tw->ik", found.by_water, water)
    curved = 0.5 * np.einsum("ik,ikjl,jl", moves, found.hessian, moves)
    with_moves, without = (
        spent(given, lengths, start, each, aims, water, pushed) for each in (moves, 0 * moves)
    )
    assert with_moves - without == pytest.approx(curved + np.sum(gradient * moves), rel=1e-9)


def gain(given: Regulator) -> np.ndarray:
    later = given.to_come()
    return np.linalg.solve(given.rate + given.B.T @ later @ given.B, given.B.T @ later @ given.A)


@pytest.mark.parametrize("ticks", [1, 2, 12, 30])
def test_without_limits_the_first_move_is_that_of_the_regulator(ticks):
    given, draw = problem(), np.random.default_rng(2)
    # the target stays where it is at the last tick, over a horizon or for ever
    start, aims = draw.normal(size=5), draw.normal(size=(ticks + 1, 2))
    found = condensed(given, np.ones(ticks), np.zeros((2, 1)))
    hessian = found.hessian.reshape(2 * ticks, -1)
    for gradient, move in (
        (found.by_state @ start, -gain(given) @ start),
        (
            np.einsum("iktd,td->ik", found.by_aim, aims),
            np.einsum("tud,td->u", given.by_aim(given.to_come(), ticks), aims),
        ),
    ):
        best = -np.linalg.solve(hessian, gradient.ravel()).reshape(2, ticks)
        assert best[:, 0] == pytest.approx(move, rel=1e-8)


def test_a_target_at_rest_is_reached_and_asks_for_nothing_more():
    given, aim = problem(), np.array([0.3, -0.2])
    back, ahead = gain(given), given.by_aim(given.to_come(), 4).sum(axis=0) @ aim
    z = np.zeros(5)
    for _ in range(20000):
        z = given.A @ z + given.B @ (ahead - back @ z) + given.shift @ aim
    assert z == pytest.approx(given.steady @ aim, abs=1e-9)


def test_numbers_given_at_some_ticks_go_straight_in_between():
    weights = straight(np.array([0, 1, 4]), 5)
    assert np.array([1.0, 3.0, 6.0]) @ weights == pytest.approx([1.0, 3.0, 4.0, 5.0, 6.0, 6.0])
    assert straight(np.zeros(1, int), 2).tolist() == [[1.0, 1.0, 1.0]]


@pytest.mark.parametrize("ticks", [1, 3, 10, 60, 137])
def test_moves_of_a_horizon_last_longer_and_longer(ticks):
    lengths = blocks(ticks)
    assert lengths.sum() == ticks
    assert lengths[0] == 1
    assert lengths.size <= 18
    assert np.all(np.diff(lengths[:-1]) >= 0)


def test_velocities_of_the_same_drag():
    # across the arm drag is |u| u, along it there is none to speak of; steady current 0.2 m/s
    along = Along(jnp.eye(2), jnp.array([[0.0, 1.0]] * 2), jnp.array([[0.2, 0.0]] * 2))
    hastening = jnp.array([[1.0, 2.0], [3.0, 4.0]])
    found = np.asarray(along(jnp.array([[0.3, 0.1], [-0.1, 0.05]]), hastening))
    alike, acceleration = found.reshape(2, 2, 2)
    assert 2 * 0.2 * alike[:, 0] == pytest.approx([0.3**2, -(0.1**2)])
    assert alike[:, 1] == pytest.approx([0.1, 0.05])
    assert acceleration == pytest.approx(np.asarray(hastening))


# --- in closed loop -----------------------------------------------------------------------------

SHORT = ("arm.nodes=11", "control.compare=false")
UNKNOWN, MEASURED, KNOWN = (
    ('control.kind="mpc"', f'control.mpc.current="{current}"')
    for current in ("unknown", "measured", "known")
)
METER = 'sensors=[{kind="current", points=[[0.0, 0.0]], noise=0.005}]'


def played(name: str, *settings: str):
    result = crinoid.simulate(crinoid.load(name, [*SHORT, *settings]))
    assert result.dataset.attrs["status"] == "ok"
    return result.dataset


def rms(name: str, *settings: str) -> float:
    return float(np.sqrt(np.mean(played(name, *settings)["tip_error"].values ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "settings", "share"),
    [
        pytest.param("station-keeping", (*MEASURED, METER), 0.5, id="it measures the current"),
        pytest.param(
            "wave-zone", KNOWN, 0.1, id="it foresees the waves", marks=pytest.mark.release
        ),
    ],
)
def test_mpc_holds_the_tip_better_than_the_pid(name, settings, share):
    given = "simulation.duration=8"
    assert rms(name, given, *settings) < share * rms(name, given, 'control.kind="pid"')


SMALL_EDDIES = (
    "simulation.duration=14",
    "seed=2",
    "flow.0.amplitude=[0.15, 0.0]",
    "flow.1={kind='turbulence', mean=[0.15, 0.0], intensity=0.5, length_scale=0.2, ramp_time=3.0}",
)


@pytest.mark.release
def test_mpc_does_not_shake_the_arm_where_swell_and_drift_cancel():
    # then drag hardly damps the arm, whatever the mean current
    given = ("station-keeping", *SMALL_EDDIES)
    unknown = rms(*given, *UNKNOWN)
    assert unknown < 1.5 * rms(*given, 'control.kind="lqg"')
    # a meter measures little of small eddies, and does not mislead
    assert rms(*given, *MEASURED, METER) < 1.2 * unknown


@pytest.mark.slow
def test_commands_keep_to_the_limits_from_the_first_instant():
    # the tip is wanted 5 cm away at once, by servos that are slow and weak
    data = played(
        "station-keeping",
        "simulation.duration=6",
        *UNKNOWN,
        "target={tip=[0.05, -9.5]}",
        'control.controlled=["x"]',
        "output.interval=0.01",
        "flow.0.amplitude=[0.2, 0]",  # a swell that weak servos can follow
        "base.channels.slide.max_speed=0.03",
        "base.channels.slide.max_acceleration=0.1",
        "base.channels.slide.range=[-0.02, 0.04]",
        "base.channels.tilt.max_speed_deg=5",
        "base.channels.tilt.max_acceleration_deg=20",
    )
    for channel, range_, speed, acceleration in (
        ("slide", (-0.02, 0.04), 0.03, 0.1),
        ("tilt", (-np.pi / 3, np.pi / 3), np.radians(5), np.radians(20)),
    ):
        command = data["base_command"].sel(channel=channel).values[1:]
        moves = np.diff(command, prepend=0.0) / 0.01
        assert np.all((command >= range_[0] - 1e-12) & (command <= range_[1] + 1e-12))
        assert np.abs(moves).max() <= speed * (1 + 1e-9)
        assert np.abs(np.diff(moves)).max() / 0.01 <= acceleration * (1 + 1e-6)
        assert np.abs(moves).max() >= 0.99 * speed  # the limits were met
    late = data["tip_error"].values[data["time"].values > 4.0]
    assert late.max() < 0.02


@pytest.mark.slow
def test_a_measured_current_needs_a_meter():
    with pytest.raises(crinoid.ScenarioError, match=r"control.mpc.current: .*kind = \"current\""):
        played("station-keeping", *MEASURED)
