"""The tool at the tip: against beams with a tip mass on paper, and rigid bodies by definition."""

import re
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import crinoid
from crinoid.dynamics import EnergyAccount, find_modes
from crinoid.elements import WORKS, Motion, Tool
from crinoid.numerics.frames import Orientation
from crinoid.numerics.ramp import Onset
from crinoid.rod import Rod
from helpers.arms import QUICKLY, arm, order

L, G, RADIUS, E = 0.5, 9.81, 0.02, 1.5e8
LINE, EI = 1080.0 * np.pi * RADIUS**2, E * np.pi / 4 * RADIUS**4
# the tool bends the arm by a fiftieth of its length; its axial modes are fast
ARM = {
    "length": L, "radius": RADIUS, "youngs_modulus": E, "density": 1080.0, "section": {"EA": 1e6},
}  # fmt: skip


def scenario(tool, *, dimension=2):
    arm = ARM | {"dimension": dimension}
    return crinoid.Scenario(arm=arm, water={"density": 0.0}, tool=tool)


@eqx.filter_jit(compiler_options=QUICKLY)
def hanging(system):
    state, outcome = system.find_equilibrium()
    return system.tip(state), system.linearise(state), outcome.converged


def first_frequency(mass: float, inertia: float, offset: float) -> float:
    """Return that of an Euler beam with a rigid body at its end (Hz).

    With ``w = A (cosh kx - cos kx) + B (sinh kx - sin kx)`` the end has
    ``EI w''' = -omega^2 M (w + d w')`` and ``EI w'' = omega^2 (J + M d^2) w' + omega^2 M d w``.
    """

    def determinant(k: float) -> float:
        x, squared = k * L, EI * k**4 / LINE
        c, s, ch, sh = np.cos(x), np.sin(x), np.cosh(x), np.sinh(x)
        w, slope = np.array([ch - c, sh - s]), k * np.array([sh + s, ch - c])
        bend, shear = k**2 * np.array([ch + c, sh + s]), k**3 * np.array([sh - s, ch + c])
        force = EI * shear + squared * mass * (w + offset * slope)
        turning = (inertia + mass * offset**2) * slope + mass * offset * w
        moment = EI * bend - squared * turning
        return float(np.linalg.det(np.array([force, moment])))

    k = brentq(determinant, 0.1 / L, 1.88 / L)
    return float(k**2 * np.sqrt(EI / LINE) / (2 * np.pi))


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    "tool", [{}, {"offset": 0.05, "inertia": 1e-3}], ids=["mass", "rigid body"]
)
def test_sag_and_first_frequency_are_those_of_a_beam_with_a_tip_mass(tool, dimension):
    mass, offset, inertia = 0.2, tool.get("offset", 0.0), tool.get("inertia", 0.0)
    case = scenario({"mass": mass, **tool}, dimension=dimension)
    tip, matrices, converged = hanging(crinoid.system(case))
    assert converged
    sag = mass * G * (L**3 / 3 + offset * L**2 / 2) / EI + LINE * G * L**4 / 8 / EI
    assert -10.0 - float(tip[dimension - 1]) == pytest.approx(sag, rel=6e-4)
    frequency = find_modes(*matrices).frequency
    expected = first_frequency(mass, inertia, offset)
    assert frequency[0] == pytest.approx(expected, rel=6e-4)
    # without the tool it is another
    assert expected < 0.8 * first_frequency(0.0, 0.0, 0.0)
    if dimension == 3:  # both ways
        assert frequency[1] == pytest.approx(expected, rel=6e-4)


# --- the element alone ---------------------------------------------------------------------------

BODY = {"mass": 0.7, "inertia": 0.03, "offset": 0.2}


def tool(axes, **others):
    """Return the only window of a tool."""
    rod = Rod.round(length=0.4, nodes=3, radius=0.01, density=1e3, youngs_modulus=1e5, axes=axes)
    return jax.tree.map(lambda x: x[0], Tool.of(rod, **{**BODY, **others}))


def moving(axes, seed, **others):
    """Return an edge that moves anyhow, in space with a spin."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(3, 2, 2 if axes == 2 else 4))
    names = ("velocity", "acceleration", "position")
    fields = dict(zip(names, map(jnp.asarray, rows), strict=True))
    fields |= dict.fromkeys(("flow_velocity", "flow_acceleration"), jnp.zeros((2, axes)))
    orientation = None
    if axes == 3:
        edge = np.diff(rows[2, :, :3], axis=0)[0]
        across = np.cross(edge, rng.normal(size=3))
        director = jnp.asarray([across, across]) / np.linalg.norm(across)
        orientation = Orientation(director, jnp.zeros(2), jnp.zeros((2, 3)))
    return Motion(**fields | others, time=jnp.zeros(()), orientation=orientation)


def test_in_the_plane_it_follows_lagranges_equations():
    element, motion = tool(2), moving(2, 0)

    def kinetic(position, velocity):
        _, (rate, _) = jax.jvp(element._stance, (position,), (velocity,))
        edge, change = position[1] - position[0], velocity[1] - velocity[0]
        turning = (edge[0] * change[1] - edge[1] * change[0]) / jnp.sum(edge**2)
        return 0.5 * BODY["mass"] * jnp.sum(rate**2) + 0.5 * BODY["inertia"] * turning**2

    now, ways = (motion.position, motion.velocity), (motion.velocity, motion.acceleration)
    _, rate = jax.jvp(jax.grad(kinetic, 1), now, ways)
    expected = rate - jax.grad(kinetic)(*now)
    np.testing.assert_allclose(element.residual(motion), expected, rtol=1e-12, atol=1e-12)


def test_in_space_forces_and_moments_are_the_rates_of_its_momenta():
    element, motion = tool(3, inertia=jnp.array([0.01, 0.03, 0.05])), moving(3, 1)
    assert motion.orientation is not None

    def momenta(position, velocity, spin, director):
        edge, change = position[1] - position[0], velocity[1] - velocity[0]
        tangent = edge / jnp.linalg.norm(edge)
        turning = jnp.cross(edge, change) / jnp.sum(edge**2) + spin * tangent
        axes = jnp.stack([tangent, director, jnp.cross(tangent, director)])
        (centre, _), (rate, _) = jax.jvp(element._stance, (position,), (velocity,))
        linear = BODY["mass"] * rate
        own = axes.T @ (element.inertia * (axes @ turning))
        return linear, jnp.cross(centre, linear) + own, turning

    director = motion.orientation.director[1]
    position, velocity = motion.position[:, :3], motion.velocity[:, :3]
    now = (position, velocity, motion.velocity[1, 3], director)
    turning = momenta(*now)[2]
    acceleration = motion.acceleration
    ways = (velocity, acceleration[:, :3], acceleration[1, 3], jnp.cross(turning, director))
    _, (force, moment, _) = jax.jvp(momenta, now, ways)
    found = element.residual(motion)
    tangent = (position[1] - position[0]) / jnp.linalg.norm(position[1] - position[0])
    about = jnp.sum(jnp.cross(position, found[:, :3]), axis=0) + found[1, 3] * tangent
    np.testing.assert_allclose(jnp.sum(found[:, :3], axis=0), force, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(about, moment, rtol=1e-12, atol=1e-12)
    # the edge passes nothing on along itself, and does not spin the one before
    assert abs(float(found[0, :3] @ tangent)) < 1e-12
    assert float(found[0, 3]) == 0.0


def test_in_the_plane_of_a_planar_arm_it_is_the_same_in_space():
    flat, still = moving(2, 2), jnp.zeros((2, 3))
    onto = jnp.zeros((2, 4)).at[0, 0].set(1.0).at[1, 2].set(1.0)  # x and z
    rows = (row @ onto for row in (flat.position, flat.velocity, flat.acceleration))
    oriented = Orientation(still.at[:, 1].set(1.0), jnp.zeros(2), still)
    deep = Motion(*rows, still, still, flat.time, oriented)
    expected = tool(2).residual(flat) @ onto
    np.testing.assert_allclose(tool(3).residual(deep), expected, rtol=1e-12, atol=1e-12)


def test_the_water_carries_drags_and_buoys_it():
    # at rest in the flow, beside a tip that stands still
    u, rate, rho = np.array([0.3, 0.4]), np.array([0.7, -0.2]), 1025.0
    still = dict.fromkeys(("velocity", "acceleration"), jnp.zeros((2, 2)))
    flow = {"flow_velocity": jnp.tile(u, (2, 1)), "flow_acceleration": jnp.tile(rate, (2, 1))}
    motion = moving(2, 3, **still, **flow)
    water = {"volume": 4e-4, "added_mass": 0.3, "drag_area": 2e-3}
    element = tool(2, density=rho, gravity=G, **water)
    force = -np.sum(element.residual(motion), axis=0)
    weight = (BODY["mass"] - rho * 4e-4) * G
    expected = (rho * 4e-4 + 0.3) * rate + 0.5 * rho * 2e-3 * 0.5 * u - [0.0, weight]
    np.testing.assert_allclose(force, expected, rtol=1e-8)


# --- taken up and let go -------------------------------------------------------------------------


@pytest.mark.release
def test_it_is_taken_up_and_let_go_without_a_jolt_and_the_ledger_balances():
    carried = {"mass": 0.3, "inertia": 0.01, "offset": 0.1, "gravity": 9.81}

    def grasping(start, stop):
        held = Onset.of(start, 0.0, stop)
        return arm(
            nodes=5,
            EI=3.0,
            EA=1e3,
            tolerance=1e-12,
            gravity=9.81,
            damping_time=0.02,
            loads=[lambda rod: Tool.of(rod, **carried, held=held)],
        )

    @eqx.filter_jit
    def begin(system):
        state = system.rest()
        return (state, EnergyAccount.of(system.forces, state)), system.energy(state)

    @eqx.filter_jit
    def part(system, step, begun):
        def one(carry, _):
            state, account = carry
            after, outcome = system.step(state, jnp.zeros(3), step)
            kept = (after.time, after.position[-1], after.velocity[-1], after.acceleration[-1])
            account = account.after(system.forces, state, after, jnp.asarray(step))
            return (after, account), (*kept, system.energy(after), account.work, outcome.converged)

        return jax.lax.scan(one, begun, length=40)

    def run(system, step, steps):
        (carry, energy), parts = begin(system), []
        assert steps % 40 == 0
        for _ in range(steps // 40):
            carry, kept = part(system, jnp.asarray(step), carry)
            parts.append(kept)
        return jax.tree.map(lambda *each: np.concatenate(each), *parts), energy

    paths, defects = {}, []
    for name, times in {"free": (2.0, 3.0), "grasped": (0.2, 0.6), "held": (0.0, 9.0)}.items():
        (*kept, _, _, converged), _ = run(grasping(*times), 0.005, 160)
        assert converged.all()
        paths[name] = [np.asarray(values) for values in kept]
    time, position, velocity, acceleration = paths["grasped"]
    before, since = time < 0.1999, time > 0.2001
    np.testing.assert_array_equal(position[before], paths["free"][1][before])
    assert np.abs(position[since] - paths["free"][1][since]).max() > 0.01
    for instant in (0.2, 0.6):
        index = int(np.argmin(np.abs(time - instant)))
        jolt = np.linalg.norm(acceleration[index] - acceleration[index - 1])
        assert jolt > 1.0  # m/s2: its weight comes and goes at once
        change = np.linalg.norm(velocity[index] - velocity[index - 1])
        assert change < 2 * 0.005 * np.abs(acceleration[index - 1 : index + 1]).sum()

    for steps in (200, 400, 800):
        (*_, energy, work, converged), start = run(grasping(0.2, 0.6), 0.8 / steps, steps)
        assert converged.all()
        defects.append(float(jnp.sum(energy[-1] - start) - jnp.sum(work[-1])))
    assert abs(float(work[-1][WORKS.index("tool")])) > 0.1
    assert order(np.abs(defects))[-1] > 1.8
    assert abs(defects[-1]) < 1e-4


# --- its table -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_its_numbers_can_be_differentiated_by():
    parameters = crinoid.parameters(scenario({"mass": 0.2, "offset": 0.05}))

    @eqx.filter_jit(compiler_options=QUICKLY)
    def slopes(parameters):
        def height(mass, offset):
            tool = replace(parameters.tool, mass=mass, offset=offset)
            system = crinoid.assemble(replace(parameters, tool=tool))
            return system.tip(system.find_equilibrium()[0])[1]

        return jax.jacfwd(height, (0, 1))(parameters.tool.mass, parameters.tool.offset)

    by_mass, by_offset = slopes(parameters)
    assert -float(by_mass) == pytest.approx(G * (L**3 / 3 + 0.05 * L**2 / 2) / EI, rel=2e-3)
    assert -float(by_offset) == pytest.approx(0.2 * G * L**2 / 2 / EI, rel=2e-3)


ABOVE_0, FROM_0 = "must be a number above 0 (kg)", "must be a number of 0 or more"
MISTAKES = {
    f"tool.mass: missing; {ABOVE_0}": {},
    f"tool.mass: got 0.0; {ABOVE_0}": {"mass": 0.0},
    f"tool.offset: got -0.1; {FROM_0} (m)": {"mass": 1.0, "offset": -0.1},
    f"tool.inertia: got -1.0; {FROM_0} (kg m2)": {"mass": 1.0, "inertia": -1.0},
    f"tool.inertia: got [1.0, 1.0, 1.0]; {FROM_0} (kg m2). Set arm.dimension = 3 to use it.": {
        "mass": 1.0, "inertia": [1.0, 1.0, 1.0]
    },
    "tool.until: got 3.0; must be after from = 4.0 (s)": {
        "mass": 1.0, "from": 4.0, "until": 3.0
    },
    "tool.from_: unknown key; did you mean tool.from?": {"mass": 1.0, "from_": 4.0},
}  # fmt: skip


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_gets_one_line(line):
    with pytest.raises(crinoid.ScenarioError, match=f"^{re.escape(line)}$"):
        scenario(MISTAKES[line])


def test_a_scenario_with_a_tool_is_written_and_read_back():
    written = scenario({"mass": 0.2, "from": 1.0, "until": 2.0, "inertia": 1e-3})
    assert crinoid.Scenario.from_toml(written.to_toml()) == written
    assert written.to_dict()["tool"]["from"] == 1.0
    assert "tool" not in crinoid.Scenario().to_dict()
    changed = written.with_values({"tool.from": 0.5})
    assert changed.tool.from_ == 0.5
