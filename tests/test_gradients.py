"""Derivatives of equilibria and of motion, in both modes, against central differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.base import SineMotion
from crinoid.dynamics import System
from crinoid.elements import Bend, Drag, Weight
from crinoid.flow import PowerShear
from physics import always, arm

NODES = 11
STEPS = 20
BED = -5.0


def shear():
    return PowerShear(always(), *(jnp.asarray(x, float) for x in ([0.9, 0.0], 1.0 - BED, BED, 2.0)))


def held_at(channel):
    # a swing that stands still: a displacement that tests may set
    nothing = jnp.zeros(())
    return SineMotion(channel, nothing, nothing, jnp.asarray(np.pi / 2))


def bent(**changes):
    """Build an arm that its weight bends down and a shear flow pushes on.

    Soft in stretch, so that round-off (EA/l times 2e-16 = 2e-12 N) lets Newton's method converge
    to 1e-11 N: a central difference over 1e-4 is then good to 1e-7.
    """
    return arm(
        nodes=NODES,
        EA=1e3,
        damping_time=0.01,
        tilt=0.4,
        gravity=2.0,
        water_density=1.0,
        diameter=2.0,
        displaced_area=0.3,
        drag_tangential=0.05,
        flows=(shear(),),
        motions=tuple(held_at(channel) for channel in range(3)),
        time_step=0.02,
        tolerance=1e-13,
        floor=1e-11,
        **changes,
    )


ARM = bent()
PARAMETERS = ("EI", "weight", "flow", "drag", "throw")


def varied(factors):
    """Scale stiffness, weight in water, flow speed and drag of the arm."""
    stiffness, weight, flow, drag = factors

    def scaled(element):
        if isinstance(element, Bend):
            return eqx.tree_at(lambda e: e.stiffness, element, stiffness * element.stiffness)
        if isinstance(element, Weight):
            return eqx.tree_at(lambda e: e.force, element, weight * element.force)
        if isinstance(element, Drag):
            return jax.tree.map(lambda x: drag * x, element)
        return element

    return eqx.tree_at(
        lambda s: (s.forces.elements, s.forces.water.flows[0].reference_velocity),
        ARM,
        (
            tuple(scaled(element) for element in ARM.forces.elements),
            flow * ARM.forces.water.flows[0].reference_velocity,
        ),
    )


def start_and_end(factors, commands):
    """Return the tip in equilibrium, and after the arm was thrown and commanded for 20 steps.

    ``factors``: those of `varied`, then the speed at which the tip is thrown upward.
    """
    system = varied(factors[:4])
    state, found = system.find_equilibrium()
    along = jnp.linspace(0.0, 1.0, NODES)
    throw = factors[4] * jnp.stack([0.0 * along, along**2], axis=1)
    thrown = eqx.tree_at(lambda s: s.velocity, state, state.velocity.at[1:].add(throw))

    def step(state, command):
        state, outcome = system.step(state, command)
        return state, outcome.converged

    end, converged = jax.lax.scan(step, thrown, commands)
    return system.tip(state), system.tip(end), found.converged & jnp.all(converged)


FACTORS = jnp.ones(5)
COMMANDS = jnp.asarray(
    np.random.default_rng(0).uniform(-1, 1, (STEPS, 3)) * np.array([0.05, 0.05, 0.3])
)
run = jax.jit(start_and_end)


def run_accurately(factors, commands):
    start, end, converged = run(factors, commands)
    assert converged
    return np.concatenate([start, end])


@jax.jit
def _both_modes(factors, commands, factors_dot, commands_dot):
    def tips(factors, commands):
        start, end, _ = start_and_end(factors, commands)
        return jnp.concatenate([start, end])

    _, linear = jax.linearize(tips, factors, commands)
    forward = jax.vmap(linear)(factors_dot, commands_dot)
    backward = jax.linear_transpose(linear, factors, commands)
    by_factors, by_commands = jax.vmap(lambda tip: backward(tip))(jnp.eye(6))
    return forward, by_factors, by_commands


# every factor alone, then ways of changing all commands at once
DIRECTIONS = [(np.eye(5)[i], np.zeros((STEPS, 3))) for i in range(5)] + [
    (np.zeros(5), np.random.default_rng(seed).normal(size=(STEPS, 3))) for seed in range(3)
]
NAMES = [*PARAMETERS, "commands-0", "commands-1", "commands-2"]


@pytest.fixture(scope="module")
def derivatives():
    factors_dot, commands_dot = (jnp.asarray(np.stack(d)) for d in zip(*DIRECTIONS, strict=True))
    return jax.tree.map(np.asarray, _both_modes(FACTORS, COMMANDS, factors_dot, commands_dot))


@pytest.mark.parametrize("which", range(len(DIRECTIONS)), ids=NAMES)
def test_derivatives_are_those_of_central_differences(derivatives, which):
    """Of the tip (x, z, angle) in equilibrium, and 20 steps later."""
    forward, by_factors, by_commands = derivatives
    factors_dot, commands_dot = DIRECTIONS[which]
    h = 1e-4
    ahead, behind = (
        run_accurately(FACTORS + s * h * factors_dot, COMMANDS + s * h * commands_dot)
        for s in (1, -1)
    )
    difference = (ahead - behind) / (2 * h)
    start, end = np.abs(difference[:3]).max(), np.abs(difference[3:]).max()
    # throw and commands come after the equilibrium, everything else shifts it
    assert (start > 1e-2) == (which < 4)
    assert end > 1e-2
    scale = np.repeat([max(start, 1e-3), end], 3)
    np.testing.assert_allclose(forward[which] / scale, difference / scale, rtol=0, atol=1e-5)
    # reverse mode: the same numbers but for round-off
    reverse = by_factors @ factors_dot + np.einsum("tij,ij->t", by_commands, commands_dot)
    np.testing.assert_allclose(reverse / scale, forward[which] / scale, rtol=0, atol=1e-9)


def test_a_command_matters_only_after_it_was_given(derivatives):
    _, _, by_commands = derivatives
    np.testing.assert_array_equal(by_commands[:3], 0)
    assert (np.abs(by_commands[3:]).max(axis=(0, 2)) > 0).all()


def test_batched_arms_move_as_they_do_alone():
    # with different stiffness, weight, flow, drag and throw each
    rng = np.random.default_rng(5)
    factors = jnp.asarray(rng.uniform(0.7, 1.3, (3, 5)))
    together = jax.jit(jax.vmap(start_and_end, (0, None)))(factors, COMMANDS)
    assert np.all(together[2])
    for i in range(3):
        alone = run_accurately(factors[i], COMMANDS)
        # both are solved to 1e-11 N, in different orders of summation
        np.testing.assert_allclose(
            np.concatenate([together[0][i], together[1][i]]), alone, rtol=0, atol=1e-10
        )


find = eqx.filter_jit(System.find_equilibrium)


@eqx.filter_jit
def static_jacobian(system, state):
    return system.static_jacobian(state)


def displaced(pose, **changes):
    """Build the arm on a base that stands elsewhere."""
    return eqx.tree_at(
        lambda s: [motion.amplitude for motion in s.base.motions],
        bent(**changes),
        [jnp.asarray(x) for x in pose],
    )


def tip_of(system):
    state, outcome = find(system, jnp.zeros(()))
    assert outcome.converged
    return np.asarray(system.tip(state)), state


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.5)], ids=["at_zero", "displaced"])
def test_static_jacobian_is_how_the_equilibrium_follows_the_base(pose):
    system = displaced(pose)
    _, state = tip_of(system)
    got = np.asarray(static_jacobian(system, state))
    h = 1e-4
    differences = []
    for change in h * np.eye(3):
        ahead, _ = tip_of(displaced(pose + change))
        behind, _ = tip_of(displaced(pose - change))
        differences.append((ahead - behind) / (2 * h))
    expected = np.stack(differences, axis=1)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6)
    # the shear flow is the same all along x, but not at every depth: lifted, the arm bends more
    np.testing.assert_allclose(got[:, 0], [1, 0, 0], rtol=0, atol=1e-9)
    assert np.abs(got[:, 1] - [0, 1, 0]).max() > 1e-2


def test_lifting_the_base_is_lifting_its_origin():
    lifted, _ = tip_of(displaced((0.0, 0.25, 0.0)))
    moved, _ = tip_of(bent(origin=jnp.asarray([0.0, 0.25])))
    np.testing.assert_allclose(lifted, moved, rtol=0, atol=1e-9)


def test_static_jacobian_without_flow_is_rigid_in_translation():
    system = eqx.tree_at(lambda s: s.forces.water.flows[0].reference_velocity, bent(), jnp.zeros(2))
    _, state = tip_of(system)
    got = static_jacobian(system, state)
    np.testing.assert_allclose(got[:, :2], [[1, 0], [0, 1], [0, 0]], rtol=0, atol=1e-9)


def test_command_moves_a_base_at_rest_as_much_as_it_says():
    """Where the servo stands at its command none of its limits must bend the derivative."""
    servo = ARM.base.servo
    step = jnp.asarray(0.02)

    def position(command):
        return servo.advance(servo.at_rest(), command, step).position

    h = 1e-6
    got = jax.jacfwd(position)(jnp.zeros(3))
    ahead, behind = position(h * jnp.ones(3)), position(-h * jnp.ones(3))
    # it moves alike both ways: there is a derivative
    np.testing.assert_allclose(ahead, -behind, rtol=1e-9)
    assert (ahead > 0).all()
    np.testing.assert_allclose(got, np.diag((ahead - behind) / (2 * h)), rtol=1e-6)
