"""Contact in space: gaps, slopes, friction that turns and twists the arm, bodies of three axes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import crinoid
from crinoid.elements import Pose
from crinoid.rod import Rod
from helpers.arms import obstacles, order
from helpers.touching import (
    FRICTION,
    SHAPES,
    THICK,
    assert_momentum_kept,
    closest,
    closing,
    kept_energy,
    march,
    moving,
    one_edge,
    push,
    rest,
    rubbed,
    shapes,
    window,
)

CREEP = 1e-3
"""Speed at which friction has come on (m/s)."""


# --- geometry ----------------------------------------------------------------------------------


@shapes
def test_in_the_plane_it_is_the_planar_contact(kind):
    flat = {
        name: np.delete(value, 1) if np.ndim(value) else value
        for name, value in SHAPES[3][kind].items()
    }
    if "normal" in flat:
        flat["normal"] = flat["normal"] / np.linalg.norm(flat["normal"])
    level = {
        name: np.insert(value, 1, 0.0) if np.ndim(value) else value for name, value in flat.items()
    }
    planar, spatial = (
        one_edge(axes, friction=FRICTION, **shape) for axes, shape in ((2, flat), (3, level))
    )
    rng = np.random.default_rng(5)
    for _ in range(10):
        position = window(rng, spatial, within=0.5, along=np.array([1, 0, 1]))
        velocity = rng.normal(size=(3, 4)) * [1.0, 0.0, 1.0, 0.0]
        velocity = closing(spatial, position, velocity, rate=-0.1)
        gap, force = push(spatial, position, velocity)
        expected = push(planar, *(rows[:, [0, 2]] for rows in (position, velocity)))
        assert gap == pytest.approx(float(expected[0]), abs=1e-16)
        assert np.abs(force).max() > 0.1
        np.testing.assert_allclose(force[:, [0, 2]], expected[1], rtol=1e-11, atol=1e-13)
        np.testing.assert_array_equal(force[:, [1, 3]], 0.0)


# --- friction ----------------------------------------------------------------------------------


def without_friction(contact):
    return eqx.tree_at(lambda c: c.friction, contact, jnp.zeros(()))


@shapes
def test_what_rubs_damps_the_gap_and_never_pulls(kind):
    contact, position, along = rubbed(2, kind)
    smooth = without_friction(contact)
    _, still = push(contact, position, along)
    for rate in (-0.2, 0.01, 5.0):
        velocity = closing(contact, position, along, rate)
        (gap, force), (_, elastic) = (push(c, position, velocity) for c in (contact, smooth))
        pressing = float(contact.press(jnp.asarray(gap))[1])
        stiffness = 4 * pressing / (contact.skin - gap)
        pushed = pressing - 0.4 * np.sqrt(float(contact.mass) * stiffness) * rate  # twice 0.2
        np.testing.assert_allclose(
            force - elastic * max(pushed, 0.0) / pressing,
            (still - elastic) * max(pushed, 0.0) / pressing,
            atol=1e-12 * np.abs(still).max(),
        )


def at_surface(contact, position, velocity):
    """Return where the arm's surface is touched, and how fast it moves there, by hand."""
    places, moves = position[:, :3], velocity[:, :3]
    _, slopes, share = closest(contact, places)
    outward = -slopes[2] / np.linalg.norm(slopes[2])
    edge = places[1] - places[0]
    tangent = edge / np.linalg.norm(edge)
    lever = -THICK * outward
    rate = np.cross(tangent, moves[1] - moves[0]) / np.linalg.norm(edge) + velocity[1, 3] * tangent
    speed = (1 - share) * moves[0] + share * moves[1] + np.cross(rate, lever) - moves[2]
    return places[0] + share * edge + lever, speed - (speed @ outward) * outward, tangent


@shapes
def test_friction_is_one_force_at_the_surface(kind):
    for seed in (2, 3, 4):
        contact, position, velocity = rubbed(seed, kind)
        gap, force = push(contact, position, velocity)
        # nothing is lost: forces add up to none, and those on the arm, with the torque about the
        # edge, have no moment about the point where the surfaces touch
        assert np.abs(force[:, :3]).max() > 1.0
        np.testing.assert_allclose(force[:, :3].sum(axis=0), 0.0, atol=1e-13)
        point, sliding, tangent = at_surface(contact, position, velocity)
        moment = np.cross(position[:2, :3] - point, force[:2, :3]).sum(axis=0)
        assert np.abs(force[1, 3]) > 1e-4
        np.testing.assert_allclose(moment + force[1, 3] * tangent, 0.0, atol=1e-14)
        # what obstacles and the edge before get
        np.testing.assert_array_equal(force[[0, 2], 3], 0.0)
        # it is against the sliding, and takes its power
        _, pressed = push(without_friction(contact), position, velocity)
        rubbing = force - pressed
        _, pressing = contact.press(jnp.asarray(gap))
        against = -FRICTION * float(pressing) * sliding / np.sqrt(sliding @ sliding + CREEP**2)
        np.testing.assert_allclose(rubbing[:2, :3].sum(axis=0), against, rtol=1e-9, atol=1e-12)
        taken = against @ sliding
        assert np.sum(rubbing * velocity) == pytest.approx(taken, rel=1e-12)
        assert taken < -0.1


@shapes
def test_it_turns_with_everything(kind):
    contact, position, velocity = rubbed(6, kind)
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7])

    def turned(rows):
        return np.concatenate([turn.apply(np.array(rows[:, :3])), rows[:, 3:]], axis=1)

    core, normal = (
        jnp.asarray(turn.apply(np.array(v))) for v in (contact.half_axis, contact.normal)
    )
    aslant = eqx.tree_at(lambda c: (c.half_axis, c.normal), contact, (core, normal))
    gap, force = push(contact, position, velocity)
    gap_aslant, force_aslant = push(aslant, turned(position), turned(velocity))
    assert gap_aslant == pytest.approx(float(gap), abs=1e-14)
    # a cylinder's core is a kilometre long: round-off of that
    atol = 1e-7 if kind == "cylinder" else 1e-9
    np.testing.assert_allclose(force_aslant, turned(force), atol=atol)


# --- bodies and their rows ---------------------------------------------------------------------


def crowd(**changes):
    """Return a rod of 6 nodes along x, three obstacles beside it, and rows that move."""
    rod = Rod.round(length=0.5, nodes=6, radius=0.02, density=1080.0, youngs_modulus=5e5)
    place = jnp.asarray([[0.17, 0.0304, -0.0393], [0.36, -0.0242, 0.0323], [0.0, 0.0, -0.0254]])
    drift = jnp.asarray([[0.1, -0.2, 0.3], [0.0, 0.5, -0.1], [0.2, 0.1, 0.0]])
    build = obstacles(
        place,
        radius=[0.03, 0.02, 0.0],
        half_axis=[[0.0] * 3, [0.0, 0.4, 0.3], [0.0] * 3],
        normal=[[0.0] * 3, [0.0] * 3, [0.0, 0.6, 0.8]],
        friction=0.3,
        velocity=drift,
        density=1e3,
        gravity=9.81,
        carried=(0, 1),
        **{"mass": [0.2, np.inf, np.inf]} | changes,
    )
    rng = np.random.default_rng(9)
    nodes = np.zeros((7, 4))
    nodes[:, 0] = np.linspace(-0.1, 0.5, 7)
    spin = ((0, 0), (0, 1))
    turns = np.pad(rng.normal(size=(3, 3)) * [[1.0], [0.0], [0.0]], spin)
    position = np.concatenate([nodes, np.pad(place, spin), 0.0 * turns])
    velocity = np.concatenate([rng.normal(size=(7, 4)), np.pad(drift, spin), turns])
    return build(rod), moving(position, velocity)


def test_what_obstacles_do_to_the_rows_of_nodes_and_back():
    (bodies, motion), pose = crowd(), Pose.unturned(3, 3)
    gap, rows = jax.jit(lambda motion: bodies.push(motion, 7, pose))(motion)
    touch, pushed = jax.jit(lambda motion: bodies.touch(motion, 7, pose))(motion)
    assert gap.shape == (3, 5)
    assert rows.shape == (13, 4)
    assert touch.in_contact.all()
    np.testing.assert_array_equal(rows[:2, 3], 0.0)  # no edge of the arm ends at root or ghost
    np.testing.assert_array_equal(rows[-6:, 3], 0.0)
    assert np.abs(rows[2:7, 3]).max() > 1e-4
    np.testing.assert_allclose(touch.force, -rows[-6:-3, :3])
    np.testing.assert_allclose(pushed, rows[:-6])
    np.testing.assert_allclose(pushed[:, :3].sum(0), touch.force.sum(0), atol=1e-12)
    assert touch.impulse.shape == (3, 3)
    later = touch.since(touch, jnp.asarray(0.01))
    np.testing.assert_allclose(later.impulse, 0.01 * touch.force)
    # what an edge spins does not count as having moved past something
    spun = motion.position.at[:7, 3].add(50.0)
    (contacts,), gap = bodies.groups(7, pose), gap.reshape(-1)
    resolved = jax.jit(lambda *rows: contacts.resolved(*rows))
    assert resolved(spun - motion.position, gap, gap, jnp.asarray(0.01))
    jumped = motion.position.at[-6, 1].add(0.2)
    assert not resolved(jumped - motion.position, gap, gap, jnp.asarray(0.01))


def test_carried_obstacles_follow_the_water_in_space_at_order_two():
    # round the z axis at 1 rad/s, and up
    def water(places):
        x, y, _ = places.T
        return jnp.stack([-y, x, jnp.full_like(x, 0.2)], axis=1)

    bodies, _ = crowd(mass=None)
    errors = []
    for steps in (5, 10, 20):
        position = bodies.position.at[1].set(jnp.asarray([1.0, 0.0, -2.0]))
        velocity = bodies.begin(position, water)
        np.testing.assert_allclose(velocity[1], [0.0, 1.0, 0.2])
        np.testing.assert_allclose(velocity[2], bodies.drift[2])
        for _ in range(steps):
            flow = water(position)
            position, velocity = bodies.prescribed_motion(
                position, flow, water, jnp.asarray(1 / steps)
            )
        end = np.array([np.cos(1.0), np.sin(1.0), -1.8])
        errors.append(np.linalg.norm(np.asarray(position)[1] - end))
        np.testing.assert_allclose(position[2], [0.2, 0.1, -0.0254], atol=1e-12)
        np.testing.assert_allclose(velocity[1], water(position[1:2])[0])
    assert order(errors) == pytest.approx(2.0, abs=0.15)


# --- in the chain ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_hit_beside_the_axis_keeps_momentum_and_energy(friction):
    velocity = np.array([0.0, 0.1, 0.3])
    ball = {
        "kind": "sphere",
        "radius": 0.03,
        "mass": 0.2,
        "friction": friction,
        "position": [0.4, 0.02, -0.055],
        "velocity": velocity.tolist(),
    }
    in_vacuum = crinoid.Scenario(
        arm={"dimension": 3, "nodes": 8, "youngs_modulus": 5e5, "damping_time": 0.0},
        base={"position": [0.0] * 3},
        water={"density": 0.0, "gravity": 0.0},
        obstacle=[ball],
        simulation={"time_step": 2e-3, "max_halvings": 10},
    )
    system = crinoid.system(in_vacuum)
    end, _ = march(system, rest(system), 100)
    assert_momentum_kept(end, 0.2, velocity, rtol=1e-6, atol=1e-8)
    kept = kept_energy(end, 0.2, velocity)
    if friction:
        assert 0.7 < kept < 0.95  # the rest went into friction
        assert np.abs(end.motion.velocity[:, 3]).max() > 0.1  # it spins
    else:
        assert kept == pytest.approx(1.0, abs=0.01)
    np.testing.assert_array_equal(end.motion.position[-1, 3], 0.0)
