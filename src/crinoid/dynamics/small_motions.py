"""Linearisation about a shape at rest: stiffness, damping, mass, and influence of the inputs."""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.base import Base
from crinoid.dynamics import statics
from crinoid.dynamics.acting import ActingForces
from crinoid.dynamics.context import Context
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.dynamics.state import State, tip_pose
from crinoid.dynamics.tangent import LineStiffness, Tangent
from crinoid.dynamics.tangent_assembly import assemble_tangent
from crinoid.numerics import banded
from crinoid.numerics.small_matrices import product


class Influence(NamedTuple):
    """Influence of small changes of the inputs on the boundary and the loads. SI units."""

    held: Float[Array, "2 b channel"]
    """Displacement of the ghost node and the root per change of each channel of the base."""
    loads: Float[Array, "n b drive"]
    """Forces on the nodes per change of each drive of the other actuators."""
    tip: Float[Array, "pose 3 d"]
    """Derivative of the tip's pose by the last three nodes."""
    lines: LineStiffness | None = None
    """Stiffness of tendons of given length and of closed chambers, if there are any."""

    def static(self, stiffness: banded.Bands) -> Float[Array, "pose input"]:
        """Return the derivative of the tip's pose by inputs that change slowly."""
        moved = jnp.pad(self.held, ((0, self.loads.shape[0] - BOUNDARY_NODES), (0, 0), (0, 0)))
        forced = -jax.vmap(lambda column: banded.matvec(stiffness, column), -1, -1)(moved)
        forced = jnp.concatenate([forced, self.loads], axis=-1)
        nodes = jnp.concatenate([moved, jnp.zeros_like(self.loads)], axis=-1)
        if self.lines is None:
            free = banded.solve(stiffness[BOUNDARY_NODES:], forced[BOUNDARY_NODES:])
            nodes = jnp.concatenate([nodes[:BOUNDARY_NODES], free])
        else:
            loads = jnp.einsum("lnb,nbc->lc", self.lines.follow, moved)
            taut = -jnp.einsum("nbl,lc->nbc", self.lines.pull, loads)
            forced = forced.at[..., : moved.shape[2]].add(taut)
            tangent = Tangent(stiffness, None, ()).coupled(self.lines)
            nodes += jax.vmap(tangent.solve, -1, -1)(forced)
        last = nodes[-self.tip.shape[1] :, : self.tip.shape[2]]
        return jnp.sum(self.tip[..., None] * last, axis=(1, 2))


def influence(base: Base, forces: Forces, state: State) -> Influence:
    """Return the influence of the inputs about ``state``, taken as still."""
    pose, _, _ = base.pose(state.time, state.servo)
    none = jnp.zeros_like(pose)
    held = jax.vmap(lambda rate: base.moving(pose, rate, none).velocity, out_axes=-1)(
        jnp.eye(pose.size)
    )
    if state.attitude is not None:
        axes = forces.axes
        held = held.at[:, :axes].set(product(state.attitude, held[:, :axes]))
    rows = state.motion.position
    stage, none = statics.static_stage(state.time, rows, state.frames), jnp.zeros_like(rows)
    context = state.context.at_rest(state.time)
    acting = ActingForces.of(forces, context)
    around = acting.surroundings(stage, none)

    def balance(drive: Array) -> Float[Array, "n b"]:
        driven = ActingForces.of(forces, replace(context, drive=drive))
        motion = driven.motion(stage, none, around)
        return -driven.nodes(driven.residual(motion)[0])

    loads = jnp.zeros((*forces.nodes(rows).shape, 0))
    if context.drive is not None:
        loads = jax.jacfwd(balance)(context.drive)
    lines = None
    if forces.lines is not None or forces.far_contacts:
        lines = assemble_tangent(acting, stage, acting.motion(stage, none, around), around).of_lines
    return Influence(held, loads, jax.jacfwd(tip_pose)(state.position[-3:]), lines)


class SmallMotions(NamedTuple):
    """Stiffness, damping and mass of small motions of all nodes about a shape at rest."""

    stiffness: banded.Bands
    """N/m, and of spins N m."""
    mass: banded.Bands
    """Mass including the added mass (kg)."""
    stiffness_in_current: banded.Bands
    """Stiffness in a steady current, whose drag changes as the arm turns (N/m)."""
    damping_in_current: banded.Bands
    """Damping of the material and slope of the quadratic drag in that current (N s/m)."""
    stiffness_in_still_water: banded.Bands
    damping_in_still_water: banded.Bands
    elastic: banded.Bands | None
    """Stiffness of a material with Maxwell branches, relaxed and without loads and tension."""


def linearise(laws: Forces, state: State, current: Float[Array, " d"]) -> SmallMotions:
    """Linearise the forces on the nodes about the shape of a state, taken as still.

    Three flows: the one at its time, a steady ``current`` (m/s) past the same shape, and still
    water. Obstacles keep their places.
    """
    time, position, frames = state.time, state.motion.position, state.frames
    context = state.context.at_rest(time)
    forces = ActingForces.of(laws, context)
    zero = jnp.zeros_like(position)

    def tangent(by: Float[Array, "3"], steady: Bool[Array, ""], speed: Array) -> banded.Bands:
        stage = StepMap(time, position, zero, zero, by[0], by[1], by[2], frames)
        around = forces.surroundings(stage, zero)
        flows = jnp.where(steady, speed * current, around.velocity)
        slope = jnp.where(steady, 0.0, around.velocity_slope)
        around = replace(around, velocity=flows, velocity_slope=slope)
        return assemble_tangent(forces, stage, forces.motion(stage, zero, around), around).bands

    of = jnp.eye(3)[jnp.array([0, 2, 0, 1, 0, 1])]
    steady = jnp.array([False, False, True, True, True, True])
    speed = jnp.array([0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    # sequential, so that the tangent is compiled once
    found = jax.lax.map(lambda one: tangent(*one), (of, steady, speed))
    return SmallMotions(*found, elastic=_elastic(laws, context, state, found[0]))


def _elastic(
    laws: Forces, context: Context, state: State, relaxed: banded.Bands
) -> banded.Bands | None:
    """Return the stiffness of the material alone, if it has Maxwell branches.

    At first these resist a deformation by the sum of their ratios times that stiffness.
    """
    stretch, zero = laws.stretch, jnp.zeros_like(state.motion.position)
    if stretch is None or stretch.material.relaxation is None:
        return None
    stage = statics.static_stage(state.time, state.motion.position, state.frames)
    forces = ActingForces.of(laws, context)
    around = forces.surroundings(stage, zero)
    motion = forces.motion(stage, zero, around)
    memory = zip(forces.elements, forces.arm.memory_at_start(motion), strict=True)
    strained = tuple(held if hasattr(one, "material") else None for one, held in memory)
    at_once = ActingForces.of(laws, context.remembering(strained, jnp.zeros(())))
    strained_motion = at_once.motion(stage, zero, around)
    more = assemble_tangent(at_once, stage, strained_motion, around).bands - relaxed
    return more / jnp.sum(stretch.material.relaxation[0, 0])
