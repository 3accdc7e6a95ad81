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
    """Linear quadratic Gaussian control with integral action, within the limits of the inputs.

    An observer estimates the arm and the water; a gain makes of both the next move of each command,
    the best one for a linear model, a quadratic cost of errors and speeds, and white noise
    (Anderson and Moore 1990; Astrom and Wittenmark 1997, section 11.4). What is estimated of the
    water is thereby fed forward.

    What is best without limits can be unstable with them. So there are several gains, each gentler
    than the one before, and the first one counts whose move the inputs can do (Wredenhagen and
    Belanger, Automatica 30 (1994) 403-416).

    Where the target moves, commands that the static Jacobian tells move with it, ahead by the lag
    of the actuators. The model says how the arm would then move; the gain acts on what differs.
    """

    observer: Observer
    gains: Float[Array, "gain driven full"]
    """Moves of the commands by estimate of arm and water, actuators, commands and the integral; the
    gentlest last."""
    curved: Float[Array, "gain driven driven"]
    """Second derivative of the cost of each by the moves."""
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
        course, before = self.follow(memory.course, seen), seen.command[rows]
        away = jnp.concatenate(
            [
                observed.estimate - course.estimate,
                observed.actuators - course.actuators,
                before - memory.course.command,
                memory.integral,
            ]
        )
        # the course has moved on since the last command by its own
        moves = self.period * course.rate - jnp.sum(self.gains * away, axis=2)
        lower, upper = seen.lower[rows], seen.upper[rows]
        slowest, fastest = self.braking.next(
            self.period * memory.rate, before - lower, upper - before
        )
        can = jnp.all((moves >= slowest) & (moves <= fastest), axis=1)
        chosen = jnp.where(jnp.any(can), jnp.argmax(can), can.size - 1)
        kept = nearest(moves[chosen], slowest, fastest, self.curved[chosen])
        held = jnp.clip(before + kept, lower, upper)
        error = product(self.integrating, pose_error(seen.measured, seen.wanted))
        # at a limit an integral would only wind up
        integral = memory.integral + jnp.where(jnp.any(can), self.period, 0.0) * error
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
    curved: Float[Array, "input input"],
) -> Float[Array, " input"]:
    """Return the moves that cost least within limits, where ``wanted`` cost least without.

    Others make up for what one input cannot do: coordinate descent on a quadratic cost with the
    second derivative ``curved``.
    """
    size = wanted.size

    def one(number: Array, moves: Array) -> Array:
        at = number % size
        slope = jnp.sum(curved[at] * (moves - wanted))
        return moves.at[at].set(jnp.clip(moves[at] - slope / curved[at, at], lower[at], upper[at]))

    within = jnp.clip(wanted, lower, upper)
    return jax.lax.cond(
        jnp.all(within == wanted),
        lambda: within,
        lambda: jax.lax.fori_loop(0, _SWEEPS * size, one, within),
    )
