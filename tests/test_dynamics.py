"""The arm in time: frequencies, damping, orders of convergence, energy, base motion, recovery."""

from collections.abc import Callable
from functools import cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.special import ellipk

from crinoid.base import BaseMotion, SineMotion, TableMotion
from crinoid.dynamics import Integrator, Outcome, Progress, State, System, find_modes
from crinoid.dynamics.guess import expected_acceleration
from crinoid.dynamics.integrator import Stage
from crinoid.elements import ENERGIES, WORKS, DistributedLoad, Element, TipLoad
from crinoid.flow import Flow, PowerShear, Sine, Uniform
from crinoid.onset import Onset
from crinoid.rod import Rod
from crinoid.spline import PiecewisePolynomial
from physics import Kept, always, arm, order

CANTILEVER = np.array([1.8751041, 4.6940911, 7.8547574])
"""beta L: roots of cos(x) cosh(x) = -1 (Blevins 1979, table 8-1)."""
STILL = np.zeros(3)
CHUNK = 250
"""Steps of one compiled run that keeps every state."""

# --- how an arm is run: compiled once for each make of arm, whatever its numbers ---------------


@eqx.filter_jit
def _rest(system: System, time: Array) -> Kept:
    return Kept.of(system, system.rest(time))


def rest(system: System, time: float = 0.0) -> Kept:
    return _rest(system, jnp.asarray(time))


@eqx.filter_jit
def equilibrium(system: System) -> tuple[State, Outcome]:
    return system.find_equilibrium()


@eqx.filter_jit
def advance(system: System, state: Kept, step: Array) -> tuple[Kept, Progress]:
    return state.advance(system, jnp.zeros(3), step)


@eqx.filter_jit
def _steps(system: System, state: Kept, command: Array, steps: Array, step: Array):
    """Return the state after at most CHUNK steps, those on the way, and how the steps went."""

    def once(index, carry):
        state, kept = carry
        now = state.step(system, command, step)
        return now[0], jax.tree.map(lambda all_, one: all_.at[index].set(one), kept, now)

    room = jax.tree.map(
        lambda x: jnp.zeros((CHUNK, *x.shape), x.dtype),
        (state, Outcome.of_nothing(converged=False)),
    )
    end, (states, outcomes) = jax.lax.fori_loop(0, steps, once, (state, room))
    return end, states, outcomes


def _march(
    system: System, state: Kept, command: ArrayLike, steps: int, step: float
) -> tuple[Kept, bool]:
    good = True
    for done in range(0, steps, CHUNK):
        count = min(CHUNK, steps - done)
        given = jnp.asarray(command, float), jnp.asarray(count), jnp.asarray(step)
        state, _, outcomes = _steps(system, state, *given)
        good &= bool(outcomes.converged[:count].all())
    return state, good


def march(
    system: System, state: Kept, *, until: float, steps: int, command: ArrayLike = STILL
) -> Kept:
    """Return the state after equal steps, none of which may fail."""
    state, good = _march(system, state, command, steps, (until - float(state.time)) / steps)
    assert good
    assert float(state.time) == pytest.approx(until, rel=1e-12)
    return state


def track(system: System, state: Kept, step: float, chunks: int = 1) -> tuple[Kept, Outcome]:
    """Return the states after each of ``chunks * CHUNK`` steps, and how the steps went."""
    parts = []
    given = jnp.asarray(STILL), jnp.asarray(CHUNK), jnp.asarray(step)
    for _ in range(chunks):
        state, *kept = _steps(system, state, *given)
        parts.append(kept)
    states, outcomes = jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)
    assert outcomes.converged.all()
    return states, outcomes


@eqx.filter_jit
def imbalance(system: System, state: State) -> tuple[Array, Array]:
    """Return the residual of all nodes in a state and the largest single force in it."""
    none = jnp.zeros(())
    stage = Stage(state.time, state.position, state.velocity, state.acceleration, none, none, none)
    zero = jnp.zeros_like(state.position)
    current = system.forces.surroundings(stage, zero)
    return system.forces.residual(system.forces.motion(stage, zero, current))


# --- makes of arms -----------------------------------------------------------------------------


def polynomial(channel: int, speed: float = 0.0, acceleration: float = 0.0) -> TableMotion:
    """A channel that moves as ``speed t + acceleration t^2 / 2`` for -1 s < t < 3 s."""
    knots = np.arange(-1.0, 4.0)
    # a cubic spline through points of a parabola is the parabola
    table = CubicSpline(knots, speed * knots + 0.5 * acceleration * knots**2)
    return TableMotion(channel, PiecewisePolynomial(table))


def bare(*, tip_force: ArrayLike = (0.0, 0.0), **properties: object) -> System:
    """Build an arm in a vacuum with a dead force on its tip, there from the start."""
    return arm(loads=(lambda rod: TipLoad.of(rod, dead_force=tip_force),), **properties)


def carried(
    *,
    speed: ArrayLike = (0.0, 0.0),
    acceleration: ArrayLike = (0.0, 0.0),
    turning: float = 0.0,
    spin_up: float = 0.0,
    current: ArrayLike = (0.0, 0.0),
    **properties: object,
) -> System:
    """Build an arm under water on a base that slides, heaves and turns; in a uniform current."""
    speed, acceleration = np.asarray(speed, float), np.asarray(acceleration, float)
    return arm(
        water_density=1000.0,
        motions=(
            polynomial(0, speed[0], acceleration[0]),
            polynomial(1, speed[1], acceleration[1]),
            polynomial(2, turning, spin_up),
        ),
        flows=(Uniform(always(), jnp.asarray(current, float)),),
        **properties,
    )


def _everything(
    integrator: Integrator | None = None, depth: float = 0.0, tolerance: float = 1e-12
) -> System:
    """Build an arm on which everything acts at once."""
    number = jnp.asarray
    flows: tuple[Flow, ...] = (
        Sine(Onset.of(0.0, 0.3), number([0.3, 0.4]), number(1.3), number(0.4)),
        PowerShear(
            always(), number([0.5, 0.1]), number(5.0), number(-depth - 5.0), number(1.0 / 7.0)
        ),
    )
    motions: tuple[BaseMotion, ...] = (
        SineMotion(1, number(0.05), number(0.9), number(0.3)),
        SineMotion(2, number(0.2), number(0.6), number(0.0)),
        SineMotion(0, number(0.03), number(1.4), number(1.0)),
    )
    loads: tuple[Callable[[Rod], Element], ...] = (
        lambda rod: DistributedLoad.of(
            rod, tangential=0.1, normal=0.3, fixed=(0.2, 0.3), onset=Onset.of(0.0, 0.5)
        ),
        lambda rod: TipLoad.of(
            rod,
            dead_force=(0.2, 0.6),
            follower_force=(0.1, 0.3),
            moment=0.1,
            onset=Onset.of(0.0, 0.4),
        ),
    )
    return arm(
        EA=1e3,
        gravity=9.81,
        water_density=1000.0,
        displaced_area=8e-4,
        diameter=0.032,
        added_mass_tangential=0.2,
        linear_drag=0.5,
        damping_time=0.05,
        flows=flows,
        motions=motions,
        loads=loads,
        origin=(0.0, -depth),
        integrator=integrator,
        tolerance=tolerance,
    )


# --- vibration ---------------------------------------------------------------------------------


@eqx.filter_jit
def _linearise(system: System) -> tuple[Array, Array]:
    return system.linearise(system.rest())


def vibrations(system: System) -> tuple[np.ndarray, np.ndarray]:
    """Return circular frequencies (rad/s) and transverse shapes of a straight arm along x."""
    modes = find_modes(*_linearise(system))
    bending = np.abs(modes.shape[..., 1]).max(axis=1) > 0.5
    return 2 * np.pi * modes.frequency[bending], modes.shape[bending, 1:, 1]


def ring_down(system: System, mode: int, step: float) -> complex:
    """Return the pole (1/s) with which one small-amplitude mode rings in a simulation.

    The trapezoid rule maps a pole ``s`` to ``z = (1 + s h / 2) / (1 - s h / 2)`` exactly (Tustin),
    so undoing that map leaves no error of the time step. ``z`` comes from the two-term recurrence
    of the tip's motion, which is the logarithmic decrement and the period in one.
    """
    frequency, shapes = vibrations(system)
    velocity = np.zeros((shapes.shape[1] + 2, 2))
    velocity[2:, 1] = 1e-3 * shapes[mode]  # so slow that the nonlinear terms are 1e-6 of the linear
    # Kelvin-Voigt damping of a mode is damping_time omega^2 times its velocity
    slowing = -float(system.forces.bend.damping_time[0]) * frequency[mode] ** 2 * velocity
    state = eqx.tree_at(
        lambda s: (s.motion.velocity, s.motion.acceleration),
        rest(system),
        (jnp.asarray(velocity), jnp.asarray(slowing)),
    )
    tip = track(system, state, step)[0].position[:, -1, 1]
    (twice, minus), *_ = np.linalg.lstsq(np.stack([tip[1:-1], tip[:-2]], 1), tip[2:], rcond=None)
    z = np.roots([1.0, -twice, -minus])
    s = 2.0 / step * (z - 1.0) / (z + 1.0)
    return complex(s[np.argmax(s.imag)])


@pytest.mark.parametrize("mode", [0, 1])
def test_a_simulated_mode_rings_at_its_frequency_and_damping(mode):
    damping_time = 0.01
    system = carried(damping_time=damping_time, drag_normal=0.0, tolerance=1e-12)
    frequency = vibrations(system)[0][mode]
    pole = ring_down(system, mode, step=0.2 / frequency)
    assert abs(pole) == pytest.approx(frequency, rel=1e-7)
    assert abs(pole) == pytest.approx(CANTILEVER[mode] ** 2, rel=(1e-5, 2e-4)[mode])  # at N = 11
    assert -pole.real / abs(pole) == pytest.approx(damping_time * frequency / 2, rel=1e-6)


def test_an_arm_under_water_rings_at_its_lower_frequency():
    # m = 1 kg/m, rho A = 0.6 kg/m, Ca = 1.5
    wet = carried(displaced_area=6e-4, added_mass_normal=1.5, drag_normal=0.0, tolerance=1e-12)
    pole = ring_down(wet, 0, step=0.05)
    in_vacuum = vibrations(carried())[0][0]
    assert abs(pole) == pytest.approx(np.sqrt(1.0 / (1.0 + 1.5 * 0.6)) * in_vacuum, rel=1e-5)
    assert pole.real == pytest.approx(0.0, abs=1e-5)


def test_a_stiff_arm_on_a_pin_swings_as_a_physical_pendulum():
    # released horizontally: a quarter of a swing takes K(k^2 = 1/2) / omega, with
    # omega^2 = m g (L / 2) / J and J = m L^2 / 3, which linear elements have exactly
    system = bare(EI=1e5, EA=1e7, pinned=True, gravity=9.81, tolerance=1e-12)
    states, _ = track(system, rest(system), 1e-3, chunks=2)
    tip = CubicHermiteSpline(
        states.time, states.position[:, -1, 0], states.velocity[:, -1, 0], extrapolate=False
    )
    quarter = ellipk(0.5) / np.sqrt(9.81 * 0.5 / (1.0 / 3.0))
    assert tip.roots()[0] == pytest.approx(quarter, rel=1e-5)


# --- motion in water ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tilt", "added"), [(0.0, 1.3), (np.pi / 2, 0.2)], ids=["broadside", "along"]
)
def test_a_submerged_body_rises_with_its_buoyant_acceleration(tilt, added):
    # (rho V - m) g / (m + Ca rho V): a base that rises just so carries nothing
    mass, displaced, gravity = 0.4, 1.0, 9.81
    rising = (displaced - mass) * gravity / (mass + added * displaced)
    system = carried(
        acceleration=(0.0, rising), tilt=tilt, mass_per_length=mass, displaced_area=1e-3,
        added_mass_normal=1.3, added_mass_tangential=0.2, drag_normal=0.0, drag_tangential=0.0,
        gravity=gravity, EI=0.01,
    )  # fmt: skip
    state = rest(system)
    assert np.asarray(state.acceleration[1:, 1]) == pytest.approx(rising, rel=1e-10)
    for moved in (state, march(system, state, until=0.5, steps=50)):
        assert np.asarray(moved.base_force) == pytest.approx(0.0, abs=1e-8)
        assert float(moved.base_moment) == pytest.approx(0.0, abs=1e-8)
        shape = np.asarray(moved.position - moved.position[1])
        assert shape == pytest.approx(np.asarray(state.position - state.position[1]), abs=1e-9)


def _cylinder(**motion: ArrayLike) -> tuple[System, float, float]:
    """Build a stiff cylinder across the water; with its weight in water and its terminal speed."""
    diameter, heavier, drag, gravity = 0.01, 1.2, 1.1, 9.81
    area = np.pi / 4 * diameter**2
    system = carried(
        mass_per_length=heavier * 1000.0 * area, displaced_area=area, diameter=diameter,
        drag_normal=drag, gravity=gravity, EI=1e4, **motion,
    )  # fmt: skip
    terminal = np.sqrt(np.pi * diameter * gravity * (heavier - 1.0) / (2.0 * drag))
    return system, (heavier - 1.0) * 1000.0 * area * gravity, terminal


def test_broadside_cylinder_sinks_at_its_terminal_speed():
    *_, terminal = _cylinder()
    assert terminal == pytest.approx(0.16738, abs=5e-6)
    system, weight, _ = _cylinder(speed=(0.0, -terminal))
    state = rest(system)
    assert np.asarray(state.acceleration) == pytest.approx(0.0, abs=1e-8)  # of 9.81
    sunk = march(system, state, until=0.5, steps=50)
    assert float(sunk.position[-1, 1]) == pytest.approx(-0.5 * terminal, abs=1e-10)
    assert np.asarray(sunk.base_force) == pytest.approx(0.0, abs=1e-8 * weight)


@pytest.mark.parametrize("share", [0.5, -1.0])
def test_drag_on_a_cylinder_grows_with_the_square_of_the_speed(share):
    *_, terminal = _cylinder()
    system, weight, _ = _cylinder(current=(0.0, share * terminal))
    state, outcome = equilibrium(system)
    assert outcome.converged
    carries = -weight * (1.0 - share * abs(share))
    assert float(state.base_force[1]) == pytest.approx(carries, rel=1e-6)


def test_an_arm_carried_through_still_water_is_an_arm_in_a_current():
    speed = np.array([0.4, -0.25])
    properties = {
        "EI": 0.05, "gravity": 9.81, "mass_per_length": 0.9, "displaced_area": 8e-4,
        "diameter": 0.03, "damping_time": 0.02, "tilt": 0.3, "tolerance": 1e-13,
    }  # fmt: skip
    moving = carried(speed=speed, **properties)
    standing = carried(current=-speed, **properties)
    moved = march(moving, rest(moving), until=1.0, steps=100)
    stood = march(standing, rest(standing), until=1.0, steps=100)
    assert np.asarray(moved.position[1]) == pytest.approx(speed, abs=1e-12)
    bent = np.asarray(stood.position - rest(standing).position)
    assert np.abs(bent).max() > 0.05
    assert np.asarray(moved.position - moved.position[1]) == pytest.approx(
        np.asarray(stood.position), abs=1e-11
    )
    assert np.asarray(moved.velocity - moved.velocity[1]) == pytest.approx(
        np.asarray(stood.velocity), abs=1e-8
    )
    assert np.asarray(moved.base_force) == pytest.approx(np.asarray(stood.base_force), abs=1e-7)


# --- what the base feels -----------------------------------------------------------------------


def test_at_rest_the_base_carries_the_weight_and_its_lever():
    system = carried(mass_per_length=0.7, displaced_area=2e-4, gravity=9.81)
    state, outcome = equilibrium(system)
    assert outcome.converged
    weight = (0.7 - 0.2) * 9.81  # in water; L = 1
    assert np.asarray(state.base_force) == pytest.approx([0.0, -weight], abs=1e-8)
    share = np.asarray(system.reference.voronoi_length) * weight
    lever = np.asarray(state.position[1:, 0])
    # positive from +x toward +z: weight on an arm along +x turns the base the other way
    assert float(state.base_moment) == pytest.approx(-np.sum(share * lever), abs=1e-8)
    assert float(state.base_moment) < -0.4 * weight


def test_steady_acceleration_is_a_weight():
    # d'Alembert: the shape that hangs in gravity rides along on a base that accelerates upward
    # (an arm of no displacement, so that the water has no weight; the force is m a)
    hanging, _ = equilibrium(carried(gravity=6.0, damping_time=0.1))
    system = carried(acceleration=(0.0, 6.0), damping_time=0.1)
    state = eqx.filter_jit(System._begin)(system, jnp.zeros(()), hanging.position, None)
    assert np.asarray(state.acceleration[:, 1]) == pytest.approx(6.0, abs=1e-6)
    assert np.asarray(state.base_force) == pytest.approx([0.0, -6.0], abs=1e-7)  # m = 1 kg
    assert float(state.base_moment) == pytest.approx(float(hanging.base_moment), abs=1e-7)


# --- order in the time step --------------------------------------------------------------------


def _swing(integrator: Integrator, steps: int) -> np.ndarray:
    """Return where a heavy, damped arm is 0.8 s after it was let go horizontally."""
    system = bare(EA=1e3, gravity=10.0, damping_time=0.02, integrator=integrator, tolerance=1e-12)
    return np.asarray(march(system, rest(system), until=0.8, steps=steps).position)


@cache
def _fine_swing() -> np.ndarray:
    return _swing(Integrator.newmark(), 12800)


@pytest.mark.parametrize(
    ("integrator", "expected", "within"),
    [
        (Integrator.newmark(), 2.0, 0.02),
        (Integrator.generalized_alpha(0.8), 2.0, 0.02),
        (Integrator.generalized_alpha(0.2), 2.0, 0.1),
        (Integrator.implicit_euler(), 1.0, 0.05),
    ],
    ids=["newmark", "alpha-0.8", "alpha-0.2", "implicit-euler"],
)
def test_order_in_the_time_step_on_a_large_swing(integrator, expected, within):
    # all against one reference, so all converge to the same motion; w L^3 / EI = 10
    assert _fine_swing()[-1, 1] < -0.8
    errors = [np.abs(_swing(integrator, steps) - _fine_swing()).max() for steps in (200, 400, 800)]
    assert order(errors) == pytest.approx(expected, abs=within)
    assert errors[-1] < (1e-2 if expected == 1.0 else 1e-4)


@pytest.mark.parametrize(
    "integrator",
    [Integrator.newmark(), Integrator.generalized_alpha(0.8)],
    ids=["newmark", "alpha-0.8"],
)
def test_a_load_that_jumps_where_steps_meet_keeps_the_order(integrator):
    def shape(integrator: Integrator, steps: int) -> np.ndarray:
        onset = Onset.of(0.2, 0.0, 0.5)
        load = partial(TipLoad.of, dead_force=(0.0, -3.0), onset=onset)
        properties = {"EA": 1e3, "damping_time": 0.02, "tolerance": 1e-12}
        system = arm(loads=(load,), integrator=integrator, **properties)
        return np.asarray(march(system, rest(system), until=0.8, steps=steps).position)

    fine = shape(Integrator.newmark(), 12800)
    errors = [np.abs(shape(integrator, steps) - fine).max() for steps in (200, 400, 800)]
    assert order(errors) == pytest.approx(2.0, abs=0.1)
    assert errors[-1] < 1e-4


@pytest.mark.parametrize(
    ("integrator", "expected", "within"),
    [
        (Integrator.newmark(), 3.0, 0.01),
        (Integrator.newmark(0.3025, 0.6), 3.0, 0.05),
        (Integrator.generalized_alpha(0.8), 3.0, 0.2),
        (Integrator.generalized_alpha(0.2), 3.0, 0.05),
        (Integrator.implicit_euler(), 2.0, 0.01),
    ],
    ids=["newmark", "newmark-0.6", "alpha-0.8", "alpha-0.2", "implicit-euler"],
)
def test_estimated_error_of_a_step_is_its_local_error(integrator, expected, within):
    properties = {"EA": 1e3, "gravity": 10.0, "damping_time": 0.02, "tolerance": 1e-12}
    system, exact = bare(integrator=integrator, **properties), bare(**properties)
    estimates, errors = [], []
    for steps in (400, 800, 1600):
        step = 0.8 / steps
        state = march(system, rest(system), until=0.4, steps=steps // 2)
        after, progress = advance(system, state, jnp.asarray(step))
        true = march(exact, state, until=float(state.time) + step, steps=64)
        estimates.append(float(progress.error))
        distance = np.linalg.norm(np.asarray(after.position - true.position), axis=1)
        errors.append(distance.max())
    assert order(estimates) == pytest.approx(expected, abs=0.05)
    # what it leaves out is of the next order
    missed = np.abs(1 - np.asarray(estimates) / errors)
    assert missed[-1] < within
    assert missed[2] < 0.75 * missed[1] < 0.75**2 * missed[0]


# --- energy ------------------------------------------------------------------------------------


@eqx.filter_jit
def _kept(system: System, states: Kept, step: Array) -> Array:
    """Return what the trapezoid rule keeps: ``E + h^2 / 12 (a . M a + v . K v)``."""

    def of_one(state: Kept) -> Array:
        motion = state.motion

        def kinetic(velocity: Array) -> Array:
            moving = eqx.tree_at(lambda m: m.velocity, motion, velocity)
            return system.forces.energy(moving)[ENERGIES.index("kinetic")]

        def slope(position: Array) -> Array:
            placed = eqx.tree_at(lambda m: m.position, motion, position)
            return jax.grad(lambda m: jnp.sum(system.forces.energy(m)))(placed).position

        _, restoring = jax.jvp(slope, (motion.position,), (motion.velocity,))
        curved = 2.0 * kinetic(motion.acceleration) + jnp.sum(restoring * motion.velocity)
        return jnp.sum(state.energy) + step**2 / 12.0 * curved

    return jax.vmap(of_one)(states)


def energies(step: float, chunks: int) -> np.ndarray:
    """Return the energy of an arm let go horizontally, and what the rule keeps of it.

    Both over the largest kinetic energy.
    """
    system = bare(gravity=10.0, tolerance=1e-12)
    state, parts = rest(system), []
    for _ in range(chunks):
        states, _ = track(system, state, step)
        parts.append((states.energy, _kept(system, states, jnp.asarray(step))))
        state = jax.tree.map(lambda leaf: leaf[-1], states)
    energy, kept = map(np.concatenate, zip(*parts, strict=True))
    kinetic = energy[:, ENERGIES.index("kinetic")].max()
    assert kinetic > 1.8
    return np.stack([energy.sum(axis=1), kept]) / kinetic


def test_energy_of_an_undamped_swing_stays_in_a_band():
    # 100 s, about 80 swings; the energy is that of the start, zero. (A step of 0.01 s is too long
    # for the vibrations of this mesh: within 100 s the energy begins to wander)
    total, kept = energies(0.0057, chunks=17_500 // CHUNK)
    assert np.abs(total).max() < 6e-4
    first, last = total[:1000], total[-1000:]
    assert np.ptp(last) < 1.1 * np.ptp(first)
    assert last.mean() == pytest.approx(first.mean(), abs=0.05 * np.ptp(first))
    assert np.ptp(kept) < 5e-6


def test_the_trapezoid_rule_keeps_an_energy_of_its_own():
    # it is conjugate to the midpoint rule, which is symplectic: what it keeps, but for a part of
    # order 4, is E + h^2 / 12 (a . M a + v . K v) (Hairer, Lubich and Wanner 2006, Geometric
    # Numerical Integration, sections VI.8 and IX.3). Nothing is won or lost; E itself moves in a
    # band of order 2, and sinks where faster vibrations are stirred up
    bands = [np.ptp(energies(10.0 / n, chunks=n // CHUNK), axis=1) for n in (2000, 4000)]
    of_total, of_kept = np.transpose(bands)
    assert order(of_total) == pytest.approx(2.0, abs=0.15)
    assert order(of_kept) == pytest.approx(4.0, abs=0.2)
    assert of_kept[-1] < 1e-7


@pytest.mark.parametrize(
    "integrator",
    [Integrator.newmark(), Integrator.generalized_alpha(0.8)],
    ids=["newmark", "alpha-0.8"],
)
def test_energy_audit_closes_at_order_two(integrator):
    defects, works = [], []
    for steps in (200, 400, 800):
        system = _everything(integrator)
        start = rest(system)
        end = march(system, start, until=1.0, steps=steps)
        stored = float(jnp.sum(end.energy - start.energy))
        defects.append(stored - float(jnp.sum(end.work)))
        works.append(np.asarray(end.work))
    worked = np.delete(works[-1], [WORKS.index("contact"), WORKS.index("tool")])
    assert np.abs(worked).min() > 0.01  # J: drag, damping, base, loads, added mass all work
    assert order(np.abs(defects)) == pytest.approx(2.0, abs=0.05)
    assert abs(defects[-1]) < 1e-4 * np.abs(works[-1]).sum()


def test_each_work_converges_at_order_two_in_generalized_alpha():
    # the sum may hide an error of two works against each other
    def work(integrator: Integrator, steps: int) -> np.ndarray:
        system = _everything(integrator)
        return np.asarray(march(system, rest(system), until=1.0, steps=steps).work)

    exact = work(Integrator.newmark(), 6400)
    errors = [
        np.abs(work(Integrator.generalized_alpha(0.8), steps) - exact) for steps in (200, 400, 800)
    ]
    for name, error in zip(WORKS, np.transpose(errors), strict=True):
        if name in ("contact", "tool"):
            assert not np.any(error)  # there is nothing to touch or to carry
            continue
        assert order(error) == pytest.approx(2.0, abs=0.2), name


def test_energy_audit_closes_when_servos_move_the_base():
    command = np.array([0.02, -0.03, 0.1])
    defects = []
    for steps in (200, 400, 800):
        system = bare(EA=1e3, gravity=9.81, damping_time=0.05, tolerance=1e-12)
        start = rest(system)
        end = march(system, start, until=1.0, steps=steps, command=command)
        defects.append(float(jnp.sum(end.energy - start.energy) - jnp.sum(end.work)))
    assert float(end.work[WORKS.index("actuation")]) > 0.0
    assert order(np.abs(defects)) == pytest.approx(2.0, abs=0.2)


def test_still_water_and_damping_only_take_energy():
    system = carried(gravity=9.81, displaced_area=1e-4, damping_time=0.05)
    states, _ = track(system, rest(system), 0.004)
    for name in ("drag", "damping"):
        power = np.sum(states.working[name] * states.motion.velocity, axis=(1, 2))
        assert power.max() <= 0.0
        assert states.work[-1, WORKS.index(name)] < -0.01


# --- start, base motion ------------------------------------------------------------------------


@pytest.mark.parametrize("time", [0.0, 0.37])
def test_initial_acceleration_balances_the_forces(time):
    # on a base that moves in all its channels, in a current that changes
    system = _everything()
    state = rest(system, time)
    residual, scale = map(np.asarray, imbalance(system, state))
    assert np.abs(residual[2:]).max() < 1e-12 * scale.max()
    assert np.abs(np.asarray(state.acceleration)).max() > 1.0
    force = -residual[:2].sum(axis=0)
    assert np.asarray(state.base_force) == pytest.approx(force, abs=1e-12)


def test_initial_velocity_is_that_of_the_base():
    system = _everything()
    state = rest(system, 0.37)
    (dx, dz, turn), (vx, vz, spin), _ = map(
        np.asarray, system.base.pose(state.time, system.base.servo.at_rest())
    )
    reach = np.linspace(0.0, 1.0, 11)[:, None]
    along = np.array([np.cos(turn), np.sin(turn)])
    across = np.array([-np.sin(turn), np.cos(turn)])
    assert np.asarray(state.position[1:]) == pytest.approx([dx, dz] + reach * along, abs=1e-12)
    assert np.asarray(state.velocity[1:]) == pytest.approx(
        [vx, vz] + reach * spin * across, abs=1e-12
    )


def test_the_root_follows_the_prescribed_motion():
    system = _everything()
    passed = [march(system, rest(system), until=0.17 * n, steps=20 * n) for n in range(1, 5)]
    states = jax.tree.map(lambda *leaves: np.stack(leaves), *passed)
    for channel, axis in ((1, 1), (0, 0)):
        (motion,) = (m for m in system.base.motions if m.channel == channel)
        rate = 2 * np.pi * float(motion.frequency)
        angle = rate * states.time + float(motion.phase)
        amplitude = float(motion.amplitude)
        assert states.position[:, 1, axis] == pytest.approx(amplitude * np.sin(angle), abs=1e-13)
        assert states.velocity[:, 1, axis] == pytest.approx(
            amplitude * rate * np.cos(angle), abs=1e-12
        )
        assert states.acceleration[:, 1, axis] == pytest.approx(
            -amplitude * rate**2 * np.sin(angle), abs=1e-11
        )
    # the ghost edge turns with the tilt
    edge = states.position[:, 1] - states.position[:, 0]
    tilt = 0.2 * np.sin(2 * np.pi * 0.6 * states.time)
    assert np.arctan2(edge[:, 1], edge[:, 0]) == pytest.approx(tilt, abs=1e-12)
    assert np.hypot(*edge.T) == pytest.approx(0.1, abs=1e-13)


def test_depth_does_not_round_the_motion():
    shallow, deep = (
        march(system, rest(system), until=1.0, steps=200)
        for system in (_everything(depth=10.0), _everything(depth=4000.0))
    )
    assert np.asarray(deep.position) == pytest.approx(np.asarray(shallow.position), abs=1e-10)
    assert np.asarray(deep.velocity) == pytest.approx(np.asarray(shallow.velocity), abs=1e-9)


def test_what_is_at_rest_stays_at_rest():
    # edges of 1/8 m, which have no round-off
    system = bare(length=1.25)
    start = rest(system)
    states, outcomes = track(system, start, 0.01)
    assert np.array_equal(states.position, np.broadcast_to(start.position, (CHUNK, 12, 2)))
    assert not states.velocity.any()
    assert not outcomes.iterations.any()


@pytest.mark.parametrize(("tilt", "curvature"), [(0.7, 0.0), (-0.4, 2.0)])
def test_round_off_does_not_stir_what_is_at_rest(tilt, curvature):
    system = bare(tilt=tilt, rest_curvature=curvature)
    start = rest(system)
    states, outcomes = track(system, start, 0.01)
    assert np.abs(states.position - start.position).max() < 1e-13
    # one that gains nothing shows that there is nothing to gain
    assert outcomes.iterations.max() <= 2
    assert outcomes.iterations.mean() < 1.05


def expected(accelerations):
    """Return the acceleration that is expected after those of six steps, the last one last."""
    state = rest(bare())
    motion = eqx.tree_at(lambda m: m.acceleration, state.motion, accelerations[-1])
    earlier = jnp.stack(accelerations[-2::-1])
    then = eqx.tree_at(lambda s: (s.motion, s.earlier), state.state, (motion, earlier))
    return expected_acceleration(bare().forces, then)


def test_smooth_motion_is_guessed_and_what_jumps_is_taken_to_stay():
    rng = np.random.default_rng(0)
    shape = rest(bare()).state.motion.acceleration.shape
    bent, turned, stiff, steady = rng.normal(size=(4, *shape))
    time = 0.1 * np.arange(7)
    smooth = [bent * t**2 + turned * t + steady for t in time]
    alternating = [a + (-1) ** n * stiff for n, a in enumerate(smooth)]
    for known in (smooth, alternating):
        assert np.asarray(expected(known[:6])) == pytest.approx(known[6], abs=1e-12)
    # what alternates about nothing else, and what is never the same
    rising = [1.2**n * a for n, a in enumerate([stiff, -stiff] * 3)]
    assert np.array_equal(expected(rising), rising[-2])
    jumps = list(rng.normal(size=(6, *shape)))
    assert np.array_equal(expected(jumps), jumps[-1])
    # what the arm does as one bends nothing, and does not count
    sways = (0.0, 30.0, 10.0, 0.0, 20.0, 20.0)  # by which it would stay
    swaying = [
        a + 0.1 * rng.normal(size=shape) + sway
        for a, sway in zip([stiff, steady] * 3, sways, strict=True)
    ]
    assert np.array_equal(expected(swaying), swaying[-2])


# --- steps that fail ---------------------------------------------------------------------------


def pushed(tip_force: ArrayLike, max_iterations: int = 15) -> System:
    """Build an arm that a force on its tip, there at once, buckles and folds back."""
    return bare(tip_force=tip_force, damping_time=0.02, max_iterations=max_iterations)


def whole_step(system: System, state: Kept, step: float) -> tuple[Kept, bool]:
    """Return the state after one step that is not cut, and whether it is good."""
    return _march(system, state, STILL, 1, step)


def test_halving_recovers_a_step_that_newton_cannot_take():
    system = pushed((-10.0, -1.0))  # four times the buckling load
    start = rest(system)
    _, good = whole_step(system, start, 0.1)
    assert not good
    state, progress = advance(system, start, jnp.asarray(0.1))
    assert progress.outcome.converged
    assert progress.steps > 1
    assert progress.iterations > progress.outcome.iterations
    assert float(state.time) == pytest.approx(0.1, rel=1e-12)
    fine = march(system, start, until=0.1, steps=1000)
    moved = np.abs(np.asarray(fine.position - start.position)).max()
    assert moved > 0.03
    # few and coarse steps of a sudden load: no closer than their own error, which is of order 2
    quarters = start
    for _ in range(4):
        quarters, _ = advance(system, quarters, jnp.asarray(0.025))
    errors = [np.abs(np.asarray(s.position - fine.position)).max() for s in (state, quarters)]
    assert errors[0] < 0.12 * moved
    assert errors[1] < 0.01 * moved


@pytest.mark.parametrize(
    ("force", "max_iterations", "step", "steps"),
    [((-1e3, 0.0), 15, 3.0, 0), ((-1e2, -10.0), 6, 1.0, 1)],
)
def test_a_step_past_all_halvings_gives_back_the_last_good_state(
    force, max_iterations, step, steps
):
    system = pushed(force, max_iterations)
    start = rest(system)
    state, progress = advance(system, start, jnp.asarray(step))
    assert not progress.outcome.converged
    assert (int(progress.steps) > 0) == bool(steps)
    for leaf in jax.tree.leaves(state):
        assert np.isfinite(leaf).all()
    assert float(state.time) < step
    residual, scale = map(np.asarray, imbalance(system, state))
    assert np.abs(residual[2:]).max() <= 1e-9 * scale.max()
    if not steps:
        assert eqx.tree_equal(state, start)


def test_a_good_step_is_not_cut():
    system = pushed((0.0, -1.0))
    start = rest(system)
    state, progress = advance(system, start, jnp.asarray(0.01))
    stepped, good = whole_step(system, start, 0.01)
    assert good
    assert progress.steps == 1
    assert progress.iterations == progress.outcome.iterations
    assert np.asarray(state.position) == pytest.approx(np.asarray(stepped.position), abs=1e-14)


def test_a_step_that_errs_too_much_is_cut_in_two():
    system = pushed((0.0, -1.0))
    start, step = rest(system), 0.02
    _, whole = advance(system, start, jnp.asarray(step))
    assert whole.steps == 1
    assert whole.error == whole.outcome.error > 0
    middle, first = advance(system, start, jnp.asarray(step / 2))
    end, second = advance(system, middle, jnp.asarray(step / 2))
    careful = eqx.tree_at(lambda s: s.max_error, system, 0.6 * whole.error)
    state, cut = advance(careful, start, jnp.asarray(step))
    assert cut.outcome.converged
    assert cut.steps == 2
    assert np.asarray(state.position) == pytest.approx(np.asarray(end.position), abs=1e-14)
    # of both parts, not of the last alone
    assert cut.error == max(first.error, second.error) <= careful.max_error
    assert cut.residual == max(first.residual, second.residual)
    assert cut.iterations == whole.iterations + first.iterations + second.iterations
    # past all halvings it fails, and says by how much it errs
    hopeless = eqx.tree_at(lambda s: s.max_error, system, jnp.asarray(1e-12))
    state, failed = advance(hopeless, start, jnp.asarray(step))
    assert not failed.outcome.converged
    assert failed.outcome.error > 1e-12
    assert failed.steps == 0
    assert eqx.tree_equal(state, start)
