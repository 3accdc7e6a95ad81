"""The tool that is taken up at one touch and let go at another."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.dynamics import GripState
from crinoid.elements import Motion, Tool
from crinoid.results.result import Result
from crinoid.rod import Rod
from crinoid.simulation import play
from helpers.arms import QUICKLY, acting

pytestmark = pytest.mark.slow

TOOL = {"mass": 0.1, "inertia": 1e-4, "offset": 0.02, "take_at_touch": 0, "drop_at_touch": 1}


def scenario(axes=2, *, touch=(), above=-9.955, below=-10.045, time_step=0.002, **tables):
    """Describe an arm that its base lifts against a ball, and then lowers onto another."""

    def at(x, z):
        return [x, z] if axes == 2 else [x, 0.0, z]

    heave = {"channel": "heave", "kind": "sine", "amplitude": 0.03, "frequency_hz": 1.0}
    balls = [
        {"kind": "sphere", "radius": 0.02, "position": at(0.49, height)}
        for height in (above, below)
    ]
    described = {
        "arm": {"nodes": 5, "length": 0.5, "youngs_modulus": 2e5, "dimension": axes},
        "water": {"gravity": 0.0},
        "base": {"position": at(0.0, -10.0), "motion": [heave]},
        "obstacle": balls,
        "tool": TOOL | dict(touch),
        "simulation": {"duration": 0.2, "time_step": time_step, "start": "rest"},
        "output": {"interval": 0.01},
    }
    return crinoid.Scenario(**described | tables)


# --- when it is held -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def obstacles():
    return crinoid.system(scenario()).forces.obstacles


TIP, ROOT, BOTH = [[1, 1, 1, 0], [1, 1, 1, 1]], [[0, 1, 1, 1], [1, 1, 1, 1]], [[1, 1, 1, 0]] * 2
OTHER, NONE = [[1, 1, 1, 1], [1, 1, 1, 0]], [[1, 1, 1, 1]] * 2
"""Which edges are clear of the two balls."""


@pytest.mark.parametrize(
    ("tool", "touches", "held"),
    [
        # from the end of the step in which contact began, whatever is touched later on
        ({}, [NONE, TIP, NONE, TIP, OTHER, TIP, NONE], [0, 0, 1, 1, 1, 0, 0]),
        # the root is not the tip, unless it is to count as well
        ({}, [NONE, ROOT, NONE, TIP, NONE, OTHER, NONE], [0, 0, 0, 0, 1, 1, 0]),
        ({"touch_span": [0, 1]}, [NONE, ROOT, *[NONE] * 3, OTHER, NONE], [0, 0, 1, 1, 1, 1, 0]),
        # what is touched already counts when its time comes
        ({"from": 2.0}, [NONE, TIP, TIP, TIP, TIP, NONE, NONE], [0, 0, 0, 1, 1, 1, 1]),
        # a step at least between the two
        ({}, [NONE, BOTH, BOTH, BOTH, BOTH, NONE, NONE], [0, 0, 1, 0, 0, 0, 0]),
        # the other ball does not matter before; the time lets it go at the latest
        ({"until": 4.0}, [NONE, OTHER, TIP, NONE, NONE, OTHER, NONE], [0, 0, 0, 1, 0, 0, 0]),
        ({"until": 4.0}, [NONE, OTHER, NONE, NONE, NONE, TIP, TIP], [0, 0, 0, 0, 0, 0, 0]),
        ({"until": 5.0, "drop_at_touch": None}, [NONE, TIP, *[OTHER] * 5], [0, 0, 1, 1, 1, 0, 0]),
        ({"from": 1.0, "take_at_touch": None}, [OTHER, NONE, NONE, OTHER] + [NONE] * 3,
         [0, 1, 1, 1, 0, 0, 0]),
        ({"from": 1.0, "take_at_touch": None, "until": 3.0}, [NONE] * 7, [0, 1, 1, 0, 0, 0, 0]),
    ],
)  # fmt: skip
def test_touches_take_it_up_and_let_it_go(obstacles, tool, touches, held):
    tool = {key: value for key, value in (TOOL | tool).items() if value is not None}
    parameters = crinoid.parameters(scenario(tool=tool)).tool
    grasp, found = parameters.grasp(), []
    grip = grasp.begin()
    for second, clear in enumerate(touches):
        # a state has the grip of its own balance, the step from it what its touches make of that
        found.append(int(grip.held.whole(float(second))[0]))
        grip = grasp.after(
            obstacles, grip, 0.01 * jnp.asarray(clear, float), jnp.asarray(1.0 * second)
        )
    assert found == held


def test_of_many_arms_each_has_its_own(obstacles):
    grasp = crinoid.parameters(scenario()).tool.grasp()
    gaps, time = 0.01 * jnp.array([NONE, TIP, OTHER], float), jnp.array([1.0, 2.0, 3.0])

    def after(gaps, time):
        return grasp.after(obstacles, grasp.begin(), gaps, time)

    grips = jax.vmap(after)(gaps, time)
    np.testing.assert_array_equal(grips.taken, [np.inf, 2.0, np.inf])


@pytest.mark.parametrize("found", [(np.inf, np.inf), (1.0, np.inf), (1.0, 2.0)])
def test_times_that_are_not_known_yet_have_no_slope_and_spoil_none(found):
    rod = Rod.round(length=0.4, nodes=3, radius=0.01, density=1e3, youngs_modulus=1e5)
    place, still = jnp.array([[0.2, 0.0], [0.4, 0.1]]), jnp.zeros((2, 2))
    time = jnp.asarray(1.5)
    motion = Motion(place, still, still + 2.0, still, still, time)

    @jax.jit
    def pull(mass, taken, dropped):
        tool = Tool.of(rod, mass=mass, held=GripState(taken, dropped).held)
        return jnp.sum(jax.tree.map(lambda x: x[0], tool).residual(motion)[:, 0])

    inputs = (jnp.asarray(0.3), *map(jnp.asarray, found))
    expected = (2.0 if found == (1.0, np.inf) or found == (1.0, 2.0) else 0.0, 0.0, 0.0)
    assert jax.grad(pull, (0, 1, 2))(*inputs) == pytest.approx(expected)
    assert jax.jacfwd(pull, (0, 1, 2))(*inputs) == pytest.approx(expected)


# --- in a run ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def result():
    return crinoid.simulate(scenario())


def times(result):
    """Return when the tool was taken up and let go."""
    return [float(result.checkpoint[f"state.grip.{name}"]) for name in ("taken", "dropped")]


@pytest.mark.slow
def test_a_run_tells_when_it_was_taken_up_and_let_go(result):
    taken, dropped = times(result)
    assert 0 < taken < dropped < 0.2
    assert result.dataset.attrs["notes"].splitlines()[-2:] == [
        f"the tip took the tool at t = {taken:.6g} s, when it touched obstacle 0",
        f"the tip released the tool at t = {dropped:.6g} s, when it touched obstacle 1",
    ]
    time, held = result.dataset["time"].values, result.dataset["tool_held"].values
    np.testing.assert_array_equal(held, (time > taken + 1e-9) & (time < dropped + 1e-9))
    # contact began in the step that ends then
    touched = result.dataset["contact_time"].values[time < taken]
    np.testing.assert_array_equal(touched, 0.0)


@pytest.mark.slow
def test_the_ledger_closes_and_the_tool_works_while_it_is_held(result):
    energy = result.dataset["energy"]
    stored = energy.sel(kind=["kinetic", "elastic", "potential"]).sum("kind")
    works = energy.sum("kind") - stored
    worked = energy.sel(kind="tool").values
    assert np.abs(worked).max() > 1e-4
    assert float(np.abs(stored - stored[0] - works).max()) < 1e-3 * np.abs(worked).max()
    taken, dropped = times(result)
    time = result.dataset["time"].values
    np.testing.assert_array_equal(worked[time <= taken], 0.0)
    np.testing.assert_array_equal(np.diff(worked[time >= dropped]), 0.0)


def test_what_is_not_touched_is_not_taken_up(result):
    # the same arm, without what it could touch
    away = crinoid.simulate(scenario(above=-9.8, below=-10.2))
    assert away.dataset.attrs["notes"].splitlines() == [
        "the tip never took the tool: obstacle 0 did not touch the part [0.9, 1.0] of the arm"
    ]
    assert not away.dataset["tool_held"].any()
    assert not away.dataset["energy"].sel(kind="tool").any()
    # it is let go at a time, as nothing else is touched
    kept = crinoid.simulate(scenario(below=-10.2, touch={"until": 0.15}))
    assert kept.dataset.attrs["notes"].splitlines()[-1] == (
        "no touch released the tool: obstacle 1 did not touch the part [0.9, 1.0] of the arm "
        "while the tip had it"
    )
    held = kept.dataset["time"].where(kept.dataset["tool_held"] > 0, drop=True)
    assert times(kept)[1] == 0.15
    assert float(held[-1]) == pytest.approx(0.14)


@pytest.mark.parametrize("until", [0.01, 0.06, 0.15])
def test_a_run_goes_on_as_if_it_had_not_stopped(result, tmp_path, until):
    part = crinoid.simulate(scenario().with_values({"simulation.duration": until}))
    # before it is taken up, while it is held, and after
    taken, dropped = times(result)
    assert (until < taken) + 2 * (taken < until < dropped) + 3 * (dropped < until) == {
        0.01: 1,
        0.06: 2,
        0.15: 3,
    }[until]
    part.save(tmp_path)
    whole = play(Prepared(scenario()), resume=Result.load(tmp_path))
    for name in ("position", "tool_held", "energy"):
        np.testing.assert_array_equal(whole.dataset[name], result.dataset[name], name)
    assert whole.dataset.attrs["notes"] == result.dataset.attrs["notes"]


@pytest.mark.release
def test_in_space_it_moves_as_if_the_times_had_been_known_before():
    parameters = crinoid.parameters(scenario(3, time_step=0.001))

    @eqx.filter_jit(compiler_options=QUICKLY)
    def march(parameters, grip):
        system = crinoid.assemble(parameters)
        state = eqx.tree_at(lambda s: s.grip, system.rest(), grip)

        def one(state, _):
            after, _ = system.step(state, jnp.zeros(len(system.inputs)))
            has = acting(system, after.context).arm.tool_factor(after.time)
            return after, (after.time, after.position[-1], after.velocity[-1], after.grip, has)

        return jax.lax.scan(one, state, length=120)[1]

    never = parameters.tool.grasp().begin()
    time, tip, velocity, grips, has = march(parameters, never)
    taken, dropped = float(grips.taken[-1]), float(grips.dropped[-1])
    np.testing.assert_array_equal(has, (time > taken + 1e-9) & (time < dropped + 1e-9))
    assert 20 < np.sum(has) < 80
    # it comes moving as the tip does: what changes in a step is the acceleration
    change, at = np.linalg.norm(np.diff(velocity, axis=0), axis=1), int(np.argmax(has))
    assert change[at - 1] < 2 * change[at - 5 : at + 5].mean()
    # known a moment after the step in which contact began, it is there in the same steps
    known = jax.tree.map(lambda times: times[-1] + 1e-7, grips)
    np.testing.assert_array_equal(march(parameters, known)[1], tip)
    # and without it the arm goes another way
    away = parameters.obstacle.position.at[0, 2].add(0.1)
    off = eqx.tree_at(lambda p: p.obstacle.position, parameters, away)
    assert np.abs(march(off, never)[1] - tip).max() > 1e-4


# --- its table -----------------------------------------------------------------------------------


MISTAKES = {
    "tool.take_at_touch: got 2; must be at most 1, the index of the last [[obstacle]]": {
        "take_at_touch": 2
    },
    "tool.drop_at_touch: got -1; must be the index of an obstacle, 0 for the first": {
        "drop_at_touch": -1
    },
    "tool.drop_at_touch: got 0; must differ from take_at_touch. The arm still touches that "
    "obstacle when it has the tool.": {"drop_at_touch": 0},
    "tool.touch_span: got [0.9, 0.5]; must be [a, b] with 0 <= a < b <= 1": {
        "touch_span": [0.9, 0.5]
    },
    "tool.drop_at_touch: got 1; must be at most 0, the index of the last [[obstacle]]": {
        "obstacles": 1
    },
    "tool.take_at_touch: got 0; must be left out without an [[obstacle]]": {
        "obstacles": 0, "drop_at_touch": None
    },
    "tool.touch_span: got [0.5, 1.0]; must be left out without touches. Set take_at_touch or "
    "drop_at_touch to use it.": {
        "touch_span": [0.5, 1.0], "take_at_touch": None, "drop_at_touch": None
    },
}  # fmt: skip


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_gets_one_line(line):
    table = TOOL | MISTAKES[line]
    balls = scenario().to_dict()["obstacle"][: table.pop("obstacles", 2)]
    tool = {key: value for key, value in table.items() if value is not None}
    with pytest.raises(crinoid.ScenarioError, match=f"^{re.escape(line)}$"):
        scenario(obstacle=balls, tool=tool)


def test_without_touches_there_is_nothing_to_decide():
    timed = crinoid.system(scenario(tool={"mass": 0.1}))
    assert timed.grip_triggers is None
    # and before a touch there is no tool
    system = crinoid.system(scenario())
    (tool,) = (each for each in system.forces.elements if isinstance(each, Tool))
    assert not np.any(tool.held.whole(0.0))
    assert not np.any(tool.held.whole(1e3))
