"""Linearised time step: state transition by small changes of state, inputs and water.

The *coordinates* of a state are position, velocity and acceleration of the unknowns of a step, with
the auxiliary acceleration of generalized-alpha, then the memory of the elements, followed by the
states of the actuators. They determine the rest: the nodes that the base holds, the frames in
space, the attitude of a vehicle, the reaction of the base.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from crinoid.actuation import drives, followed
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import BOUNDARY_NODES, ROTATION, SPIN
from crinoid.dynamics.start import at_end
from crinoid.dynamics.state import State
from crinoid.dynamics.time_step import step_with
from crinoid.dynamics.vehicle import turn_of, unknowns
from crinoid.numerics.frames import angle_between, tangents, transport
from crinoid.numerics.small_matrices import product

if TYPE_CHECKING:
    from crinoid.dynamics.system import System

Coordinates = Float[Array, " a"]
Following = Float[Array, " s"]


class Transition(NamedTuple):
    """Linearised time step. SI units; ``a`` coordinates of the arm, ``s`` of actuators.

    The arm: ``a' = arm a + held s + driven s' + stirred w + hastened w_t``, where ``s`` and ``s'``
    are those of the actuators at both ends of the step, and ``w`` and ``w_t`` the changes of the
    velocity and the material acceleration of the water at all rows at its end. The actuators:
    ``s' = actuators s + commanded u``.
    """

    arm: Float[Array, "a a"]
    held: Float[Array, "a s"]
    """By the actuators at the start of the step; zero unless the base turns meanwhile."""
    driven: Float[Array, "a s"]
    stirred: Float[Array, "a rows d"]
    """By the velocity of the water at the nodes, then at obstacles and at a vehicle."""
    hastened: Float[Array, "a rows d"]
    """By its material acceleration."""
    actuators: Float[Array, "s s"]
    commanded: Float[Array, "s input"]
    observed_arm: Float[Array, "y a"]
    """Derivative of the output by the arm."""
    observed_actuators: Float[Array, "y s"]
    """Derivative of the output by the actuators, which move the root."""

    @property
    def A(self) -> Float[Array, "x x"]:
        """State matrix of ``x``, arm and actuators."""
        corner = jnp.zeros((self.actuators.shape[0], self.arm.shape[0]))
        driven = self.held + self.driven @ self.actuators
        return jnp.block([[self.arm, driven], [corner, self.actuators]])

    @property
    def B(self) -> Float[Array, "x input"]:
        """Input matrix of a command held for the step."""
        return jnp.concatenate([self.driven @ self.commanded, self.commanded])

    @property
    def C(self) -> Float[Array, "y x"]:
        """Output matrix."""
        return jnp.concatenate([self.observed_arm, self.observed_actuators], axis=1)


class LocalCoordinates:
    """Coordinates of the states of a system near a given one."""

    def __init__(self, system: "System", state: State) -> None:
        self.system, self.state = system, state
        self.actuators, self.driven = numbers_of((state.servo, *state.actuators))
        self._memory = numbers_of(state.memory)[1]

    @property
    def arm(self) -> Coordinates:
        """Coordinates of the arm at the given state."""
        return self.read(self.state)[0]

    def read(self, state: State) -> tuple[Coordinates, Following]:
        """Return the coordinates of the arm and of the actuators at a state."""
        rows, forces = state.motion.position, self.system.forces
        frames = self.state.frames
        if frames is not None:  # by directors: spins depend on the path
            assert state.motion.orientation is not None
            nodes = forces.nodes(rows)
            now = tangents(nodes)
            transported = transport(frames.director, frames.tangent, now)
            director = state.motion.orientation.director
            spin = frames.spin + angle_between(transported, director, now)
            rows = rows.at[: nodes.shape[0], SPIN].set(spin)
        before, attitude = self.state.attitude, state.attitude
        if before is not None:  # likewise by attitudes, not turns
            assert attitude is not None
            turn = turn_of(product(before.T, attitude))
            turn = self.state.motion.position[ROTATION, : turn.size] + turn
            rows = rows.at[ROTATION, : turn.size].set(turn)
        if self.state.obstacle_attitude is not None:
            assert state.obstacle_attitude is not None
            turns = jax.vmap(lambda a, b: turn_of(product(b, a.T)))(
                self.state.obstacle_attitude, state.obstacle_attitude
            )
            at_rotations, size = forces.rows.rotations, turns.shape[1]
            turns += self.state.motion.position[at_rotations, :size]
            rows = rows.at[at_rotations, :size].set(turns)
        motion, at = state.motion, self.entries
        parts = (rows, motion.velocity, motion.acceleration, state.auxiliary_offset)
        moving = [part.reshape(-1)[at] for part in parts]
        arm = jnp.concatenate([*moving, numbers_of(state.memory)[0]])
        return arm, numbers_of((state.servo, *state.actuators))[0]

    def at(self, arm: Coordinates, actuators: Following) -> State:
        """Return the state with these coordinates."""
        system, state, motion = self.system, self.state, self.state.motion
        servo, *others = self.driven(actuators)
        known = (motion.position, motion.velocity, motion.acceleration, state.auxiliary_offset)
        at, shape = self.entries, motion.position.shape
        moving, memory = jnp.split(arm, [len(known) * at.size])
        position, velocity, acceleration, auxiliary_offset = (
            rows.reshape(-1).at[at].set(part, unique_indices=True).reshape(shape)
            for rows, part in zip(known, moving.reshape(len(known), at.size), strict=True)
        )
        remembered = self._memory(memory)
        one, zero = jnp.ones(()), jnp.zeros(())
        stage = StepMap(state.time, position, velocity, acceleration, one, zero, zero, state.frames)
        context = replace(state.context, drive=drives(system.actuators, others), memory=remembered)
        forces, _, stage = at_end(system.forces, system.base, servo, context, stage, state, zero)
        none = jnp.zeros_like(position)
        moved = forces.motion(stage, none, forces.surroundings(stage, none))
        reaction = forces.residual(moved)[0][:BOUNDARY_NODES]
        return replace(
            State.of(forces, moved, reaction, (servo, *others), remembered),
            auxiliary_offset=auxiliary_offset,
            acceleration_history=state.acceleration_history,
            predictor_accepted=state.predictor_accepted,
            reused_tangent=state.reused_tangent,
        )

    @property
    def entries(self) -> Int[np.ndarray, " entry"]:
        """Indices of the unknowns of a step among the flattened rows."""
        forces, rows = self.system.forces, self.state.motion.position
        moves = np.zeros(rows.shape, bool)
        moves[forces.rows.nodes] = True
        moves[:BOUNDARY_NODES] = False
        if forces.obstacles is not None and forces.obstacles.bodies is not None:
            flat = moves[forces.rows.obstacle_rows].reshape(-1)
            flat[list(forces.obstacles.bodies.unknowns(rows.shape[1]))] = True
        if forces.vehicle is not None:
            flat = moves[forces.rows.vehicle].reshape(-1)
            flat[list(unknowns(forces.axes, rows.shape[1]))] = True
        return np.flatnonzero(moves)


def transition(
    system: "System",
    state: State,
    command: Float[Array, " input"],
    step: Float[Array, ""],
    output: Callable[[State], Float[Array, " y"]],
) -> Transition:
    """Linearise the time step from ``state`` under ``command``: the derivative of the step."""
    followers = system.followers
    before = LocalCoordinates(system, state)
    ends = followed(followers, before.driven(before.actuators), command, step)
    at_end, shaped = numbers_of(tuple(ends))
    water = jnp.zeros((2, state.motion.position.shape[0], system.forces.axes))

    def move(arm: Array, held: Array, driven: Array, water: Array) -> Array:
        after, _ = step_with(system, before.at(arm, held), shaped(driven), step, water)
        return LocalCoordinates(system, jax.lax.stop_gradient(after)).read(after)[0]

    def follow(actuators: Array, command: Array) -> Array:
        ends = followed(followers, before.driven(actuators), command, step)
        return numbers_of(tuple(ends))[0]

    def see(arm: Array, actuators: Array) -> Array:
        return output(before.at(arm, actuators))

    at = (before.arm, before.actuators)
    arm, held, driven, stirred = _slopes(move, (*at, at_end, water))
    actuators, commanded = _slopes(follow, (before.actuators, command))
    return Transition(
        arm, held, driven, stirred[:, 0], stirred[:, 1], actuators, commanded, *_slopes(see, at)
    )


def _slopes(function: Callable[..., Array], at: tuple[Array, ...]) -> list[Array]:
    """Return the derivatives of a function by each of its arguments."""
    _, along = jax.linearize(function, *at)
    flat, shaped = ravel_pytree(at)
    columns = jax.vmap(lambda change: along(*shaped(change)))(jnp.eye(flat.size))
    ends = np.cumsum([part.size for part in at])[:-1]
    parts = jnp.split(columns.T, ends, axis=1)
    return [part.reshape(-1, *each.shape) for part, each in zip(parts, at, strict=True)]


def numbers_of(
    followers: tuple[Any, ...],
) -> tuple[Following, Callable[[Following], tuple[Any, ...]]]:
    """Return the numbers among the states of actuators, and the inverse of that map."""
    numbers, rest = eqx.partition(followers, eqx.is_inexact_array)
    flat, shaped = ravel_pytree(numbers)
    return flat, lambda other: eqx.combine(shaped(other), rest)
