"""Gauss-Markov currents: their statistics, and that they depend on the seed only."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from crinoid.flow import GaussMarkov
from crinoid.foundation.fixed_numbers import POINTS_PER_CORRELATION_TIME
from crinoid.numerics.ramp import Onset

T = 0.5
"""Correlation time (s)."""
MEAN = np.array([0.3, -0.1])
DEVIATION = np.array([0.2, 0.05])


def gauss_markov(duration, seed=0, mean=MEAN, deviation=DEVIATION):
    return GaussMarkov.of(
        Onset.of(),
        mean=mean,
        standard_deviation=deviation,
        correlation_time=T,
        duration=duration,
        generator=np.random.default_rng(seed),
    )


@eqx.filter_jit
def velocities(flow, times, axes=2):
    return jax.vmap(lambda time: flow.velocity(jnp.zeros(axes), time))(jnp.asarray(times))


@eqx.filter_jit
def jet(flow, time):
    return flow.jet(jnp.zeros(2), jnp.asarray(time))


def test_statistics_of_a_long_record():
    # 20000 correlation times: the variance of a record scatters by sqrt(1 / 20000) = 0.7 %, and
    # its mean by sqrt(2 / 20000) = 1 % of the standard deviation
    lag = T / 10
    record = np.asarray(velocities(gauss_markov(20_000 * T), np.arange(0.0, 20_000 * T, lag)))
    wandering = (record - MEAN) / DEVIATION
    assert wandering.mean(axis=0) == pytest.approx([0.0, 0.0], abs=0.03)
    # the spline takes off 0.4 %
    assert np.mean(wandering**2, axis=0) == pytest.approx([0.996, 0.996], abs=0.03)
    assert np.mean(wandering[:, 0] * wandering[:, 1]) == pytest.approx(0.0, abs=0.03)
    for steps in (5, 10, 20):
        correlation = np.mean(wandering[steps:] * wandering[:-steps], axis=0)
        assert correlation == pytest.approx(np.exp([-steps * lag / T] * 2), abs=0.03)


def test_a_spatial_current_adds_one_across_to_the_planar_one():
    times = np.arange(0.0, 4000 * T, T / 2)
    mean, deviation = (np.insert(pair, 1, aside) for pair, aside in ((MEAN, 0.2), (DEVIATION, 0.1)))
    flat = velocities(gauss_markov(4000 * T, 7), times)
    full = np.asarray(velocities(gauss_markov(4000 * T, 7, mean, deviation), times, 3))
    np.testing.assert_allclose(full[:, [0, 2]], flat, atol=1e-15)
    wandering = (full - mean) / deviation
    # 4000 correlation times: the variance scatters by 1.6 %, a correlation by as much
    together = wandering.T @ wandering / len(times)
    np.testing.assert_allclose(together, 0.996 * np.eye(3), atol=0.06)
    lagged = wandering[2:, 1] @ wandering[:-2, 1] / len(times)
    assert lagged == pytest.approx(np.exp(-1), abs=0.06)


def test_every_record_starts_from_the_same_distribution():
    records = [gauss_markov(T, seed) for seed in range(600)]
    together = jax.tree.map(lambda *leaves: jnp.stack(leaves), *records)
    start = np.asarray(jax.vmap(velocities, (0, None))(together, np.array([0.0, T])))
    # 600 of them: the variance scatters by sqrt(2 / 600) = 6 %, a mean by 4 %
    for instant in ((start - MEAN) / DEVIATION).swapaxes(0, 1):
        assert instant.mean(axis=0) == pytest.approx([0.0, 0.0], abs=0.16)
        assert instant.var(axis=0) == pytest.approx([1.0, 1.0], abs=0.24)


def test_a_longer_record_begins_with_the_shorter_one():
    times = np.linspace(0.0, 4.0, 1001)
    short, long = (velocities(gauss_markov(duration), times) for duration in (4.0, 400.0))
    np.testing.assert_allclose(short, long, atol=1e-15)
    assert np.abs(velocities(gauss_markov(4.0, seed=1), times) - short).max() > 0.1


def test_it_has_an_acceleration_that_does_not_jump():
    flow = gauss_markov(4.0)
    knots = np.asarray(flow.record.knots)
    for knot in knots[(knots > 0) & (knots < 4)][:10]:
        before, after = jet(flow, knot - 1e-9), jet(flow, knot + 1e-9)
        np.testing.assert_allclose(before.rate, after.rate, atol=1e-6)
        # nor does its slope jump, which is of order 100 m/s3 (1e-4 m/s2 over these 1e-6 s)
        near, far = (jet(flow, knot + side * 1e-6).rate for side in (-1, 1))
        np.testing.assert_allclose(after.rate - near, far - before.rate, atol=1e-6)


def test_what_the_spline_keeps_and_adds():
    # the variance of what a cubic spline makes of the process follows from how much each point
    # has to say in the middle of many: on average, and of its rate too
    points = np.arange(121)
    spline = CubicSpline(points, np.eye(121))
    inside = np.linspace(60, 61, 101)
    correlation = np.exp(-np.abs(points[:, None] - points) / POINTS_PER_CORRELATION_TIME)

    def variance(weights):
        return np.trapezoid(np.sum(weights @ correlation * weights, axis=1), inside)

    kept = variance(spline(inside))
    rate = np.sqrt(variance(spline(inside, 1))) * POINTS_PER_CORRELATION_TIME
    assert kept == pytest.approx(0.996, abs=5e-4)
    assert rate == pytest.approx(6.8, abs=0.05)
    # and that is what a record has
    times = jnp.linspace(0.0, 2000 * T, 100_001)
    flow = gauss_markov(2000 * T)
    rates = jax.jit(jax.vmap(lambda time: flow.jet(jnp.zeros(2), time).rate))(times)
    assert np.std(rates, axis=0) / DEVIATION * T == pytest.approx([rate, rate], rel=0.05)
