"""An arm that touches the hull of its vehicle, which floats or follows the base."""

from dataclasses import replace
from functools import cache, partial
from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.dynamics import ActingForces, Context, Hull
from crinoid.dynamics.balance import Balance
from crinoid.dynamics.start import clamped
from crinoid.dynamics.statics import static_stage
from helpers.arms import QUICKLY, acting
from helpers.newton_steps import factored

LENGTH, DIAMETER, RADIUS, NODES = 0.4, 0.1, 0.01, 13
FLOATING = {"mass": 3.0, "inertia": 0.05}
OFFSET = {2: [-0.15, 0.03], 3: [-0.15, 0.02, 0.03]}
dimensions = pytest.mark.parametrize("dimension", [2, 3])
bases = pytest.mark.parametrize("floats", [False, True], ids=["prescribed", "floating"])


def document(dimension, *, floats=False, friction=0.0, **tables):
    """Return the tables of an arm that is bent back over its hull."""
    vehicle = {"hull": {"length": LENGTH, "diameter": DIAMETER}}
    if floats:
        vehicle |= FLOATING | {"offset": OFFSET[dimension]}
    arm = {
        "dimension": dimension,
        "length": 0.5,
        "nodes": NODES,
        "radius": RADIUS,
        "density": 1000.0,
        "youngs_modulus": 1e6,
        "rest_curvature": 8.0,
    }
    down = [0.0] * (dimension - 1)
    load = [{"kind": "tip", "force": [*down, -0.12]}]
    contact = {"self": True, "friction": friction}
    given = {"arm": arm, "vehicle": vehicle, "load": load, "contact": contact}
    return given | {"water": {"density": arm["density"]}} | tables


@cache
def system(dimension, floats, friction=0.3):
    return crinoid.system(
        crinoid.Scenario.from_dict(document(dimension, floats=floats, friction=friction))
    )


def hull_of(system):
    """Return the hull of a system."""
    return next(each for each in system.forces.far_contacts if isinstance(each, Hull))


def bent(dimension, floats, gap=2e-4, random=None):
    """Return a system, a state and rows of an arm that lies on the hull, perhaps moved at random.

    Its outer half is straight and parallel to the hull, at a distance of its surface.
    """
    made = system(dimension, floats)
    state = made.rest()
    angle = np.linspace(0.0, np.pi, 1001)
    reach = (DIAMETER / 2 + RADIUS + gap) / 2
    curve = np.stack([reach * np.sin(angle), reach * (1 - np.cos(angle))], axis=1)
    curve[:, 0] += 0.05
    curve = np.concatenate([[[0.0, 0.0]], curve, [[-0.3, 2 * reach]]])
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1)))
    places = np.linspace(0.0, 0.45, NODES)
    rows, nodes = np.array(state.motion.position), slice(1, NODES + 1)
    rows[nodes, 0], rows[nodes, dimension - 1] = (np.interp(places, along, x) for x in curve.T)
    if random is not None:
        rows[3 : NODES + 1, :dimension] += 2e-4 * random.normal(size=(NODES - 2, dimension))
    return made, state, jnp.asarray(rows)


def moving(made, state, rows, random, rates=(20.0, 1e4)):
    """Return forces and the stage of rows with velocities at random."""
    context = clamped(Context(), made.forces, made.base, state.time, state.servo)
    forces = ActingForces.of(made.forces, context)
    stage = static_stage(jnp.zeros(()), rows, state.frames)
    return forces, replace(
        stage,
        velocity=jnp.asarray(0.1 * random.normal(size=rows.shape)),
        by_velocity=jnp.asarray(rates[0]),
        by_acceleration=jnp.asarray(rates[1]),
        fixed_fields=(),
    )


@pytest.mark.release
@pytest.mark.parametrize(("dimension", "floats"), [(2, False), (3, True)])
def test_tangent_is_the_slope_of_the_residual(dimension, floats):
    random = np.random.default_rng(3)
    forces, stage = moving(*(found := bent(dimension, floats, random=random)), random)
    rows = found[2]
    zero = jnp.zeros_like(rows)
    way = random.normal(size=rows.shape)
    way[:2] = 0.0
    if floats and dimension == 2:
        way[-1, 1] = 0.0  # of the rotation one entry counts
    if floats and dimension == 3:
        way[-2:, 3] = 0.0

    made = found[0]

    @eqx.filter_jit(compiler_options=QUICKLY)
    def solved(forces, stage, way):
        balance = Balance(forces, forces.surroundings(stage, zero), stage)
        tangent = balance.tangent(balance.motion(zero))
        exact = jax.jvp(lambda c: balance.residual(balance.motion(c))[0], (zero,), (way,))[1]
        pushed = hull_of(made).push(forces.motion(stage, zero, balance.around), forces.heading)
        found = tangent.solve(exact), factored(tangent, exact)
        return *found, tangent.on_held(way), exact, pushed

    found, by_factors, held, exact, pushed = map(
        np.asarray, solved(forces, stage, jnp.asarray(way))
    )
    assert np.abs(pushed[2:]).max() > 1.0  # it touches the hull
    assert found == pytest.approx(way, abs=1e-7)
    assert by_factors == pytest.approx(found, abs=1e-9)
    assert held == pytest.approx(exact[:2], abs=1e-9 * np.abs(exact[:2]).max())


@pytest.mark.release
@dimensions
def test_momenta_are_kept_between_arm_and_floating_hull(dimension):
    random = np.random.default_rng(4)
    made, state, rows = bent(dimension, True, random=random)
    forces, stage = moving(made, state, rows, random)
    zero = jnp.zeros_like(rows)

    @eqx.filter_jit(compiler_options=QUICKLY)
    def balance(forces, stage):
        around = forces.surroundings(stage, zero)
        without = replace(forces, far_contacts=())
        motion = forces.motion(stage, zero, around)
        attitude = forces.attitude(motion.position)
        gain = without.residual(motion)[0] - forces.residual(motion)[0]
        return gain, motion.position, attitude

    pushed, place, attitude = map(np.asarray, balance(forces, stage))
    # the rows of ghost node and root are forces that the vehicle takes up
    free, vehicle = pushed[2:-2, :dimension], pushed[-2, :dimension]
    place, middle = place[2:-2, :dimension], place[-2, :dimension]
    assert np.abs(free).max() > 1.0
    assert free.sum(axis=0) + vehicle == pytest.approx(0.0, abs=1e-9)

    def moment(lever, force):
        lever, force = (np.broadcast_to(x, (len(force), dimension)) for x in (lever, force))
        if dimension == 2:
            return (lever[:, :1] * force[:, 1:] - lever[:, 1:] * force[:, :1]).sum(axis=0)
        return np.cross(lever, force).sum(axis=0)

    turning = attitude @ pushed[-1, :3] if dimension == 3 else pushed[-1, :1]
    total = moment(place, free) + moment(middle, vehicle[None]) + turning
    if dimension == 3:
        edges = np.diff(np.vstack([rows[1:2, :3], place]), axis=0)
        edges /= np.linalg.norm(edges, axis=1)[:, None]
        assert np.abs(pushed[2:-2, 3]).max() > 1e-4  # it rubs
        total += (pushed[2:-2, 3:] * edges).sum(axis=0)
    assert total == pytest.approx(0.0, abs=1e-9)


def nearest(near, far, nose, way):
    """Return the distance of an edge from the core of the hull, by samples (m)."""
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    points = near + share * (far - near)
    back = np.clip((nose - points) @ way, DIAMETER / 2, LENGTH - DIAMETER / 2)
    return np.linalg.norm(points - (nose - back[:, None] * way), axis=1).min()


@pytest.mark.slow
@dimensions
@bases
def test_gap_is_the_distance_of_an_edge_from_a_capsule_behind_the_root(dimension, floats):
    random = np.random.default_rng(5)
    made, _, rows = bent(dimension, floats)
    place = np.array(rows)
    place[3 : NODES + 1, :dimension] += 0.05 * random.normal(size=(NODES - 2, dimension))
    nodes, way = place[1 : NODES + 1, :dimension], np.eye(dimension)[0]
    gaps = eqx.filter_jit(lambda forces, rows: forces.far_gaps(rows))(acting(made), place)[-1]
    exact = [
        nearest(near, far, nodes[0], way) - DIAMETER / 2 - RADIUS
        for near, far in pairwise(nodes[1:])
    ]
    edge = np.linalg.norm(np.diff(nodes[1:], axis=0), axis=1)
    # the distance is eased by at most EASE |e|^2 / 4 under the root
    eased = np.sqrt((np.array(exact) + DIAMETER / 2 + RADIUS) ** 2 + 0.01 * edge**2 / 4)
    most = eased - DIAMETER / 2 - RADIUS
    assert np.all(gaps > np.array(exact) - 1e-6)
    assert np.all(gaps < most + 1e-6)


@eqx.filter_jit(compiler_options=QUICKLY)
def pushed(forces, stage):
    motion = forces.motion(stage, 0 * stage.position, forces.surroundings(stage, stage.position))
    return forces.far_contacts[-1].push(motion, forces.heading)


@pytest.mark.release
@bases
def test_forces_in_space_are_those_in_the_plane(floats):
    found = {}
    for dimension in (2, 3):
        made, state, rows = bent(dimension, floats)
        forces, stage = moving(made, state, rows, np.random.default_rng(0))
        velocity = np.zeros(rows.shape)
        drawn = np.random.default_rng(6).normal(size=(len(rows), 2))
        velocity[:, [0, dimension - 1]] = 0.1 * drawn
        if floats:  # its turn from x to z is one about -y
            velocity[-1] = 0.0
            velocity[-1, dimension - 2] = 0.3 if dimension == 2 else -0.3
        stage = replace(stage, velocity=jnp.asarray(velocity))
        found[dimension] = np.asarray(pushed(forces, stage))[: NODES + 1, [0, dimension - 1]]
    assert np.abs(found[2][2:]).max() > 1.0
    assert found[3] == pytest.approx(found[2], abs=1e-9 * np.abs(found[2]).max())


@pytest.mark.slow
def test_an_arm_at_rest_on_its_hull_hands_its_loads_to_the_base():
    state = system(2, False, friction=0.0).equilibrium()
    gap, place = np.asarray(state.far_gaps[-1]), np.asarray(state.position[-1])
    assert gap.min() < 0.05 * RADIUS  # it presses
    assert np.asarray(state.base_force) == pytest.approx([0.0, -0.12], abs=1e-8)
    assert float(state.base_moment) == pytest.approx(-0.12 * place[0], abs=1e-8)


@pytest.mark.release
def test_gradient_by_the_diameter_is_that_of_differences():
    made = system(2, False)

    state = made.equilibrium()

    @jax.jit
    @partial(jax.value_and_grad, has_aux=True)
    def tip(radius):
        changed = eqx.tree_at(
            lambda s: s.forces.far_contacts[-1].contact.radius,
            made,
            radius + 0.0 * made.forces.far_contacts[-1].contact.radius,
        )

        def tick(state, _):
            state, outcome = changed.step(state, jnp.zeros(3))
            return state, outcome.converged

        end, good = jax.lax.scan(tick, state, length=2)
        return jnp.sum(made.tip(end)[:2]), good.all()

    def difference(h):
        high, low = (tip(DIAMETER / 2 + x)[0] for x in (h, -h))
        assert high[1]
        return float(high[0] - low[0]) / (2 * h)

    slope = float(tip(DIAMETER / 2)[1])
    assert abs(slope) > 1e-3
    assert slope == pytest.approx((4 * difference(1e-6) - difference(2e-6)) / 3, rel=1e-4)


@pytest.mark.release
def test_an_arm_that_curls_onto_its_hull_pushes_it_and_keeps_their_momentum():
    # in a vacuum, by a chamber
    chamber = {
        "name": "curl",
        "offset": 0.006,
        "area": 6e-5,
        "angle_deg": 180.0,
        "max_pressure": 2e5,
        "time_constant": 0.05,
        "schedule": {"time": [0.0, 0.3], "share": [0.0, 1.0]},
    }
    given = document(3, floats=True, friction=0.2, chamber=[chamber])
    given["arm"] |= {"rest_curvature": 9.0, "damping_time": 0.02, "length": 0.55}
    simulation = {"duration": 0.6, "time_step": 0.005, "tolerance": 1e-11, "start": "rest"}
    given |= {"load": [], "water": {"density": 0.0, "gravity": 0.0}, "simulation": simulation}
    data = crinoid.simulate(crinoid.Scenario.from_dict(given)).dataset
    gap, force = data["hull_gap"].values, data["hull_force"].values
    assert np.linalg.norm(force, axis=2).max() > 0.05
    assert gap.min() > -0.05 * RADIUS
    mass = 1000.0 * np.pi * RADIUS**2 * 0.55 * np.ones(NODES) / (NODES - 1)
    mass[[0, -1]] /= 2
    pose = data["vehicle_pose"].values[:, :3]
    place = np.einsum("n,tna->ta", mass, data["position"].values)
    # the centre of mass of arm and vehicle rests; the root, which turns, moves at order 2
    away, moved = place - place[0] + FLOATING["mass"] * pose, np.abs(FLOATING["mass"] * pose).max()
    assert moved > 1e-3
    assert np.abs(away).max() < 1e-3 * moved


HULL = {"length": LENGTH, "diameter": DIAMETER}


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"contact": {}}, "vehicle.hull: got a table; must be left out with contact.self = false"),
        (
            {"vehicle": {"hull": HULL, "hold": "thrusters"}},
            'vehicle.hold: got "thrusters"; must be left out without mass',
        ),
        ({"vehicle": {"hull": HULL, "inertia": 1.0}}, "vehicle.mass: missing; must be"),
        ({"vehicle": {"hull": HULL, "mass": 1.0}}, "vehicle.inertia: missing; must be"),
        (
            {"vehicle": {"hull": {"length": 0.1, "diameter": 0.2}}},
            "vehicle.hull.length: got 0.1; must be at least diameter = 0.2 ",
        ),
        ({"arm": {"length": 0.03, "nodes": 4}}, "vehicle.hull: got a table; must be left out for"),
        ({"arm": {"rest_curvature": 11.0}}, "vehicle.hull: overlaps the arm without load by"),
    ],
)
def test_a_hull_that_cannot_be_is_refused_in_one_line(tables, message):
    given = document(2) | {"load": []}
    given["arm"] |= tables.pop("arm", {})
    with pytest.raises(crinoid.ScenarioError) as error:
        crinoid.simulate(crinoid.Scenario.from_dict(given | tables))
    assert str(error.value).startswith(message)
    assert len(error.value.lines) == 1


def test_edges_near_the_root_and_where_channels_draw_it_back_do_not_count():
    given = document(2, floats=True)
    given["base"] = {"channels": {"slide": {"range": [-0.1, 0.2]}}}
    floating = crinoid.system(crinoid.Scenario.from_dict(given))
    # pi radius + 0.1 m are 3.2 edges
    assert hull_of(floating).first_edge == 4
    assert hull_of(system(2, True)).first_edge == 1


@pytest.mark.slow
def test_a_hull_alone_follows_the_base():
    scenario = crinoid.Scenario.from_dict(document(2))
    assert not scenario.floats
    assert scenario.hull == scenario.vehicle.hull
    assert crinoid.Scenario.from_toml(scenario.to_toml()) == scenario
