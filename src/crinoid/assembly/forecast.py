"""From a scenario to what its controller knows of the water ahead."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre

from crinoid.assembly.fluctuation import Fluctuation, fluctuations
from crinoid.assembly.numbers import array
from crinoid.control import Along, CarriedWater, KnownWater, WaterVelocity
from crinoid.flow import Water

if TYPE_CHECKING:
    from crinoid.assembly.plan import Plan

Points = Float[np.ndarray, "station d"]
Times = Float[np.ndarray, " look"]

SHAPES = 3
"""Shapes along the arm of water that is foreseen."""
_LEAST_ACROSS = 0.3
"""Share of the current that counts as across the arm at least."""
_SPACING = 0.04
"""Time between the readings from which those to come are foreseen, over the arm's first period."""
_MEMORY = np.array([0.75, 4.0])
"""Over the arm's first period, for how long readings are kept at least and at most."""
_LEAST_NOISE = 0.02
"""Noise of readings over their standard deviation, at least."""


def known_water(plan: Plan, steady: Float[np.ndarray, " d"], lead: Times) -> KnownWater:
    """Return the flows of a scenario, as they will be at the arm ``lead`` (s) ahead."""
    stations, along = _along(plan, steady)
    water, points = plan.system.forces.water, array(stations)

    @jax.jit
    def begin() -> jax.Array:
        velocity = jax.vmap(lambda point: water.velocity(point, plan.state.time))(points)
        still = Water(water.flows, frozen_at=plan.state.time)
        lasting = jax.vmap(lambda point: still.current(point, plan.state.time))(points)
        return along(velocity, lasting.acceleration)

    # a pattern that drifts hardly accelerates its water but in small eddies, all over the arm
    hastening = Water(tuple(flow for flow in water.flows if not flow.drifts))
    return KnownWater(water, hastening, points, along, begin(), array(lead))


def carried_water(
    plan: Plan, steady: Float[np.ndarray, " d"], lead: Times, name: str
) -> CarriedWater:
    """Return what a sensor's readings tell of the water at the arm, carried by the mean current.

    The mean at each station now and later, given the readings so far, of a random process with
    the covariance in space and time that the flows of the scenario have (Wiener 1949): what a
    meter does not tell is taken for the mean current.
    """
    stations, along = _along(plan, steady)
    sensor = next(each for each in plan.sensors if each.name == name)
    assert isinstance(sensor.measurand, WaterVelocity)
    points = np.asarray(sensor.measurand.points) + np.asarray(plan.system.forces.origin)
    mean = np.asarray(plan.current, float)
    speed = float(np.linalg.norm(mean))
    reach = (stations[:, None] - points) @ mean / speed if speed else np.zeros(1)
    memory = float(np.clip(reach.max() / max(speed, 1e-9), *(_MEMORY * plan.first_period)))
    stride = max(1, round(_SPACING * plan.first_period / plan.period))
    count = int(np.ceil(memory / (stride * plan.period))) + 1
    taken = -np.arange(count) * stride * plan.period - float(sensor.delay)
    expected = fluctuations(plan.scenario, plan.recordings, plan.first_period)

    def covariance(
        counted: Sequence[Fluctuation],
        here: Float[np.ndarray, "point d"],
        now: Float[np.ndarray, " time"],
        there: Float[np.ndarray, "meter d"],
        then: Float[np.ndarray, " sample"],
    ) -> Float[np.ndarray, "time point d sample meter d"]:
        apart = here[:, None, None] - there
        lag = now[:, None, None, None] - then[:, None]
        shape = np.broadcast_shapes(lag.shape, apart.shape[:-1])
        apart = np.broadcast_to(apart, (*shape, mean.size))
        lag = np.broadcast_to(lag, shape)
        found = np.sum([each.covariance(apart, lag) for each in counted], axis=0)
        return np.moveaxis(found, -2, 2)

    between = covariance(expected, points, taken, points, taken)
    size = count * points.size
    square = between.reshape(size, size)
    noise = np.tile(np.asarray(sensor.noise) ** 2, count) + _LEAST_NOISE**2 * np.diag(square)
    told = covariance(expected, stations, lead, points, taken)
    hastening = [each for each in expected if each.accelerates]
    soon, before = (
        covariance(hastening, stations, lead + shift * plan.period, points, taken)
        for shift in (0.5, -0.5)
    )
    told = np.stack([told, (soon - before) / plan.period], axis=1).reshape(-1, size)
    weights = np.linalg.solve(square + np.diag(noise), told.T).T
    shape = (lead.size, 2, *stations.shape, count, *points.shape)
    return CarriedWater(along, array(weights.reshape(shape)), array(mean), name, stride)


def _along(plan: Plan, steady: Float[np.ndarray, " d"]) -> tuple[Points, Along]:
    """Return stations along the arm at its start, in the world, and how the model sees these."""
    nodes = np.asarray(plan.state.position)[1:]
    points, weights = legendre.leggauss(SHAPES + 2)
    place = 0.5 * (points + 1) * (len(nodes) - 1)

    def at_stations(rows: Float[np.ndarray, "n d"]) -> Points:
        return np.stack([np.interp(place, np.arange(len(nodes)), each) for each in rows.T], axis=1)

    tangents = at_stations(np.gradient(nodes, axis=0))
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = steady - (tangents @ steady)[:, None] * tangents
    # a current along the arm has no drag to speak of, but fluctuates
    normal = np.eye(len(steady))[np.argmin(np.abs(tangents), axis=1)]
    normal -= np.sum(normal * tangents, axis=1, keepdims=True) * tangents
    speed, least = np.linalg.norm(across, axis=1), _LEAST_ACROSS * np.linalg.norm(steady)
    across = np.where(speed[:, None] > least, across, least * normal)
    degree = np.arange(SHAPES)
    shapes = (legendre.legvander(points, SHAPES - 1) * weights[:, None] * (degree + 0.5)).T
    stations = at_stations(nodes) + np.asarray(plan.system.forces.origin)
    return stations, Along(array(shapes), array(tangents), array(across))
