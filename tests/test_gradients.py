"""Derivatives of equilibria and of motion, in both modes, against central differences."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.base import SineMotion
from crinoid.elements import Bend, Drag, Weight
from crinoid.flow import PowerShear
from physics import QUICKLY, always, arm, ways

NODES = 11
STEPS = 20
H = 1e-4
"""Step of the central differences."""


def held_at(channel):
    """Make a swing that stands still: a displacement of the base that tests may set."""
    nothing = jnp.zeros(())
    return SineMotion(channel, nothing, nothing, jnp.asarray(np.pi / 2))


# Its weight bends it down, a current that grows upward pushes on it. Soft in stretch, so that
# round-off (EA/l times 2e-16 = 2e-12 N) lets Newton's method converge to 1e-11 N: what central
# differences over 1e-4 find is then good to 1e-7. The servos stay away from their limits.
ARM = arm(
    nodes=NODES,
    EA=1e3,
    damping_time=0.01,
    tilt=0.4,
    gravity=2.0,
    water_density=1.0,
    diameter=2.0,
    displaced_area=0.3,
    drag_tangential=0.05,
    flows=(
        PowerShear(
            always(), jnp.asarray([1.2, 0.6]), jnp.asarray(3.0), jnp.asarray(-3.0), jnp.asarray(2.0)
        ),
    ),
    motions=tuple(held_at(channel) for channel in range(3)),
    limits=((-1.0,) * 3, (1.0,) * 3, (1e3,) * 3, (1e5,) * 3, (5.0,) * 3),
    time_step=0.02,
    tolerance=1e-13,
    floor=1e-11,
)

# of `start_and_end`: factors on the first four, the speed (m/s) at which the tip is thrown upward,
# where the base is held (m, rad), how high its coordinates start (m)
PARAMETERS = ("EI", "weight", "flow", "drag", "throw", "slide", "heave", "tilt", "origin")
EQUILIBRIUM = {"EI", "weight", "flow", "drag", "slide", "heave", "tilt", "origin"}
USUAL = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
# steadily ahead of the base, which would brake if they turned on it
COMMANDS = np.linspace(0.0, 1.0, STEPS + 1)[1:, None] * np.array([0.2, -0.1, 0.5])


def varied(parameters):
    stiffness, weight, flow, drag, _, slide, heave, tilt, origin = parameters

    def scaled(element):
        if isinstance(element, Bend):
            return eqx.tree_at(lambda e: e.stiffness, element, stiffness * element.stiffness)
        if isinstance(element, Weight):
            return eqx.tree_at(lambda e: e.force, element, weight * element.force)
        if isinstance(element, Drag):
            return jax.tree.map(lambda x: drag * x, element)
        return element

    (shear,) = ARM.forces.water.flows
    return eqx.tree_at(
        lambda s: [
            s.forces.elements,
            s.forces.water.flows[0].reference_velocity,
            s.forces.origin,
            *(motion.amplitude for motion in s.base.motions),
        ],
        ARM,
        [
            tuple(scaled(element) for element in ARM.forces.elements),
            flow * shear.reference_velocity,
            jnp.stack([0.0 * origin, origin]),
            slide,
            heave,
            tilt,
        ],
    )


def start_and_end(parameters, commands):
    """Return the tip (x, z, angle) in equilibrium, and 20 steps after it was thrown.

    And the static Jacobian at the start, and whether every solve converged.
    """
    system = varied(parameters)
    state, found = system.find_equilibrium()
    along = jnp.linspace(0.0, 1.0, NODES)
    throw = parameters[4] * jnp.stack([0.0 * along, along**2], axis=1)
    thrown = eqx.tree_at(lambda s: s.motion.velocity, state, state.velocity.at[1:].add(throw))

    def step(state, command):
        state, outcome = system.step(state, command)
        return state, outcome.converged

    end, converged = jax.lax.scan(step, thrown, commands)
    tips = jnp.concatenate([system.tip(state), system.tip(end)])
    return tips, system.static_jacobian(state), found.converged & jnp.all(converged)


DIRECTIONS = ways(PARAMETERS, (STEPS, 3), seeds=3)
DISPLACED = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.3, -0.2, 0.5, 0.0])
SLACK = np.array([1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def runs():
    """Run the arm with all changes that the tests ask for, at once in one batch."""
    points = {"usual": (USUAL, COMMANDS), "displaced": (DISPLACED, COMMANDS)}
    points["slack"] = (SLACK, COMMANDS)
    for name, (direction, along) in DIRECTIONS.items():
        for sign in (1, -1):
            points[name, sign] = (USUAL + sign * H * direction, COMMANDS + sign * H * along)
            points["displaced", name, sign] = (DISPLACED + sign * H * direction, COMMANDS)
    batch = tuple(jnp.asarray(np.stack(values)) for values in zip(*points.values(), strict=True))
    tips, jacobians, converged = jax.jit(jax.vmap(start_and_end), compiler_options=QUICKLY)(*batch)
    assert np.all(converged)
    return {name: (np.asarray(tips[i]), np.asarray(jacobians[i])) for i, name in enumerate(points)}


def slope(runs, *name):
    return (runs[*name, 1][0] - runs[*name, -1][0]) / (2 * H)


@partial(jax.jit, compiler_options=QUICKLY)
def both_modes(parameters, commands, parameters_dot, commands_dot, weights):
    tips, linear = jax.linearize(lambda *inputs: start_and_end(*inputs)[0], parameters, commands)
    backward = jax.linear_transpose(linear, parameters, commands)
    return tips, linear(parameters_dot, commands_dot), backward(weights)


@pytest.fixture(scope="module")
def alone():
    """Return the tips of one run, and their derivatives: along the directions, and in reverse."""
    nowhere = np.zeros(len(PARAMETERS)), np.zeros((STEPS, 3))
    ahead = [(*direction, np.zeros(6)) for direction in DIRECTIONS.values()]
    back = [(*nowhere, weights) for weights in np.eye(6)]
    runs = [
        jax.tree.map(np.asarray, both_modes(*map(jnp.asarray, (USUAL, COMMANDS, *given))))
        for given in ahead + back
    ]
    tips, forward, reverse = zip(*runs, strict=True)
    by_parameters, by_commands = zip(*reverse[len(ahead) :], strict=True)
    return (
        tips[0],
        np.stack(forward[: len(ahead)]),
        (np.stack(by_parameters), np.stack(by_commands)),
    )


@pytest.mark.parametrize("name", DIRECTIONS)
def test_derivatives_are_those_of_central_differences(runs, alone, name):
    difference = slope(runs, name)
    at_start, at_end = np.abs(difference.reshape(2, 3)).max(axis=1)
    # what is thrown and commanded comes after the equilibrium
    assert (at_start > 1e-2) == (name in EQUILIBRIUM)
    assert at_end > 1e-2
    scale = np.repeat([at_start if name in EQUILIBRIUM else 1.0, at_end], 3)
    _, forward, (by_parameters, by_commands) = alone
    got = forward[list(DIRECTIONS).index(name)]
    np.testing.assert_allclose(got / scale, difference / scale, rtol=0, atol=1e-5)
    # reverse mode: the same numbers but for round-off
    direction, along = DIRECTIONS[name]
    reverse = by_parameters @ direction + np.einsum("tij,ij->t", by_commands, along)
    np.testing.assert_allclose(reverse / scale, got / scale, rtol=0, atol=1e-9)


def test_a_command_matters_only_after_it_was_given(alone):
    _, _, (_, by_commands) = alone
    np.testing.assert_array_equal(by_commands[:3], 0)
    assert (np.abs(by_commands[3:]).max(axis=(0, 2)) > 0).all()


def test_batched_arms_move_as_one_does_alone(runs, alone):
    # each is solved to 1e-11 N, but sums may be taken in another order
    np.testing.assert_allclose(runs["usual"][0], alone[0], rtol=0, atol=1e-10)
    assert np.abs(runs["displaced"][0] - runs["usual"][0]).max() > 0.1


@pytest.mark.parametrize("where", ["usual", "displaced"])
def test_static_jacobian_is_how_the_equilibrium_follows_the_base(runs, where):
    name = () if where == "usual" else ("displaced",)
    channels = ("slide", "heave", "tilt")
    expected = np.stack([slope(runs, *name, channel)[:3] for channel in channels], axis=1)
    got = runs[where][1]
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6)
    # the current is the same all along x, but not at every height: lifted, the arm bends more
    np.testing.assert_allclose(got[:, 0], [1, 0, 0], rtol=0, atol=1e-9)
    assert np.abs(got[:, 1] - [0, 1, 0]).max() > 1e-2
    # lifting the base is lifting the origin of its coordinates
    np.testing.assert_allclose(got[:, 1], slope(runs, *name, "origin")[:3], rtol=0, atol=1e-6)


def test_static_jacobian_without_current_is_rigid_in_translation(runs):
    _, jacobian = runs["slack"]
    np.testing.assert_allclose(jacobian[:, :2], [[1, 0], [0, 1], [0, 0]], rtol=0, atol=1e-9)


def test_command_moves_a_base_at_rest_as_much_as_it_says():
    """Where the servo stands at its command none of its limits may bend the derivative."""
    servo = ARM.base.servo

    def position(command):
        return servo.advance(servo.at_rest(), command, jnp.asarray(0.02)).position

    nowhere = jnp.zeros(3)
    got = jax.jit(jax.jacfwd(position))(nowhere)
    ahead, behind = position(nowhere + 1e-6), position(nowhere - 1e-6)
    # it moves alike both ways: there is a derivative
    np.testing.assert_allclose(ahead, -behind, rtol=1e-9)
    assert (ahead > 0).all()
    np.testing.assert_allclose(got, np.diag((ahead - behind) / 2e-6), rtol=1e-6, atol=1e-12)
