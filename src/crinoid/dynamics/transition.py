"""The linear model of a time step: what small changes of a state, inputs and water lead to.

A state is told apart from others by its *coordinates*: position, velocity and acceleration of what
a step solves for, with the auxiliary acceleration of generalized-alpha, and behind them the states
of the actuators. What they decide on follows: the nodes that the base holds, the frames in space,
the attitude of a vehicle, the reaction of the base.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from crinoid.actuation import drives, followed
from crinoid.dynamics import start
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.grip import holding
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.prescribed import prescribed
from crinoid.dynamics.state import State
from crinoid.dynamics.surroundings import Stir
from crinoid.dynamics.tangent import HELD
from crinoid.dynamics.vehicle import ROWS, turn_of, unknowns
from crinoid.frames import angle_between, tangents, transport
from crinoid.products import product

if TYPE_CHECKING:
    from crinoid.dynamics.system import System

Coordinates = Float[Array, " a"]
Following = Float[Array, " s"]
Rows = Float[Array, "rows b"]
Observe = Callable[["System", State], Float[Array, " y"]]


class Transition(NamedTuple):
    """Small changes over one time step. SI units; ``a`` coordinates of the arm, ``s`` of actuators.

    The arm: ``a' = arm a + held s + driven s' + stirred w + hastened w_t``, where ``s`` and ``s'``
    are those of the actuators at both ends of the step, and ``w`` and ``w_t`` what the velocity and
    the material acceleration of the water at the nodes change by at its end. The actuators:
    ``s' = actuators s + commanded u``.
    """

    arm: Float[Array, "a a"]
    held: Float[Array, "a s"]
    """By the actuators at the start of the step: nothing where the base does not turn meanwhile."""
    driven: Float[Array, "a s"]
    stirred: Float[Array, "a n d"]
    hastened: Float[Array, "a n d"]
    actuators: Float[Array, "s s"]
    commanded: Float[Array, "s input"]
    observed_arm: Float[Array, "y a"]
    """How what is observed follows the arm."""
    observed_actuators: Float[Array, "y s"]
    """How it follows the actuators, which move the root."""

    @property
    def A(self) -> Float[Array, "x x"]:
        """The matrix by which a state ``x``, arm and actuators, follows the one before."""
        corner = jnp.zeros((self.actuators.shape[0], self.arm.shape[0]))
        top = jnp.concatenate([self.arm, self.held + self.driven @ self.actuators], axis=1)
        return jnp.concatenate([top, jnp.concatenate([corner, self.actuators], axis=1)])

    @property
    def B(self) -> Float[Array, "x input"]:
        """The matrix by which it follows a command held for the step."""
        return jnp.concatenate([self.driven @ self.commanded, self.commanded])

    @property
    def C(self) -> Float[Array, "y x"]:
        """The matrix by which what is observed follows a state."""
        return jnp.concatenate([self.observed_arm, self.observed_actuators], axis=1)


class Chart:
    """Coordinates of the states near a given one.

    Parameters
    ----------
    system
        The arm.
    state
        The state whose coordinates are those that it has; others differ from it.
    """

    def __init__(self, system: System, state: State) -> None:
        self.system, self.state = system, state
        self.actuators, self._shaped = numbers_of((state.servo, *state.actuators))

    @property
    def arm(self) -> Coordinates:
        """The coordinates of the arm at the state itself."""
        return self.read(self.state)[0]

    def read(self, state: State) -> tuple[Coordinates, Following]:
        """Return the coordinates of the arm and of the actuators at a state nearby."""
        rows, forces = state.motion.position, self._forces(state.servo, state.actuators)
        frames = self.state.frames
        if frames is not None:  # directors tell more than spins, which say nothing of the way
            assert state.motion.orientation is not None
            nodes = forces.nodes(rows)
            now = tangents(nodes)
            carried = transport(frames.director, frames.tangent, now)
            director = state.motion.orientation.director
            spin = frames.spin + angle_between(carried, director, now)
            rows = rows.at[: nodes.shape[0], 3].set(spin)
        before, attitude = self.state.attitude, state.attitude
        if before is not None:  # likewise attitudes more than turns
            assert attitude is not None
            turn = turn_of(product(before.T, attitude))
            turned = self.state.motion.position[-1, : turn.size] + turn
            rows = rows.at[-1, : turn.size].set(turned)
        motion, at = state.motion, self._entries
        parts = (rows, motion.velocity, motion.acceleration, state.ahead)
        arm = jnp.concatenate([part.reshape(-1)[at] for part in parts])
        return arm, numbers_of((state.servo, *state.actuators))[0]

    def at(self, arm: Coordinates, actuators: Following) -> State:
        """Return the state nearby that has these coordinates."""
        system, state, motion = self.system, self.state, self.state.motion
        servo, *others = self._shaped(actuators)
        forces = self._forces(servo, others)
        known = (motion.position, motion.velocity, motion.acceleration, state.ahead)
        at, shape = self._entries, motion.position.shape
        position, velocity, acceleration, ahead = (
            rows.reshape(-1).at[at].set(part, unique_indices=True).reshape(shape)
            for rows, part in zip(known, arm.reshape(len(known), at.size), strict=True)
        )
        one, zero = jnp.ones(()), jnp.zeros(())
        stage = Stage(state.time, position, velocity, acceleration, one, zero, zero, state.frames)
        stage = prescribed(forces, system.base, stage, state, servo, zero)
        none = jnp.zeros_like(position)
        moved = forces.motion(stage, none, forces.surroundings(stage, none))
        return State(
            motion=moved,
            ahead=ahead,
            servo=servo,
            actuators=tuple(others),
            reaction=forces.residual(moved)[0][:HELD],
            gap=forces.gaps(moved.position),
            earlier=state.earlier,
            guessed=state.guessed,
            kept=state.kept,
            attitude=forces.attitude(moved),
            grip=state.grip,
        )

    def driven(self, actuators: Following) -> list[Any]:
        """Return the states of the actuators, the base's servos first."""
        return list(self._shaped(actuators))

    @property
    def _entries(self) -> Int[np.ndarray, " entry"]:
        """Which entries of all rows, one after the other, a step solves for."""
        forces, rows = self.system.forces, self.state.motion.position
        moves, nodes = np.zeros(rows.shape, bool), forces.nodes(rows).shape[0]
        moves[HELD:nodes] = True
        moves[nodes + np.array(forces.free, int), : forces.axes] = True
        if forces.vehicle is not None:
            moves[-ROWS:].reshape(-1)[list(unknowns(forces.axes, rows.shape[1]))] = True
        return np.flatnonzero(moves)

    def _forces(self, servo: Any, actuators: Sequence[Any]) -> Forces:
        system, state = self.system, self.state
        forces = system.forces.driven(drives(system.actuators, actuators))
        forces = holding(forces, state.grip)
        return start.mounted(forces, system.base, state.time, servo, state)


def transition(
    system: System,
    state: State,
    command: Float[Array, " input"],
    step: Float[Array, ""],
    observe: Observe,
) -> Transition:
    """Linearise a time step about the one from ``state`` under ``command``.

    Exact: what `crinoid.System.step` does to small changes, whatever the integrator.
    """
    followers = system.followers
    before = Chart(system, state)
    at_start = before.driven(before.actuators)
    ends = followed(followers, at_start, command, step)
    after = Chart(system, system.moved(state, ends, step)[0])
    nodes = system.forces.nodes(state.motion.position).shape[0]
    water = jnp.zeros((2, nodes, system.forces.axes))

    def move(arm: Array, held: Array, driven: Array, water: Array) -> Array:
        end = system.moved(before.at(arm, held), after.driven(driven), step, Stir(*water))[0]
        return after.read(end)[0]

    def follow(actuators: Array, command: Array) -> Array:
        ends = followed(followers, before.driven(actuators), command, step)
        return numbers_of(tuple(ends))[0]

    def see(arm: Array, actuators: Array) -> Array:
        return observe(system, before.at(arm, actuators))

    at = (before.arm, before.actuators)
    arm, held, driven, stirred = _slopes(move, (*at, after.actuators, water))
    actuators, commanded = _slopes(follow, (before.actuators, command))
    return Transition(
        arm, held, driven, stirred[:, 0], stirred[:, 1], actuators, commanded, *_slopes(see, at)
    )


def _slopes(function: Callable[..., Array], at: tuple[Array, ...]) -> list[Array]:
    """Return the derivatives of a function by each of its arguments."""
    _, along = jax.linearize(function, *at)
    flat, shaped = ravel_pytree(at)
    columns = jax.vmap(lambda change: along(*shaped(change)))(jnp.eye(flat.size))
    sizes = [part.size for part in at]
    ends = [sum(sizes[: index + 1]) for index in range(len(at) - 1)]
    parts = jnp.split(columns.T, ends, axis=1)
    return [part.reshape(-1, *each.shape) for part, each in zip(parts, at, strict=True)]


def numbers_of(
    followers: tuple[Any, ...],
) -> tuple[Following, Callable[[Following], tuple[Any, ...]]]:
    """Return the numbers among the states of actuators, and how to put others in their place."""
    numbers, rest = eqx.partition(followers, eqx.is_inexact_array)
    flat, shaped = ravel_pytree(numbers)
    return flat, lambda other: eqx.combine(shaped(other), rest)
