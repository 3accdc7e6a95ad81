"""The linear model of a time step against differences of the step itself."""

from functools import partial
from operator import itemgetter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.base import SineMotion
from crinoid.dynamics import Integrator, LocalCoordinates
from crinoid.flow import Uniform
from helpers.arms import QUICKLY, always, arm, vehicle

pytestmark = pytest.mark.slow

BEFORE = 8
"""Steps after which a step is linearised: the arm moves by then."""
INTEGRATORS = {
    "newmark": Integrator.newmark(),
    "generalized-alpha": Integrator.generalized_alpha(0.6),
    "implicit-euler": Integrator.implicit_euler(),
}


def example(integrator, current=(0.0, 0.0, 0.0)):
    """Build an arm in space whose base shakes."""
    shaken = SineMotion(5, *(jnp.asarray(n) for n in (0.2, 6.0, 0.3)))
    flow = jnp.asarray([0.3, -0.4, 0.2]) + jnp.asarray(current)
    return arm(
        axes=3,
        nodes=5,
        EA=1e3,
        EI=(1.0, 1.4),
        GJ=0.7,
        rest_curvature=(0.5, -0.3, 1.0),
        damping_time=0.02,
        gravity=2.0,
        water_density=1000.0,
        displaced_area=6e-4,
        tilt=0.4,
        flows=(Uniform(always(), flow),),
        motions=(shaken,),
        limits=[[limit] * 6 for limit in (-1.0, 1.0, 1e3, 1e5, 5.0)],
        integrator=integrator,
        tolerance=1e-13,
    )


def afloat():
    """Build an arm in the plane with a chamber on a submarine that floats."""
    quick = {"max_speed": 10.0, "max_acceleration": 1e3}
    turning = {"max_speed_deg": 1e3, "max_acceleration_deg": 1e5, "range_deg": [-60.0, 60.0]}
    return crinoid.system(
        crinoid.Scenario(
            arm={"nodes": 5, "length": 0.5, "youngs_modulus": 4e5, "damping_time": 0.05},
            base={
                "channels": {name: {"range": [-0.3, 0.3]} | quick for name in ("slide", "heave")}
                | {"tilt": turning}
            },
            vehicle={
                "mass": 5.0,
                "inertia": 0.3,
                "offset": [-0.3, 0.05],
                "added_mass": [3.0, 4.0],
                "drag_area": [0.05, 0.1],
                "angular_drag": 2.0,
                "metacentric_height": 0.04,
                "hold": "thrusters",
                "bandwidth_hz": 0.5,
            },
            chamber=[{"offset": 0.008, "area": 2e-4, "max_pressure": 3e4, "time_constant": 0.05}],
            flow=[{"kind": "uniform", "velocity": [0.2, -0.1]}],
            simulation={"tolerance": 1e-13},
        )
    )


CASES = {name: partial(example, integrator) for name, integrator in INTEGRATORS.items()} | {
    "chamber, afloat": afloat
}


@eqx.filter_jit(compiler_options=QUICKLY)
def moving(system, command):
    """Return a state on the way, and the one a step later."""

    def step(state, _):
        state, _ = system.step(state, command)
        return state, state

    _, states = jax.lax.scan(step, system.rest(), length=BEFORE + 1)
    before, after = (jax.tree.map(itemgetter(at), states) for at in (-2, -1))
    return before, after


@eqx.filter_jit(compiler_options=QUICKLY)
def linear(system, state, command):
    found = system.transition(state, command)
    return found, found.A, found.B, found.C


def nearby(chart, change):
    arm_change, actuator_change = jnp.split(change, [chart.arm.size])
    return chart.at(chart.arm + arm_change, chart.actuators + actuator_change)


@eqx.filter_jit(compiler_options=QUICKLY)
def changed(system, state, change, command):
    """Return the coordinates after a step from a state nearby, and its tip."""
    near = nearby(LocalCoordinates(system, state), change)
    return system.step(near, command)[0], system.tip(near)


@eqx.filter_jit(compiler_options=QUICKLY)
def read(system, reference, state):
    return jnp.concatenate(LocalCoordinates(system, reference).read(state))


def scaled(size_arm, size, seed):
    """Draw a change of all coordinates, each about as large as it differs from step to step."""
    change = np.random.default_rng(seed).standard_normal(size)
    for part, typical in zip(np.split(change[:size_arm], 4), (1e-6, 1e-4, 1e-2, 1e-1), strict=True):
        part *= typical
    change[size_arm:] *= 1e-5
    change[-1] = 0.0  # length of the step before: it counts where a servo's push changes
    return change


@pytest.mark.parametrize("case", CASES)
def test_a_b_c_are_those_of_the_step(case):
    system = CASES[case]()
    command = jnp.linspace(0.1, 0.2, len(system.inputs))
    state, after = moving(system, command)
    found, A, B, C = linear(system, state, command)
    arm_size = found.arm.shape[0]
    for seed in range(3):
        change = scaled(arm_size, A.shape[0], seed)
        moved = 1e-5 * np.random.default_rng(10 + seed).standard_normal(command.size)
        (ahead, tip_ahead), (back, tip_back) = (
            changed(system, state, jnp.asarray(sign * change), command + sign * moved)
            for sign in (1.0, -1.0)
        )
        differences = 0.5 * np.asarray(read(system, after, ahead) - read(system, after, back))
        expected = np.asarray(A @ change + B @ moved)
        parts = [*np.split(np.arange(arm_size), 4), np.arange(arm_size, A.shape[0])]
        for part in parts:
            largest = np.abs(expected[part]).max()
            np.testing.assert_allclose(differences[part], expected[part], atol=1e-6 * largest)
        np.testing.assert_allclose(0.5 * (tip_ahead - tip_back), C @ change, atol=1e-12, rtol=1e-6)


def test_a_change_of_the_current_is_what_the_water_at_the_nodes_does():
    system, faster, slower = (
        example(INTEGRATORS["newmark"], np.array(by) * [1.0, 2.0, -1.0])
        for by in (0.0, 1e-4, -1e-4)
    )
    command = jnp.zeros(6)
    state, after = moving(system, command)
    found, A, *_ = linear(system, state, command)
    none = jnp.zeros(A.shape[0])
    ahead, back = (
        read(system, after, changed(each, state, none, command)[0]) for each in (faster, slower)
    )
    change = np.asarray(found.stirred).sum(axis=1) @ [1e-4, 2e-4, -1e-4]
    differences = 0.5 * (ahead - back)[: change.size]
    np.testing.assert_allclose(differences, change, atol=1e-6 * np.abs(change).max())


@eqx.filter_jit(compiler_options=QUICKLY)
def there_and_back(system, changes):
    """Return a state, what a chart about it reads of one nearby, and the state of that reading."""
    start = LocalCoordinates(system, system.rest())
    # on from one that is far, by two ways
    chart = LocalCoordinates(system, nearby(start, changes[0]))
    by_step = nearby(start, changes[0] + changes[1])
    near = nearby(chart, changes[1])
    read = jnp.concatenate(chart.read(near)) - jnp.concatenate([chart.arm, chart.actuators])
    held = system.base.prescribe(chart.state.time, near.servo).position
    return read, near, held, by_step, chart.at(*chart.read(by_step))


@pytest.mark.parametrize("floats", [False, True])
def test_a_chart_gives_back_what_it_was_given(floats):
    system = example(INTEGRATORS["newmark"])
    if floats:
        system = eqx.tree_at(
            lambda s: s.forces.vehicle, system, vehicle(3), is_leaf=lambda x: x is None
        )
    size = 4 * (4 * 4 + (6 if floats else 0))
    near = scaled(size, size + 25, 0)
    far = 1e3 * scaled(size, size + 25, 1)
    read, there, held, other, again = there_and_back(system, jnp.asarray([far, near]))
    np.testing.assert_allclose(read[:size], near[:size], atol=1e-12)
    np.testing.assert_allclose(read[size:], near[size:], atol=1e-15)
    if not floats:  # what the base holds has moved along
        np.testing.assert_allclose(there.position[:2], held, atol=1e-15)
    # a state is where its coordinates say, whichever way it came
    np.testing.assert_allclose(again.position, other.position, rtol=0, atol=1e-13)
    # no edge ends at the ghost
    director, expected = (each.motion.orientation.director[1:] for each in (again, other))
    np.testing.assert_allclose(director, expected, rtol=0, atol=1e-13)
    if floats:
        np.testing.assert_allclose(again.attitude, other.attitude, rtol=0, atol=1e-15)
