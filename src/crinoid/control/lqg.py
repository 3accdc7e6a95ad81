"""LQG control: state feedback on what an observer makes of the readings."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.controller import Controller
from crinoid.control.observer import Observer, ObserverState
from crinoid.control.seen import Command, Seen
from crinoid.control.target import pose_error
from crinoid.products import product


class LqgMemory(eqx.Module):
    """Numbers that an LQG controller carries from one call to the next."""

    observed: ObserverState
    integral: Float[Array, " controlled"]
    """Integral of the error of what is controlled (m s)."""
    called: Float[Array, ""]
    """Commands given so far, 0 or 1 and more."""


class Lqg(Controller):
    """Linear quadratic Gaussian control with integral action.

    An observer estimates the arm and the water; a gain makes of both a change of the command
    that is the best one for a linear model, a quadratic cost of errors and speeds, and
    white noise (Anderson and Moore 1990; Astrom and Wittenmark 1997, section 11.4). What is estimated
    of the water is thereby fed forward.

    Where the target is not where the tip was, the arm is steered to the equilibrium at which its tip
    would be there, by the command that is known beforehand or by the static Jacobian.
    """

    observer: Observer
    gain: Float[Array, "driven full"]
    """Change of the commands by estimate of arm and water, actuators, commands and integral."""
    integrating: Float[Array, "controlled pose"]
    """Error that is integrated, in metres, by the error of the pose."""
    period: Float[Array, ""]
    """Time between two commands (s)."""
    steady: Float[Array, "full driven"]
    """What estimate, actuators and commands are where commands stand still."""
    mapping: Float[Array, "driven pose"]
    """Command for a displacement of the tip."""
    rows: tuple[int, ...] = eqx.field(static=True)
    """Which inputs are driven."""

    def start(self, seen: Seen) -> LqgMemory:
        none = jnp.zeros(self.integrating.shape[0])
        return LqgMemory(self.observer.start(seen), none, jnp.zeros(()))

    def command(self, memory: LqgMemory, seen: Seen) -> tuple[Command, LqgMemory]:
        rows = jnp.asarray(self.rows, int)
        observed = self.observer.update(memory.observed, seen)
        aim = self.aim(seen)
        before = seen.command[rows]
        full = jnp.concatenate([observed.estimate, observed.actuators, before, memory.integral])
        change = -product(self.gain, full - product(self.steady, aim))
        free = before + change
        held = jnp.clip(free, seen.lower[rows], seen.upper[rows])
        error = product(self.integrating, pose_error(seen.measured, seen.wanted))
        # at a limit an integral would only wind up
        free_to_move = jnp.all(free == held)
        integral = memory.integral + jnp.where(free_to_move, self.period, 0.0) * error
        command = jnp.zeros_like(seen.command).at[rows].set(held)
        return command, LqgMemory(observed, integral, memory.called + 1)

    def aim(self, seen: Seen) -> Float[Array, " driven"]:
        """Return the commands at which the tip would stand still where it is wanted."""
        start = self.observer.values[: seen.wanted.size]
        wanted = seen.target.in_frame(seen.time)
        return product(self.mapping, pose_error(wanted, start))
