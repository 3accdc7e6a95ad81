"""Contact with surfaces on grids: against round obstacles and planes, slopes, any shape."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import spline_filter

from crinoid.elements import Bed, Contact, SignedDistance, SurfaceContact
from crinoid.numerics.grid_spline import GridSpline
from helpers.touching import FRICTION, THICK, closing, moving, one_edge, push, window

BALL, STEP, SHORT = 0.03, THICK / 2, 0.04
gap_of = eqx.filter_jit(Contact.gap)
both = pytest.mark.parametrize("axes", [2, 3], ids=["plane", "space"])


def spline(values, low, step):
    numbers = spline_filter(values, order=3), np.full(values.ndim, low), np.full(values.ndim, step)
    return GridSpline(*map(jnp.asarray, numbers))


def ball(axes):
    """Return the signed distance from a ball on a grid."""
    places = np.arange(-0.06, 0.0601, STEP)
    grid = np.meshgrid(*[places] * axes, indexing="ij")
    return SignedDistance(spline(np.linalg.norm(grid, axis=0) - BALL, places[0], STEP), 41)


def bed(axes, height):
    """Return a bed of given heights by x and, in space, y."""
    places = np.arange(-0.5, 0.501, 0.02)
    grid = np.meshgrid(*[places] * (axes - 1), indexing="ij")
    return Bed(spline(height(*grid), places[0], 0.02), 9)


def against(surface, axes, friction=0.0):
    """Return the contact of an edge of 0.1 m, 10 mm thick, with a surface."""
    return SurfaceContact(**vars(one_edge(axes, friction=friction)), surface=surface)


def short(contact):
    """Return the contact of a shorter edge: as long as its distance from the ball's middle."""
    return eqx.tree_at(lambda one: one.rest_length, contact, jnp.asarray(SHORT))


@both
@pytest.mark.parametrize("place", ["middle", "end", "oblique"])
def test_a_ball_on_a_grid_is_the_ball(place, axes):
    rng = np.random.default_rng(2)
    exact, found = map(short, (one_edge(axes, radius=BALL), against(ball(axes), axes)))
    way = {"middle": [0.0, 1.0], "end": [1.0, 0.0], "oblique": [1.0, 0.1]}[place]
    along, aside = (np.zeros(axes) for _ in range(2))
    along[[0, -1]], aside[[0, -1]] = way, (-way[1], way[0])
    turn, _ = np.linalg.qr(rng.normal(size=(axes, axes)))
    reach = BALL + THICK + 0.3 * float(exact.skin)
    for share in np.linspace(-0.5, 0.5, 5):
        # the edge passes the ball, or points at it
        near = reach * (along if place == "end" else aside)
        other = near + SHORT * along
        if place != "end":
            near, other = (end + (share - 0.5) * SHORT * along for end in (near, other))
        places = np.stack([near @ turn, other @ turn, 0 * near])
        position = places if axes == 2 else np.c_[places, np.zeros(3)]
        (gap, forces), (known, wanted) = push(found, position), push(exact, position)
        assert gap == pytest.approx(known, abs=0.01 * THICK)
        assert np.abs(wanted).max() > 0.05
        # the skin is a twentieth of the arm's radius: compared at the same gap
        pressing, wished = (exact.press(jnp.asarray(each))[1] for each in (gap, known))
        scale = float(wished / pressing)
        np.testing.assert_allclose(scale * forces, wanted, atol=0.02 * np.abs(wanted).max())


@both
def test_a_sloped_bed_is_a_plane(axes):
    slope = np.array([0.3, -0.2][: axes - 1])
    normal = np.append(-slope, 1.0) / np.hypot(np.linalg.norm(slope), 1.0)
    flat = one_edge(axes, normal=tuple(normal), friction=FRICTION)
    rough = against(bed(axes, lambda *x: np.tensordot(slope, np.array(x), 1)), axes, FRICTION)
    rng = np.random.default_rng(4)
    for _ in range(20):
        position = window(rng, flat, within=0.4)
        velocity = rng.normal(size=position.shape)
        for found, known in zip(
            push(rough, position, velocity), push(flat, position, velocity), strict=True
        ):
            np.testing.assert_allclose(found, known, rtol=1e-7, atol=1e-9)


@both
def test_the_gap_from_a_hill_is_that_from_its_ball(axes):
    # a cap of radius 0.3 m, touched at a slope of up to 40 degrees
    def height(*x):
        return np.sqrt(0.3**2 - np.minimum(np.sum(np.square(x), axis=0), 0.27**2))

    hill, round_one = map(short, (against(bed(axes, height), axes), one_edge(axes, radius=0.3)))
    for angle in np.deg2rad([0.0, 20.0, 40.0]):
        out, along = np.zeros(axes), np.zeros(axes)
        out[[0, -1]] = np.sin(angle), np.cos(angle)
        along[[0, -1]] = np.cos(angle), -np.sin(angle)
        middle = (0.3 + THICK) * out
        places = np.stack([middle - 0.02 * along, middle + 0.02 * along, 0 * out])
        gap, known = (gap_of(one, places, None) for one in (hill, round_one))
        assert float(gap) == pytest.approx(float(known), abs=0.01 * THICK)


def bumpy(axes):
    """Return a bed with bumps of 50 mm, which no formula of a ball or plane fits."""
    return bed(axes, lambda *x: 0.01 * np.sum(np.sin(2 * np.pi * np.array(x) / 0.2), axis=0))


cases = pytest.mark.parametrize("surface", [ball, bumpy])


@pytest.mark.slow
@both
@cases
def test_gap_is_the_least_distance_over_the_edge(surface, axes):
    contact = against(surface(axes), axes)
    rng = np.random.default_rng(7)

    @jax.jit
    def brute(places):
        shares = jnp.linspace(0, 1, 2001)
        ease = 0.5 * contact._pull * (shares - 0.5) ** 2
        points = places[0] - places[2] + shares[:, None] * (places[1] - places[0])
        return jnp.min(jax.vmap(contact._distance)(points) + ease) - contact.arm_radius

    for _ in range(30):
        near, way = 0.05 * rng.normal(size=axes), rng.normal(size=axes)
        places = np.stack([near, near + 0.1 * way / np.linalg.norm(way), 0 * near])
        gap = float(gap_of(contact, places, None))
        assert gap == pytest.approx(float(brute(places)), abs=1e-6)


@pytest.mark.slow
@both
@cases
def test_slopes_of_gap_and_forces_are_those_of_differences(surface, axes):
    contact = against(surface(axes), axes, FRICTION)
    rng = np.random.default_rng(5)
    position = window(rng, contact, within=0.5)
    velocity = closing(contact, position, rng.normal(size=position.shape))

    def pushed(position):
        gap, pushed = Contact.push(contact, moving(position, velocity))
        return jnp.append(pushed.ravel(), 1e3 * gap)

    @jax.jit
    def with_slopes(position):
        value, forward = jax.linearize(pushed, position)
        back = jax.linear_transpose(forward, position)
        ways = jnp.eye(position.size).reshape(-1, *position.shape)
        columns = jnp.moveaxis(jax.vmap(forward)(ways), 0, -1)
        (rows,) = jax.vmap(back)(jnp.eye(value.size))
        return value, columns.reshape(rows.shape), rows

    def forces(position):
        return with_slopes(jnp.asarray(position))[0]

    _, slopes, back = with_slopes(jnp.asarray(position))
    step = 1e-8
    assert np.abs(forces(position)).max() > 1.0
    for entry in np.ndindex(position.shape):
        moved = np.zeros(position.shape)
        moved[entry] = step
        wanted = np.asarray(forces(position + moved) - forces(position - moved)) / (2 * step)
        scale = np.abs(slopes).max()
        np.testing.assert_allclose(slopes[(slice(None), *entry)], wanted, atol=1e-5 * scale)
        np.testing.assert_allclose(back[(slice(None), *entry)], wanted, atol=1e-5 * scale)


@both
def test_outside_of_the_grid_there_is_no_contact(axes):
    contact = against(ball(axes), axes)
    for away in (0.08, 0.5, 30.0):
        near = away * np.ones(axes) / np.sqrt(axes)
        places = np.stack([near, near + 0.1 * near / away, 0 * near])
        gap = float(gap_of(contact, places, None))
        assert 0.03 * away < gap <= away - BALL - THICK + 1e-3
