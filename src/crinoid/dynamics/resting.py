"""States of an arm at rest: without load, in equilibrium, or on the branch of an equilibrium."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import drives
from crinoid.dynamics import pulled, start
from crinoid.dynamics.acting import ActingForces
from crinoid.dynamics.context import Context
from crinoid.dynamics.outcome import Outcome
from crinoid.dynamics.rows import BOUNDARY_NODES, Rows
from crinoid.dynamics.state import State
from crinoid.dynamics.statics import static_motion
from crinoid.numerics.frames import Frames

if TYPE_CHECKING:
    from crinoid.dynamics.system import System

Time = Float[Array, ""]
Undeformed = tuple[ActingForces, Time, Rows, Frames | None]


def undeformed(system: System, time: Time) -> Undeformed:
    """Return the forces with actuators at rest, the time, and the undeformed shape then."""
    forces = ActingForces.of(system.forces, _context(system))
    return forces, time, *start.undeformed(system.reference, system.base, forces, time)


def undeformed_state(system: System, time: Time) -> State:
    """Return the undeformed arm, clamped to the base."""
    return state_at_rest(system, *undeformed(system, time))


def clearance(system: System, time: Time) -> Float[Array, " m"]:
    """Return the distance of each obstacle from the undeformed arm (m)."""
    forces, _, rows, _ = undeformed(system, time)
    gaps = forces.gaps(rows)
    return jnp.zeros(0) if gaps is None else jnp.min(gaps, axis=1)


def find_equilibrium(system: System, time: Time) -> tuple[State, Outcome]:
    """Find the static equilibrium at a time; the outcome says whether there is one."""
    _, _, rows, frames = undeformed(system, time)
    rows = start.with_clamp_spin(system.base, time, rows, frames)
    forces, position, frames, outcome = pulled.find(
        system.reference, system.forces, _context(system), system.settings, time, rows, frames
    )
    return state_at_rest(system, forces, time, position, frames), outcome


def follow_equilibrium(system: System, before: System, state: State) -> tuple[State, Outcome]:
    """Find the equilibrium that an arm reaches while numbers change slowly to those of a system.

    It starts from an equilibrium ``state`` of the system ``before`` with other numbers, and keeps
    to its branch: past a limit point the arm snaps to the next equilibrium. The outcome says
    whether there is one.
    """
    shape, frames = state.motion.position, state.frames
    nodes = system.forces.num_nodes(shape)
    free = np.r_[BOUNDARY_NODES:nodes, system.forces.free_rows]

    def placed(one: System) -> Rows:
        rows = start.with_clamp_spin(one.base, state.time, undeformed(one, state.time)[2], frames)
        return rows.at[free].set(shape[free])

    forces, position, frames, outcome = pulled.follow(
        system.reference,
        ((before.forces, _context(before)), (system.forces, _context(system))),
        system.settings,
        state.time,
        (placed(before), placed(system)),
        frames,
        state.memory,
    )
    return state_at_rest(system, forces, state.time, position, frames), outcome


def stand(system: System, state: State) -> State:
    """Return the same shape without motion, in the flow frozen at its time."""
    forces = ActingForces.of(system.forces, state.context.at_rest(state.time))
    motion = static_motion(forces, state.time, state.motion.position, state.frames)
    reaction = forces.residual(motion)[0][:BOUNDARY_NODES]
    memory, followers = forces.arm.memory_at_start(motion), (state.servo, *state.actuators)
    return replace(
        State.of(forces, motion, reaction, followers, memory),
        attitude=state.attitude,
        reused_tangent=state.reused_tangent,
    )


def state_at_rest(
    system: System, forces: ActingForces, time: Time, position: Rows, frames: Frames | None
) -> State:
    """Return the state of a shape that moves rigidly with the base, in dynamic balance."""
    followers = [one.at_rest() for one in system.followers]
    state = start.begin(forces, system.base, followers, time, position, frames)
    triggers = system.grip_triggers
    return state if triggers is None else replace(state, grip=triggers.begin())


def _context(system: System) -> Context:
    """Return the context of the forces with actuators at rest."""
    return Context(drives(system.actuators, [each.at_rest() for each in system.actuators]))
