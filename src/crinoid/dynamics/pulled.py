"""Static equilibrium of an arm whose tendons rub in their channels.

With Coulomb friction an arm has many equilibria. This one is that of an arm whose drives rose from
0, in one go: each tendon slid along its whole length, from the arm at rest under its other loads.
The tension then falls along a tendon by the angle that it turns (`crinoid.elements.Threads`), and
the shape depends on the tension: a fixed point. Newton's method finds the shape for the friction of
the shape before, again and again. Friction at a place depends on the angle before it, so the error
falls like a power over its factorial (Picard's iteration of a Volterra equation).

An arm that follows changing loads has one of them: its tendons slide and stick on the way, as in
time steps that are infinitely long.
"""

from dataclasses import replace
from operator import itemgetter

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.dynamics import statics
from crinoid.dynamics.acting import ActingForces
from crinoid.dynamics.balance import Balance
from crinoid.dynamics.context import Context, Memory
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.newton import ReusedTangent, Settings, solve
from crinoid.dynamics.outcome import Outcome
from crinoid.dynamics.rows import Rows
from crinoid.elements import Threads
from crinoid.foundation.fixed_numbers import ADHESION, FRICTION_ROUNDS, FRICTION_SETTLED, LOAD_STEPS
from crinoid.numerics.frames import Frames
from crinoid.rod.reference import Reference

Way = tuple[Forces, Context]


def find(
    reference: Reference,
    forces: Forces,
    context: Context,
    settings: Settings,
    time: Float[Array, ""],
    start: Rows,
    frames: Frames | None,
) -> tuple[ActingForces, Rows, Frames | None, Outcome]:
    """Find a stable equilibrium of an arm, and its forces with the friction of tendons there.

    The arguments are those of `crinoid.dynamics.statics.find`, in a flow that is not yet frozen.
    """
    still = context.at_rest(time)
    frozen = ActingForces.of(forces, still)
    if not _rubs(forces):
        found = statics.find(reference, frozen, settings, time, start, frames)
        return ActingForces.of(forces, context), *found
    assert context.drive is not None

    def under(drive: Float[Array, " drive"]) -> tuple[Rows, Frames | None, Outcome]:
        loaded = ActingForces.of(forces, replace(still, drive=drive))
        return statics.find(reference, loaded, settings, time, start, frames)

    drives = jnp.stack([jnp.zeros_like(context.drive), context.drive])
    both = jax.lax.map(under, drives)
    unloaded, loaded = (jax.tree.map(itemgetter(k), both) for k in (0, 1))
    slack = _memory(frozen, time, *unloaded[:2])
    careful = statics.careful(frozen, settings)
    Shape = tuple[Rows, Frames | None]

    def follow(shape: Shape, _: None) -> tuple[Shape, tuple[Outcome, Array]]:
        position, frames = shape
        rubbing = _slid(frozen, slack, _memory(frozen, time, position, frames))
        correction, outcome = _balanced(rubbing, careful, time, position, frames)
        position = position + correction
        moved = jnp.max(jnp.abs(correction[:, : forces.axes]))
        return (position, _moved(rubbing, position, frames)), (outcome, moved)

    (position, frames), (outcomes, moved) = jax.lax.scan(
        follow, loaded[:2], None, length=FRICTION_ROUNDS
    )
    outcome = jax.tree.map(itemgetter(-1), outcomes)
    outcome = _judged(outcome, moved[-1], FRICTION_SETTLED * reference.length)
    found = outcome.converged & loaded[2].converged & unloaded[2].converged
    outcome = replace(outcome, converged=found)
    slid = _slid(ActingForces.of(forces, context), slack, _memory(frozen, time, position, frames))
    return slid, position, frames, outcome


def follow(
    reference: Reference,
    way: tuple[Way, Way],
    settings: Settings,
    time: Float[Array, ""],
    starts: tuple[Rows, Rows],
    frames: Frames | None,
    memory: Memory,
) -> tuple[ActingForces, Rows, Frames | None, Outcome]:
    """Find the equilibrium that an arm reaches while its loads change slowly.

    Where tendons rub it is known to the sliding within which their friction develops.

    On the ``way`` are the forces before and after, with their contexts, which differ in numbers.
    ``starts`` are the shape before, and the same with the base and the obstacles as they are after
    (m); ``memory`` is that of the elements before.
    """
    before, after = ((forces, context.at_rest(time)) for forces, context in way)
    if not _rubs(after[0]):
        still = ActingForces.of(*after)
        found = statics.find(reference, still, settings, time, starts[1], frames, follows=True)
        return ActingForces.of(*way[1]), *found
    at_end = ActingForces.of(*after)
    careful = statics.careful(at_end, settings)
    one = jnp.ones(())
    moved_base = starts[1] - starts[0]
    Shape = tuple[Rows, Frames | None, Memory]

    def advance(shape: Shape, share: tuple[Array, Array]) -> tuple[Shape, None]:
        old, frames, memory = shape
        at, gone = share
        position = old + gone * moved_base
        forces, context = jax.tree.map(
            lambda a, b: jnp.where(a == b, b, a + at * (b - a)), before, after
        )
        rubbing = ActingForces.of(forces, context.remembering(memory, one))
        correction, outcome = _balanced(rubbing, careful, time, position, frames)
        found = _settled(rubbing, time, position + correction, frames)
        failed = (position, frames, memory)
        return jax.tree.map(lambda x, y: jnp.where(outcome.converged, x, y), found, failed), None

    def approach(shape: Shape, shares: tuple[Array, Array]) -> tuple[Shape, tuple[Outcome, Array]]:
        (position, frames, memory), _ = jax.lax.scan(advance, shape, shares)
        # out of unstable shapes, and to those that no small step reaches
        rubbing = ActingForces.of(after[0], after[1].remembering(memory, one))
        there = statics.find(reference, rubbing, settings, time, position, frames, follows=True)
        shape = _settled(rubbing, time, *there[:2])
        moved = jnp.max(jnp.abs((there[0] - position)[:, : at_end.axes]))
        return shape, (there[2], moved)

    on_the_way = jnp.arange(1, LOAD_STEPS + 1) / LOAD_STEPS, jnp.full(LOAD_STEPS, 1 / LOAD_STEPS)
    at_the_end = jnp.ones(LOAD_STEPS), jnp.zeros(LOAD_STEPS)
    begin = (starts[0], frames, _of_threads(before[0], memory))
    (position, frames, memory), (outcomes, moved) = jax.lax.scan(
        approach, begin, jax.tree.map(lambda *each: jnp.stack(each), on_the_way, at_the_end)
    )
    outcome = jax.tree.map(itemgetter(-1), outcomes)
    outcome = _judged(outcome, moved[-1], ADHESION * reference.length)
    forces, context = way[1]
    slid = ActingForces.of(forces, context.remembering(memory, jnp.zeros(())))
    return slid, position, frames, outcome


def _judged(outcome: Outcome, moved: Float[Array, ""], most: Float[Array, ""]) -> Outcome:
    """Return the outcome of an equilibrium from the last movement (m) and the largest valid one."""
    error = jnp.where(outcome.converged & (moved >= most), moved, 0.0)
    return replace(outcome, converged=outcome.converged & (moved < most), error=error)


def _rubs(forces: Forces) -> bool:
    return any(isinstance(each, Threads) and each.friction is not None for each in forces.elements)


def _of_threads(forces: Forces, memory: Memory) -> Memory:
    """Return the memory of threads alone: other elements have forgotten all when they rest."""
    pairs = zip(forces.elements, memory, strict=True)
    return tuple(held if isinstance(each, Threads) else None for each, held in pairs)


def _balanced(
    forces: ActingForces, settings: Settings, time: Array, position: Rows, frames: Frames | None
) -> tuple[Rows, Outcome]:
    """Return the correction of a shape that balances the forces (m), and its outcome."""
    stage, none = statics.static_stage(time, position, frames), jnp.zeros_like(position)
    balance = Balance(forces, forces.surroundings(stage, none), stage)
    correction, _, outcome, _ = solve(balance, none, settings, ReusedTangent.none(forces, none))
    return correction, outcome


def _moved(forces: Forces, position: Rows, frames: Frames | None) -> Frames | None:
    """Return the frames of a new shape."""
    if frames is None:
        return None
    nodes = forces.nodes(position)
    return jax.lax.stop_gradient(Frames.of(nodes, frames.at(nodes)))


def _settled(
    forces: ActingForces, time: Array, position: Rows, frames: Frames | None
) -> tuple[Rows, Frames | None, Memory]:
    """Return a new shape, its frames, and the memory of the threads that slid there."""
    frames = _moved(forces, position, frames)
    motion = statics.static_motion(forces, time, position, frames)
    return position, frames, _of_threads(forces, forces.arm.memory_after(motion))


def _memory(forces: ActingForces, time: Array, position: Rows, frames: Frames | None) -> Memory:
    return forces.arm.memory_at_start(statics.static_motion(forces, time, position, frames))


def _slid(forces: ActingForces, before: Memory, now: Memory) -> ActingForces:
    """Return the forces with the friction of threads that slid from one shape to another."""
    held = tuple(
        (each.slid(one, other), None) if isinstance(each, Threads) and one is not None else kept
        for each, kept, one, other in zip(forces.elements, forces.held, before, now, strict=True)
    )
    return replace(forces, held=held)
