"""The arm in time: frequencies, damping, orders of convergence, energy, base motion, recovery.

In the plane, and where the same holds in space there too; what is so in space only is in
`test_space_dynamics.py`.
"""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.special import ellipk

from crinoid.dynamics import Integrator, resting
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.start import expected_acceleration
from crinoid.elements import ENERGIES, WORKS
from helpers.arms import QUICKLY, acting, order
from helpers.beams import NATURAL
from helpers.motion import (
    advance,
    at,
    carried,
    dry,
    everything,
    march,
    rest,
    ring_down,
    run,
    submerged,
    vector,
    vibrations,
    watch,
    whole_step,
    wrench,
)

pytestmark = pytest.mark.usefixtures("optimised")

NEWMARK, ALPHA, EULER = (
    Integrator.newmark(),
    Integrator.generalized_alpha(0.8),
    Integrator.implicit_euler(),
)
in_both_dimensions = pytest.mark.parametrize("axes", [2, 3])
second_order = pytest.mark.parametrize("integrator", [NEWMARK, ALPHA], ids=["newmark", "alpha-0.8"])


@eqx.filter_jit(compiler_options=QUICKLY)
def equilibrium(system):
    state, outcome = system.find_equilibrium()
    return eqx.error_if(state, ~outcome.converged, "no equilibrium")


@eqx.filter_jit(compiler_options=QUICKLY)
def imbalance(system, state):
    """Return the residual of all nodes in a state and the largest single force in it."""
    none, motion = jnp.zeros(()), state.motion
    rows = motion.position, motion.velocity, motion.acceleration
    stage = StepMap(state.time, *rows, none, none, none, state.frames)
    zero = jnp.zeros_like(motion.position)
    forces = acting(system)
    current = forces.surroundings(stage, zero)
    return forces.residual(forces.motion(stage, zero, current))


# --- vibration ---------------------------------------------------------------------------------

FRICTIONLESS = {"drag_normal": 0.0, "drag_tangential": 0.0, "tolerance": 1e-12}


@pytest.mark.slow
@pytest.mark.parametrize("mode", [0, 1])
@pytest.mark.parametrize(
    ("axes", "column"),
    [(2, 1), *(pytest.param(3, column, marks=pytest.mark.release) for column in (1, 2))],
)
def test_a_simulated_mode_rings_at_its_frequency_and_damping(axes, column, mode):
    damping_time, EI = 0.01, 1.0 if axes == 2 else (1.0, 1.7)
    system = submerged(axes, damping_time=damping_time, EI=EI, **FRICTIONLESS)
    frequency, pole = ring_down(system, column, mode)
    exact = NATURAL[mode] * np.sqrt(np.atleast_1d(EI)[column - 1])
    within = {2: (1e-5, 2e-4), 3: (3e-5, 1e-3)}[axes][mode]  # of 11 and of 9 nodes
    assert frequency == pytest.approx(exact, rel=within)
    assert abs(pole) == pytest.approx(frequency, rel=1e-7)
    assert -pole.real / abs(pole) == pytest.approx(damping_time * frequency / 2, rel=1e-6)


@pytest.mark.slow
def test_an_arm_under_water_rings_at_its_lower_frequency():
    # m = 1 kg/m, rho A = 0.6 kg/m, Ca = 1.5
    wet = submerged(2, displaced_area=6e-4, added_mass_normal=1.5, **FRICTIONLESS)
    _, pole = ring_down(wet, 1, 0)
    in_vacuum = vibrations(submerged(2), 1)[0][0]
    assert abs(pole) == pytest.approx(np.sqrt(1.0 / (1.0 + 1.5 * 0.6)) * in_vacuum, rel=1e-5)
    assert pole.real == pytest.approx(0.0, abs=1e-5)


@pytest.mark.slow
def test_a_stiff_arm_on_a_pin_swings_as_a_physical_pendulum():
    # released horizontally: a quarter of a swing takes K(k^2 = 1/2) / omega, with
    # omega^2 = m g (L / 2) / J and J = m L^2 / 3, which linear elements have exactly
    system = dry(2, EI=1e5, EA=1e7, pinned=True, gravity=9.81, tolerance=1e-12)
    states = run(system, rest(system), until=0.5, steps=500)
    tip = CubicHermiteSpline(
        states.time, states.position[:, -1, 0], states.velocity[:, -1, 0], extrapolate=False
    )
    quarter = ellipk(0.5) / np.sqrt(9.81 * 0.5 / (1.0 / 3.0))
    assert tip.roots()[0] == pytest.approx(quarter, rel=1e-5)


# --- motion in water ---------------------------------------------------------------------------


def assert_rigid(system, *, scale=1.0):
    """Run an arm for half a second that must feel no force, and so keep its shape."""
    start = rest(system)
    states = run(system, start, until=0.5, steps=50)
    for load in wrench(states):
        np.testing.assert_allclose(load, 0, atol=1e-8 * scale)
    shape = states.position - states.position[:, 1:2]
    np.testing.assert_allclose(shape, np.broadcast_to(start.position, shape.shape), atol=1e-9)
    return states


@pytest.mark.slow
@in_both_dimensions
@pytest.mark.parametrize(
    ("tilt", "added"), [(0.0, 1.3), (np.pi / 2, 0.2)], ids=["broadside", "along"]
)
def test_a_submerged_body_rises_with_its_buoyant_acceleration(axes, tilt, added):
    # (rho V - m) g / (m + Ca rho V): a base that rises just so carries nothing
    mass, displaced, gravity = 0.4, 1.0, 9.81
    rising = (displaced - mass) * gravity / (mass + added * displaced)
    system = carried(
        axes,
        acceleration=vector(axes, 0.0, rising),
        pan=0.7,
        tilt=tilt,
        roll=0.4,
        mass_per_length=mass,
        displaced_area=1e-3,
        added_mass_normal=1.3,
        added_mass_tangential=0.2,
        drag_normal=0.0,
        drag_tangential=0.0,
        gravity=gravity,
        EI=0.01,
    )
    np.testing.assert_allclose(rest(system).acceleration[1:, -1], rising, rtol=1e-10)
    assert_rigid(system)


def cylinder(axes, share, **changes):
    """Build a cylinder across the water that sinks at a share of its terminal speed.

    Also return its weight in water and its terminal speed.
    """
    diameter, heavier, drag, gravity = 0.01, 1.2, 1.1, 9.81
    area = np.pi / 4 * diameter**2
    terminal = np.sqrt(np.pi * diameter * gravity * (heavier - 1.0) / (2.0 * drag))
    assert terminal == pytest.approx(0.16738, abs=5e-6)
    system = carried(
        axes,
        speed=vector(axes, 0.0, -share * terminal),
        pan=0.7,
        roll=0.4,
        diameter=diameter,
        mass_per_length=heavier * 1000.0 * area,
        displaced_area=area,
        drag_normal=drag,
        gravity=gravity,
        **changes,
    )
    return system, (heavier - 1.0) * 1000.0 * area * gravity, terminal


@pytest.mark.slow
def test_broadside_cylinder_sinks_at_its_terminal_speed():
    # in the plane: the validation case falling-cylinder
    system, weight, terminal = cylinder(3, 1.0)
    np.testing.assert_allclose(rest(system).acceleration, 0, atol=1e-8)  # of 9.81
    states = assert_rigid(system, scale=weight)
    assert states.position[-1, -1, -1] == pytest.approx(-0.5 * terminal, abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.5, -1.0])
def test_drag_on_a_cylinder_grows_with_the_square_of_the_speed(share):
    _, weight, terminal = cylinder(2, 0.0)
    standing, *_ = cylinder(2, 0.0, current=(0.0, share * terminal), EI=1e4)
    carries = -weight * (1.0 - share * abs(share))
    assert float(equilibrium(standing).base_force[1]) == pytest.approx(carries, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("axes", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_an_arm_carried_through_still_water_is_an_arm_in_a_current(axes):
    speed = vector(axes, 0.4, -0.25, y=0.3)
    properties = {
        "gravity": 9.81,
        "mass_per_length": 0.9,
        "displaced_area": 8e-4,
        "diameter": 0.03,
        "damping_time": 0.02,
        "pan": 0.7,
        "tilt": 0.3,
        "roll": 0.4,
        "tolerance": 1e-13,
    } | (
        {"EI": 0.05}
        if axes == 2
        else {"EI": (0.05, 0.08), "GJ": 0.04, "radius": 0.1, "rest_curvature": (0.5, 0.0, 1.0)}
    )
    systems = [
        carried(axes, **case, **properties) for case in ({"speed": speed}, {"current": -speed})
    ]
    moved, stood = (march(each, rest(each), until=1.0, steps=100) for each in systems)
    np.testing.assert_allclose(moved.position[1], speed, rtol=0, atol=1e-12)
    assert np.abs(stood.position - rest(systems[1]).position).max() > 0.05
    shift, drift = moved.position[1], moved.velocity[1]
    within = {2: 1e-11, 3: 1e-10}[axes]
    np.testing.assert_allclose(moved.position - shift, stood.position, rtol=0, atol=within)
    np.testing.assert_allclose(moved.velocity - drift, stood.velocity, rtol=0, atol=1e-8)
    np.testing.assert_allclose(moved.base_force, stood.base_force, rtol=0, atol=1e-7)
    if axes == 3:
        twists = (each.motion.orientation.twist for each in (moved, stood))
        np.testing.assert_allclose(*twists, rtol=0, atol=1e-9)


# --- what the base feels -----------------------------------------------------------------------


def test_steady_acceleration_is_a_weight():
    # d'Alembert: the shape that hangs in gravity rides along on a base that accelerates upward
    # (an arm of no displacement, so that the water has no weight; the force is m a)
    hanging = equilibrium(submerged(2, gravity=6.0, damping_time=0.1))
    system = carried(2, acceleration=(0.0, 6.0), damping_time=0.1)
    forces, time, _, _ = resting.undeformed(system, jnp.zeros(()))
    state = eqx.filter_jit(resting.state_at_rest)(system, forces, time, hanging.position, None)
    np.testing.assert_allclose(state.acceleration[:, 1], 6.0, rtol=0, atol=1e-6)
    np.testing.assert_allclose(state.base_force, [0.0, -6.0], rtol=0, atol=1e-7)  # m = 1 kg
    assert float(state.base_moment) == pytest.approx(float(hanging.base_moment), abs=1e-7)


# --- order in the time step --------------------------------------------------------------------

SWINGS = {
    2: {"EA": 1e3, "gravity": 10.0},
    # crooked, soft and far from round
    3: {
        "EI": (0.6, 1.4), "GJ": 0.5, "radius": 0.2, "rest_curvature": (1.5, -1.0, 3.0),
        "gravity": 10.0, "tilt": 0.4, "pan": 0.3, "roll": 0.5,
    },
}  # fmt: skip
SMOOTH = {"damping_time": 0.02, "tolerance": 1e-12}


def swing(axes, integrator, steps):
    """Return a heavy, damped arm 0.8 s after it was let go, and its places and directors."""
    system = dry(axes, **SWINGS[axes], **SMOOTH, integrator=integrator)
    last = march(system, rest(system), until=0.8, steps=steps)
    parts = [last.position] + ([] if axes == 2 else [last.motion.orientation.director[1:]])
    return last, np.concatenate([np.ravel(part) for part in parts])


@cache
def fine_swing(axes):
    return swing(axes, NEWMARK, {2: 12800, 3: 6400}[axes])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axes", "integrator", "expected", "within"),
    [
        (2, ALPHA, 2.0, 0.02),
        (2, Integrator.generalized_alpha(0.2), 2.0, 0.1),
        (2, EULER, 1.0, 0.05),
        pytest.param(3, NEWMARK, 2.0, 0.05, marks=pytest.mark.release),
        pytest.param(3, ALPHA, 2.0, 0.05, marks=pytest.mark.release),
        pytest.param(3, EULER, 1.0, 0.05, marks=pytest.mark.release),
    ],
    ids=[
        *("alpha-0.8-2", "alpha-0.2-2", "implicit-euler-2"),
        *("newmark-3", "alpha-0.8-3", "implicit-euler-3"),
    ],
)
def test_order_in_the_time_step_on_a_large_swing(axes, integrator, expected, within):
    # all against one reference, so all converge to the same motion; w L^3 / EI = 10
    last, exact = fine_swing(axes)
    assert last.position[-1, -1] < {2: -0.8, 3: -0.4}[axes]
    if axes == 3:
        assert np.abs(np.diff(last.motion.orientation.twist)).max() > 0.1
    errors = [np.abs(swing(axes, integrator, n)[1] - exact).max() for n in (200, 400, 800)]
    print(errors, order(errors))
    assert order(errors) == pytest.approx(expected, abs=within)
    assert axes == 3 or errors[-1] < (1e-2 if expected == 1.0 else 1e-4)


@pytest.mark.release
@second_order
def test_a_load_that_jumps_where_steps_meet_keeps_the_order(integrator):
    def shape(integrator, steps):
        jump = {"dead": (0.0, -3.0), "onset": (0.2, 0.0, 0.5)}
        system = dry(2, EA=1e3, integrator=integrator, **SMOOTH, **jump)
        return march(system, rest(system), until=0.8, steps=steps).position

    fine = shape(NEWMARK, 12800)
    errors = [np.abs(shape(integrator, steps) - fine).max() for steps in (200, 400, 800)]
    assert order(errors) == pytest.approx(2.0, abs=0.1)
    assert errors[-1] < 1e-4


@pytest.mark.release
@pytest.mark.parametrize(
    ("integrator", "expected", "within"),
    [
        (NEWMARK, 3.0, 0.01),
        (Integrator.newmark(0.3025, 0.6), 3.0, 0.05),
        (ALPHA, 3.0, 0.2),
        (Integrator.generalized_alpha(0.2), 3.0, 0.05),
        (EULER, 2.0, 0.01),
    ],
    ids=["newmark", "newmark-0.6", "alpha-0.8", "alpha-0.2", "implicit-euler"],
)
def test_estimated_error_of_a_step_is_its_local_error(integrator, expected, within):
    system, exact = (
        dry(2, **SWINGS[2], **SMOOTH, integrator=each) for each in (integrator, NEWMARK)
    )
    estimates, errors = [], []
    for steps in (400, 800, 1600):
        step = 0.8 / steps
        state = march(system, rest(system), until=0.4, steps=steps // 2)
        after, progress = advance(system, state, step)
        true = march(exact, state, until=float(state.time) + step, steps=100)
        estimates.append(float(progress.error))
        errors.append(np.linalg.norm(after.position - true.position, axis=1).max())
    assert order(estimates) == pytest.approx(expected, abs=0.05)
    # what it leaves out is of the next order
    missed = np.abs(1 - np.asarray(estimates) / errors)
    assert missed[-1] < within
    assert missed[2] < 0.75 * missed[1] < 0.75**2 * missed[0]


# --- energy ------------------------------------------------------------------------------------


@eqx.filter_jit
def _kept(system, states, step):
    """Return what the trapezoid rule keeps: ``E + h^2 / 12 (a . M a + v . K v)``."""

    def of_one(state):
        motion = state.motion

        def kinetic(velocity):
            moving = eqx.tree_at(lambda m: m.velocity, motion, velocity)
            return acting(system).arm.energy(moving)[ENERGIES.index("kinetic")]

        def slope(position):
            placed = eqx.tree_at(lambda m: m.position, motion, position)
            return jax.grad(lambda m: jnp.sum(acting(system).arm.energy(m)))(placed).position

        _, restoring = jax.jvp(slope, (motion.position,), (motion.velocity,))
        curved = 2.0 * kinetic(motion.acceleration) + jnp.sum(restoring * motion.velocity)
        return jnp.sum(state.energy) + step**2 / 12.0 * curved

    return jax.vmap(of_one)(states)


def energies(step, steps):
    """Return the energy of an arm let go horizontally, and what the rule keeps of it.

    Both over the largest kinetic energy.
    """
    system = dry(2, gravity=10.0, tolerance=1e-12)
    state, parts = rest(system), []
    for done in range(0, steps, 500):
        states = run(system, state, until=(done + 500) * step, steps=500)
        parts.append((states.energy, _kept(system, states, jnp.asarray(step))))
        state = at(states, -1)
    energy, kept = map(np.concatenate, zip(*parts, strict=True))
    kinetic = energy[:, ENERGIES.index("kinetic")].max()
    assert kinetic > 1.8
    return np.stack([energy.sum(axis=1), kept]) / kinetic


@pytest.mark.release
def test_energy_of_an_undamped_swing_stays_in_a_band():
    # 100 s, about 80 swings; the energy is that of the start, zero. (A step of 0.01 s is too long
    # for the vibrations of this mesh: within 100 s the energy begins to wander)
    total, kept = energies(0.0057, steps=17_500)
    assert np.abs(total).max() < 6e-4
    first, last = total[:1000], total[-1000:]
    assert np.ptp(last) < 1.1 * np.ptp(first)
    assert last.mean() == pytest.approx(first.mean(), abs=0.05 * np.ptp(first))
    assert np.ptp(kept) < 5e-6


@pytest.mark.release
def test_the_trapezoid_rule_keeps_an_energy_of_its_own():
    # it is conjugate to the midpoint rule, which is symplectic: what it keeps, but for a part of
    # order 4, is E + h^2 / 12 (a . M a + v . K v) (Hairer, Lubich and Wanner 2006, Geometric
    # Numerical Integration, sections VI.8 and IX.3). Nothing is won or lost; E itself moves in a
    # band of order 2, and sinks where faster vibrations are stirred up
    bands = [np.ptp(energies(10.0 / n, steps=n), axis=1) for n in (2000, 4000)]
    of_total, of_kept = np.transpose(bands)
    assert order(of_total) == pytest.approx(2.0, abs=0.15)
    assert order(of_kept) == pytest.approx(4.0, abs=0.2)
    assert of_kept[-1] < 1e-7


def defect(since, end):
    """Return by how much stored energy and works differ between two states."""
    return float(jnp.sum(end.energy - since.energy) - jnp.sum(end.work - since.work))


@pytest.mark.parametrize("axes", [2, pytest.param(3, marks=pytest.mark.slow)])
@second_order
def test_energy_audit_closes_at_order_two(axes, integrator):
    system = everything(axes, integrator=integrator)
    start = rest(system)
    ends = [march(system, start, until=1.0, steps=steps) for steps in (200, 400, 800)]
    defects = np.abs([defect(start, end) for end in ends])
    work = np.asarray(ends[-1].work)
    worked = np.delete(work, [WORKS.index("contact"), WORKS.index("tool")])
    print(defects, order(defects), worked)
    assert np.abs(worked).min() > 0.01  # J: drag, damping, base, loads, added mass all work
    assert order(defects) == pytest.approx(2.0, abs={2: 0.05, 3: 0.1}[axes])
    assert defects[-1] < {2: 1e-4, 3: 2e-4}[axes] * np.abs(work).sum()


@pytest.mark.release
def test_each_work_converges_at_order_two_in_generalized_alpha():
    # the sum may hide an error of two works against each other
    def work(integrator, steps):
        system = everything(2, integrator=integrator)
        return np.asarray(march(system, rest(system), until=1.0, steps=steps).work)

    exact = work(NEWMARK, 6400)
    errors = [np.abs(work(ALPHA, steps) - exact) for steps in (200, 400, 800)]
    for name, error in zip(WORKS, np.transpose(errors), strict=True):
        if name in ("contact", "tool"):
            assert not np.any(error)  # there is nothing to touch or to carry
            continue
        assert order(error) == pytest.approx(2.0, abs=0.2), name


@pytest.mark.parametrize("axes", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_energy_audit_closes_when_servos_move_the_base(axes):
    command = [0.02, -0.03, 0.1] if axes == 2 else [0.02, 0.04, -0.03, 0.2, 0.1, 0.5]
    shape = {} if axes == 2 else {"radius": 0.2, "rest_curvature": (0.4, 0.3, 1.0)}
    system = dry(axes, EA=1e3, gravity=9.81, damping_time=0.05, tolerance=1e-12, **shape)
    start, whole, later = rest(system), [], []
    for steps in (200, 400, 800):
        states = run(system, start, until=1.0, steps=steps, command=command)
        end = at(states, -1)
        whole.append(defect(start, end))
        later.append(defect(at(states, steps // 10 - 1), end))
    actuation = float(end.work[WORKS.index("actuation")])
    assert actuation > 0.0
    # the jerk at the first step, where the command jumps, leaves an error that falls faster still
    print(order(np.abs(later)), order(np.abs(whole)), whole[-1] / actuation)
    np.testing.assert_allclose(order(np.abs(later)), 2.0, atol=0.05)
    assert (order(np.abs(whole)) > 1.9).all()
    assert abs(whole[-1]) < {2: 1e-2, 3: 1e-3}[axes] * actuation


# --- start, base motion ------------------------------------------------------------------------


@pytest.mark.parametrize("axes", [2, pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("time", [0.0, 0.37])
def test_the_start_is_a_rigid_motion_in_balance(axes, time):
    # on a base that moves in all its channels, in a current that changes
    system = everything(axes)
    state = rest(system, time)
    residual, scale = map(np.asarray, imbalance(system, state.state))
    assert np.abs(residual[2:]).max() < 1e-12 * scale.max()
    assert np.abs(state.acceleration).max() > 1.0
    force = -residual[:2, :axes].sum(axis=0)
    np.testing.assert_allclose(state.base_force, force, rtol=0, atol=1e-12)
    # no two nodes change their distance, the held ones included
    velocity, places = np.asarray(state.velocity), np.asarray(state.position)
    apart = places[:, None] - places[None]
    closing = np.sum(apart * (velocity[:, None] - velocity[None]), axis=-1)
    np.testing.assert_allclose(closing, 0, atol=1e-12)
    assert np.abs(velocity[1:]).max() > {2: 0.1, 3: 0.3}[axes]
    # nothing is damped: in space the spins are those of that rotation
    assert abs(float(jnp.sum(state.working["damping"] * state.motion.velocity))) < 1e-20
    assert axes == 2 or np.abs(state.motion.velocity[2:, 3]).max() > 0.1


def test_depth_does_not_round_the_motion():
    shallow, deep = (
        march(system, rest(system), until=1.0, steps=200)
        for system in (everything(2, depth=10.0), everything(2, depth=4000.0))
    )
    np.testing.assert_allclose(deep.position, shallow.position, rtol=0, atol=1e-10)
    np.testing.assert_allclose(deep.velocity, shallow.velocity, rtol=0, atol=1e-9)


def test_what_is_at_rest_stays_at_rest():
    # edges of 1/8 m, which have no round-off
    system = dry(2, length=1.25)
    start = rest(system)
    states, outcomes = watch(system, start, until=2.5, steps=250)
    np.testing.assert_array_equal(states.position, np.broadcast_to(start.position, (250, 12, 2)))
    assert not states.velocity.any()
    assert not outcomes.iterations.any()


AT_REST = [
    {"tilt": 0.7}, {"tilt": -0.4, "rest_curvature": 2.0},
    {"pan": 0.4, "tilt": 0.7, "roll": 2.0, "rest_curvature": (1.0, -2.0, 4.0), "EI": (1.0, 1.7)},
]  # fmt: skip


@pytest.mark.parametrize(
    ("axes", "case"),
    [(2, AT_REST[0]), (2, AT_REST[1]), pytest.param(3, AT_REST[2], marks=pytest.mark.slow)],
)
def test_round_off_does_not_stir_what_is_at_rest(axes, case):
    system = dry(axes, **case)
    start = rest(system)
    states, outcomes = watch(system, start, until=2.5, steps=250)
    assert np.abs(states.position - start.position).max() < {2: 1e-13, 3: 1e-12}[axes]
    if axes == 3:
        turned = states.motion.orientation.director - start.motion.orientation.director
        assert np.abs(turned).max() < 1e-11
        return
    # one that gains nothing shows that there is nothing to gain
    assert outcomes.iterations.max() <= 2
    assert outcomes.iterations.mean() < 1.05


def test_smooth_motion_is_guessed_and_what_jumps_is_taken_to_stay():
    system, rng = dry(2), np.random.default_rng(0)
    start = rest(system).state

    @eqx.filter_jit
    def expected(accelerations):
        """Return the acceleration that is expected after those of six steps, the last one last."""
        motion = eqx.tree_at(lambda m: m.acceleration, start.motion, accelerations[-1])
        then = eqx.tree_at(
            lambda s: (s.motion, s.acceleration_history), start, (motion, accelerations[-2::-1])
        )
        return expected_acceleration(system.forces, then)

    shape = start.motion.acceleration.shape
    bent, turned, stiff, steady = rng.normal(size=(4, *shape))
    smooth = [bent * t**2 + turned * t + steady for t in 0.1 * np.arange(7)]
    alternating = [a + (-1) ** n * stiff for n, a in enumerate(smooth)]
    for known in (smooth, alternating):
        np.testing.assert_allclose(expected(jnp.stack(known[:6])), known[6], rtol=0, atol=1e-12)
    # what alternates about nothing else, what is never the same, and what the arm does as one,
    # which bends nothing and does not count
    rising = [1.2**n * a for n, a in enumerate([stiff, -stiff] * 3)]
    jumps = list(rng.normal(size=(6, *shape)))
    sways = (0.0, 30.0, 10.0, 0.0, 20.0, 20.0)  # by which it would stay
    swaying = [
        a + 0.1 * rng.normal(size=shape) + sway
        for a, sway in zip([stiff, steady] * 3, sways, strict=True)
    ]
    for known, taken in ((rising, -2), (jumps, -1), (swaying, -2)):
        np.testing.assert_array_equal(expected(jnp.stack(known)), known[taken])


# --- steps that fail ---------------------------------------------------------------------------


def pushed(tip_force, max_iterations=15):
    """Build an arm that a force on its tip, there at once, buckles and folds back."""
    return dry(2, dead=tip_force, damping_time=0.02, max_iterations=max_iterations)


def test_halving_recovers_a_step_that_newton_cannot_take():
    system = pushed((-10.0, -1.0))  # four times the buckling load
    start = rest(system)
    assert not whole_step(system, start, 0.1)[1].converged
    state, progress = advance(system, start, 0.1)
    assert progress.outcome.converged
    assert progress.steps > 1
    assert progress.iterations > progress.outcome.iterations
    assert float(state.time) == pytest.approx(0.1, rel=1e-12)
    fine = march(system, start, until=0.1, steps=1000)
    moved = np.abs(fine.position - start.position).max()
    assert moved > 0.03
    # few and coarse steps of a sudden load: no closer than their own error, which is of order 2
    quarters = start
    for _ in range(4):
        quarters, _ = advance(system, quarters, 0.025)
    errors = [np.abs(each.position - fine.position).max() for each in (state, quarters)]
    assert errors[0] < 0.12 * moved
    assert errors[1] < 0.01 * moved


@pytest.mark.parametrize(
    ("force", "max_iterations", "step", "steps"),
    [((-1e3, 0.0), 15, 3.0, 0), ((-1e2, -10.0), 6, 1.0, 1)],
)
def test_a_step_past_all_halvings_gives_back_the_last_good_state(
    force, max_iterations, step, steps
):
    system = pushed(force, max_iterations)
    start = rest(system)
    state, progress = advance(system, start, step)
    assert not progress.outcome.converged
    assert (int(progress.steps) > 0) == bool(steps)
    for leaf in jax.tree.leaves(state):
        assert np.isfinite(leaf).all()
    assert float(state.time) < step
    residual, scale = map(np.asarray, imbalance(system, state.state))
    assert np.abs(residual[2:]).max() <= 1e-9 * scale.max()
    if not steps:
        assert eqx.tree_equal(state, start)


@pytest.mark.slow
def test_a_step_that_errs_too_much_is_cut_in_two():
    system = pushed((0.0, -1.0))
    start, step = rest(system), 0.02
    _, whole = advance(system, start, step)
    assert whole.steps == 1
    assert whole.iterations == whole.outcome.iterations
    assert whole.error == whole.outcome.error > 0
    middle, first = advance(system, start, step / 2)
    end, second = advance(system, middle, step / 2)
    careful = eqx.tree_at(lambda s: s.max_error, system, 0.6 * whole.error)
    state, cut = advance(careful, start, step)
    assert cut.outcome.converged
    assert cut.steps == 2
    np.testing.assert_allclose(state.position, end.position, rtol=0, atol=1e-14)
    # of both parts, not of the last alone
    assert cut.error == max(first.error, second.error) <= careful.max_error
    assert cut.residual == max(first.residual, second.residual)
    assert cut.iterations == whole.iterations + first.iterations + second.iterations
    # past all halvings it fails, and says by how much it errs
    hopeless = eqx.tree_at(lambda s: s.max_error, system, jnp.asarray(1e-12))
    state, failed = advance(hopeless, start, step)
    assert not failed.outcome.converged
    assert failed.outcome.error > 1e-12
    assert failed.steps == 0
    assert eqx.tree_equal(state, start)
