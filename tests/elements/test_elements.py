"""Each element alone: its forces, energies and powers against what they are by definition."""

from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from crinoid.elements import (
    AddedMass,
    Bend,
    DistributedLoad,
    Drag,
    Inertia,
    Material,
    Motion,
    Stretch,
    TipLoad,
    Weight,
)
from crinoid.elements.node import bend_strain
from crinoid.elements.water import cylinder_added_mass, cylinder_drag
from crinoid.numerics.ramp import Onset
from crinoid.rod import Rod
from crinoid.rod.reference import along, mass_matrices, shared
from helpers.arms import always

EDGE = 0.1
"""Length of an edge at rest (m)."""
REST = 0.2
"""Strain of a bend without load."""


def one(*numbers):
    return tuple(jnp.asarray(number, float) for number in numbers)


def stretch(damping_time=0.0):
    return Stretch(1, *one(30.0, EDGE), Material(*one(damping_time)))


def bend(damping_time=0.0):
    return Bend(0, *one([0.7], [REST]), Material(*one(damping_time)))


def on_line(ends, s):
    """Return what runs linearly along an edge, from ``s`` = 0 to 1."""
    return (1 - s) * np.asarray(ends)[0] + s * np.asarray(ends)[1]


def frustum(s):
    """Return the mass per length of a round section whose radius runs linearly, 0.4 to 0.5 kg."""
    return on_line(np.sqrt([0.4, 0.5]), s) ** 2


def massive():
    """Mass matrix of a frustum of 0.4 kg per length at one end and 0.5 at the other."""
    return mass_matrices(jnp.array([[frustum(0.0), frustum(0.5), frustum(1.0)]]))[0]


def inertia():
    return Inertia(1, *one(massive(), []))


def drag(normal=2.0, tangential=0.3, linear=0.0):
    ends = one([normal, 1.5 * normal], [tangential, 1.2 * tangential], [linear, linear])
    return Drag(1, *map(along, ends))


def added_mass(normal=1.0, tangential=0.2):
    return AddedMass(1, *one(massive(), normal, tangential))


def distributed(tangential=1.3, normal=-0.6, fixed=(0.0, 0.0)):
    return DistributedLoad(1, *one(tangential, normal, fixed), always())


def tip_load(dead=(0.0, 0.0), follower=(0.0, 0.0), moment=0.0):
    return TipLoad(3, *one(dead, follower, [moment], [0.0]), always())


# every element of a kind has the same parameters throughout, so that each is compiled once
ALL = {
    "stretch": stretch(0.05), "bend": bend(0.05), "inertia": inertia(), "drag": drag(linear=0.4),
    "added_mass": added_mass(), "distributed": distributed(),
    "tip_load": tip_load(follower=(0.8, -0.5), moment=0.2), "weight": Weight(1, jnp.asarray(0.25)),
    "fixed_load": distributed(fixed=(0.2, -0.4)), "dead_load": tip_load(dead=(0.3, 0.9)),
}  # fmt: skip

residual = eqx.filter_jit(lambda element, motion: element.residual(motion))
energy = eqx.filter_jit(lambda element, motion: element.energy(motion))


@eqx.filter_jit
def power(element, motion):
    """Return the power that is not stored."""
    force = element.working(motion)
    return jnp.zeros(()) if force is None else jnp.sum(force * motion.velocity)


@eqx.filter_jit
def energy_slope(element, motion):
    def stored(position):
        return element.energy(replace(motion, position=position))

    return jax.grad(stored)(motion.position)


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
    moving = still if velocity is None else np.asarray(velocity) + still
    return Motion(*map(jnp.asarray, (position, moving, still, still + flow, still, 1.0)))


def over_edge(integrand):
    return quad(integrand, 0.0, 1.0, epsabs=1e-14, epsrel=1e-13)[0]


def falls_to_ends(integrand):
    """Integrate over the edge, times the share of each end."""
    shares = (lambda s: 1 - s, lambda s: s)
    return np.array([over_edge(lambda s, of=of: of(s) * integrand(s)) for of in shares])


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


@pytest.mark.parametrize("name", ALL)
def test_power_of_a_force_is_either_stored_or_counted(name):
    element = ALL[name]
    motion = random_motion(element.stencil, 2)
    if name == "inertia":
        # d/dt of 1/2 m v^2 along the edge is m v . a
        storing = over_edge(
            lambda s: frustum(s) * on_line(motion.velocity, s) @ on_line(motion.acceleration, s)
        )
    else:
        storing = np.sum(energy_slope(element, motion) * motion.velocity)
    fed = -np.sum(residual(element, motion) * motion.velocity)
    np.testing.assert_allclose(storing - power(element, motion), -fed, rtol=1e-11, atol=1e-13)


def test_stretch_is_linear_in_the_length():
    # E_s = 1/2 EA l (1 - |e|/l)^2, force EA (|e|/l - 1)
    position = jnp.asarray([[0.0, 0.0], [0.0, 1.05 * EDGE]])
    motion = replace(window(stencil=2), position=position)
    expected = 30.0 * 0.05 * np.array([[0, -1], [0, 1]])
    np.testing.assert_allclose(residual(stretch(), motion), expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(energy(stretch(), motion), 0.5 * 30 * EDGE * 0.05**2, rtol=1e-12)


def strain(turn):
    tangent = np.tan(turn / 2)
    return float(bend_strain(jnp.asarray(tangent), jnp.asarray(np.hypot(1.0, tangent))))


def test_strain_of_a_bend_is_its_turn_but_for_the_fifth_power():
    # 2 tan(a / 2) = a + a^3 / 12 + a^5 / 120 + ... and 4 sin(a / 2) = 2 a - a^3 / 12 + a^5 / 960
    for turn in (0.1, -0.2, 0.4):
        assert (strain(turn) - turn) / turn**5 == pytest.approx(1 / 320, rel=0.2 * turn**2)
    # and it grows without bound toward a fold
    assert strain(np.pi - 1e-6) > 1e6


def test_what_is_spread_along_an_edge_loads_its_ends_by_its_integral():
    # a linear property times something linear, times the share of an end
    for f, g in np.random.default_rng(6).normal(size=(5, 2, 2)):
        got = shared(along(jnp.asarray(f)) * along(jnp.asarray(g)))
        expected = falls_to_ends(lambda s, f=f, g=g: on_line(f, s) * on_line(g, s))
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-14)


def test_an_edge_that_moves_rigidly_has_the_kinetic_energy_of_a_tapered_rod():
    # 1/2 m v_c^2 + 1/2 J w^2, with J about the centre of mass by Steiner
    drift, spin = np.array([0.4, -0.7]), 3.0
    motion = window(angle=0.5, stencil=2)
    x, z = np.asarray(motion.position).T
    motion = replace(motion, velocity=jnp.asarray(drift + spin * np.stack([-z, x], axis=1)))
    moments = (over_edge(lambda s, n=n: frustum(s) * (EDGE * s) ** n) for n in (0, 1, 2))
    whole, first, second = moments
    centre = first / whole
    of_centre = drift + spin * centre * np.array([-np.sin(0.5), np.cos(0.5)])
    kinetic = 0.5 * whole * of_centre @ of_centre + 0.5 * (second - whole * centre**2) * spin**2
    np.testing.assert_allclose(energy(inertia(), motion), kinetic, rtol=1e-13)


@pytest.mark.parametrize("nodes", [3, 4, 11])
def test_a_taper_has_the_mass_the_stretch_and_the_twist_of_a_cone(nodes):
    length, root, tip, density, water = 0.6, 0.03, 0.01, 1300.0, 1000.0
    rod = Rod.round(
        length=length, nodes=nodes, radius=(root, tip), density=density, youngs_modulus=2e5, axes=3
    )
    close = partial(np.testing.assert_allclose, rtol=1e-12)
    volume = np.pi * length * (root**2 + root * tip + tip**2) / 3
    weight = Weight.of(rod, density=water, gravity=9.81).force
    close(weight.sum(), (density - water) * volume * 9.81)
    lever = over_edge(lambda s: np.pi * on_line([root, tip], s) ** 2 * s) * length / volume
    close(weight @ rod.arc_length / weight.sum(), length * lever)
    close(Inertia.of(rod).mass.sum(), density * volume)
    added = AddedMass.of(rod, density=water, normal=1.0, tangential=0.0)
    close(added.displaced.sum(), water * volume)
    # the stretch by a pull at the tip, and the twist by a torque there up to the last edge's middle
    close(np.sum(rod.rest_length / Stretch.of(rod).EA), length / (2e5 * np.pi * root * tip))
    until = 1 - 0.5 / (nodes - 1)
    twist = quad(lambda s: length / (np.pi / 2 * on_line([root, tip], s) ** 4), 0, until)[0]
    close(np.sum((rod.voronoi_length / rod.GJ)[:-1]), twist / (2e5 / 3), rtol=1e-9)
    spin = over_edge(lambda s: np.pi / 2 * on_line([root, tip], s) ** 4) * density * length
    close(rod.spin_inertia.sum(), spin, rtol=0.1 / (nodes - 1) ** 4)  # by Simpson's rule


@pytest.mark.parametrize("nodes", [3, 11])
@pytest.mark.parametrize("ends", [(3.0, 0.5), (2.0, 2.0), (1.0, 1.0001), (1e-2, 4.0)])
def test_given_stiffness_that_tapers_stretches_and_twists_by_its_compliance(nodes, ends):
    # the integral of ds / (a + (b - a) s) is ln(b / a) / (b - a)
    rod = Rod.round(
        length=0.6,
        nodes=nodes,
        radius=0.02,
        density=1e3,
        youngs_modulus=2e5,
        axes=3,
        EA=jnp.asarray(ends),
        GJ=jnp.asarray(ends),
        EI=jnp.asarray([[1.0, 2.0], ends]),
    )
    a, b = ends
    compliance = 0.6 / a if a == b else 0.6 * np.log(b / a) / (b - a)
    np.testing.assert_allclose(np.sum(rod.rest_length / rod.EA), compliance, rtol=1e-9)
    np.testing.assert_allclose(np.sum(rod.voronoi_length / rod.GJ), compliance, rtol=1e-9)
    share = np.linspace(0, 1, nodes)[:, None]
    np.testing.assert_allclose(rod.EI, (1 - share) * [1.0, 2.0] + share * ends, rtol=1e-12)


def test_the_drag_of_a_cylinder_is_that_of_the_literature():
    # Dennis and Chang, J. Fluid Mech. 42 (1970); and the formula of White, Viscous Fluid Flow
    steady = {5.0: 4.116, 10.0: 2.846, 20.0: 2.045, 40.0: 1.522}
    np.testing.assert_allclose(
        cylinder_drag(np.array(list(steady))), list(steady.values()), rtol=0.15
    )
    reynolds = np.geomspace(1.0, 2e5, 101)
    np.testing.assert_allclose(cylinder_drag(reynolds), 1 + 10 * reynolds ** (-2 / 3), rtol=0.2)
    assert cylinder_drag(np.array([1e5]))[0] == pytest.approx(1.2, abs=0.05)
    swings = [0.0, 3.0, 8.0, 50.0]
    found = [cylinder_added_mass(swing) for swing in swings]
    assert found == pytest.approx([1.0, 1.0, 0.78, 0.6])


def test_drag_of_the_literature_has_the_coefficient_of_its_reynolds_number():
    rod = Rod.round(length=0.6, nodes=4, radius=(0.02, 0.01), density=1e3, youngs_modulus=2e5)
    numbers = {"density": 1000.0, "tangential": 0.02, "linear": 0.5}
    known = Drag.of(rod, normal=1.0, viscosity=1.2e-6, **numbers)
    one, none = (Drag.of(rod, normal=normal, **numbers) for normal in (1.0, 0.0))
    speed = 3e-3
    at_rest = window(angle=0.0, stencil=2)
    flow = jnp.asarray([[0.0, speed], [0.0, speed]])
    motion = replace(at_rest, flow_velocity=flow, velocity=jnp.zeros((2, 2)))
    reynolds = np.asarray(rod.edge_diameter[1]) * speed / 1.2e-6
    assert 50 < reynolds.min() < reynolds.max() < 100

    def force(element):
        return jax.tree.map(lambda leaf: leaf[1], element).residual(motion)

    factor = np.asarray(cylinder_drag(reynolds))
    spread = -shared(jnp.asarray(one.normal[1] * factor * speed**2))
    np.testing.assert_allclose((force(known) - force(none))[:, 1], spread, rtol=1e-9)
    assert (np.abs(spread) > 1.4 * np.abs((force(one) - force(none))[:, 1])).all()
    # and has a slope where the water rests
    edge = jax.tree.map(lambda leaf: leaf[1], known)
    slope = jax.jacfwd(lambda flow: edge.residual(replace(motion, flow_velocity=flow)))
    assert np.isfinite(slope(jnp.zeros((2, 2)))).all()


W = 0.7
"""A relative speed (m/s)."""
THIRDS = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0
"""Share that each end of an edge bears of a load that runs linearly along it."""


@pytest.mark.parametrize("edge_angle", [0.0, 0.9, -2.0])
@pytest.mark.parametrize("incidence", np.deg2rad([0.0, 90.0, -90.0, 180.0, 35.0, 250.0]))
@pytest.mark.parametrize("moving", [False, True])
def test_drag_of_a_straight_edge(edge_angle, incidence, moving):
    # per length 1/2 rho C_dn d |w_n| w_n + 1/2 rho C_dt pi d |w_t| w_t + c w. Of what falls
    # linearly from end to end each end bears a third, and a sixth of that at the other end
    direction = edge_angle + incidence
    relative = W * np.array([np.cos(direction), np.sin(direction)])
    # only the relative velocity matters: the water moves, or the arm does, or both
    own = np.array([0.3, -1.1]) if moving else np.zeros(2)
    motion = window(angle=edge_angle, velocity=own, flow=relative + own, stencil=2)

    tangent = np.array([np.cos(edge_angle), np.sin(edge_angle)])
    normal = np.array([-np.sin(edge_angle), np.cos(edge_angle)])
    forward, across = W * np.cos(incidence), W * np.sin(incidence)
    per_length = (
        np.outer([2.0, 3.0], abs(across) * across * normal)
        + np.outer([0.3, 0.36], abs(forward) * forward * tangent)
        + np.outer([0.4, 0.4], relative)
    )
    force = -residual(ALL["drag"], motion)
    np.testing.assert_allclose(force, THIRDS @ per_length, rtol=0, atol=1e-14)


def test_drag_of_an_edge_that_turns_about_its_end():
    # the share of an end of c (w s)^2: a cubic, which Simpson's rule integrates exactly
    velocity = np.array([[0.0, 0.0], [0.0, W]])
    even = Drag(1, *map(along, one([2.5, 2.5], [0.3, 0.36], [0.0, 0.0])))
    against = residual(even, window(velocity=velocity, stencil=2))
    expected = falls_to_ends(lambda s: 2.5 * (W * s) ** 2)
    np.testing.assert_allclose(against[:, 1], expected, rtol=1e-12)


@pytest.mark.parametrize("incidence", np.deg2rad([0.0, 90.0, 35.0]))
def test_drag_is_smooth_where_the_water_rests(incidence):
    direction = np.array([np.cos(incidence), np.sin(incidence)])

    def force(speed):
        flow = jnp.tile(speed * jnp.asarray(direction), (2, 1))
        return drag().residual(replace(window(stencil=2), flow_velocity=flow))

    force_and_slope = jax.jit(lambda speed: jax.jvp(force, (speed,), (1.0,)))
    still, slope = force_and_slope(0.0)
    np.testing.assert_array_equal(still, 0)
    assert np.isfinite(slope).all()
    # quadratic drag has no slope at rest: what the rounding leaves is of its width, 1e-9 m/s
    np.testing.assert_allclose(slope, 0, atol=1e-8)

    forward, across = np.cos(incidence), np.sin(incidence)
    per_length = np.outer([0.3, 0.36], [forward * abs(forward), 0.0])
    per_length += np.outer([2.0, 3.0], [0.0, across * abs(across)])
    for speed in (2e-6, 1e-4, 1.0):
        quadratic = -(speed**2) * THIRDS @ per_length
        got, _ = force_and_slope(speed)
        np.testing.assert_allclose(got, quadratic, rtol=1e-6, atol=1e-6 * speed**2 * 1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_drag_takes_energy_from_an_arm_in_still_water(seed):
    motion = random_motion(2, seed)
    assert power(ALL["drag"], replace(motion, flow_velocity=jnp.zeros((2, 2)))) < 0


@pytest.mark.parametrize("edge_angle", [0.0, 0.9])
def test_added_mass_of_a_straight_edge(edge_angle):
    # rho A [C_an (I - tt) + C_at tt] (Du/Dt - a) + rho A Du/Dt per length
    rng = np.random.default_rng(7)
    flow, own = rng.normal(size=(2, 2, 2))
    motion = window(angle=edge_angle, stencil=2)
    motion = replace(motion, flow_acceleration=jnp.asarray(flow), acceleration=jnp.asarray(own))
    t = np.array([np.cos(edge_angle), np.sin(edge_angle)])
    coefficient = 1.0 * (np.eye(2) - np.outer(t, t)) + 0.2 * np.outer(t, t)
    per_mass = (flow - own) @ coefficient + flow
    force = -residual(ALL["added_mass"], motion)
    for got, ends in zip(force.T, per_mass.T, strict=True):
        expected = falls_to_ends(lambda s, ends=ends: frustum(s) * on_line(ends, s))
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-14)


def test_loads_come_on_with_their_onset():
    for element in (ALL["distributed"], ALL["tip_load"]):
        later, ramped = (replace(element, onset=Onset.of(*times)) for times in ((2.0,), (0.0, 2.0)))
        # all at time 1: in full, not yet, and half way up
        motion = random_motion(element.stencil, 9)
        full = residual(element, motion)
        np.testing.assert_array_equal(residual(later, motion), 0)
        np.testing.assert_allclose(residual(ramped, motion), 0.5 * full, rtol=1e-14)


@pytest.mark.parametrize("curvature", [0.0, 1e-13, 1e-8, 1e-3, 0.8, 30.0])
def test_the_chord_of_an_arc_and_its_derivatives(curvature):
    # 2 sin(kappa l / 2) / kappa: both derivatives at a straight arm too
    def chord(curvature):
        rod = Rod.round(
            length=0.4,
            nodes=5,
            radius=0.01,
            density=1.0,
            youngs_modulus=1.0,
            rest_curvature=curvature,
        )
        return rod.chord_length[0]

    edge, angle = 0.1, 0.1 * curvature
    half = angle / 2
    if angle < 1e-2:
        exact = edge * (1 - half**2 / 6), -(edge**2) * angle / 12, -(edge**3) / 12
    else:
        slope = edge**2 * (angle * np.cos(half) - 2 * np.sin(half)) / angle**2
        bend = edge**3 * (
            4 * np.sin(half) / angle**3 - 2 * np.cos(half) / angle**2 - np.sin(half) / (2 * angle)
        )
        exact = edge * np.sin(half) / half, slope, bend
    given = jnp.asarray(curvature)
    found = chord(given), jax.grad(chord)(given), jax.grad(jax.grad(chord))(given)
    np.testing.assert_allclose(found[:2], exact[:2], rtol=1e-6, atol=1e-25)
    np.testing.assert_allclose(found[2], exact[2], rtol=1e-4)
