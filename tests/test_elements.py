"""Each element alone: its forces, energies and powers against what they are by definition."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.elements import (
    AddedMass,
    Bend,
    DistributedLoad,
    Drag,
    Inertia,
    Motion,
    Stretch,
    TipLoad,
    Weight,
)
from physics import always

EDGE = 0.1
"""Length of an edge at rest (m)."""


def one(*numbers):
    return tuple(jnp.asarray(number, float) for number in numbers)


def stretch(damping_time=0.0):
    return Stretch(1, *one(30.0, EDGE, damping_time))


def bend(damping_time=0.0):
    return Bend(0, *one(0.7, 0.3, damping_time))


def drag(normal=2.0, tangential=0.3, linear=0.0):
    return Drag(1, *one([normal, 1.5 * normal], [tangential, 1.2 * tangential], [linear, linear]))


def added_mass(normal=1.0, tangential=0.2):
    return AddedMass(1, *one([0.4, 0.5], normal, tangential))


def distributed(tangential=1.3, normal=-0.6, fixed=(0.0, 0.0)):
    return DistributedLoad(1, *one(tangential, normal, fixed), always())


def tip_load(dead=(0.0, 0.0), follower=(0.0, 0.0), moment=0.0):
    return TipLoad(3, *one(dead, follower, [moment], [0.0]), always())


# whatever turns with the arm; every element of a kind has the same parameters throughout, so
# that each is compiled once
OBJECTIVE = {
    "stretch": stretch(0.05),
    "bend": bend(0.05),
    "inertia": Inertia(1, jnp.full(2, 0.3)),
    "drag": drag(linear=0.4),
    "added_mass": added_mass(),
    "distributed": distributed(),
    "tip_load": tip_load(follower=(0.8, -0.5), moment=0.2),
}
ALL = OBJECTIVE | {
    "weight": Weight(1, jnp.asarray(0.25)),
    "fixed_load": distributed(fixed=(0.2, -0.4)),
    "dead_load": tip_load(dead=(0.3, 0.9)),
}

residual = eqx.filter_jit(lambda element, motion: element.residual(motion))
energy = eqx.filter_jit(lambda element, motion: element.energy(motion))
power = eqx.filter_jit(lambda element, motion: element.power(motion))


@eqx.filter_jit
def energy_slope(element, motion):
    return jax.grad(
        lambda position: element.energy(eqx.tree_at(lambda m: m.position, motion, position))
    )(motion.position)


@eqx.filter_jit
def tangent(element, motion):
    """Return d(residual)/d(position)."""

    def moved(position):
        return element.residual(eqx.tree_at(lambda m: m.position, motion, position))

    return jax.jacfwd(moved)(motion.position)


def random_motion(stencil, seed):
    """Make a window that is stretched, bent, and moving in moving water."""
    rng = np.random.default_rng(seed)
    edges = EDGE * rng.uniform(0.8, 1.2, stencil)
    angles = rng.uniform(-np.pi, np.pi) + np.cumsum(rng.uniform(-1.0, 1.0, stencil))
    steps = edges[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    position = rng.normal(size=2) + np.cumsum(steps, axis=0)
    others = (jnp.asarray(rng.normal(size=(stencil, 2))) for _ in range(4))
    return Motion(jnp.asarray(position), *others, jnp.asarray(1.0))


def window(turn=0.0, angle=0.0, velocity=None, flow=(0.0, 0.0), stencil=3):
    """Make a window of edges of rest length, the first at ``angle``, the next turned further."""
    angles = angle + turn * np.arange(stencil - 1)
    steps = EDGE * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    position = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    still = np.zeros((stencil, 2))
    return Motion(
        jnp.asarray(position),
        jnp.asarray(still if velocity is None else velocity),
        jnp.asarray(still),
        jnp.asarray(still + np.asarray(flow)),
        jnp.asarray(still),
        jnp.asarray(1.0),
    )


def turn_all(motion, angle):
    c, s = np.cos(angle), np.sin(angle)
    rotation = jnp.asarray([[c, -s], [s, c]])
    return jax.tree.map(lambda x: x @ rotation.T if x.ndim == 2 else x, motion), rotation


def moment_about_origin(position, force):
    return np.sum(position[:, 0] * force[:, 1] - position[:, 1] * force[:, 0])


SEEDS = range(5)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    "element", [stretch(), bend(), ALL["weight"]], ids=["stretch", "bend", "weight"]
)
def test_conservative_force_is_the_slope_of_its_energy(element, seed):
    motion = random_motion(element.stencil, seed)
    slope = energy_slope(element, motion)
    assert np.abs(slope).max() > 0
    np.testing.assert_allclose(residual(element, motion), slope, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", [stretch, bend])
def test_damping_takes_the_power_that_it_says(kind, seed):
    motion = random_motion(kind().stencil, seed)
    damping = residual(kind(0.05), motion) - residual(kind(0.0), motion)
    taken = -np.sum(damping * motion.velocity)
    assert taken < 0
    np.testing.assert_allclose(power(kind(0.05), motion), taken, rtol=1e-11)
    assert power(kind(0.0), motion) == 0
    # and stores what it would without damping
    assert energy(kind(0.05), motion) == energy(kind(0.0), motion)


@pytest.mark.parametrize("name", ["stretch", "bend"])
def test_rigid_motion_is_not_damped(name):
    element = ALL[name]
    motion = random_motion(element.stencil, 1)
    x, z = np.asarray(motion.position).T
    velocity = jnp.asarray(np.stack([0.3 - 2.0 * z, -0.8 + 2.0 * x], axis=1))
    rigid = eqx.tree_at(lambda m: m.velocity, motion, velocity)
    # round-off of the rate, squared
    assert abs(power(element, rigid)) < 1e-24 * abs(power(element, motion))


@pytest.mark.parametrize("name", ALL)
def test_power_of_a_force_is_either_stored_or_counted(name):
    element = ALL[name]
    motion = random_motion(element.stencil, 2)
    if name == "inertia":
        # d/dt 1/2 m v^2 = m v . a
        storing = 0.3 * np.sum(motion.velocity * motion.acceleration)
    else:
        storing = np.sum(energy_slope(element, motion) * motion.velocity)
    fed = -np.sum(residual(element, motion) * motion.velocity)
    np.testing.assert_allclose(storing - power(element, motion), -fed, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("name", ALL)
def test_force_does_not_depend_on_the_place(name):
    element = ALL[name]
    motion = random_motion(element.stencil, 3)
    elsewhere = eqx.tree_at(
        lambda m: m.position, motion, motion.position + jnp.asarray([3.0, -2.0])
    )
    np.testing.assert_allclose(
        residual(element, elsewhere), residual(element, motion), rtol=0, atol=1e-11
    )


@pytest.mark.parametrize("angle", [0.7, -2.3])
@pytest.mark.parametrize("name", OBJECTIVE)
def test_force_turns_with_everything_else(name, angle):
    element = OBJECTIVE[name]
    motion = random_motion(element.stencil, 4)
    turned, rotation = turn_all(motion, angle)
    force = residual(element, motion)
    assert np.abs(force).max() > 1e-2
    np.testing.assert_allclose(residual(element, turned), force @ rotation.T, rtol=0, atol=1e-12)
    for scalar in (energy, power):
        np.testing.assert_allclose(
            scalar(element, turned), scalar(element, motion), rtol=1e-11, atol=1e-13
        )


@pytest.mark.parametrize("name", ["weight", "fixed_load", "dead_load"])
def test_dead_force_does_not_turn(name):
    element = ALL[name]
    if name == "fixed_load":
        element = distributed(0.0, 0.0, (0.2, -0.4))
    force = residual(element, random_motion(element.stencil, 4))
    assert np.abs(force).max() > 0.1
    np.testing.assert_array_equal(force, residual(element, random_motion(element.stencil, 5)))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ["stretch", "bend"])
def test_internal_forces_are_in_balance(name, seed):
    element = ALL[name]
    motion = random_motion(element.stencil, seed)
    force = np.asarray(residual(element, motion))
    size = np.abs(force).max()
    assert size > 1e-2
    np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-14 * size)
    np.testing.assert_allclose(
        moment_about_origin(np.asarray(motion.position), force), 0, atol=1e-13 * size
    )


def test_stretch_is_linear_in_the_length():
    # E_s = 1/2 EA l (1 - |e|/l)^2, force EA (|e|/l - 1)
    position = jnp.asarray([[0.0, 0.0], [0.0, 1.05 * EDGE]])
    motion = eqx.tree_at(lambda m: m.position, window(stencil=2), position)
    expected = 30.0 * 0.05 * np.array([[0, -1], [0, 1]])
    np.testing.assert_allclose(residual(stretch(), motion), expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(energy(stretch(), motion), 0.5 * 30 * EDGE * 0.05**2, rtol=1e-12)


@pytest.mark.parametrize("turn", [-2.9, -1.0, 0.0, 0.3, 1.0, 2.9])
def test_bend_is_linear_in_the_tangent_of_half_the_turn(turn):
    # integrated curvature 2 tan(phi / 2): Bergou et al. 2008, eq. 1
    stored = 0.5 * 0.7 * (2 * np.tan(turn / 2) - 0.3) ** 2
    np.testing.assert_allclose(energy(bend(), window(turn, 0.4)), stored, rtol=1e-11)


def test_bend_is_at_rest_at_its_rest_strain():
    motion = window(2 * np.arctan(0.3 / 2), 0.4)
    np.testing.assert_allclose(residual(bend(), motion), 0, atol=1e-14)


@pytest.mark.parametrize("turn", np.deg2rad([170.0, -170.0, 179.0]))
def test_almost_folded_edges_have_finite_and_exact_forces(turn):
    motion = window(turn, 0.4)
    element = bend()
    force, stiffness = residual(element, motion), tangent(element, motion)
    assert np.isfinite(force).all()
    assert np.isfinite(stiffness).all()
    # it resists the fold: opening it takes energy away
    opened = window(turn * 0.99, 0.4)
    assert energy(element, opened) < energy(element, motion)

    # the strain varies over the distance to the fold, (pi - turn) EDGE: steps far below it
    h = 1e-4 * (np.pi - abs(turn)) * EDGE
    flat = np.eye(6).reshape(6, 3, 2)
    differences = []
    for direction in flat:
        ahead, behind = (
            residual(
                element,
                eqx.tree_at(lambda m: m.position, motion, motion.position + sign * h * direction),
            )
            for sign in (1, -1)
        )
        differences.append((ahead - behind) / (2 * h))
    difference = np.stack(differences, axis=-1).reshape(3, 2, 3, 2)
    scale = np.abs(stiffness).max()
    np.testing.assert_allclose(stiffness, difference, rtol=0, atol=1e-6 * scale)


W = 0.7
"""A relative speed (m/s)."""


@pytest.mark.parametrize("edge_angle", [0.0, 0.9, -2.0])
@pytest.mark.parametrize("incidence", np.deg2rad([0.0, 90.0, -90.0, 180.0, 35.0, 250.0]))
@pytest.mark.parametrize("moving", [False, True])
def test_drag_of_a_straight_edge(edge_angle, incidence, moving):
    # per length 1/2 rho C_dn d |w_n| w_n + 1/2 rho C_dt pi d |w_t| w_t + c w on each end
    direction = edge_angle + incidence
    relative = W * np.array([np.cos(direction), np.sin(direction)])
    # only the relative velocity matters: the water moves, or the arm does, or both
    own = np.array([0.3, -1.1]) if moving else np.zeros(2)
    motion = window(angle=edge_angle, flow=relative + own, stencil=2)
    motion = eqx.tree_at(lambda m: m.velocity, motion, jnp.asarray(np.tile(own, (2, 1))))

    tangent = np.array([np.cos(edge_angle), np.sin(edge_angle)])
    normal = np.array([-np.sin(edge_angle), np.cos(edge_angle)])
    along, across = W * np.cos(incidence), W * np.sin(incidence)
    for end, (c_n, c_t, c) in enumerate(zip((2.0, 3.0), (0.3, 0.36), (0.4, 0.4), strict=True)):
        expected = (
            c_n * abs(across) * across * normal + c_t * abs(along) * along * tangent + c * relative
        )
        force = -np.asarray(residual(ALL["drag"], motion))[end]
        np.testing.assert_allclose(force, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("incidence", np.deg2rad([0.0, 90.0, 35.0]))
def test_drag_is_smooth_where_the_water_rests(incidence):
    direction = np.array([np.cos(incidence), np.sin(incidence)])

    def force(speed):
        motion = window(angle=0.0, flow=(0.0, 0.0), stencil=2)
        flow = jnp.tile(speed * jnp.asarray(direction), (2, 1))
        return drag().residual(eqx.tree_at(lambda m: m.flow_velocity, motion, flow))

    force_and_slope = jax.jit(lambda speed: jax.jvp(force, (speed,), (1.0,)))
    still, slope = force_and_slope(0.0)
    np.testing.assert_array_equal(still, 0)
    assert np.isfinite(slope).all()
    # quadratic drag has no slope at rest: what the rounding leaves is of its width, 1e-9 m/s
    np.testing.assert_allclose(slope, 0, atol=1e-8)

    along, across = np.cos(incidence), np.sin(incidence)
    for speed in (2e-6, 1e-4, 1.0):
        quadratic = -(speed**2) * np.array(
            [
                [0.3 * along * abs(along), 2.0 * across * abs(across)],
                [0.36 * along * abs(along), 3.0 * across * abs(across)],
            ]
        )
        got, _ = force_and_slope(speed)
        np.testing.assert_allclose(got, quadratic, rtol=1e-6, atol=1e-6 * speed**2 * 1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_drag_takes_energy_from_an_arm_in_still_water(seed):
    motion = random_motion(2, seed)
    still = eqx.tree_at(lambda m: m.flow_velocity, motion, jnp.zeros((2, 2)))
    assert power(ALL["drag"], still) < 0


@pytest.mark.parametrize("edge_angle", [0.0, 0.9])
def test_added_mass_of_a_straight_edge(edge_angle):
    # rho A [C_an (I - tt) + C_at tt] (Du/Dt - a) + rho A Du/Dt on each end
    rng = np.random.default_rng(7)
    flow, own = rng.normal(size=(2, 2, 2))
    motion = eqx.tree_at(
        lambda m: (m.flow_acceleration, m.acceleration),
        window(angle=edge_angle, stencil=2),
        (jnp.asarray(flow), jnp.asarray(own)),
    )
    t = np.array([np.cos(edge_angle), np.sin(edge_angle)])
    coefficient = 1.0 * (np.eye(2) - np.outer(t, t)) + 0.2 * np.outer(t, t)
    displaced = np.array([0.4, 0.5])[:, None]
    expected = displaced * ((flow - own) @ coefficient + flow)
    np.testing.assert_allclose(-residual(ALL["added_mass"], motion), expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 0.9, np.pi / 2])
def test_distributed_load_is_along_and_across_its_edge(angle):
    t, n = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    element = ALL["fixed_load"]
    expected = 1.3 * t - 0.6 * n + np.array([0.2, -0.4])
    force = -residual(element, window(angle=angle, stencil=2))
    np.testing.assert_allclose(force, np.stack([expected, expected]), rtol=0, atol=1e-14)


def test_moment_is_a_couple():
    motion = random_motion(3, 8)
    force = -np.asarray(residual(tip_load(moment=0.2), motion))
    np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-14)
    moment = moment_about_origin(np.asarray(motion.position), force)
    np.testing.assert_allclose(moment, 0.2, rtol=1e-12)


@pytest.mark.parametrize("turn", [0.0, 0.1, -0.2])
def test_follower_force_turns_with_the_tip(turn):
    force = -np.asarray(residual(tip_load(follower=(0.8, -0.5)), window(turn, 0.3)))
    np.testing.assert_array_equal(force[:2], 0)
    # of an arm of even curvature the tip has turned half a turn more than the middle of its last
    # edge; carried on linearly in the direction, this is so but for the cube of the turn
    angle = 0.3 + 1.5 * turn
    c, s = np.cos(angle), np.sin(angle)
    expected = np.array([[c, -s], [s, c]]) @ [0.8, -0.5]
    np.testing.assert_allclose(force[2], expected, rtol=0, atol=abs(turn) ** 3 + 1e-14)
    np.testing.assert_allclose(np.hypot(*force[2]), np.hypot(0.8, 0.5), rtol=1e-14)


def test_loads_come_on_with_their_onset():
    onset = always()
    for element in (ALL["distributed"], ALL["tip_load"]):
        later = eqx.tree_at(lambda e: e.onset.start, element, onset.start + 2.0)
        ramped = eqx.tree_at(lambda e: e.onset.ramp_time, element, onset.ramp_time + 2.0)
        # all at time 1: in full, not yet, and half way up
        motion = random_motion(element.stencil, 9)
        full = residual(element, motion)
        np.testing.assert_array_equal(residual(later, motion), 0)
        np.testing.assert_allclose(residual(ramped, motion), 0.5 * full, rtol=1e-14)
