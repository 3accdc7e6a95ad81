"""LQG control: a Kalman filter and state feedback within the limits of the inputs."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from crinoid.control.braking import Braking
from crinoid.control.controller import Command, Controller, ControllerInput
from crinoid.control.estimate import Estimate, ObserverOutputs
from crinoid.control.target import pose_error
from crinoid.dynamics import numbers_of
from crinoid.numerics.small_matrices import product

Numbers = Float[Array, " z"]
Following = Float[Array, " s"]


class ObserverState(eqx.Module):
    """State of an observer: the estimate and its last data."""

    estimate: Numbers
    """Arm, water and readings under way, all as differences."""
    actuators: Following
    """States of the actuators, less those at rest."""
    taken: Float[Array, " sensor"]
    """Time of the newest reading of each sensor (s)."""


class Observer(eqx.Module):
    """A Kalman filter on the linear model of an arm in fluctuating water (Kalman 1960).

    The states of the actuators are measured, limits of speed and acceleration included, and not
    derived from commands: so an input that lags at its limit does not mislead it. A
    reading that arrives late is compared with what was expected when it was taken. Each sensor
    counts only at calls at which it has a new reading; every set of sensors with new readings
    has its gain.
    """

    move: Float[Array, "z z"]
    """Estimate after a period, by that before."""
    held: Float[Array, "z s"]
    """And by the actuators before."""
    driven: Float[Array, "z s"]
    """And by the actuators after it."""
    expect: Float[Array, "y z"]
    """Expected readings by the estimate."""
    follow: Float[Array, "y s"]
    """And by the actuators."""
    gains: Float[Array, "set z y"]
    """Gain for each set of sensors with new readings."""
    fresh: Int[Array, "set sensor"]
    """Sensors of each set (0, 1)."""
    values: Float[Array, " y"]
    """Readings where the model is linear about."""
    at_rest: Following
    """States of the actuators there."""
    kept: tuple[int, ...] = eqx.field(static=True)
    """Indices of the modelled numbers in the states of all actuators."""
    sensors: tuple[str, ...] = eqx.field(static=True)
    """Names of the sensors other than that of the tip."""
    outputs: ObserverOutputs | None
    """Tip, shape and current by the estimate; None where several observers share a run."""

    def start(self, seen: ControllerInput) -> ObserverState:
        """Begin with the arm that the model is linear about."""
        none = jnp.full(len(self.sensors) + 1, -jnp.inf)
        return ObserverState(jnp.zeros(self.move.shape[0]), self._actuators(seen), none)

    def update(
        self, before: ObserverState, seen: ControllerInput, pushed: Numbers | None = None
    ) -> ObserverState:
        """Return the estimate at the next call, a period later.

        ``pushed`` is a further known change meanwhile.
        """
        actuators = self._actuators(seen)
        first = jnp.all(before.taken == -jnp.inf)
        moved = (
            product(self.move, before.estimate)
            + product(self.held, before.actuators)
            + product(self.driven, actuators)
        )
        if pushed is not None:
            moved += pushed
        estimate = jnp.where(first, before.estimate, moved)
        others = [seen.readings[name] for name in self.sensors]
        taken = jnp.stack([seen.measurement_time, *(each.measurement_time for each in others)])
        fresh = (taken > before.taken).astype(int)
        chosen = jnp.all(self.fresh == fresh, axis=1)
        read = jnp.concatenate(
            [
                pose_error(seen.measured, self.values[: seen.measured.size]),
                *(each.value for each in others),
            ]
        )
        read = read.at[seen.measured.size :].add(-self.values[seen.measured.size :])
        surprise = read - product(self.expect, estimate) - product(self.follow, actuators)
        gain = jnp.sum(jnp.where(chosen[:, None, None], self.gains, 0.0), axis=0)
        return ObserverState(estimate + product(gain, surprise), actuators, taken)

    def output(self, observed: ObserverState) -> Estimate | None:
        """Return tip, shape and current at the last call, filtered."""
        if self.outputs is None:
            return None
        return self.outputs.of(observed.estimate, observed.actuators)

    def _actuators(self, seen: ControllerInput) -> Following:
        numbers, _ = numbers_of(seen.actuators)
        return numbers[jnp.asarray(self.kept, int)] - self.at_rest


_SWEEPS = 20  # sweeps of coordinate descent over the inputs for the best moves within limits


class LqgMemory(eqx.Module):
    """Memory of an LQG controller."""

    observed: ObserverState
    integral: Float[Array, " controlled"]
    """Integral of the error of the controlled coordinates (m s)."""
    rate: Float[Array, " driven"]
    """Rate at which the commands move (1/s)."""


class ModelBased(Controller):
    """Controller on a linear model of the arm, with an observer and integral action."""

    observer: Observer
    integrating: Float[Array, "controlled pose"]
    """Error that is integrated, in metres, by the error of the pose."""
    mapping: Float[Array, "driven pose"]
    """Command for a displacement of the tip."""
    lead: Float[Array, " look"]
    """Preview times of the target (s), the first 0."""
    period: Float[Array, ""]
    """Time between two commands (s)."""
    rows: tuple[int, ...] = eqx.field(static=True)
    """Indices of the driven inputs."""

    def estimate(self, memory: Any) -> Estimate | None:
        return self.observer.output(memory.observed)

    def wanted_commands(self, seen: ControllerInput) -> Float[Array, "look driven"]:
        """Return the commands at which the tip would stand still where it is wanted at each look.

        By the linear model.
        """
        wanted = jax.vmap(seen.target.in_frame)(seen.time + self.lead)
        tip = self.observer.values[: seen.reference.size]
        return jax.vmap(lambda pose: product(self.mapping, pose_error(pose, tip)))(wanted)


class Lqg(ModelBased):
    """Linear quadratic Gaussian control with integral action, within the limits of the inputs.

    An observer estimates the arm and the water; a gain turns both into the next move of each
    command, the best one for a linear model, a quadratic cost of errors and speeds, and white noise
    (Anderson and Moore 1990; Astrom and Wittenmark 1997, section 11.4). The estimate of the
    water is thereby fed forward.

    A gain that is best without limits can be unstable with them. So there are several, each gentler
    than the one before, and the first one applies whose move the inputs can make (Wredenhagen and
    Belanger, Automatica 30 (1994) 403-416).

    Where the target moves, a part of each move is for where it will be (Katayama, Ohki, Inoue and
    Kato 1985).
    """

    gains: Float[Array, "gain driven full"]
    """Moves of the commands by estimate of arm and water, actuators, commands and the integral; the
    gentlest last."""
    by_aim: Float[Array, "gain driven look driven"]
    """And by the commands at which the tip would stand still where it is wanted, now and later."""
    curved: Float[Array, "gain driven driven"]
    """Second derivative of the cost of each by the moves."""
    braking: Braking
    """Limits of the commands, one period ahead."""

    def start(self, seen: ControllerInput) -> LqgMemory:
        none = jnp.zeros(self.integrating.shape[0])
        return LqgMemory(self.observer.start(seen), none, jnp.zeros(len(self.rows)))

    def command(self, memory: LqgMemory, seen: ControllerInput) -> tuple[Command, LqgMemory]:
        rows = jnp.asarray(self.rows, int)
        observed, before = self.observer.update(memory.observed, seen), seen.command[rows]
        full = jnp.concatenate([observed.estimate, observed.actuators, before, memory.integral])
        aims = self.wanted_commands(seen)
        moves = jnp.sum(self.by_aim * aims, axis=(2, 3)) - jnp.sum(self.gains * full, axis=2)
        lower, upper = seen.lower[rows], seen.upper[rows]
        moving = self.period * memory.rate
        slowest, fastest = self.braking.next(moving, before - lower, upper - before)
        can = jnp.all((moves >= slowest) & (moves <= fastest), axis=1)
        chosen = jnp.where(jnp.any(can), jnp.argmax(can), can.size - 1)
        kept = nearest(moves[chosen], slowest, fastest, self.curved[chosen])
        held = jnp.clip(before + kept, lower, upper)
        error = product(self.integrating, pose_error(seen.measured, seen.reference))
        # no wind-up of the integral at a limit
        integral = memory.integral + jnp.where(jnp.any(can), self.period, 0.0) * error
        command = jnp.zeros_like(seen.command).at[rows].set(held)
        return command, LqgMemory(observed, integral, (held - before) / self.period)


def nearest(
    wanted: Command, lower: Command, upper: Command, curved: Float[Array, "input input"]
) -> Command:
    """Return the moves of least cost within limits; ``wanted`` are those without limits.

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
