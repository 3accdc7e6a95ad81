"""Base and chambers share the work: the static Jacobian of all inputs, and their limits."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import lsq_linear

import crinoid
from crinoid.assembly.controller import build_controller
from crinoid.assembly.plan import Plan
from crinoid.assembly.prepared import Prepared
from crinoid.control import Allocation, Seen
from crinoid.control.target import Target
from crinoid.dynamics.influence import Influence
from crinoid.products import product
from crinoid.simulation.response import Plant

SHARE = 0.3
CHAMBERS = {
    2: [
        {"name": "root", "span": [0.0, 0.5], "pair": True},
        {"name": "tip", "span": [0.5, 1.0], "angle_deg": 180.0},
    ],
    3: [{"name": name, "angle_deg": a} for name, a in (("a", 90.0), ("b", 210.0), ("c", 330.0))],
}
GAINS = {"kp": 0.4, "ki": 3.0}


def scenario(axes, control=None, **pid):
    ends = {"offset": 0.01, "area": 2e-4, "max_pressure": 5e4}
    schedule = {"time": [0.0, 1.0], "share": [0.0, 0.0]}
    return crinoid.Scenario.from_dict(
        {
            "arm": {"dimension": axes, "nodes": 6, "radius": 0.02, "youngs_modulus": 2e5},
            "base": {"tilt_deg": 20.0, "channels": {"slide": {"range": [-0.1, 0.1]}, "tilt": {}}},
            "chamber": [ends | each | {"schedule": schedule} for each in CHAMBERS[axes]],
            "control": {"kind": "pid", "pid": pid or {"slide": GAINS}} | (control or {}),
        }
    )


# --- the static Jacobian --------------------------------------------------------------------------


@eqx.filter_jit
def _answers(system, shares):
    def settled(share):
        values = jnp.broadcast_to(share[:, None], (share.size, 2))
        driven = eqx.tree_at(lambda s: s.actuators[0].values, system, values)
        state, outcome = driven.find_equilibrium()
        small = driven.small_motions(state, jnp.zeros(driven.forces.axes))
        return driven.tip(state), driven.influence(state), small, outcome.converged

    return jax.lax.map(settled, shares)


@pytest.fixture(scope="module", params=[2, 3])
def answers(request):
    """Return tips, influences and small motions: as it is, with each share changed, and empty."""
    axes, by = request.param, 1e-4
    system = crinoid.system(scenario(axes))
    count = len(CHAMBERS[axes])
    ways = np.concatenate([np.eye(count), -np.eye(count)])
    points = np.concatenate([np.full((1, count), SHARE) + by * 0, SHARE + by * ways])
    empty = np.concatenate([np.zeros((1, count)), by * np.eye(count), 2 * by * np.eye(count)])
    tips, influence, small, converged = _answers(system, jnp.asarray([*points, *empty]))
    assert np.all(converged)
    return np.asarray(tips), influence, small, count, by


def test_chambers_move_the_tip_as_the_static_jacobian_says(answers):
    tips, influence, small, count, by = answers
    at = jax.tree.map(lambda x: x[0], (influence, small.stiffness))
    found = np.asarray(jax.jit(Influence.static)(*at))[:, -count:]
    expected = (tips[1 : 1 + count] - tips[1 + count : 1 + 2 * count]).T / (2 * by)
    np.testing.assert_allclose(found, expected, rtol=2e-5, atol=2e-7)
    assert np.abs(expected).max() > 0.05


def test_an_empty_chamber_has_the_slope_of_filling_it(answers):
    tips, influence, small, count, by = answers
    first = 1 + 2 * count
    at = jax.tree.map(lambda x: x[first], (influence, small.stiffness))
    found = np.asarray(jax.jit(Influence.static)(*at))[:, -count:]
    none, once, twice = tips[first], tips[first + 1 :][:count], tips[first + 1 + count :]
    expected = (4 * once - 3 * none - twice).T / (2 * by)  # one-sided, of second order
    if count == 2:  # a pair has a slope to either side: bending has the same, stretch the other
        expected[:, 0] = found[:, 0]
        assert abs(found[1, 0] / found[0, 0]) > 1
    np.testing.assert_allclose(found, expected, rtol=2e-4, atol=2e-6)


def test_the_slow_response_is_the_static_jacobian(answers):
    _, influence, small, *_ = answers
    at, stiffness, damping, mass = jax.tree.map(
        lambda x: np.asarray(x[0]),
        (influence, small.stiffness, small.damping_in_current, small.mass),
    )
    (slow,) = Plant(stiffness, damping, mass, at).response(np.array([1e-5]))
    static = np.asarray(jax.jit(Influence.static)(at, stiffness))
    np.testing.assert_allclose(slow.real, static, rtol=1e-6, atol=5e-8)
    assert slow.shape[1] == static.shape[1] == at.held.shape[2] + at.loads.shape[2]


# --- sharing --------------------------------------------------------------------------------------


def shared(seed=0, inputs=5):
    rng = np.random.default_rng(seed)
    jacobian = np.zeros((3, inputs))
    jacobian[:2] = rng.normal(size=(2, inputs))
    weight = rng.uniform(0.3, 3.0, inputs)
    allocation = Allocation.of(jacobian, np.ones(3), weight, np.zeros(inputs))
    return allocation, jacobian, weight, rng


def test_what_is_spare_moves_nothing_and_is_all_that_does_not():
    allocation, jacobian, weight, _ = shared()
    spare = np.asarray(allocation.spare)
    np.testing.assert_allclose(jacobian @ spare, 0.0, atol=1e-12)
    np.testing.assert_allclose(spare @ spare, spare, atol=1e-12)
    assert np.linalg.matrix_rank(spare) == 3
    # commands over their weights are taken away at right angles to what moves the tip
    np.testing.assert_allclose(
        spare / weight[:, None] * weight, (spare / weight[:, None] * weight).T, atol=1e-12
    )


within = jax.jit(jax.vmap(Allocation.within, (None, 0, None, None)))


def test_others_take_over_what_a_limit_keeps_an_input_from():
    allocation, jacobian, weight, rng = shared()
    lower, upper = -weight, np.full(5, 0.8)
    commands = 0.5 * weight * rng.normal(size=(200, 5))
    held = np.asarray(within(allocation, *map(jnp.asarray, (commands, lower, upper))))
    assert np.all((held >= lower) & (held <= upper))
    inside = np.all((commands >= lower) & (commands <= upper), axis=1)
    np.testing.assert_allclose(held[inside], commands[inside], atol=1e-12)
    assert 20 < np.sum(~inside) < 180
    wanted = commands @ jacobian.T
    missed = np.linalg.norm(held @ jacobian.T - wanted, axis=1)
    clipped = np.clip(commands, lower, upper)
    cut = np.linalg.norm(clipped @ jacobian.T - wanted, axis=1)
    least = np.array(
        [np.sqrt(2 * lsq_linear(jacobian[:2], w[:2], (lower, upper)).cost) for w in wanted]
    )
    assert np.all(missed <= cut + 1e-12)
    possible = least < 1e-6
    # where it can be done it is done, but for a few that take more rounds than there are
    assert np.mean(missed[possible & ~inside] < 2e-3 * cut[possible & ~inside]) > 0.8


def test_commands_that_nothing_is_left_for_are_cut_off():
    allocation, *_ = shared()
    limit = jnp.full(5, 1e-3)
    held = within(allocation, jnp.full((1, 5), 1e6), -limit, limit)
    np.testing.assert_allclose(held[0], limit)


def plan(described, jacobian):
    prepared = Prepared(described)
    system = prepared.system
    state = jax.eval_shape(system.rest)  # nobody looks at it
    return Plan(described, prepared.parameters, system, state, jnp.asarray(jacobian))


JACOBIAN = np.array(
    [[1.0, 0.0, -0.2, 0.02, 0.01], [0.0, 1.0, 0.4, 0.1, 0.05], [0.0, 0.0, 1.0, 0.5, 0.4]]
)
"""How x, z and the angle follow slide, heave, tilt and the chambers root and tip."""
DRIVEN = ["slide", "tilt", "root", "tip"]
ROWS = [0, 2, 3, 4]


def test_the_mapping_is_the_least_of_weighted_commands():
    names, weights = DRIVEN, {"root": 4.0, "tilt": 0.5}
    described = scenario(2, **dict.fromkeys(names, GAINS))
    found = plan(described, JACOBIAN).mapping(names, weights)
    weight = np.diag([1.0, 0.5, 4.0, 1.0])
    expected = weight @ np.linalg.pinv(JACOBIAN[:2, ROWS] @ weight)
    np.testing.assert_allclose(found[ROWS, :2], expected, rtol=1e-12)
    np.testing.assert_array_equal(found[:, 2], 0.0)  # the angle is not controlled
    np.testing.assert_array_equal(found[1], 0.0)  # nor is heave driven
    assert plan(described, JACOBIAN).allocation(["slide", "tilt"]) is None
    assert plan(described, JACOBIAN).allocation(names) is not None


@pytest.mark.parametrize("weights", [{"slide": 1e-3}, {"root": 1e3}, {"slide": 1e-3, "tip": 1e3}])
def test_however_unlike_the_weights_an_error_is_undone(weights):
    described = scenario(2, **dict.fromkeys(DRIVEN, GAINS))
    found = plan(described, JACOBIAN).mapping(DRIVEN, weights)
    np.testing.assert_allclose(JACOBIAN[:2] @ found[:, :2], np.eye(2), atol=1e-9)


def run(described, wanted, calls=2000):
    """Let a PID move a tip that follows its commands at once as ``JACOBIAN`` says."""
    made = plan(described, JACOBIAN)
    controller, inputs = build_controller(made), made.inputs
    lower, upper = (
        jnp.stack([getattr(each, side) for each in inputs]) for side in ("lower", "upper")
    )
    wanted, rows = jnp.asarray(wanted), jnp.asarray(JACOBIAN)

    def seen(command):
        tip, none = product(rows, command), jnp.zeros(5)
        target = Target(wanted, None, ())
        time = jnp.zeros(())
        return Seen(
            time, tip, time, wanted, none, target, jnp.zeros(3), command, (), lower, upper, {}
        )

    def call(carry, _):
        memory, command = carry
        command, memory = controller.command(memory, seen(command))
        return (memory, command), command

    none = jnp.zeros(5)
    begin = controller.start(seen(none)), none
    commands = jax.jit(lambda: jax.lax.scan(call, begin, None, length=calls)[1])()
    return np.asarray(commands), np.asarray(upper)


def every(**changes):
    return scenario(2, **{name: GAINS | changes.get(name, {}) for name in DRIVEN})


def test_a_limit_that_is_met_leaves_no_error_where_others_can_help():
    # the slide's share would be beyond its 0.1 m
    commands, upper = run(every(slide={"weight": 10.0}), [0.125, -0.05, 0.0])
    np.testing.assert_allclose(JACOBIAN[:2] @ commands[-1], [0.125, -0.05], atol=1e-6)
    assert commands[:, 0].max() == pytest.approx(upper[0])


def test_an_error_beyond_all_limits_does_not_wind_up():
    far, _ = run(every(), [9.0, 0.0, 0.0], calls=4000)
    near, _ = run(every(), [9.0, 0.0, 0.0], calls=400)
    np.testing.assert_allclose(far[-1], near[-1], atol=1e-3)


def test_an_input_goes_back_to_rest_while_the_tip_stays():
    wanted = [0.03, 0.02, 0.0]
    kept, _ = run(every(root={"weight": 20.0}, tip={"weight": 20.0}), wanted)
    assert np.all(np.abs(kept[-1, 3:]) > 0.02)
    hand_over = {"weight": 20.0, "return_time": 2.0}
    commands, _ = run(every(root=hand_over, tip=hand_over), wanted, calls=4000)
    np.testing.assert_allclose(commands[-1, 3:], 0.0, atol=1e-4)
    alone = np.linalg.solve(JACOBIAN[:2, [0, 2]], wanted[:2])
    np.testing.assert_allclose(commands[-1, [0, 2]], alone, atol=1e-4)
    # fast: at first the chambers do most; later the tip stays where it is while they let go
    tips = commands @ JACOBIAN[:2].T
    assert np.abs(tips[400:] - wanted[:2]).max() < 2e-4
    np.testing.assert_allclose(commands[30, 3:], kept[30, 3:], rtol=0.2)


def test_an_input_may_go_back_at_once():
    hand_over = {"weight": 20.0, "return_time": 1e-9}
    commands, _ = run(every(root=hand_over, tip=hand_over), [0.03, 0.02, 0.0])
    np.testing.assert_allclose(JACOBIAN[:2] @ commands[-1], [0.03, 0.02], atol=1e-6)
    np.testing.assert_allclose(commands[-1, 3:], 0.0, atol=1e-6)


# --- mistakes -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("control", "pid", "line"),
    [
        (
            {},
            {"rot": {}},
            'control.pid.rot: drives an input that is not there, takes "slide", "heave", "tilt", '
            '"root" or "tip"',
        ),
        (
            {},
            {"root": {"weight": 0.0}},
            "control.pid.root.weight: got 0.0, takes a number from 0.001 to 1000",
        ),
        (
            {},
            {"root": {"weight": 1e12}},
            "control.pid.root.weight: got 1000000000000.0, takes a number from 0.001 to 1000",
        ),
        (
            {},
            {"root": {"wieght": 2.0}},
            "control.pid.root.wieght: unknown key; did you mean control.pid.root.weight?",
        ),
        ({}, {"root": 3.0}, "control.pid.root: got 3.0, takes a table"),
        (
            {"mapping": "identity", "controlled": ["x"]},
            {"slide": {}, "root": {}},
            "control.pid.root: bends the arm, which goes with no one coordinate; mapping = "
            '"identity" takes slide, heave, tilt',
        ),
    ],
)
def test_a_mistake_is_told_in_one_line(control, pid, line):
    with pytest.raises(crinoid.ScenarioError) as caught:
        scenario(2, control, **pid)
    assert str(caught.value) == line


@pytest.mark.parametrize(("key", "value"), [("return_time", 3.0), ("weight", 2.0)])
def test_there_must_be_one_to_share_with(key, value):
    described = scenario(2, slide=GAINS, root=GAINS | {key: value})
    with pytest.raises(crinoid.ScenarioError) as caught:
        build_controller(plan(described, JACOBIAN))
    assert str(caught.value) == (
        f"control.pid.root.{key}: got {value}, goes with more inputs than it takes for what is "
        "controlled"
    )


def test_a_slack_tendon_is_told_to_be_made_taut():
    described = scenario(2)
    winch = {"name": "winch", "drive": "length", "offset": 0.01, "max_shortening": 0.01}
    described = described.with_values(
        {"tendon": [winch | {"stiffness": 1e4}], "control.pid.winch": GAINS}
    )
    slack = np.concatenate([JACOBIAN, np.zeros((3, 1))], axis=1)
    with pytest.raises(crinoid.ScenarioError) as caught:
        build_controller(plan(described, slack))
    assert str(caught.value) == (
        "control.pid.winch: does nothing: nothing of the tip that is controlled follows winch from "
        "the start; takes an input that moves it, a tendon that its schedule makes taut"
    )
