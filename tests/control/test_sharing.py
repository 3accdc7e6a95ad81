"""Base and chambers share the work: the static Jacobian of all inputs, and their limits."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import lsq_linear

import crinoid
from crinoid.assembly.control_loop import build_controller
from crinoid.assembly.plan import AssembledScenario
from crinoid.assembly.prepared import Prepared
from crinoid.control import Allocation, ControllerInput
from crinoid.control.target import Target
from crinoid.dynamics.small_motions import Influence
from crinoid.numerics.small_matrices import product
from crinoid.simulation.frequency_response import Plant
from helpers.refusals import mistake

SHARE = 0.3
CHAMBERS = {
    2: [
        {"name": "root", "span": [0.0, 0.5], "pair": True},
        {"name": "tip", "span": [0.5, 1.0], "angle_deg": 180.0},
    ],
    3: [{"name": name, "angle_deg": a} for name, a in (("a", 90.0), ("b", 210.0), ("c", 330.0))],
}
GAINS = {"kp": 0.4, "ki": 3.0}


def scenario(axes=2, control=None, **pid):
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


static = jax.jit(Influence.static)
BY = 1e-4
"""Change of a chamber's share."""


@pytest.fixture(scope="module", params=[2, 3])
def answers(request):
    """Return tips, influences and small motions: as it is, with each share changed, and empty."""
    count = len(CHAMBERS[request.param])
    one, none = np.eye(count), np.zeros((1, count))
    changes = np.concatenate([none, one, -one])
    empty = np.concatenate([none, one, 2 * one])
    shares = jnp.asarray(np.concatenate([SHARE + BY * changes, BY * empty]))
    tips, influence, small, converged = _answers(crinoid.system(scenario(request.param)), shares)
    assert np.all(converged)
    return np.asarray(tips), influence, small, count


@pytest.mark.slow
def test_chambers_move_the_tip_as_the_static_jacobian_says(answers):
    def slope(at):
        given = jax.tree.map(lambda x: x[at], (influence, small.stiffness))
        return np.asarray(static(*given))[:, -count:]

    tips, influence, small, count = answers
    _, more, less, none, once, twice = np.split(tips, np.cumsum([1, count, count, 1, count]))
    expected = (more - less).T / (2 * BY)
    np.testing.assert_allclose(slope(0), expected, rtol=2e-5, atol=2e-7)
    assert np.abs(expected).max() > 0.05
    # an empty one has the slope of filling it: one-sided, of second order
    expected, empty = (4 * once - 3 * none - twice).T / (2 * BY), slope(1 + 2 * count)
    if count == 2:  # a pair has a slope to either side: bending has the same, stretch the other
        expected[:, 0] = empty[:, 0]
        assert abs(empty[1, 0] / empty[0, 0]) > 1
    np.testing.assert_allclose(empty, expected, rtol=2e-4, atol=2e-6)


@pytest.mark.release
def test_the_slow_response_is_the_static_jacobian(answers):
    _, influence, small, _ = answers
    at, stiffness, damping, mass = jax.tree.map(
        lambda x: np.asarray(x[0]),
        (influence, small.stiffness, small.damping_in_current, small.mass),
    )
    (slow,) = Plant(stiffness, damping, mass, at).response(np.array([1e-5]))
    np.testing.assert_allclose(slow.real, static(at, stiffness), rtol=1e-6, atol=5e-8)
    assert slow.shape[1] == at.held.shape[2] + at.loads.shape[2]


# --- sharing --------------------------------------------------------------------------------------


def shared():
    rng = np.random.default_rng(0)
    jacobian = np.zeros((3, 5))
    jacobian[:2] = rng.normal(size=(2, 5))
    weight = rng.uniform(0.3, 3.0, 5)
    return Allocation.of(jacobian, np.ones(3), weight, np.zeros(5)), jacobian, weight, rng


def test_spare_commands_are_all_those_that_move_nothing():
    allocation, jacobian, weight, _ = shared()
    spare = np.asarray(allocation.spare)
    np.testing.assert_allclose(jacobian @ spare, 0.0, atol=1e-12)
    np.testing.assert_allclose(spare @ spare, spare, atol=1e-12)
    assert np.linalg.matrix_rank(spare) == 3
    # commands over their weights are taken away at right angles to what moves the tip
    weighed = spare / weight[:, None] * weight
    np.testing.assert_allclose(weighed, weighed.T, atol=1e-12)


within = jax.jit(jax.vmap(Allocation.within, (None, 0, None, None)))


def test_others_take_over_what_a_limit_keeps_an_input_from():
    allocation, jacobian, weight, rng = shared()
    lower, upper = -weight, np.full(5, 0.8)
    commands = 0.5 * weight * rng.normal(size=(200, 5))
    held = np.asarray(within(allocation, *map(jnp.asarray, (commands, lower, upper))))
    assert np.all((held >= lower) & (held <= upper))
    clipped, wanted = np.clip(commands, lower, upper), commands @ jacobian.T
    inside = np.all(commands == clipped, axis=1)
    np.testing.assert_allclose(held[inside], commands[inside], atol=1e-12)
    assert 20 < np.sum(~inside) < 180
    missed, cut = (np.linalg.norm(x @ jacobian.T - wanted, axis=1) for x in (held, clipped))
    assert np.all(missed <= cut + 1e-12)
    least = np.array([lsq_linear(jacobian[:2], w[:2], (lower, upper)).cost for w in wanted])
    possible = (np.sqrt(2 * least) < 1e-6) & ~inside
    # where it can be done it is done, but for a few that take more rounds than there are
    assert np.mean(missed[possible] < 2e-3 * cut[possible]) > 0.8
    # commands that nothing is left for are cut off
    limit = jnp.full(5, 1e-3)
    np.testing.assert_allclose(within(allocation, jnp.full((1, 5), 1e6), -limit, limit)[0], limit)


def plan(described, jacobian):
    prepared = Prepared(described)
    system = prepared.system
    state = jax.eval_shape(system.rest)  # nobody looks at it
    tip = jnp.zeros(3)
    return AssembledScenario(
        described,
        prepared.parameters,
        system,
        state,
        jnp.asarray(jacobian),
        prepared.sensors,
        prepared.target(tip),
        prepared.facts.mean_current,
        prepared.recordings,
        prepared.facts.period,
    )


JACOBIAN = np.array(
    [[1.0, 0.0, -0.2, 0.02, 0.01], [0.0, 1.0, 0.4, 0.1, 0.05], [0.0, 0.0, 1.0, 0.5, 0.4]]
)
"""How x, z and the angle follow slide, heave, tilt and the chambers root and tip."""
DRIVEN = ["slide", "tilt", "root", "tip"]
ROWS = [0, 2, 3, 4]


def test_the_mapping_is_the_least_of_weighted_commands():
    made, names = plan(every(), JACOBIAN), DRIVEN
    found = made.mapping(names, {"root": 4.0, "tilt": 0.5})
    weight = np.diag([1.0, 0.5, 4.0, 1.0])
    expected = weight @ np.linalg.pinv(JACOBIAN[:2, ROWS] @ weight)
    np.testing.assert_allclose(found[ROWS, :2], expected, rtol=1e-12)
    np.testing.assert_array_equal(found[:, 2], 0.0)  # the angle is not controlled
    np.testing.assert_array_equal(found[1], 0.0)  # nor is heave driven
    assert made.allocation(["slide", "tilt"]) is None
    assert made.allocation(names) is not None
    # however unlike the weights an error is undone
    for weights in ({"slide": 1e-3}, {"root": 1e3}, {"slide": 1e-3, "tip": 1e3}):
        found = made.mapping(names, weights)
        np.testing.assert_allclose(JACOBIAN[:2] @ found[:, :2], np.eye(2), atol=1e-9)


def run(described, wanted, calls=2000):
    """Let a PID move a tip that follows its commands at once as ``JACOBIAN`` says."""
    made = plan(described, JACOBIAN)
    controller = build_controller(made)
    time, still, none = map(jnp.zeros, ((), 3, 5))
    lower, upper = (
        jnp.stack([getattr(each, side) for each in made.inputs]) for side in ("lower", "upper")
    )
    wanted, rows = jnp.asarray(wanted), jnp.asarray(JACOBIAN)
    target = Target(wanted, None, ())

    def seen(command):
        tip = product(rows, command)
        return ControllerInput(
            time, tip, time, wanted, none, target, still, command, (), lower, upper, {}
        )

    def call(carry, _):
        memory, command = carry
        command, memory = controller.command(memory, seen(command))
        return (memory, command), command

    begin = controller.start(seen(none)), none
    commands = jax.jit(lambda: jax.lax.scan(call, begin, None, length=calls)[1])()
    return np.asarray(commands), np.asarray(upper)


def every(**changes):
    return scenario(**{name: GAINS | changes.get(name, {}) for name in DRIVEN})


def test_a_limit_that_is_met_leaves_no_error_where_others_can_help():
    # the slide's share would be beyond its 0.1 m
    commands, upper = run(every(slide={"weight": 10.0}), [0.125, -0.05, 0.0])
    np.testing.assert_allclose(JACOBIAN[:2] @ commands[-1], [0.125, -0.05], atol=1e-6)
    assert commands[:, 0].max() == pytest.approx(upper[0])


def test_an_error_beyond_all_limits_does_not_wind_up():
    commands, _ = run(every(), [9.0, 0.0, 0.0], calls=4000)
    np.testing.assert_allclose(commands[-1], commands[399], atol=1e-3)


def test_an_input_goes_back_to_rest_while_the_tip_stays():
    def handed_over(calls=2000, **back):
        chambers = {"weight": 20.0} | back
        return run(every(root=chambers, tip=chambers), [*wanted, 0.0], calls)[0]

    wanted = [0.03, 0.02]
    kept = handed_over()
    assert np.all(np.abs(kept[-1, 3:]) > 0.02)
    commands = handed_over(4000, return_time=2.0)
    np.testing.assert_allclose(commands[-1, 3:], 0.0, atol=1e-4)
    alone = np.linalg.solve(JACOBIAN[:2, [0, 2]], wanted)
    np.testing.assert_allclose(commands[-1, [0, 2]], alone, atol=1e-4)
    # fast: at first the chambers do most; later the tip stays where it is while they let go
    assert np.abs(commands[400:] @ JACOBIAN[:2].T - wanted).max() < 2e-4
    np.testing.assert_allclose(commands[30, 3:], kept[30, 3:], rtol=0.2)
    # or at once
    commands = handed_over(return_time=1e-9)
    np.testing.assert_allclose(JACOBIAN[:2] @ commands[-1], wanted, atol=1e-6)
    np.testing.assert_allclose(commands[-1, 3:], 0.0, atol=1e-6)


# --- mistakes -------------------------------------------------------------------------------------


THERE = '"slide", "heave", "tilt", "root" or "tip"'
MISTAKES = {
    f"rot: got a table; must drive {THERE}": {"rot": {}},
    "root.weight: got 0.0; must be a number from 0.001 to 1000": {"root": {"weight": 0.0}},
    "root.weight: got 2000.0; must be a number from 0.001 to 1000": {"root": {"weight": 2e3}},
    "root.wieght: unknown key; did you mean control.pid.root.weight?": {"root": {"wieght": 2.0}},
    "root: got 3.0; must be a table": {"root": 3.0},
    'root: got a table; must be left out with mapping = "identity". It maps to no single '
    'coordinate. Use "slide", "heave" or "tilt".': {"slide": {}, "root": {}},
}


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_refused_in_one_line(line):
    one = {"mapping": "identity", "controlled": ["x"]} if "identity" in line else {}
    assert mistake(scenario, 2, one, **MISTAKES[line]) == f"control.pid.{line}"


@pytest.mark.parametrize(("key", "value"), [("return_time", 3.0), ("weight", 2.0)])
def test_an_input_that_gives_way_needs_others_to_share_with(key, value):
    made = plan(scenario(slide=GAINS, root=GAINS | {key: value}), JACOBIAN)
    assert mistake(build_controller, made) == (
        f"control.pid.root.{key}: got {value}; must be left out unless more inputs are driven "
        "than the controlled coordinates need"
    )


def test_a_slack_tendon_is_refused():
    winch = {"name": "winch", "drive": "length", "offset": 0.01, "max_shortening": 0.01}
    described = scenario().with_values(
        {"tendon": [winch | {"stiffness": 1e4}], "control.pid.winch": GAINS}
    )
    made = plan(described, np.pad(JACOBIAN, ((0, 0), (0, 1))))
    assert mistake(build_controller, made) == (
        "control.pid.winch: does nothing: no controlled coordinate follows winch from the "
        "start. Drive an input that moves the tip, or make the tendon taut by its schedule."
    )
