"""Prescribed motion: the rows that a step does not solve for, held by the base or led."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from crinoid.base import Base, ServoState
from crinoid.chain import begun_with, widened
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.state import State


def prescribed(
    forces: Forces, base: Base, stage: Stage, state: State, servo: ServoState, step: Array
) -> Stage:
    """Return the stage with the motion of the held nodes and the led obstacles set.

    Nodes that a vehicle holds, which floats, are not prescribed.

    The stage is that of a step of given length (s) from ``state``, with the servo at its end.
    """
    rows: tuple[Array, ...] = (stage.position, stage.velocity, stage.acceleration)
    width = stage.position.shape[1]
    if forces.mount is None:  # which carries them along otherwise
        held = base.prescribe(stage.time, servo)
        position = held.position
        if held.frame is not None:
            frames = stage.frames
            assert frames is not None
            spin = frames.spin_to(1, held.frame[0], held.frame[1])
            position = jnp.c_[position, jnp.stack([jnp.zeros(()), spin])]
        given = (position, held.velocity, held.acceleration)
        rows = tuple(begun_with(value, row) for row, value in zip(rows, given, strict=True))
    obstacles = forces.obstacles
    if obstacles is not None:
        first = forces.nodes(stage.position).shape[0]
        water = state.motion.flow_velocity[first : first + obstacles.count]
        led, velocity = obstacles.lead(
            state.obstacle_position,
            water,
            lambda points: forces.flow_velocity(points, stage.time),
            step,
        )
        values = (led, velocity, jnp.zeros_like(led))
        at = first + obstacles.led
        rows = tuple(
            row.at[at].set(widened(value[obstacles.led], width), unique_indices=True)
            for row, value in zip(rows, values, strict=True)
        )
    return eqx.tree_at(lambda s: (s.position, s.velocity, s.acceleration), stage, rows)
