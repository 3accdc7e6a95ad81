"""Contact: the right gap, exact slopes, momentum and energy kept, nothing passes through."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.base import VelocityMotion
from crinoid.dynamics import Integrator, Obstacles
from crinoid.dynamics.integrator import Stage
from crinoid.elements import Contact, DistributedLoad, Motion, TipLoad
from crinoid.elements.contact import SKIN
from crinoid.flow import PowerShear
from crinoid.onset import Onset
from physics import Kept, always, arm, obstacles, order

LENGTH = 0.5
RADIUS = 0.02
MODULUS = 5e5
SOFT = {
    "length": LENGTH,
    "nodes": 11,
    "EA": None,
    "EI": None,
    "radius": RADIUS,
    "youngs_modulus": MODULUS,
    "mass_per_length": 1080 * np.pi * RADIUS**2,
    "diameter": 2 * RADIUS,
    "displaced_area": np.pi * RADIUS**2,
    "max_halvings": 10,
    "tolerance": 1e-9,
}

advance = eqx.filter_jit(lambda system, state: state.advance(system, jnp.zeros(len(system.inputs))))
rest = eqx.filter_jit(lambda system: Kept.of(system, system.rest()))


@eqx.filter_jit
def balance(system):
    state, outcome = system.find_equilibrium()
    return Kept.of(system, state), outcome


def march(system, state, steps):
    """Return the state after some time steps, and how many shorter ones they took."""
    taken = 0
    for _ in range(steps):
        state, progress = advance(system, state)
        assert progress.outcome.converged
        taken += int(progress.steps)
    return state, taken


# --- geometry ----------------------------------------------------------------------------------


def one_edge(**shape):
    """Return the contact of one edge of 0.1 m, 10 mm thick, with one obstacle."""
    return Contact(
        1,
        jnp.asarray(0.1),
        jnp.asarray(0.01),
        jnp.asarray(50.0),
        jnp.asarray(shape.get("radius", 0.0)),
        jnp.asarray(shape.get("half_axis", (0.0, 0.0))),
        jnp.asarray(shape.get("normal", (0.0, 0.0))),
        jnp.asarray(shape.get("friction", 0.0)),
        jnp.asarray(0.1),
    )


SHAPES = {
    "sphere": {"radius": 0.03},
    "capsule": {"radius": 0.02, "half_axis": (0.05, 0.03)},
    "cylinder": {"radius": 0.02, "half_axis": (600.0, 800.0)},
    "plane": {"normal": (0.6, 0.8)},
}


def distance(shape, position):
    """Return the distance of the surfaces by brute force."""
    near, far, place = np.asarray(position)
    share = np.linspace(0, 1, 2001)[:, None]
    points = near + share * (far - near)
    if "normal" in shape:
        return ((points - place) @ np.asarray(shape["normal"])).min() - 0.01
    core = np.asarray(shape.get("half_axis", (0.0, 0.0)))
    along = np.clip((points - place) @ core / max(core @ core, 1e-300), -1, 1)[:, None]
    apart = np.linalg.norm(points - place - along * core, axis=1)
    return apart.min() - shape["radius"] - 0.01


@pytest.mark.parametrize("kind", SHAPES)
def test_gap_is_the_distance_of_the_surfaces(kind):
    shape = SHAPES[kind]
    contact = one_edge(**shape)
    gap = jax.jit(lambda position: contact.gap(position))
    rng = np.random.default_rng(3)
    for _ in range(40):
        angle = rng.uniform(0, 2 * np.pi)
        near = rng.uniform(-0.15, 0.15, 2)
        far = near + 0.1 * np.array([np.cos(angle), np.sin(angle)])
        position = np.stack([near, far, rng.uniform(-0.05, 0.05, 2)])
        exact = distance(shape, position)
        if exact < -0.01:  # the middles overlap: no distance to speak of
            continue
        # drawing the point of contact to the middle of the edge can only widen the gap, by less
        # than e^2 _EASE / (8 distance)
        excess = float(gap(jnp.asarray(position))) - exact
        assert -1e-6 < excess < 0.01 * 0.1**2 / (8 * 0.02) + 1e-6


@pytest.mark.parametrize("kind", SHAPES)
def test_force_is_the_slope_of_the_skins_potential(kind):
    contact = one_edge(**SHAPES[kind])
    position = jnp.asarray([[-0.04, 0.031], [0.06, 0.038], [0.01, -0.0]])
    # bring the surfaces together, to the middle of the skin
    gap, slopes, _ = contact._closest(position)
    push = -slopes[2] / jnp.linalg.norm(slopes[2])
    position = position.at[2].add(push * (gap - 0.5 * contact.skin))

    def potential(position):
        return contact.press(contact.gap(position))[0]

    still = jnp.zeros_like(position)
    motion = Motion(position, still, still, still, still, jnp.zeros(()))
    force = -contact.residual(motion)
    assert float(jnp.abs(force).max()) > 1.0
    np.testing.assert_allclose(force, -jax.grad(potential)(position), rtol=1e-9, atol=1e-12)
    scale = float(jnp.abs(force).max())
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-14 * scale)


@pytest.mark.parametrize("kind", ["sphere"])
def test_contact_keeps_angular_momentum(kind):
    contact = one_edge(**SHAPES[kind])
    position = jnp.asarray([[-0.04, 0.031], [0.06, 0.045], [0.01, -0.002]])
    still = jnp.zeros_like(position)
    force = -contact.residual(Motion(position, still, still, still, still, jnp.zeros(())))
    moment = position[:, 0] * force[:, 1] - position[:, 1] * force[:, 0]
    assert float(jnp.abs(moment).max()) > 0.01
    np.testing.assert_allclose(moment.sum(), 0.0, atol=1e-14)


def test_skin_is_a_twentieth_of_the_arms_radius():
    contact = one_edge(**SHAPES["sphere"])
    assert float(contact.skin) == pytest.approx(SKIN * 0.01)
    potential, force = contact.press(jnp.asarray([1.0, 1.001, 0.0]) * contact.skin)
    np.testing.assert_allclose(force, [0.0, 0.0, 50.0])
    np.testing.assert_allclose(potential, [0.0, 0.0, 50.0 * SKIN * 0.01 / 5])


# --- slopes ------------------------------------------------------------------------------------


def crowd(**changes):
    """Build an arm between bodies that press on it: two free ones, a led one and the bed."""
    places = [(0.22, -0.0395), (0.31, 0.0394), (0.43, -0.0393), (0.3, -0.0195)]

    def of(rod):
        whole = obstacles(
            places,
            radius=RADIUS,
            normal=[(0, 0), (0, 0), (0, 0), (0, 1)],
            friction=0.4,
            velocity=[(0.1, 0.2), (-0.1, -0.2), (0.05, 0.1), (0.0, 0.0)],
            mass=0.05,
            density=1000.0,
            gravity=9.81,
        )(rod)
        bodies = jax.tree.map(lambda x: x[:2], whole.bodies)
        return Obstacles(whole.contact, bodies, whole.position, whole.drift, (0, 1), ())

    wet = {"nodes": 8, "damping_time": 0.02, "water_density": 1000.0, "gravity": 9.81}
    return arm(
        **SOFT | wet | changes,
        flows=(
            PowerShear(
                always(),
                jnp.asarray([0.4, 0.1]),
                reference_height=jnp.asarray(2.0),
                bed=jnp.asarray(-5.0),
                exponent=jnp.asarray(0.3),
            ),
        ),
        obstacles=of,
    )


def test_tangent_with_contacts_is_the_slope_of_the_residual():
    system = crowd()
    state = rest(system)
    forces, motion = system.forces, state.motion
    rng = np.random.default_rng(5)
    velocity = motion.velocity + 0.05 * rng.normal(size=motion.velocity.shape)
    h = 1e-3
    stage = Stage(
        state.time,
        motion.position,
        velocity,
        motion.acceleration,
        jnp.ones(()),
        jnp.asarray(2 / h),
        jnp.asarray(4 / h**2),
    )
    zero = jnp.zeros_like(motion.position)
    assert bool(state.touch.in_contact.all())

    def residual(correction):
        current = forces.surroundings(stage, zero)
        return forces.unknown(forces.residual(forces.motion(stage, correction, current))[0])

    @jax.jit
    def solved(rhs):
        current = forces.surroundings(stage, zero)
        now = forces.motion(stage, zero, current)
        return forces.tangent(stage, now, current).solve(rhs)

    rhs = jnp.asarray(rng.normal(size=zero.shape))
    change = solved(rhs)
    led = [0, 1, -2, -1]  # the held nodes, the led sphere and the bed
    assert not np.any(np.asarray(change)[led])
    slope = jax.jit(lambda d: jax.jvp(residual, (zero,), (d,))[1])(change)
    np.testing.assert_allclose(slope, forces.unknown(rhs), rtol=1e-8, atol=1e-9)


def test_gradient_of_a_step_in_contact_agrees_with_differences():
    system = crowd(time_step=1e-4, tolerance=1e-13)
    state = rest(system)
    rng = np.random.default_rng(8)
    weights, direction = jnp.asarray(rng.normal(size=(2, *state.motion.position.shape)))

    def after(shift):
        shifted = state.motion.position + shift
        moved = eqx.tree_at(lambda s: s.motion.position, state, shifted)
        end, _ = system.step(moved.state, jnp.zeros(len(system.inputs)))
        return jnp.sum(end.motion.position * weights)

    @jax.jit
    def along(distance):
        shift = distance * direction
        value, forward = jax.jvp(after, (shift,), (direction,))
        return value, (forward, jnp.sum(jax.grad(after)(shift) * direction))

    step = 1e-7
    difference = (along(step)[0] - along(-step)[0]) / (2 * step)
    assert abs(float(difference)) > 0.01
    np.testing.assert_allclose(along(0.0)[1], difference, rtol=1e-5)


# --- hits --------------------------------------------------------------------------------------


def hit(velocity, mass, *, place=(0.4, -0.06), **changes):
    """Build an arm in a vacuum that a free body flies at."""
    body = obstacles([place], velocity=[velocity], mass=mass, radius=RADIUS)
    return arm(**SOFT | {"obstacles": body} | changes)


@pytest.mark.parametrize(
    ("velocity", "mass", "place"),
    [
        ((0.0, 0.3), 0.05, (0.4, -0.06)),
        ((0.0, 1.0), 0.5, (0.37, -0.06)),
        ((0.2, 0.1), 0.02, (0.38, -0.05)),
        ((-0.3, 0.0), 0.05, (0.56, 0.001)),
    ],
)
def test_a_hit_keeps_momentum_and_energy(velocity, mass, place):
    # a hard hit sets off waves that take a step of their own length
    system = hit(velocity, mass, place=place, time_step=0.0025)
    end, taken = march(system, rest(system), 160)
    touch = end.touch
    assert taken > 160  # it was seen coming
    assert 0 < float(touch.duration[0]) < 0.05
    assert not touch.in_contact[0]
    # what the body lost the arm got
    gained = mass * (np.asarray(end.obstacle_velocity[0]) - velocity)
    np.testing.assert_allclose(gained, -np.asarray(touch.impulse[0]), rtol=1e-7, atol=1e-9)
    before = 0.5 * mass * np.sum(np.square(velocity))
    after = 0.5 * mass * np.sum(np.square(end.obstacle_velocity[0])) + float(end.energy.sum())
    assert after == pytest.approx(before, rel=0.01)
    # what the arm has was done on it by the contact
    assert float(end.work[-1]) == pytest.approx(float(end.energy.sum()), rel=0.01)
    assert float(touch.closest[0]) > -0.01 * RADIUS


def test_a_hit_of_what_rubs_gives_back_half_of_its_speed():
    # a body of a hundredth of an edge's mass on the middle of an edge: nothing but the skin moves
    def speed(friction):
        body = obstacles([(0.375, -0.045)], velocity=[(0.0, 0.3)], mass=1e-3, radius=RADIUS,
                         friction=friction)  # fmt: skip
        system = arm(**SOFT | {"obstacles": body}, time_step=0.0025)
        end, _ = march(system, rest(system), 20)
        assert not end.touch.in_contact[0]
        return -float(end.obstacle_velocity[0, 1]) / 0.3

    elastic, rubbed = speed(0.0), speed(0.3)
    assert 0.9 < elastic < 1.0
    assert 0.4 < rubbed < 0.6


def test_a_hit_under_generalized_alpha():
    velocity, mass = (0.0, 0.3), 0.05
    method = Integrator.generalized_alpha(0.8)
    system = hit(velocity, mass, time_step=0.0025, integrator=method)
    end, taken = march(system, rest(system), 160)
    touch = end.touch
    assert taken > 160  # halved where they met
    assert not touch.in_contact[0]
    assert float(touch.closest[0]) > -0.01 * RADIUS
    # forces are balanced between both ends of a step, the impulse is added up at the ends
    gained = mass * (np.asarray(end.obstacle_velocity[0]) - velocity)
    impulse = np.asarray(touch.impulse[0])
    np.testing.assert_allclose(gained, -impulse, rtol=0, atol=0.1 * np.abs(impulse).max())
    # what is too fast for a step it takes out, and never gives energy
    before = 0.5 * mass * np.sum(np.square(velocity))
    after = 0.5 * mass * np.sum(np.square(end.obstacle_velocity[0])) + float(end.energy.sum())
    assert 0.8 * before < after < 1.01 * before


def test_the_base_feels_a_hit_on_a_stiff_arm():
    # all momentum goes through a stiff arm into the base
    system = hit((0.0, 0.2), 0.05, youngs_modulus=5e7, damping_time=2e-3, time_step=1e-3)
    state, impulse = rest(system), np.zeros(2)
    for _ in range(400):
        before = np.asarray(state.base_force)
        state, _ = advance(system, state)
        impulse += 0.5e-3 * (before + np.asarray(state.base_force))
    arm_has = np.sum(SOFT["mass_per_length"] * LENGTH / 10 * np.asarray(state.velocity[2:-1]), 0)
    arm_has = arm_has + 0.5 * SOFT["mass_per_length"] * LENGTH / 10 * np.asarray(state.velocity[-1])
    np.testing.assert_allclose(impulse + arm_has, np.asarray(state.touch.impulse[0]), atol=2e-4)


@pytest.mark.parametrize("speed", [0.5, 1.0, 2.0])
def test_nothing_passes_through_a_thin_arm(speed):
    thin = {"radius": 0.003, "diameter": 0.006, "nodes": 11, "mass_per_length": 0.03}
    body = obstacles([(0.37, -0.0333)], velocity=[(0.0, speed)], mass=0.002, radius=0.002)
    system = arm(**SOFT | thin | {"obstacles": body, "time_step": 0.01})
    end, _ = march(system, rest(system), 12)
    # in one default step it could cross the arm, 10 mm, several times
    assert float(end.touch.impulse[0, 1]) > 0.5 * 0.002 * speed
    assert float(end.touch.closest[0]) > -0.01 * 0.003


def test_a_step_that_would_miss_a_hit_has_not_converged():
    system = hit((0.0, 2.0), 0.05, place=(0.4, -0.06))
    _, outcome = eqx.filter_jit(system.step)(rest(system).state, jnp.zeros(len(system.inputs)))
    assert float(outcome.residual) < 1e-9  # the balance is solved, but that of a hit half seen
    assert not outcome.resolved
    assert not outcome.converged


def test_a_step_that_finds_no_balance_is_not_blamed_on_its_contacts():
    system = hit((0.0, 2.0), 0.05, place=(0.4, -0.0412))
    _, outcome = eqx.filter_jit(system.step)(rest(system).state, jnp.zeros(len(system.inputs)))
    assert float(outcome.residual) > 1.0
    assert not outcome.converged
    assert outcome.resolved


# --- leaning -----------------------------------------------------------------------------------


def leaning(place, *, along=0.0, tip=0.0, **obstacle):
    """Build an arm with a load along it (N/m) or at its tip (N), down onto an obstacle."""
    return arm(
        **SOFT | {"damping_time": 0.05},
        loads=(
            lambda rod: DistributedLoad.of(rod, fixed=(0.0, -along)),
            lambda rod: TipLoad.of(rod, dead_force=(0.0, -tip)),
        ),
        obstacles=obstacles([place], **obstacle),
    )


def test_a_prop_carries_what_beam_theory_says():
    # uniform load on a propped cantilever: 3/8 of it on the prop
    load = 0.2
    wanted = 3 / 8 * load * LENGTH
    # the prop reaches as far into the skin of the straight arm as this force presses it
    contact = leaning((LENGTH, -1.0)).forces.obstacles.contact
    clear = contact.skin[-1] * (1 - (wanted / contact.strength[-1]) ** 0.25)
    system = leaning((LENGTH, -2 * RADIUS - float(clear)), along=load)
    state, outcome = balance(system)
    assert outcome.converged
    force = state.touch.force[0]
    assert float(force[1]) == pytest.approx(wanted, rel=0.01)
    # the prop, the base and the load balance
    total = force - state.base_force + jnp.asarray([0.0, -load * LENGTH])
    np.testing.assert_allclose(total, 0.0, atol=1e-7)


def test_pressing_on_a_sphere_gives_back_the_load():
    # a tip load right above a sphere goes straight into it, but for what bends the arm down to it
    system = leaning((LENGTH, -0.05 - RADIUS - 1e-3), tip=0.5, radius=0.05)
    state, outcome = balance(system)
    assert outcome.converged
    EI = MODULUS * np.pi / 4 * RADIUS**4
    bent = 3 * EI / LENGTH**3 * float(state.position[-1, 1])
    assert float(state.touch.force[0, 1]) == pytest.approx(0.5 + bent, rel=5e-3)
    # and stays as it is
    later, taken = march(system, state, 20)
    assert taken == 20
    np.testing.assert_allclose(later.position, state.position, atol=1e-9)


def test_friction_under_a_moving_floor_is_coulombs():
    floor = {"normal": (0.0, 1.0), "radius": 0.0, "friction": 0.3, "velocity": [(0.1, 0.0)]}
    system = leaning((0.0, -RADIUS - 2e-3), along=2.0, **floor)
    state, outcome = balance(system)
    assert outcome.converged
    state, _ = march(system, state, 120)
    push = np.asarray(state.touch.force[0])
    assert push[1] > 0.3
    # creep rounds it off: 0.1 m/s over sqrt(0.1^2 + 0.001^2)
    assert push[0] / push[1] == pytest.approx(0.3, rel=1e-3)


MU = 0.54


@pytest.fixture(scope="module")
def slid():
    """Slide a limp arm over a pile, a quarter of a turn, by its root; return it, and its pulls."""
    radius, pile, load = 0.002, 0.05, 0.2
    onset = Onset.of(0.0, 0.2)
    system = arm(
        nodes=101, length=0.5, EA=None, EI=None, radius=radius, youngs_modulus=2e5,
        diameter=2 * radius, mass_per_length=1080 * np.pi * radius**2, damping_time=0.005,
        time_step=0.01, max_halvings=10, tolerance=1e-9,
        motions=[VelocityMotion(0, onset, jnp.asarray(-0.2))],
        loads=(lambda rod: TipLoad.of(rod, dead_force=(0.0, -load)),),
        obstacles=obstacles([(0.2, -pile - 1.02 * radius)], radius=pile, friction=MU),
    )  # fmt: skip
    state, outcome = balance(system)
    assert outcome.converged
    state, _ = march(system, state, 60)
    pulls, taken = [], 0
    for _ in range(20):
        state, parts = march(system, state, 1)
        pulls.append(float(state.base_force[0]) / load)
        taken += parts
    return np.array(pulls), taken, pile / (pile + radius)


def test_friction_of_a_limp_arm_on_a_pile_is_the_capstans(slid):
    # the moment about the pile's axis makes the exponent smaller by R / (R + R_a)
    pulls, _, inner = slid
    assert np.log(pulls.mean()) == pytest.approx(MU * np.pi / 2 * inner, rel=0.03)


def test_an_arm_that_slides_does_not_chatter(slid):
    pulls, taken, _ = slid
    assert pulls.std() < 0.05 * pulls.mean()
    assert taken < 20 * 15


# --- bodies in the water -----------------------------------------------------------------------

VOLUME = 4 / 3 * np.pi * RADIUS**3


def test_a_light_body_rises_with_its_added_mass():
    mass = 0.4 * 1000 * VOLUME
    body = obstacles([(0.2, -1.0)], mass=mass, radius=RADIUS, density=1000.0, gravity=9.81)
    system = arm(**SOFT | {"water_density": 1000.0, "obstacles": body})
    state = rest(system)
    expected = (1000 * VOLUME - mass) * 9.81 / (mass + 0.5 * 1000 * VOLUME)
    np.testing.assert_allclose(state.motion.acceleration[-1], [0.0, expected], rtol=1e-12)
    state, _ = march(system, state, 60)
    drag = 0.5 * 1000 * 0.47 * np.pi * RADIUS**2
    terminal = np.sqrt((1000 * VOLUME - mass) * 9.81 / drag)
    assert float(state.obstacle_velocity[0, 1]) == pytest.approx(terminal, rel=1e-3)


def test_carried_obstacles_follow_the_water_at_order_two():
    # in a shear with an upward part, dz/dt = w (h/h0)^n can be integrated by hand
    shear = PowerShear(
        always(),
        jnp.asarray([0.4, 0.2]),
        reference_height=jnp.asarray(1.0),
        bed=jnp.asarray(-2.0),
        exponent=jnp.asarray(0.5),
    )
    errors = []
    for steps in (5, 10, 20):
        system = arm(
            **SOFT | {"time_step": 1.0 / steps, "water_density": 1000.0},
            flows=(shear,),
            obstacles=obstacles([(1.0, -1.0)], carried=(0,)),
        )
        state = rest(system)
        np.testing.assert_allclose(state.obstacle_velocity[0], [0.4, 0.2], rtol=1e-12)
        state, _ = march(system, state, steps)
        # h' = 0.2 sqrt(h): sqrt(h) = 1 + 0.1 t
        errors.append(abs(float(state.obstacle_position[0, 1]) - (1.1**2 - 2.0)))
    assert order(errors) == pytest.approx(2.0, abs=0.1)


def test_drifting_obstacles_keep_to_their_velocity():
    system = leaning((0.3, -1.0), velocity=[(0.1, 0.2)])
    state, taken = march(system, balance(system)[0], 30)  # which is at rest: nothing loads it
    assert taken == 30
    np.testing.assert_allclose(state.obstacle_position, [(0.33, -0.94)], rtol=0, atol=1e-12)
