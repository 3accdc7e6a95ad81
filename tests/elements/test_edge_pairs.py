"""Contact of two edges of an arm: one pair, in the plane and in space."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.elements import SelfContact
from helpers.touching import moving

RADII, STRENGTH, FRICTION = (0.01, 0.012), 50.0, 0.4
SKIN = 0.05 * RADII[0]
axes = pytest.mark.parametrize("axes", [2, 3])


def pair(friction=FRICTION):
    """Return the contact of two edges."""
    numbers = (RADII, STRENGTH, friction, 0.1)
    return SelfContact(*(jnp.asarray(number, float) for number in numbers))


@eqx.filter_jit
def _forces(contact, motions):
    return jax.vmap(lambda window: -contact.residual(window))(motions)


def forces(contact, position, velocity):
    """Return the forces of many windows."""
    motions = jax.vmap(moving)(jnp.asarray(position), jnp.asarray(velocity))
    return np.asarray(_forces(contact, motions))


@eqx.filter_jit
def gaps(contact, position):
    """Return the gaps of many windows (m)."""
    return jax.vmap(contact.gap, (0, None))(jnp.asarray(position), None)


def crossing(axes, count=60, share=0.4):
    """Return windows whose skins overlap, a share of their thickness apart, and their motion."""
    random = np.random.default_rng(axes)
    position = random.uniform(-0.1, 0.1, (count, 4, axes))
    for _ in range(20):  # along the line between the edges, until they are as close as they should
        slopes = jax.vmap(jax.value_and_grad(lambda place: pair().gap(place, None)))
        gap, slope = slopes(jnp.asarray(position))
        away = np.asarray(slope[:, :1] + slope[:, 1:2])
        off = (np.asarray(gap) - share * SKIN) / np.sum(away**2, axis=(1, 2))
        position[:, :2] -= off[:, None, None] * away
    velocity = random.normal(size=(count, 4, axes + (axes == 3)))
    return np.pad(position, ((0, 0), (0, 0), (0, axes == 3))), velocity


@pytest.mark.slow
@axes
def test_forces_change_neither_momentum_nor_angular_momentum(axes):
    position, velocity = crossing(axes)
    found = forces(pair(), position, velocity)
    pushed, places = found[..., :axes], position[..., :axes]
    size = np.abs(pushed).max(axis=(1, 2))
    assert np.count_nonzero(size > 1.0) > 20  # the others leave faster than their skins follow
    assert np.abs(pushed.sum(axis=1)).max() < 1e-12 * size.max()
    if axes == 2:
        moment = np.sum(places[..., 0] * pushed[..., 1] - places[..., 1] * pushed[..., 0], axis=1)
    else:
        edges = np.diff(places, axis=1)[:, ::2]
        along = edges / np.linalg.norm(edges, axis=2, keepdims=True)
        moment = np.cross(places, pushed).sum(axis=1)
        moment += np.sum(found[:, 1::2, 3:] * along, axis=1)
    assert np.abs(moment).max() < 1e-12 * size.max()


@pytest.mark.slow
@axes
def test_a_smooth_skin_stores_all_work_and_friction_only_takes(axes):
    position, velocity = crossing(axes)
    smooth, rough = pair(0.0), pair()

    def potential(places):
        return smooth.press(smooth.gap(places, None))[0]

    slope = jax.vmap(jax.grad(potential))(jnp.asarray(position[..., :axes]))
    pushed = forces(smooth, position, velocity)
    assert pushed[..., :axes] == pytest.approx(-np.asarray(slope), rel=1e-9, abs=1e-12)
    more = forces(rough, position, velocity) - pushed
    power = np.sum(more * velocity, axis=(1, 2))
    assert (power < 0.0).all()


def test_a_pair_in_a_plane_of_space_is_a_planar_pair():
    position, velocity = crossing(2)
    places, speeds = (np.zeros((len(position), 4, 4)) for _ in range(2))
    places[..., [0, 2]], speeds[..., [0, 2]] = position, velocity
    planar, spatial = forces(pair(), position, velocity), forces(pair(), places, speeds)
    assert spatial[..., [0, 2]] == pytest.approx(planar, rel=1e-9, abs=1e-12)
    assert spatial[..., 1] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.slow
@axes
def test_the_gap_is_the_least_distance_drawn_to_the_middles(axes):
    position, _ = crossing(axes, 5)
    places = position[..., :axes]
    s, t = np.meshgrid(*[np.linspace(0.0, 1.0, 401)] * 2, indexing="ij")
    edge, other = places[:, 1] - places[:, 0], places[:, 3] - places[:, 2]
    apart = (places[:, 0] - places[:, 2])[:, None, None]
    between = apart + s[..., None] * edge[:, None, None] - t[..., None] * other[:, None, None]
    squared = np.sum(between**2, axis=-1)
    squared += 0.01 * (s - 0.5) ** 2 * np.sum(edge**2, axis=1)[:, None, None]
    squared += 0.01 * (t - 0.5) ** 2 * np.sum(other**2, axis=1)[:, None, None]
    least = np.sqrt(squared.min(axis=(1, 2))) - sum(RADII)
    assert np.asarray(gaps(pair(), places)) == pytest.approx(least, abs=1e-6)
