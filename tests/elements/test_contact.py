"""Contact: the right gap, exact slopes, momentum and energy kept, nothing passes through."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.base import VelocityMotion
from crinoid.dynamics import Integrator
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.tangent_assembly import assemble_tangent
from crinoid.elements import DistributedLoad, TipLoad
from crinoid.flow import PowerShear
from crinoid.foundation.fixed_numbers import EASE, SKIN
from crinoid.numerics.ramp import Onset
from helpers.arms import Kept, acting, always, arm, obstacles, order
from helpers.touching import (
    SHAPES,
    THICK,
    advance,
    assert_momentum_kept,
    kept_energy,
    march,
    one_edge,
    push,
    rest,
    rubbed,
    shapes,
    window,
)

LENGTH = 0.5
RADIUS = 0.02
MODULUS = 5e5
SOFT = {
    "length": LENGTH, "nodes": 11, "EA": None, "EI": None, "radius": RADIUS,
    "youngs_modulus": MODULUS, "mass_per_length": 1080 * np.pi * RADIUS**2, "diameter": 2 * RADIUS,
    "displaced_area": np.pi * RADIUS**2, "max_halvings": 10, "tolerance": 1e-9,
}  # fmt: skip


@eqx.filter_jit
def balance(system):
    state, outcome = system.find_equilibrium()
    return Kept.of(system, state), outcome


both = pytest.mark.parametrize("axes", [2, 3], ids=["plane", "space"])

# --- geometry ----------------------------------------------------------------------------------


def distances(shape, places):
    """Return the gap by brute force: the least over the edge, and that eased toward its middle."""
    near, far, place = places
    share = np.linspace(0, 1, 4001)[:, None]
    ease = EASE * (share[:, 0] - 0.5) ** 2
    points = near + share * (far - near)
    if "normal" in shape:
        heights = (points - place) @ np.asarray(shape["normal"]) - THICK
        return heights.min(), (heights + 0.5 * 0.1 * ease).min()
    core = np.asarray(shape.get("half_axis", 0 * place))
    along = np.clip((points - place) @ core / max(core @ core, 1e-300), -1, 1)[:, None]
    squared = np.sum((points - place - along * core) ** 2, axis=1)
    least = (np.sqrt(each.min()) for each in (squared, squared + 0.1**2 * ease))
    return (each - shape["radius"] - THICK for each in least)


@both
@shapes
def test_gap_is_the_distance_of_the_surfaces(kind, axes):
    rng = np.random.default_rng(3)
    shape = SHAPES[axes][kind]
    contact = one_edge(axes, **shape)
    for _ in range(60):
        position = window(rng, contact)
        gap, _ = push(contact, position)
        exact, eased = distances(shape, position[:, :axes])
        if exact < -THICK:  # the middles overlap: no distance to speak of
            continue
        # steps of 1/4000 of the edge: within h^2 / (2 * 20 mm)
        assert 0.0 <= eased - gap + 1e-12 < 2e-8
        # drawing the point of contact to the middle of the edge can only widen the gap, by less
        # than e^2 EASE / (8 distance)
        assert -1e-6 < gap - exact < EASE * 0.1**2 / (8 * 0.02) + 1e-6


@eqx.filter_jit
def potential(contact, position):
    """Return the energy in the skin, and its slope."""
    return jax.value_and_grad(lambda position: contact.press(contact.gap(position, None))[0])(
        position
    )


@both
@shapes
def test_force_is_the_slope_of_the_skins_potential(kind, axes):
    contact, position, _ = rubbed(1, kind, axes)
    force, step = push(contact, position)[1], 1e-8
    assert np.abs(force).max() > 1.0
    for entry in np.ndindex(position.shape):
        moved = np.zeros(position.shape)
        moved[entry] = step
        ahead, behind = (float(potential(contact, position + s * moved)[0]) for s in (1, -1))
        assert force[entry] == pytest.approx(-(ahead - behind) / (2 * step), abs=1e-6)
    np.testing.assert_allclose(force, -potential(contact, position)[1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(force[:, :axes].sum(axis=0), 0.0, atol=1e-14)
    np.testing.assert_array_equal(force[:, axes:], 0.0)


def test_contact_keeps_angular_momentum():
    contact, position, _ = rubbed(1, "sphere", axes=2)
    _, force = push(contact, position)
    moment = position[:, 0] * force[:, 1] - position[:, 1] * force[:, 0]
    assert np.abs(moment).max() > 0.01
    np.testing.assert_allclose(moment.sum(), 0.0, atol=1e-14)


def test_skin_is_a_twentieth_of_the_arms_radius():
    contact = one_edge(radius=0.03)
    assert float(contact.skin) == pytest.approx(SKIN * THICK)
    potential, force = contact.press(jnp.asarray([1.0, 1.001, 0.0]) * contact.skin)
    np.testing.assert_allclose(force, [0.0, 0.0, 50.0])
    np.testing.assert_allclose(potential, [0.0, 0.0, 50.0 * SKIN * THICK / 5])


# --- slopes ------------------------------------------------------------------------------------


def crowd(**changes):
    """Build an arm between bodies that press on it: two free ones, a led one and the bed."""
    places = [(0.22, -0.0395), (0.31, 0.0394), (0.43, -0.0393), (0.3, -0.0195)]

    def of(rod):
        return obstacles(
            places,
            radius=RADIUS,
            normal=[(0, 0), (0, 0), (0, 0), (0, 1)],
            friction=0.4,
            velocity=[(0.1, 0.2), (-0.1, -0.2), (0.05, 0.1), (0.0, 0.0)],
            mass=[0.05, 0.05, np.inf, np.inf],
            density=1000.0,
            gravity=9.81,
        )(rod)

    wet = {"nodes": 8, "damping_time": 0.02, "water_density": 1000.0, "gravity": 9.81}
    return arm(
        **SOFT | wet | changes,
        flows=(PowerShear(always(), *map(jnp.asarray, ([0.4, 0.1], 2.0, -5.0, 0.3))),),
        obstacles=of,
    )


@pytest.mark.slow
def test_tangent_with_contacts_is_the_slope_of_the_residual():
    system = crowd()
    state = rest(system)
    forces, motion = acting(system), state.motion
    rng = np.random.default_rng(5)
    velocity = motion.velocity + 0.05 * rng.normal(size=motion.velocity.shape)
    h = 1e-3
    rates = map(jnp.asarray, (1.0, 2 / h, 4 / h**2))
    stage = StepMap(state.time, motion.position, velocity, motion.acceleration, *rates)
    zero = jnp.zeros_like(motion.position)
    assert bool(state.touch.in_contact.all())

    def residual(correction):
        current = forces.surroundings(stage, zero)
        return forces.unknown(forces.residual(forces.motion(stage, correction, current))[0])

    @jax.jit
    def solved(rhs):
        current = forces.surroundings(stage, zero)
        now = forces.motion(stage, zero, current)
        return assemble_tangent(forces, stage, now, current).solve(rhs)

    # a rotation in the plane has one number
    rhs = jnp.asarray(rng.normal(size=zero.shape)).at[forces.rows.rotations, 1].set(0.0)
    change = solved(rhs)
    led = [0, 1, -6, -5, -2, -1]  # the held nodes, both rows of the led sphere and of the bed
    assert not np.any(np.asarray(change)[led])
    slope = jax.jit(lambda d: jax.jvp(residual, (zero,), (d,))[1])(change)
    np.testing.assert_allclose(slope, forces.unknown(rhs), rtol=1e-8, atol=1e-9)


@pytest.mark.slow
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
        value, forward = jax.linearize(after, shift)
        (back,) = jax.linear_transpose(forward, shift)(jnp.ones(()))
        return value, (forward(direction), jnp.sum(back * direction))

    step = 1e-7
    difference = (along(step)[0] - along(-step)[0]) / (2 * step)
    assert abs(float(difference)) > 0.01
    np.testing.assert_allclose(along(0.0)[1], difference, rtol=1e-5)


# --- hits --------------------------------------------------------------------------------------


def hit(velocity, mass, *, place=(0.4, -0.06), friction=0.0, **changes):
    """Build an arm in a vacuum that a free body flies at."""
    body = obstacles([place], velocity=[velocity], mass=mass, radius=RADIUS, friction=friction)
    return arm(**SOFT | {"obstacles": body} | changes)


def assert_is_over(end, taken):
    """The body was seen coming in 160 steps, did not pass through, and has left the arm."""
    assert taken > 160
    assert not end.touch.in_contact[0]
    assert float(end.touch.closest[0]) > -0.01 * RADIUS


@pytest.mark.slow
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
    assert_is_over(end, taken)
    assert 0 < float(end.touch.duration[0]) < 0.05
    assert_momentum_kept(end, mass, velocity, rtol=1e-7, atol=1e-9)
    assert kept_energy(end, mass, velocity) == pytest.approx(1.0, rel=0.01)
    # what the arm has was done on it by the contact
    assert float(end.work[-1]) == pytest.approx(float(end.energy.sum()), rel=0.01)


@pytest.mark.slow
def test_a_hit_of_what_rubs_gives_back_half_of_its_speed():
    # a body of a hundredth of an edge's mass on the middle of an edge: nothing but the skin moves
    def speed(friction):
        place = (0.375, -0.045)
        system = hit((0.0, 0.3), 1e-3, place=place, friction=friction, time_step=0.0025)
        end, _ = march(system, rest(system), 20)
        assert not end.touch.in_contact[0]
        return -float(end.obstacle_velocity[0, 1]) / 0.3

    elastic, rubbed = speed(0.0), speed(0.3)
    assert 0.9 < elastic < 1.0
    assert 0.4 < rubbed < 0.6


@pytest.mark.release
def test_a_hit_under_generalized_alpha():
    velocity, mass = (0.0, 0.3), 0.05
    method = Integrator.generalized_alpha(0.8)
    system = hit(velocity, mass, time_step=0.0025, integrator=method)
    end, taken = march(system, rest(system), 160)
    assert_is_over(end, taken)
    # forces are balanced between both ends of a step, the impulse is added up at the ends
    largest = float(jnp.abs(end.touch.impulse[0]).max())
    assert_momentum_kept(end, mass, velocity, rtol=0, atol=0.1 * largest)
    # what is too fast for a step it takes out, and never gives energy
    assert 0.8 < kept_energy(end, mass, velocity) < 1.01


@pytest.mark.slow
def test_the_base_feels_a_hit_on_a_stiff_arm():
    # all momentum goes through a stiff arm into the base
    system = hit((0.0, 0.2), 0.05, youngs_modulus=5e7, damping_time=2e-3, time_step=1e-3)
    state, impulse = rest(system), np.zeros(2)
    for _ in range(400):
        before = np.asarray(state.base_force)
        state, _ = advance(system, state)
        impulse += 0.5e-3 * (before + np.asarray(state.base_force))
    share = SOFT["mass_per_length"] * LENGTH / 10 * np.array([1.0] * 9 + [0.5])
    arm_has = share @ np.asarray(state.velocity[2:])
    np.testing.assert_allclose(impulse + arm_has, np.asarray(state.touch.impulse[0]), atol=2e-4)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.5, 1.0, 2.0])
def test_nothing_passes_through_a_thin_arm(speed):
    thin = {"radius": 0.003, "diameter": 0.006, "mass_per_length": 0.03}
    body = obstacles([(0.37, -0.0333)], velocity=[(0.0, speed)], mass=0.002, radius=0.002)
    system = arm(**SOFT | thin | {"obstacles": body, "time_step": 0.01})
    end, _ = march(system, rest(system), 12)
    # in one default step it could cross the arm, 10 mm, several times
    assert float(end.touch.impulse[0, 1]) > 0.5 * 0.002 * speed
    assert float(end.touch.closest[0]) > -0.01 * 0.003


@pytest.mark.slow
def test_a_step_that_would_miss_a_hit_has_not_converged():
    # steps are not cut
    far, near = (hit((0.0, 2.0), 0.05, place=(0.4, z), max_halvings=0) for z in (-0.06, -0.0412))
    outcome = advance(far, rest(far))[1].outcome
    assert float(outcome.residual) < 1e-9  # the balance is solved, but that of a hit half seen
    assert not outcome.resolved
    assert not outcome.converged
    # a step that finds no balance does not blame its contacts
    near = eqx.tree_at(lambda system: system.settings.max_iterations, near, jnp.asarray(1))
    outcome = advance(near, rest(near))[1].outcome
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


@pytest.mark.release
def test_a_prop_carries_what_beam_theory_says():
    # uniform load on a propped cantilever: 3/8 of it on the prop
    load = 0.2
    wanted = 3 / 8 * load * LENGTH
    # the prop reaches as far into the skin of the straight arm as this force presses it
    contact = leaning((LENGTH, -1.0)).forces.obstacles.contacts[0]
    clear = contact.skin[-1] * (1 - (wanted / contact.strength[-1]) ** 0.25)
    system = leaning((LENGTH, -2 * RADIUS - float(clear)), along=load)
    state, outcome = balance(system)
    assert outcome.converged
    force = state.touch.force[0]
    assert float(force[1]) == pytest.approx(wanted, rel=0.01)
    # the prop, the base and the load balance
    total = force - state.base_force + jnp.asarray([0.0, -load * LENGTH])
    np.testing.assert_allclose(total, 0.0, atol=1e-7)


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.release
def test_friction_of_a_limp_arm_on_a_pile_is_the_capstans():
    # its root pulls a limp arm over a pile, a quarter of a turn
    radius, pile, load, friction = 0.002, 0.05, 0.2, 0.54
    system = arm(
        nodes=101,
        length=0.5,
        EA=None,
        EI=None,
        radius=radius,
        youngs_modulus=2e5,
        diameter=2 * radius,
        mass_per_length=1080 * np.pi * radius**2,
        damping_time=0.005,
        time_step=0.01,
        max_halvings=10,
        tolerance=1e-9,
        motions=[VelocityMotion(0, Onset.of(0.0, 0.2), jnp.asarray(-0.2))],
        loads=(lambda rod: TipLoad.of(rod, dead_force=(0.0, -load)),),
        obstacles=obstacles([(0.2, -pile - 1.02 * radius)], radius=pile, friction=friction),
    )
    state, outcome = balance(system)
    assert outcome.converged
    state, _ = march(system, state, 60)
    pulls, taken = [], 0
    for _ in range(20):
        state, parts = march(system, state, 1)
        pulls.append(float(state.base_force[0]) / load)
        taken += parts
    # the moment about the pile's axis makes the exponent smaller by R / (R + R_a)
    exponent = friction * np.pi / 2 * pile / (pile + radius)
    assert np.log(np.mean(pulls)) == pytest.approx(exponent, rel=0.03)
    # nor does it chatter
    assert np.std(pulls) < 0.05 * np.mean(pulls)
    assert taken < 20 * 15


# --- bodies in the water -----------------------------------------------------------------------

VOLUME = 4 / 3 * np.pi * RADIUS**3


def in_the_water(current, *, mass=1000 * VOLUME, place=(9.0, -1.0), gravity=0.0, **changes):
    """Build an arm in a shear with an obstacle that the water carries, and one that is free."""
    velocity = [(0.0, 0.0), current]
    return arm(
        **SOFT | {"water_density": 1000.0} | changes,
        flows=(PowerShear(always(), *map(jnp.asarray, (list(current), 1.0, -2.0, 0.5))),),
        obstacles=obstacles(
            [(1.0, -1.0), place],
            velocity=velocity,
            mass=[np.inf, mass],
            radius=RADIUS,
            density=1000.0,
            gravity=gravity,
            carried=(0,),
        ),
    )


@pytest.mark.release
def test_a_light_body_rises_with_its_added_mass():
    mass = 0.4 * 1000 * VOLUME
    system = in_the_water((0.0, 0.0), mass=mass, place=(0.2, -1.0), gravity=9.81)
    state = rest(system)
    expected = (1000 * VOLUME - mass) * 9.81 / (mass + 0.5 * 1000 * VOLUME)
    # rows of both places, and then of both turns
    np.testing.assert_allclose(state.motion.acceleration[-3], [0.0, expected], rtol=1e-12)
    state, _ = march(system, state, 60)
    drag = 0.5 * 1000 * 0.47 * np.pi * RADIUS**2
    terminal = np.sqrt((1000 * VOLUME - mass) * 9.81 / drag)
    assert float(state.obstacle_velocity[1, 1]) == pytest.approx(terminal, rel=1e-3)


@pytest.mark.release
def test_carried_obstacles_follow_the_water_at_order_two():
    # in a shear with an upward part, dz/dt = w (h/h0)^n can be integrated by hand
    errors = []
    for steps in (5, 10, 20):
        system = in_the_water((0.4, 0.2), time_step=1.0 / steps)
        state = rest(system)
        np.testing.assert_allclose(state.obstacle_velocity[0], [0.4, 0.2], rtol=1e-12)
        state, _ = march(system, state, steps)
        # h' = 0.2 sqrt(h): sqrt(h) = 1 + 0.1 t
        errors.append(abs(float(state.obstacle_position[0, 1]) - (1.1**2 - 2.0)))
    assert order(errors) == pytest.approx(2.0, abs=0.1)


@pytest.mark.slow
def test_drifting_obstacles_keep_to_their_velocity():
    system = leaning((0.3, -1.0), velocity=[(0.1, 0.2)])
    state, taken = march(system, balance(system)[0], 30)  # which is at rest: nothing loads it
    assert taken == 30
    np.testing.assert_allclose(state.obstacle_position, [(0.33, -0.94)], rtol=0, atol=1e-12)
