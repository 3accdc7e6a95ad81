"""Statistics of the water in a scenario, and the forecasts that a controller makes of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre

from crinoid.assembly.arrays import array
from crinoid.control import Along, FrozenTurbulenceForecast, KnownWater, WaterVelocity
from crinoid.flow import Flow, Water
from crinoid.numerics.signals_and_systems import integral_time
from crinoid.scenario import (
    GaussMarkovFlow,
    GustFlow,
    MeasuredFlow,
    Scenario,
    SeaState,
    SineFlow,
    SurfaceWaves,
    TurbulenceFlow,
    UniformFlow,
)

if TYPE_CHECKING:
    from crinoid.assembly.plan import AssembledScenario
    from crinoid.recording import Recording

_SLOW = 15.0  # correlation time of unexplained velocity, over the arm's first period
_LEAST = 0.05
"""Its standard deviation over the arm's length in a first period, at least: loads that are not
known look like a current."""
_SHARE = 0.1  # and at least this share of all the rest
_WIDTH = 0.15  # damping ratio of the oscillator that models waves: the width of their spectrum
_NARROW = 0.01  # damping ratio for a swell of one frequency


class Fluctuation(NamedTuple):
    """Velocity of the water that varies at random about its mean."""

    deviation: Float[np.ndarray, " d"]  # standard deviation along each axis (m/s)
    time: float  # correlation time (s), of an oscillation its period
    damping: float | None = None  # damping ratio of what oscillates; None: it does not
    slowness: Float[np.ndarray, " d"] | None = None
    """Delay over distance (s/m) of a record that drifts past; None: it does not."""
    drift: Float[np.ndarray, " d"] | None = None  # mean velocity (m/s) of eddies; None: it has none
    length: float | None = None
    """Longitudinal integral scale of its eddies (m); None: it is the same across the drift."""

    def covariance(
        self, apart: Float[np.ndarray, "... d"], lag: Float[np.ndarray, ...]
    ) -> Float[np.ndarray, "... d d"]:
        """Return that of the velocities at two points ``apart`` (m), the first ``lag`` (s) later.

        Turbulence is isotropic (Batchelor 1953, chapter 3), with von Karman's longitudinal
        correlation (1948).
        """
        if self.length is not None and self.drift is not None:
            away = apart - self.drift * lag[..., None]
            return np.outer(self.deviation, self.deviation) * _isotropic(away, self.length)
        carried = 0.0 if self.slowness is None else apart @ self.slowness
        later = np.abs(lag - carried)
        if self.damping is None:
            kept = np.exp(-later / self.time)
        else:
            rate, share = 2 * math.pi / self.time, math.sqrt(1 - self.damping**2)
            angle = rate * share * later
            swing = np.cos(angle) + self.damping / share * np.sin(angle)
            kept = np.exp(-self.damping * rate * later) * swing
        return kept[..., None, None] * np.diag(self.deviation**2)

    @property
    def accelerates(self) -> bool:
        """Whether particles of the water feel it change: not in a pattern that drifts with them."""
        return self.slowness is None and self.drift is None

    def process(self, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return ``F``, ``Q`` and ``S`` of ``d' = F d + v``, ``w = S d``, with ``w`` of variance 1.

        ``Q`` is the covariance of the noise ``v``, sampled every ``period`` seconds. An oscillation
        is a damped one of the second order that white noise drives.
        """
        if self.damping is None:
            kept = math.exp(-period / self.time)
            return np.array([[kept]]), np.array([[1 - kept**2]]), np.ones((1, 1))
        from scipy.linalg import expm  # slow to load

        rate = 2 * math.pi / self.time
        kept = expm(period * rate * np.array([[0.0, 1.0], [-1.0, -2 * self.damping]]))
        # both of variance 1, uncorrelated
        return kept, np.eye(2) - kept @ kept.T, np.array([[1.0, 0.0]])


def fluctuations(
    scenario: Scenario,
    recordings: Mapping[int, Recording],
    flows: Sequence[Flow],
    first_period: float,
) -> tuple[Fluctuation, ...]:
    """Return the fluctuations of all flows of a scenario, one that is slow last.

    ``flows`` are those built from it.
    ``first_period`` is that of the arm's slowest vibration (s).
    """
    slow = _SLOW * first_period
    axes, found = scenario.arm.dimension, []
    carrier, swing = _carrier(scenario, recordings)
    for index, flow in enumerate(scenario.flow):
        match flow:
            case TurbulenceFlow():
                spread = np.full(axes, flow.intensity * math.hypot(*flow.mean))
                # where nothing else moves them, eddies last as long as they take to turn
                speed = max(math.sqrt(carrier @ carrier + swing), spread[0])
                passing = flow.length_scale / speed
                found.append(Fluctuation(spread, passing, drift=carrier, length=flow.length_scale))
            case GaussMarkovFlow():
                spread = np.broadcast_to(flow.standard_deviation, axes)
                found.append(Fluctuation(spread, flow.correlation_time))
            case GustFlow():
                found.append(Fluctuation(np.abs(flow.velocity) / 2, flow.duration / 2))
            case SineFlow():
                spread = np.abs(flow.amplitude) / math.sqrt(2)
                found.append(Fluctuation(spread, 1 / flow.frequency_hz, _NARROW))
            case SurfaceWaves():
                found.append(_waves(flow.state_of(flows[index]), scenario))
            case MeasuredFlow():
                found.append(_measured(recordings[index], slow))
    total = np.sqrt(sum((each.deviation**2 for each in found), np.zeros(axes)))
    least = _LEAST * scenario.arm.length / first_period
    found.append(Fluctuation(np.maximum(least, _SHARE * total), slow))
    return tuple(found)


def vortex_shedding(
    scenario: Scenario, recordings: Mapping[int, Recording], tangent: Float[np.ndarray, " d"]
) -> Fluctuation | None:
    """Return the velocity of water whose drag is the lift of vortices on an arm along ``tangent``.

    It points across arm and current. Its band is narrow in a steady current, and as wide as the
    current varies. None without vortices, and in the plane.
    """
    water = scenario.water
    if water.vortices is None or scenario.arm.dimension == 2:
        return None
    numbers = water.vortices.numbers
    mean, variance = _carrier(scenario, recordings)
    for flow in scenario.flow:
        if isinstance(flow, TurbulenceFlow):
            variance += (flow.intensity * math.hypot(*flow.mean)) ** 2
    mean = mean - (mean @ tangent) * tangent
    speed = math.sqrt(mean @ mean + variance)
    if not speed:
        return None
    aside = np.cross(tangent, mean) / max(np.linalg.norm(mean), 1e-300)
    diameter = float(np.mean(scenario.arm.diameters))
    # that of an arm that control holds still
    share = numbers.get("strouhal") or math.sqrt(numbers["centre"] ** 2 - numbers["range"] ** 2)
    # 1/2 rho d C_l U^2 cos(...) by the slope of the drag across the current, 1/2 rho d C_d U
    spread = np.abs(aside) * speed * numbers["lift"] / math.sqrt(2) / max(water.drag_normal, 0.1)
    width = min(max(_WIDTH, math.sqrt(variance) / speed / 2), 0.7)
    return Fluctuation(spread, diameter / (share * speed), width, drift=np.zeros(3))


def _carrier(
    scenario: Scenario, recordings: Mapping[int, Recording]
) -> tuple[Float[np.ndarray, " d"], float]:
    """Return the mean velocity (m/s) that carries eddies, and its variance over all axes."""
    mean, variance = np.zeros(scenario.arm.dimension), 0.0
    for index, flow in enumerate(scenario.flow):
        match flow:
            case UniformFlow():
                mean += flow.velocity
            case TurbulenceFlow():
                mean += flow.mean
            case GaussMarkovFlow():
                mean += flow.mean
                spread = np.broadcast_to(flow.standard_deviation, mean.size)
                variance += float(spread @ spread)
            case SineFlow():
                variance += float(np.dot(flow.amplitude, flow.amplitude)) / 2
            case MeasuredFlow() if recordings[index].levels is None:
                record = recordings[index]
                mean += record.velocity[:, 0].mean(axis=0)
                if not record.carried:
                    variance += float(record.velocity[:, 0].var(axis=0).sum())
    return mean, variance


def _isotropic(away: Float[np.ndarray, "... d"], length: float) -> Float[np.ndarray, "... d d"]:
    """Return the correlation of isotropic turbulence at two points, by component."""
    from scipy.special import gamma, kv  # slow to load

    energetic = length * gamma(1 / 3) / (math.sqrt(math.pi) * gamma(5 / 6))
    distance = np.linalg.norm(away, axis=-1)
    scaled = np.maximum(distance / energetic, 1e-9)
    factor = 2 ** (2 / 3) / gamma(1 / 3) * scaled ** (1 / 3)
    steep = 0.5 * factor * scaled * kv(2 / 3, scaled)
    along = away / np.maximum(distance, 1e-300)[..., None]
    radial = along[..., :, None] * along[..., None, :]
    across = factor * kv(1 / 3, scaled) - steep
    return across[..., None, None] * np.eye(away.shape[-1]) + steep[..., None, None] * radial


def _waves(state: SeaState, scenario: Scenario) -> Fluctuation:
    """Return what long-crested waves do at the middle of the arm, those of the peak's period."""
    rate = 2 * math.pi / state.period
    number = rate**2 / max(scenario.water.gravity, 1e-9)
    depth = -scenario.base.position[-1]
    orbital = state.deviation * rate * math.exp(-number * max(depth, 0.0))
    spread = np.full(scenario.arm.dimension, orbital)
    return Fluctuation(spread, state.period, _NARROW if state.regular else _WIDTH)


def _measured(recording: Recording, slow: float) -> Fluctuation:
    """Return deviation and correlation time of a record as it is played.

    Of several levels where it varies most, and of several axes along that which forgets soonest:
    slow parts are modelled apart.
    """
    varies = np.var(recording.velocity, axis=0)
    series = recording.velocity[:, int(np.argmax(varies.sum(axis=1)))].T
    times = [integral_time(each, recording.interval) for each in series if np.ptp(each)]
    deviation = np.sqrt(varies.mean(axis=0))
    slowness = recording.slowness if np.any(recording.slowness) else None
    time = recording.time_scale * min(times) if times else slow
    return Fluctuation(deviation, time, slowness=slowness)


Points = Float[np.ndarray, "station d"]
Times = Float[np.ndarray, " look"]

SHAPES = 3  # shapes along the arm of water that is foreseen
_LEAST_ACROSS = 0.3  # share of the current that counts as across the arm at least
_SPACING = 0.04  # time between readings for the forecast, over the arm's first period
_MEMORY = np.array([0.75, 4.0])
"""Over the arm's first period, for how long readings are kept at least and at most."""
_LEAST_NOISE = 0.02  # noise of readings over their standard deviation, at least


def known_water(
    plan: AssembledScenario, steady: Float[np.ndarray, " d"], lead: Times
) -> KnownWater:
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
    plan: AssembledScenario, steady: Float[np.ndarray, " d"], lead: Times, name: str
) -> FrozenTurbulenceForecast:
    """Return the water at the arm as estimated from a sensor's readings and the mean current.

    The mean at each station now and later, given the readings so far, of a random process with
    the covariance in space and time that the flows of the scenario have (Wiener 1949): what a
    meter does not determine counts as mean current.
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
    expected = fluctuations(
        plan.scenario, plan.recordings, plan.system.forces.water.flows, plan.first_period
    )

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
    predicted = covariance(expected, stations, lead, points, taken)
    hastening = [each for each in expected if each.accelerates]
    soon, before = (
        covariance(hastening, stations, lead + shift * plan.period, points, taken)
        for shift in (0.5, -0.5)
    )
    predicted = np.stack([predicted, (soon - before) / plan.period], axis=1).reshape(-1, size)
    weights = np.linalg.solve(square + np.diag(noise), predicted.T).T
    shape = (lead.size, 2, *stations.shape, count, *points.shape)
    return FrozenTurbulenceForecast(along, array(weights.reshape(shape)), array(mean), name, stride)


def _along(plan: AssembledScenario, steady: Float[np.ndarray, " d"]) -> tuple[Points, Along]:
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
