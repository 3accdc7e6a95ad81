"""Damped vibrations: rates and shapes against solutions on paper, in the plane and in space."""

from functools import partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.optimize import brentq

from crinoid.dynamics import (
    DampedModes,
    ModesError,
    Relaxing,
    SmallMotions,
    System,
    find_damped_modes,
    find_modes,
    find_relaxing_modes,
)
from crinoid.dynamics.tangent import LineStiffness
from crinoid.elements import TipLoad
from crinoid.flow import Uniform
from helpers.arms import QUICKLY, always, arm
from helpers.beams import NATURAL


@eqx.filter_jit(compiler_options=QUICKLY)
def linearised(system: System, strain: Array, current: Array) -> SmallMotions:
    state = system.rest()
    state = eqx.tree_at(lambda s: s.motion.position, state, state.motion.position * (1.0 + strain))
    return system.small_motions(state, current)


def small(
    current: tuple[float, ...] = (0.0, 0.0),
    thrust: float = 0.0,
    follows: bool = True,
    **made: float,
) -> SmallMotions:
    """Linearise an arm in the plane: every test has the same parts, so that one is compiled."""
    name = "follower_force" if follows else "dead_force"
    load = partial(TipLoad.of, **{name: (-thrust, 0.0)})
    water = {"water_density": 1000.0, "drag_normal": 0.0, "drag_tangential": 0.0}
    system = arm(
        nodes=21,
        **water | made,
        loads=(load,),
        flows=(Uniform(always(), jnp.asarray(current)),),
    )
    return linearised(system, jnp.asarray(-thrust / 1e4), jnp.asarray(current))


def modes(motions: SmallMotions, count: int = 6) -> DampedModes:
    return find_damped_modes(
        motions.stiffness_in_current, motions.damping_in_current, motions.mass, count
    )


def test_viscous_material_damps_each_mode_by_half_its_frequency_times_the_damping_time():
    found = modes(small(damping_time=0.01), 8)
    ratio = NATURAL * 0.01 / 2
    np.testing.assert_allclose(found.damping_ratio[:3], ratio, rtol=1e-3)
    np.testing.assert_allclose(
        2 * np.pi * found.frequency[:3], NATURAL * np.sqrt(1 - ratio**2), rtol=1e-3
    )
    np.testing.assert_allclose(found.decay_rate[:3], NATURAL**2 * 0.01 / 2, rtol=2e-3)
    # faster than 2 / 0.01 none swings: of each the slower of its two rates is told
    undamped = 2 * np.pi * find_modes(*small()[:2], 8).frequency
    over = undamped * 0.01 / 2 > 1
    assert over.sum() == 2
    np.testing.assert_array_equal(found.frequency == 0, over)
    np.testing.assert_allclose(found.damping_ratio, undamped * 0.01 / 2, rtol=1e-6)
    slower = undamped * (found.damping_ratio - np.sqrt(found.damping_ratio[over] ** 2 - 1).max())
    assert found.decay_rate[-1] == pytest.approx(slower[-1], rel=1e-6)


def test_modes_of_a_material_that_relaxes_solve_its_cubic_and_one_without_a_rate_is_left_out():
    still = small()
    none = jnp.zeros_like(still.stiffness)
    natural = 2 * np.pi * find_modes(*still[:2], 4).frequency
    for ratio, time, missing in ((3.0, 0.5, []), (12.0, 0.1, [2])):
        branch = np.array([[ratio], [time / natural[1]]])
        relaxing = Relaxing(still.stiffness, branch)
        found = find_relaxing_modes(relaxing, still.stiffness, none, still.mass, 4)
        assert np.flatnonzero(np.isnan(found.frequency)).tolist() == missing
        for mode in np.flatnonzero(np.isfinite(found.frequency)).tolist():
            # (s^2 + w^2) (1 + s T) + w^2 r s T = 0
            power, late = natural[mode] ** 2, branch[1, 0]
            roots = np.roots([late, 1.0, power * late * (1 + ratio), power])
            swing = roots[np.argmax(roots.imag)]
            assert abs(found.rate(mode) - swing) < 1e-6 * abs(swing)


def test_a_cross_current_damps_by_the_slope_of_its_drag():
    # 1/2 rho Cd d |w| w has the slope rho Cd d U; m = 1 kg/m, added mass 0.6 kg/m
    drag = {"drag_normal": 1.2, "diameter": 0.02, "displaced_area": 6e-4}
    found = modes(small((0.0, 0.1), **drag), 3)
    slope, mass = 1000 * 1.2 * 0.02 * 0.1, 1.6
    natural = NATURAL / np.sqrt(mass)
    np.testing.assert_allclose(found.damping_ratio, slope / (2 * mass * natural), rtol=3e-3)
    np.testing.assert_allclose(
        2 * np.pi * found.frequency,
        np.sqrt(natural**2 - (slope / (2 * mass)) ** 2),
        rtol=1e-3,
    )
    still = modes(small(**drag), 3)
    np.testing.assert_allclose(2 * np.pi * still.frequency, natural, rtol=1e-3)
    assert np.abs(still.damping_ratio).max() < 1e-8  # quadratic drag has no slope at rest


@pytest.mark.parametrize(
    ("share", "flutters"), [(0.98, False), (1.02, True)], ids=["below", "beyond"]
)
def test_a_thrust_that_follows_the_tip_makes_it_flutter_beyond_becks_load(share, flutters):
    # P = 20.05 EI / L^2, where the first two frequencies meet at 11.02 (Beck 1952; Bolotin 1963)
    found = modes(small(thrust=20.05 * share), 2)
    assert found.frequency[0] > 0
    assert (found.damping_ratio.min() < -1e-3) == flutters
    if flutters:
        grows = np.argmin(found.damping_ratio)
        assert 2 * np.pi * found.frequency[grows] == pytest.approx(11.02, rel=0.01)
        assert np.abs(found.shape[grows].imag).max() > 0.05  # a wave that travels, no standing one
    else:
        assert np.abs(found.shape.imag).max() < 1e-6


def test_an_arm_pushed_beyond_its_buckling_load_leaves_without_swinging():
    # EI w'''' + P w'' + m s^2 w = 0, with s > 0 beyond Euler's load pi^2 / 4 (EI = m = L = 1)
    thrust = 1.2 * np.pi**2 / 4

    def held(rate: float) -> float:
        k = np.sqrt(np.roots([1, thrust, rate**2]) + 0j)
        k = np.concatenate([k, -k])
        ends = [k**0, k, k**2 * np.exp(k), (k**3 + thrust * k) * np.exp(k)]
        return float((np.linalg.det(ends) / np.linalg.det(np.vander(k))).real)

    found = modes(small(thrust=thrust, follows=False), 3)
    assert found.frequency[0] == 0.0
    assert found.damping_ratio[0] == -1.0
    assert found.decay_rate[0] == pytest.approx(-brentq(held, 0.1, 1.7), rel=2e-3)
    assert (found.frequency[1:] > 0).all()
    assert np.abs(found.damping_ratio[1:]).max() < 1e-8


def test_a_large_arm_is_solved_among_its_slowest_undamped_modes_to_the_same(monkeypatch):
    pull = np.random.default_rng(1).normal(size=(22, 2, 2))
    lines = LineStiffness(pull, 3.0 * np.moveaxis(pull, -1, 0))
    moving = small((0.1, 0.2), drag_normal=1.2, diameter=0.05, damping_time=0.002)
    given = moving.stiffness_in_current, moving.damping_in_current, moving.mass, 4
    for strung in (None, lines):
        whole = find_damped_modes(*given, strung)
        with monkeypatch.context() as patched:
            patched.setattr("crinoid.dynamics.damped_modes.DENSE_UNKNOWNS", 10)
            patched.setattr("crinoid.dynamics.damped_modes.SPARE_MODES", 4)
            found = find_damped_modes(*given, strung)
        assert (whole.damping_ratio > 1e-3).all()
        for one, other in zip(found, whole, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-7)


def test_lines_stiffen_the_modes_as_they_do_without_damping():
    pull = np.random.default_rng(1).normal(size=(22, 2, 2))
    lines = LineStiffness(pull, 3.0 * np.moveaxis(pull, -1, 0))
    motions = small()
    bare, strung = (
        find_modes(motions.stiffness, motions.mass, 3, each).frequency for each in (None, lines)
    )
    assert strung[0] > 1.1 * bare[0]
    found = find_damped_modes(*motions[:1], motions.damping_in_current, motions.mass, 3, lines)
    np.testing.assert_allclose(found.frequency, strung, rtol=1e-8)


@pytest.mark.release
def test_a_motion_that_nothing_drives_back_has_no_damping_ratio():
    free = arm(nodes=6, pinned=True, linear_drag=0.5)
    motions = linearised(free, jnp.zeros(()), jnp.zeros(2))
    found = modes(motions, 2)
    # turning about the pin: lambda is 0 or, which is the faster one, -c / m
    assert found.frequency[0] == found.decay_rate[0] == 0.0
    assert np.isnan(found.damping_ratio[0])
    turned = found.shape[0, :, 1].real
    np.testing.assert_allclose(turned, np.linspace(0, turned[-1], turned.size), atol=1e-9)
    assert found.damping_ratio[1] == pytest.approx(0.5 / (2 * 3.9266023**2), rel=0.01)


def test_matrices_that_are_no_numbers_have_no_damped_modes():
    bands = jnp.full((5, 5, 2, 2), jnp.nan)
    with pytest.raises(ModesError, match="no damped modes found"):
        find_damped_modes(bands, bands, bands, 2)


@pytest.mark.slow
def test_in_space_a_current_damps_motion_along_it_twice_as_much_as_across_it():
    # along it the slope of 1/2 rho Cd d |w| w is rho Cd d U, across it half as much
    current = jnp.array([0.0, 0.1, 0.0])
    given = {"axes": 3, "nodes": 21, "GJ": 1e4, "water_density": 1000.0, "drag_tangential": 0.0}
    round_arm = arm(**given, drag_normal=1.2, diameter=0.02, flows=(Uniform(always(), current),))
    motions = linearised(round_arm, jnp.zeros(()), current)
    found = modes(motions, 4)
    natural, slope = np.repeat(NATURAL[:2], 2), 1000 * 1.2 * 0.02 * 0.1
    natural_found = np.hypot(2 * np.pi * found.frequency, found.decay_rate)
    np.testing.assert_allclose(natural_found, natural, rtol=1e-3)
    for pair in (slice(0, 2), slice(2, 4)):
        order = np.argsort(found.damping_ratio[pair])
        np.testing.assert_allclose(
            (found.damping_ratio[pair] * 2 * natural[pair] / slope)[order], [0.5, 1.0], rtol=3e-3
        )
        across, along = np.abs(found.shape[pair])[order]
        assert across[:, 1].max() < 1e-6 * across[:, 2].max()
        assert along[:, 2].max() < 1e-6 * along[:, 1].max()
    # in still water both ways are alike: what comes out stands still in a plane, z before y
    calm = find_damped_modes(motions.stiffness, 0.01 * motions.stiffness, motions.mass, 4)
    assert np.abs(calm.shape.imag).max() < 1e-9
    assert np.abs(calm.shape[::2, :, 1]).max() < 1e-6
    assert np.abs(calm.shape[1::2, :, 2]).max() < 1e-6
