"""Friction of tendons: the capstan's closed forms, hysteresis, energy balance, gradients."""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.dynamics import ActingForces, Context, EnergyAccount, System
from crinoid.dynamics.statics import static_stage
from crinoid.elements import WORKS, Threads
from crinoid.elements.threads import Sliding
from crinoid.foundation.fixed_numbers import ADHESION
from helpers.arms import dense, order
from helpers.newton_steps import slopes

LENGTH, OFFSET, FRICTION = 0.5, 0.008, 0.3
EI = 1e5 * np.pi / 4 * 0.02**4
TENSION = 1.5 * EI / (OFFSET * LENGTH)
"""Tension that bends the arm by 1.5 rad without friction (N)."""
WINCH = {"drive": "length", "max_shortening": 0.025, "stiffness": 2e3}
PULL = {"time": [0.0, 15.0, 20.0, 30.0, 35.0], "share": [0.0, 1.0, 1.0, 0.4, 0.4]}
# as many instants as in PULL, so that one program runs them all
HELD = {"time": [0.0, 1.0, 2.0, 3.0, 4.0], "share": [1.0] * 5}
CHUNK = 100
"""Steps of the program that runs an arm."""
both = pytest.mark.parametrize("axes", [2, pytest.param(3, marks=pytest.mark.release)])


def scenario(axes=2, nodes=21, schedule=PULL, **tendon):
    """Return an arm in a vacuum with a tendon in its plane."""
    arm = {"dimension": axes, "nodes": nodes, "length": LENGTH, "damping_time": 0.5}
    if "drive" not in tendon:
        tendon["max_tension"] = TENSION
    usual = {"offset": OFFSET, "friction": FRICTION, "angle_deg": 90.0 * (axes - 2)}
    return crinoid.Scenario(
        arm=arm | {"youngs_modulus": 1e5, "radius": 0.02},
        water={"density": 0.0, "gravity": 0.0},
        tendon=[usual | {"schedule": schedule} | tendon],
    )


class Track(NamedTuple):
    """What a run leaves behind at the end of each step."""

    angle: np.ndarray
    """Turn of the tip (rad)."""
    tension: np.ndarray
    """At the root end (N)."""
    path: np.ndarray
    """Of the tendon (m)."""
    energy: np.ndarray
    work: np.ndarray
    converged: np.ndarray


def memory_of(system, state):
    (found,) = (
        held
        for each, held in zip(system.forces.elements, state.memory, strict=True)
        if isinstance(each, Threads)
    )
    return found


@eqx.filter_jit
def _begin(system):
    state = system.rest()
    return state, EnergyAccount.of(system.forces, state)


@eqx.filter_jit
def _track(system, start, step):
    command = jnp.zeros(len(system.inputs))

    def tick(carry, _):
        state, account, progress = system.advance_with_account(*carry, command, step)
        tip, line = system.tip(state), state.motion.line
        found = Track(
            tip[-1] if tip.size == 3 else jnp.arctan2(tip[-1], tip[-3]),
            state.actuators[0].drive[0] * TENSION if line is None else line[0],
            jnp.sum(memory_of(system, state).path),
            jnp.sum(system.energy(state)),
            account.work,
            progress.outcome.converged,
        )
        return (state, account), found

    return jax.lax.scan(tick, start, None, length=CHUNK)


def track(described, until, step):
    system = crinoid.system(described)
    carry, parts = _begin(system), []
    steps = round(until / step)
    assert steps % CHUNK == 0
    for _ in range(steps // CHUNK):
        carry, found = _track(system, carry, jnp.asarray(step, float))
        assert found.converged.all()
        parts.append(jax.tree.map(np.asarray, found))
    return jax.tree.map(lambda *each: np.concatenate(each), *parts)


def pulled(tension):
    """Return the turn of the tip under a tension that has risen: tension T / (1 + mu k s)."""
    return np.log(1 + FRICTION * OFFSET * tension * LENGTH / EI) / FRICTION


def paid_out(tension):
    """Return the turn of the tip once all of the tendon has been paid out: T / (1 - mu k s)."""
    return -np.log(1 - FRICTION * OFFSET * tension * LENGTH / EI) / FRICTION


@pytest.mark.slow
def test_pulling_and_paying_out_bend_by_the_capstan():
    # in the plane: the validation case tendon-friction
    found = track(scenario(3), 35.0, 0.05)
    assert found.angle[399] == pytest.approx(pulled(TENSION), rel=0.02)
    assert found.angle[-1] == pytest.approx(paid_out(0.4 * TENSION), rel=0.02)
    # at the same tension the arm is bent more while it is paid out
    assert found.angle[-1] > 1.15 * pulled(0.4 * TENSION)


def with_friction(parameters, friction):
    """Return the system of an arm whose first tendon has another friction."""
    threads = parameters.actuator[0]
    changed = threads.friction.at[0].set(friction)
    threads = eqx.tree_at(lambda t: t.friction, threads, changed)
    return crinoid.assemble(eqx.tree_at(lambda p: p.actuator, parameters, (threads,)))


def with_slopes(function, at, weights):
    """Return value, slope, weighted slope backward, and what else a function returns.

    All in one program; backward only where there are weights.
    """
    if weights is None:
        value, slope, more = jax.jvp(function, (at,), (jnp.ones(()),), has_aux=True)
        return value, slope, None, more
    value, forward, more = jax.linearize(function, at, has_aux=True)
    (back,) = jax.linear_transpose(forward, at)(weights)
    return value, forward(jnp.ones(())), back, more


_found = eqx.filter_jit(System.find_equilibrium)


def _at_rest(parameters, friction):
    """Return the turn of the tip in equilibrium, and that equilibrium."""
    system = with_friction(parameters, friction)
    state, found = system.find_equilibrium()
    tip = system.tip(state)
    angle = tip[-1] if tip.size == 3 else jnp.arctan2(tip[-1], tip[-3])
    return angle, (state, EnergyAccount.of(system.forces, state), found.converged)


@eqx.filter_jit
def _at_rest_with_slopes(parameters, friction):
    """Return the turn of the tip in equilibrium, its slope both ways, and that equilibrium."""
    return with_slopes(partial(_at_rest, parameters), friction, jnp.ones(()))


@pytest.mark.release
def test_an_equilibrium_is_that_of_a_tendon_that_was_pulled():
    # its slope by friction: in the plane, below
    described = scenario(3, schedule=HELD)
    parameters = crinoid.parameters(described)
    turn, (*begun, converged) = eqx.filter_jit(_at_rest)(parameters, jnp.asarray(FRICTION, float))
    assert converged
    assert float(turn) == pytest.approx(pulled(TENSION), rel=0.01)
    # a run that starts there stays there
    later, found = _track(crinoid.system(described), tuple(begun), jnp.asarray(0.05, float))
    assert found.converged.all()
    np.testing.assert_allclose(later[0].position, begun[0].position, atol=1e-5 * LENGTH)


@pytest.mark.slow
def test_a_free_body_far_away_leaves_an_equilibrium_as_it_is():
    described = scenario(nodes=6, schedule=HELD)
    ball = {"kind": "sphere", "position": [1.0, -20.0], "radius": 0.05, "mass": 0.5}
    found = []
    for each in (described, described.with_values({"obstacle": [ball]})):
        state, outcome = _found(crinoid.system(each))
        assert outcome.converged
        found.append(np.asarray(state.position))
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-9 * LENGTH)


def opposed(pretension, EA):
    """Return a planar arm on whose other side a second tendon has a pretension."""
    described = scenario(2, schedule=HELD).with_values({"arm.section.EA": EA})
    other = {"offset": OFFSET, "angle_deg": 180.0, "friction": FRICTION, "max_tension": 1.0}
    first = described.tendon[0].model_dump(exclude_unset=True)
    return described.with_values({"tendon": [first, other | {"pretension": pretension}]})


@pytest.fixture(scope="module")
def rested():
    """Return a function of friction, pretension and EA: one program for all equilibria."""

    def found(friction, pretension=0.0, EA=1e5 * np.pi * 0.02**2):
        described = opposed(pretension, EA)
        parameters = crinoid.parameters(described)
        *turn, (state, _, converged) = _at_rest_with_slopes(
            parameters, jnp.asarray(friction, float)
        )
        assert converged
        return turn, memory_of(crinoid.system(described), state)

    return found


@pytest.mark.release
def test_the_slope_of_an_equilibrium_by_friction(rested):
    (turn, slope, back), _ = rested(FRICTION)
    assert float(turn) == pytest.approx(pulled(TENSION), rel=0.01)
    ends = [rested(FRICTION + d)[0][0] for d in (1e-4, -1e-4)]
    assert float(slope) == pytest.approx(float(ends[0] - ends[1]) / 2e-4, rel=1e-5)
    assert float(back) == pytest.approx(float(slope), rel=1e-9)


@pytest.mark.release
def test_in_an_equilibrium_a_tendon_that_others_lengthen_was_paid_out(rested):
    # the tension of the antagonist rises toward the tip; a softer arm would shorten both
    _, memory = rested(FRICTION, pretension=0.05 * TENSION, EA=1e4)
    assert np.asarray(memory.factor)[5:, 0].max() < 1.0
    assert np.asarray(memory.factor)[5:, 1].min() > 1.0


@pytest.mark.release
def test_part_of_a_tendon_slides_back_first():
    # from the root as far as T_1 / (1 - mu k s) meets T_0 / (1 + mu k s); the rest sticks
    share = 0.8
    schedule = PULL | {"share": [0.0, 1.0, 1.0, share, share]}
    found = track(scenario(schedule=schedule), 35.0, 0.05)
    bent = FRICTION * OFFSET * TENSION / EI
    meets = (1 / share - 1) / (2 * bent)
    expected = np.log((1 + bent * LENGTH) / (1 + bent * meets) / (1 - bent * share * meets))
    assert 0 < meets < 0.5 * LENGTH
    assert found.angle[-1] == pytest.approx(expected / FRICTION, rel=0.02)


@pytest.mark.release
def test_a_tendon_that_sticks_is_stable_on_a_soft_arm_with_little_damping():
    # a plain lag of friction feeds energy here
    still = {"arm.damping_time": 0.01}
    schedule = {"time": [0.0, 15.0, 30.0, 40.0, 50.0], "share": [0.0, 1.0, 0.0, 0.0, 0.0]}
    lost = []
    for step in (0.1, 0.025):
        found = track(scenario(schedule=schedule).with_values(still), 30.0, step)
        middle = 0.5 * (found.tension[1:] + found.tension[:-1])
        drawn = -np.sum(middle * np.diff(found.path))
        lost.append(drawn - found.work[-1, WORKS.index("actuation")])
    assert lost[0] == pytest.approx(lost[1], rel=0.02)


@pytest.mark.release
@pytest.mark.parametrize(("damping_time", "coarse"), [(0.5, 1.0), (0.002, 0.55)])
def test_the_error_is_of_first_order_once_a_step_slides_less_than_friction_needs(
    damping_time, coarse
):
    # longer steps turn friction round within one, where an arm that vibrates converges more slowly
    schedule = {"time": [0.0, 0.5, 1.0, 2.0, 3.0], "share": [0.0, 1.0, 0.2, 0.2, 0.2]}
    described = scenario(schedule=schedule).with_values({"arm.damping_time": damping_time})
    steps = 1e-2 / 2 ** np.arange(5)
    runs = {step: track(described, 1.0, step) for step in (*steps, 1e-2 / 2**6)}
    *tracks, exact = (
        run.angle[round(0.1 / step) - 1 :: round(0.1 / step)] for step, run in runs.items()
    )
    errors = [np.sqrt(np.mean((each - exact) ** 2)) for each in tracks]
    found = order(errors)
    assert found[0] == pytest.approx(coarse, abs=0.1)
    # that of the last is a little more: the reference has an error too
    assert found[2:] == pytest.approx([1.0, 1.15], abs=0.15)
    slides = {
        step: np.abs(np.diff(run.path)).max() / (ADHESION * LENGTH) for step, run in runs.items()
    }
    assert slides[steps[0]] > 2.0
    assert slides[steps[3]] < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("tendon", [{}, WINCH], ids=["tension", "length"])
def test_friction_dissipates_and_the_balance_closes(tendon):
    schedule = {"time": [0.0, 10.0, 20.0, 30.0, 40.0], "share": [0.0, 1.0, 0.0, 0.0, 0.0]}
    defects = []
    for step in (0.1, 0.05):
        found = track(scenario(schedule=schedule, **tendon), 20.0, step)
        acted = found.work[:, WORKS.index("actuation")]
        defects.append(np.abs(found.energy - found.work.sum(axis=1)).max())
        middle = 0.5 * (found.tension[1:] + found.tension[:-1])
        drawn = -np.cumsum(middle * np.diff(found.path))
        lost = drawn - (acted[1:] - acted[0])
        assert lost[-1] > 0.1 * drawn.max()
        # where it turns back, what adhesion stores returns
        returned = np.maximum.accumulate(lost) - lost
        assert returned.max() < 0.1 * lost[-1]
    assert defects[0] < 1e-3 * np.abs(acted).max()
    assert defects[0] / defects[1] > 3.5


@pytest.mark.release
def test_a_winch_draws_by_the_tension_at_the_root():
    schedule = {"time": [0.0, 15.0, 20.0, 30.0, 40.0], "share": [0.0, 1.0, 1.0, 1.0, 1.0]}
    found = track(scenario(schedule=schedule, **WINCH), 20.0, 0.05)
    assert found.angle[-1] > 0.5
    assert found.angle[-1] == pytest.approx(pulled(found.tension[-1]), rel=0.02)
    # the tendon stretches by its mean tension
    free, turn = LENGTH - WINCH["max_shortening"], found.angle[-1] * FRICTION
    mean = found.tension[-1] * turn / np.expm1(turn)
    expected = free * (1 + 5e-5 + mean / WINCH["stiffness"])
    assert found.path[-1] == pytest.approx(expected, rel=1e-4)


@both
@pytest.mark.release
def test_the_tangent_is_the_slope_of_the_force(axes):
    winch = WINCH | {"offset": 0.006, "friction": 0.5, "schedule": PULL}
    described = scenario(axes, 6)
    tendons = [described.tendon[0].model_dump(exclude_unset=True), winch]
    system = crinoid.system(described.with_values({"tendon": tendons}))
    state = system.rest()
    noise = np.random.default_rng(0).standard_normal((2, *state.motion.position.shape))
    stage = static_stage(jnp.zeros(()), state.motion.position + 0.01 * noise[0], state.frames, 1e3)
    memory = tuple(
        held
        if not isinstance(held, Sliding)
        else held._replace(direction=0.3 * jnp.ones_like(held.wrap), wrap=held.wrap + 0.2)
        for held in state.memory
    )
    # of the tendons alone, which compiles faster
    (at,) = (k for k, each in enumerate(system.forces.elements) if isinstance(each, Threads))
    lone = replace(system.forces, elements=(system.forces.elements[at],))
    context = Context(jnp.array([0.7, 0.9]), (memory[at],), jnp.asarray(0.1))
    bands, (pull, follow), slope = slopes(ActingForces.of(lone, context), stage)
    got = dense(bands) + np.einsum("nbl,lmc->nbmc", pull, follow)
    largest = np.abs(slope).max(axis=(2, 3), keepdims=True) + np.finfo(float).tiny
    np.testing.assert_allclose(got / largest, slope / largest, rtol=0, atol=1e-11)


@eqx.filter_jit
def _tip(parameters, friction, weights=None):
    """Return the tip after 40 steps, with its slopes."""

    def tip(friction):
        system = with_friction(parameters, friction)
        command = jnp.zeros(len(system.inputs))

        def once(state, _):
            return system.step(state, command)[0], None

        return jax.lax.scan(once, system.rest(), length=40)[0].position[-1], ()

    return with_slopes(tip, friction, weights)


QUICK = {"time": [0.0, 0.5, 1.0], "share": [0.0, 1.0, 0.2]}
WEIGHTS = jnp.array([1.0, -0.7])
"""Of the coordinates of the tip in the slope backward, in the plane alone."""


def quick(axes, **tendon):
    described = scenario(axes, 6, QUICK, **tendon).with_values({"simulation.time_step": 0.02})
    return crinoid.parameters(described)


@pytest.mark.slow
@both
def test_gradient_of_the_tip_by_friction(axes):
    weights = WEIGHTS if axes == 2 else None
    parameters = quick(axes)
    _, slope, back, _ = _tip(parameters, jnp.asarray(FRICTION, float), weights)
    ends = [_tip(parameters, jnp.asarray(FRICTION + d, float), weights)[0] for d in (1e-5, -1e-5)]
    difference = (ends[0] - ends[1]) / 2e-5
    scale = np.abs(difference).max()
    assert scale > 1e-3
    np.testing.assert_allclose(slope, difference, atol=1e-5 * scale)
    if axes == 2:
        np.testing.assert_allclose(back, weights @ slope, atol=1e-9 * scale)


@pytest.mark.release
def test_friction_of_0_is_none():
    system = crinoid.system(scenario(2, 6, QUICK, friction=0.0))
    assert memory_of(system, system.rest()) is None
    smooth, rough = quick(2, friction=0.0), quick(2)
    none = jnp.zeros(())
    expected, *_ = _tip(smooth, none)
    found, *_ = _tip(rough, none, WEIGHTS)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    rubbing, *_ = _tip(rough, jnp.asarray(FRICTION, float), WEIGHTS)
    assert np.abs(rubbing - expected).max() > 1e-6


@pytest.mark.release
@both
def test_the_path_turns_with_the_arm_and_its_winding(axes):
    rest = {"rest_curvature": 2.0 if axes == 2 else [0.0, 2.0, 0.0]}
    wound = {} if axes == 2 else {"twist_deg": 360.0}
    for shape, tendon, expected in [
        (rest, {"offset": [0.0, 0.004]}, 2.0 * LENGTH),
        ({}, wound, _helix(np.radians(wound.get("twist_deg", 0.0)) / LENGTH)),
    ]:
        changes = {f"arm.{key}": value for key, value in shape.items()}
        system = crinoid.system(scenario(axes, 41, **tendon).with_values(changes))
        wrap = np.asarray(memory_of(system, system.rest()).wrap).sum()
        # the last half edge does not bend
        assert wrap == pytest.approx(expected, rel=0.02, abs=1e-9)


def _helix(rate):
    """Return by how much a helix about the straight arm turns over its length (rad)."""
    return OFFSET * rate**2 / np.sqrt(1 + (OFFSET * rate) ** 2) * LENGTH
