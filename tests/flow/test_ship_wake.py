"""The wake of a ship: Kelvin's pattern, Michell's amplitudes, and its arrival."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

import crinoid
from crinoid.flow import ShipWake
from crinoid.flow.ship_wake import amplitude
from crinoid.numerics.dispersion import dispersion
from crinoid.numerics.ramp import Onset

GRAVITY, SPEED, DISTANCE = 9.81, 3.0, 8.0
HULL = {"length": 6.0, "beam": 1.2, "draught": 0.35}
CUSP = 8**0.5 * DISTANCE / SPEED
"""Time from the passing to the first waves of the wedge (s)."""


def wake(
    *,
    time=0.0,
    components=600,
    depth=None,
    current=(0.0, 0.0),
    velocity=(SPEED, 0.0),
    distance=DISTANCE,
    **hull,
):
    made = ShipWake.passed(
        Onset.of(),
        speed=float(np.hypot(*velocity)),
        direction=float(np.arctan2(*velocity[::-1])),
        distance=distance,
        time=time,
        **(hull or HULL),
        place=(0.0,) * len(current),
        components=components,
        depth=depth,
        gravity=GRAVITY,
        current=current,
    )
    return made.carried(jnp.asarray((*current, 0.0)), jnp.asarray(GRAVITY))


@eqx.filter_jit
def _surface(flow, points, times):
    return jax.vmap(flow.elevation)(points, times)


def surface(flow, points, times):
    """Return the elevation at pairs of a level point and a time (m)."""
    times = np.asarray(times, float)
    points = np.broadcast_to(points, (times.size, 2))
    return np.asarray(_surface(flow, jnp.asarray(np.c_[points, 0 * times]), jnp.asarray(times)))


def record(flow, times):
    """Return the elevation at the origin of the waves without their onset (m)."""
    turns = np.asarray(flow.phases)[:, None] - np.outer(flow.frequencies, times) / (2 * np.pi)
    return flow.amplitudes @ np.cos(2 * np.pi * turns)


def test_transverse_waves_on_the_track_are_as_fast_as_the_ship():
    behind = np.linspace(60.0, 140.0, 4001)
    points = np.stack([40 * SPEED - behind, np.full(behind.size, -DISTANCE)], axis=1)
    height = surface(wake(components=2000), points, np.full(behind.size, 40.0))
    rise = np.flatnonzero((height[1:] >= 0) & (height[:-1] < 0))
    length = (behind[rise[-1]] - behind[rise[0]]) / (rise.size - 1)
    assert rise.size > 10
    assert length == pytest.approx(2 * np.pi * SPEED**2 / GRAVITY, rel=0.005)


@pytest.mark.parametrize(("depth", "angle"), [(1e3, 19.4712), (2.0, 20.1574)])
def test_the_wedge_has_kelvins_angle(depth, angle):
    """Each wave fills a line from the ship, where the phase does not depend on its direction.

    The energy is on that line by the group velocity. In shallow water the wedge is wider.
    """
    flow = wake(depth=depth, components=4001)
    along, aside = np.asarray(flow.wave_numbers[:, None] * flow.headings).T
    rays = np.degrees(np.arctan(np.gradient(along) / np.gradient(aside)))
    number = np.linspace(0.8, 4.0, 100_001)
    sigma, group = dispersion(number, depth, GRAVITY)
    cos = np.minimum(sigma / (number * SPEED), 1)
    edge = np.degrees(np.arctan(group * np.sqrt(1 - cos**2) / (SPEED - group * cos))).max()
    assert np.abs(rays).max() == pytest.approx(edge, abs=0.01)
    assert edge == pytest.approx(angle, abs=1e-3)


def test_all_waves_follow_the_ship_in_water_of_any_depth():
    flow = wake(depth=3.0, velocity=(2.0, 2.0))
    number, heading = np.asarray(flow.wave_numbers), np.asarray(flow.headings)
    assert np.asarray(flow.frequencies) == pytest.approx(number * (heading @ [2.0, 2.0]), rel=1e-9)
    squared = GRAVITY * number * np.tanh(3.0 * number)
    assert np.asarray(flow.frequencies) ** 2 == pytest.approx(squared, rel=1e-9)


@pytest.mark.parametrize("froude", [0.266, 0.35, 0.5])
def test_the_energy_of_the_waves_is_the_resistance_of_michell(froude):
    speed = froude * np.sqrt(GRAVITY * HULL["length"])
    number, (length, beam, draught) = GRAVITY / speed**2, HULL.values()

    def radiated(angle):
        found = amplitude(np.tan([angle]), number, length, beam, draught)[0]
        return 0.5 * np.pi * speed**2 * found**2 * np.cos(angle) ** 3

    nodes, weights = np.polynomial.legendre.leggauss(120)
    x, z = np.meshgrid(0.5 * length * nodes, 0.5 * draught * (nodes - 1), indexing="ij")
    slope = -4 * beam * x / length**2 * (1 - (z / draught) ** 2)
    slope *= np.outer(weights, weights) * length * draught / 4

    def integrand(rapidity):
        secant = np.cosh(rapidity)
        whole = np.sum(slope * np.exp(number * secant * (secant * z + 1j * x)))
        return abs(whole) ** 2 * secant**2

    resistance = 4 * GRAVITY**2 / (np.pi * speed**2) * quad(integrand, 0, 4, limit=200)[0]
    half_turn = 2 * quad(radiated, 0, np.pi / 2 - 1e-6, limit=200)[0]
    assert half_turn == pytest.approx(resistance, rel=1e-3)


def test_the_wake_arrives_after_the_ship_and_behind_the_wedge():
    times = np.linspace(-3.0, 30.0, 3301)
    height = surface(wake(), (0.0, 0.0), times)
    assert not height[times <= 0].any()
    highest = np.abs(height).max()
    assert np.abs(height[times < 0.5 * CUSP]).max() < 0.04 * highest
    period = 2 * np.pi * SPEED / GRAVITY
    assert CUSP - period < times[np.abs(height).argmax()] < CUSP + 2 * period


def test_a_ship_that_passed_before_the_run_left_the_same_wake():
    times = np.linspace(0.0, 20.0, 201)
    now, before = (
        surface(wake(), (0.0, 0.0), times + 6),
        surface(wake(time=-6.0), (0.0, 0.0), times),
    )
    assert before == pytest.approx(now, abs=1e-12)


def test_the_sum_has_converged():
    scenario = crinoid.load("ship-wake")
    made = scenario.flow[0].build(scenario, None)
    times = np.linspace(2.0, 30.0, 1401)

    more = wake(time=2.0, components=2 * made.amplitudes.size, depth=3.0)
    once, twice = record(made, times), record(more, times)
    assert np.abs(once - twice).max() < 1e-3 * np.abs(twice).max()


def test_a_current_carries_ship_and_waves():
    drift, times = np.array([0.2, -0.1]), np.linspace(5.0, 25.0, 101)
    ground = np.array([SPEED, 0.0]) + drift
    carried, still = wake(current=tuple(drift), velocity=tuple(ground)), wake()
    place, port = np.array([3.0, 2.0]), np.array([-ground[1], ground[0]]) / np.hypot(*ground)
    # both from the ship at t = 0, which is abreast of x = y = 0
    points = place + DISTANCE * (np.array([0.0, 1.0]) - port) + np.outer(times, drift)
    expected = surface(still, place, times)
    assert surface(carried, points, times) == pytest.approx(expected, abs=1e-9)


def test_the_surface_moves_with_the_water_and_the_jet_is_its_derivative():
    flow, top = wake(depth=3.0, components=64), jnp.asarray([1.0, 0.5, 0.0])
    elevation, velocity = eqx.filter_jit(flow.elevation), eqx.filter_jit(flow.velocity)
    instant, later, sooner = (jnp.asarray(CUSP + shift) for shift in (0.0, 1e-4, -1e-4))
    rise = (elevation(top, later) - elevation(top, sooner)) / 2e-4
    assert float(velocity(top, instant)[2]) == pytest.approx(float(rise), rel=1e-6)
    # while it sets in
    below = top - jnp.asarray([0.0, 0.0, 0.4])
    instant, later, sooner = (
        jnp.asarray(0.4 * DISTANCE / SPEED + shift) for shift in (0.0, 1e-4, -1e-4)
    )
    jet = eqx.filter_jit(flow.jet)(below, instant)
    rate = (velocity(below, later) - velocity(below, sooner)) / 2e-4
    np.testing.assert_allclose(jet.velocity, velocity(below, instant), rtol=1e-9)
    np.testing.assert_allclose(jet.rate, rate, rtol=1e-5)


def test_a_planar_arm_sees_the_cut():
    plane, space = wake(current=(0.0,)), wake()
    for time in (8.0, 12.0):
        planar = plane.velocity(jnp.asarray([0.3, -0.4]), jnp.asarray(time))
        spatial = space.velocity(jnp.asarray([0.3, 0.0, -0.4]), jnp.asarray(time))
        np.testing.assert_allclose(planar, spatial[jnp.asarray([0, 2])], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("froude", [0.35, 0.4, 0.5])
@pytest.mark.parametrize("share", [0.1, 0.15])
@pytest.mark.parametrize("away", [1.0, 4.0])
def test_the_height_is_that_of_kriebel_and_seelig_within_a_factor(froude, share, away):
    """Compare with ``g H / U^2 = (F - 0.1)^2 (y / L)^(-1/3)``, deep water, fine ends.

    Kriebel and Seelig 2005, An empirical model for ship-generated waves.
    """
    length = 10.0
    speed = froude * np.sqrt(GRAVITY * length)
    hull = {"length": length, "beam": share * length, "draught": 0.06 * length}
    flow = wake(velocity=(speed, 0.0), distance=away * length, components=2000, **hull)
    times = 8**0.5 * away * length / speed + np.linspace(-5, 10, 400) * speed / GRAVITY
    measured = speed**2 / GRAVITY * (froude - 0.1) ** 2 * away ** (-1 / 3)
    assert 0.6 < np.ptp(record(flow, times)) / measured < 2.3
