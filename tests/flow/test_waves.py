"""Surface waves: dispersion, kinematics, and the spectrum asked for."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.arrays import build_flow
from crinoid.flow import Jet, Waves
from crinoid.flow.wave_number import wave_number
from crinoid.flow.waves import jonswap
from crinoid.numerics.dispersion import deep_wave_number, stopped
from crinoid.numerics.ramp import Onset
from helpers.currents import gradients, numbers

GRAVITY = 9.81
REGULAR = {"kind": "regular-wave", "height": 0.8, "period": 5.0}


def waves(
    *,
    seed=0,
    direction=0.7,
    level=2,
    spreading=None,
    components=64,
    depth=25.0,
    height=2.0,
    period=7.0,
    gamma=3.3,
):
    return Waves.jonswap(
        Onset.of(),
        significant_height=height,
        peak_period=period,
        direction=direction,
        spreading=spreading,
        gamma=gamma,
        components=components,
        depth=depth,
        gravity=GRAVITY,
        current=(0.0,) * level,
        generator=np.random.default_rng(seed),
    ).carried(jnp.zeros(level + 1), jnp.asarray(GRAVITY))


@eqx.filter_jit
def jets(flow, points, time):
    return jax.vmap(flow.jet, (0, None))(jnp.asarray(points), jnp.asarray(time))


@eqx.filter_jit
def _current(water, point, time):
    return water.current(point, time)


def currents(water, point, time):
    """Return the current of all flows at a point."""
    return _current(water, *numbers(point, time))


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
    flow = waves(components=1, depth=1e4, direction=0.0, level=1)
    number, frequency = float(flow.wave_numbers[0]), float(flow.frequencies[0])
    assert number == pytest.approx(frequency**2 / GRAVITY, rel=1e-12)
    for height in (0.0, -1.0, -10.0, -40.0):
        speed = float(flow.amplitudes[0]) * frequency * np.exp(number * height)
        assert amplitude(flow, height) == pytest.approx([speed, speed], rel=1e-12)
    for part in jax.tree.leaves(jets(flow, [[0.0, -9e3], [0.0, -1e4]], 1.0)):
        np.testing.assert_array_equal(part, 0.0)  # less than any number there


def test_shallow_water_moves_as_one():
    depth = 5e-4
    flow = waves(components=1, depth=depth, height=1e-5, direction=0.0, level=1)
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
    slopes = gradients(waves(), points)
    scale = np.sqrt(np.mean(slopes**2))
    assert np.abs(np.trace(slopes, axis1=1, axis2=2)).max() < 1e-12 * scale
    assert np.abs(slopes - slopes.swapaxes(1, 2)).max() < 1e-12 * scale


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
    of = jax.jit(lambda point, time: Jet.of(flow.velocity, point, time))
    differentiated = jax.tree.leaves(of(*numbers([3.0, -2.0, beyond], 2.0)))
    for part, expected in zip(jax.tree.leaves(outside), differentiated, strict=True):
        np.testing.assert_allclose(part[0], expected, atol=1e-12)
    assert not outside.gradient[0, :, 2].any()


def test_significant_height_is_four_standard_deviations_of_the_surface():
    flow = waves(height=2.0)
    assert 4 * np.sqrt(np.sum(flow.amplitudes**2) / 2) == pytest.approx(2.0, rel=1e-12)
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
    steps = np.diff(np.sort(np.asarray(waves().frequencies)))
    assert steps.min() > 0
    assert steps.std() > 0.3 * steps.mean()


def test_a_planar_arm_sees_the_cut_through_them():
    full, flat = waves(), waves(level=1)
    whole = jets(full, [[3.0, 0.0, -4.0]], 2.1)
    cut = jets(flat, [[3.0, -4.0]], 2.1)
    keep = np.array([0, 2])
    np.testing.assert_allclose(cut.velocity, whole.velocity[:, keep], rtol=1e-12)
    np.testing.assert_allclose(cut.rate, whole.rate[:, keep], rtol=1e-12)
    gradient = whole.gradient[:, keep][..., keep]
    np.testing.assert_allclose(cut.gradient, gradient, rtol=1e-9, atol=1e-14)


def in_scenario(dimension=3, flows=(), **table):
    """Return the flow of a regular wave of 0.8 m and 5 s in a scenario, after other flows."""
    depth = table.pop("depth", 6.0)
    scenario = crinoid.Scenario(
        arm={"dimension": dimension},
        base={"position": [0.0] * (dimension - 1) + [-2.0]},
        water={} if depth is None else {"depth": depth},
        flow=[*flows, table if "kind" in table else REGULAR | table],
    )
    return crinoid.system(scenario).forces.water


def airy(point, time, *, number, frequency, depth, phase=0.0, seen=None):
    """Return velocity and its rate in the plane of travel, of a wave of 0.8 m (closed form)."""
    along, height = point
    seen = frequency if seen is None else seen
    angle = number * along - seen * time + phase
    size = 0.4 * frequency / np.sinh(number * depth)
    level, up = (f(number * (height + depth)) for f in (np.cosh, np.sinh))
    velocity = size * np.array([level * np.cos(angle), up * np.sin(angle)])
    rate = size * seen * np.array([level * np.sin(angle), -up * np.cos(angle)])
    gradient = (
        size
        * number
        * np.array(
            [
                [-level * np.sin(angle), up * np.cos(angle)],
                [up * np.cos(angle), level * np.sin(angle)],
            ]
        )
    )
    return velocity, rate, gradient


@pytest.mark.parametrize("point", [(0.0, -1.0), (3.0, -5.9), (-41.0, -0.2)])
@pytest.mark.parametrize("time", [0.0, 7.3])
def test_a_regular_wave_is_that_of_linear_theory(point, time):
    frequency = 2 * np.pi / 5.0
    number = float(wave_number(np.array([frequency]), 6.0, GRAVITY)[0])
    wanted = airy(point, time, number=number, frequency=frequency, depth=6.0, phase=np.pi / 3)
    velocity, rate, gradient = wanted
    acceleration = rate + gradient @ velocity
    flat = currents(in_scenario(2, phase_deg=60.0), point, time)
    np.testing.assert_allclose(flat.velocity, velocity, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(flat.acceleration, acceleration, rtol=1e-9, atol=1e-13)
    # in space along any direction
    way = np.deg2rad(130.0)
    out = np.array([[np.cos(way), np.sin(way), 0.0], [0.0, 0.0, 1.0]])
    full = currents(in_scenario(phase_deg=60.0, direction_deg=130.0), point @ out, time)
    np.testing.assert_allclose(full.velocity, velocity @ out, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(full.acceleration, acceleration @ out, rtol=1e-9, atol=1e-13)


def test_a_regular_wave_has_its_crest_at_the_origin_at_first():
    flow = in_scenario(2).flows[0]
    surface = jax.jit(lambda point, time: flow.elevation(point, time))
    assert float(surface(*numbers([0.0, 0.0], 0.0))) == pytest.approx(0.4, rel=1e-12)
    assert float(surface(*numbers([0.0, 0.0], 2.5))) == pytest.approx(-0.4, rel=1e-12)


def test_a_regular_wave_without_depth_is_on_deep_water():
    frequency = 2 * np.pi / 5.0
    flow = currents(in_scenario(2, depth=None), (0.0, -7.0), 0.0)
    speed = 0.4 * frequency * np.exp(-7.0 * frequency**2 / GRAVITY)
    np.testing.assert_allclose(flow.velocity, [speed, 0.0], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        flow.acceleration[1], speed**2 * frequency**2 / GRAVITY - speed * frequency, rtol=1e-12
    )


@pytest.mark.parametrize("depth", [0.5, 6.0, None])
@pytest.mark.parametrize("current", [-0.7, 1.3])
def test_a_current_shifts_the_frequency(depth, current):
    stop = stopped(-current, depth, GRAVITY)
    frequency = np.geomspace(1e-2, min(20.0, stop * (1 - 1e-6)), 51)
    far = 1e8 if depth is None else depth
    number = wave_number(frequency, far, GRAVITY, current)
    deep = np.tanh(number * far)
    carried = np.sqrt(GRAVITY * number * deep)
    np.testing.assert_allclose(carried + number * current, frequency, rtol=1e-12)
    # the slow solution, in which the energy travels on, joins that of still water
    nearby = wave_number(frequency, far, GRAVITY, 1e-12 * current)
    np.testing.assert_allclose(nearby, wave_number(frequency, far, GRAVITY), rtol=1e-9)
    if depth is None:
        np.testing.assert_allclose(
            deep_wave_number(frequency, GRAVITY, current), number, rtol=1e-12
        )
    assert np.all(np.diff(frequency) / np.diff(number) > 0)


def test_waves_on_deep_water_stop_where_the_current_is_a_quarter_of_their_speed():
    # omega < g / 4 U (Peregrine 1976)
    assert stopped(0.7, None, GRAVITY) == pytest.approx(GRAVITY / 2.8, rel=1e-12)
    assert stopped(0.7, 1e3, GRAVITY) == pytest.approx(GRAVITY / 2.8, rel=1e-9)
    assert stopped(3.0, 0.5, GRAVITY) == 0.0
    assert np.isnan(wave_number(np.array([3.6]), 1e3, GRAVITY, -0.7))


@pytest.mark.parametrize("speed", [-0.6, 1.1])
def test_a_wave_on_a_current_is_a_wave_on_still_water_that_drifts(speed):
    seen, way = 2 * np.pi / 5.0, np.deg2rad(130.0)
    number = float(wave_number(np.array([seen]), 6.0, GRAVITY, speed)[0])
    frequency = np.sqrt(GRAVITY * number * np.tanh(6.0 * number))
    velocity, rate, gradient = airy(
        (3.0, -5.0), 7.3, number=number, frequency=frequency, depth=6.0, seen=seen
    )
    velocity = velocity + np.array([speed, 0.0])
    acceleration = rate + gradient @ velocity
    # a mean of flows at any angle: what runs along the waves counts
    along, across = [np.cos(way), np.sin(way)], [-np.sin(way), np.cos(way)]
    mean = speed * np.array([*along, 0.0]) + 0.3 * np.array([*across, 0.0])
    half = {"kind": "uniform", "velocity": (mean / 2).tolist()}
    water = in_scenario(direction_deg=130.0, flows=[half, half])
    point = [3.0 * along[0], 3.0 * along[1], -5.0]
    current = currents(water, point, 7.3)
    out = np.array([[*along, 0.0], [0.0, 0.0, 1.0]])
    drift = 0.3 * np.array([*across, 0.0])
    np.testing.assert_allclose(current.velocity, velocity @ out + drift, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(current.acceleration, acceleration @ out, rtol=1e-9, atol=1e-13)
    # from the drifting water it is a wave on still water: Du/Dt = (d/dt + U . grad) u there
    moving = airy((3.0 - speed * 7.3, -5.0), 7.3, number=number, frequency=frequency, depth=6.0)
    np.testing.assert_allclose(velocity - [speed, 0.0], moving[0], rtol=1e-9, atol=1e-13)


def test_irregular_waves_that_a_current_stops_are_left_out():
    # at twice the frequency of the peak they still travel, at four times they do not
    wander = {"standard_deviation": 0.1, "correlation_time": 2.0}
    mean = {"kind": "gauss-markov", "mean": [-0.9, 0.2]} | wander
    table = {"kind": "waves", "significant_height": 1.0, "peak_period": 6.0}
    flow = in_scenario(2, depth=40.0, flows=[mean], **table).flows[1]
    assert np.max(flow.frequencies) < GRAVITY / 3.6
    assert 4 * np.sqrt(np.sum(flow.amplitudes**2) / 2) == pytest.approx(1.0, rel=1e-12)
    doppler = flow.intrinsic_frequencies - 0.9 * flow.wave_numbers
    np.testing.assert_allclose(doppler, flow.frequencies, rtol=1e-10)


def test_a_scenario_turns_them_and_keeps_their_phases():
    table = {"kind": "waves", "significant_height": 1.0, "peak_period": 6.0}

    def flow(direction, dimension):
        scenario = crinoid.Scenario(
            seed=3, water={"depth": 30.0}, flow=[table | {"direction_deg": direction}]
        )
        arm = scenario.arm.model_copy(update={"dimension": dimension})
        return build_flow(scenario.model_copy(update={"arm": arm}), 0, scenario.flow[0])

    headings = {(0.0, 2): [1.0], (60.0, 2): [0.5], (60.0, 3): [0.5, np.sqrt(0.75)]}
    for way, heading in headings.items():
        np.testing.assert_allclose(flow(*way).headings, [heading] * 64, atol=1e-12)
        np.testing.assert_array_equal(flow(*way).phases, flow(60.0, 2).phases)


@pytest.mark.parametrize("spreading", [1.0, 10.0, 100.0])
def test_directions_follow_the_spreading(spreading):
    # cos^2s has the first moment s / (s + 1), so a width of sqrt(2 / (s + 1)) (Kuik et al. 1988)
    drawn = [np.asarray(waves(seed=seed, spreading=spreading).headings) for seed in range(20)]
    mean = (np.concatenate(drawn) @ [1, 1j]).mean()
    assert np.angle(mean) == pytest.approx(0.7, abs=0.01)
    width = np.sqrt(2 * (1 - np.abs(mean)))
    assert width == pytest.approx(np.sqrt(2 / (spreading + 1)), rel=0.01)
