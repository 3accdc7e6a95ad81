"""Currents: velocities by hand, onsets, and the acceleration of a particle that drifts along."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy.typing import ArrayLike
from scipy.integrate import quad

from crinoid.flow import Flow, Gust, LogarithmicShear, PowerShear, Sine, Uniform, Water
from crinoid.onset import Onset


def numbers(*values: ArrayLike) -> tuple[Array, ...]:
    return tuple(jnp.asarray(value, float) for value in values)


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


def test_a_ramp_is_half_a_cosine():
    flow = uniform([0.8, 0.4], Onset.of(3.0, 2.0))
    for time, share in ((0.0, 0.0), (2.99, 0.0), (3.5, 0.5 - 0.5**1.5), (4.0, 0.5), (5.0, 1.0)):
        assert moves(flow, [0.0, 0.0], time)[0] == pytest.approx(
            share * np.array([0.8, 0.4]), abs=1e-12
        )
    # its rate, greatest half way: pi / 2 / ramp_time; none where it begins and ends
    for time, rate in ((3.0, 0.0), (4.0, np.pi / 4), (5.0, 0.0), (9.0, 0.0)):
        assert moves(flow, [0.0, 0.0], time)[1] == pytest.approx(
            rate * np.array([0.8, 0.4]), abs=1e-12
        )


def test_without_a_ramp_it_jumps():
    flow = uniform([0.8, 0.4], Onset.of(3.0))
    for time, share in ((2.999, 0.0), (3.0, 0.5), (3.001, 1.0)):
        velocity, acceleration = moves(flow, [0.0, 0.0], time)
        assert velocity == pytest.approx(share * np.array([0.8, 0.4]), abs=0.0)
        assert acceleration == pytest.approx(0.0, abs=0.0)


def test_an_onset_multiplies_the_flow():
    # half way up its ramp; the ramp's rate and the flow's own both accelerate the water
    flow = eqx.tree_at(lambda f: f.onset, sine(), Onset.of(0.0, 2.0))
    velocity, acceleration = moves(flow, [0.0, 0.0], 1.0)
    assert velocity == pytest.approx(0.5 * np.array([0.3, 0.1]), abs=1e-12)
    # at the crest of the sine only the ramp changes: pi / 2 / 2 s
    assert acceleration == pytest.approx(np.pi / 4 * np.array([0.3, 0.1]), abs=1e-12)


def test_a_flow_that_stops_is_gone():
    flow = uniform([0.8, 0.4], Onset.of(1.0, 0.5, 3.0))
    for time, share in ((2.999, 1.0), (3.0, 0.5), (3.001, 0.0)):
        assert moves(flow, [0.0, 0.0], time)[0] == pytest.approx(share * np.array([0.8, 0.4]))


@pytest.mark.parametrize(
    ("flow", "point", "time"),
    [
        (uniform([0.8, 0.4], Onset.of(3.0)), [0.0, 0.0], 3.0),
        (uniform([0.8, 0.4], Onset.of(3.0, 2.0)), [0.0, 0.0], 3.0),
        (uniform([0.8, 0.4], Onset.of(3.0, 2.0)), [0.0, 0.0], 5.0),
        (power_shear(), [0.0, -30.0], 1.0),
        (power_shear(), [0.0, -31.0], 1.0),
        (power_shear(), [0.0, -30.0 + 1e-12], 1.0),
        (log_shear(), [0.0, -30.0], 1.0),
        (log_shear(), [0.0, -29.99], 1.0),
        (log_shear(), [0.0, -35.0], 1.0),
        (gust(), [0.0, 0.0], 2.0),
        (gust(), [0.0, 0.0], 6.0),
    ],
)
def test_slopes_are_finite_at_the_ends_of_ramps_and_at_the_bed(flow, point, time):
    # those of the acceleration too: Newton's method asks for them
    for slope in _slopes(Water((flow, uniform([0.1, 0.2]))), *numbers(point, time)):
        assert np.isfinite(slope).all()


# --- the acceleration of a particle ------------------------------------------------------------

TOGETHER = Water(
    (
        uniform([0.3, 0.15], Onset.of(0.0, 4.0)),
        power_shear(0.4),
        log_shear(),
        gust(),
        sine(0.3),
    )
)


@pytest.mark.parametrize("time", [1.0, 2.7, 5.1, 8.0])
@pytest.mark.parametrize("point", [[0.0, -28.7], [4.0, -22.0]])
def test_acceleration_is_that_of_a_drifting_particle(time, point):
    step = 1e-3

    def velocity(at: np.ndarray, when: float) -> np.ndarray:
        return moves(TOGETHER, at, when)[0]

    def drift(at: np.ndarray, when: float, step: float) -> np.ndarray:
        # one step of Runge and Kutta, its error far below that of the difference
        k1 = velocity(at, when)
        k2 = velocity(at + 0.5 * step * k1, when + 0.5 * step)
        k3 = velocity(at + 0.5 * step * k2, when + 0.5 * step)
        k4 = velocity(at + step * k3, when + step)
        return at + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def difference(step: float) -> np.ndarray:
        ahead, behind = drift(np.array(point), time, step), drift(np.array(point), time, -step)
        return (velocity(ahead, time + step) - velocity(behind, time - step)) / (2 * step)

    # central differences, their second-order error removed (Richardson)
    followed = (4 * difference(step) - difference(2 * step)) / 3
    _, acceleration = moves(TOGETHER, point, time)
    assert acceleration == pytest.approx(followed, abs=1e-9)
    assert np.abs(acceleration).max() > 1e-3


def test_acceleration_of_a_sum_is_not_the_sum_of_accelerations():
    # a shear alone carries no particle across itself, an upwelling lifts it into faster water:
    # Du/Dt = w du/dz = 0.2 * 0.5 * 0.8 / 10 (h / h_ref)^-1/2
    shear, upwelling = power_shear(0.5), uniform([0.0, 0.2])
    point = [0.0, -27.5]
    _, together = moves(Water((shear, upwelling)), point, 1.0)
    assert together == pytest.approx([0.2 * 0.5 * 0.8 / 10 * 2.0, 0.0], abs=1e-12)
    for alone in (shear, upwelling):
        assert moves(alone, point, 1.0)[1] == pytest.approx(0.0, abs=1e-12)


def test_velocities_add_up():
    point, time = [1.0, -24.0], 2.7
    total = sum(moves(flow, point, time)[0] for flow in TOGETHER.flows)
    assert moves(TOGETHER, point, time)[0] == pytest.approx(total, abs=1e-14)


def test_without_flows_the_water_is_still():
    velocity, acceleration = moves(Water(()), [1.0, -2.0], 3.0)
    assert not velocity.any()
    assert not acceleration.any()
