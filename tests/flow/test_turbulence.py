"""Turbulence: no divergence, the intensity and the spectrum asked for, carried by the water."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.integrate import quad
from scipy.special import gamma, kv

import crinoid
from crinoid.assembly.forecast import Fluctuation
from crinoid.flow import Sine, Turbulence, Water
from crinoid.numerics.ramp import Onset
from helpers.currents import gradients, numbers

SPEED = 1.5
"""Mean speed (m/s), along x."""
INTENSITY = 0.2
LENGTH = 0.8
"""Longitudinal integral scale (m)."""
ENERGETIC = LENGTH * gamma(1 / 3) / (np.sqrt(np.pi) * gamma(5 / 6))
"""The length L_e of the spectrum (m)."""
DEVIATION = INTENSITY * SPEED
SEEDS = 48


def turbulence(seed=0, *, dimension=3, modes=256, mean=None, onset=None):
    usual = np.array([SPEED, 0.0, 0.0][:dimension])
    return Turbulence.of(
        onset or Onset.of(),
        mean=usual if mean is None else mean,
        intensity=INTENSITY,
        length_scale=LENGTH,
        modes=modes,
        generator=np.random.default_rng(seed),
    )


@pytest.fixture(scope="module")
def many():
    """Return turbulence of many seeds, stacked."""
    flows = [turbulence(seed) for seed in range(SEEDS)]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *flows)


@eqx.filter_jit
def _fluctuations(flows, points, time):
    def at(flow, point):
        return flow.velocity(point, time) - flow.mean

    return jax.vmap(jax.vmap(at, (None, 0)), (0, None))(flows, points)


def fluctuations(flows, points, time=0.0):
    """Return what is added to the mean by each of the stacked flows at each of some places."""
    return np.asarray(_fluctuations(flows, *numbers(points, time)))


def test_there_is_no_divergence():
    flow = turbulence(mean=np.array([1.0, 0.4, -0.3]))
    slopes = gradients(flow, np.random.default_rng(9).uniform(-10, 10, (300, 3)))
    divergence = np.abs(np.trace(slopes, axis1=1, axis2=2)).max()
    assert divergence < 1e-10 * min(1.0, np.sqrt(np.mean(slopes**2)))


def test_intensity_of_each_component(many):
    points = np.random.default_rng(9).uniform(-500, 500, (400, 3))
    found = fluctuations(many, points)
    deviation = np.sqrt(np.mean(found**2, axis=(0, 1)))
    assert deviation == pytest.approx([DEVIATION] * 3, rel=0.05)
    # isotropic: components do not go together
    cross = np.einsum("spi,spj->ij", found, found) / found[..., 0].size / DEVIATION**2
    assert cross == pytest.approx(np.eye(3), abs=0.1)


def test_intensity_of_each_draw(many):
    # over all places and times each mode has half its amplitude squared
    variance = np.sum(np.asarray(many.amplitudes) ** 2, axis=2) / 2
    assert variance.sum(axis=1) == pytest.approx(np.full(SEEDS, 3 * DEVIATION**2), rel=1e-12)
    assert np.sqrt(variance) == pytest.approx(np.full((SEEDS, 3), DEVIATION), rel=0.03)


def test_what_the_cut_of_the_spectrum_leaves_out(many):
    number = np.linalg.norm(many.wave_vectors, axis=1) * ENERGETIC
    assert number.min() > 0.2 * (1 - 1e-12)
    assert number.max() < 300 * (1 + 1e-12)

    def energy(low, high):
        def by_logarithm(log):
            k = np.exp(log)
            return k * k**4 / (1 + k**2) ** (17 / 6)

        return quad(by_logarithm, np.log(low), np.log(high), limit=200, epsrel=1e-10)[0]

    whole = energy(1e-4, 1e12)
    assert energy(300, 1e12) / whole == pytest.approx(0.032, abs=5e-4)
    assert energy(1e-4, 0.2) / whole == pytest.approx(6e-5, abs=5e-6)
    # each interval of equal logarithm has one mode with just its energy
    below = number < 3.0
    amplitudes = np.sum(np.asarray(many.amplitudes) ** 2, axis=1)
    share = np.sum(amplitudes * below, axis=1) / np.sum(amplitudes, axis=1)
    assert share == pytest.approx(np.full(SEEDS, energy(0.2, 3.0) / energy(0.2, 300)), abs=0.01)


def test_longitudinal_correlation_and_its_integral(many):
    start = np.random.default_rng(9).uniform(-500, 500, (150, 3))
    lags = np.concatenate([np.linspace(0, 1, 21), np.linspace(1, 6, 26)[1:]]) * LENGTH
    there = fluctuations(many, start)[..., 0]
    ahead = (fluctuations(many, start + lag * np.eye(3)[0])[..., 0] for lag in lags)
    correlation = np.array([np.mean(there * moved) for moved in ahead]) / np.mean(there**2)
    ratio = np.maximum(lags, 1e-9) / ENERGETIC
    known = 2 ** (2 / 3) / gamma(1 / 3) * np.cbrt(ratio) * kv(1 / 3, ratio)
    # the eddies that the spectrum is cut by would take 3.2 % off at any but the smallest lags
    assert correlation == pytest.approx(known, abs=0.04)
    assert np.trapezoid(correlation, lags) == pytest.approx(LENGTH, rel=0.1)


@pytest.mark.parametrize("lag", [0.0, 1.5])
def test_controllers_expect_its_covariance_in_space_and_time(many, lag):
    mean = np.asarray(many.mean[0])
    deviation = np.full(3, INTENSITY * np.linalg.norm(mean))
    expected = Fluctuation(deviation, LENGTH / np.linalg.norm(mean), drift=mean, length=LENGTH)
    assert not expected.accelerates
    start = np.random.default_rng(9).uniform(-500, 500, (150, 3))
    for away in ([0.0, 0.0, 0.0], [0.3, 0.0, 0.5], [-0.2, 0.4, 0.1]):
        apart = np.asarray(away) * LENGTH
        here, there = fluctuations(many, start), fluctuations(many, start + apart, lag)
        found = np.einsum("spa,spb->ab", there, here) / here[..., 0].size
        wanted = expected.covariance(apart, np.array(lag))
        assert found == pytest.approx(wanted, abs=0.06 * expected.deviation[0] ** 2)


def test_its_mean_carries_it():
    mean = np.array([0.7, -0.2, 0.1])
    flow, place = turbulence(mean=mean), np.array([0.3, 0.1, -4.0])
    now, then = (flow.velocity(*numbers(place + t * mean, 0.4 + t)) for t in (0.0, 2.3))
    np.testing.assert_allclose(now, then, rtol=1e-12)


def test_a_swell_carries_it():
    # seen from water that swings, the same water has its bed swung the other way
    flow, swell = turbulence(dimension=2), Sine(Onset.of(), *numbers([0.4, 0.1], 0.2, 0.5))
    water, time = Water((flow, swell)), jnp.asarray(3.1)
    path = [quad(lambda t, i=i: float(swell.at(jnp.asarray(t))[i]), 0, 3.1)[0] for i in (0, 1)]
    point = np.array([0.3, -4.0])
    carried = water.velocity(jnp.asarray(point + path), time) - swell.at(time)
    np.testing.assert_allclose(carried, flow.velocity(jnp.asarray(point), time), rtol=1e-9)


@pytest.mark.release
def test_an_arm_in_a_swell_moves_as_one_whose_base_is_swung():
    # a neutral arm feels the water beside it alone: swell over a still base is still water over a
    # base that swings the other way
    amplitude, frequency = 0.25, 0.25
    reach = amplitude / (2 * np.pi * frequency)
    eddies = {"kind": "turbulence", "mean": [0.06, 0], "intensity": 0.8, "length_scale": 0.3}
    swell = {"kind": "sine", "amplitude": [amplitude, 0], "frequency_hz": frequency}
    swing = {"kind": "sine", "channel": "slide", "amplitude": reach, "frequency_hz": frequency}

    def tip(flow, base):
        scenario = crinoid.Scenario(
            arm={"nodes": 7, "density": 1025.0, "youngs_modulus": 1e6, "damping_time": 0.02},
            base={"tilt_deg": 90.0} | base,
            flow=flow,
            simulation={"duration": 3.0, "time_step": 0.005, "start": "rest"},
        )
        dataset = crinoid.simulate(scenario).dataset
        assert dataset.attrs["status"] == "ok"
        position = dataset["position"].transpose("time", "node", "axis").values
        return position[:, -1, 0] - position[:, 0, 0]

    in_swell = tip([eddies | {"modes": 32}, swell], {"position": [0.0, -10.0]})
    motion = [swing | {"phase_deg": 90.0}]
    swung = tip([eddies | {"modes": 32}], {"position": [-reach, -10.0], "motion": motion})
    assert np.std(in_swell) > 0.02
    np.testing.assert_allclose(swung, in_swell, atol=1e-4 * np.std(in_swell))


def test_a_planar_arm_sees_the_cut_through_it():
    flat, full = turbulence(dimension=2), turbulence(dimension=3)
    whole = np.asarray(full.velocity(*numbers([0.3, 0.0, -4.0], 2.1)))
    cut = flat.velocity(*numbers([0.3, -4.0], 2.1))
    np.testing.assert_allclose(cut, whole[[0, 2]], rtol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_velocity_and_slopes_are_sums_of_waves(dimension):
    flow, time = turbulence(5, dimension=dimension), 2.1
    point = np.array([0.3, 0.2, -4.0])[-dimension:]
    waves, amplitudes = np.asarray(flow.wave_vectors), np.asarray(flow.amplitudes)
    angle = (point - time * np.asarray(flow.mean)) @ waves + 2 * np.pi * np.asarray(flow.phases)
    velocity = flow.mean + amplitudes @ np.cos(angle)
    slopes = -amplitudes * np.sin(angle) @ waves.T

    at = numbers(point, time)
    jet = jax.jit(lambda point, time: flow.jet(point, time))(*at)
    np.testing.assert_allclose(jet.velocity, velocity, rtol=1e-11)
    np.testing.assert_allclose(jet.gradient, slopes, atol=1e-11 * np.abs(slopes).max())
    np.testing.assert_allclose(jet.rate, -slopes @ flow.mean, atol=1e-11 * np.abs(slopes).max())
    for mode in jax.jacfwd, jax.jacrev:
        found = jax.jit(mode(lambda point: flow.jet(point, at[1]).velocity))(at[0])
        np.testing.assert_allclose(found, slopes, atol=1e-11 * np.abs(slopes).max())


@pytest.mark.slow
def test_slopes_by_its_numbers_place_and_time_are_those_of_differences():
    flow = turbulence(3, dimension=2, modes=16, onset=Onset.of(0.4, 3.0))
    parts, rest = eqx.partition(flow, eqx.is_inexact_array)

    @jax.jit
    def current(parts, points, time):
        water = Water((eqx.combine(parts, rest),))
        return jax.vmap(water.current, (0, None))(points, time)

    places = numbers([[0.3, -4.0], [0.1, -4.2]], 2.1)
    check_grads(current, (parts, *places), order=2, eps=1e-6, rtol=1e-5)
