"""Time step: the state at its end, whether that is accepted, and substeps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.actuation import drives
from crinoid.dynamics.acting import ActingForces
from crinoid.dynamics.balance import Balance
from crinoid.dynamics.newton import solve
from crinoid.dynamics.outcome import MIN_COSINE, Outcome, StepStatistics, cos_turn_angle
from crinoid.dynamics.rows import BOUNDARY_NODES, Rows
from crinoid.dynamics.start import at_end, expected_acceleration, first_guess
from crinoid.dynamics.state import State
from crinoid.foundation.fixed_numbers import ERROR_GROWTH

if TYPE_CHECKING:
    from crinoid.dynamics.system import System


def step_with(
    system: System,
    state: State,
    ends: Sequence[Any],
    step: Float[Array, ""],
    water: Float[Array, "2 rows d"] | None = None,
) -> tuple[State, Outcome]:
    """Advance by one time step at whose end the actuators are in the states ``ends``.

    ``water`` is a change of its velocity (m/s) and material acceleration (m/s2) at all rows, at the
    end of the step.
    """
    h, before, method = step, state.motion, system.integrator
    servo, *actuators = ends
    grip = None
    if system.grip_triggers is not None:
        obstacles = system.forces.obstacles
        grip = system.grip_triggers.after(obstacles, state.grip, state.gap, state.time)
    stage = method.stage(before, state.auxiliary_offset, h, state.frames)
    context = replace(state.context, drive=drives(system.actuators, actuators), step=h, grip=grip)
    forces, held, stage = at_end(system.forces, system.base, servo, context, stage, state, h)

    def correction_for(acceleration: Rows) -> Rows:
        free = method.correction(acceleration, h)[BOUNDARY_NODES:]  # the others are prescribed
        return jnp.pad(free, ((BOUNDARY_NODES, 0), (0, 0)))

    # the water is costly: evaluated once, for constant acceleration, and expanded from there.
    # Not at Newton's guess: a switch between predictors would make the step discontinuous
    around = forces.surroundings(stage, correction_for(before.acceleration))
    if water is not None:
        velocity, acceleration = around.velocity + water[0], around.acceleration + water[1]
        around = replace(around, velocity=velocity, acceleration=acceleration)
    guess = correction_for(expected_acceleration(forces, state))
    if held is not None:
        guess = first_guess(forces, held, stage, state, guess)
    correction, reaction, outcome, reused_tangent = solve(
        Balance(forces, around, stage), guess, system.settings, state.reused_tangent
    )
    motion = forces.motion(stage, correction, around)
    after = replace(
        State.of(forces, motion, reaction, ends, forces.arm.memory_after(motion)),
        auxiliary_offset=method.auxiliary_offset(
            before.acceleration, state.auxiliary_offset, motion.acceleration, h
        ),
        acceleration_history=jnp.concatenate(
            [before.acceleration[None], state.acceleration_history[:-1]]
        ),
        predictor_accepted=outcome.iterations == 0,
        reused_tangent=jax.lax.stop_gradient(reused_tangent),
    )
    return after, _judged(system, forces, state, after, outcome, h)


def _judged(
    system: System, forces: ActingForces, state: State, after: State, outcome: Outcome, step: Array
) -> Outcome:
    """Return the outcome of a step, rejected for a fold, a large error or a contact too fast.

    On entry ``outcome`` is that of Newton's method.
    """
    before, now = state.motion, after.motion
    folded = jnp.any(cos_turn_angle(forces, now.position) < MIN_COSINE)
    errors = system.integrator.error(before.acceleration, now.acceleration, step)
    errors = jax.lax.stop_gradient(forces.unknown(errors, forces.reach)[:, : forces.axes])
    largest = jnp.sqrt(jnp.max(jnp.sum(errors**2, axis=1)))
    error = jnp.where(outcome.converged, largest, 0.0)
    good = outcome.converged & ~folded & (error <= system.max_error)
    resolved = ~good | _resolved(forces, state, after, step)
    good &= resolved
    return replace(outcome, converged=good, resolved=resolved, folded=folded, error=error)


def _resolved(forces: ActingForces, state: State, after: State, step: Array) -> Bool[Array, ""]:
    """Return whether a step from one state to another resolves all contacts."""
    moved = after.motion.position - state.motion.position
    far = zip(forces.far_contacts, state.far_gaps, after.far_gaps, strict=True)
    found = [each.resolved(moved, gap, closer, step) for each, gap, closer in far]
    if (obstacles := forces.obstacles) is not None:
        assert state.gap is not None
        assert after.gap is not None
        gaps = map(obstacles.by_contact, (state.gap, after.gap))
        each = [*zip(forces.near_contacts(moved), *gaps, strict=True)]
        if (bodies := obstacles.bodies) is not None:
            assert state.body_gap is not None
            assert after.body_gap is not None
            gaps = map(bodies.by_contact, (state.body_gap, after.body_gap))
            each += zip(forces.body_contacts(moved), *gaps, strict=True)
        found += [group.resolved(moved, *gap, step) for group, *gap in each]
    return jnp.all(jnp.array(found, bool))


def halve(
    system: System,
    once: Callable[[Any, Array], tuple[Any, Outcome]],
    state: Any,
    length: float | Array | None,
    before: StepStatistics | None,
) -> tuple[Any, StepStatistics]:
    """Advance a state, any pytree, by one time step or ``length`` (s), in substeps where it fails.

    ``once`` advances it by a substep. The statistics of its solves add to those ``before``, if any.
    The shortest substep is ``2**-max_halvings`` of the length; if it fails too, the last good state
    comes back with a failed outcome. A substep is doubled again where the longer one is expected
    to keep within ``max_error``.
    """
    length = system.time_step if length is None else jnp.asarray(length, float)
    before = before or StepStatistics.of_nothing()
    whole = 2**system.max_halvings  # length of the step in units of the shortest substep

    Carry = tuple[Any, StepStatistics, Array, Array]

    def unfinished(carry: Carry) -> Bool[Array, ""]:
        _, _, done, part = carry
        return (done < whole) & (part > 0)

    def attempt(carry: Carry) -> Carry:
        state, progress, done, part = carry
        new, outcome = once(state, length * (part / whole))
        good = outcome.converged
        accepted = jax.lax.cond(good, lambda: new, lambda: state)
        done = done + jnp.where(good, part, 0)
        # after a success double the substep, if the time reached is a multiple of the longer one
        room = ERROR_GROWTH * outcome.error <= system.max_error
        longer = jnp.where((done % (2 * part) == 0) & (part < whole) & room, 2 * part, part)
        part = jnp.where(good, longer, part // 2)
        return accepted, progress.with_solve(outcome), done, part

    unsolved = replace(before, outcome=Outcome.of_nothing(converged=False))
    state, progress, _, _ = jax.lax.while_loop(
        unfinished, attempt, (state, unsolved, jnp.asarray(0), whole)
    )
    return state, progress
