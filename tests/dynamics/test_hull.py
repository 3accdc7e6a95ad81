"""An arm that touches the hull of its vehicle, which floats or follows the base."""

from dataclasses import replace
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.dynamics import Hull
from crinoid.dynamics.newton import Balance
from crinoid.dynamics.start import with_mount
from crinoid.dynamics.statics import static_stage
from helpers.arms import QUICKLY

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
    base = {"tilt_deg": 0.0}
    return {"arm": arm, "vehicle": vehicle, "load": load, "contact": contact, "base": base} | tables


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
    state = eqx.filter_jit(lambda s: s.rest())(made)
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
    forces = made.forces.driven(None)
    forces = with_mount(forces, made.base, state.time, state.servo)
    stage = static_stage(jnp.zeros(()), rows, state.frames)
    return forces, replace(
        stage,
        velocity=jnp.asarray(0.1 * random.normal(size=rows.shape)),
        by_velocity=jnp.asarray(rates[0]),
        by_acceleration=jnp.asarray(rates[1]),
        fixed_fields=(),
    )


@dimensions
@bases
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
        tangent = balance.tangent(zero)
        exact = jax.jvp(lambda c: balance.residual(c)[0], (zero,), (way,))[1]
        pushed = hull_of(made).push(forces.motion(stage, zero, balance.around))
        found = tangent.solve(exact), tangent.factorise().solve(exact)
        return *found, tangent.on_held(way), exact, pushed

    found, factored, held, exact, pushed = map(np.asarray, solved(forces, stage, jnp.asarray(way)))
    assert np.abs(pushed[2:]).max() > 1.0  # it touches the hull
    assert found == pytest.approx(way, abs=1e-7)
    assert factored == pytest.approx(found, abs=1e-9)
    assert held == pytest.approx(exact[:2], abs=1e-9 * np.abs(exact[:2]).max())


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
