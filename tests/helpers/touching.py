"""One edge that touches one obstacle, in the plane and in space, and arms that are hit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.elements import Contact, Motion
from helpers.arms import Kept

THICK, FRICTION = 0.01, 0.4
"""Radius of the edge (m), and the coefficient of what rubs."""

SHAPES = {
    2: {
        "sphere": {"radius": 0.03},
        "capsule": {"radius": 0.02, "half_axis": (0.05, 0.03)},
        "cylinder": {"radius": 0.02, "half_axis": (600.0, 800.0)},
        "plane": {"normal": (0.6, 0.8)},
    },
    3: {
        "sphere": {"radius": 0.03},
        "capsule": {"radius": 0.02, "half_axis": (0.05, -0.04, 0.03)},
        "cylinder": {"radius": 0.02, "half_axis": (480.0, 640.0, 600.0)},
        "plane": {"normal": (0.48, 0.6, 0.64)},
    },
}
shapes = pytest.mark.parametrize("kind", SHAPES[3])


def one_edge(axes=3, *, friction=0.0, **shape):
    """Return the contact of one edge of 0.1 m, 10 mm thick, with one obstacle."""
    none = (0.0,) * axes
    numbers = (
        *(0.1, THICK, 50.0, shape.get("radius", 0.0)),
        *(shape.get("half_axis", none), shape.get("normal", none), friction, 0.1),
    )
    return Contact(*(jnp.asarray(number, float) for number in numbers))


def moving(position, velocity):
    """Return the motion of a window in still water."""
    position, velocity = jnp.asarray(position, float), jnp.asarray(velocity, float)
    still = jnp.zeros((*position.shape[:-1], min(position.shape[-1], 3)))
    return Motion(position, velocity, 0 * velocity, still, still, jnp.zeros(()))


@eqx.filter_jit
def _push(contact, motion):
    return contact.push(motion)


def push(contact, position, velocity=None):
    """Return the gap and the forces of a window."""
    velocity = np.zeros_like(position) if velocity is None else velocity
    return jax.tree.map(np.asarray, _push(contact, moving(position, velocity)))


@eqx.filter_jit
def _closest(contact, places):
    return contact._closest(places[:, : contact.axes], contact.half_axis)[:3]


def closest(contact, position):
    """Return the gap, its slopes, and where along the edge it is."""
    return jax.tree.map(np.asarray, _closest(contact, jnp.asarray(position)))


def window(rng, contact, *, within=None, along=1.0):
    """Return a window at random, its surfaces ``within`` the skin if that is given."""
    axes = contact.axes
    edge = along * rng.normal(size=axes)
    near, place = (along * rng.uniform(-far, far, axes) for far in (0.15, 0.05))
    places = np.stack([near, near + 0.1 * edge / np.linalg.norm(edge), place])
    if within is not None:
        for _ in range(3):  # along the slope the gap is all but straight
            gap, slopes, _ = closest(contact, places)
            away = slopes[2] / (slopes[2] @ slopes[2])
            places[2] -= away * (gap - within * float(contact.skin))
    return places if axes == 2 else np.concatenate([places, rng.normal(size=(3, 1))], axis=1)


def closing(contact, position, velocity, rate=0.0):
    """Return velocities at which the gap changes at a ``rate`` (m/s), by the obstacle's."""
    axes = contact.axes
    _, slopes, _ = closest(contact, position)
    off = np.sum(slopes * velocity[:, :axes]) - rate
    velocity = velocity.copy()
    velocity[2, :axes] -= off * slopes[2] / (slopes[2] @ slopes[2])
    return velocity


def rubbed(seed, kind, axes=3):
    """Return a contact with friction, a window that is in touch, and velocities along surfaces."""
    rng = np.random.default_rng(seed)
    contact = one_edge(axes, friction=FRICTION, **SHAPES[axes][kind])
    position = window(rng, contact, within=0.5)
    return contact, position, closing(contact, position, rng.normal(size=position.shape))


# --- arms --------------------------------------------------------------------------------------

rest = eqx.filter_jit(lambda system: Kept.of(system, system.rest()))
advance = eqx.filter_jit(lambda system, state: state.advance(system, jnp.zeros(len(system.inputs))))


def march(system, state, steps):
    """Return the state after some time steps, and how many shorter ones they took."""
    taken = 0
    for _ in range(steps):
        state, progress = advance(system, state)
        assert progress.outcome.converged
        taken += int(progress.steps)
    return state, taken


def assert_momentum_kept(end, mass, velocity, **tolerances):
    """What a free body lost since it had a ``velocity`` the arm got."""
    gained = mass * (np.asarray(end.obstacle_velocity[0]) - velocity)
    np.testing.assert_allclose(gained, -np.asarray(end.touch.impulse[0]), **tolerances)


def kept_energy(end, mass, velocity):
    """Return which share of the energy of a free body the body and the arm have."""
    before, after = (0.5 * mass * np.sum(np.square(v)) for v in (velocity, end.obstacle_velocity))
    return (after + float(end.energy.sum())) / before
