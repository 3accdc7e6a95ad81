"""Gain-scheduled predictive control: models of several poses of the base."""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from crinoid.assembly.arrays import array
from crinoid.assembly.control_design import ControlDesignModel
from crinoid.assembly.optimal_control import design_mpc
from crinoid.assembly.plan import AssembledScenario, find_state
from crinoid.control import Mpc, RigidRotationCorrection, ScheduledMpc, commands_at
from crinoid.dynamics import System, numbers_of
from crinoid.scenario import refusal

Turn = Float[np.ndarray, " angle"]

_SPACING = 0.35  # turn from one model to the next along the way of the target (rad)
_NEW = 0.8  # share of it beyond which a pose needs a model
_MOST = 12  # most models
_LOOKS = 200  # number of times at which the path of the target is sampled


class _LocalController(NamedTuple):
    """A controller on the model of one pose of the base."""

    turn: Turn  # rotation of the base from its start, by the channels that turn (rad)
    controller: Mpc
    turned: RigidRotationCorrection  # part of the turn that its model lacks away from there
    standing: Float[np.ndarray, "z s"]  # estimate at rest, by the actuators


def build_scheduled(plan: AssembledScenario) -> ScheduledMpc:
    """Return predictive controllers along the way of the target, as one.

    The way is gone along from the start. Where the nearest model says that the base turns far from
    its pose, there is another; so each is found by one that is near.
    """
    here = _local(plan, np.zeros(plan.system.base.angles.shape[0]))
    found = [here]
    for pose in _way(plan):
        for _ in range(_MOST):
            away = _turn_for(plan, here, pose) - here.turn
            far = float(np.linalg.norm(away))
            wanted = here.turn + away * min(1.0, _SPACING / max(far, 1e-12))
            distances = [float(np.linalg.norm(each.turn - wanted)) for each in found]
            near = found[int(np.argmin(distances))]
            if min(distances) > _NEW * _SPACING and len(found) < _MOST:
                near = _local(plan, wanted)
                found.append(near)
            if near is here:
                break
            here = near
    return _stack(plan, found)


def _way(plan: AssembledScenario) -> Float[np.ndarray, "look pose"]:
    """Return poses of the target over the run."""
    target = plan.target
    end = plan.scenario.simulation.duration
    if target.path is None:
        return np.asarray(target.fixed)[None]
    times = array(np.linspace(plan.scenario.control.start, end, _LOOKS))
    return np.asarray(jax.jit(jax.vmap(target.in_frame))(times))


def _turn_for(
    plan: AssembledScenario, local: _LocalController, pose: Float[np.ndarray, " pose"]
) -> Turn:
    """Return how far the base is to be turned for a pose of the tip, as a model says."""
    rows = list(local.controller.rows)
    around = _commands(plan, local.turn)
    lower, upper = map(array, (plan.limits - around)[:, rows])
    found = _commands_at(local.controller, local.turned, array(pose)[None], lower, upper)
    around[rows] += np.clip(np.asarray(found[0][0]), lower, upper)
    return around[_turning(plan)]


_commands_at = jax.jit(commands_at)


def _turning(plan: AssembledScenario) -> slice:
    """Return which inputs turn the base."""
    channels = plan.system.base.servo.lower.shape[0]
    return slice(channels - plan.system.base.angles.shape[0], channels)


def _commands(plan: AssembledScenario, turn: Turn) -> Float[np.ndarray, " input"]:
    """Return the commands that turn the base so, and nothing else."""
    commands = np.zeros(len(plan.inputs))
    commands[_turning(plan)] = turn
    return commands


def _local(plan: AssembledScenario, turn: Turn) -> _LocalController:
    """Design the controller for the arm where the base is turned.

    A base with other set angles is equivalent to one whose servos have turned it.
    """
    base, state, system = plan.system.base, plan.state, plan.system
    if turn.any():
        system = eqx.tree_at(lambda each: each.base.angles, system, base.angles + array(turn))
        state, outcome = find_state(system, plan.scenario.simulation.start == "equilibrium")
        if not outcome.converged:
            angles = ", ".join(f"{each:.3g}" for each in np.rad2deg(turn))
            text = f"no equilibrium where the base is turned by {angles} deg on the way of the tip"
            text = f'got "scheduled", but the arm has {text}. Set "frozen".'
            raise refusal("control.mpc.model", text)
    controller, design = design_mpc(replace(plan, system=system, state=state))
    servo, observer = plan.state.servo, controller.observer
    servo = replace(servo, position=servo.position.at[_turning(plan)].add(array(turn)))
    shifted = numbers_of((servo, *plan.state.actuators))[0]
    at_rest = array(np.asarray(shifted)[list(observer.kept)])
    controller = replace(controller, observer=replace(observer, at_rest=at_rest, outputs=None))
    parts = design.parts
    # water and offset of the tip do not answer to actuators
    moving = np.r_[np.arange(parts.arm), np.arange(parts.estimated, parts.move.shape[0])]
    standing_still = np.zeros_like(parts.held)
    standing_still[moving] = np.linalg.solve(
        np.eye(moving.size) - parts.move[np.ix_(moving, moving)],
        (parts.held + parts.driven)[moving],
    )
    turned = _rotation_correction(plan, system, design)
    return _LocalController(turn, controller, turned, standing_still)


def _rotation_correction(
    plan: AssembledScenario, system: System, design: ControlDesignModel
) -> RigidRotationCorrection:
    """Return what the model lacks of the turn of an arm that is rigid."""
    base = system.base
    axes, none = base.axes, jnp.zeros(base.servo.lower.shape[0])
    size = plan.sensors[0].noise.shape[0]
    pose = design.observer.values[:size]
    root = jnp.zeros(size).at[:axes].set(system.forces.origin)
    place = plan.target.to_frame(root, plan.state.time)
    free = RigidRotationCorrection(
        base, pose[:axes] - place[:axes], pose[axes:], jnp.zeros((size, none.size))
    )
    return eqx.tree_at(lambda each: each.slope, free, jax.jit(jax.jacfwd(free.swung))(none))


def _stack(plan: AssembledScenario, found: list[_LocalController]) -> ScheduledMpc:
    """Put controllers together, each with as many states as the largest: more that are zero."""
    states = max(each.standing.shape[0] for each in found)
    around = np.stack([_commands(plan, each.turn) for each in found])
    turns = np.zeros(around.shape[1])
    turns[_turning(plan)] = 1.0
    channels = plan.system.base.servo.lower.shape[0]

    def stack(*each: jax.Array | np.ndarray) -> jax.Array:
        largest = np.max([one.shape for one in each], axis=0).astype(int)
        whole = np.zeros((len(each), *largest), each[0].dtype)
        for row, one in enumerate(each):
            whole[(slice(row, row + 1), *map(slice, one.shape))] = one
        return jax.device_put(whole)

    return ScheduledMpc(
        models=jax.tree.map(stack, *(_with_states(each.controller, states) for each in found)),
        turned=jax.tree.map(stack, *(each.turned for each in found)),
        at=array(around[:, :channels]),
        around=array(around),
        standing=stack(*(each.standing for each in found)),
        turns=array(turns[:channels]),
    )


def _with_states(controller: Mpc, states: int) -> Mpc:
    """Return a controller whose cost has as many states, the added ones without effect."""
    size = controller.observer.move.shape[0]
    by_state = np.insert(np.asarray(controller.by_state), [size] * (states - size), 0.0, axis=2)
    return replace(controller, by_state=array(by_state))
