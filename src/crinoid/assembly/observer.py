"""Kalman filter on a linear model of the arm, its sensors and the statistics of the water."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from crinoid.assembly.arrays import array
from crinoid.assembly.forecast import Fluctuation
from crinoid.assembly.linear import LinearModel
from crinoid.assembly.observer_outputs import OutputMatrices, observer_outputs
from crinoid.assembly.plan import AssembledScenario
from crinoid.control import Inclination, Observer, Sensor, Shape, WaterVelocity
from crinoid.numerics.kalman import stationary_covariance, stationary_filter

_TICKS = 60  # number of commands over which the pattern of arrivals is sampled
_MODEL_ERROR = 2e-2  # relative error of the effect of the inputs over a period in the model
_LEAST_NOISE = 1e-3  # least noise of readings, over their usual variation
_ELSEWHERE = 1.5
"""Noise of the water's velocity at a meter, over its deviation. Water at the arm differs, and drag
is not linear in it. The difference lasts while an eddy passes, so white noise must exceed it."""
_LOCAL = 0.03
"""Noise of curvatures or inclinations along the arm, over the largest that is usual: eddies shorter
than the shapes of the model's water bend it, too."""
_BENT = 0.05  # least displacement of the tip of an arm at work, over its length
_OFFSET_TIME = 0.75  # correlation time of the tip's offset from the model, over the first period


class WaterProcess(NamedTuple):
    """Fluctuating water: ``d' = move d + v``, its velocity by shape and axis ``velocity d``."""

    move: Float[np.ndarray, "d d"]
    noise: Float[np.ndarray, "d d"]  # covariance of ``v``
    velocity: Float[np.ndarray, "w d"]
    sped: Float[np.ndarray, "w d"]  # the part of it by which particles of the water accelerate

    @staticmethod
    def of(fluctuations: Sequence[Fluctuation], shapes: int, period: float) -> WaterProcess:
        """Build the water of independent fluctuations, each of all shapes."""
        from scipy.linalg import block_diag  # slow to load

        moves, noises, velocities, sped = [], [], [], []
        for each in fluctuations:
            move, noise, velocity = each.process(period)
            for shape in range(shapes):
                for axis, deviation in enumerate(each.deviation):
                    if not deviation:
                        continue
                    moves.append(move)
                    noises.append(noise)
                    row = np.zeros((shapes * each.deviation.size, velocity.shape[1]))
                    # a shape with more zeros has less of it
                    row[shape * each.deviation.size + axis] = deviation * velocity / (1 + shape)
                    velocities.append(row)
                    sped.append(row * each.accelerates)
        parts = block_diag(*moves), block_diag(*noises), np.hstack(velocities), np.hstack(sped)
        return WaterProcess(*parts)


class ReadingSchedule(NamedTuple):
    """Arrival of readings at a controller."""

    fresh: Bool[np.ndarray, "tick sensor"]  # whether there is a new one when a command is given
    age: tuple[int, ...]  # how old they are then, in control periods

    @staticmethod
    def of(sensors: Sequence[Sensor], period: float, time_step: float) -> ReadingSchedule:
        """Compute it from the clocks and delays of the sensors."""

        def ticks(every: float, count: int) -> Float[np.ndarray, " tick"]:
            return np.ceil(np.arange(count) * every / time_step - 1e-6) * time_step

        given = ticks(period, 2 * _TICKS + 1)
        fresh, ages = [], []
        for sensor in sensors:
            every, delay = float(sensor.clock.period), float(sensor.delay)
            behind = math.ceil((delay + every) / period) * period
            taken = ticks(every, math.ceil((given[-1] + behind) / every) + 2)
            # from when the first ones have arrived
            now = given + math.ceil(behind / every) * every
            newest = np.searchsorted(taken, now - delay + 1e-6 * every, side="right") - 1
            new = np.diff(newest, prepend=newest[0] - 1)[1:] > 0
            age = (now - taken[newest])[1:][new]
            fresh.append(new)
            ages.append(round(float(np.mean(age)) / period))
        return ReadingSchedule(np.stack(fresh, axis=1), tuple(ages))


class AugmentedModel(NamedTuple):
    """Linear model augmented by the states of water, offset of the tip, and late readings."""

    move: Float[np.ndarray, "z z"]
    held: Float[np.ndarray, "z s"]
    driven: Float[np.ndarray, "z s"]
    noise: Float[np.ndarray, "z z"]
    expect: Float[np.ndarray, "y z"]
    follow: Float[np.ndarray, "y s"]
    outputs: OutputMatrices
    """How tip, shape and current follow the states that are no readings under way, which come
    first."""
    usual: Float[np.ndarray, " y"]  # by how much the readings vary
    arm: int  # number of states of the arm, which come first

    @property
    def estimated(self) -> int:
        """Number of states that are not readings under way."""
        return self.outputs.tip.shape[1]


def augmented(
    model: LinearModel,
    water: WaterProcess,
    arrivals: ReadingSchedule,
    plan: AssembledScenario,
    unshed: int,
) -> AugmentedModel:
    """Augment the linear model. The first ``unshed`` states of the water are no shed vortices.

    The tip's pose has an offset that varies, for what a linear model does not have: a
    bent arm is shorter, by the square of its deflection.
    """
    arm, states, pose = model.arm.shape[0], water.move.shape[0], plan.sensors[0].noise.shape[0]
    estimated = arm + states + pose
    inner = np.zeros((estimated, estimated))
    change = water.sped @ (water.move - np.eye(states)) / plan.period
    inner[:arm, :arm] = model.arm
    inner[:arm, arm:-pose] = model.stirred @ water.velocity @ water.move + model.hastened @ change
    inner[arm:-pose, arm:-pose] = water.move
    kept = math.exp(-plan.period / (_OFFSET_TIME * plan.first_period))
    inner[-pose:, -pose:] = kept * np.eye(pose)
    seen = np.hstack([model.observed, model.observed_water @ water.velocity])
    seen = np.hstack([seen, np.eye(seen.shape[0], pose)])
    random = np.zeros((estimated, estimated))
    push = model.stirred @ water.velocity + model.hastened @ water.sped / plan.period
    by_noise = np.concatenate([push, np.eye(states)])
    random[:-pose, :-pose] = by_noise @ water.noise @ by_noise.T
    usual = np.sqrt(np.einsum("yz,zv,yv->y", seen, stationary_covariance(inner, random), seen))
    axes, length = plan.scenario.arm.dimension, plan.scenario.arm.length
    shorter = max(float(usual[:axes].max()), _BENT * length) ** 2 / (2 * length)
    offset = np.where(np.arange(pose) < axes, shorter, shorter / length)  # usual, of the tip
    random[-pose:, -pose:] = np.diag((1 - kept**2) * offset**2)
    wrong = _MODEL_ERROR * (model.driven @ model.commanded) * model.usual
    random[:arm, :arm] += wrong @ wrong.T
    sizes = [sensor.noise.shape[0] for sensor in plan.sensors]
    total = estimated + sum(n * age for n, age in zip(sizes, arrivals.age, strict=True))
    move, noise = np.zeros((total, total)), np.zeros((total, total))
    held, driven = (np.zeros((total, model.held.shape[1])) for _ in range(2))
    expect = np.zeros((sum(sizes), total))
    follow = np.zeros((sum(sizes), model.held.shape[1]))
    move[:estimated, :estimated], noise[:estimated, :estimated] = inner, random
    held[:arm], driven[:arm] = model.held, model.driven
    first, row = estimated, 0
    for size, age in zip(sizes, arrivals.age, strict=True):
        rows = slice(row, row + size)
        row += size
        if not age:
            expect[rows, :estimated] = seen[rows]
            follow[rows] = model.observed_actuators[rows]
            continue
        # the newest reading under way first
        move[first : first + size, :estimated] = seen[rows]
        held[first : first + size] = model.observed_actuators[rows]
        later = np.arange(first + size, first + size * age)
        move[later, later - size] = 1.0
        expect[rows, first + size * (age - 1) : first + size * age] = np.eye(size)
        first += size * age
    tip = seen[:pose]
    nodes = np.zeros((model.nodes.shape[0], estimated))
    nodes[:, :arm] = model.nodes
    share = np.linspace(0.0, 1.0, nodes.shape[0] // axes)
    nodes[:, -pose : estimated - pose + axes] = np.kron(share[:, None], np.eye(axes))
    current = np.zeros((axes, estimated))
    # the other shapes along the arm have no mean
    current[:, arm : arm + unshed] = water.velocity[:axes, :unshed]
    outputs = OutputMatrices(tip, nodes, current, offset)
    return AugmentedModel(move, held, driven, noise, expect, follow, outputs, usual, arm)


def reading_noise(
    plan: AssembledScenario, model: LinearModel, parts: AugmentedModel
) -> tuple[Float[np.ndarray, " y"], Float[np.ndarray, " y"]]:
    """Return the variance of the readings of all sensors, and their values in the linear model.

    The variance is that of noise, rounding, and motions that the model lacks. The values are those
    of the state about which the model is linear, the first ones in the frame of the target.
    """
    given = np.concatenate([np.asarray(sensor.noise) for sensor in plan.sensors])
    grain = np.concatenate([np.asarray(sensor.resolution) for sensor in plan.sensors])
    sizes = [sensor.noise.shape[0] for sensor in plan.sensors]
    meters = [isinstance(sensor.measurand, WaterVelocity) for sensor in plan.sensors]
    least = np.repeat(np.where(meters, _ELSEWHERE, _LEAST_NOISE), sizes)
    local = np.zeros_like(parts.usual)
    for sensor, end in zip(plan.sensors, np.cumsum(sizes), strict=True):
        if isinstance(sensor.measurand, (Shape, Inclination)):
            rows = slice(end - sensor.noise.shape[0], end)
            local[rows] = _LOCAL * parts.usual[rows].max()
    noise = given**2 + grain**2 / 12 + (least * parts.usual) ** 2 + local**2
    values = values_in_current(plan.sensors, model.values, np.array(plan.current, float))
    values[: sizes[0]] = plan.target.to_frame(array(values[: sizes[0]]), plan.state.time)
    return np.maximum(noise, 1e-16 * max(noise.max(), 1e-300)), values


def values_in_current(
    sensors: Sequence[Sensor], values: Float[np.ndarray, " y"], current: Float[np.ndarray, " d"]
) -> Float[np.ndarray, " y"]:
    """Return readings, those of current meters with the mean current over the run (m/s)."""
    sizes = [sensor.noise.shape[0] for sensor in sensors]
    found = [
        np.tile(current, part.size // current.size)
        if isinstance(sensor.measurand, WaterVelocity)
        else part
        for sensor, part in zip(sensors, np.split(values, np.cumsum(sizes)[:-1]), strict=True)
    ]
    return np.concatenate(found)


def build_observer(
    plan: AssembledScenario, model: LinearModel, parts: AugmentedModel, arrivals: ReadingSchedule
) -> Observer:
    """Return the observer of least variance."""
    variance, values = reading_noise(plan, model, parts)
    sizes = [sensor.noise.shape[0] for sensor in plan.sensors]
    every = np.repeat(arrivals.fresh, sizes, axis=1)
    found = stationary_filter(parts.move, parts.noise, parts.expect, variance, every)
    return Observer(
        move=array(parts.move),
        held=array(parts.held),
        driven=array(parts.driven),
        expect=array(parts.expect),
        follow=array(parts.follow),
        gains=array(found.gains),
        fresh=jax.device_put(found.fresh[:, np.cumsum([0, *sizes[:-1]])].astype(int)),
        values=array(values),
        at_rest=array(model.at_rest),
        kept=model.kept,
        sensors=plan.readings,
        outputs=observer_outputs(plan, model, parts.outputs, found.covariance),
    )
