"""PID control of the tip, and the allocation of its commands to redundant inputs."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.control.controller import Command, Controller, ControllerInput
from crinoid.control.target import Pose, pose_error
from crinoid.numerics.ramp import Onset
from crinoid.numerics.small_matrices import product, solve

_DAMPING = 1e-4  # damping of the inverse, as a squared share of the largest singular value
_READY = 1e2  # weight of an input that relieves another, relative to one that returns to rest
_RANK = 1e-9  # share of the largest singular value below which a direction counts as none


class Allocation(eqx.Module):
    """Allocation of commands to redundant inputs.

    At rest, commands ``u`` move the pose by ``J u``; many of them move it alike. `within` keeps to
    the limits: of an input that would go beyond its own the others take over what they can, by
    least squares with weights (the cascaded generalised inverse of control allocation, Bodson
    2002). `return_rate` lets inputs go back to rest where others can do their part: of
    that change of the commands it leaves what does not move the pose (redundancy resolution,
    Liegeois 1977).
    """

    jacobian: Float[Array, "pose input"]
    """Movement of the pose by each driven input; 0 of coordinates that are not controlled."""
    scale: Float[Array, " pose"]
    """Length that makes an error of each coordinate one in metres."""
    weight: Command
    """Weight of each input; 0 of one that is not driven."""
    release: Command
    """Rate at which an input goes back to where it rests (1/s); 0: it does not."""
    spare: Float[Array, "input input"]
    """Part of a change of the commands that does not move the pose."""

    @staticmethod
    def of(
        jacobian: Float[np.ndarray, "pose input"],
        scale: Float[np.ndarray, " pose"],
        weight: Float[np.ndarray, " input"],
        release: Float[np.ndarray, " input"],
    ) -> "Allocation":
        """Build the allocation from the static Jacobian."""
        # those that stay make room for those that go back
        ready = weight * np.where(release > 0, 1.0, _READY)
        weighed = scale[:, None] * jacobian * ready
        unmoved = np.eye(weight.size) - np.linalg.pinv(weighed, rcond=_RANK) @ weighed
        back = np.divide(1.0, ready, out=np.zeros_like(ready), where=ready > 0)
        spare = ready[:, None] * unmoved * back
        numbers = (jacobian, scale, weight, release, spare)
        return Allocation(*(jax.device_put(each) for each in numbers))

    def return_rate(self, command: Command) -> Command:
        """Return the rate of commands by which inputs go back and others take over (1/s)."""
        return -product(self.spare, self.release * command)

    def within(self, command: Command, lower: Command, upper: Command) -> Command:
        """Return commands within the limits whose effect on the pose is nearest to ``command``."""
        wanted = product(self.jacobian, command)

        def missed(held: Command) -> Float[Array, " pose"]:
            return self.scale * (wanted - product(self.jacobian, held))

        def share(_: Array, carry: tuple[Command, ...]) -> tuple[Command, ...]:
            best, held, weight = carry
            # the least commands, over their weights, that move the pose by the error (m)
            scaled = self.scale[:, None] * self.jacobian
            weighed = scaled * weight
            # above zero where no input is left
            damping = _DAMPING * jnp.sum(weighed**2) + _RANK * jnp.sum((scaled * self.weight) ** 2)
            squares = product(weighed, weighed.T) + damping * jnp.eye(self.scale.size)
            free = held + weight * product(weighed.T, solve(squares, missed(held)))
            inside = (free >= lower) & (free <= upper)
            held = jnp.clip(free, lower, upper)
            better = jnp.sum(missed(held) ** 2) < jnp.sum(missed(best) ** 2)
            return jnp.where(better, held, best), held, jnp.where(inside, weight, 0.0)

        inside = (command >= lower) & (command <= upper)
        cut = jnp.clip(command, lower, upper)
        begin = cut, cut, jnp.where(inside, self.weight, 0.0)
        # each round one more coordinate may be left to fewer inputs
        return jax.lax.fori_loop(0, self.scale.size, share, begin)[0]


_NEAR_SINGULAR = 0.05  # singular value, over the largest one, below which the inverse is damped


def damped_inverse(jacobian: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "n m"]:
    """Return the least-squares inverse, damped where the Jacobian is nearly rank deficient.

    A singular value ``s`` is inverted as ``1 / s`` down to ``e``, a twentieth of the largest, and
    as ``s / e^2`` below: damped least squares, ``s / (s^2 + d^2)``, with ``d^2 = e^2 - s^2`` for
    each singular value by itself (Nakamura and Hanafusa 1986; Maciejewski and Klein 1988). An
    error that hardly any command undoes asks for little, one that none undoes for nothing.
    """
    u, values, vt = np.linalg.svd(jacobian, full_matrices=False)
    largest = values.max(initial=0.0)
    if not largest:
        return np.zeros(jacobian.T.shape)
    return (vt.T * (values / np.maximum(values, _NEAR_SINGULAR * largest) ** 2)) @ u.T


_TAKEN = 1e-3  # share of the excess over limits that counts as taken over by other inputs


class PidMemory(eqx.Module):
    """Memory of a PID, a number for each input in its unit."""

    integral: Command
    """Command of the integral term."""
    slope: Command
    """Filtered rate at which the measured tip moves, as seen by each input, less the rate asked
    for beforehand (1/s)."""
    measured: Pose
    feedforward: Command
    """Command that was known beforehand."""
    calls: Int[Array, ""]
    """Commands given so far."""
    found: Command
    """Error at the first call, as seen by each input."""
    found_forward: Command
    """Command that was known beforehand at the first call."""


class Pid(Controller):
    """A PID per input, on the part of the tip's error that the input can undo.

    The error of the tip becomes an error per input through ``mapping``, the inverse of the
    static Jacobian d(tip)/d(inputs) (`crinoid.control.damped_inverse`), so that at low frequency
    each input sees a plant of gain one. The derivative acts on the measurement, which spares the
    base the kick of a moved target, and is filtered to first order. An input at the end of its
    range stops integrating further into it (Astrom and Murray 2008, sections 10.4 and 10.5).

    The feed-forward command is added within the limits, and the derivative leaves
    out the motion that it asks for. So the PID corrects what the feed-forward leaves over, and does
    not work against it.

    The error and the known command that are there at the first call are taken up along half a
    cosine over ``take_up``, so that the base is not jolted (bumpless transfer, section 10.5 there).

    Redundant inputs share the work (`crinoid.control.Allocation`): the others do what one cannot
    do within its limits, and some go back to where they rest while the
    others take over (mid-ranging; Allison and Isaksson 1998).
    """

    kp: Command
    """Proportional gain (1)."""
    ki: Command
    """Integral gain (1/s)."""
    kd: Command
    """Derivative gain (s)."""
    filter_time: Command
    """Time constant of the derivative's filter (s)."""
    mapping: Float[Array, "input pose"]
    """Command per error of the tip's pose, in the units of both."""
    period: Float[Array, ""]
    """Time between two commands (s)."""
    take_up: Float[Array, ""]
    """Time in which the initial error is taken up (s)."""
    allocation: Allocation | None = None
    """Allocation to redundant inputs; None without them."""

    def start(self, seen: ControllerInput) -> PidMemory:
        zero = jnp.zeros_like(self.kp)
        return PidMemory(zero, zero, seen.measured, zero, jnp.asarray(0), zero, zero)

    def command(self, memory: PidMemory, seen: ControllerInput) -> tuple[Command, PidMemory]:
        measured, feedforward = seen.measured, seen.feedforward
        error = product(self.mapping, pose_error(seen.reference, measured))
        first = memory.calls == 0
        found = jnp.where(first, error, memory.found)
        found_forward = jnp.where(first, feedforward, memory.found_forward)
        left = 1 - Onset.of(0.0, self.take_up)(memory.calls * self.period)
        error, feedforward = error - left * found, feedforward - left * found_forward
        moved = product(self.mapping, pose_error(measured, memory.measured))
        moved -= feedforward - memory.feedforward
        slope = (self.filter_time * memory.slope + moved) / (self.filter_time + self.period)
        integral = memory.integral + self.ki * self.period * error
        free = feedforward + self.kp * error + integral - self.kd * slope
        if self.allocation is None:
            held = jnp.clip(free, seen.lower, seen.upper)
            missed = free - held
        else:
            integral += self.period * self.allocation.return_rate(integral + feedforward)
            held = self.allocation.within(free, seen.lower, seen.upper)
            away = free - held
            missed = product(self.mapping, product(self.allocation.jacobian, away))
            missed = jnp.where(jnp.abs(missed) < _TAKEN * jnp.sum(jnp.abs(away)), 0.0, missed)
        winding = missed * self.ki * error > 0
        integral = jnp.where(winding, memory.integral, integral)
        calls = memory.calls + 1
        return held, PidMemory(integral, slope, measured, feedforward, calls, found, found_forward)
