"""From a scenario to what its controller knows of the water ahead."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre

from crinoid.assembly.fluctuation import Fluctuation, fluctuations
from crinoid.assembly.numbers import array
from crinoid.control import Along, CarriedWater, KnownWater, WaterVelocity

if TYPE_CHECKING:
    from crinoid.assembly.plan import Plan

Points = Float[np.ndarray, "station d"]
Times = Float[np.ndarray, " look"]

SHAPES = 3
"""Shapes along the arm of water that is foreseen."""
_LEAST_ACROSS = 0.3
"""Share of the current that counts as across the arm at least."""
_SPACING = 0.05
"""Time between the readings from which those to come are foreseen (s)."""
_LEAST_MEMORY, _MOST_MEMORY = 1.0, 5.0
"""For how long readings are kept (s)."""
_LEAST_NOISE = 0.02
"""Noise of readings over their standard deviation, at least."""


def known_water(plan: Plan, steady: Float[np.ndarray, " d"], lead: Times) -> KnownWater:
    """Return the flows of a scenario, as they will be at the arm ``lead`` (s) ahead."""
    stations, along = _along(plan, steady)
    water, points = plan.system.forces.water, array(stations)

    @jax.jit
    def begin() -> jax.Array:
        return along(jax.vmap(lambda point: water.velocity(point, plan.state.time))(points))

    return KnownWater(water, points, along, begin(), array(lead))


def carried_water(
    plan: Plan, steady: Float[np.ndarray, " d"], lead: Times, name: str
) -> CarriedWater:
    """Return what a sensor's readings tell of the water at the arm, carried by the mean current.

    What is measured at a point comes to a station ``d`` downstream of it after ``d / U`` (Taylor
    1938). What is yet to be measured is the mean given the readings so far, of a random process
    with the covariance that the flows of the scenario have (Wiener 1949).
    """
    stations, along = _along(plan, steady)
    sensor = next(each for each in plan.sensors if each.name == name)
    assert isinstance(sensor.measurand, WaterVelocity)
    points = np.asarray(sensor.measurand.points) + np.asarray(plan.system.forces.origin)
    mean = np.asarray(plan.current, float)
    speed = float(np.linalg.norm(mean))
    away = stations[:, None] - points
    downstream = away @ mean / speed if speed else np.zeros(away.shape[:2])
    beside = np.sum(away**2, axis=2) - downstream**2
    nearest = np.argmin(beside + 1e-6 * np.abs(downstream), axis=1)
    reach = downstream[np.arange(len(stations)), nearest]
    lag = np.clip(reach / speed if speed else 0.0 * reach, 0.0, _MOST_MEMORY)
    stride = max(1, round(_SPACING / plan.period))
    memory = max(_LEAST_MEMORY, float(lag.max()))
    count = int(np.ceil(memory / (stride * plan.period))) + 1
    # of the newest reading and those before it, in periods from now
    taken = -(np.arange(count) * stride + round(float(sensor.delay) / plan.period))
    wanted = np.round((lead[:, None] - lag) / plan.period).astype(int)
    expected = fluctuations(plan.scenario, plan.recordings)
    noise = np.asarray(sensor.noise).reshape(points.shape)[0]
    weights = np.zeros((*wanted.shape, count, mean.size))
    for axis in range(mean.size):
        longest = int(max(np.ptp(taken), np.abs(wanted[..., None] - taken).max()))
        likeness = sum(
            each.deviation[axis] ** 2 * _correlation(each, plan.period, longest)
            for each in expected
        )
        least = noise[axis] ** 2 + _LEAST_NOISE**2 * likeness[0]
        between = likeness[np.abs(taken[:, None] - taken)] + least * np.eye(count)
        weights[..., axis] = likeness[np.abs(wanted[..., None] - taken)] @ np.linalg.inv(between)
    numbers = (along, array(weights), array(mean))
    return CarriedWater(*numbers, name, tuple(map(int, nearest)), stride)


def _correlation(each: Fluctuation, period: float, longest: int) -> Float[np.ndarray, " lag"]:
    move, _, velocity = each.process(period)
    state, found = velocity.T, []
    for _ in range(longest + 1):
        found.append(float((velocity @ state)[0, 0]))
        state = move @ state
    return np.array(found)


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
