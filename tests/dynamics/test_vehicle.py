"""The submarine that floats: momentum, energy, limits of a heavy one, and drift with the water."""

import re
from dataclasses import replace
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.dynamics import ActingForces, EnergyAccount, resting
from crinoid.dynamics.balance import Balance
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.start import clamped
from crinoid.dynamics.vehicle import VehicleKinematics
from crinoid.dynamics.windows import motion_windows
from crinoid.elements import WORKS, Inertia, Tool, VehiclePose
from crinoid.flow import Uniform
from crinoid.numerics.frames import cross, moments
from helpers.arms import QUICKLY, always, arm, obstacles, order, vehicle
from helpers.newton_steps import solve_afloat

INERTIA = {2: 0.4, 3: (0.2, 0.4, 0.5)}
OFFSET = {2: (-0.3, 0.1), 3: (-0.3, 0.2, 0.1)}
STEPS = 100
CURVED = {2: 1.0, 3: (0.7, 1.0, 1.5)}


def floating(axes, *, current=None, tool=1.0, floats=None, arms=None):
    """Build an arm with a tool on a submarine that floats; one make for each number of axes."""
    inertia = 2e-3 if axes == 2 else jnp.array([1e-3, 2e-3, 3e-3])
    current = (0.0,) * axes if current is None else current
    numbers = {"inertia": INERTIA[axes], "offset": OFFSET[axes]} | (floats or {})
    settings = {
        "nodes": 5,
        "axes": axes,
        "EA": 1e3,
        "EI": 2.0,
        "GJ": 1.0 if axes == 3 else None,
        "tolerance": 1e-14,
        "rest_curvature": CURVED[axes],
        "linear_drag": 1e-300,
        "radius": 1e-4,  # the spin of an edge about itself has no gyroscopic moment
    }
    return arm(
        loads=[lambda rod: Tool.of(rod, mass=0.2 * tool, inertia=tool * inertia, offset=0.05)],
        flows=[Uniform(always(), jnp.asarray(current, float))],
        vehicle=None if floats is None else vehicle(axes, **numbers),
        **settings | (arms or {}),
    )


def begun(system, velocity):
    """Return the arm at rest, given velocities, with the accelerations that follow."""
    state = system.rest()
    context = clamped(state.context, system.forces, system.base, state.time, state.servo)
    forces = ActingForces.of(system.forces, context)
    position, frames = state.motion.position, state.frames
    none, zero = jnp.zeros_like(position), jnp.zeros(())
    stage = StepMap(state.time, position, velocity, none, zero, zero, jnp.ones(()), frames)
    around = forces.surroundings(stage, none)
    motion = forces.motion(stage, none, around)
    residual, _ = forces.residual(motion)
    acceleration = Balance(forces, around, stage).tangent(motion).solve(-residual)
    motion = forces.motion(stage, acceleration, around)
    acceleration_history = jnp.stack([motion.acceleration] * 5)
    return eqx.tree_at(
        lambda s: (s.motion, s.acceleration_history), state, (motion, acceleration_history)
    )


def momenta(system, motion, attitude):
    """Return momentum and angular momentum about the origin of arm, tool and vehicle together."""
    axes, forces = system.forces.axes, system.forces
    inertia = next(e for e in forces.elements if isinstance(e, Inertia))
    window = motion_windows(inertia, motion)
    share = jax.vmap(lambda e, m: e._momentum(m.velocity))(inertia, window)
    place, linear = window.position[..., :axes], share[..., :axes]
    momentum = jnp.sum(linear, axis=(0, 1))
    about = jnp.sum(moments(place, linear), axis=(0, 1))
    tool = jax.tree.map(lambda x: x[0], next(e for e in forces.elements if isinstance(e, Tool)))
    ends, moving = (row[-4:-2] for row in (motion.position, motion.velocity))
    (centre, _), (rate, _) = jax.jvp(tool._stance, (ends[:, :axes],), (moving[:, :axes],))
    edge, change = ends[1, :axes] - ends[0, :axes], moving[1, :axes] - moving[0, :axes]
    turning = moments(edge, change) / jnp.sum(edge**2)
    spun = tool.inertia * turning
    if axes == 3:
        tangents = jnp.diff(place, axis=1)[:, 0]
        tangents /= jnp.linalg.norm(tangents, axis=1)[:, None]
        about += jnp.sum(share[:, 1, 3:] * tangents, axis=0)
        director = motion.orientation.director[-1]
        frame = jnp.stack([tangents[-1], director, cross(tangents[-1], director)])
        turning += moving[1, 3] * tangents[-1]
        spun = frame.T @ (tool.inertia * (frame @ turning))
    momentum += tool.mass * rate
    about += moments(centre, tool.mass * rate) + spun
    body, turns = forces.vehicle, about.size
    middle, speed = motion.position[-2, :axes], motion.velocity[-2, :axes]
    own = body.inertia * motion.velocity[-1, :turns]
    about += moments(middle, body.mass * speed) + (own if axes == 2 else attitude @ own)
    return jnp.concatenate([momentum + body.mass * speed, about]), turning


def rates(system, state):
    """Return the momenta, and how fast they change with the accelerations of a state."""
    motion, attitude, axes = state.motion, state.attitude, system.forces.axes
    now, turning = momenta(system, motion, attitude)

    def moved(position, velocity, orientation, attitude):
        where = (position, velocity, orientation)
        other = eqx.tree_at(
            lambda m: (m.position, m.velocity, m.orientation),
            motion,
            where,
            is_leaf=lambda x: x is None,
        )
        return momenta(system, other, attitude)[0]

    orientation, swept, turned = motion.orientation, None, jnp.zeros_like(attitude)
    if axes == 3:
        swept = jax.tree.map(jnp.zeros_like, orientation)
        last = cross(turning, orientation.director[-1])
        swept = eqx.tree_at(lambda o: o.director, swept, swept.director.at[-1].set(last))
        turned = cross(motion.velocity[-1, :3], attitude)  # a row v R turns into w x (v R)
        turned = jax.vmap(lambda w, row: cross(row, w), (None, 0))(
            motion.velocity[-1, :3], attitude
        )
    _, rate = jax.jvp(
        moved,
        (motion.position, motion.velocity, orientation, attitude),
        (motion.velocity, motion.acceleration, swept, turned),
    )
    return now, rate


@eqx.filter_jit(compiler_options=QUICKLY)
def run(system, velocity, command, step):
    """Return the states and momenta over `STEPS`, and whether all converged."""
    state = begun(system, velocity)
    books = EnergyAccount.of(system.forces, state)

    def one(carry, _):
        state, books = carry
        after, outcome = system.step(state, command, step)
        books = books.after(system.forces, state, after, step)
        return (after, books), (after, books, rates(system, after), outcome.converged)

    _, (states, all_books, found, good) = jax.lax.scan(one, (state, books), length=STEPS)
    return states, all_books, found, good.all()


def pushed(system):
    """Return velocities of an arm that swings and a vehicle that moves and turns."""
    axes = system.forces.axes
    width = 2 if axes == 2 else 4
    velocity = np.zeros((8, width))
    velocity[2:6, axes - 1] = 0.2 * np.linspace(0.25, 1.0, 4) ** 2
    velocity[-2, 0], velocity[-1, 0] = 0.05, 0.1
    if axes == 3:
        velocity[2:6, 1] = 0.1 * np.linspace(0.25, 1.0, 4) ** 2
        velocity[-1, :3] = (0.2, 0.1, -0.1)
    return jnp.asarray(velocity)


in_both_dimensions = pytest.mark.parametrize(
    "axes", [2, pytest.param(3, marks=pytest.mark.release)]
)


def still(axes):
    """Return the command that moves no channel."""
    return jnp.zeros(3 * (axes - 1))


@cache
def drifting(axes):
    """Return an arm on a vehicle, both pushed, and its runs in steps of 4 ms, a half, a quarter."""
    system, found = floating(axes, floats={}), {}
    for share in (1, 2, 4):
        *found[share], good = run(system, pushed(system), still(axes), jnp.asarray(4e-3 / share))
        assert good
    return system, found


@pytest.mark.slow
@in_both_dimensions
def test_momentum_of_arm_tool_and_vehicle_is_conserved_in_a_vacuum(axes):
    system, found = drifting(axes)
    drifts = [
        float(np.ptp(now[share - 1 : 25 * share], axis=0).max())
        for share, (*_, (now, _)) in found.items()
    ]
    # no force but those between them: what time steps leave is of second order,
    assert (order(drifts) > 1.8).all()
    *_, (now, _), good = run(system, pushed(system), still(axes), jnp.asarray(2e-6))
    assert good
    assert np.abs(now - now[0]).max() < 1e-9 * np.abs(now[0]).max()
    # and the accelerations change nothing at all, while servos move the arm's base as well
    command = jnp.asarray([0.1, 0.05, 0.3, -0.2, 0.1, 0.2])[: 3 * (axes - 1)]
    # (in space short of what the frames of edges turn by in a step)
    step = jnp.asarray(0.01 if axes == 2 else 1e-6)
    states, _, (now, rate), good = run(system, pushed(system), command, step)
    assert good
    forces = 3.0 * np.abs(states.motion.acceleration[:, -2]).max()
    assert forces > 1.0
    assert np.abs(rate).max() < 1e-9 * forces


@pytest.mark.slow
@in_both_dimensions
def test_what_the_base_does_to_the_arm_the_vehicle_loses(axes):
    system, found = drifting(axes)
    turns = 1 if axes == 2 else 3
    body, defects, lost = system.forces.vehicle, [], []
    for share, (states, books, _) in found.items():
        first, last = 4 * share - 1, 25 * share - 1
        velocity = states.motion.velocity
        kinetic = 0.5 * body.mass * np.sum(velocity[:, -2, :axes] ** 2, axis=1)
        kinetic = kinetic + 0.5 * np.sum(body.inertia * velocity[:, -1, :turns] ** 2, axis=1)
        work = books.work[:, WORKS.index("actuation")]
        lost.append(float(kinetic[last] - kinetic[first]))
        defects.append(lost[-1] + float(work[last] - work[first]))
    energy = eqx.filter_jit(lambda each: jax.vmap(system.energy)(each).sum(axis=1))(states)
    stored = energy - books.work.sum(axis=1)
    assert abs(lost[-1]) > 1e-4
    assert (order(np.abs(defects)) > 1.7).all()
    assert abs(defects[-1]) < 1e-4 * abs(lost[-1])
    assert np.ptp(stored) < 1e-4 * float(np.ptp(energy))


@pytest.mark.slow
@in_both_dimensions
def test_a_free_vehicle_drifts_with_a_uniform_current(axes):
    current = (0.3, 0.2) if axes == 2 else (0.3, -0.1, 0.2)
    water = {"water_density": 1000.0, "displaced_area": 1e-3, "linear_drag": 5.0}
    floats = {"drag": 40.0, "added_mass": np.linspace(1.0, 2.0, axes), "angular_drag": 0.5}
    system = floating(
        axes,
        current=current,
        floats=floats,
        arms=water | {"rest_curvature": jnp.zeros_like(jnp.asarray(CURVED[axes]))},
    )
    u = np.zeros((8, 2 if axes == 2 else 4))
    u[:-1, :axes] = current
    states, _, _, good = run(system, jnp.asarray(u), still(axes), jnp.asarray(0.01))
    assert good
    # along with it from the start: nothing pushes
    moved = states.motion.position[-1, 2:-1, :axes] - states.motion.position[0, 2:-1, :axes]
    np.testing.assert_allclose(moved, 0.99 * np.tile(current, (5, 1)), rtol=0, atol=1e-9)
    # and from rest
    states, _, _, good = run(system, jnp.zeros_like(u), still(axes), jnp.asarray(0.1))
    assert good
    slip = np.linalg.norm(states.motion.velocity[:, -2, :axes] - np.asarray(current), axis=1)
    assert slip[-1] < 0.05 * np.linalg.norm(current)
    assert (np.diff(slip[::10]) < 0).all()


@pytest.mark.release
def test_water_that_accelerates_carries_a_free_vehicle_along():
    # (m + m_a) a = (rho V + m_a) Du/Dt, of an arm that weighs 1e-5 of it
    scenario = crinoid.Scenario(
        arm={"nodes": 3, "radius": 5e-3},
        water={"depth": 30.0},
        flow=[
            {"kind": "sine", "amplitude": [0.1, 0.05], "frequency_hz": 0.2},
            {"kind": "waves", "significant_height": 0.5, "peak_period": 5.0},
        ],
        vehicle={"mass": 8e3, "inertia": 1e3, "volume": 9.0, "added_mass": 2e3},
    )
    system, time = crinoid.system(scenario), jnp.asarray(1.7)

    @eqx.filter_jit(compiler_options=QUICKLY)
    def started(system, time):
        return system.forces.water.current(system.forces.origin, time), system.rest(time)

    water, state = started(system, time)
    density = scenario.water.density
    expected = (9.0 * density + 2e3) / (8e3 + 2e3) * water.acceleration
    weight = np.array([0.0, (9.0 * density / 8e3 - 1.0) * 8e3 / (8e3 + 2e3) * 9.81])
    assert np.linalg.norm(water.acceleration) > 0.01
    found = state.motion.acceleration[-2] - weight
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-3 * np.linalg.norm(expected))


def flows(current, swell):
    """Return a current and a swell, which may be zero: a run in any is the same program."""
    return [
        {"kind": "uniform", "velocity": list(current)},
        {"kind": "sine", "amplitude": list(swell), "frequency_hz": 0.2},
    ]


STILL = flows((0.0, 0.0), (0.0, 0.0))


def ridden(*, volume, linear_drag, drag_area=0.0, current=(0.0, 0.0), swell=(0.0, 0.0)):
    """Return times and displacements of a vehicle of 8 t that an arm of 1e-5 of it hardly feels."""
    scenario = crinoid.Scenario(
        arm={"nodes": 3, "radius": 5e-3},
        water={"depth": 30.0},
        flow=flows(current, swell),
        vehicle={
            "mass": 8e3,
            "inertia": 1e3,
            "added_mass": 2e3,
            "volume": volume,
            "linear_drag": list(linear_drag),
            "drag_area": drag_area,
        },
        simulation={"duration": 4.0, "time_step": 0.02, "start": "rest"},
        control={"kind": "none"},
    )
    data = crinoid.simulate(scenario).dataset
    return np.asarray(data["time"])[:, None], np.asarray(data["vehicle_pose"])[:, :2]


@pytest.mark.release
def test_linear_drag_brings_it_exponentially_to_the_speed_of_the_current():
    # (m + m_a) dv/dt = c (U - v) - (m - rho V) g
    drag = np.array([6e3, 9e3])
    time, moved = ridden(current=[0.2, 0.0], linear_drag=drag, volume=7.9e3 / 1025.0)
    last = np.array([0.2, -(8e3 - 7.9e3) * 9.81 / drag[1]])
    rate = drag / (8e3 + 2e3)
    expected = last * (time - (1 - np.exp(-rate * time)) / rate)
    assert np.abs(expected[-1]).min() > 0.05
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-3 * np.abs(expected).max())


@pytest.mark.release
def test_a_neutral_vehicle_swings_with_the_water():
    # Du/Dt pushes the body and the water around it: v = u whatever its added mass and drag
    swell, rate = np.array([0.1, 0.05]), 2 * np.pi * 0.2
    neutral = {"volume": 8e3 / 1025.0, "linear_drag": [500.0, 300.0], "drag_area": 0.5}
    time, moved = ridden(swell=swell, **neutral)
    expected = swell / rate * (1 - np.cos(rate * time))
    np.testing.assert_allclose(moved, expected, rtol=0, atol=2e-3 * np.abs(expected).max())


@in_both_dimensions
def test_linear_drag_acts_along_and_about_its_axes(axes):
    turns = 1 if axes == 2 else 3
    along, about = np.arange(1.0, axes + 1), np.arange(1.0, turns + 1)
    body, moving = vehicle(axes, mass=4.0), ride(axes, 0.0, 0.3, velocity=0.2, rate=0.1)
    none = jnp.zeros(axes)
    dragged = replace(body, linear_drag=jnp.asarray(along), angular_linear_drag=jnp.asarray(about))
    more, less = (each.residual(moving, none, none) for each in (dragged, body))
    turn = np.asarray(moving.attitude)
    force = turn @ (along * (turn.T @ np.full(axes, 0.2)))
    np.testing.assert_allclose(more[0] - less[0], force, rtol=1e-12)
    np.testing.assert_allclose(more[1] - less[1], about * 0.1, rtol=1e-12)


@pytest.mark.release
def test_in_the_plane_of_a_planar_arm_it_moves_the_same_in_space():
    flat = floating(2, floats={"offset": (-0.3, 0.1)}, arms={"rest_curvature": 1.0})
    deep = floating(
        3,
        floats={"offset": (-0.3, 0.0, 0.1), "inertia": (0.2, 0.4, 0.5)},
        arms={"rest_curvature": (0.0, 1.0, 0.0)},
    )
    onto = np.zeros((2, 4))
    onto[0, 0] = onto[1, 2] = 1.0
    velocity = np.asarray(pushed(flat)) @ onto
    velocity[-1] = [0.0, -0.1, 0.0, 0.0]  # tilt is left-handed about y
    command = jnp.asarray([0.05, 0.03, 0.2])
    planar, *_, good = run(flat, pushed(flat), command, jnp.asarray(0.01))
    there = jnp.asarray([0.05, 0.0, 0.03, 0.0, 0.2, 0.0])
    spatial, *_, fine = run(deep, jnp.asarray(velocity), there, jnp.asarray(0.01))
    assert good & fine
    moved = spatial.motion.position[:, :-1, :3] - planar.motion.position[:, :-1] @ onto[:, :3]
    assert np.abs(moved).max() < 1e-9
    assert np.ptp(planar.motion.position[:, -1, 0]) > 0.01
    turned = spatial.attitude[:, 2, 0] - planar.attitude[:, 1, 0]
    assert np.abs(turned).max() < 1e-9


@pytest.mark.release
def test_one_too_heavy_to_be_pushed_is_a_base_that_is_held():
    axes, command = 3, jnp.asarray([0.1, 0.05, 0.3, -0.2, 0.1, 0.2])
    heavy = floating(axes, floats={"mass": 1e9, "inertia": 1e9}, arms={"gravity": 9.81})
    held = floating(axes, arms={"gravity": 9.81})

    @eqx.filter_jit(compiler_options=QUICKLY)
    def swing(system):
        def one(state, _):
            state, outcome = system.step(state, command, 0.01)
            return state, (state.position, state.base_force, outcome.converged)

        return jax.lax.scan(one, system.rest(), length=STEPS)[1]

    states, _, _, good = run(heavy, jnp.zeros_like(pushed(heavy)), command, jnp.asarray(0.01))
    position, force, fine = swing(held)
    assert good & fine.all()
    assert np.ptp(position[:, -1], axis=0).max() > 0.1
    np.testing.assert_allclose(states.motion.position[:, :6, :axes], position, rtol=0, atol=1e-7)
    assert np.abs(states.base_force - force).max() < 1e-5 * np.abs(force).max()


# --- the matrix of a step ------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axes", "ball"), [pytest.param(2, True, marks=pytest.mark.release), (3, False)]
)
def test_the_bordered_matrix_is_the_derivative_of_the_residual(axes, ball):
    beside = {"obstacles": obstacles([[0.4, 0.012]], radius=1e-3, mass=0.3)} if ball else {}
    system = floating(axes, floats={"drag": 3.0, "bandwidth": 1.0}, arms=beside)
    rng = np.random.default_rng(0)
    shape = (10 if ball else 8, 2 if axes == 2 else 4)
    noise = 1e-3 * rng.normal(size=(3, *shape)) * np.array([1.0, 1.0, 0.1])[:, None, None]
    rhs = rng.normal(size=shape)
    given = map(jnp.asarray, (noise, rhs))
    solved, factorised, product, _ = solve_afloat(system, None, *given)
    np.testing.assert_allclose(factorised, solved, rtol=1e-12)
    unknown = np.asarray(solved) != 0
    assert not unknown[:2].any()
    assert unknown.sum() == (8 + 2 + 1 + 3 if ball else 16 + 6)
    np.testing.assert_allclose(product[unknown], rhs[unknown], rtol=1e-7, atol=1e-9)


@pytest.mark.release
def test_obstacles_are_as_far_from_the_arm_whether_its_submarine_floats_or_not():
    beside = {"obstacles": obstacles([[0.4, 0.3], [1.2, 0.1]], radius=0.05, mass=0.3)}
    clearance = eqx.filter_jit(lambda system: resting.clearance(system, jnp.zeros(())))
    floats, held = (clearance(floating(2, floats=each, arms=beside)) for each in ({}, None))
    assert held.shape == (2,)
    np.testing.assert_array_equal(floats, held)


@pytest.mark.slow
def test_slopes_by_the_numbers_of_a_vehicle_are_those_of_differences():
    system = floating(2, floats={"bandwidth": 0.5, "drag": 3.0, "metacentric_height": 0.1})
    where = (
        lambda s: s.forces.vehicle.mass,
        lambda s: s.forces.vehicle.inertia,
        lambda s: s.forces.vehicle.offset,
        lambda s: s.forces.vehicle.thrusters.stiffness,
    )

    @eqx.filter_jit(compiler_options=QUICKLY)
    def reached(factors):
        def at(factors):
            changed = system
            for each, factor in zip(where, factors, strict=True):
                changed = eqx.tree_at(each, changed, factor * each(changed))
            state = begun(changed, pushed(changed))

            def one(state, _):
                return changed.step(state, jnp.asarray([0.05, 0.0, 0.1]), 0.01)[0], None

            end, _ = jax.lax.scan(one, state, length=20)
            places = jnp.concatenate([changed.tip(end), end.vehicle_position])
            return places, places

        return jax.jacfwd(at, has_aux=True)(factors)

    ones, h = np.ones(len(where)), 1e-4
    slopes = reached(jnp.asarray(ones))[0]
    for index in range(len(where)):
        ahead, behind = (
            reached(jnp.asarray(ones + sign * h * np.eye(len(where))[index]))[1] for sign in (1, -1)
        )
        difference = (ahead - behind) / (2 * h)
        assert np.abs(difference).max() > 1e-5
        np.testing.assert_allclose(slopes[:, index], difference, rtol=1e-5, atol=1e-9)


# --- the body alone ------------------------------------------------------------------------------


def ride(axes, position, turn, velocity=0.0, rate=0.0):
    """Return how a vehicle moves that is displaced and turned."""
    turns = 1 if axes == 2 else 3
    rows = np.zeros((3, 2, 2 if axes == 2 else 4))
    rows[0, 0, :axes], rows[1, 0, :axes] = position, velocity
    rows[0, 1, :turns], rows[1, 1, :turns] = turn, rate
    attitude = VehiclePose.at_start(axes).attitude_at(jnp.asarray(rows[0, 1]))
    return VehicleKinematics.of(attitude, turns, *map(jnp.asarray, rows))


def test_thrusters_pull_it_back_up_to_their_limits():
    body = vehicle(
        2,
        mass=4.0,
        inertia=0.5,
        offset=(0.0, 0.0),
        added_mass=(1.0, 2.0),
        bandwidth=0.5 / np.pi,
        max_force=3.0,
        max_moment=0.1,
    )
    # omega = 1: stiffness and half the damping are the mass with added mass
    force, moment = body.thrusters(ride(2, (0.1, 0.2), 0.0, (0.01, 0.0), 0.05), body.offset)
    np.testing.assert_allclose(force, [-(0.5 + 0.1), -1.2])
    np.testing.assert_allclose(moment, [-0.05], rtol=1e-12)
    force, moment = body.thrusters(ride(2, (9.0, -9.0), 0.5), body.offset)
    np.testing.assert_allclose(force, [-3.0, 3.0])
    np.testing.assert_allclose(moment, [-0.1])
    # along its own axes: turned by a right angle it pushes along z to go along x
    force, _ = body.thrusters(ride(2, (0.1, 0.0), np.pi / 2), body.offset)
    np.testing.assert_allclose(force, [0.0, 0.6], atol=1e-15)


@in_both_dimensions
def test_a_low_centre_of_mass_rights_it_and_weight_pulls_it_down(axes):
    body = vehicle(axes, mass=4.0, displaced=3.5, inertia=0.5, gravity=9.81, metacentric_height=0.1)
    tilted = 0.2 if axes == 2 else (0.0, -0.2, 0.0)
    force, moment = body.residual(ride(axes, 0.0, tilted), jnp.zeros(axes), jnp.zeros(axes))
    np.testing.assert_allclose(force, [*[0.0] * (axes - 1), 0.5 * 9.81], atol=1e-14)
    righting = 3.5 * 9.81 * 0.1 * np.sin(0.2)
    expected = [righting] if axes == 2 else [0.0, -righting, 0.0]
    np.testing.assert_allclose(moment, expected, atol=1e-14)


# --- its table -----------------------------------------------------------------------------------


BODY = {"mass": 5.0, "inertia": 1.0}
HEAVE = {"kind": "sine", "channel": "heave", "amplitude": 0.1, "frequency_hz": 0.2}


@pytest.mark.parametrize(
    ("vehicle", "tables", "line"),
    [
        ({"mass": 5.0}, {}, "vehicle.inertia: missing; must be a number above 0 (kg m2)"),
        (BODY | {"inertia": 0.0}, {},
         "vehicle.inertia: got 0.0; must be a number above 0 (kg m2)"),
        (BODY | {"drag_area": [1.0, 2.0, 3.0]}, {},
         "vehicle.drag_area: got [1.0, 2.0, 3.0]; must be a number of 0 or more, or [x, z] (m2). "
         "Set arm.dimension = 3 to use it."),
        (BODY | {"hold": "anchor"}, {},
         'vehicle.hold: got "anchor"; must be "free" or "thrusters"'),
        (BODY, {"base": {"motion": [HEAVE]}},
         "base.motion: got [a table]; must be left out with vehicle.mass. A vehicle floats and "
         "has no prescribed motion."),
        (BODY, {"target": {"frame": "base"}},
         'target.frame: got "base"; must be "world" with vehicle.mass'),
    ],
)  # fmt: skip
def test_a_mistake_gets_one_line(vehicle, tables, line):
    with pytest.raises(crinoid.ScenarioError, match=f"^{re.escape(line)}$"):
        crinoid.Scenario(vehicle=vehicle, **tables)


@pytest.mark.release
def test_a_free_vehicle_sinks_as_its_drag_lets_it_and_its_result_reads_back():
    mass, displaced, added, area = 80.0, 76.0, 40.0, 0.2
    scenario = crinoid.Scenario(
        # a thread that weighs and drags next to nothing
        arm={"nodes": 3, "length": 0.1, "radius": 5e-4, "youngs_modulus": 1e9, "density": 1025.0},
        base={"position": [0.0, -20.0], "tilt_deg": -90.0},
        vehicle={
            "mass": mass,
            "inertia": 3.0,
            "volume": displaced / 1025.0,
            "added_mass": added,
            "drag_area": area,
            "linear_drag": [1e-9, 1e-9],  # none would be another program than that of `ridden`
            "offset": [0.0, 0.1],
            "metacentric_height": 0.1,
        },
        flow=STILL,
        simulation={"duration": 8.0, "time_step": 0.02, "start": "rest"},
    )
    result = crinoid.simulate(scenario)
    assert result.scenario == scenario
    weight, drag = (mass - displaced) * 9.81, 0.5 * 1025.0 * area
    terminal, gain = np.sqrt(weight / drag), weight / (mass + added)
    time = result.dataset["time"].values
    assert gain * time[-1] > 2 * terminal  # it no longer gains speed
    depth = terminal**2 / gain * np.log(np.cosh(gain * time / terminal))
    height = result.dataset["vehicle_pose"].sel(channel="heave").values
    np.testing.assert_allclose(height, -depth, rtol=1e-3, atol=1e-12)


def test_what_thrusters_need_may_stay_where_nothing_holds_it():
    free = crinoid.load("floating", ["vehicle.hold=free"])
    assert crinoid.Scenario.from_toml(free.to_toml()) == free
    assert not np.any(crinoid.system(free).forces.vehicle.thrusters.stiffness)


def test_numbers_of_the_table_reach_the_body():
    scenario = crinoid.Scenario(
        arm={"dimension": 3},
        vehicle={
            "mass": 5.0,
            "inertia": [1.0, 2.0, 3.0],
            "offset": [-0.2, 0.0, 0.1],
            "added_mass": [1.0, 2.0, 3.0],
            "drag_area": 0.1,
            "hold": "thrusters",
            "bandwidth_hz": 0.5 / np.pi,
            "max_force": 7.0,
        },
    )
    assert crinoid.Scenario.from_toml(scenario.to_toml()) == scenario
    body = crinoid.system(scenario).forces.vehicle
    np.testing.assert_allclose(body.thrusters.stiffness, [6.0, 7.0, 8.0])
    np.testing.assert_allclose(body.thrusters.turn_damping, [2.0, 4.0, 6.0])
    np.testing.assert_allclose(body.drag, 0.5 * 1025.0 * 0.1)
    assert float(body.displaced) == 5.0  # neutral
    assert float(body.thrusters.max_force) == 7.0
    assert np.isinf(body.thrusters.max_moment)
