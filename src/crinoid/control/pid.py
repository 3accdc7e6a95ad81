"""PID control of the tip through the inputs: channels of the base, chambers, tendons."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from crinoid.control.allocation import Allocation
from crinoid.control.controller import Controller
from crinoid.control.seen import Command, Pose, Seen
from crinoid.control.target import pose_error
from crinoid.onset import Onset
from crinoid.products import product

_TAKEN = 1e-3
"""Share of what is beyond limits that may be left over where others have taken it over."""


class PidMemory(eqx.Module):
    """Numbers that a PID carries from one call to the next, per input, in the units of these."""

    integral: Command
    """Command of the integral term."""
    slope: Command
    """Filtered rate at which the measured tip moves, as seen by each input, less what is asked
    for beforehand (1/s)."""
    measured: Pose
    forward: Command
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

    What is known beforehand of the command is added within the limits, and the derivative leaves
    out the motion that it asks for. So the PID corrects what the feed-forward leaves over, and does
    not work against it.

    The error and the known command that are there at the first call are taken up along half a
    cosine over ``take_up``, so that the base is not jolted (bumpless transfer, section 10.5 there).

    Inputs that are more than what is controlled share the work (`crinoid.control.Allocation`): what
    one cannot do within its limits the others do, and some go back to where they rest while the
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
    """How long it takes to answer in full to what is there when it is switched on (s)."""
    allocation: Allocation | None = None
    """How inputs share the work; None where there are no more than it takes."""

    def start(self, seen: Seen) -> PidMemory:
        zero = jnp.zeros_like(self.kp)
        return PidMemory(zero, zero, seen.measured, zero, jnp.asarray(0), zero, zero)

    def command(self, memory: PidMemory, seen: Seen) -> tuple[Command, PidMemory]:
        measured, forward = seen.measured, seen.forward
        error = product(self.mapping, pose_error(seen.wanted, measured))
        first = memory.calls == 0
        found = jnp.where(first, error, memory.found)
        found_forward = jnp.where(first, forward, memory.found_forward)
        left = 1 - Onset.of(0.0, self.take_up)(memory.calls * self.period)
        error, forward = error - left * found, forward - left * found_forward
        moved = product(self.mapping, pose_error(measured, memory.measured))
        moved -= forward - memory.forward
        slope = (self.filter_time * memory.slope + moved) / (self.filter_time + self.period)
        integral = memory.integral + self.ki * self.period * error
        free = forward + self.kp * error + integral - self.kd * slope
        if self.allocation is None:
            held = jnp.clip(free, seen.lower, seen.upper)
            missed = free - held
        else:
            integral += self.period * self.allocation.handed(integral + forward)
            held = self.allocation.within(free, seen.lower, seen.upper)
            away = free - held
            missed = product(self.mapping, product(self.allocation.jacobian, away))
            missed = jnp.where(jnp.abs(missed) < _TAKEN * jnp.sum(jnp.abs(away)), 0.0, missed)
        winding = missed * self.ki * error > 0
        integral = jnp.where(winding, memory.integral, integral)
        calls = memory.calls + 1
        return held, PidMemory(integral, slope, measured, forward, calls, found, found_forward)
