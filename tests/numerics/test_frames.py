"""Frames that turn along with a rod: transport, its holonomy, and turns that are counted."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from crinoid.numerics.frames import (
    Frames,
    Orientation,
    angle_between,
    cross,
    spun,
    tangents,
    transport,
)
from helpers.arms import order

TURN = 2 * np.pi


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def normals(rng, tangent):
    return unit(np.cross(tangent, rng.normal(size=tangent.shape)))


def chain(edges, spins=None):
    """Place nodes at the ends of edges that follow each other, with spins that are zero if none."""
    places = np.concatenate([np.zeros((1, 3)), np.cumsum(edges, axis=0)])
    spins = np.zeros(len(places)) if spins is None else spins
    return jnp.asarray(np.concatenate([places, np.asarray(spins)[:, None]], axis=1))


_of = eqx.filter_jit(Frames.of)
_at = eqx.filter_jit(Frames.at)


def framed(position, director, twist=None):
    """Build the frames of a shape from the directors of its edges and the twists of its nodes."""
    position, director = np.asarray(position), np.asarray(director)
    director = np.concatenate([director[:1], director])
    twist = np.zeros(len(position)) if twist is None else twist
    none = jnp.zeros_like(jnp.asarray(director))
    return _of(jnp.asarray(position), Orientation(jnp.asarray(director), jnp.asarray(twist), none))


# --- transport ---------------------------------------------------------------------------------


def test_transport_is_the_rotation_that_turns_about_neither_tangent():
    rng = np.random.default_rng(0)
    before, after = unit(rng.normal(size=(2, 200, 3)).reshape(-1, 3)).reshape(2, 200, 3)
    vector = normals(rng, before) * rng.uniform(0.5, 2.0, (200, 1))
    axis = np.cross(before, after)
    angle = np.arctan2(np.linalg.norm(axis, axis=1), np.sum(before * after, axis=1))
    got = transport(*map(jnp.asarray, (vector, before, after)))
    expected = Rotation.from_rotvec(angle[:, None] * unit(axis)).apply(vector)
    np.testing.assert_allclose(got, expected, rtol=0, atol=2e-12)
    assert angle.max() > np.deg2rad(165)
    # to the opposite it is no number
    x, y, _ = jnp.eye(3)
    assert not np.isfinite(transport(y, x, -x)).all()


def test_spinning_turns_about_the_tangent_by_the_right_hand():
    rng = np.random.default_rng(2)
    tangent = unit(rng.normal(size=(50, 3)))
    director, angle = normals(rng, tangent), rng.uniform(-np.pi, np.pi, 50)
    got = spun(*map(jnp.asarray, (director, tangent, angle)))
    expected = Rotation.from_rotvec(angle[:, None] * tangent).apply(director)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-14)
    between = angle_between(jnp.asarray(director), got, jnp.asarray(tangent))
    np.testing.assert_allclose(between, angle, rtol=0, atol=1e-13)
    across = cross(jnp.asarray(tangent), jnp.asarray(director))
    np.testing.assert_allclose(across, np.cross(tangent, director), atol=1e-15)


# --- frames of a shape -------------------------------------------------------------------------


def crooked(edges=6):
    """Return an arm bent and twisted at random, by several turns, and its frames."""
    rng = np.random.default_rng(3)
    tangent = np.array([1.0, 0.3, -0.2]) + rng.uniform(-0.8, 0.8, (edges, 3))
    position = chain(tangent, rng.uniform(-9.0, 9.0, edges + 1))
    tangent = unit(tangent)
    director = normals(rng, tangent)
    # what the directors say, and some turns more
    carried = transport(*map(jnp.asarray, (director[:-1], tangent[:-1], tangent[1:])))
    wrapped = angle_between(carried, jnp.asarray(director[1:]), jnp.asarray(tangent[1:]))
    twist = np.pad(np.asarray(wrapped) + TURN * rng.integers(-3, 4, edges - 1), 1)
    return position, director, twist, framed(position, director, twist)


def test_frames_give_back_the_orientation_that_they_come_from():
    position, director, twist, frames = crooked()
    orientation = _at(frames, position)
    np.testing.assert_allclose(orientation.director[1:], director, rtol=0, atol=1e-14)
    np.testing.assert_allclose(orientation.twist, twist, rtol=0, atol=1e-13)
    np.testing.assert_allclose(orientation.lean, 0, atol=1e-15)
    np.testing.assert_allclose(tangents(position)[0], tangents(position)[1], rtol=0, atol=0)
    assert np.abs(twist).max() > TURN


def test_directors_stay_unit_normals_however_far_the_edges_turn():
    position, *_, frames = crooked()
    rng = np.random.default_rng(4)
    away = chain(2.0 * rng.normal(size=(6, 3)), rng.uniform(-50.0, 50.0, 7))
    angle = np.arccos(np.sum(np.asarray(tangents(position) * tangents(away)), axis=1))
    assert angle.max() > 2.0
    director = np.asarray(_at(frames, away).director)
    np.testing.assert_allclose(np.linalg.norm(director, axis=1), 1, rtol=0, atol=1e-13)
    np.testing.assert_allclose(np.sum(director * tangents(away), axis=1), 0, atol=1e-13)


@pytest.mark.parametrize("turns", [0.5, 1.5, -2.5, 3.0])
def test_whole_turns_of_twist_are_counted(turns):
    position = chain([[1.0, 0.0, 0.0]] * 3)
    frames = framed(position, [[0.0, 1.0, 0.0]] * 3)
    spun_up = position.at[2, 3].set(TURN * turns)  # the middle edge alone
    twist = _at(frames, spun_up).twist
    np.testing.assert_allclose(twist, [0, TURN * turns, -TURN * turns, 0], rtol=0, atol=1e-12)
    # nor are they lost where the frames start again from there
    again = _of(spun_up, _at(frames, spun_up))
    np.testing.assert_allclose(_at(again, spun_up).twist, twist, rtol=0, atol=1e-12)
    half = spun_up.at[2, 3].add(np.pi / 2)
    np.testing.assert_allclose(_at(again, half).twist[1], TURN * turns + np.pi / 2, atol=1e-12)


def test_spinning_to_a_frame_is_how_far_the_edge_must_spin():
    position, *_, frames = crooked()
    rng = np.random.default_rng(5)
    tangent = unit(np.asarray(tangents(position))[2:3] + 0.5 * rng.normal(size=(1, 3)))
    director = normals(rng, tangent)
    spin = frames.spin_to(2, jnp.asarray(tangent[0]), jnp.asarray(director[0]))
    assert abs(spin - position[2, 3]) <= np.pi
    turned = np.array(position)
    turned[2, :3] = turned[1, :3] + tangent[0]
    turned[2, 3] = spin
    got = _at(frames, jnp.asarray(turned)).director[2]
    np.testing.assert_allclose(got, director[0], rtol=0, atol=1e-14)


# --- the area between two ways -----------------------------------------------------------------


@eqx.filter_jit
def _drag_along(frames, position, moving):
    """Return how fast directors turn about their tangents as the places move, and the frames."""
    now, rate = jax.jvp(lambda position: frames.at(position).director, (position,), (moving,))
    tangent, swing = jax.jvp(tangents, (position,), (moving,))
    about = jnp.sum(cross(tangent, now) * rate, axis=1)
    return about, jnp.sum(frames.at(position).lean * swing, axis=1)


@pytest.mark.parametrize("far", [0.3, 1.0, 2.0])
def test_lean_is_how_places_drag_the_directors_along(far):
    # by differentiation, and that by differences
    position, *_, frames = crooked()
    rng = np.random.default_rng(6)
    moved = position.at[:, :3].add(jnp.asarray(far * rng.normal(size=(7, 3))))
    moving = jnp.asarray(np.pad(rng.normal(size=(7, 3)), ((0, 0), (0, 1))))
    about, leant = map(np.asarray, _drag_along(frames, moved, moving))
    assert np.abs(leant[1:]).min() > 1e-4
    np.testing.assert_allclose(leant, about, rtol=0, atol=1e-12 * np.abs(about).max())
    h = 1e-6
    places = (moved + s * h * moving for s in (1, 0, -1))
    ahead, here, behind = (np.asarray(_at(frames, place).director) for place in places)
    port = np.cross(tangents(moved), here)
    difference = np.sum(port * (ahead - behind), axis=1) / (2 * h)
    np.testing.assert_allclose(leant, difference, rtol=0, atol=1e-7 * np.abs(about).max())


def spherical_area(pole, corners):
    """Return the area of a spherical polygon, by triangles from a pole.

    tan(area / 2) = a . (b x c) / (1 + a . b + b . c + c . a) for a triangle (Eriksson, Math. Mag.
    63 (1990) 184-187).
    """
    b, c = corners[:-1], corners[1:]
    facing = 1 + b @ pole + c @ pole + np.sum(b * c, axis=1)
    return np.sum(2 * np.arctan2(np.cross(b, c) @ pole, facing))


@pytest.mark.parametrize("opening", np.deg2rad([30.0, 80.0, 120.0]))
def test_going_round_a_cone_turns_by_the_area_that_it_encloses(opening):
    # the last edge goes three times round the one before, which points along x; neither spins
    steps = 24
    around = TURN * np.arange(steps + 1) / steps
    circle = np.stack([0 * around, np.cos(around), np.sin(around)], axis=1)
    corners = np.sin(opening) * circle + [np.cos(opening), 0.0, 0.0]
    still = np.array([1.0, 0.0, 0.0])
    position = chain([still, still, corners[0]])
    frames = framed(position, [[0, 0, 1.0]] * 3)
    start = float(_at(frames, position).twist[2])
    for corner in np.tile(corners[1:], (3, 1)):
        position = chain([still, still, corner])
        frames = _of(position, _at(frames, position))
    # each time round, the frame comes back turned by the area within (Gauss and Bonnet)
    got = float(_at(frames, position).twist[2]) - start
    enclosed = 3 * spherical_area(still, corners)
    assert abs(got) > 0.7
    assert got == pytest.approx(enclosed, abs=1e-10)
    # the polygon comes near the circle
    assert enclosed == pytest.approx(3 * TURN * (1 - np.cos(opening)), rel=0.05)


def test_frames_turn_with_a_body_that_turns_at_order_two():
    # three turns about a fixed axis: the spin about each tangent is even
    position, director, twist, _ = crooked()
    position = np.array(position)
    axis = np.array([0.6, -0.48, 0.64])
    along = np.asarray(tangents(jnp.asarray(position))) @ axis

    def error(steps):
        frames = framed(position, director, twist)
        for n in range(1, steps + 1):
            turned = Rotation.from_rotvec(3 * TURN * n / steps * axis).apply(position[:, :3])
            spins = position[:, 3] + 3 * TURN * n / steps * along
            moved = jnp.asarray(np.concatenate([turned, spins[:, None]], axis=1))
            frames = _of(moved, _at(frames, moved))
        np.testing.assert_allclose(_at(frames, moved).twist, twist, atol=20 / steps)
        return np.abs(np.asarray(frames.director)[1:] - director).max()

    errors = [error(steps) for steps in (60, 120, 240)]
    assert errors[-1] < 0.02
    assert order(errors) == pytest.approx(2.0, abs=0.05)
