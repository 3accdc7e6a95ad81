"""The spatial arm in time: frequencies, orders, energy, directions of the world, twist and writhe.

All arms here are of one make, so that their step is compiled once; what a test does without is
zero.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from crinoid.base import SineMotion, TableMotion
from crinoid.dynamics import Integrator, find_modes
from crinoid.elements import ENERGIES, WORKS, DistributedLoad, TipLoad, Tool
from crinoid.flow import Sine, Uniform
from crinoid.frames import tangents
from crinoid.onset import Onset
from crinoid.space import CHANNELS
from crinoid.spline import PiecewisePolynomial
from physics import Kept, always, arm, facing, order

pytestmark = pytest.mark.usefixtures("optimised")

NODES = 9
CHUNK = 50
"""Steps of one compiled run."""
STILL = np.zeros(6)
ROLL = CHANNELS[3].index("roll")
TURN = 2 * np.pi

# --- how an arm is run: compiled once, whatever its numbers ------------------------------------


@eqx.filter_jit(compiler_options={"xla_backend_optimization_level": 0})
def _rest(system, time):
    return Kept.of(system, system.rest(time))


def rest(system, time=0.0):
    return _rest(system, jnp.asarray(time))


@eqx.filter_jit
def _run(system, state, command, step):
    def once(state, _):
        state, outcome = state.step(system, command, step)
        return state, (state, (state.base_force, state.base_moment), outcome)

    return jax.lax.scan(once, state, None, length=CHUNK)[1]


def felt(system, state, *, until, steps, command=STILL):
    """Return the states after each of equal steps, and force and moment on the base in each.

    None of the steps may fail.
    """
    step = jnp.asarray((until - float(state.time)) / steps, float)
    parts = []
    assert steps % CHUNK == 0
    for _ in range(steps // CHUNK):
        states, wrench, outcomes = _run(system, state, jnp.asarray(command), step)
        assert outcomes.converged.all()
        state = jax.tree.map(lambda leaf: leaf[-1], states)
        parts.append(jax.tree.map(np.asarray, (states, wrench)))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def run(system, state, **how):
    """Return the states after each of equal steps, none of which may fail."""
    return felt(system, state, **how)[0]


@eqx.filter_jit(compiler_options={"xla_backend_optimization_level": 0})
def _inertia(system, motion):
    def kinetic(velocity):
        moving = eqx.tree_at(lambda m: m.velocity, motion, velocity)
        return system.forces.energy(moving)[ENERGIES.index("kinetic")]

    return jax.hessian(kinetic)(jnp.zeros_like(motion.velocity))


def momentum(system, state, velocity):
    """Return the momentum of all nodes, the held ones too, and the spin's of each edge.

    It is the slope of the kinetic energy by the velocities, which is linear in them: of
    accelerations it is the rate of change.
    """
    return np.tensordot(velocity, _inertia(system, state.motion), axes=2)


def at(states, index):
    return jax.tree.map(lambda leaf: jnp.asarray(leaf[index]), states)


def channels(**given):
    """Return a number for each channel, zero if not given."""
    return jnp.asarray([given.get(name, 0.0) for name in CHANNELS[3]], float)


def body(rod, share, inertia):
    """Build a share of a tool that has all that one may have."""
    return Tool.of(
        rod, mass=0.2 * share, inertia=share * inertia, density=1000.0 * share,
        gravity=9.81 * share, volume=5e-5, added_mass=0.05 * share, drag_area=2e-3, offset=0.05,
    )  # fmt: skip


def spatial(
    *,
    swing=None,
    frequency=0.7,
    phase=0.3,
    paths=None,
    dead=(0.0, 0.0, 0.0),
    follower=(0.0, 0.0, 0.0),
    moment=(0.0, 0.0, 0.0),
    follower_moment=(0.0, 0.0, 0.0),
    tangential=0.0,
    normal=0.0,
    fixed=(0.0, 0.0, 0.0),
    onset=0.0,
    current=(0.0, 0.0, 0.0),
    swaying=(0.0, 0.0, 0.0),
    tool=0.0,
    **properties,
):
    """Build a spatial arm in water, on a base that swings in all channels and follows paths.

    In the water a current is steady and another a sine of 1.3 Hz. Loads come on within the time
    ``onset`` (s). ``tool`` is the share of a `body` at the tip.
    """
    number = jnp.asarray
    amplitudes = channels(**swing or {})
    motions = [
        SineMotion(i, amplitudes[i], number(frequency), number(phase * (i + 1)))
        for i in range(len(amplitudes))
    ]
    for i, name in enumerate(CHANNELS[3]):
        time, path = (paths or {}).get(name, ((0.0, 1.0, 2.0, 3.0), np.zeros(4)))
        knots = np.linspace(time[0], time[-1], 41)  # as many for all: they are compiled once
        table = CubicSpline(knots, CubicSpline(time, path)(knots))
        motions.append(TableMotion(i, PiecewisePolynomial(table)))
    ramp = Onset.of(0.0, onset)
    settings = {"axes": 3, "nodes": NODES, "EA": 1e3, "GJ": 0.8, "water_density": 1000.0}
    return arm(
        loads=(
            lambda rod: DistributedLoad.of(
                rod, tangential=tangential, normal=normal, fixed=number(fixed), onset=ramp
            ),
            lambda rod: TipLoad.of(
                rod,
                dead_force=number(dead),
                follower_force=number(follower),
                moment=number(moment),
                follower_moment=number(follower_moment),
                onset=ramp,
            ),
            lambda rod: body(rod, tool, jnp.array([1e-3, 2e-3, 3e-3])),
        ),
        flows=(
            Uniform(always(), number(current, float)),
            Sine(always(), number(swaying, float), number(1.3), number(0.4)),
        ),
        motions=motions,
        **settings | properties,
    )


def dry(**properties):
    """Build an arm in a vacuum."""
    return spatial(water_density=0.0, linear_drag=1e-300, **properties)


def everything(**changes):
    """Build an arm on which everything acts at once."""
    return spatial(
        **{
            "EI": (0.8, 1.3), "rest_curvature": (0.5, -0.7, 1.1), "damping_time": 0.05,
            "gravity": 9.81, "displaced_area": 8e-4, "diameter": 0.032, "radius": 0.2,
            "added_mass_tangential": 0.2, "linear_drag": 0.5, "tolerance": 1e-12,
            "current": (0.3, -0.4, 0.1), "swaying": (0.2, 0.3, -0.4),
            "swing": {
                "slide": 0.03, "sway": -0.05, "heave": 0.04, "pan": 0.2, "tilt": -0.15, "roll": 0.4,
            },
            "paths": {"roll": ((0.0, 1.0, 2.0, 3.0), (0.0, 2.0, 1.0, 4.0))},
            "tangential": 0.1, "normal": 0.3, "fixed": (0.2, -0.2, 0.3), "onset": 0.4,
            "dead": (0.2, 0.4, 0.6), "follower": (0.1, -0.2, 0.3),
            "moment": (0.1, 0.05, -0.2), "follower_moment": (0.2, -0.1, 0.1),
            "pan": 0.4, "tilt": 0.2, "roll": -0.6,
        } | changes
    )  # fmt: skip


# --- vibration ---------------------------------------------------------------------------------


@eqx.filter_jit(compiler_options={"xla_backend_optimization_level": 0})
def _linearise(system):
    return system.linearise(system.rest())


def vibrations(system, column):
    """Return circular frequencies (rad/s) and shapes of a straight arm's modes in one column."""
    modes = find_modes(*_linearise(system), 14)
    size = np.abs(modes.shape).max(axis=1)
    chosen = size[:, column] > 0.99
    others = np.delete(size[chosen], column, axis=1)
    np.testing.assert_allclose(others, 0, atol=1e-6)
    return TURN * modes.frequency[chosen], modes.shape[chosen]


def ring_down(system, column, mode, step=0.2):
    """Return frequency (rad/s) and pole (1/s) with which one mode of small amplitude rings.

    The trapezoid rule maps a pole ``s`` to ``z = (1 + s h / 2) / (1 - s h / 2)`` (Tustin), which is
    undone; ``z`` comes from the two-term recurrence of the motion.
    """
    frequency, shapes = vibrations(system, column)
    frequency, shape = frequency[mode], shapes[mode]
    velocity = np.concatenate([np.zeros((1, 4)), 1e-3 * shape])
    slowing = -float(system.forces.bend.damping_time[0]) * frequency**2 * velocity
    state = eqx.tree_at(
        lambda s: (s.motion.velocity, s.motion.acceleration),
        rest(system),
        (jnp.asarray(velocity), jnp.asarray(slowing)),
    )
    step = step / frequency
    tip = run(system, state, until=200 * step, steps=200).motion.position[:, -1, column]
    (twice, minus), *_ = np.linalg.lstsq(np.stack([tip[1:-1], tip[:-2]], 1), tip[2:], rcond=None)
    z = np.roots([1.0, -twice, -minus])
    s = 2.0 / step * (z - 1.0) / (z + 1.0)
    return frequency, complex(s[np.argmax(s.imag)])


CANTILEVER = np.array([1.8751041, 4.6940911])
"""beta L: roots of cos(x) cosh(x) = -1 (Blevins 1979, table 8-1)."""
LINEAR = {"drag_normal": 0.0, "drag_tangential": 0.0, "tolerance": 1e-12}
EDGES = NODES - 1


def torsion(mode):
    """Return the circular frequency of a mode of twist, and that of a chain of ``EDGES`` edges.

    (2 n - 1) pi / 2 sqrt(GJ / rho J) / L, with rho J = m r^2 / 2 (Blevins 1979, table 8-16); of
    masses in the middle of the edges, with half an edge's spring at the clamp, a sine's difference.
    """
    speed = np.sqrt(0.8 / 0.5)
    exact = (2 * mode + 1) * np.pi / 2 * speed
    return exact, 2 * EDGES * speed * np.sin(exact / speed / EDGES / 2)


def test_frequencies_of_twist_are_those_of_a_wave_along_the_arm():
    frequency, shapes = vibrations(spatial(), 3)
    assert len(frequency) >= 4
    for mode in range(4):
        exact, chain = torsion(mode)
        assert frequency[mode] == pytest.approx(chain, rel=1e-10)
        assert frequency[mode] == pytest.approx(exact, rel=0.5 * (exact / EDGES) ** 2)
        middles = (np.arange(EDGES) + 0.5) / EDGES
        sine = np.sin((2 * mode + 1) * np.pi / 2 * middles)
        shape = shapes[mode, 1:, 3]
        np.testing.assert_allclose(shape, sine * (shape[-1] / sine[-1]), rtol=0, atol=1e-9)


@pytest.mark.parametrize("mode", [0, 2])
def test_a_mode_of_twist_rings_at_its_frequency_and_damping(mode):
    damping_time = 0.01
    frequency, pole = ring_down(spatial(damping_time=damping_time, **LINEAR), 3, mode)
    assert frequency == pytest.approx(torsion(mode)[1], rel=1e-10)
    assert abs(pole) == pytest.approx(frequency, rel=1e-8)
    assert -pole.real / abs(pole) == pytest.approx(damping_time * frequency / 2, rel=1e-7)


@pytest.mark.parametrize("column", [1, 2])
@pytest.mark.parametrize("mode", [0, 1])
def test_bending_rings_at_its_frequency_and_damping_both_ways(mode, column):
    damping_time, EI = 0.01, (1.0, 1.7)
    system = spatial(damping_time=damping_time, EI=EI, **LINEAR)
    frequency, pole = ring_down(system, column, mode)
    exact = CANTILEVER[mode] ** 2 * np.sqrt(EI[column - 1])
    assert frequency == pytest.approx(exact, rel=(3e-5, 1e-3)[mode])
    assert abs(pole) == pytest.approx(frequency, rel=1e-7)
    assert -pole.real / abs(pole) == pytest.approx(damping_time * frequency / 2, rel=1e-6)


def test_a_rolled_arm_bends_as_softly_whichever_way_it_is_seen():
    # with the softer direction at 0.7 from y, the frequencies are those of before
    level = TURN * find_modes(*_linearise(spatial(EI=(1.0, 1.7))), 8).frequency
    turned = spatial(EI=(1.0, 1.7), pan=1.1, tilt=-0.5, roll=0.7)
    np.testing.assert_allclose(
        TURN * find_modes(*_linearise(turned), 8).frequency, level, rtol=1e-8
    )


def test_water_lowers_the_frequencies_of_bending_but_not_of_twist():
    # m = 1 kg/m, rho A = 0.6 kg/m, Ca = 1.5
    wet = {"displaced_area": 6e-4, "added_mass_normal": 1.5}
    lower, unlike = np.sqrt(1 / (1 + 1.5 * 0.6)), {"EA": 1e6, "EI": (1.0, 1.7)}
    for column, share in ((1, lower), (2, lower), (3, 1.0)):
        dry_, wet_ = (vibrations(spatial(**case, **unlike), column)[0][:2] for case in ({}, wet))
        np.testing.assert_allclose(wet_ / dry_, share, rtol=1e-9)


# --- order in the time step, energy ------------------------------------------------------------


def swing(integrator, steps):
    """Return where an arm is 0.8 s after it was let go: heavy, crooked, soft and far from round."""
    system = dry(
        EI=(0.6, 1.4), GJ=0.5, radius=0.2, rest_curvature=(1.5, -1.0, 3.0), gravity=10.0,
        damping_time=0.02, tilt=0.4, pan=0.3, roll=0.5, integrator=integrator, tolerance=1e-12,
    )  # fmt: skip
    last = at(run(system, rest(system), until=0.8, steps=steps), -1)
    return last, np.concatenate(
        [np.ravel(part) for part in (last.position, last.motion.orientation.director[1:])]
    )


@pytest.fixture(scope="module")
def fine_swing():
    return swing(Integrator.newmark(), 6400)[1]


@pytest.mark.parametrize(
    ("integrator", "expected", "within"),
    [
        (Integrator.newmark(), 2.0, 0.05),
        (Integrator.generalized_alpha(0.8), 2.0, 0.05),
        (Integrator.implicit_euler(), 1.0, 0.05),
    ],
    ids=["newmark", "alpha-0.8", "implicit-euler"],
)
def test_order_in_the_time_step_on_a_large_swing_with_twist(
    fine_swing, integrator, expected, within
):
    # all against one reference, so all converge to the same motion
    ends = [swing(integrator, steps) for steps in (200, 400, 800)]
    last = ends[-1][0]
    assert float(last.position[-1, 2]) < -0.4
    assert np.abs(np.diff(np.asarray(last.motion.orientation.twist))).max() > 0.1
    errors = [np.abs(end - fine_swing).max() for _, end in ends]
    print(errors, order(errors))
    assert order(errors) == pytest.approx(expected, abs=within)


def swinging(load, radius):
    return dry(
        EI=(0.8, 1.5), radius=radius, rest_curvature=(0.4, 0.0, 2.0), gravity=load, pan=0.3,
        roll=0.5, tolerance=1e-12,
    )  # fmt: skip


def gained(start, states):
    """Return how much the energy of each state is above the first's, over the largest kinetic."""
    kinetic = states.energy[:, ENERGIES.index("kinetic")].max()
    return (states.energy.sum(axis=1) - float(start.energy.sum())) / kinetic


@pytest.mark.parametrize(
    ("load", "radius", "step", "spin", "travel", "band"),
    [(2.0, 0.3, 0.01, 0.4, 10.0, 2e-4), (10.0, 0.05, 0.0025, 10.0, 20.0, 2e-3)],
    ids=["gentle", "wild"],
)
def test_energy_of_an_undamped_swing_stays_in_a_band(load, radius, step, spin, travel, band):
    # 1e4 steps. The large load makes the motion chaotic, which stirs up ever faster vibrations; and
    # of one that turns by an angle x in a step the trapezoid rule misses the share x^2 / 6 of its
    # energy (what it keeps is in tests/test_dynamics.py). So the energy seems to sink
    system = swinging(load, radius)
    start = rest(system)
    states = run(system, start, until=1e4 * step, steps=10_000)
    assert np.abs(states.motion.velocity[:, 2:, 3]).max() > spin
    assert np.abs(np.diff(states.position[:, -1], axis=0)).sum(axis=0).min() > travel
    assert states.energy[:, ENERGIES.index("kinetic")].max() > 0.04 * load
    assert np.abs(gained(start, states)).max() < band


def test_the_band_of_the_energy_shrinks_with_the_square_of_the_step():
    system = swinging(10.0, 0.05)
    start = rest(system)
    bands = [
        np.abs(gained(start, run(system, start, until=5.0, steps=steps))).max()
        for steps in (500, 1000, 2000)
    ]
    assert order(bands) == pytest.approx(2.0, abs=0.1)
    assert bands[-1] < 1e-4


@pytest.mark.parametrize(
    "integrator",
    [Integrator.newmark(), Integrator.generalized_alpha(0.8)],
    ids=["newmark", "alpha-0.8"],
)
def test_energy_audit_closes_at_order_two(integrator):
    defects = []
    system = everything(integrator=integrator)
    start = rest(system)
    for steps in (200, 400, 800):
        end = at(run(system, start, until=1.0, steps=steps), -1)
        defects.append(float(jnp.sum(end.energy - start.energy) - jnp.sum(end.work)))
    absent = [WORKS.index("contact"), WORKS.index("tool")]
    worked = np.delete(np.asarray(end.work), absent)
    print(defects, order(np.abs(defects)), worked)
    assert np.abs(worked).min() > 0.01  # J: drag, damping, base, loads, added mass all work
    assert order(np.abs(defects)) == pytest.approx(2.0, abs=0.1)
    assert abs(defects[-1]) < 2e-4 * np.abs(worked).sum()


def test_servos_that_turn_the_base_do_the_work_that_the_arm_gains():
    command = np.array([0.02, 0.04, -0.03, 0.2, 0.1, 0.5])
    system = dry(radius=0.2, rest_curvature=(0.4, 0.3, 1.0), gravity=9.81, damping_time=0.05,
                 tolerance=1e-12)  # fmt: skip
    start, whole, later = rest(system), [], []

    def defect(since, end):
        return float(jnp.sum(end.energy - since.energy) - jnp.sum(end.work - since.work))

    for steps in (200, 400, 800):
        states = run(system, start, until=1.0, steps=steps, command=command)
        end = at(states, -1)
        whole.append(defect(start, end))
        later.append(defect(at(states, steps // 10 - 1), end))
    actuation = float(end.work[WORKS.index("actuation")])
    assert actuation > 0.0
    # the jerk at the first step, where the command jumps, leaves an error that falls faster still
    np.testing.assert_allclose(order(np.abs(later)), 2.0, atol=0.05)
    assert (order(np.abs(whole)) > 1.9).all()
    assert abs(whole[-1]) < 1e-3 * actuation


# --- motion in water ---------------------------------------------------------------------------

ANYHOW = {"pan": 0.7, "tilt": 0.3, "roll": 0.4}


def carried(speed=(0.0, 0.0, 0.0), acceleration=(0.0, 0.0, 0.0), **properties):
    """Build an arm under water on a base that moves along a straight line, from rest or not."""
    time = np.arange(-1.0, 4.0)
    paths = {
        name: (time, v * time + 0.5 * a * time**2)
        for name, v, a in zip(("slide", "sway", "heave"), speed, acceleration, strict=True)
    }
    return spatial(paths=paths, **properties)


def assert_rigid(system, *, until, scale):
    """Run an arm that must feel no force, and so keep its shape."""
    start = rest(system)
    states, (force, moment) = felt(system, start, until=until, steps=50)
    np.testing.assert_allclose(force, 0, atol=1e-8 * scale)
    np.testing.assert_allclose(moment, 0, atol=1e-8 * scale)
    shape = states.position - states.position[:, 1:2]
    np.testing.assert_allclose(shape, np.broadcast_to(start.position, shape.shape), atol=1e-9)
    return states


@pytest.mark.parametrize(
    ("tilt", "added"), [(0.0, 1.3), (np.pi / 2, 0.2)], ids=["broadside", "along"]
)
def test_a_submerged_body_rises_with_its_buoyant_acceleration(tilt, added):
    # (rho V - m) g / (m + Ca rho V): a base that rises just so carries nothing
    mass, displaced, gravity = 0.4, 1.0, 9.81
    rising = (displaced - mass) * gravity / (mass + added * displaced)
    system = carried(
        acceleration=(0.0, 0.0, rising), **ANYHOW | {"tilt": tilt}, mass_per_length=mass,
        displaced_area=1e-3, added_mass_normal=1.3, added_mass_tangential=0.2, drag_normal=0.0,
        drag_tangential=0.0, gravity=gravity, EI=0.01,
    )  # fmt: skip
    np.testing.assert_allclose(rest(system).acceleration[1:, 2], rising, rtol=1e-10)
    assert_rigid(system, until=0.5, scale=1.0)


def test_a_cylinder_across_its_way_sinks_at_its_terminal_speed():
    diameter, heavier, drag, gravity = 0.01, 1.2, 1.1, 9.81
    area = np.pi / 4 * diameter**2
    terminal = np.sqrt(np.pi * diameter * gravity * (heavier - 1.0) / (2.0 * drag))
    assert terminal == pytest.approx(0.16738, abs=5e-6)
    system = carried(
        speed=(0.0, 0.0, -terminal), pan=0.7, roll=0.4, mass_per_length=heavier * 1000.0 * area,
        displaced_area=area, diameter=diameter, drag_normal=drag, gravity=gravity,
    )  # fmt: skip
    states = assert_rigid(system, until=0.5, scale=0.2 * 1000.0 * area * gravity)
    assert float(states.position[-1, -1, 2]) == pytest.approx(-0.5 * terminal, abs=1e-10)


def test_an_arm_carried_through_still_water_is_an_arm_in_a_current():
    speed = np.array([0.4, 0.3, -0.25])
    properties = {
        "EI": (0.05, 0.08), "GJ": 0.04, "gravity": 9.81, "mass_per_length": 0.9, "diameter": 0.03,
        "displaced_area": 8e-4, "damping_time": 0.02, "radius": 0.1, "tolerance": 1e-13,
        "rest_curvature": (0.5, 0.0, 1.0),
    }  # fmt: skip
    ends = []
    for moving in ({"speed": speed}, {"current": -speed}):
        system = carried(**moving, **properties, **ANYHOW)
        ends.append(at(run(system, rest(system), until=1.0, steps=100), -1))
    moved, stood = ends
    np.testing.assert_allclose(moved.position[1], speed, rtol=0, atol=1e-12)
    assert np.abs(stood.position - rest(system).position).max() > 0.05
    shift, drift = moved.position[1], moved.velocity[1]
    np.testing.assert_allclose(moved.position - shift, stood.position, rtol=0, atol=1e-10)
    np.testing.assert_allclose(moved.velocity - drift, stood.velocity, rtol=0, atol=1e-8)
    np.testing.assert_allclose(moved.base_force, stood.base_force, rtol=0, atol=1e-7)
    np.testing.assert_allclose(
        moved.motion.orientation.twist, stood.motion.orientation.twist, rtol=0, atol=1e-9
    )


# --- the plane in space, and the directions of the world ---------------------------------------

SWUNG = {"slide": 0.05, "heave": -0.04, "tilt": 0.2}
PLANAR = {
    "EI": 0.7, "rest_curvature": 0.6, "damping_time": 0.03, "gravity": 9.81, "diameter": 0.032,
    "displaced_area": 8e-4, "added_mass_tangential": 0.2, "linear_drag": 0.5, "tilt": 0.3,
    "tolerance": 1e-13, "floor": 1e-11,
}  # fmt: skip


def test_an_arm_confined_to_the_plane_moves_as_the_planar_arm():
    space = spatial(
        **PLANAR, swing=SWUNG, current=(0.3, 0.0, -0.2), swaying=(0.4, 0.0, 0.5), onset=0.3,
        tangential=0.1, normal=0.3, fixed=(0.2, 0.0, 0.3), dead=(0.2, 0.0, 0.6),
        follower=(0.1, 0.0, 0.3), moment=(0.0, -0.1, 0.0), follower_moment=(0.0, -0.05, 0.0),
        tool=1.0,
    )  # fmt: skip
    number, ramp = jnp.asarray, Onset.of(0.0, 0.3)
    phases = {name: 0.3 * (CHANNELS[3].index(name) + 1) for name in SWUNG}
    plane = arm(
        nodes=NODES, EA=1e3, water_density=1000.0, **PLANAR,
        loads=(
            lambda rod: DistributedLoad.of(
                rod, tangential=0.1, normal=0.3, fixed=(0.2, 0.3), onset=ramp
            ),
            lambda rod: TipLoad.of(
                rod, dead_force=(0.2, 0.6), follower_force=(0.1, 0.3), moment=0.15, onset=ramp
            ),
            lambda rod: body(rod, 1.0, 2e-3),
        ),
        flows=(
            Uniform(always(), number([0.3, -0.2])),
            Sine(always(), number([0.4, 0.5]), number(1.3), number(0.4)),
        ),
        motions=[
            SineMotion(i, *map(number, (SWUNG[name], 0.7, phases[name])))
            for i, name in enumerate(SWUNG)
        ],
    )  # fmt: skip
    (there, (force, moment)), (flat, (flat_force, flat_moment)) = (
        felt(system, rest(system), until=1.5, steps=300, command=np.zeros(len(system.inputs)))
        for system in (space, plane)
    )
    assert np.ptp(flat.position[:, -1], axis=0).min() > 0.2
    in_plane = np.array([0, 2])
    for got, expected in (
        (there.position, flat.position),
        (there.velocity, flat.velocity),
        (force, flat_force),
    ):
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(got[..., in_plane], expected, rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(got[..., 1], 0, atol=1e-9 * scale)
    np.testing.assert_allclose(moment[:, 1], -flat_moment, rtol=0, atol=1e-9)
    np.testing.assert_allclose(there.energy, flat.energy, rtol=0, atol=1e-9)
    np.testing.assert_allclose(there.work, flat.work, rtol=0, atol=1e-9)
    np.testing.assert_allclose(there.motion.orientation.twist, 0, atol=1e-9)


def turned(rotation, case):
    """Turn what has a direction in the world."""
    directed = ("fixed", "dead", "moment", "current", "swaying")
    return case | {name: rotation.apply(case[name]) for name in directed if name in case}


@pytest.mark.parametrize("gravity", [False, True], ids=["any", "about the vertical"])
def test_the_motion_does_not_depend_on_the_directions_of_the_world(gravity):
    # the base's angles are those that the rotation makes of it; it rolls as it is told
    case = {
        "EI": (0.8, 1.3), "rest_curvature": (0.5, -0.7, 1.1), "damping_time": 0.05,
        "displaced_area": 8e-4, "diameter": 0.032, "radius": 0.2, "linear_drag": 0.5,
        "tolerance": 1e-12, "current": (0.3, -0.4, 0.1), "swaying": (0.2, 0.3, -0.4),
        "paths": {"roll": ((0.0, 1.0, 2.0, 3.0), (0.0, 2.0, 1.0, 4.0))}, "onset": 0.4,
        "tangential": 0.1, "normal": 0.3, "fixed": (0.2, -0.2, 0.3), "dead": (0.2, 0.4, 0.6),
        "follower": (0.1, -0.2, 0.3), "moment": (0.1, 0.05, -0.2),
        "follower_moment": (0.2, -0.1, 0.1), "gravity": 9.81 if gravity else 0.0,
    }  # fmt: skip
    level = Rotation.from_euler("zyx", [0.4, -0.2, -0.6])
    systems = [spatial(**case, **facing(level.as_matrix()))]
    for seed in range(2):
        rotation = Rotation.random(random_state=seed)
        if gravity:
            rotation = Rotation.from_rotvec([0.0, 0.0, 2.0 + 3.0 * seed])
        systems.append(spatial(**turned(rotation, case), **facing((rotation * level).as_matrix())))
        systems[-1] = systems[-1], rotation
    plain, pushes = felt(systems[0], rest(systems[0]), until=1.0, steps=200)
    assert np.ptp(plain.position[:, -1], axis=0).min() > 0.1
    for system, rotation in systems[1:]:
        moved, pushed = felt(system, rest(system), until=1.0, steps=200)
        back = rotation.inv().as_matrix().T
        for got, expected in (
            (moved.position, plain.position),
            (moved.velocity, plain.velocity),
            *zip(pushed, pushes, strict=True),
        ):
            scale = max(1.0, np.abs(expected).max())
            np.testing.assert_allclose(got @ back, expected, rtol=0, atol=1e-8 * scale)
        orientation, expected = moved.motion.orientation, plain.motion.orientation
        np.testing.assert_allclose(orientation.director @ back, expected.director, atol=1e-8)
        np.testing.assert_allclose(orientation.twist, expected.twist, rtol=0, atol=1e-8)
        np.testing.assert_allclose(
            moved.motion.velocity[..., 3], plain.motion.velocity[..., 3], rtol=0, atol=1e-7
        )


# --- the base ----------------------------------------------------------------------------------

ALL_CHANNELS = {
    "slide": 0.06, "sway": -0.05, "heave": 0.04, "pan": 0.5, "tilt": -0.4, "roll": 0.9,
}  # fmt: skip


def tumbling(**properties):
    """Build an arm in a vacuum on a base that moves in all channels, and rolls several turns."""
    return dry(
        **{
            "EI": (0.8, 1.3), "rest_curvature": (0.5, -0.7, 1.1), "radius": 0.2, "pan": 0.4,
            "tilt": 0.2, "roll": -0.6, "swing": ALL_CHANNELS, "damping_time": 0.02,
            "paths": {"roll": ((0.0, 1.0, 2.0, 3.0), np.array([0.0, 2.5, 3.0, 0.0]) * TURN)},
            "tolerance": 1e-12,
        } | properties
    )  # fmt: skip


@pytest.fixture(scope="module")
def tumble():
    system = tumbling()
    return system, *felt(system, rest(system), until=2.0, steps=1000)


def test_the_clamp_follows_the_base_through_several_turns(tumble):
    system, states, _ = tumble
    servo = system.base.servo.at_rest()
    for n in range(99, 1000, 100):
        state = at(states, n)
        pose, _, _ = system.base.pose(state.time, servo)
        frame = np.asarray(system.base.frame(pose))
        ghost, root = np.asarray(state.position[:2])
        np.testing.assert_allclose(root, pose[:3], rtol=0, atol=1e-14)
        np.testing.assert_allclose((root - ghost) * EDGES, frame[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.motion.orientation.director[1], frame[1], atol=1e-12)
    # velocities of the clamp by differences of places and frames
    h = float(states.time[1] - states.time[0])
    for rows, rates in ((states.position, states.velocity), (states.velocity, states.acceleration)):
        difference = (rows[2:, :2] - rows[:-2, :2]) / (2 * h)
        scale = np.abs(rates[:, :2]).max()
        np.testing.assert_allclose(difference, rates[1:-1, :2], rtol=0, atol=2e-3 * scale)
    director = states.motion.orientation.director[:, 1]
    clamp = (states.position[:, 1] - states.position[:, 0]) * EDGES
    rate = (director[2:] - director[:-2]) / (2 * h)
    spin = np.sum(np.cross(clamp, director)[1:-1] * rate, axis=1)
    expected = states.motion.velocity[1:-1, 1, 3]
    assert np.abs(expected).max() > 10.0
    np.testing.assert_allclose(spin, expected, rtol=0, atol=2e-3 * np.abs(expected).max())


def test_the_base_feels_the_rate_of_change_of_momentum(tumble):
    # in a vacuum without gravity. Rotary inertia of the arm is that of its spin alone, about the
    # edge's own axis: what it takes to turn that axis is left out
    system, states, (got_force, got_moment) = tumble
    change, spinning = np.split(
        momentum(system, at(states, 0), states.motion.acceleration), [3], axis=-1
    )
    force = -np.sum(change, axis=1)
    lever = states.position - states.position[:, 1:2]
    moment = -np.cross(lever, change).sum(axis=1)
    scale = np.abs(force).max()
    assert scale > 5.0
    np.testing.assert_allclose(got_force, force, rtol=0, atol=1e-8 * scale)
    tangent = np.stack([np.asarray(tangents(jnp.asarray(x))) for x in states.position[::50]])
    spun = spinning[::50] * tangent
    assert np.abs(spun).max() > 1e-2
    np.testing.assert_allclose(
        got_moment[::50], moment[::50] - spun.sum(axis=1), rtol=0, atol=1e-8 * scale
    )


def test_impulse_of_the_base_is_the_momentum_that_the_arm_gains():
    # by velocities, at order 2; the moment about a fixed place with the angular momentum
    system = tumbling(radius=1e-3)  # so thin that its spin has no momentum
    start, misses = rest(system), []

    def momenta(state):
        carried = momentum(system, start, state.motion.velocity)[:, :3]
        angular = np.cross(state.position, carried)
        return np.concatenate([carried, angular], axis=1).sum(axis=0)

    for steps in (200, 400, 800):
        states, wrench = felt(system, start, until=0.5, steps=steps)
        first = (start.position, (start.base_force, start.base_moment))
        places, (force, about_root) = jax.tree.map(
            lambda first, later: np.concatenate([first[None], later]),
            first,
            (states.position, wrench),
        )
        moment = about_root + np.cross(places[:, 1], force)
        pushes = np.concatenate([force, moment], axis=1)
        impulse = np.sum(pushes[1:] + pushes[:-1], axis=0) * 0.25 / steps
        misses.append(np.linalg.norm(momenta(at(states, -1)) - momenta(start) + impulse))
    gained = np.linalg.norm(momenta(at(states, -1)) - momenta(start))
    print(misses, order(misses), gained)
    assert misses[-1] < 1e-3 * gained
    assert order(misses) == pytest.approx(2.0, abs=0.2)


def test_the_start_is_a_rigid_motion_and_in_balance():
    system = everything()
    for time in (0.0, 0.37):
        state = rest(system, time)
        velocity, places = np.asarray(state.velocity), np.asarray(state.position)
        # no edge changes its length, and no two nodes their distance
        apart = places[1:, None] - places[None, 1:]
        closing = np.sum(apart * (velocity[1:, None] - velocity[None, 1:]), axis=-1)
        np.testing.assert_allclose(closing, 0, atol=1e-12)
        assert np.abs(velocity[1:]).max() > 0.3
        # the spins are those of that rotation: nothing is damped
        damping = state.working["damping"]
        assert abs(float(jnp.sum(damping * state.motion.velocity))) < 1e-20
        assert np.abs(state.motion.velocity[2:, 3]).max() > 0.1
        force = -np.asarray(state.reaction[:, :3]).sum(axis=0)
        np.testing.assert_allclose(state.base_force, force, rtol=0, atol=1e-12)


def test_what_is_at_rest_stays_at_rest():
    system = dry(pan=0.4, tilt=0.7, roll=2.0, rest_curvature=(1.0, -2.0, 4.0), EI=(1.0, 1.7))
    start = rest(system)
    states = run(system, start, until=2.0, steps=200)
    assert np.abs(states.position - start.position).max() < 1e-12
    assert (
        np.abs(states.motion.orientation.director - start.motion.orientation.director).max() < 1e-11
    )


# --- turns that are wound up, and turns that are not -------------------------------------------


def by_turns(turns, within):
    """Return a table of roll: from rest to whole turns within a time (s), and held there."""
    time = np.linspace(0.0, 2 * within, 41)
    share = np.clip(time / within, 0.0, 1.0)
    return time, TURN * turns * share**2 * (3 - 2 * share)


def settled(system, state, until):
    return at(run(system, state, until=until, steps=800), -1)


@pytest.mark.parametrize("gravity", [0.0, 4.0], ids=["straight", "hanging"])
def test_rolling_the_base_carries_a_round_arm_along_and_winds_up_nothing(gravity):
    # it rolls about its own line, whether that is straight or an arc
    case = {"radius": 0.2, "gravity": gravity, "damping_time": 0.2, "pan": 0.3}
    idle = dry(**case, paths={"roll": by_turns(0.0, 2.0)})
    still = settled(idle, rest(idle), 16.0)
    assert bool(gravity) == (float(still.position[-1, 2]) < -0.3)
    system = dry(**case, paths={"roll": by_turns(3.0, 2.0)})
    start = eqx.tree_at(lambda s: s.motion.time, still, jnp.zeros(()))
    states = run(system, start, until=2.0, steps=400)
    # on the way it twists, and a bent arm is carried off sideways by its damping
    assert np.abs(states.motion.orientation.twist).max() > 0.05
    sideways = states.position @ [-np.sin(0.3), np.cos(0.3), 0.0]
    assert bool(gravity) == (np.abs(sideways).max() > 0.05)
    end = settled(system, at(states, -1), 16.0)
    np.testing.assert_allclose(end.position, still.position, rtol=0, atol=1e-7)
    np.testing.assert_allclose(end.motion.orientation.twist, 0, atol=1e-7)
    director = still.motion.orientation.director
    np.testing.assert_allclose(end.motion.orientation.director, director, rtol=0, atol=1e-6)


def test_rolling_the_base_turns_an_arm_that_is_not_round():
    # a naturally bent arm goes round with the base: after a quarter turn it points to starboard
    case = {"radius": 0.2, "damping_time": 0.2, "rest_curvature": (0.0, 1.0, 0.0), "EI": (1.0, 1.5)}
    system = dry(**case, paths={"roll": by_turns(2.25, 1.0)})
    start = rest(system)
    end = settled(system, at(run(system, start, until=2.0, steps=400), -1), 20.0)
    x, _, z = np.asarray(start.position).T
    # roll from +y toward +z turns what points up to -y
    np.testing.assert_allclose(end.position, np.stack([x, -z, 0 * x], axis=1), rtol=0, atol=1e-6)


def writhe(places):
    """Return the writhe of a closed polygon: the Gauss integral over all pairs of edges.

    Of two edges the solid angle of the directions from one to the other (Klenin and Langowski,
    Biopolymers 54 (2000) 307-317, method 1a).
    """
    nodes = np.asarray(places)
    ahead = np.roll(nodes, -1, axis=0)
    count, total = len(nodes), 0.0
    for i in range(count):
        j = np.arange(i + 2, count if i else count - 1)
        if not len(j):
            continue
        a, b, c, d = nodes[i], ahead[i], nodes[j], ahead[j]
        to = [c - a, d - a, d - b, c - b]
        faces = [np.cross(to[k], to[(k + 1) % 4]) for k in range(4)]
        faces = [face / (np.linalg.norm(face, axis=1)[:, None] + 1e-300) for face in faces]
        cosines = [np.sum(faces[k] * faces[(k + 1) % 4], axis=1) for k in range(4)]
        angle = np.sum(np.arcsin(np.clip(cosines, -1, 1)), axis=0)
        sign = np.sign(np.sum(np.cross(d - c, b - a) * (c - a), axis=1))
        total += np.sum(angle * sign) / (2 * np.pi)  # twice over 4 pi
    return total


def test_writhe_of_a_known_curve():
    # a long coil closed far away: 1 - cos(opening) per turn (Fuller, PNAS 68 (1971) 815-819)
    turns, per_turn, radius, pitch = 40, 40, 1.0, 2.0
    angle = TURN * np.arange(turns * per_turn + 1) / per_turn
    coil = np.stack([radius * np.cos(angle), radius * np.sin(angle), pitch * angle / TURN], axis=1)
    far = 1e4
    top, bottom = coil[-1] + [0, 0, far], coil[0] - [0, 0, far]
    aside = np.array([far, 0.0, 0.0])
    loop = np.concatenate([coil, [top, top + aside, bottom + aside, bottom]])
    opening = np.arctan2(TURN * radius, pitch)
    assert writhe(loop) == pytest.approx(turns * (1 - np.cos(opening)), rel=0.02)
    mirrored = loop * [1, 1, -1]
    assert writhe(mirrored) == pytest.approx(-writhe(loop), rel=1e-9)


def linked(state):
    """Return the twist and the writhe (turns) of an arm whose ends go on upward and downward."""
    places, far = np.asarray(state.position), 1e5
    up, down = places[0] + far * np.array([0, 0, 1.0]), places[-1] - far * np.array([0, 0, 1.0])
    aside = far * np.array([1.0, 0.0, 0.0])
    loop = np.concatenate([places, [down, down + aside, up + aside, up]])
    return np.sum(np.asarray(state.motion.orientation.twist)) / TURN, writhe(loop)


def test_turns_of_the_tip_and_the_base_become_twist_and_writhe():
    # Calugareanu, White, Fuller: of a ribbon, link = twist + writhe. An arm that hangs and is
    # naturally bent is wound at its tip by a torque, at its base by its roll, until it coils up;
    # its ends go on straight down and up. So the twist and the writhe together change by what the
    # director turns about the vertical at the tip, less what it turns at the base
    torque = 4.6 * 0.8 * TURN  # GJ = 0.8
    system = dry(
        radius=0.3, damping_time=0.1, tilt=-np.pi / 2, EI=(1.0, 1.2), dead=(0.0, 0.0, -53.0),
        rest_curvature=(2.5, 0.0, 0.0), moment=(0.0, 0.0, -torque), onset=2.0,
        paths={"roll": by_turns(-1.0, 2.0)}, tolerance=1e-11,
    )  # fmt: skip
    start = rest(system)
    states = run(system, start, until=1.94, steps=800)  # soon after it passes through itself

    down = np.array([0.0, 0.0, -1.0])
    before, wound, links = None, 0.0, []
    every = jax.tree.map(lambda first, later: np.concatenate([first[None], later]), start, states)
    for n in range(len(every.time)):
        state = jax.tree.map(lambda leaf, n=n: leaf[n], every)
        last = state.position[-1] - state.position[-2]
        last = last / np.linalg.norm(last)
        assert last @ down > -0.9
        director = state.motion.orientation.director[-1]
        share = director @ down / (1 + last @ down)
        carried = director - share * (last + down)  # transport to straight down
        angle = np.arctan2(down @ np.cross([1.0, 0.0, 0.0], carried), carried[0])
        turned_on = 0.0 if before is None else np.angle(np.exp(1j * (angle - before)))
        assert abs(turned_on) < 1.0
        wound, before = wound + turned_on / TURN, angle
        if n % 40 == 0:
            pose, _, _ = system.base.pose(jnp.asarray(state.time), system.base.servo.at_rest())
            links.append([*linked(state), wound, float(pose[ROLL]) / TURN])
    twist, writhes, tip, roll = np.array(links).T
    assert tip[-1] > 3.0
    assert np.ptp(writhes) > 0.4
    assert np.ptp(twist) > 1.0
    np.testing.assert_allclose(twist + writhes - (tip - roll), 0, atol=1e-5)


# --- folds -------------------------------------------------------------------------------------

advance = eqx.filter_jit(
    lambda system, state, step: state.advance(system, jnp.zeros(6), step),
    compiler_options={"xla_backend_optimization_level": 0},
)


def whole_step(system, state, step):
    """Return the state after one step that is not cut, and how it went."""
    states, _, outcomes = at(_run(system, state, jnp.zeros(6), jnp.asarray(step, float)), 0)
    return states, outcomes


def sharpest(state):
    edges = np.diff(np.asarray(state.position), axis=0)
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    return np.rad2deg(np.arccos(np.clip(np.sum(edges[1:] * edges[:-1], axis=1), -1, 1))).max()


def folding(calm, seed, *, outer, bent, turn, step):
    """Bend a straight arm sharply, its ``outer`` edges on their way to ``turn`` within a step."""
    places, velocity = np.array(calm.motion.position), np.zeros((NODES + 1, 4))
    hinge = places[-1 - outer, :3].copy()
    # in the plane of m_2, so that m_1 stays normal; and a little out of it
    velocity[2:] = 2e-3 * np.random.default_rng(seed).normal(size=(NODES - 1, 4)) / step
    fold = Rotation.from_rotvec([0.0, -np.deg2rad(bent), 0.0])
    for node in range(-outer, 0):
        lever = fold.apply(places[node, :3] - hinge)
        places[node, :3] = hinge + lever
        velocity[node, :3] += np.cross([0.0, -np.deg2rad(turn) / step, 0.0], lever)
    return eqx.tree_at(
        lambda s: (s.motion.position, s.motion.velocity, s.motion.acceleration),
        calm,
        (jnp.asarray(places), jnp.asarray(velocity), jnp.zeros((NODES + 1, 4))),
    )


@pytest.mark.parametrize(
    ("EI", "step"), [(5e-2, 0.005), (1e-5, 0.005), (1e-7, 0.02)], ids=["soft", "limp", "a string"]
)
def test_a_step_over_a_fold_is_refused_and_cut(EI, step):
    system = spatial(
        EI=EI, GJ=EI, EA=10.0, damping_time=1e-3, displaced_area=1e-6, radius=0.02, diameter=2e-3
    )
    calm = rest(system)
    refused, recovered, short = 0, 0, jnp.asarray(step)
    for seed in range(4):
        for outer in (1, 3):
            for bent, turn in ((150, 20), (150, 30), (150, 40), (165, 20)):
                start = folding(calm, seed, outer=outer, bent=bent, turn=turn, step=step)
                whole, outcome = whole_step(system, start, step)
                if outcome.converged:
                    assert sharpest(whole) < 170.0
                if outcome.folded:
                    assert not outcome.converged
                    assert sharpest(whole) > 170.0
                    refused += 1
                state, progress = advance(system, start, short)
                for leaf in jax.tree.leaves(state):
                    assert np.isfinite(leaf).all()
                assert sharpest(state) < 170.0
                assert progress.outcome.converged == (float(state.time) == pytest.approx(step))
                recovered += bool(progress.outcome.converged & outcome.folded)
    assert refused > 8
    # what has some stiffness bounces
    assert recovered == (refused if EI == 5e-2 else 0)


def test_what_is_not_a_number_is_never_accepted():
    system = spatial(gravity=9.81)
    calm = rest(system)
    for part in ("position", "velocity"):
        for column in range(4):
            rows = getattr(calm.motion, part).at[5, column].set(jnp.nan)
            broken = eqx.tree_at(lambda s, part=part: getattr(s.motion, part), calm, rows)
            _, outcome = whole_step(system, broken, 0.01)
            assert not outcome.converged
