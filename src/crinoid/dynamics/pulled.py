"""Static equilibrium of an arm whose tendons rub in their channels.

With Coulomb friction an arm has many equilibria. This one is that of an arm whose drives rose from
0, in one go: each tendon slid along its whole length, from the arm at rest under its other loads.
The tension then falls along a tendon by the angle that it turns (`crinoid.elements.Threads`), and
the shape depends on the tension: a fixed point. Newton's method finds the shape for the friction of
the shape before, again and again. Friction at a place depends on the angle before it, so the error
falls like a power over its factorial (Picard's iteration of a Volterra equation).
"""

from dataclasses import replace
from operator import itemgetter

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.dynamics import statics
from crinoid.dynamics.arm import Memory
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.newton import Balance, ReusedTangent, Settings, solve
from crinoid.dynamics.outcome import Outcome
from crinoid.elements import Threads
from crinoid.numerics.frames import Frames
from crinoid.rod.reference import Reference

Rows = Float[Array, "rows b"]

_ROUNDS = 16
"""Number of solves with friction; a fixed one, so that both modes of differentiation apply."""
_SETTLED = 1e-7
"""Largest displacement of the last of them, over the arm's length."""


def find(
    reference: Reference,
    forces: Forces,
    settings: Settings,
    time: Float[Array, ""],
    start: Rows,
    frames: Frames | None,
) -> tuple[Forces, Rows, Frames | None, Outcome]:
    """Find a stable equilibrium of an arm, and its forces with the friction of tendons there.

    The arguments are those of `crinoid.dynamics.statics.find`, in a flow that is not yet frozen.
    """
    frozen = forces.frozen(time)
    if not any(isinstance(each, Threads) and each.friction is not None for each in forces.elements):
        return forces, *statics.find(reference, frozen, settings, time, start, frames)
    assert forces.drive is not None

    def under(drive: Float[Array, " drive"]) -> tuple[Rows, Frames | None, Outcome]:
        loaded = frozen.driven(drive)
        return statics.find(reference, loaded, settings, time, start, frames)

    drives = jnp.stack([jnp.zeros_like(forces.drive), forces.drive])
    unloaded, loaded = (
        jax.tree.map(lambda x, k=k: x[k], jax.lax.map(under, drives)) for k in (0, 1)
    )
    slack = _memory(frozen, time, *unloaded[:2])
    careful = statics.careful(frozen, settings)
    none, no_tangent = jnp.zeros_like(start), ReusedTangent.none(forces, start)
    Shape = tuple[Rows, Frames | None]

    def follow(shape: Shape, _: None) -> tuple[Shape, tuple[Outcome, Array]]:
        position, frames = shape
        rubbing = _slid(frozen, slack, _memory(frozen, time, position, frames))
        stage = statics.static_stage(time, position, frames)
        around = rubbing.surroundings(stage, none)
        correction, _, outcome, _ = solve(
            Balance(rubbing, around, stage), none, careful, no_tangent
        )
        position = position + correction
        if frames is not None:
            nodes = forces.nodes(position)
            frames = jax.lax.stop_gradient(Frames.of(nodes, frames.at(nodes)))
        moved = jnp.max(jnp.abs(correction[:, : forces.axes]))
        return (position, frames), (outcome, moved)

    (position, frames), (outcomes, moved) = jax.lax.scan(follow, loaded[:2], None, length=_ROUNDS)
    outcome = jax.tree.map(itemgetter(-1), outcomes)
    settled = (
        loaded[2].converged & unloaded[2].converged & (moved[-1] < _SETTLED * reference.length)
    )
    outcome = replace(outcome, converged=outcome.converged & settled)
    return _slid(forces, slack, _memory(frozen, time, position, frames)), position, frames, outcome


def _memory(forces: Forces, time: Array, position: Rows, frames: Frames | None) -> Memory:
    return forces.memory_at_start(statics.static_motion(forces, time, position, frames))


def _slid(forces: Forces, before: Memory, now: Memory) -> Forces:
    """Return the forces with the friction of threads that slid from one shape to another."""
    elements = tuple(
        each.slid(one, other) if isinstance(each, Threads) and one is not None else each
        for each, one, other in zip(forces.elements, before, now, strict=True)
    )
    return replace(forces, elements=elements)
