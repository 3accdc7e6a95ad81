"""Friction of tendons: the capstan's closed forms, hysteresis, energy balance, gradients."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.dynamics import EnergyAccount, System
from crinoid.dynamics.statics import static_stage
from crinoid.elements import WORKS, Threads
from crinoid.elements.threads import Sliding
from helpers.arms import dense, only
from helpers.newton_steps import slopes

LENGTH, OFFSET, FRICTION = 0.5, 0.008, 0.3
EI = 1e5 * np.pi / 4 * 0.02**4
TENSION = 1.5 * EI / (OFFSET * LENGTH)
"""Tension that bends the arm by 1.5 rad without friction (N)."""
WINCH = {"drive": "length", "max_shortening": 0.025, "stiffness": 2e3}
PULL = {"time": [0.0, 15.0, 20.0, 30.0, 35.0], "share": [0.0, 1.0, 1.0, 0.4, 0.4]}
both = pytest.mark.parametrize("axes", [2, 3])


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


_rest = eqx.filter_jit(System.rest)


@eqx.filter_jit
def _track(system, step, steps):
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

    state = system.rest()
    start = state, EnergyAccount.of(system.forces, state)
    return jax.lax.scan(tick, start, None, length=steps)[1]


def track(described, until, step):
    found = _track(crinoid.system(described), jnp.asarray(step), round(until / step))
    assert found.converged.all()
    return jax.tree.map(np.asarray, found)


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


@eqx.filter_jit
def _turn_at_rest(parameters, friction):
    """Return the turn of the tip in equilibrium, and whether there is one."""
    threads = eqx.tree_at(lambda t: t.friction, parameters.actuator[0], friction[None])
    system = crinoid.assemble(eqx.tree_at(lambda p: p.actuator, parameters, (threads,)))
    state, found = system.find_equilibrium()
    tip = system.tip(state)
    return tip[-1] if tip.size == 3 else jnp.arctan2(tip[-1], tip[-3]), (state, found.converged)


HELD = {"time": [0.0, 1.0], "share": [1.0, 1.0]}


@both
@pytest.mark.slow
def test_an_equilibrium_is_that_of_a_tendon_that_was_pulled(axes):
    described = scenario(axes, schedule=HELD)
    parameters = crinoid.parameters(described)
    turn, (state, converged) = _turn_at_rest(parameters, jnp.asarray(FRICTION))
    assert converged
    assert float(turn) == pytest.approx(pulled(TENSION), rel=0.01)
    # from the law in closed form; the mesh has the rest
    slope = eqx.filter_jit(jax.jacfwd(lambda mu: _turn_at_rest(parameters, mu)[0]))(
        jnp.asarray(FRICTION)
    )
    ends = [_turn_at_rest(parameters, jnp.asarray(FRICTION + d))[0] for d in (1e-4, -1e-4)]
    assert float(slope) == pytest.approx(float(ends[0] - ends[1]) / 2e-4, rel=1e-5)
    if axes == 2:
        back = eqx.filter_jit(jax.jacrev(lambda mu: _turn_at_rest(parameters, mu)[0]))
        assert float(back(jnp.asarray(FRICTION))) == pytest.approx(float(slope), rel=1e-9)
    # a run that starts there stays there
    system = crinoid.system(described)
    step = eqx.filter_jit(lambda s: system.step(s, jnp.zeros(len(system.inputs)), 0.05)[0])
    later = state
    for _ in range(5):
        later = step(later)
    np.testing.assert_allclose(later.position, state.position, atol=1e-5 * LENGTH)


@pytest.mark.slow
def test_in_an_equilibrium_a_tendon_that_others_lengthen_was_paid_out():
    # the tension of the antagonist rises toward the tip; a softer arm would shorten both
    described = scenario(2, schedule=HELD).with_values({"arm.section.EA": 1e4})
    tendons = [described.tendon[0].model_dump(exclude_unset=True)]
    tendons.append({"offset": OFFSET, "angle_deg": 180.0, "friction": 0.3, "max_tension": 1.0})
    tendons[1]["pretension"] = 0.05 * TENSION
    system = crinoid.system(described.with_values({"tendon": tendons}))
    state, found = eqx.filter_jit(System.find_equilibrium)(system)
    memory = memory_of(system, state)
    assert found.converged
    assert np.asarray(memory.factor)[5:, 0].max() < 1.0
    assert np.asarray(memory.factor)[5:, 1].min() > 1.0


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_tendon_that_sticks_is_stable_on_a_soft_arm_with_little_damping():
    # a plain lag of friction feeds energy here
    still = {"arm.damping_time": 0.01}
    schedule = {"time": [0.0, 15.0, 30.0], "share": [0.0, 1.0, 0.0]}
    lost = []
    for step in (0.1, 0.025):
        found = track(scenario(schedule=schedule).with_values(still), 30.0, step)
        middle = 0.5 * (found.tension[1:] + found.tension[:-1])
        drawn = -np.sum(middle * np.diff(found.path))
        lost.append(drawn - found.work[-1, WORKS.index("actuation")])
    assert lost[0] == pytest.approx(lost[1], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("tendon", [{}, WINCH], ids=["tension", "length"])
def test_friction_dissipates_and_the_balance_closes(tendon):
    schedule = {"time": [0.0, 10.0, 20.0], "share": [0.0, 1.0, 0.0]}
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


@pytest.mark.slow
def test_a_winch_draws_by_the_tension_at_the_root():
    schedule = {"time": [0.0, 15.0, 20.0], "share": [0.0, 1.0, 1.0]}
    found = track(scenario(schedule=schedule, **WINCH), 20.0, 0.05)
    assert found.angle[-1] > 0.5
    assert found.angle[-1] == pytest.approx(pulled(found.tension[-1]), rel=0.02)
    # the tendon stretches by its mean tension
    free, turn = LENGTH - WINCH["max_shortening"], found.angle[-1] * FRICTION
    mean = found.tension[-1] * turn / np.expm1(turn)
    expected = free * (1 + 5e-5 + mean / WINCH["stiffness"])
    assert found.path[-1] == pytest.approx(expected, rel=1e-4)


@both
@pytest.mark.slow
def test_the_tangent_by_hand_is_the_slope_of_the_force(axes):
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
    forces = system.forces.driven(jnp.array([0.7, 0.9])).remembering(memory, 0.1)
    forces = only(forces, Threads)
    bands, (pull, follow), slope = slopes(forces, stage)
    got = dense(bands) + np.einsum("nbl,lmc->nbmc", pull, follow)
    largest = np.abs(slope).max(axis=(2, 3), keepdims=True) + np.finfo(float).tiny
    np.testing.assert_allclose(got / largest, slope / largest, rtol=0, atol=1e-11)


@eqx.filter_jit
def _tip(parameters, friction, steps):
    threads = eqx.tree_at(lambda t: t.friction, parameters.actuator[0], friction[None])
    system = crinoid.assemble(eqx.tree_at(lambda p: p.actuator, parameters, (threads,)))
    command = jnp.zeros(len(system.inputs))

    def run(state):
        return jax.lax.scan(lambda s, _: (system.step(s, command)[0], None), state, None, steps)[0]

    return run(system.rest()).position[-1]


QUICK = {"time": [0.0, 0.5, 1.0], "share": [0.0, 1.0, 0.2]}


@pytest.mark.slow
@both
def test_gradient_of_the_tip_by_friction(axes):
    parameters = crinoid.parameters(
        scenario(axes, 6, QUICK).with_values({"simulation.time_step": 0.02})
    )
    tip = partial(_tip, parameters, steps=40)
    friction, ends = jnp.asarray(FRICTION), []
    slope = eqx.filter_jit(jax.jacfwd(tip))(friction)
    for sign in (1, -1):
        ends.append(tip(friction + sign * 1e-5))
    difference = (ends[0] - ends[1]) / 2e-5
    scale = np.abs(difference).max()
    assert scale > 1e-3
    np.testing.assert_allclose(slope, difference, atol=1e-5 * scale)
    if axes == 2:
        back = eqx.filter_jit(jax.jacrev(tip))(friction)
        np.testing.assert_allclose(back, slope, atol=1e-9 * scale)


@pytest.mark.slow
def test_friction_of_0_is_none():
    described = scenario(2, 6, QUICK)
    smooth = described.with_values({"tendon.0.friction": 0.0})
    without = crinoid.parameters(smooth)
    system = crinoid.assemble(without)
    assert memory_of(system, _rest(system)) is None
    expected = _tip(without, jnp.zeros(()), 20)
    found = _tip(crinoid.parameters(described), jnp.zeros(()), 20)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    rubbing = _tip(crinoid.parameters(described), jnp.asarray(FRICTION), 20)
    assert np.abs(rubbing - expected).max() > 1e-6


@pytest.mark.slow
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
        wrap = np.asarray(memory_of(system, _rest(system)).wrap).sum()
        # the last half edge does not bend
        assert wrap == pytest.approx(expected, rel=0.02, abs=1e-9)


def _helix(rate):
    """Return by how much a helix about the straight arm turns over its length (rad)."""
    return OFFSET * rate**2 / np.sqrt(1 + (OFFSET * rate) ** 2) * LENGTH
