"""Flows with their derivatives: closed forms against differentiation, sums, and the current."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from crinoid.flow import (
    GaussMarkov,
    Gust,
    Jet,
    LogarithmicShear,
    MeasuredPoint,
    MeasuredProfile,
    PowerShear,
    Sine,
    Turbulence,
    Uniform,
    Water,
    Waves,
)
from crinoid.flow.flow import Everywhere, displacement, panels_of
from crinoid.numerics.piecewise import PiecewisePolynomial
from crinoid.numerics.ramp import Onset
from helpers.currents import numbers

pytestmark = pytest.mark.slow


def vector(dimension, along, up):
    return jnp.asarray([along, up] if dimension == 2 else [along, 0.3 * along, up])


def record(mean):
    """Return a record that wanders about a mean, some columns of it otherwise than others."""
    time = np.linspace(-20.0, 20.0, 81)
    wandering = 0.3 * np.sin(time[:, None] * (0.8 + 0.1 * np.arange(mean.size)))
    return PiecewisePolynomial(CubicSpline(time, mean * (1 + wandering)))


def flows(dimension):
    """Return one flow of each kind, all of them coming on."""
    onset = Onset.of(0.5, 3.0)
    mean = np.asarray(vector(dimension, 0.4, 0.1))
    first, second, third = map(np.random.default_rng, (1, 2, 3))
    return (
        Uniform(onset, vector(dimension, 0.3, 0.2)),
        PowerShear(onset, vector(dimension, 0.8, 0.0), *numbers(10.0, -30.0, 0.4)),
        LogarithmicShear(onset, vector(dimension, 0.8, 0.0), *numbers(10.0, -30.0, 0.01)),
        Gust(onset, vector(dimension, 0.6, -0.2), *numbers(4.0)),
        Sine(onset, vector(dimension, 0.3, 0.1), *numbers(0.25, 0.4)),
        MeasuredPoint(onset, record(mean), *numbers(0 * mean, mean / (mean @ mean)), carried=True),
        MeasuredProfile(onset, record(np.tile(mean, 6)), *numbers([-8.0, -5.0, -1.0])),
        GaussMarkov.of(
            onset,
            mean=mean,
            standard_deviation=np.array(0.2),
            correlation_time=1.5,
            duration=10.0,
            generator=first,
        ),
        Turbulence.of(
            onset, mean=mean, intensity=0.3, length_scale=5.0, modes=64, generator=second
        ),
        Waves.jonswap(
            onset,
            significant_height=1.5,
            peak_period=5.0,
            direction=0.6435,
            spreading=8.0,
            gamma=3.3,
            components=16,
            depth=30.0,
            gravity=9.81,
            current=(0.0,) * (dimension - 1),
            generator=third,
        ).carried(jnp.zeros(dimension), jnp.asarray(9.81)),
    )


KINDS = {
    f"{type(flow).__name__}-{dimension}": (dimension, flow)
    for dimension in (2, 3)
    for flow in flows(dimension)
}
PLACES = {2: np.array([1.3, -4.0]), 3: np.array([1.3, -0.4, -4.0])}
NEAR_BED = np.array([1.3, -0.4, -29.5])
"""Where shear is steep, so that steady flows carry each other along."""
EVERYTHING = Water(flows(3))


@eqx.filter_jit
def jets(flow, point, time):
    """Return a flow's jet, and the one that differentiating its velocity gives."""
    return flow.jet(point, time), Jet.of(flow.velocity, point, time)


_current = eqx.filter_jit(Water.current)


def current(water, point, time):
    return _current(water, *numbers(point, time))


def differences(function, at, step):
    """Return the derivative of a function by central differences of order 4, as the last axis."""

    def along(direction):
        def difference(h):
            pair = (function(at + h * direction), function(at - h * direction))
            return jax.tree.map(lambda a, b: (np.asarray(a) - np.asarray(b)) / (2 * h), *pair)

        return jax.tree.map(lambda a, b: (4 * a - b) / 3, difference(step), difference(2 * step))

    slopes = map(along, np.eye(len(at)))
    return jax.tree.map(lambda *parts: np.stack(parts, axis=-1), *slopes)


@pytest.mark.parametrize("kind", KINDS)
def test_a_jet_is_the_flow_and_its_derivatives(kind):
    dimension, flow = KINDS[kind]
    # before it starts, while it comes on, later
    for time in (0.2, 1.7, 4.3):
        jet, differentiated = map(jax.tree.leaves, jets(flow, *numbers(PLACES[dimension], time)))
        for part, expected in zip(jet, differentiated, strict=True):
            np.testing.assert_allclose(part, expected, rtol=1e-11, atol=1e-13)


def test_jets_add_up():
    # patterns that drift are where the displacement of all other flows has carried them
    at, parts = numbers(PLACES[3], 1.7), []
    for flow in EVERYTHING.flows:
        others = [other for other in EVERYTHING.flows if other is not flow]
        moved = sum(np.asarray(other.displacement(at[1])) for other in others)
        parts.append(jets(flow, at[0] - moved if flow.drifts else at[0], at[1])[0])
    jet = sum(parts[1:], parts[0])
    together = current(EVERYTHING, *at)
    np.testing.assert_allclose(together.velocity, jet.velocity, atol=1e-15)
    np.testing.assert_allclose(together.velocity_slope, jet.gradient, atol=1e-15)


def test_displacement_is_the_integral_of_the_velocity():
    place = jnp.asarray(PLACES[2])
    uniform = [flow for size, flow in KINDS.values() if size == 2 and isinstance(flow, Everywhere)]
    _, drifting = KINDS["MeasuredPoint-2"]
    tide = MeasuredPoint(drifting.onset, drifting.record, drifting.met, jnp.zeros(2), carried=False)
    times = np.linspace(0.5, 8.0, 15001)  # the gust ends on a sample
    for flow in (*uniform, tide):
        velocity = np.asarray(jax.jit(jax.vmap(flow.velocity, (None, 0)))(place, times))
        steps = 0.5 * np.diff(times)[:, None] * (velocity[1:] + velocity[:-1])
        moved = np.asarray(jax.jit(jax.vmap(flow.displacement))(jnp.asarray(times[1:])))
        np.testing.assert_allclose(moved, np.cumsum(steps, axis=0), atol=2e-5)
        assert np.abs(moved[-1]).max() > 0.05
        assert not np.any(flow.displacement(jnp.asarray(0.3)))


@pytest.mark.parametrize("ramp", [0.0, 2.0, 60.0])  # half a period, and many
@pytest.mark.parametrize("stop", [np.inf, 41.3])
def test_displacement_of_a_swell_is_that_of_a_quadrature(ramp, stop):
    onset, (frequency, phase) = Onset.of(0.4, ramp, stop), numbers(0.25, 0.2)
    swell, rate = Sine(onset, jnp.array([0.3, 0.0]), frequency, phase), 2 * jnp.pi * frequency

    def path(time):
        return -swell.amplitude / rate * jnp.cos(rate * time + phase)

    def by_quadrature(time):
        return displacement(onset, path, time, panels_of(ramp, 4.0))

    times = jnp.linspace(0.01, 80.0, 57)
    along = jax.jit(jax.vmap(lambda time: jax.jvp(swell.displacement, (time,), (1.0,))))
    moved, speed = along(times)
    np.testing.assert_allclose(moved, jax.jit(jax.vmap(by_quadrature))(times), atol=1e-13)
    velocity = jax.vmap(swell.velocity, (None, 0))(jnp.zeros(2), times)
    np.testing.assert_allclose(speed, velocity, atol=1e-13)


# aside from points of time where an onset or a record has a kink
@pytest.mark.parametrize("time", [1.1, 1.7, 2.74, 5.14, 8.06])
@pytest.mark.parametrize("height", [-4.0, -22.0, -28.7])
def test_acceleration_is_that_of_a_drifting_particle(time, height):
    # along the path of a particle through all flows at once, cross terms included
    point = np.array([1.3, -0.4, height])

    def velocity(at, when):
        return np.asarray(current(EVERYTHING, at, when).velocity)

    def passed(since):
        # where the particle is a little later, by one step of Runge and Kutta
        (step,) = since
        k1 = velocity(point, time)
        k2 = velocity(point + 0.5 * step * k1, time + 0.5 * step)
        k3 = velocity(point + 0.5 * step * k2, time + 0.5 * step)
        k4 = velocity(point + step * k3, time + step)
        return velocity(point + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4), time + step)

    acceleration = current(EVERYTHING, point, time).acceleration
    followed = differences(passed, np.zeros(1), 1e-4)[:, 0]
    np.testing.assert_allclose(acceleration, followed, rtol=0, atol=1e-9)
    assert np.abs(acceleration).max() > 1e-3


@pytest.mark.parametrize("frozen", [False, True])
def test_the_slope_of_a_current_is_how_it_changes_with_the_position(frozen):
    water = Water(EVERYTHING.flows, jnp.asarray(1.7)) if frozen else EVERYTHING
    point = NEAR_BED if frozen else PLACES[3]
    found = current(water, point, 1.7).velocity_slope
    slope = differences(lambda point: current(water, point, 1.7).velocity, point, 2e-4)
    np.testing.assert_allclose(found, slope, atol=1e-9)
    assert np.abs(found).max() > 1e-2


def test_a_frozen_flow_keeps_its_velocity_and_the_acceleration_of_what_is_steady():
    now = current(EVERYTHING, NEAR_BED, 1.7)
    # at any later time
    frozen = current(Water(EVERYTHING.flows, jnp.asarray(1.7)), NEAR_BED, 9.0)
    np.testing.assert_allclose(frozen.velocity, now.velocity, atol=1e-15)
    np.testing.assert_allclose(frozen.velocity_slope, now.velocity_slope, atol=1e-15)
    # uniform and sheared currents carry each other along; what fluctuates neither is carried
    # nor carries
    steady = Water(tuple(flow for flow in EVERYTHING.flows if flow.steady))
    assert 0 < len(steady.flows) < len(EVERYTHING.flows)
    alone = current(steady, NEAR_BED, 1.7)
    carried = alone.velocity_slope @ alone.velocity
    np.testing.assert_allclose(frozen.acceleration, carried, atol=1e-14)
    assert np.abs(frozen.acceleration).max() > 1e-3
    assert np.abs(now.velocity_slope @ now.velocity - frozen.acceleration).max() > 1e-2


def test_still_water_has_no_current():
    for part in jax.tree.leaves(current(Water(()), [1.0, -2.0], 3.0)):
        assert not part.any()


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_a_current_can_be_differentiated_once_more(mode):
    # as gradients of a time step do, over many places at once
    points = PLACES[2] + np.array([[0.0, 0.0], [0.2, -0.3], [0.4, -0.5]])
    water = Water(tuple(flow for dimension, flow in KINDS.values() if dimension == 2)[-3:])

    def slopes(strength):
        stronger = eqx.tree_at(
            lambda water: [water.flows[1].relative_amplitudes, water.flows[2].amplitudes],
            water,
            replace_fn=strength.__mul__,
        )
        return jax.vmap(stronger.current, (0, None))(jnp.asarray(points), jnp.asarray(1.7))

    compiled = jax.jit(slopes)
    exact = jax.jit(mode(slopes))(jnp.asarray(1.0))
    numeric = differences(lambda x: compiled(jnp.asarray(x[0])), np.ones(1), 1e-3)
    for got, wanted in zip(jax.tree.leaves(exact), jax.tree.leaves(numeric), strict=True):
        np.testing.assert_allclose(got, wanted[..., 0], atol=1e-10)
        assert np.abs(got).max() > 1e-3
