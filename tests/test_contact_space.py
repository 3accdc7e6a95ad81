"""Contact in space: gaps, slopes, friction that turns and twists the arm, bodies of three axes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import crinoid
from crinoid.dynamics import Obstacles
from crinoid.elements import Body, Contact, Motion
from crinoid.elements.contact import _EASE
from crinoid.rod import Rod
from physics import Kept, order

RADIUS, CREEP = 0.01, 1e-3
FRICTION = 0.4

SHAPES = {
    "sphere": {"radius": 0.03},
    "capsule": {"radius": 0.02, "half_axis": (0.05, -0.04, 0.03)},
    "cylinder": {"radius": 0.02, "half_axis": (480.0, 640.0, 600.0)},
    "plane": {"normal": (0.48, 0.6, 0.64)},
}
shapes = pytest.mark.parametrize("kind", SHAPES)


def one_edge(*, friction=0.0, axes=3, **shape):
    """Return the contact of one edge of 0.1 m, 10 mm thick, with one obstacle."""
    none = (0.0,) * axes
    numbers = (
        *(0.1, RADIUS, 50.0, shape.get("radius", 0.0)),
        *(shape.get("half_axis", none), shape.get("normal", none), friction, 0.1),
    )
    return Contact(1, *(jnp.asarray(number, float) for number in numbers))


def moving(position, velocity):
    """Return the motion of a window in still water."""
    position, velocity = jnp.asarray(position, float), jnp.asarray(velocity, float)
    axes = 2 if position.shape[-1] == 2 else 3
    still = jnp.zeros((*position.shape[:-1], axes))
    return Motion(position, velocity, 0 * velocity, still, still, jnp.zeros(()))


@eqx.filter_jit
def _push(contact, motion):
    return contact.push(motion)


def push(contact, position, velocity=None):
    """Return the gap and the forces of a window."""
    velocity = np.zeros_like(position) if velocity is None else velocity
    return jax.tree.map(np.asarray, _push(contact, moving(position, velocity)))


@eqx.filter_jit
def _potential(contact, position):
    """Return the energy in the skin."""
    return contact.press(contact.gap(position))[0]


@eqx.filter_jit
def _closest(contact, places):
    return contact._closest(places)


def window(rng, contact, *, within=None, axes=(1, 1, 1)):
    """Return a window at random, its surfaces ``within`` the skin if that is given."""
    edge = axes * rng.normal(size=3)
    near, place = axes * rng.uniform(-0.15, 0.15, 3), axes * rng.uniform(-0.05, 0.05, 3)
    places = np.stack([near, near + 0.1 * edge / np.linalg.norm(edge), place])
    if within is not None:
        for _ in range(3):  # along the slope the gap is all but straight
            gap, slopes, _ = map(np.asarray, _closest(contact, jnp.asarray(places)))
            away = slopes[2] / np.linalg.norm(slopes[2])
            places[2] -= away * (gap - within * float(contact.skin)) / np.linalg.norm(slopes[2])
    return np.concatenate([places, rng.normal(size=(3, 1))], axis=1)


def closing(contact, position, velocity, rate=0.0):
    """Return velocities at which the gap changes at a ``rate`` (m/s), by the obstacle's."""
    _, slopes, _ = map(np.asarray, _closest(contact, jnp.asarray(position[:, :3])))
    off = np.sum(slopes * velocity[:, :3]) - rate
    velocity = velocity.copy()
    velocity[2, :3] -= off * slopes[2] / (slopes[2] @ slopes[2])
    return velocity


def rubbed(seed, kind):
    """Return a contact with friction, a window that is in touch, and velocities along surfaces."""
    rng = np.random.default_rng(seed)
    contact = one_edge(friction=FRICTION, **SHAPES[kind])
    position = window(rng, contact, within=0.5)
    return contact, position, closing(contact, position, rng.normal(size=(3, 4)))


# --- geometry ----------------------------------------------------------------------------------


def eased(shape, position):
    """Return the gap by brute force: the least over the edge, eased toward its middle."""
    near, far, place = position[:, :3]
    share = np.linspace(0, 1, 4001)[:, None]
    points = near + share * (far - near)
    if "normal" in shape:
        pull = 0.5 * _EASE * 0.1 * (share[:, 0] - 0.5) ** 2
        return ((points - place) @ np.asarray(shape["normal"]) + pull).min() - RADIUS
    core = np.asarray(shape.get("half_axis", (0.0, 0.0, 0.0)))
    along = np.clip((points - place) @ core / max(core @ core, 1e-300), -1, 1)[:, None]
    squared = np.sum((points - place - along * core) ** 2, axis=1)
    squared += _EASE * np.sum((far - near) ** 2) * (share[:, 0] - 0.5) ** 2
    return np.sqrt(squared.min()) - shape["radius"] - RADIUS


@shapes
def test_gap_is_the_least_distance_at_any_angle(kind):
    rng = np.random.default_rng(3)
    contact = one_edge(**SHAPES[kind])
    for _ in range(60):
        position = window(rng, contact)
        gap, _ = push(contact, position)
        if gap < -RADIUS:  # the middles overlap: no distance to speak of
            continue
        # steps of 1/4000 of the edge: within h^2 / (2 * 20 mm)
        assert 0.0 <= eased(SHAPES[kind], position) - gap + 1e-12 < 2e-8


def test_crossed_cores_are_as_far_apart_as_their_common_normal_is_long():
    # an arm along x over a pipe along y, and one aslant, 50 mm over it
    for axis in ([0.0, 1000.0, 0.0], [600.0, 800.0, 0.0]):
        contact = one_edge(radius=0.02, half_axis=axis)
        position = [[-0.05, 0.3, 0.05, 0.0], [0.05, 0.3, 0.05, 0.0], [0.0, 0.3, 0.0, 0.0]]
        gap, _ = push(contact, np.array(position))
        assert gap == pytest.approx(0.05 - 0.02 - RADIUS, abs=1e-12)


@shapes
def test_force_is_the_slope_of_the_skins_potential(kind):
    contact, position, _ = rubbed(1, kind)
    force, step = push(contact, position)[1], 1e-8
    assert np.abs(force).max() > 1.0
    for entry in np.ndindex(3, 4):
        moved = np.zeros((3, 4))
        moved[entry] = step
        ahead, behind = (
            float(_potential(contact, jnp.asarray(position + s * moved))) for s in (1, -1)
        )
        assert force[entry] == pytest.approx(-(ahead - behind) / (2 * step), abs=1e-6)
    np.testing.assert_allclose(force[:, :3].sum(axis=0), 0.0, atol=1e-14)
    np.testing.assert_array_equal(force[:, 3], 0.0)


@shapes
def test_in_the_plane_it_is_the_planar_contact(kind):
    flat = {
        name: np.delete(value, 1) if np.ndim(value) else value
        for name, value in SHAPES[kind].items()
    }
    if "normal" in flat:
        flat["normal"] = flat["normal"] / np.linalg.norm(flat["normal"])
    level = {
        name: np.insert(value, 1, 0.0) if np.ndim(value) else value for name, value in flat.items()
    }
    planar, spatial = (
        one_edge(friction=FRICTION, axes=axes, **shape) for axes, shape in ((2, flat), (3, level))
    )
    rng = np.random.default_rng(5)
    for _ in range(10):
        position = window(rng, spatial, within=0.5, axes=(1, 0, 1))
        velocity = rng.normal(size=(3, 4)) * [1.0, 0.0, 1.0, 0.0]
        velocity = closing(spatial, position, velocity, rate=-0.1)
        gap, force = push(spatial, position, velocity)
        expected = push(planar, *(rows[:, [0, 2]] for rows in (position, velocity)))
        assert gap == pytest.approx(float(expected[0]), abs=1e-16)
        assert np.abs(force).max() > 0.1
        np.testing.assert_allclose(force[:, [0, 2]], expected[1], rtol=1e-11, atol=1e-13)
        np.testing.assert_array_equal(force[:, [1, 3]], 0.0)


# --- friction ----------------------------------------------------------------------------------


@shapes
def test_what_rubs_damps_the_gap_and_never_pulls(kind):
    contact, position, along = rubbed(2, kind)
    smooth = eqx.tree_at(lambda c: c.friction, contact, jnp.zeros(()))
    _, still = push(contact, position, along)
    for rate in (-0.2, 0.01, 5.0):
        velocity = closing(contact, position, along, rate)
        (gap, force), (_, elastic) = (push(c, position, velocity) for c in (contact, smooth))
        pressing = float(contact.press(jnp.asarray(gap))[1])
        stiffness = 4 * pressing / (contact.skin - gap)
        pushed = pressing - 0.4 * np.sqrt(float(contact.mass) * stiffness) * rate  # twice 0.2
        np.testing.assert_allclose(force - elastic * max(pushed, 0.0) / pressing,
                                   (still - elastic) * max(pushed, 0.0) / pressing,
                                   atol=1e-12 * np.abs(still).max())  # fmt: skip


def at_surface(contact, position, velocity):
    """Return where the arm's surface is touched, and how fast it moves there, by hand."""
    places, moves = position[:, :3], velocity[:, :3]
    _, slopes, share = map(np.asarray, _closest(contact, jnp.asarray(places)))
    outward = -slopes[2] / np.linalg.norm(slopes[2])
    edge = places[1] - places[0]
    tangent = edge / np.linalg.norm(edge)
    lever = -RADIUS * outward
    rate = np.cross(tangent, moves[1] - moves[0]) / np.linalg.norm(edge) + velocity[1, 3] * tangent
    speed = (1 - share) * moves[0] + share * moves[1] + np.cross(rate, lever) - moves[2]
    return places[0] + share * edge + lever, speed - (speed @ outward) * outward, tangent


@shapes
@pytest.mark.parametrize("seed", [2, 3, 4])
def test_friction_is_one_force_at_the_surface(kind, seed):
    # nothing is lost: forces add up to none, and those on the arm, with the torque about the
    # edge, have no moment about the point where the surfaces touch
    contact, position, velocity = rubbed(seed, kind)
    _, force = push(contact, position, velocity)
    assert np.abs(force[:, :3]).max() > 1.0
    np.testing.assert_allclose(force[:, :3].sum(axis=0), 0.0, atol=1e-13)
    point, _, tangent = at_surface(contact, position, velocity)
    moment = np.cross(position[:2, :3] - point, force[:2, :3]).sum(axis=0) + force[1, 3] * tangent
    assert np.abs(force[1, 3]) > 1e-4
    np.testing.assert_allclose(moment, 0.0, atol=1e-14)
    np.testing.assert_array_equal(force[[0, 2], 3], 0.0)  # what obstacles and the edge before get


@shapes
@pytest.mark.parametrize("seed", [2, 3, 4])
def test_friction_takes_the_power_of_sliding(kind, seed):
    contact, position, velocity = rubbed(seed, kind)
    smooth = eqx.tree_at(lambda c: c.friction, contact, jnp.zeros(()))
    gap, force = push(contact, position, velocity)
    _, pressed = push(smooth, position, velocity)
    _, sliding, _ = at_surface(contact, position, velocity)
    _, pressing = contact.press(jnp.asarray(gap))
    taken = -FRICTION * float(pressing) * sliding @ sliding / np.sqrt(sliding @ sliding + CREEP**2)
    assert np.sum((force - pressed) * velocity) == pytest.approx(taken, rel=1e-12)
    assert taken < -0.1


def test_what_slides_across_the_arm_twists_it():
    contact = one_edge(friction=FRICTION, **SHAPES["sphere"])
    under = -0.03 - RADIUS - 0.5 * float(contact.skin)
    position = np.array([[-0.05, 0, 0, 0.3], [0.05, 0, 0, 0.7], [0.0, 0, under, 0]])
    velocity = np.zeros((3, 4))
    velocity[2] = [0.0, 0.2, 0.0, 0.0]  # to port under an arm along x: right-handed about it
    gap, force = push(contact, position, velocity)
    pressing = float(contact.press(jnp.asarray(gap))[1])
    rounded = 0.2 / np.hypot(0.2, CREEP)
    assert force[1, 3] == pytest.approx(FRICTION * pressing * RADIUS * rounded, rel=1e-12)
    np.testing.assert_allclose(force[0, :3], force[1, :3], atol=1e-14)  # carried along evenly
    assert 2 * force[0, 1] == pytest.approx(FRICTION * pressing * rounded, rel=1e-12)
    # an arm that rolls on what slides is not rubbed
    velocity[1, 3] = 0.2 / RADIUS
    _, rolling = push(contact, position, velocity)
    np.testing.assert_allclose(rolling[:, [1, 3]], 0.0, atol=1e-14)
    # and one that spins on what rests walks to starboard
    velocity[2] = 0.0
    _, walking = push(contact, position, velocity)
    assert walking[1, 3] < 0
    assert 2 * walking[0, 1] == pytest.approx(-FRICTION * pressing * rounded, rel=1e-12)


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


def test_a_free_body_obeys_newton_along_three_axes_and_does_not_spin():
    mass, radius = np.array([0.3, 0.1]), np.array([0.04, 0.02])
    made_of = {"mass": jnp.asarray(mass), "radius": jnp.asarray(radius)}
    bodies = Body.of(**made_of, density=1000.0, gravity=9.81)
    rng = np.random.default_rng(8)
    position, velocity, acceleration = rng.normal(size=(3, 2, 1, 4))
    water, gaining = rng.normal(size=(2, 2, 1, 3))
    rows = (position, velocity, acceleration, water, gaining, np.zeros(2))
    motion = Motion(*map(jnp.asarray, rows))
    residual = jax.jit(jax.vmap(Body.residual))(bodies, motion)
    displaced = 1000 * 4 / 3 * np.pi * radius**3
    for body in range(2):
        relative = (water - velocity[..., :3])[body, 0]
        felt = displaced[body] * (1.5 * gaining - 0.5 * acceleration[..., :3])[body, 0]
        felt += 500 * 0.47 * np.pi * radius[body] ** 2 * np.linalg.norm(relative) * relative
        felt[2] -= (mass - displaced)[body] * 9.81
        lacking = mass[body] * acceleration[body, 0, :3] - felt
        np.testing.assert_allclose(residual[body, 0, :3], lacking, rtol=1e-12)
    # the last coordinate has an inertia and no force: it stays as it is, and the matrix regular
    np.testing.assert_allclose(residual[:, 0, 3], mass * acceleration[:, 0, 3])


def crowd(**changes):
    """Return a rod of 6 nodes along x, three obstacles beside it, and rows that move."""
    rod = Rod.round(length=0.5, nodes=6, radius=0.02, density=1080.0, youngs_modulus=5e5)
    count = 3
    contact = Contact.of(
        rod,
        radius=jnp.asarray([0.03, 0.02, 0.0]),
        half_axis=jnp.asarray([[0.0] * 3, [0.0, 0.4, 0.3], [0.0] * 3]),
        normal=jnp.asarray([[0.0] * 3, [0.0] * 3, [0.0, 0.6, 0.8]]),
        friction=jnp.full(count, 0.3),
        mass=jnp.asarray([0.2, jnp.inf, jnp.inf]),
    )
    bodies = Body.of(mass=jnp.asarray([0.2]), radius=jnp.asarray([0.03]), density=1e3, gravity=9.81)
    place = jnp.asarray([[0.17, 0.0304, -0.0393], [0.36, -0.0242, 0.0323], [0.0, 0.0, -0.0254]])
    drift = jnp.asarray([[0.1, -0.2, 0.3], [0.0, 0.5, -0.1], [0.2, 0.1, 0.0]])
    settings = {"free": (0,), "carried": (0, 1)} | changes
    obstacles = Obstacles(contact, bodies, place, drift, **settings)
    rng = np.random.default_rng(9)
    nodes = np.zeros((7, 4))
    nodes[:, 0] = np.linspace(-0.1, 0.5, 7)
    spin = ((0, 0), (0, 1))
    position = np.concatenate([nodes, np.pad(place, spin)])
    velocity = np.concatenate([rng.normal(size=(7, 4)), np.pad(drift, spin)])
    return obstacles, moving(position, velocity)


def test_what_obstacles_do_to_the_rows_of_nodes_and_back():
    obstacles, motion = crowd()
    gap, rows = jax.jit(lambda motion: obstacles.push(motion))(motion)
    touch, pushed = jax.jit(lambda motion: obstacles.touch(motion))(motion)
    assert gap.shape == (3, 5)
    assert rows.shape == (10, 4)
    assert touch.in_contact.all()
    np.testing.assert_array_equal(rows[:2, 3], 0.0)  # no edge of the arm ends at root or ghost
    np.testing.assert_array_equal(rows[-3:, 3], 0.0)
    assert np.abs(rows[2:7, 3]).max() > 1e-4
    np.testing.assert_allclose(touch.force, -rows[-3:, :3])
    np.testing.assert_allclose(pushed, rows[:-3])
    np.testing.assert_allclose(pushed[:, :3].sum(0), touch.force.sum(0), atol=1e-12)
    assert touch.impulse.shape == (3, 3)
    later = touch.since(touch, jnp.asarray(0.01))
    np.testing.assert_allclose(later.impulse, 0.01 * touch.force)
    # what an edge spins does not count as having moved past something
    spun = motion.position.at[:7, 3].add(50.0)
    resolved = jax.jit(lambda *rows: obstacles.resolved(*rows))
    assert resolved(motion.position, gap, spun, gap, jnp.asarray(0.01))
    jumped = motion.position.at[-3, 1].add(0.2)
    assert not resolved(motion.position, gap, jumped, gap, jnp.asarray(0.01))


def test_carried_obstacles_follow_the_water_in_space_at_order_two():
    # round the z axis at 1 rad/s, and up
    def water(places):
        x, y, _ = places.T
        return jnp.stack([-y, x, jnp.full_like(x, 0.2)], axis=1)

    obstacles, _ = crowd(free=())
    errors = []
    for steps in (5, 10, 20):
        position = obstacles.position.at[1].set(jnp.asarray([1.0, 0.0, -2.0]))
        velocity = obstacles.begin(position, water)
        np.testing.assert_allclose(velocity[1], [0.0, 1.0, 0.2])
        np.testing.assert_allclose(velocity[2], obstacles.drift[2])
        for _ in range(steps):
            flow = water(position)
            position, velocity = obstacles.lead(position, flow, water, jnp.asarray(1 / steps))
        end = np.array([np.cos(1.0), np.sin(1.0), -1.8])
        errors.append(np.linalg.norm(np.asarray(position)[1] - end))
        np.testing.assert_allclose(position[2], [0.2, 0.1, -0.0254], atol=1e-12)
        np.testing.assert_allclose(velocity[1], water(position[1:2])[0])
    assert order(errors) == pytest.approx(2.0, abs=0.15)


# --- in the chain ------------------------------------------------------------------------------

advance = eqx.filter_jit(lambda system, state: state.advance(system, jnp.zeros(len(system.inputs))))
rest = eqx.filter_jit(lambda system: Kept.of(system, system.rest()))


def hit(place, velocity, *, axes=3, friction=0.0):
    """Build an arm in a vacuum that a free ball flies at; y is left out of the plane."""
    keep = [0, 1, 2] if axes == 3 else [0, 2]
    ball = {
        "kind": "sphere",
        "position": [place[axis] for axis in keep],
        "velocity": [velocity[axis] for axis in keep],
        "radius": 0.03,
        "mass": 0.2,
        "friction": friction,
    }
    return crinoid.system(
        crinoid.Scenario(
            arm={"dimension": axes, "nodes": 8, "youngs_modulus": 5e5, "damping_time": 0.0},
            base={"position": [0.0] * axes},
            water={"density": 0.0, "gravity": 0.0},
            obstacle=[ball],
            simulation={"time_step": 2e-3, "max_halvings": 10},
        )
    )


def march(system, steps):
    state = rest(system)
    for _ in range(steps):
        state, progress = advance(system, state)
        assert progress.outcome.converged
    return state


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_hit_beside_the_axis_keeps_momentum_and_energy(friction):
    velocity = np.array([0.0, 0.1, 0.3])
    end = march(hit([0.4, 0.02, -0.055], velocity, friction=friction), 100)
    gained = 0.2 * (np.asarray(end.obstacle_velocity[0]) - velocity)
    np.testing.assert_allclose(gained, -np.asarray(end.touch.impulse[0]), rtol=1e-6, atol=1e-8)
    before, ball = 0.1 * velocity @ velocity, 0.1 * np.sum(np.square(end.obstacle_velocity[0]))
    kept = (ball + float(end.energy.sum())) / before
    spun = np.abs(end.motion.velocity[:, 3]).max()
    if friction:
        assert 0.7 < kept < 0.95  # the rest went into friction
        assert spun > 0.1
    else:
        assert kept == pytest.approx(1.0, abs=0.01)
    np.testing.assert_array_equal(end.motion.position[-1, 3], 0.0)


def test_a_hit_in_the_plane_is_the_planar_one():
    place, velocity = [0.4, 0.0, -0.055], [-0.1, 0.0, 0.3]
    flat, full = (march(hit(place, velocity, axes=axes, friction=0.3), 60) for axes in (2, 3))
    assert float(jnp.abs(flat.touch.impulse).max()) > 0.01
    np.testing.assert_allclose(full.position[:, [0, 2]], flat.position, atol=1e-9)
    np.testing.assert_allclose(full.touch.impulse[:, [0, 2]], flat.touch.impulse, atol=1e-9)
    np.testing.assert_allclose(full.position[:, 1], 0.0, atol=1e-12)
