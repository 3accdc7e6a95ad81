"""The closed loop as a pure function: its gradients and its failures."""

from dataclasses import replace
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.dynamics import Reason
from crinoid.foundation.fixed_numbers import SKIN
from crinoid.simulation import glance
from helpers.arms import QUICKLY, acting

STEPS = 40
H = 2e-5
"""Step of the central differences, relative: contact presses within a thin skin."""
COMMON = {
    "seed": 1,
    "base": {"tilt_deg": -20.0, "channels": {"slide": {}, "tilt": {}}},
    "chamber": [{"name": "bend", "area": 2e-4, "offset": 0.008, "max_pressure": 1e5, "pair": True}],
    "sensor": {"delay": 0.01, "noise_position": 1e-4},
    # Newton's method ends at round-off
    "simulation": {"duration": 1.0, "time_step": 0.005, "tolerance": 1e-13},
}
GAINS = {
    "kind": "pid",
    "rate_hz": 100.0,
    "pid": {"tilt": {"kp": 0.3, "ki": 1.0, "kd": 0.02}, "bend": {"kp": 0.2, "ki": 0.8}},
}
ARM = {"nodes": 5, "radius": [0.02, 0.015], "youngs_modulus": 1e6}
PLANE = COMMON | {
    "arm": ARM,
    "flow": [{"kind": "uniform", "velocity": [0.3, 0.1]}],
    "obstacle": [{"kind": "sphere", "position": [0.35, -10.05], "radius": 0.05, "friction": 0.2}],
    "target": {"tip": [0.475, -10.155]},
    "control": GAINS,
}
SPACE = COMMON | {
    "arm": ARM | {"dimension": 3},
    "flow": [{"kind": "uniform", "velocity": [0.2, 0.2, 0.1]}],
    # without friction, which is rounded where an iteration more or less was taken
    "obstacle": [{"kind": "sphere", "position": [0.35, 0.02, -10.05], "radius": 0.05}],
    "target": {"tip": [0.475, 0.02, -10.155]},
    "control": GAINS | {"controlled": ["x", "z"]},
}
FACTORS = {
    "proportional gain": lambda p: p.pid.kp,
    "integral gain": lambda p: p.pid.ki,
    "derivative gain": lambda p: p.pid.kd,
    "modulus": lambda p: p.arm.youngs_modulus,
    "radius": lambda p: p.arm.radius,
    "density": lambda p: p.arm.density,
    "water's density": lambda p: p.water.density,
    "chamber's pressure": lambda p: p.actuator[0].max_pressure,
    "drag": lambda p: p.water.drag_normal,
    "current": lambda p: p.flow[0].uniform_velocity,
}
NAMES = (*FACTORS, "throw")
"""Factors that the loss is differentiated by: on numbers, and on the speeds at the start."""


STUDIES = {"plane": (PLANE, jax.grad), "space": (SPACE, jax.jacfwd)}
"""Scenarios and how they are differentiated: in space forward, which compiles faster."""


@cache
def studied(kind):
    """Return slopes of a loss by factors, the loss, and the smallest gap to the obstacle.

    As a function of the factors and of how far the obstacle is raised, and of the latter alone.
    """
    document, slope = STUDIES[kind]
    scenario = crinoid.Scenario.from_dict(document)
    loop, state = crinoid.closed_loop(scenario)
    parameters = crinoid.parameters(scenario)
    rows, axes = state.motion.velocity, scenario.arm.dimension
    along = jnp.linspace(0.0, 1.0, len(rows))[:, None] ** 2
    thrown = 0.005 * along * jnp.arange(1.0, rows.shape[1] + 1)
    thrown = thrown.at[:, axes:].set(0.0).at[-1].set(0.0)

    def loss(factors, raised):
        varied = parameters
        for where, factor in zip(FACTORS.values(), factors, strict=False):
            varied = eqx.tree_at(where, varied, factor * where(varied))
        motion = state.motion
        moved = eqx.tree_at(
            lambda m: (m.position, m.velocity),
            motion,
            (motion.position.at[-1, axes - 1].add(raised), motion.velocity + factors[-1] * thrown),
        )
        closed = crinoid.with_parameters(loop, varied)
        start = replace(state, motion=moved, gap=acting(closed.system).gaps(moved.position))
        run = crinoid.rollout(closed, start, STEPS, observe=observed)
        gap, seen = run.kept
        effort = jnp.sum(jnp.diff(seen.command, axis=0) ** 2)
        value = jnp.sum(seen.error**2) + effort + run.end.state.position[-1, 0]
        return value, (value, jnp.min(gap))

    def observed(loop, now):
        return jnp.min(now.state.gap), glance(loop, now)

    # one program for the loss and its slopes
    found = eqx.filter_jit(slope(loss, has_aux=True), compiler_options=QUICKLY)
    return found, cache(lambda raised: found(jnp.ones(len(NAMES)), jnp.asarray(raised)))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("touches", [True, False], ids=["in contact", "without contact"])
@pytest.mark.parametrize("kind", ["plane", pytest.param("space", marks=pytest.mark.release)])
def test_slopes_are_those_of_central_differences(kind, name, touches):
    at, usually = studied(kind)
    usual, raised = jnp.ones(len(NAMES)), 0.0 if touches else 0.3
    found, (_, gap) = usually(raised)
    assert (gap < SKIN * 0.0175) == touches
    which = NAMES.index(name)
    h = 10 * H if name == "throw" else H  # which is felt least
    values = {
        times: float(at(usual.at[which].add(times * h), jnp.asarray(raised))[1][0])
        for times in (-2, -1, 1, 2)
    }
    difference = (8 * (values[1] - values[-1]) - (values[2] - values[-2])) / (12 * h)
    assert abs(found[which]) > 1e-6
    np.testing.assert_allclose(found[which], difference, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["plane", pytest.param("space", marks=pytest.mark.release)])
def test_nothing_is_a_number_after_a_failed_step(kind):
    # it starts with an obstacle pressed into the arm, which throws it away too fast for the steps
    slopes, (value, gap) = studied(kind)[1](-0.002)
    assert np.isnan(value)
    assert np.isnan(gap)
    assert np.isnan(slopes).all()


CALM = {
    "arm": {"nodes": 4},
    "base": {"tilt_deg": 10.0, "channels": {"tilt": {}}},
    "flow": [{"kind": "uniform", "velocity": [0.3, 0.1], "ramp_time": 0.1}],
    "control": GAINS | {"pid": {"tilt": {"kp": 0.3, "ki": 1.0, "kd": 0.02}}, "compare": False},
    "simulation": {"duration": 0.23, "time_step": 0.01, "start": "rest"},
    "output": {"interval": 0.01},
}


@pytest.fixture(scope="module")
def calm():
    scenario = crinoid.Scenario.from_dict(CALM)
    loop, state = crinoid.closed_loop(scenario)
    run = eqx.filter_jit(crinoid.rollout, compiler_options=QUICKLY)
    return scenario, loop, state, run


@pytest.mark.slow
def test_a_rollout_is_a_simulation(calm):
    scenario, loop, state, run = calm
    result = crinoid.simulate(scenario).dataset
    found = run(loop, state, 23)
    assert found.converged
    assert int(found.end.steps) == 23
    np.testing.assert_allclose(found.kept.time, result["time"][1:], rtol=1e-12)
    np.testing.assert_allclose(found.kept.tip[:, :2], result["tip_position"][1:], rtol=1e-12)
    np.testing.assert_allclose(found.kept.command[:, :3], result["base_command"][1:], atol=1e-12)
    error = np.linalg.norm(found.kept.error[:, :2], axis=1)
    np.testing.assert_allclose(error, result["tip_error"][1:], atol=1e-12)
    # and from where it ended it goes on
    part = run(loop, run(loop, state, 12).end, 11)
    np.testing.assert_allclose(part.kept.tip, found.kept.tip[12:], rtol=1e-12)


@pytest.mark.slow
def test_a_rollout_ends_at_the_first_step_that_fails(calm):
    _, loop, state, run = calm
    wild = eqx.tree_at(lambda s: s.motion.velocity, state, state.motion.velocity.at[-1].set(1e6))
    found = run(loop, wild, 12)
    assert not found.converged
    assert int(found.end.steps) == 0
    assert found.outcome.reason != Reason.NONE
    kept = (found.kept, found.end.state, found.end.command)
    numbers = jax.tree.leaves(eqx.filter(kept, eqx.is_inexact_array))
    assert numbers
    for array in numbers:
        assert np.isnan(array).all()


def test_rollouts_without_steps_are_refused(calm):
    _, loop, state, _ = calm
    with pytest.raises(ValueError, match="got 0; must be at least 1"):
        crinoid.rollout(loop, state, 0)
