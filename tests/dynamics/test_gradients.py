"""Derivatives of equilibria and of motion against central differences, in the plane and in space.

In reverse mode, which is the transpose of forward mode; in the plane both are tested.
"""

from functools import cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.base import SineMotion
from crinoid.elements import TipLoad
from crinoid.flow import PowerShear, Uniform
from crinoid.foundation.axes import CHANNELS
from helpers.arms import QUICKLY, always, arm, ways

pytestmark = pytest.mark.slow

STEPS = 20
H = 1e-4
"""Step of the central differences."""

# factors, the speed (m/s) at which the tip is thrown, where the base is held (m, rad), how high its
# coordinates start (m)
USUAL = {
    2: {
        "EI": 1.0, "weight": 1.0, "flow": 1.0, "drag": 1.0, "throw": 1.0, "origin": 0.0,
        "to slide": 0.0, "to heave": 0.0, "to tilt": 0.0,
    },
    3: {
        "EI_1": 1.0, "EI_2": 1.4, "GJ": 0.7, "kappa_1": 0.5, "kappa_2": -0.4, "twist": 1.2,
        "pan": 0.3, "tilt": 0.4, "roll": -0.5, "current": 1.0, "gravity": 2.0, "follower": 0.3,
        "throw": 1.0, "to slide": 0.0, "to sway": 0.0, "to heave": 0.0, "to pan": 0.0,
        "to tilt": 0.0, "to roll": 0.0,
    },
}  # fmt: skip
"""Parameters of `start_and_end`."""
HELD_AT = {axes: tuple(f"to {name}" for name in CHANNELS[axes]) for axes in (2, 3)}
AT = {axes: np.array(list(usual.values())) for axes, usual in USUAL.items()}
DISPLACED = {
    2: np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.3, -0.2, 0.5]),
    3: AT[3]
    + np.where([name in HELD_AT[3] for name in USUAL[3]], np.arange(19) % 4 * 0.2 - 0.3, 0),
}
# steadily ahead of the base, which would brake if they turned on it
COMMANDS = {
    axes: np.linspace(0.0, 1.0, STEPS + 1)[1:, None] * speeds
    for axes, speeds in ((2, [0.2, -0.1, 0.5]), (3, [0.2, 0.1, -0.1, 0.4, 0.5, 0.8]))
}
DIRECTIONS = {
    2: ways(tuple(USUAL[2]), (STEPS, 3), seeds=3),
    3: ways(tuple(USUAL[3]), (STEPS, 6), seeds=2),
}

in_both_dimensions = pytest.mark.parametrize(
    "axes", [2, pytest.param(3, marks=pytest.mark.release)]
)


def planar(p):
    """Return what an arm is of: its weight bends it down, a current pushes that grows upward."""
    shear = map(jnp.asarray, (3.0, -3.0, 2.0))
    return {
        "nodes": 11,
        "EI": p["EI"],
        "gravity": 2.0 * p["weight"],
        "tilt": 0.4,
        "drag_normal": 1.1 * p["drag"],
        "drag_tangential": 0.05 * p["drag"],
        "origin": jnp.stack([0.0 * p["origin"], p["origin"]]),
        "flows": (PowerShear(always(), p["flow"] * jnp.asarray([1.2, 0.6]), *shear),),
    }


def spatial(p):
    def follower(rod):
        force, moment = jnp.asarray([[0.2, 0.5, -0.4], [0.6, -0.4, 0.3]])
        share = p["follower"]
        return TipLoad.of(rod, follower_force=share * force, follower_moment=share * moment)

    return {
        "nodes": 7,
        "EI": (p["EI_1"], p["EI_2"]),
        "GJ": p["GJ"],
        "radius": 0.2,
        "rest_curvature": (p["kappa_1"], p["kappa_2"], p["twist"]),
        "pan": p["pan"],
        "tilt": p["tilt"],
        "roll": p["roll"],
        "gravity": p["gravity"],
        "drag_tangential": 0.05,
        "flows": (Uniform(always(), p["current"] * jnp.asarray([1.2, -0.5, 0.6])),),
        "loads": (follower,),
    }


def varied(axes, parameters):
    """Build an arm that parameters change.

    It is soft in stretch, so that round-off (EA/l times 2e-16 = 2e-12 N) lets Newton's method
    converge to 1e-11 N: what central differences over 1e-4 find is then good to 1e-7. The servos
    stay away from their limits.
    """
    p = dict(zip(USUAL[axes], parameters, strict=True))
    still, ahead = jnp.zeros(()), jnp.asarray(np.pi / 2)
    # swings that stand still hold the base where they are
    motions = [SineMotion(i, p[name], still, ahead) for i, name in enumerate(HELD_AT[axes])]
    limits = [[limit] * len(motions) for limit in (-1.0, 1.0, 1e3, 1e5, 5.0)]
    return arm(
        axes=axes,
        EA=1e3,
        damping_time=0.01,
        water_density=1.0,
        diameter=2.0,
        displaced_area=0.3,
        motions=motions,
        limits=limits,
        time_step=0.02,
        tolerance=1e-13,
        **(planar if axes == 2 else spatial)(p),
    )


def start_and_end(axes, parameters, commands):
    """Return the tip's pose in equilibrium, and 20 steps after it was thrown.

    And the static Jacobian at the start, and whether every solve converged.
    """
    system = varied(axes, parameters)
    state, found = system.find_equilibrium()
    velocity = state.motion.velocity
    along = jnp.linspace(0.0, 1.0, velocity.shape[0] - 1)[:, None] ** 2
    aside = jnp.asarray([0.0, 1.0] if axes == 2 else [0.0, 0.8, 0.6, 3.0])
    throw = parameters[list(USUAL[axes]).index("throw")] * along * aside
    thrown = eqx.tree_at(lambda s: s.motion.velocity, state, velocity.at[1:].add(throw))

    def step(state, command):
        state, outcome = system.step(state, command)
        return state, outcome.converged

    end, converged = jax.lax.scan(step, thrown, commands)
    tips = jnp.concatenate([system.tip(state), system.tip(end)])
    # not differentiated any further
    system, state = jax.lax.stop_gradient((system, state))
    jacobian = system.influence(state).static(system.linearise(state)[0])
    return tips, (jacobian, found.converged & jnp.all(converged))


@partial(jax.jit, static_argnums=0, compiler_options=QUICKLY)
def _run(axes, parameters, commands, along, weights):
    """Return the tips, their slope along a direction, that of their weighted sum, and the rest."""
    tips, linear, others = jax.linearize(
        partial(start_and_end, axes), parameters, commands, has_aux=True
    )
    backward = jax.linear_transpose(linear, parameters, commands)
    return tips, linear(*along) if axes == 2 else None, backward(weights), others


def run(axes, parameters, commands, *, along=None, weights=None):
    if along is None:
        along = np.zeros_like(parameters), np.zeros_like(commands)
    weights = np.zeros(6 * (axes - 1)) if weights is None else weights
    given = jax.tree.map(jnp.asarray, (parameters, commands, along, weights))
    tips, ahead, back, (jacobian, converged) = _run(axes, *given)
    assert converged
    return jax.tree.map(np.asarray, (tips, jacobian, ahead, back))


@cache
def runs(axes):
    """Return tips and static Jacobian of the arm with all changes that the tests ask for."""
    points = {"usual": (AT[axes], COMMANDS[axes]), "displaced": (DISPLACED[axes], COMMANDS[axes])}
    for name, (direction, along) in DIRECTIONS[axes].items():
        for sign in (1, -1):
            by, change = sign * H * direction, sign * H * along
            points[name, sign] = (AT[axes] + by, COMMANDS[axes] + change)
            if name in (*HELD_AT[axes], "origin"):
                points["displaced", name, sign] = (DISPLACED[axes] + by, COMMANDS[axes])
    return {name: run(axes, *point)[:2] for name, point in points.items()}


@cache
def slopes(axes):
    """Return how each coordinate of the tips follows parameters and commands, in reverse mode."""
    each = [
        run(axes, AT[axes], COMMANDS[axes], weights=weights)[3]
        for weights in np.eye(6 * (axes - 1))
    ]
    return tuple(map(np.stack, zip(*each, strict=True)))


def slope(axes, *name):
    ahead, behind = (runs(axes)[(*name, sign)][0] for sign in (1, -1))
    return (ahead - behind) / (2 * H)


@pytest.mark.parametrize(
    ("axes", "name"),
    [
        *((2, name) for name in DIRECTIONS[2]),
        *(pytest.param(3, name, marks=pytest.mark.release) for name in DIRECTIONS[3]),
    ],
)
def test_derivatives_are_those_of_central_differences(axes, name):
    difference = slope(axes, name)
    at_start, at_end = np.abs(difference.reshape(2, -1)).max(axis=1)
    # what is thrown and commanded comes after the equilibrium
    early = name != "throw" and not name.startswith("commands")
    assert (at_start > 1e-2) == early
    assert at_end > 1e-2
    scale = np.repeat([at_start if early else 1.0, at_end], difference.size // 2)
    by_parameters, by_commands = slopes(axes)
    direction, along = DIRECTIONS[axes][name]
    reverse = by_parameters @ direction + np.einsum("tij,ij->t", by_commands, along)
    np.testing.assert_allclose(reverse / scale, difference / scale, rtol=0, atol=1e-5)
    if axes == 2:  # forward mode: the same numbers but for round-off
        forward = run(2, AT[2], COMMANDS[2], along=(direction, along))[2]
        np.testing.assert_allclose(reverse / scale, forward / scale, rtol=0, atol=1e-9)


@in_both_dimensions
def test_a_command_matters_only_after_it_was_given(axes):
    start, end = np.split(slopes(axes)[1], 2)
    np.testing.assert_array_equal(start, 0)
    assert (np.abs(end).max(axis=(0, 2)) > 0).all()


@pytest.mark.release
def test_set_angles_and_channels_turn_the_base_alike():
    rows = dict(zip(USUAL[3], slopes(3)[0].T, strict=True))
    for name in ("pan", "tilt", "roll"):
        np.testing.assert_allclose(rows[name], rows[f"to {name}"], rtol=0, atol=1e-8)


@in_both_dimensions
@pytest.mark.parametrize("where", ["usual", "displaced"])
def test_static_jacobian_is_how_the_equilibrium_follows_the_base(axes, where):
    name = () if where == "usual" else ("displaced",)
    got, size = runs(axes)[where][1], 3 * (axes - 1)
    expected = np.stack([slope(axes, *name, to)[:size] for to in HELD_AT[axes]], axis=1)
    assert got.shape == (size, size)
    assert (np.abs(expected).max(axis=0) > 0.05).all()
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6)
    if axes == 3:  # the current is the same everywhere
        np.testing.assert_allclose(got[:, :3], np.eye(6)[:, :3], rtol=0, atol=1e-8)
        return
    # the current is the same all along x, but not at every height: lifted, the arm bends more
    np.testing.assert_allclose(got[:, 0], [1, 0, 0], rtol=0, atol=1e-9)
    assert np.abs(got[:, 1] - [0, 1, 0]).max() > 1e-2
    # lifting the base is lifting the origin of its coordinates
    np.testing.assert_allclose(got[:, 1], slope(2, *name, "origin")[:3], rtol=0, atol=1e-6)


def test_static_jacobian_without_current_is_rigid_in_translation():
    slack = AT[2].copy()
    slack[list(USUAL[2]).index("flow")] = 0.0
    _, jacobian, *_ = run(2, slack, COMMANDS[2])
    np.testing.assert_allclose(jacobian[:, :2], [[1, 0], [0, 1], [0, 0]], rtol=0, atol=1e-9)


def test_command_moves_a_base_at_rest_as_much_as_it_says():
    # where the servo is at its command none of its limits may bend the derivative
    servo = varied(2, jnp.asarray(AT[2])).base.servo

    @jax.jit
    def position(command):
        return servo.advance(servo.at_rest(), command, jnp.asarray(0.02)).position

    nowhere = jnp.zeros(3)
    ahead, behind = position(nowhere + 1e-6), position(nowhere - 1e-6)
    # it moves alike both ways: there is a derivative
    np.testing.assert_allclose(ahead, -behind, rtol=1e-9)
    assert (ahead > 0).all()
    slopes = jax.jacfwd(position)(nowhere)
    np.testing.assert_allclose(slopes, np.diag((ahead - behind) / 2e-6), rtol=1e-6, atol=1e-12)


def test_an_equilibrium_in_still_water_is_the_same_at_any_time():
    system = arm(nodes=4, EI=1.0)

    def found(time):
        return jnp.sum(system.find_equilibrium(time)[0].motion.position)

    assert jax.jit(jax.grad(found), compiler_options=QUICKLY)(0.0) == 0.0
