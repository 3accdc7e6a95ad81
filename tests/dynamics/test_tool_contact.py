"""A tool with a radius: the ball at the tip touches obstacles as the arm does."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.plan import find_state
from crinoid.numerics.frames import moments
from helpers.arms import acting

RADIUS, OFFSET, BALL = 0.025, 0.03, 0.04


def scenario(dimension, *, ball=(0.44, -10.07), **tool):
    """Return an arm whose heavy tool sinks onto a free ball, which lies on the bed."""

    def place(x, z):
        return [x, z] if dimension == 2 else [x, 0.0, z]

    return crinoid.Scenario.from_dict(
        {
            "arm": {
                "dimension": dimension,
                "length": 0.4,
                "nodes": 5,
                "radius": 0.01,
                "density": 1080.0,
                "youngs_modulus": 2e7,
                "damping_time": 0.02,
            },
            "base": {"position": place(0.0, -10.0)},
            "tool": {"mass": 0.2, "volume": 1e-4, "offset": OFFSET, "radius": RADIUS} | tool,
            "obstacle": [
                {
                    "kind": "sphere",
                    "position": place(*ball),
                    "radius": BALL,
                    "mass": 0.3,
                    "friction": 0.3,
                },
                {"kind": "plane", "position": place(0.0, -10.11), "normal": place(0.0, 1.0)},
            ],
            "simulation": {
                "duration": 0.3,
                "time_step": 0.005,
                "start": "rest",
                "tolerance": 1e-12,
            },
        }
    )


def rest(system):
    """Return the arm at rest: by the program of a run, so that it is compiled once."""
    return find_state(system, False)[0]


def touching(dimension):
    """Return a system, and a motion in which the tool presses on the ball and slides on it."""
    system = crinoid.system(scenario(dimension))
    state = rest(system)
    random = np.random.default_rng(dimension)
    forces = acting(system)
    shape = state.motion.velocity.shape
    position = np.array(state.motion.position)
    position[1:6, :dimension] += 0.01 * random.normal(size=(5, dimension))
    tip, before = position[5, :dimension], position[4, :dimension]
    centre = tip + OFFSET * (tip - before) / np.linalg.norm(tip - before)
    ball = forces.rows.obstacles.start
    away = np.array([0.3, 0.5, -0.8])[[0, 2] if dimension == 2 else [0, 1, 2]]
    away /= np.linalg.norm(away)
    position[ball, :dimension] = centre + (RADIUS + BALL + 0.3 * 0.05 * RADIUS) * away
    velocity = 0.1 * random.normal(size=shape)
    motion = replace(state.motion, position=jnp.asarray(position), velocity=jnp.asarray(velocity))
    return forces, motion, away


@eqx.filter_jit
def pushed(forces, motion):
    return forces.obstacles.push(motion, len(forces.nodes(motion.position)), forces.pose)


@pytest.mark.slow
def test_the_ball_presses_and_rubs_without_resultant_or_moment():
    dimension = 3  # a run in the plane is that in space (below)
    forces, motion, away = touching(dimension)
    gap, rows = pushed(forces, motion)
    skin = 0.05 * RADIUS
    assert float(gap[0, -1]) == pytest.approx(0.3 * skin, rel=1e-9)
    rows = np.asarray(rows)
    nodes, count = forces.rows.nodes, forces.obstacles.count
    places = np.asarray(motion.position)[:-count, :dimension]
    force = rows[:-count, :dimension]
    # it touches nothing else
    assert np.abs(rows[:4]).max() == 0.0
    on_ball = rows[forces.rows.obstacles.start, :dimension]
    normal = on_ball @ away
    assert normal > 1.0
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-12 * normal)
    turning = np.asarray(moments(jnp.asarray(places), jnp.asarray(force)))
    moment = turning.sum(axis=0) + rows[forces.rows.rotations].sum(axis=0)[: turning.shape[-1]]
    if dimension == 3:
        edge = places[5] - places[4]
        moment += rows[nodes][5, 3] * edge / np.linalg.norm(edge)
    np.testing.assert_allclose(moment, 0.0, atol=1e-12 * normal)
    # Coulomb's friction where it slides fast
    assert np.linalg.norm(on_ball - normal * away) == pytest.approx(0.3 * normal, rel=1e-3)


@pytest.fixture(scope="module")
def sunk():
    """Return the run in the plane."""
    return crinoid.simulate(scenario(2)).dataset


@pytest.mark.slow
def test_the_tool_rests_on_the_ball_and_not_within(sunk):
    assert sunk.attrs["status"] == "ok"
    assert float(sunk["contact_closest"].min()) > -0.01 * RADIUS
    assert float(sunk["contact_time"].sel(obstacle=0)[-1]) > 0.05
    assert float(np.abs(sunk["contact_force"].sel(obstacle=0)).max()) > 0.1
    # the arm itself is further away than its radius
    tip = sunk["position"].isel(time=-1).values[-1]
    ball = sunk["obstacle_position"].isel(time=-1, obstacle=0).values
    assert np.linalg.norm(tip - ball) > BALL + 0.012


@pytest.mark.release
def test_a_run_in_space_is_that_in_the_plane(sunk):
    space = crinoid.simulate(scenario(3)).dataset
    for name in ("position", "obstacle_position", "contact_force"):
        found = space[name].sel(axis=["x", "z"]).values
        np.testing.assert_allclose(found, sunk[name].values, rtol=0, atol=1e-10)
    np.testing.assert_allclose(space["contact_gap"], sunk["contact_gap"], rtol=0, atol=1e-10)


@pytest.mark.slow
def test_the_gradient_by_the_radius_is_that_of_differences():
    # the ball is within the skin of the tool, where their forces begin
    skin = 0.05 * RADIUS
    below = -10.0 - RADIUS - BALL - 0.9 * skin
    numbers = crinoid.parameters(scenario(2, ball=(0.43, below)))
    system = crinoid.assemble(numbers)
    start, command = rest(system), jnp.zeros(len(system.inputs))
    assert 0.0 < float(start.gap[0, -1]) < skin

    def tip(radius):
        changed = crinoid.assemble(eqx.tree_at(lambda p: p.tool.radius, numbers, radius))

        def tick(state, _):
            state, outcome = changed.step(state, command, 1e-3)
            return state, outcome.converged

        end, good = jax.lax.scan(tick, start, length=3)
        return changed.tip(end)[1], good.all()

    @jax.jit
    def with_slope(radius):
        return jax.jvp(tip, (radius,), (1.0,), has_aux=True)

    found = [with_slope(jnp.asarray(RADIUS + x)) for x in (1e-7, 0.0, -1e-7)]
    (high, _, good), (_, slope, _), (low, _, _) = found
    assert good
    assert abs(slope) > 1e-3
    assert slope == pytest.approx(float(high - low) / 2e-7, rel=1e-5)


@pytest.mark.parametrize("tool", [{"until": 0.1}, {"from": 0.1}, {"take_at_touch": 0}])
def test_a_tool_that_touches_is_held_all_the_time(tool):
    text = r"tool\.radius: got 0\.025; must be left out with from, until and touches"
    with pytest.raises(crinoid.ScenarioError, match=text):
        scenario(2, **tool)


def test_a_tool_within_an_obstacle_is_refused():
    with pytest.raises(crinoid.ScenarioError, match=r"obstacle\.0\.position: overlaps the arm"):
        crinoid.simulate(scenario(2, radius=0.04))
