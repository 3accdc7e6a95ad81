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


class LqgMemory(eqx.Module):
    """Numbers that an LQG controller carries from one call to the next."""

    observed: ObserverState
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

    Where the target moves, a part of each move is for where it will be (Katayama, Ohki, Inoue and
    Kato 1985).
    """

    observer: Observer
    gains: Float[Array, "gain driven full"]
    """Moves of the commands by estimate of arm and water, actuators, commands and the integral; the
    gentlest last."""
    by_aim: Float[Array, "gain driven look driven"]
    """And by the commands at which the tip would stand still where it is wanted, now and later."""
    curved: Float[Array, "gain driven driven"]
    """Second derivative of the cost of each by the moves."""
    integrating: Float[Array, "controlled pose"]
    """Error that is integrated, in metres, by the error of the pose."""
    period: Float[Array, ""]
    """Time between two commands (s)."""
    mapping: Float[Array, "driven pose"]
    """Command for a displacement of the tip."""
    lead: Float[Array, " look"]
    """How far it looks ahead to the target (s), first not at all."""
    braking: Braking
    """Limits of the commands, one period ahead."""
    rows: tuple[int, ...] = eqx.field(static=True)
    """Which inputs are driven."""

    def start(self, seen: Seen) -> LqgMemory:
        none = jnp.zeros(self.integrating.shape[0])
        return LqgMemory(self.observer.start(seen), none, jnp.zeros(len(self.rows)))

    def command(self, memory: LqgMemory, seen: Seen) -> tuple[Command, LqgMemory]:
        rows = jnp.asarray(self.rows, int)
        observed, before = self.observer.update(memory.observed, seen), seen.command[rows]
        full = jnp.concatenate([observed.estimate, observed.actuators, before, memory.integral])
        aims = wanted_commands(seen, self.mapping, self.observer.values, self.lead)
        moves = jnp.sum(self.by_aim * aims, axis=(2, 3)) - jnp.sum(self.gains * full, axis=2)
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
        return command, LqgMemory(observed, integral, (held - before) / self.period)


def wanted_commands(
    seen: Seen,
    mapping: Float[Array, "driven pose"],
    start: Float[Array, " y"],
    lead: Float[Array, " look"],
) -> Float[Array, "look driven"]:
    """Return the commands at which the tip would stand still where it is wanted ``lead`` ahead.

    By the linear model: ``mapping`` gives them for a displacement of the tip, whose pose comes
    first in ``start``.
    """
    wanted = jax.vmap(seen.target.in_frame)(seen.time + lead)
    return jax.vmap(lambda pose: product(mapping, pose_error(pose, start[: seen.wanted.size])))(
        wanted
    )


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
