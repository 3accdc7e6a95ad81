"""Currents: velocities by hand, onsets, sums, and what a scenario draws them from."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy.typing import ArrayLike
from scipy.integrate import quad

import crinoid
from crinoid.flow import Flow, Gust, LogarithmicShear, PowerShear, Sine, Uniform, Water
from crinoid.numerics.ramp import Onset
from helpers.currents import numbers


def uniform(velocity: ArrayLike, onset: Onset | None = None) -> Uniform:
    return Uniform(onset or Onset.of(), *numbers(velocity))


def power_shear(exponent: float = 1 / 7, onset: Onset | None = None) -> PowerShear:
    """0.8 m/s at 10 m above a bed at z = -30 m."""
    return PowerShear(onset or Onset.of(), *numbers([0.8, 0.0], 10.0, -30.0, exponent))


def log_shear(roughness_length: float = 0.01) -> LogarithmicShear:
    """0.8 m/s at 10 m above a bed at z = -30 m."""
    return LogarithmicShear(Onset.of(), *numbers([0.8, 0.0], 10.0, -30.0, roughness_length))


def gust(start: float = 2.0, ramp_time: float = 0.0) -> Gust:
    """A gust to (0.6, -0.2) m/s and back in 4 s."""
    return Gust(Onset.of(start, ramp_time), *numbers([0.6, -0.2], 4.0))


def sine(phase: float = 0.0) -> Sine:
    return Sine(Onset.of(), *numbers([0.3, 0.1], 0.25, phase))


@eqx.filter_jit
def _moves(water: Water, point: Array, time: Array) -> tuple[Array, Array]:
    current = water.current(point, time)
    return current.velocity, current.acceleration


def moves(flow: Flow | Water, point: ArrayLike, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity and material acceleration."""
    water = flow if isinstance(flow, Water) else Water((flow,))
    return jax.tree.map(np.asarray, _moves(water, *numbers(point, time)))


@eqx.filter_jit
def _slopes(water: Water, point: Array, time: Array) -> list[Array]:
    """Return how velocity and acceleration change with place and time, in both modes."""
    functions = (water.velocity, lambda point, time: water.current(point, time).acceleration)
    return [
        slope
        for function in functions
        for mode in (jax.jacfwd, jax.jacrev)
        for slope in mode(function, argnums=(0, 1))(point, time)
    ]


# --- velocities by hand ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flow", "point", "time", "velocity"),
    [
        (uniform([0.4, -0.1]), [3.0, -7.0], 5.0, [0.4, -0.1]),
        (power_shear(), [1.0, -20.0], 0.0, [0.8, 0.0]),  # at the reference height
        (power_shear(0.5), [1.0, -27.5], 0.0, [0.4, 0.0]),  # a quarter of it: half
        (power_shear(0.5), [1.0, 10.0], 0.0, [1.6, 0.0]),  # four times it: double
        (power_shear(), [1.0, -30.0], 0.0, [0.0, 0.0]),
        (power_shear(), [1.0, -31.0], 0.0, [0.0, 0.0]),
        (log_shear(), [1.0, -20.0], 0.0, [0.8, 0.0]),
        (log_shear(0.1), [1.0, -29.0], 0.0, [0.4, 0.0]),  # ln 10 / ln 100
        (log_shear(0.1), [1.0, -29.9], 0.0, [0.0, 0.0]),  # at the roughness length
        (log_shear(0.1), [1.0, -29.95], 0.0, [0.0, 0.0]),
        (log_shear(0.1), [1.0, -40.0], 0.0, [0.0, 0.0]),
        (gust(), [0.0, 0.0], 1.9, [0.0, 0.0]),
        (gust(), [0.0, 0.0], 3.0, [0.3, -0.1]),  # a quarter of its duration: half of its peak
        (gust(), [0.0, 0.0], 4.0, [0.6, -0.2]),
        (gust(), [0.0, 0.0], 5.0, [0.3, -0.1]),
        (gust(), [0.0, 0.0], 6.1, [0.0, 0.0]),
        (sine(), [0.0, 0.0], 1.0, [0.3, 0.1]),  # a quarter of its period
        (sine(), [0.0, 0.0], 3.0, [-0.3, -0.1]),
        (sine(np.pi / 2), [0.0, 0.0], 0.0, [0.3, 0.1]),
        (sine(np.pi / 6), [0.0, 0.0], 4.0, [0.15, 0.05]),
    ],
)
def test_velocity(flow, point, time, velocity):
    assert moves(flow, point, time)[0] == pytest.approx(np.asarray(velocity), abs=1e-12)


def test_a_gust_carries_half_its_peak_times_its_duration():
    carried, _ = quad(lambda time: moves(gust(), [0.0, 0.0], time)[0][0], 0.0, 8.0, points=[2, 6])
    assert carried == pytest.approx(0.6 * 4.0 / 2, rel=1e-10)


# --- coming on ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("onset", "shares", "rates"),
    [
        # a ramp is half a cosine; its rate is greatest half way, pi / 2 / ramp_time, and none where
        # it begins and ends
        (
            (3.0, 2.0),
            {0.0: 0.0, 2.99: 0.0, 3.5: 0.5 - 0.5**1.5, 4.0: 0.5, 5.0: 1.0},
            {3.0: 0.0, 4.0: np.pi / 4, 5.0: 0.0, 9.0: 0.0},
        ),
        # without a ramp it jumps
        ((3.0,), jump := {2.999: 0.0, 3.0: 0.5, 3.001: 1.0}, dict.fromkeys(jump, 0.0)),
        # what stops is gone
        ((1.0, 0.5, 3.0), {2.999: 1.0, 3.0: 0.5, 3.001: 0.0}, {}),
    ],
    ids=["ramp", "jump", "stop"],
)
def test_a_flow_comes_and_goes_with_its_onset(onset, shares, rates):
    whole = np.array([0.8, 0.4])
    flow = uniform(whole, Onset.of(*onset))
    for time, share in shares.items():
        assert moves(flow, [0.0, 0.0], time)[0] == pytest.approx(share * whole, abs=1e-15)
    for time, rate in rates.items():
        assert moves(flow, [0.0, 0.0], time)[1] == pytest.approx(rate * whole, abs=1e-15)


def test_an_onset_multiplies_the_flow():
    # half way up its ramp; the ramp's rate and the flow's own both accelerate the water
    flow = eqx.tree_at(lambda f: f.onset, sine(), Onset.of(0.0, 2.0))
    velocity, acceleration = moves(flow, [0.0, 0.0], 1.0)
    assert velocity == pytest.approx(0.5 * np.array([0.3, 0.1]), abs=1e-12)
    # at the crest of the sine only the ramp changes: pi / 2 / 2 s
    assert acceleration == pytest.approx(np.pi / 4 * np.array([0.3, 0.1]), abs=1e-12)


@pytest.mark.parametrize(
    ("flow", "point", "time"),
    [
        (uniform([0.8, 0.4], Onset.of(3.0)), [0.0, 0.0], 3.0),
        *((uniform([0.8, 0.4], Onset.of(3.0, 2.0)), [0.0, 0.0], time) for time in (3.0, 5.0)),
        *((power_shear(), [0.0, height], 1.0) for height in (-30.0, -31.0, -30.0 + 1e-12)),
        *((log_shear(), [0.0, height], 1.0) for height in (-30.0, -29.99, -35.0)),
        *((gust(), [0.0, 0.0], time) for time in (2.0, 6.0)),
    ],
)
def test_slopes_are_finite_at_the_ends_of_ramps_and_at_the_bed(flow, point, time):
    # those of the acceleration too: Newton's method asks for them
    for slope in _slopes(Water((flow, uniform([0.1, 0.2]))), *numbers(point, time)):
        assert np.isfinite(slope).all()


# --- sums and draws ----------------------------------------------------------------------------


def test_acceleration_of_a_sum_is_not_the_sum_of_accelerations():
    # a shear alone carries no particle across itself, an upwelling lifts it into faster water:
    # Du/Dt = w du/dz = 0.2 * 0.5 * 0.8 / 10 (h / h_ref)^-1/2
    shear, upwelling = power_shear(0.5), uniform([0.0, 0.2])
    point = [0.0, -27.5]
    _, together = moves(Water((shear, upwelling)), point, 1.0)
    assert together == pytest.approx([0.2 * 0.5 * 0.8 / 10 * 2.0, 0.0], abs=1e-12)
    for alone in (shear, upwelling):
        assert moves(alone, point, 1.0)[1] == pytest.approx(0.0, abs=1e-12)


DRAWN = {
    "gauss-markov": {
        "mean": [0.3, -0.1], "standard_deviation": [0.2, 0.05], "correlation_time": 0.5
    },
    "turbulence": {"mean": [0.3, 0.0], "intensity": 0.2, "length_scale": 0.5},
    "waves": {"significant_height": 1.0, "peak_period": 6.0},
}  # fmt: skip


@pytest.mark.parametrize("kind", DRAWN)
def test_a_scenario_draws_each_flow_from_its_seed_and_never_from_the_time_step(kind):
    table = {"kind": kind} | DRAWN[kind]

    @eqx.filter_jit
    def record(flow):
        times = jnp.linspace(0.0, 2.0, 50)
        return jax.vmap(lambda time: flow.velocity(jnp.asarray([0.3, -4.0]), time))(times)

    def drawn(seed, time_step):
        scenario = crinoid.Scenario(
            seed=seed,
            water={"depth": 30.0},
            flow=[table, table],
            simulation={"duration": 2.0, "time_step": time_step},
        )
        return [np.asarray(record(flow)) for flow in crinoid.system(scenario).forces.water.flows]

    first, second = drawn(0, 0.01)
    np.testing.assert_array_equal(drawn(0, 0.04), [first, second])
    assert np.abs(first - second).max() > 0.05
    assert np.abs(first - drawn(1, 0.01)[0]).max() > 0.05
