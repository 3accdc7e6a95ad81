"""Outputs of an observer: pose of the tip, shape of the arm, and current."""

from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from crinoid.assembly.arrays import array
from crinoid.assembly.linear import LinearModel, Matrix
from crinoid.assembly.plan import AssembledScenario
from crinoid.control import CurrentOutput, LinearOutput, ObserverOutputs

_DRAG_ERROR = 0.15  # error of the current by the linear model, over its deviation


class OutputMatrices(NamedTuple):
    """How tip, shape and current follow the states of an observer."""

    tip: Float[np.ndarray, "pose estimated"]
    """The pose of the tip (m; rad in the plane, components of a unit vector in space)."""
    nodes: Float[np.ndarray, "coordinate estimated"]
    """The positions of the nodes (m); the offset of the tip grows linearly from the root on."""
    current: Float[np.ndarray, "d estimated"]
    """The velocity of the water (m/s), its mean along the arm, without the lift of vortices."""
    offset: Float[np.ndarray, " pose"]
    """By how much the offset of the tip varies, in the units of the pose."""


def tangent(nodes: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " d"]:
    """Return the mean direction of an arm, a unit vector."""
    total = np.diff(nodes, axis=0).sum(axis=0)
    return total / np.linalg.norm(total)


def observer_outputs(
    plan: AssembledScenario, model: LinearModel, parts: OutputMatrices, covariance: Matrix
) -> ObserverOutputs:
    """Return tip, shape and current by the states, of which ``covariance`` is that of the errors.

    In the frame of the target. The current is that of the start, at which the linear model is, plus
    its change. Between root and tip the shape has an offset as well, that nothing observes.
    """
    target, time = plan.target, plan.state.time
    axes, size, states = plan.scenario.arm.dimension, parts.tip.shape[0], covariance.shape[0]

    def widened(by_state: Matrix) -> Matrix:
        return np.pad(by_state, ((0, 0), (0, states - by_state.shape[1])))

    def output(
        by_state: Matrix, by_actuators: Matrix, at_rest: np.ndarray, apart: np.ndarray
    ) -> LinearOutput:
        given = (widened(by_state), by_actuators, at_rest, np.zeros_like(at_rest), apart)
        found = LinearOutput(*map(array, given))
        return replace(found, std=array(found.std_of(covariance)))

    nodes = np.asarray(plan.state.position)[1:] + np.asarray(plan.system.forces.origin)
    poses = np.concatenate([model.values[None, :size], np.pad(nodes, ((0, 0), (0, size - axes)))])
    tip, *points = np.asarray(jax.jit(jax.vmap(target.to_frame, (0, None)))(array(poses), time))
    along, current = tangent(nodes), np.zeros(axes)
    if plan.scenario.simulation.start == "equilibrium":  # else the arm is that without any load
        flow = np.asarray(plan.state.flow_velocity)[1:]
        current = np.mean((flow[1:] + flow[:-1]) / 2, axis=0)
    # the velocity along the arm causes no drag: only its mean is known
    current += along @ (np.asarray(plan.current) - current) * along
    place = np.linspace(0.0, 1.0, len(nodes))
    apart = np.outer(4 * place * (1 - place), parts.offset[:axes])
    across = model.current - along @ model.current * along
    speed = np.linalg.norm(across)
    by_state = widened(parts.current)
    usual = np.diag(np.sum(by_state**2, axis=1))  # states of the water have a variance of 1
    direction, slope = across / max(speed, 1e-300), model.steeper * speed
    given = (by_state, 0 * usual, _DRAG_ERROR**2 * usual, current, along, direction, slope)
    water = CurrentOutput(*map(array, given))
    return ObserverOutputs(
        output(parts.tip, model.observed_actuators[:size], tip, np.zeros_like(tip)),
        output(parts.nodes, model.nodes_actuators, np.stack(points)[:, :axes], apart),
        replace(water, spread=array(water.spread_of(covariance))),
    )
