"""The balance of forces: its tangent is exact, Newton's method quadratic, its failures told."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.dynamics.tangent_assembly import assemble_tangent
from crinoid.elements import (
    AddedMass,
    Bend,
    DistributedLoad,
    Drag,
    Inertia,
    Stretch,
    TipLoad,
    Weight,
)
from crinoid.flow import LogarithmicShear, PowerShear, Uniform
from helpers.arms import acting, always, arm, dense, only
from helpers.newton_steps import assert_converges_quadratically, motion_of

NODES = 11
EDGE = 0.1
"""Length of an edge (m)."""
LINEAR = (Inertia, Weight)
NONLINEAR = (Stretch, Bend, Drag, AddedMass, DistributedLoad, TipLoad)


def everything():
    """Build an arm on which every element acts, in water that moves differently everywhere."""
    heights = jnp.asarray(2.0), jnp.asarray(-5.0)
    return arm(
        nodes=NODES,
        EA=50.0,
        EI=0.05,
        mass_per_length=1.2,
        diameter=0.04,
        displaced_area=1.1e-3,
        rest_curvature=0.8,
        damping_time=0.03,
        tilt=0.3,
        gravity=9.81,
        water_density=1000.0,
        drag_tangential=0.1,
        added_mass_tangential=0.2,
        linear_drag=0.5,
        loads=(
            lambda rod: DistributedLoad.of(rod, tangential=0.4, normal=-0.7, fixed=(0.2, 0.1)),
            lambda rod: TipLoad.of(
                rod, dead_force=(0.1, -0.2), follower_force=(0.3, 0.4), moment=0.05
            ),
        ),
        flows=(
            Uniform(always(), jnp.asarray([0.3, -0.1])),
            # an upward part makes the shear felt as an acceleration
            PowerShear(always(), jnp.asarray([0.4, 0.1]), *heights, jnp.asarray(0.3)),
            LogarithmicShear(always(), jnp.asarray([-0.2, 0.15]), *heights, jnp.asarray(0.01)),
        ),
    )


def stage_of_a_step(turn=None, step=0.02):
    """Make an arm that is bent, stretched and moving, in the middle of a time step."""
    rng = np.random.default_rng(3)
    turns = rng.uniform(-0.4, 0.4, NODES)
    if turn is not None:
        turns[NODES // 2] = turn
    angles = 0.3 + np.cumsum(turns)
    lengths = EDGE * rng.uniform(0.9, 1.1, NODES)
    edges = lengths[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    position = np.concatenate([np.zeros((1, 2)), np.cumsum(edges, axis=0)])
    velocity, acceleration = rng.normal(size=(2, NODES + 1, 2))
    # rates of the trapezoid rule
    return StepMap(
        *map(jnp.asarray, (1.0, position, velocity, acceleration, 1.0, 2 / step, 4 / step**2))
    )


@eqx.filter_jit
def residuals(forces, stage, corrections, load_factor=None):
    """Return the imbalance of the nodes for a batch of corrections."""

    def imbalance(correction):
        return forces.residual(motion_of(forces, stage, correction)[0], load_factor)[0]

    return jax.vmap(imbalance)(corrections)


@eqx.filter_jit
def tangent(forces, stage, load_factor):
    return assemble_tangent(
        forces, stage, *motion_of(forces, stage, 0 * stage.position), load_factor
    ).bands


@pytest.mark.parametrize("turn", [None, *np.deg2rad([170.0, -170.0])], ids=["bent", "up", "down"])
@pytest.mark.parametrize("load_factor", [1.0, 0.3])
def test_tangent_is_the_slope_of_the_residual(turn, load_factor):
    forces, stage, size = acting(everything()), stage_of_a_step(turn), 2 * (NODES + 1)
    h = 1e-5
    steps = h * np.array([-2.0, -1.0, 1.0, 2.0])[:, None, None] * np.eye(size)
    corrections = jnp.asarray(steps.reshape(-1, NODES + 1, 2))
    factor = jnp.asarray(load_factor)
    far_behind, behind, ahead, far_ahead = np.asarray(
        residuals(forces, stage, corrections, factor)
    ).reshape(4, size, NODES + 1, 2)
    # central differences of order 4: the relative truncation is that of h over the edges (or over
    # the width of the fold, 0.2 times that) to the fourth, below 1e-12
    difference = (far_behind - 8 * behind + 8 * ahead - far_ahead) / (12 * h)
    expected = np.moveaxis(difference, 0, -1).reshape(NODES + 1, 2, NODES + 1, 2)
    got = dense(tangent(forces, stage, factor))
    assert np.isfinite(got).all()
    row = np.abs(got).max(axis=(2, 3), keepdims=True)
    np.testing.assert_allclose(got / row, expected / row, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "kinds",
    [*((kind,) for kind in LINEAR + NONLINEAR), LINEAR + NONLINEAR],
    ids=lambda kinds: kinds[0].__name__ if len(kinds) == 1 else "all",
)
def test_newton_converges_quadratically(kinds):
    forces, stage = only(acting(everything()), Inertia, *kinds), stage_of_a_step()
    off = np.zeros((NODES + 1, 2))
    off[BOUNDARY_NODES:] = EDGE / 20 * np.random.default_rng(4).uniform(-1, 1, (NODES - 1, 2))
    linear = len(kinds) == 1 and kinds[0] in LINEAR
    assert_converges_quadratically(forces, stage, off, linear=linear, least=1e-11)


step = eqx.filter_jit(
    lambda system, state, command, length=None: system.step(state, command, length)
)
STILL = jnp.zeros(3)


@eqx.filter_jit
def march(system, commands, forgets=False):
    """Return the state after steps from rest, and their outcomes."""

    def step(state, given):
        after, outcome = system.step(state, given)
        if forgets:
            after = eqx.tree_at(lambda s: s.reused_tangent.contraction, after, jnp.ones(()))
        return after, outcome

    return jax.lax.scan(step, system.rest(), commands)


def fine(system):
    """Make steps of a tenth of the usual length, balanced to 1e-8."""
    return eqx.tree_at(
        lambda s: (s.time_step, s.settings.tolerance),
        system,
        (0.1 * system.time_step, jnp.asarray(1e-8)),
    )


@pytest.fixture(scope="module")
def system():
    return arm(nodes=NODES, EA=50.0, EI=0.05, gravity=9.81)


@pytest.fixture(scope="module")
def state(system):
    return system.rest()


def test_convergence_is_told(system, state):
    new, outcome = step(system, state, STILL)
    assert outcome.converged
    assert 1 <= outcome.iterations < 8
    floor = float(new.reused_tangent.floor.max())
    assert outcome.residual <= system.settings.tolerance * outcome.scale + floor
    assert outcome.scale > 0
    assert new.time == system.time_step


def test_too_few_iterations_are_told(system, state):
    # a tip that is thrown at 50 m/s moves five edges in one step
    thrown = eqx.tree_at(
        lambda s: s.motion.velocity, state, state.velocity.at[-1].set([30.0, 40.0])
    )
    hurried = eqx.tree_at(lambda s: s.settings.max_iterations, system, jnp.asarray(1))
    _, outcome = step(hurried, thrown, STILL)
    assert not outcome.converged
    assert outcome.iterations == 1
    assert outcome.residual > system.settings.tolerance * outcome.scale + 1e-9
    # counted from the root: it is at the thrown end
    assert NODES - 3 <= outcome.worst_node <= NODES - 1


@pytest.mark.release
def test_an_arm_of_many_nodes_is_solved_for_while_commands_jerk_its_base():
    # silicone, 4 cm thick; nodes next to the base that stay behind would bend by more than can be
    limits = [[-0.3] * 3, [0.3] * 3, [0.5, 0.5, 3.0], [3.0, 3.0, 35.0], [10.0] * 3]
    slim = arm(
        nodes=81,
        length=0.5,
        EA=600.0,
        EI=0.06,
        mass_per_length=1.3,
        damping_time=0.02,
        tilt=-0.8,
        gravity=1.0,
        limits=limits,
        tolerance=1e-8,
    )
    commands = np.random.default_rng(0).normal(size=(100, 3)) * [0.02, 0.0, 0.1]
    _, outcomes = march(slim, jnp.asarray(commands))
    assert outcomes.converged.all()
    assert outcomes.iterations.mean() < 3.2


@pytest.mark.release
def test_the_tangent_of_an_earlier_step_serves_later_ones(system):
    # swinging down from level, in a step that resolves it
    swinging, given = fine(system), jnp.zeros((200, 3))
    end, outcomes = march(swinging, given)
    anew, alone = march(swinging, given, forgets=True)
    assert outcomes.converged.all()
    # a tangent at each step leaves less than is asked for; one that is kept takes the same path
    assert float(outcomes.residual.max()) <= 1e-8 * float(outcomes.scale.max())
    moved = np.abs(end.position - swinging.rest().position).max()
    assert moved > 0.2
    np.testing.assert_allclose(end.position, anew.position, atol=1e-7 * moved)
    assert outcomes.iterations.sum() > alone.iterations.sum() > 0


@pytest.mark.slow
@pytest.mark.parametrize("entry", [1e-5, 1.0, 1e3, 1e150, np.nan])
def test_a_kept_tangent_that_misleads_is_found_out(system, entry):
    swinging = fine(system)
    state, _ = march(swinging, jnp.zeros((6, 3)))
    misled = eqx.tree_at(
        lambda s: s.reused_tangent.tangent,
        state,
        jax.tree.map(lambda x: jnp.full_like(x, entry), state.reused_tangent.tangent),
    )
    expected, usual = step(swinging, state, STILL)
    after, outcome = step(swinging, misled, STILL)
    assert usual.converged
    assert outcome.converged
    assert outcome.iterations > usual.iterations  # so it was used
    np.testing.assert_allclose(after.position, expected.position, atol=1e-9)
    for leaf in jax.tree.leaves(after):
        assert np.isfinite(leaf).all()
    # it is of no use to a step of another length, and not used there
    shorter = 0.5 * swinging.time_step
    expected, _ = step(swinging, state, STILL, shorter)
    after, outcome = step(swinging, misled, STILL, shorter)
    assert outcome.iterations > 0
    np.testing.assert_array_equal(after.position, expected.position)


@pytest.mark.parametrize("node", [2, 6, NODES])
@pytest.mark.parametrize("part", ["position", "velocity"])
def test_what_is_not_a_number_is_never_accepted(system, state, part, node):
    rows = getattr(state, part).at[node, 1].set(jnp.nan)
    broken = eqx.tree_at(lambda s: getattr(s.motion, part), state, rows)
    _, outcome = step(system, broken, STILL)
    assert not outcome.converged
    assert not np.isfinite(outcome.residual)
    # node 0 of the arrays is the ghost behind the root; windows span at most two nodes either way
    assert abs(outcome.worst_node - (node - 1)) <= 2
    # nor is a command
    _, outcome = step(system, state, STILL.at[2].set(jnp.nan))
    assert not outcome.converged


@pytest.mark.parametrize(
    "changed",
    [{}, {"EA": 1e6, "EI": 1e-2}, {"origin": (40.0, -70.0)}],
    ids=["soft", "stiff", "deep"],
)
def test_floor_of_each_node_is_the_round_off_of_its_forces(changed):
    tilted = arm(nodes=NODES, tilt=0.3, **{"EA": 50.0, "EI": 0.05} | changed)
    state = tilted.rest()
    after, outcome = step(tilted, state, jnp.asarray([0.0, 0.0, 0.1]))
    assert outcome.converged
    floor = np.asarray(after.reused_tangent.floor)
    assert (floor[:BOUNDARY_NODES] == 0).all()  # prescribed
    # positions off by their round-off, in any directions
    rng, position = np.random.default_rng(0), np.asarray(state.position)
    off = position * np.finfo(float).eps / 2 * rng.choice([-1.0, 1.0], (200, *position.shape))
    zero = jnp.zeros_like(state.position)
    still = StepMap(jnp.zeros(()), state.position, zero, zero, *[jnp.ones(())] * 3)
    noise = np.asarray(residuals(acting(tilted), still, jnp.asarray(off)))
    noise = np.abs(noise).max(axis=0)[BOUNDARY_NODES:]
    # one near the root, whose coordinates are small, has less than one near the tip
    assert (noise < floor[BOUNDARY_NODES:]).all()
    assert (noise[:-1] > 0.02 * floor[BOUNDARY_NODES:-1]).all()
    assert floor[BOUNDARY_NODES].max() < 0.3 * floor.max()
