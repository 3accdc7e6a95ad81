"""LQG control: state feedback on what an observer makes of the readings."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.braking import Braking
from crinoid.control.controller import Controller
from crinoid.control.observer import Observer, ObserverState
from crinoid.control.seen import Command, Seen
from crinoid.control.target import pose_error
from crinoid.products import product


_SWEEPS = 20
"""Times that each input is gone through to find the best moves within limits."""


class Course(eqx.Module):
    """How arm, actuators and commands would move with the target, if nothing disturbed them."""

    estimate: Float[Array, " z"]
    actuators: Float[Array, " s"]
    command: Float[Array, " driven"]
    rate: Float[Array, " driven"]
    """Rate at which the commands move (1/s)."""


class LqgMemory(eqx.Module):
    """Numbers that an LQG controller carries from one call to the next."""

    observed: ObserverState
    course: Course
    integral: Float[Array, " controlled"]
    """Integral of the error of what is controlled (m s)."""
    rate: Float[Array, " driven"]
    """Rate at which the commands move (1/s)."""


class Lqg(Controller):
    """Linear quadratic Gaussian control with integral action.

    An observer estimates the arm and the water; a gain makes of both an acceleration of the command
    that is the best one for a linear model, a quadratic cost of errors, speeds and
    accelerations, and white noise (Anderson and Moore 1990; Astrom and Wittenmark 1997, section
    11.4). What is estimated of the water is thereby fed forward.

    Where the target moves, commands that the static Jacobian tells move with it, ahead by the lag
    of the actuators. The model says how the arm would then move; the gain acts on what differs.
    """

    observer: Observer
    gain: Float[Array, "driven full"]
    """Acceleration of the commands by estimate of arm and water, actuators, commands, their rate
    and the integral."""
    integrating: Float[Array, "controlled pose"]
    """Error that is integrated, in metres, by the error of the pose."""
    period: Float[Array, ""]
    """Time between two commands (s)."""
    actuators: Float[Array, "s s"]
    """States of the actuators after a period, by those before."""
    commanded: Float[Array, "s driven"]
    """And by the commands."""
    mapping: Float[Array, "driven pose"]
    """Command for a displacement of the tip."""
    lead: Float[Array, " driven"]
    """How far each command looks ahead (s)."""
    braking: Braking
    """Limits of the commands, one period ahead."""
    worth: Float[Array, "driven driven"]
    """Second derivative of the cost by the moves of the commands."""
    rows: tuple[int, ...] = eqx.field(static=True)
    """Which inputs are driven."""

    def start(self, seen: Seen) -> LqgMemory:
        none = jnp.zeros(len(self.rows))
        observed = self.observer.start(seen)
        course = Course(
            jnp.zeros_like(observed.estimate), jnp.zeros_like(observed.actuators), none, none
        )
        return LqgMemory(observed, course, jnp.zeros(self.integrating.shape[0]), none)

    def command(self, memory: LqgMemory, seen: Seen) -> tuple[Command, LqgMemory]:
        rows = jnp.asarray(self.rows, int)
        observed = self.observer.update(memory.observed, seen)
        course, before, rate = self.follow(memory.course, seen), seen.command[rows], memory.rate
        away = jnp.concatenate(
            [
                observed.estimate - course.estimate,
                observed.actuators - course.actuators,
                before - course.command,
                memory.integral,
            ]
        )
        # the course has moved on since the last command by its own
        moves = self.period * course.rate - jnp.sum(self.gain * away, axis=-1)
        lower, upper = seen.lower[rows], seen.upper[rows]
        slowest, fastest = self.braking.next(self.period * rate, before - lower, upper - before)
        feasible = jnp.all((moves >= slowest) & (moves <= fastest), axis=1)
        which = jnp.where(jnp.any(feasible), jnp.argmax(feasible), len(self.gain) - 1)
        move = moves[which]
        kept = nearest(move, slowest, fastest, self.worth[which])
        held = jnp.clip(before + kept, lower, upper)
        error = product(self.integrating, pose_error(seen.measured, seen.wanted))
        # at a limit an integral would only wind up
        free = jnp.all(kept == move)
        integral = memory.integral + jnp.where(free, self.period, 0.0) * error
        command = jnp.zeros_like(seen.command).at[rows].set(held)
        return command, LqgMemory(observed, course, integral, (held - before) / self.period)

    def follow(self, before: Course, seen: Seen) -> Course:
        """Return how all would move by now with the target."""
        observer = self.observer
        actuators = product(self.actuators, before.actuators) + product(
            self.commanded, before.command
        )
        estimate = (
            product(observer.move, before.estimate)
            + product(observer.held, before.actuators)
            + product(observer.driven, actuators)
        )
        start = observer.values[: seen.wanted.size]
        ahead = jax.vmap(seen.target.in_frame)(seen.time + self.lead)
        shifted = jax.vmap(lambda pose: pose_error(pose, start))(ahead)
        step = jnp.sum(self.mapping * shifted, axis=1) - before.command
        # a target that jumps is gone after at half the greatest speed
        most = 0.5 * self.braking.rate / self.period
        rate = jnp.clip(step / self.period, -most, most)
        return Course(estimate, actuators, before.command + self.period * rate, rate)


def nearest(
    wanted: Float[Array, " input"],
    lower: Float[Array, " input"],
    upper: Float[Array, " input"],
    worth: Float[Array, "input input"],
) -> Float[Array, " input"]:
    """Return what costs least within limits, where ``wanted`` would cost least without.

    What one input cannot do others make up for as far as it is worth it: coordinate descent on a
    quadratic cost with the second derivative ``worth``.
    """
    size = wanted.size

    def one(number: Array, moves: Array) -> Array:
        at = number % size
        slope = jnp.sum(worth[at] * (moves - wanted))
        return moves.at[at].set(jnp.clip(moves[at] - slope / worth[at, at], lower[at], upper[at]))

    within = jnp.clip(wanted, lower, upper)
    return jax.lax.cond(
        jnp.all(within == wanted),
        lambda: within,
        lambda: jax.lax.fori_loop(0, _SWEEPS * size, one, within),
    )
