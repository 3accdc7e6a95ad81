"""An arm that touches itself: two halves, a coil, its tangent, its energy and its gradient."""

from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import eigh

import crinoid
from crinoid.dynamics import ActingForces, Context, FarEdges, far_edges, find_modes
from crinoid.dynamics.balance import Balance
from crinoid.dynamics.start import clamped
from crinoid.dynamics.statics import static_stage
from crinoid.dynamics.tangent import LineStiffness
from crinoid.rod import Rod
from helpers.arms import dense
from helpers.newton_steps import factored
from helpers.touching import moving

RADIUS = 0.01
NODES = 21


def halves(gap, edges=10, length=0.1):
    """Return the nodes of a hairpin (m): two straight halves, with a gap between their surfaces."""
    along, apart = length * np.arange(edges + 1), 2 * RADIUS + gap
    there = np.stack([along, 0 * along], axis=1)
    back = there[::-1] + np.array([0.0, apart])
    turn = [there[-1] + [length, -length], back[0] + [length, length]]
    return np.concatenate([[[-length, 0.0]], there, turn, back])


@eqx.filter_jit
def push(far, motion):
    """Return the forces on all rows."""
    return far.push(motion, None)


@pytest.mark.parametrize("load", [0.01, 0.3, 0.9])
def test_two_halves_are_as_close_as_the_law_of_the_skin_says(load):
    nodes = halves(0.0)
    edges = np.diff(nodes[1:], axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    rod = Rod.round(
        length=lengths.sum(),
        nodes=len(nodes) - 1,
        radius=RADIUS,
        density=1000.0,
        youngs_modulus=1e6,
        axes=2,
    )
    far = FarEdges.of(rod, far_edges(lengths, np.full(len(lengths), RADIUS)), jnp.zeros(()))
    strength = 32.0 * 1e6 * RADIUS**2
    # each edge rests on the one opposite to it: load = strength (1 - gap / skin)^4
    gap = 0.05 * RADIUS * (1.0 - load**0.25)
    place = halves(gap)
    pushed = np.asarray(push(far, moving(place, 0.0 * place)))
    assert pushed[14:, 1].sum() == pytest.approx(10 * load * strength, rel=1e-9)
    assert pushed[:12, 1].sum() == pytest.approx(-10 * load * strength, rel=1e-9)


def test_edges_are_far_where_the_arm_can_turn_back():
    radii = np.full(30, RADIUS)
    assert far_edges(np.full(30, 0.01), radii)[5] == 5 + 1 + 4  # pi r is 3.1 edges
    assert far_edges(np.full(30, 0.1), radii)[5] == 5 + 2  # never an edge and its neighbour
    assert far_edges(np.full(30, 0.001), radii) == (30,) * 30


def coil(dimension=2, friction=0.3, moment=0.0, **simulation):
    """Return the scenario of an arm that a chamber coils up until it touches itself.

    The load of its tip is zero, or a moment, so that `wound` is the same program.
    """
    about_y = moment if dimension == 2 else [0.0, -moment, 0.0]
    return crinoid.Scenario.from_dict(
        {
            "arm": {
                "dimension": dimension,
                "length": 0.5,
                "nodes": NODES,
                "radius": [0.02, 0.012],
                "density": 1080.0,
                "youngs_modulus": 1e5,
                "damping_time": 0.05,
            },
            "contact": {"self": True, "friction": friction},
            "load": [{"kind": "tip", "moment": about_y, "ramp_time": 0.4}],
            "chamber": [
                {
                    "name": "curl",
                    "offset": [0.01, 0.006],
                    "area": 1.2e-4,
                    "angle_deg": 180.0,
                    "max_pressure": 2e5,
                    "time_constant": 0.1,
                    "schedule": {"time": [0.0, 0.5], "share": [0.0, 1.0]},
                }
            ],
            "simulation": {"duration": 1.2, "time_step": 0.01, "start": "rest"} | simulation,
        }
    )


@pytest.fixture(scope="module")
def coiled():
    """Return the run of a coil."""
    return crinoid.simulate(coil())


@pytest.mark.slow
def test_a_coil_presses_on_itself_without_going_through(coiled):
    data = coiled.dataset
    assert data["self_gap"].values.min() > -0.01 * 0.012
    assert data["self_pairs"].values.max() > 5
    force = data["self_force"].values
    assert np.abs(force).max() > 0.5
    # forces of the arm on itself
    assert np.abs(force.sum(axis=1)).max() < 1e-12


def wound(dimension):
    """Return the run of an arm that a moment at its tip winds up until it touches itself."""
    given = coil(dimension, moment=0.12, duration=0.7, tolerance=1e-10).to_dict()
    given["chamber"][0]["schedule"]["share"] = [0.0, 0.0]
    return crinoid.simulate(crinoid.Scenario.from_dict(given)).dataset


@pytest.mark.release
def test_a_run_in_space_is_that_in_the_plane():
    plane, space = wound(2), wound(3)
    forces = np.abs(plane["self_force"].values)
    assert forces.max() > 0.01
    assert np.abs(space["position"].sel(axis="y")).max() < 1e-9
    same = space["position"].sel(axis=["x", "z"]).values
    assert same == pytest.approx(plane["position"].values, abs=1e-6)


def balance_error(data):
    """Return the largest error of the balance over the largest stored energy."""
    energy = data["energy"]
    kept = ["kinetic", "elastic", "potential"]
    stored = energy.sel(kind=kept).sum("kind").values
    done = energy.sel(kind=[k for k in energy["kind"].values if k not in kept]).sum("kind").values
    return np.abs(stored - stored[0] - done).max() / np.abs(stored).max()


@pytest.mark.release
def test_the_energy_of_a_coil_is_accounted_for_at_order_two(coiled):
    assert coiled.dataset["energy"].sel(kind="contact").values[-1] < -1e-3
    fine = crinoid.simulate(coil(time_step=0.005)).dataset
    assert balance_error(fine) < 1e-3
    assert balance_error(coiled.dataset) > 3.0 * balance_error(fine)


VEHICLE = {
    "mass": 20.0,
    "inertia": 0.9,
    "offset": [-0.3, 0.0],
    "metacentric_height": 0.04,
    "hold": "thrusters",
    "bandwidth_hz": 0.4,
}


def spiral(dimension, **tables):
    """Return a system and rows of an arm in a spiral, each turn in the skin of the one before."""
    document = coil(dimension).to_dict() | tables
    document["arm"]["radius"] = RADIUS
    system = crinoid.system(crinoid.Scenario.from_dict(document))
    state = system.rest()
    angle = np.linspace(0.0, 4 * np.pi, 2001)
    reach = 0.061 - (2 * RADIUS + 0.3e-3) * angle / (2 * np.pi)
    curve = np.stack([reach * np.sin(angle), 0.061 - reach * np.cos(angle)], axis=1)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1)))
    places = np.linspace(0.0, along[-1], NODES)
    rows, nodes = np.array(state.motion.position), slice(1, NODES + 1)
    rows[nodes, 0], rows[nodes, dimension - 1] = (np.interp(places, along, x) for x in curve.T)
    if dimension == 3:
        rows[nodes, 1] = 3e-4 * np.interp(places, along, angle)
    return system, state, jnp.asarray(rows)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dimension", "tables"),
    [
        pytest.param(2, {}, id="plane"),
        pytest.param(3, {}, id="space", marks=pytest.mark.release),
        pytest.param(2, {"vehicle": VEHICLE}, id="floating", marks=pytest.mark.release),
    ],
)
def test_tangent_is_the_slope_of_the_residual(dimension, tables):
    system, state, rows = spiral(dimension, **tables)
    random = np.random.default_rng(0)
    context = Context(jnp.zeros(1))
    context = clamped(context, system.forces, system.base, state.time, state.servo)
    forces = ActingForces.of(system.forces, context)
    stage = static_stage(jnp.zeros(()), rows, state.frames)
    stage = replace(
        stage,
        velocity=jnp.asarray(0.1 * random.normal(size=rows.shape)),
        by_velocity=jnp.asarray(20.0),
        by_acceleration=jnp.asarray(1e4),
        fixed_fields=(),
    )
    zero = jnp.zeros_like(rows)
    balance = Balance(forces, forces.surroundings(stage, zero), stage)
    way = random.normal(size=rows.shape)
    way[:2] = 0.0
    if tables:
        way[-1, 1] = 0.0  # of the rotation one entry counts

    @eqx.filter_jit
    def both(balance, way):
        def pushed(correction):
            moved = forces.motion(stage, correction, balance.around)
            return forces.nodes(forces.far_contacts[0].push(moved, forces.heading))

        tangent = balance.tangent(balance.motion(zero))
        exact = jax.jvp(lambda c: balance.residual(balance.motion(c))[0], (zero,), (way,))[1]
        alone = jax.jvp(pushed, (zero,), (way,))
        along = jnp.einsum("nbmc,mc->nb", tangent.far, forces.nodes(way))
        return tangent.solve(exact), factored(tangent, exact), alone, along

    solved, by_factors, (alone, slope), along = both(balance, jnp.asarray(way))
    assert np.abs(alone).max() > 0.1  # it touches itself
    if not tables:  # a vehicle moves the root, too
        size = np.abs(slope).max()
        assert np.asarray(along) == pytest.approx(-np.asarray(slope), abs=1e-9 * size)
    assert np.asarray(solved) == pytest.approx(way, abs=1e-7)
    assert np.asarray(by_factors) == pytest.approx(np.asarray(solved), abs=1e-9)


def test_modes_are_those_of_bands_and_far_edges_together():
    system, state, _ = spiral(2)
    bands = eqx.filter_jit(lambda s, x: s.linearise(x))(system, state)
    K, M = (dense(each).reshape(2 * NODES + 2, -1) for each in bands)
    pressed = np.random.default_rng(1).normal(size=(len(K), 3))
    far = 10.0 * pressed @ pressed.T
    every = np.eye(len(K)).reshape(-1, NODES + 1, 2)
    lines = LineStiffness(far.reshape(NODES + 1, 2, -1), every)
    free = slice(4, None)  # without ghost and root
    rates = eigh((K + far)[free, free], M[free, free], eigvals_only=True)[:3]
    found = find_modes(*bands, 3, lines).frequency
    assert found == pytest.approx(np.sqrt(rates) / (2 * np.pi), rel=1e-6)


@pytest.mark.release
def test_gradient_of_a_coil_is_that_of_differences():
    system = crinoid.system(coil(tolerance=1e-11))
    command = jnp.ones(len(system.inputs))

    @eqx.filter_jit
    def march(system):
        return jax.lax.fori_loop(
            0, 80, lambda _, state: system.advance(state, command)[0], system.rest()
        )

    state = march(system)

    @jax.jit
    @partial(jax.value_and_grad, has_aux=True)
    def tip(friction):
        rough = friction + 0.0 * system.forces.far_contacts[0].contact.friction
        changed = eqx.tree_at(lambda s: s.forces.far_contacts[0].contact.friction, system, rough)

        def tick(state, _):
            state, outcome = changed.step(state, command)
            return state, outcome.converged

        end, good = jax.lax.scan(tick, state, length=2)
        return system.tip(end)[0], good.all()

    def difference(h):
        (high, good), (low, _) = (tip(jnp.asarray(0.3 + x))[0] for x in (h, -h))
        assert good
        return float(high - low) / (2 * h)

    slope = float(tip(jnp.asarray(0.3))[1])
    extrapolated = (4 * difference(5e-4) - difference(1e-3)) / 3
    assert slope == pytest.approx(extrapolated, rel=1e-4)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"contact": {"friction": 0.3}}, "contact.friction: got 0.3; must be 0 unless self = true"),
        ({"contact": {"self": True}, "arm": {"length": 0.05}}, "contact.self: got true"),
        ({"contact": {"self": True}, "arm": {"rest_curvature": 20.0}}, "overlaps itself by"),
    ],
)
def test_contact_that_cannot_be_is_refused(tables, message):
    with pytest.raises(crinoid.ScenarioError, match=message):
        crinoid.simulate(crinoid.Scenario.from_dict(tables))
