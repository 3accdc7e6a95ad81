"""Surface waves: dispersion, kinematics, and the spectrum asked for."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.flow import build_flow
from crinoid.flow import Jet, Waves
from crinoid.flow.waves import jonswap, wave_number
from crinoid.onset import Onset

GRAVITY = 9.81
OBLIQUE = np.array([np.cos(0.7), np.sin(0.7)])


def waves(*, seed=0, heading=OBLIQUE, components=64, depth=25.0, height=2.0, period=7.0, gamma=3.3):
    return Waves.of(
        Onset.of(),
        significant_height=height,
        peak_period=period,
        heading=heading,
        gamma=gamma,
        components=components,
        depth=depth,
        gravity=GRAVITY,
        generator=np.random.default_rng(seed),
    )


@eqx.filter_jit
def jets(flow, points, time):
    return jax.vmap(flow.jet, (0, None))(jnp.asarray(points), jnp.asarray(time))


def amplitude(flow, height):
    """Return the amplitudes of the velocity of one wave at a height, level and upward."""
    quarter = np.pi / 2 / float(flow.frequencies[0])
    pair = [jets(flow, [[0.0, height]], time).velocity[0] for time in (0.0, quarter)]
    return np.hypot(*np.asarray(pair))


@pytest.mark.parametrize("depth", [0.01, 1.0, 30.0, 1e4])
def test_dispersion(depth):
    frequency = np.geomspace(1e-2, 1e2, 101)
    number = wave_number(frequency, depth, GRAVITY)
    balance = GRAVITY * number * np.tanh(number * depth)
    np.testing.assert_allclose(balance, frequency**2, rtol=1e-12)


def test_deep_water_decays_as_an_exponential_and_never_overflows():
    flow = waves(components=1, depth=1e4, heading=np.array([1.0]))
    number, frequency = float(flow.wave_numbers[0]), float(flow.frequencies[0])
    assert number == pytest.approx(frequency**2 / GRAVITY, rel=1e-12)
    for height in (0.0, -1.0, -10.0, -40.0):
        speed = float(flow.amplitudes[0]) * frequency * np.exp(number * height)
        assert amplitude(flow, height) == pytest.approx([speed, speed], rel=1e-12)
    for part in jax.tree.leaves(jets(flow, [[0.0, -9e3], [0.0, -1e4]], 1.0)):
        np.testing.assert_array_equal(part, 0.0)  # less than any number there


def test_shallow_water_moves_as_one():
    depth = 5e-4
    flow = waves(components=1, depth=depth, height=1e-5, heading=np.array([1.0]))
    shallow = float(flow.wave_numbers[0]) * depth
    assert shallow < 0.01
    speed = float(flow.amplitudes[0]) * np.sqrt(GRAVITY / depth)
    for height in (0.0, -2e-4, -5e-4):
        along, up = amplitude(flow, height)
        assert along == pytest.approx(speed, rel=shallow**2)
        # upward it grows in proportion to the height over the bed, to what the surface has
        share = (height + depth) / depth * float(flow.amplitudes[0] * flow.frequencies[0])
        assert up == pytest.approx(share, rel=shallow**2, abs=1e-15)


def test_there_is_neither_divergence_nor_rotation():
    points = np.random.default_rng(9).uniform([-50, -50, -25], [50, 50, 0], (200, 3))
    flow = waves()

    @jax.jit
    @jax.vmap
    def gradient(point):
        return jax.jacfwd(lambda x: flow.velocity(x, jnp.asarray(3.7)))(point)

    gradients = np.asarray(gradient(jnp.asarray(points)))
    scale = np.sqrt(np.mean(gradients**2))
    assert np.abs(np.trace(gradients, axis1=1, axis2=2)).max() < 1e-12 * scale
    assert np.abs(gradients - gradients.swapaxes(1, 2)).max() < 1e-12 * scale


def test_the_surface_and_the_bed_bound_the_water():
    flow, place = waves(), jnp.asarray([3.0, -2.0, 0.0])

    @jax.jit
    def slope(time):
        elevation = jax.jacfwd(lambda x: flow.elevation(x, time))(place)
        return elevation, jax.jacfwd(lambda t: flow.elevation(place, t))(time)

    for time in (0.3, 11.0):
        jet = jets(flow, place[None], time)
        across, rising = slope(jnp.asarray(time))
        # the surface moves with the water, and the water is driven by the slope of the surface
        assert jet.velocity[0, 2] == pytest.approx(float(rising), rel=1e-10)
        np.testing.assert_allclose(jet.rate[0, :2], -GRAVITY * across[:2], rtol=1e-10)
        bed = jets(flow, [[3.0, -2.0, -25.0]], time).velocity[0]
        assert abs(bed[2]) < 1e-12 < abs(bed[0])


@pytest.mark.parametrize(("beyond", "edge"), [(1.5, 0.0), (-40.0, -25.0)])
def test_beyond_surface_and_bed_the_water_moves_as_there(beyond, edge):
    flow = waves()
    outside, inside = (jets(flow, [[3.0, -2.0, height]], 2.0) for height in (beyond, edge))
    np.testing.assert_array_equal(outside.velocity, inside.velocity)
    place = (jnp.asarray([3.0, -2.0, beyond]), jnp.asarray(2.0))
    differentiated = jax.jit(lambda point, time: Jet.of(flow.velocity, point, time))(*place)
    for part, expected in zip(
        jax.tree.leaves(outside), jax.tree.leaves(differentiated), strict=True
    ):
        np.testing.assert_allclose(part[0], expected, atol=1e-12)
    assert not outside.gradient[0, :, 2].any()


def test_significant_height_is_four_standard_deviations_of_the_surface():
    flow = waves(height=2.0)
    exact = 4 * np.sqrt(np.sum(np.asarray(flow.amplitudes) ** 2) / 2)
    assert exact == pytest.approx(2.0, rel=1e-12)
    # and of a record of 4000 peak periods
    times = jnp.arange(0.0, 28_000.0, 0.7)
    surface = jax.jit(jax.vmap(lambda t: flow.elevation(jnp.zeros(3), t)))(times)
    assert 4 * np.std(surface) == pytest.approx(2.0, rel=0.02)


def test_components_follow_the_spectrum():
    period = 7.0
    flow = waves(components=4000, gamma=1.0, period=period)
    relative = np.sort(np.asarray(flow.frequencies)) * period / (2 * np.pi)
    # of Pierson and Moskowitz's spectrum this share of the energy lies below a frequency; the
    # part above 4 times the peak, 0.5 %, is cut
    below = np.exp(-1.25 * relative**-4.0)
    share = (np.arange(4000) + 0.5) / 4000
    assert np.abs(below - share).max() < 0.006
    # and a peak adds this much energy (DNV-RP-C205, good to about a percent)
    fine = np.linspace(0.3, 20, 200_001)
    energy = [np.trapezoid(jonswap(fine, gamma), fine) for gamma in (1.0, 2.0, 3.3, 5.0)]
    expected = 1 / (1 - 0.287 * np.log([1.0, 2.0, 3.3, 5.0]))
    assert np.array(energy) / energy[0] == pytest.approx(expected, rel=0.015)
    assert np.array(energy[0]) == pytest.approx(1 / 5, rel=1e-4)  # x^-5 exp(-5/4 x^-4)


def test_components_have_no_common_period():
    # equal steps of frequency would repeat the surface after one over the step
    frequencies = np.sort(np.asarray(waves().frequencies))
    steps = np.diff(frequencies)
    assert steps.min() > 0
    assert steps.std() > 0.3 * steps.mean()


def test_a_planar_arm_sees_the_cut_through_them():
    full, flat = waves(), waves(heading=OBLIQUE[:1])
    whole = jets(full, [[3.0, 0.0, -4.0]], 2.1)
    cut = jets(flat, [[3.0, -4.0]], 2.1)
    keep = np.array([0, 2])
    np.testing.assert_allclose(cut.velocity, whole.velocity[:, keep], rtol=1e-12)
    np.testing.assert_allclose(cut.rate, whole.rate[:, keep], rtol=1e-12)
    gradient = whole.gradient[:, keep][..., keep]
    np.testing.assert_allclose(cut.gradient, gradient, rtol=1e-9, atol=1e-14)


def test_a_scenario_turns_them_and_draws_them_from_its_seed():
    def flow(seed, direction, dimension=2):
        table = {
            "kind": "waves",
            "significant_height": 1.0,
            "peak_period": 6.0,
            "direction_deg": direction,
        }
        scenario = crinoid.Scenario(seed=seed, water={"depth": 30.0}, flow=[table])
        arm = scenario.arm.model_copy(update={"dimension": dimension})
        return build_flow(scenario.model_copy(update={"arm": arm}), 0, scenario.flow[0])

    ahead, aside, full = flow(3, 0.0), flow(3, 60.0), flow(3, 60.0, dimension=3)
    assert ahead.heading == pytest.approx([1.0])
    assert aside.heading == pytest.approx([0.5])
    assert full.heading == pytest.approx([0.5, np.sqrt(0.75)])
    np.testing.assert_array_equal(ahead.phases, aside.phases)
    np.testing.assert_array_equal(full.phases, aside.phases)
    assert np.abs(flow(4, 0.0).phases - ahead.phases).max() > 0.1
