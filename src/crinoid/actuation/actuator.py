"""Actuators: their interface, and followers of first order (valves, winches)."""

from abc import abstractmethod
from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Any, Literal, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

__all__ = ["for_small_commands"]

Command = Float[Array, " input"]
Drives = Float[Array, " drive"]

InputKind = Literal["shift", "turn", "pressure", "tension", "share"]
"""Kinds of input: shifts (m) and turns (rad) of the base, pressure (Pa), tension (N), a share."""


class Input(eqx.Module):
    """One entry of a command: its name, unit, kind and limits.

    Parameters
    ----------
    name : str
        Its name in results and in `crinoid.AssembledScenario.mapping`.
    unit : str
        Unit of its commands and limits.
    kind : {"shift", "turn", "pressure", "tension", "share"}
        Quantity: a shift (m) or turn (rad) of the base, a pressure (Pa), a tension (N), a share.
    lower, upper : array
        Smallest and largest value that the actuator follows, in ``unit``.

    Examples
    --------
    >>> thrust = crinoid.Input("thrust", "N", "tension", jnp.array(-5.0), jnp.array(5.0))
    >>> thrust.name, float(thrust.upper)
    ('thrust', 5.0)
    """

    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    kind: InputKind = eqx.field(static=True)
    lower: Float[Array, "*many"]
    upper: Float[Array, "*many"]


class Actuator(eqx.Module):
    """Actuator that turns commands into a drive: a pressure, a tension, a displacement.

    Its state is a pytree of arrays. The time step asks for the drive at its end, where the forces
    are balanced. Subclasses define ``inputs``, ``at_rest``, ``advance`` and ``drive``.

    Examples
    --------
    Two pairs of chambers, 0.1 s after a command; that is their time constant:

    >>> chambers = crinoid.system("reach").actuators[0]
    >>> [each.name for each in chambers.inputs]
    ['inner', 'outer']
    >>> command = jnp.array([0.5, 0.5])
    >>> state = chambers.advance(chambers.at_rest(), command, jnp.array(0.1))
    >>> chambers.drive(state).round(3).tolist()
    [0.316, 0.316]
    """

    @property
    @abstractmethod
    def inputs(self) -> tuple[Input, ...]:
        """The inputs that it follows, in the order of its part of a command."""

    @abstractmethod
    def at_rest(self) -> Any:
        """Return its state before the first command."""

    @abstractmethod
    def advance(self, state: Any, command: Command, step: Float[Array, ""]) -> Any:
        """Return the state after following ``command``, held for ``step`` seconds."""

    def response(self, frequency: Float[np.ndarray, " f"]) -> Complex[np.ndarray, "f input"]:
        """Return drive over command at frequencies (Hz), as long as no limit is met.

        The linear loop before a run and the preview of a feed-forward use it. By default the
        drive follows immediately.
        """
        return np.ones((frequency.size, len(self.inputs)), complex)

    @abstractmethod
    def drive(self, state: Any) -> Drives:
        """Return its drive, a number for each input in its unit.

        Elements find it in `crinoid.Motion.drive`, where the drives of all actuators but the base's
        servos are concatenated.
        """


def followed(
    actuators: Sequence[Actuator], states: Sequence[Any], command: Command, step: Float[Array, ""]
) -> list[Any]:
    """Return the states of actuators after each has followed its part of a command."""
    ends = [*accumulate((len(actuator.inputs) for actuator in actuators), initial=0)]
    if jnp.shape(command) != (ends[-1],):
        raise ValueError(f"command: got the shape {jnp.shape(command)}; must be ({ends[-1]},)")
    parts = [command[first:last] for first, last in pairwise(ends)]
    every = zip(actuators, states, parts, strict=True)
    return [one.advance(state, part, step) for one, state, part in every]


def drives(actuators: Sequence[Actuator], states: Sequence[Any]) -> Drives | None:
    """Return the drives of all actuators, one behind the other; None where there are none."""
    if not actuators:
        return None
    found = [one.drive(state) for one, state in zip(actuators, states, strict=True)]
    return jnp.concatenate(found)


_FAR = 1e6  # by how much limits are moved away, over themselves and 1

Actuators = TypeVar("Actuators")


def for_small_commands(actuators: Actuators) -> Actuators:
    """Return a tree of actuators without dead bands and limits, for a linearisation.

    At the end of a range or within a dead band their response would be half of it, or zero.
    """

    def of(path: tuple[Any, ...], leaf: Any) -> Any:
        match getattr(path[-1], "name", ""):
            case "dead_band":
                return jnp.zeros_like(leaf)
            case "lower":
                return leaf - _FAR * (1 + jnp.abs(leaf))
            case "upper":
                return leaf + _FAR * (1 + jnp.abs(leaf))
            case _:
                return leaf

    return jax.tree_util.tree_map_with_path(of, actuators)


class FollowerState(eqx.Module):
    """State of followers."""

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
    """Greatest rate (1/s); above 1e12 if there is none, which keeps slopes finite."""
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
        # a constant target over the step that has the effect of one that moves steadily
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
