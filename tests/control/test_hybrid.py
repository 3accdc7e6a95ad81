"""The hybrid controller: its model of the upright arm on paper, and arms that it brings there."""

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from scipy.integrate import cumulative_trapezoid

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.control import Hybrid, Pendulum
from crinoid.results.result import Result
from crinoid.scenario import Scenario, ScenarioError, load
from crinoid.simulation.setup import set_up

pytestmark = pytest.mark.usefixtures("optimised")

QUICK = {"arm.nodes": 11, "control.compare": False}


def simulated(name: str, **changes: object) -> Result:
    return crinoid.simulate(crinoid.load(name).with_values(QUICK | changes))


def lean(data: xr.Dataset) -> np.ndarray:
    """Return how far the arm is from upright: the line from root to tip, or the tip if it is more.

    In degrees.
    """
    reach = (data["tip_position"] - data["position"].isel(node=0)).values
    chord = np.rad2deg(np.arctan2(reach[:, 0], reach[:, 1]))
    tip = np.mod(np.rad2deg(data["tip_angle"].values) + 90.0, 360.0) - 180.0
    return np.maximum(np.abs(chord), np.abs(tip))


def upright_from(result: Result, within: float = 3.0) -> float:
    """Return from when on the arm stays upright within some degrees (s)."""
    off, time = lean(result.dataset), result.dataset["time"].values
    outside = np.flatnonzero(off > within)
    return float(time[outside[-1]]) if outside.size else 0.0


# in air the arm whips about, and a run lasts longer to compute: three starts
@pytest.mark.slow
@pytest.mark.parametrize(
    ("density", "starts", "duration"),
    [
        pytest.param(1025.0, 10, 32.0, id="water"),
        pytest.param(0.0, 3, 50.0, id="air", marks=pytest.mark.release),
    ],
)
def test_from_hanging_the_arm_is_upright_for_twenty_seconds(density, starts, duration):
    for seed in range(starts):
        # a force bends the arm another way each time, and lets it go
        random = np.random.default_rng(seed)
        start = {
            "load.0.force": random.uniform([-0.3, -0.3], [0.3, 0.0]).tolist(),
            "load.0.stop": random.uniform(0.2, 1.0),
        }
        changes = {"seed": seed, "water.density": density, "simulation.duration": duration}
        result = simulated("swing-up", **start, **changes)
        assert lean(result.dataset)[0] > 45.0
        assert upright_from(result) < duration - 20.0


@pytest.mark.release
def test_without_control_it_hangs_and_with_it_the_slide_keeps_its_limits():
    result = simulated("swing-up", **{"control.compare": True})
    assert lean(result.uncontrolled.dataset).min() > 45.0
    assert upright_from(result) < 20.0
    assert result.notes == result.uncontrolled.notes == []
    slide = result.dataset["base_servo"].sel(channel="slide").values
    assert 0.1 < np.abs(slide).max() < 0.5
    assert result.dataset.attrs["status"] == "ok"


@pytest.mark.release
def test_a_push_and_a_gust_lean_it_and_it_recovers_from_any_of_ten_seeds():
    for seed in range(10):
        changes = {"seed": seed, "control.compare": seed == 0, "simulation.duration": 20.0}
        result = simulated("push-recover", **changes)
        off, time = lean(result.dataset), result.dataset["time"].values
        for begins, ends, least in ((5.0, 8.0, 20.0), (12.0, 16.0, 8.0)):
            assert off[(time > begins) & (time < ends)].max() > least
        for begins, ends in ((2.0, 5.0), (9.0, 12.0), (18.0, 20.0)):
            assert off[(time > begins) & (time < ends)].max() < 3.0
        if result.uncontrolled is not None:  # left alone it falls before anything hits it
            alone = lean(result.uncontrolled.dataset)
            assert alone[time < 5.0].max() > 45.0
            assert alone[time > 18.0].min() > 45.0


def controller(**changes: float) -> Hybrid:
    """Return the controller of an arm in air."""
    described = load("swing-up").with_values(QUICK | {"water.density": 0.0} | changes)
    found = set_up(Prepared(described)).loop.controller
    assert isinstance(found, Hybrid)
    return found


@pytest.mark.release
def test_the_base_is_needed_from_greenhills_load_on():
    # q L^3 / EI = 7.837 (Greenhill 1881); beyond it one mode leaves, by three limits of the base
    weight, bending = 2500 * np.pi * 1e-4 * 9.81, np.pi * 1e-8 / 4
    critical = weight * 0.5**3 / (7.837 * bending)
    for share, measures in ((0.98, 4), (1.02, 1)):
        balance = controller(**{"arm.youngs_modulus": share * critical}).balance
        assert balance.capture.shape[0] == measures
        leaning = balance.modes_of(jnp.full(11, -0.1), jnp.zeros(11))
        needed = float(balance.effort(jnp.concatenate([leaning, jnp.zeros(2)])))
        assert (needed > 1e-3) == (measures > 1)


@pytest.mark.release
def test_wider_limits_of_the_base_make_the_arm_easier_to_catch():
    def measures(**limits: object) -> np.ndarray:
        slide = {f"base.channels.slide.{key}": value for key, value in limits.items()}
        balance = controller(**slide).balance
        leaning = balance.modes_of(-0.1 * jnp.linspace(0, 1, 11), jnp.zeros(11))
        return np.abs(balance.capture[1:] @ jnp.concatenate([leaning, jnp.zeros(2)]))

    least = measures()
    wide = measures(range=[-1.0, 1.0], max_speed=4.0, max_acceleration=40.0)
    np.testing.assert_allclose(wide, least / 2, rtol=1e-9)
    np.testing.assert_allclose(measures(max_speed=4.0), least / [1, 2, 1], rtol=1e-9)


def test_the_swing_is_that_of_an_elastic_line():
    # L = 0.5 m, 0.8 kg/m, 5 N/m, EI = 0.06 N m2; leans 2 sin(pi s / 2 L), turning at 3 /s of that
    count, length, EI = 400, 0.5, 0.06
    edge = length / count
    ends = np.where(np.arange(count) < count - 1, 1.0, 0.5)  # half as much hangs on the tip
    pendulum = Pendulum(
        sampled=jnp.eye(count),
        length=jnp.full(count, edge),
        mass=jnp.asarray(0.8 * edge * ends),
        weight=jnp.asarray(5.0 * edge * ends),
        stiffness=jnp.full(count, EI / edge).at[0].multiply(2.0),
    )
    # positive leans back: inclinations grow
    lean = 2.0 * np.sin(np.pi / 2 * (np.arange(count) + 0.5) / count)
    motion = jnp.asarray(lean), jnp.asarray(3.0 * lean), jnp.asarray(0.3)
    stored, momentum, ahead = map(float, pendulum.swing(*motion))

    fine = np.linspace(0.0, 1.0, 20001)
    angle = 2.0 * np.sin(np.pi / 2 * fine)

    def along(rate: np.ndarray) -> np.ndarray:
        return cumulative_trapezoid(rate, fine * length, initial=0.0)

    def whole(line: np.ndarray) -> float:
        return float(np.trapezoid(line, fine * length))

    forward = 0.3 + along(-np.cos(angle) * 3.0 * angle)
    upward = along(-np.sin(angle) * 3.0 * angle)
    bending = whole((2.0 * np.pi / 2 / length * np.cos(np.pi / 2 * fine)) ** 2)
    lifting = whole(along(np.cos(angle)) - fine * length)
    energy = 0.5 * EI * bending + 5.0 * lifting + 0.5 * 0.8 * whole(forward**2 + upward**2)
    assert stored == pytest.approx(energy, rel=1e-3)
    # the node at the root, half an edge of arm, moves with the base and is left out
    moved = 0.8 * whole(forward) - 0.5 * 0.8 * edge * 0.3
    assert momentum == pytest.approx(moved, rel=1e-3)
    assert ahead == pytest.approx(whole(along(-np.sin(angle))) / length, rel=2e-3)


MISTAKES = {
    "base.channels={}": "base.channels.slide: missing; must be a table with control.kind",
    "base.channels.slide.range=[0.0, 0.5]": "base.channels.slide.range: got [0.0, 0.5]",
    'base.mount="pinned"': 'base.mount: got "pinned"; must be "clamped"',
    "base.tilt_deg=80": "base.tilt_deg: got 80.0; must be 90",
    "arm.rest_curvature=1.0": "arm.rest_curvature: got 1.0; must be 0",
    "tool={mass=0.1}": "tool: got a table; must be left out",
    "sensors=[]": 'sensors: missing; must have an entry with kind = "inclination"',
    "sensors.0.stations=[0.0, 0.5, 1.0]": "sensors.0.stations: got [0.0, 0.5, 1.0]; must have",
    "sensors.0.rate_hz=50": "sensors.0.rate_hz: got 50.0; must be at least control.rate_hz = 100",
    "control.hybrid.release_deg=50": "control.hybrid.release_deg: got 50.0; must be above",
    "control.hybrid.modes=1": "control.hybrid.modes: got 1; must",
    "control.hybrid.modes=20": "sensors.0.stations: got [0.0, 0.1, 0.2",
}


@pytest.mark.parametrize("change", MISTAKES)
def test_a_mistake_is_refused_in_one_line(change):
    with pytest.raises(ScenarioError) as caught:
        load("swing-up", [change])
    lines = caught.value.lines
    assert any(line.startswith(MISTAKES[change]) for line in lines), lines


def test_an_arm_in_space_is_refused():
    with pytest.raises(ScenarioError, match=r"arm\.dimension: got 3; must be 2 with control"):
        Scenario(arm={"dimension": 3}, control={"kind": "hybrid"})
