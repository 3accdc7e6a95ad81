"""Actuators that follow to first order: pressures behind valves, tensions of winches."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from crinoid.actuation.actuator import Actuator, Command
from crinoid.actuation.input import Input, InputKind

Drives = Float[Array, " drive"]


class FollowerState(eqx.Module):
    """How far the actuators are."""

    drive: Drives
    held: Drives
    """Targets that they go for: commands within the dead band of the last one do not count."""
    time: Float[Array, ""]
    """Time since the start (s)."""


class Follower(Actuator):
    """Followers of first order with limits on range and rate, a dead band, and schedules.

    The target is the schedule plus the command, cut off at the limits. A drive moves toward it at
    ``(target - drive) / lag``, and no faster than its greatest rate: exact for steps of any length
    over which the command is held and the schedule is a straight line, second order at its corners.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    kinds: tuple[InputKind, ...] = eqx.field(static=True)
    lower: Drives
    upper: Drives
    lag: Drives
    """Time constant (s)."""
    max_rate: Drives
    """Greatest rate (1/s); 1e12 if there is none, which keeps slopes finite."""
    dead_band: Drives
    """Change of the target that is not followed."""
    times: Float[Array, "drive point"]
    """Times of the schedules, increasing (s)."""
    values: Float[Array, "drive point"]
    """Their values, joined by straight lines."""

    @property
    def inputs(self) -> tuple[Input, ...]:
        # a command adds to the schedule: it may take away all that is scheduled at most
        lower = self.lower - jnp.max(self.values, axis=-1)
        upper = self.upper - jnp.min(self.values, axis=-1)
        return tuple(
            Input(name, "1", kind, lower[..., index], upper[..., index])
            for index, (name, kind) in enumerate(zip(self.names, self.kinds, strict=True))
        )

    def at_rest(self) -> FollowerState:
        begin = self._within(self.scheduled(jnp.zeros(())))
        return FollowerState(begin, begin, jnp.zeros(()))

    def advance(
        self, state: FollowerState, command: Command, step: Float[Array, ""]
    ) -> FollowerState:
        time, lagging = state.time + step, self.lag > 0
        lag = jnp.where(lagging, self.lag, 1.0)
        # a target that stands still for the step, and leads where one that moves steadily does
        start, end = self.scheduled(state.time), self.scheduled(time)
        share = jnp.where(lagging, -1 / jnp.expm1(-step / lag) - lag / step, 1.0)
        wanted = self._within(start + share * (end - start) + command)
        target = jnp.where(jnp.abs(wanted - state.held) >= self.dead_band, wanted, state.held)
        away = target - state.drive
        # at the greatest rate until the distance is what the lag follows at that rate
        reach, far = self.max_rate * self.lag, jnp.abs(away)
        limited = far > reach
        spent = jnp.where(limited, jnp.minimum((far - reach) / self.max_rate, step), 0.0)
        decay = jnp.where(lagging, jnp.exp(-(step - spent) / lag), spent >= step)
        # a share of the distance, not a distance: where there is none yet it has a slope as well
        left = jnp.where(limited, 1.0 - self.max_rate * spent / jnp.where(limited, far, 1.0), 1.0)
        return FollowerState(target - away * left * decay, target, time)

    def response(self, frequency: Float[np.ndarray, " f"]) -> Complex[np.ndarray, "f input"]:
        return 1 / (1 + 2j * np.pi * frequency[:, None] * np.asarray(self.lag))

    def drive(self, state: FollowerState) -> Drives:
        return state.drive

    def scheduled(self, time: Float[Array, ""]) -> Drives:
        """Return what the schedules ask for at a time (s)."""
        # not `interp`, which gathers: the few points of a schedule are summed over
        since = (time - self.times[:, :-1]) / (self.times[:, 1:] - self.times[:, :-1])
        steps = jnp.diff(self.values, axis=1)
        return self.values[:, 0] + jnp.sum(jnp.clip(since, 0.0, 1.0) * steps, axis=1)

    def _within(self, drive: Drives) -> Drives:
        # not `clip`, which has half a slope at a limit, where a drive begins
        drive = jnp.where(drive < self.lower, self.lower, drive)
        return jnp.where(drive > self.upper, self.upper, drive)
