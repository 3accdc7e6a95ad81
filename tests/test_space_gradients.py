"""Derivatives of equilibria and of motion in space against central differences.

In reverse mode, which is the transpose of forward mode; in the plane both are tested.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.base import SineMotion
from crinoid.elements import TipLoad
from crinoid.flow import Uniform
from crinoid.space import CHANNELS
from physics import QUICKLY, always, arm, ways

NODES = 7
STEPS = 20
H = 1e-4
"""Step of the central differences."""

USUAL = {
    "EI_1": 1.0, "EI_2": 1.4, "GJ": 0.7, "kappa_1": 0.5, "kappa_2": -0.4, "twist": 1.2,
    "pan": 0.3, "tilt": 0.4, "roll": -0.5, "current": 1.0, "gravity": 2.0, "follower": 0.3,
    "throw": 1.0,
    # where the base is held (m, rad)
    "slide": 0.0, "sway": 0.0, "heave": 0.0, "to pan": 0.0, "to tilt": 0.0, "to roll": 0.0,
}  # fmt: skip
"""Parameters of `start_and_end`; the throw is the speed at which the tip is thrown aside (m/s)."""
NAMES = tuple(USUAL)
HELD_AT = NAMES[-6:]
# steadily ahead of the base, which would brake if they turned on it
COMMANDS = np.linspace(0.0, 1.0, STEPS + 1)[1:, None] * [0.2, 0.1, -0.1, 0.4, 0.5, 0.8]


def held_at(channel, place):
    """Make a swing that stands still."""
    nothing = jnp.zeros(())
    return SineMotion(channel, place, nothing, jnp.asarray(np.pi / 2))


def varied(parameters):
    p = dict(zip(NAMES, parameters, strict=True))
    velocity = p["current"] * jnp.asarray([1.2, -0.5, 0.6])
    limits = [[limit] * 6 for limit in (-1.0, 1.0, 1e3, 1e5, 5.0)]
    # soft in stretch, so that Newton's method converges to 1e-11 N
    return arm(
        axes=3,
        nodes=NODES,
        EA=1e3,
        EI=(p["EI_1"], p["EI_2"]),
        GJ=p["GJ"],
        rest_curvature=(p["kappa_1"], p["kappa_2"], p["twist"]),
        radius=0.2,
        damping_time=0.01,
        pan=p["pan"],
        tilt=p["tilt"],
        roll=p["roll"],
        gravity=p["gravity"],
        water_density=1.0,
        diameter=2.0,
        displaced_area=0.3,
        drag_tangential=0.05,
        loads=(
            lambda rod: TipLoad.of(
                rod,
                follower_force=p["follower"] * jnp.asarray([0.2, 0.5, -0.4]),
                follower_moment=p["follower"] * jnp.asarray([0.6, -0.4, 0.3]),
            ),
        ),
        flows=(Uniform(always(), velocity),),
        motions=tuple(held_at(i, p[name]) for i, name in enumerate(HELD_AT)),
        limits=limits,
        time_step=0.02,
        tolerance=1e-13,
        floor=1e-11,
    )


def start_and_end(parameters, commands):
    """Return the tip's pose in equilibrium, and 20 steps after it was thrown.

    And beside them the static Jacobian at the start, and whether every solve converged.
    """
    system = varied(parameters)
    state, found = system.find_equilibrium()
    along = jnp.linspace(0.0, 1.0, NODES)[:, None] ** 2
    throw = parameters[NAMES.index("throw")] * along * jnp.asarray([0.0, 0.8, 0.6, 3.0])
    thrown = eqx.tree_at(
        lambda s: s.motion.velocity, state, state.motion.velocity.at[1:].add(throw)
    )

    def step(state, command):
        state, outcome = system.step(state, command)
        return state, outcome.converged

    end, converged = jax.lax.scan(step, thrown, commands)
    tips = jnp.concatenate([system.tip(state), system.tip(end)])
    # not differentiated any further
    system, state = jax.lax.stop_gradient((system, state))
    return tips, (system.static_jacobian(state), found.converged & jnp.all(converged))


DIRECTIONS = ways(NAMES, (STEPS, 6), seeds=2)
AT = np.array(list(USUAL.values()))
DISPLACED = AT + np.where(np.isin(NAMES, HELD_AT), np.arange(len(NAMES)) % 4 * 0.2 - 0.3, 0.0)


@partial(jax.jit, compiler_options=QUICKLY)
def _run(parameters, commands, weights):
    """Return the tips, how their weighted sum follows parameters and commands, and the rest."""
    tips, backward, others = jax.vjp(start_and_end, parameters, commands, has_aux=True)
    return tips, backward(weights), others


def run(parameters, commands, weights=(0.0,) * 12):
    given = (jnp.asarray(values) for values in (parameters, commands, weights))
    tips, slopes, (jacobian, converged) = _run(*given)
    assert converged
    return jax.tree.map(np.asarray, (tips, slopes, jacobian))


@pytest.fixture(scope="module")
def slopes():
    """Return how each coordinate of the tips follows parameters and commands."""
    each = [run(AT, COMMANDS, weights)[1] for weights in np.eye(12)]
    return tuple(map(np.stack, zip(*each, strict=True)))


@pytest.fixture(scope="module")
def runs():
    """Run the arm with all changes that the tests ask for."""
    points = {"usual": (AT, COMMANDS), "displaced": (DISPLACED, COMMANDS)}
    for name, (direction, along) in DIRECTIONS.items():
        for sign in (1, -1):
            points[name, sign] = (AT + sign * H * direction, COMMANDS + sign * H * along)
            if name in HELD_AT:
                points["displaced", name, sign] = (DISPLACED + sign * H * direction, COMMANDS)
    return {name: run(*point) for name, point in points.items()}


def slope(runs, *name):
    return (runs[*name, 1][0] - runs[*name, -1][0]) / (2 * H)


@pytest.mark.parametrize("name", DIRECTIONS)
def test_derivatives_are_those_of_central_differences(runs, slopes, name):
    difference = slope(runs, name)
    at_start, at_end = np.abs(difference.reshape(2, 6)).max(axis=1)
    # what is thrown and commanded comes after the equilibrium
    early = name != "throw" and not name.startswith("commands")
    assert (at_start > 1e-2) == early
    assert at_end > 1e-2
    scale = np.repeat([at_start if early else 1.0, at_end], 6)
    by_parameters, by_commands = slopes
    direction, along = DIRECTIONS[name]
    got = by_parameters @ direction + np.einsum("tij,ij->t", by_commands, along)
    np.testing.assert_allclose(got / scale, difference / scale, rtol=0, atol=1e-5)


def test_set_angles_and_channels_turn_the_base_alike(slopes):
    by_parameters, _ = slopes
    rows = dict(zip(NAMES, by_parameters.T, strict=True))
    for name in ("pan", "tilt", "roll"):
        np.testing.assert_allclose(rows[name], rows[f"to {name}"], rtol=0, atol=1e-8)


@pytest.mark.parametrize("where", ["usual", "displaced"])
def test_static_jacobian_is_how_the_equilibrium_follows_the_base(runs, where):
    name = () if where == "usual" else ("displaced",)
    expected = np.stack([slope(runs, *name, channel)[:6] for channel in HELD_AT], axis=1)
    got = runs[where][2]
    assert got.shape == (6, len(CHANNELS[3]))
    assert (np.abs(expected).max(axis=0) > 0.05).all()
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6)
    # the current is the same everywhere
    np.testing.assert_allclose(got[:, :3], np.eye(6)[:, :3], rtol=0, atol=1e-8)
