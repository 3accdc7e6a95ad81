"""Swing-up and balance: an arm too heavy to stand is brought upright and held there."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.control.controller import Controller
from crinoid.control.seen import Command, Seen
from crinoid.products import product

Stations = Float[Array, " station"]
Moving = Float[Array, " motion"]
Number = Float[Array, ""]

_UP = 0.5 * jnp.pi
_ROOM = 0.98
"""Share of its travel that the base uses to swing the arm up."""


class Swing(NamedTuple):
    """How an arm swings."""

    energy: Number
    """Above that of the arm at rest upright (J)."""
    momentum: Number
    """Forward (kg m/s)."""
    ahead: Number
    """How far ahead of the root its centre of mass is (m)."""


class Pendulum(eqx.Module):
    """A planar arm as a chain of straight edges, of which inclinations tell the directions."""

    sampled: Float[Array, "edge station"]
    """From what inclinations are off upright to what those of the edges are."""
    length: Float[Array, " edge"]
    """Lengths of the edges (m)."""
    mass: Float[Array, " edge"]
    """Mass of the node that ends each edge, with added mass (kg)."""
    weight: Float[Array, " edge"]
    """Weight in water of that node (N)."""
    stiffness: Float[Array, " edge"]
    """Bending stiffness of the joint that begins each edge (N m)."""

    def swing(self, off: Stations, rate: Stations, speed: Number) -> Swing:
        """Return how the arm swings on a base that moves forward.

        Parameters
        ----------
        off, rate
            How far the inclinations are from upright (rad), and their rates (rad/s).
        speed
            Speed of the base (m/s).
        """
        leans, turning = product(self.sampled, jnp.stack([off, rate], axis=1)).T
        along = jnp.stack([-jnp.sin(leans), jnp.cos(leans)])
        ahead, height = jnp.cumsum(self.length * along, axis=1)
        swept = jnp.stack([-along[1], along[0]])
        forward, upward = jnp.cumsum(self.length * turning * swept, axis=1)
        forward = forward + speed
        # as the elements have it, short of edges that fold onto each other
        bent = 2 * jnp.tan(0.5 * jnp.clip(jnp.diff(leans, prepend=0.0), -2.0, 2.0))
        stored = 0.5 * jnp.sum(self.stiffness * bent**2)
        kinetic = 0.5 * jnp.sum(self.mass * (forward**2 + upward**2))
        lifted = jnp.sum(self.weight * (height - jnp.cumsum(self.length)))
        return Swing(
            kinetic + stored + lifted,
            jnp.sum(self.mass * forward),
            jnp.sum(self.mass * ahead) / jnp.sum(self.mass),
        )


class Filter(eqx.Module):
    """Steady Kalman filter of the upright arm's modes and their rates ("motion")."""

    advance: Float[Array, "motion motion"]
    """How the motion goes on over a control period."""
    pushed: Moving
    """Its change meanwhile per acceleration of the base (m/s2)."""
    trust: Float[Array, "motion mode"]
    """Its correction per mode that is seen elsewhere than expected."""

    def corrected(self, motion: Moving, seen: Moving) -> Moving:
        """Return the motion, corrected by what is seen of the modes."""
        count = self.trust.shape[1]
        return motion + product(self.trust, seen[:count] - motion[:count])

    def ahead(self, motion: Moving, accelerations: Float[Array, " period"]) -> Moving:
        """Return the motion some control periods on, the base accelerating meanwhile (m/s2)."""
        for acceleration in accelerations:
            motion = product(self.advance, motion) + self.pushed * acceleration
        return motion


class Balance(eqx.Module):
    """The upright arm in small motions: its modes and their rates, and where the base is."""

    modes: Float[Array, "mode station"]
    """From inclinations, less those of the upright arm, to the modes."""
    filter: Filter
    gain: Float[Array, " state"]
    """Gain of the LQR on motion, displacement and speed of the base: less where it is to go (m)."""
    capture: Float[Array, "measure state"]
    """Shares of the base's acceleration, speed and travel that it takes at least to bring what
    leaves back: beyond 1 the arm cannot be caught."""

    def seen(self, off: Stations, rate: Stations) -> Moving:
        """Return the motion by what is seen alone."""
        return product(self.modes, jnp.stack([off, rate], axis=1)).T.reshape(-1)

    def needed(self, state: Float[Array, " state"]) -> Number:
        """Return the largest share of the base's limits that it takes to catch the arm."""
        return jnp.max(jnp.abs(product(self.capture, state)))


class HybridMemory(eqx.Module):
    """Numbers that the controller carries from one call to the next."""

    off: Stations
    """How far the newest inclinations are from upright (rad)."""
    taken: Number
    """When they were measured (s)."""
    rate: Stations
    """Their filtered rates (rad/s)."""
    momentum: Number
    """Filtered momentum of the arm (kg m/s)."""
    motion: Moving
    """Modes of the upright arm, and their rates, when the inclinations were measured."""
    pushed: Float[Array, " period"]
    """Accelerations of the base over the control periods since then, the oldest first (m/s2)."""
    speed: Number
    """Speed of the base (m/s)."""
    balances: Bool[Array, ""]
    """Whether the arm is balanced; it is swung up otherwise."""


class Hybrid(Controller):
    """Swings a hanging arm up by an energy law, catches it and balances it upright.

    The base works on the arm by ``p' v``, with the arm's forward momentum ``p`` and the base's
    speed ``v``. Where the base is at ``x = X sat((E_up - E) / dE) tanh(p / p_0)`` this has the sign
    of ``E_up - E``, and brings the energy ``E`` of the arm to that of the upright one. So the law
    of Astrom and Furuta (2000, Automatica 36), which accelerates the base, becomes one of where it
    goes: it keeps within any travel, and any elastic arm obeys it. A share of how far the arm is
    ahead, within the ``tanh``, gets an arm at rest going; to first order it does no work in a
    cycle.

    Where the base's limits allow it to bring back what leaves, the arm is caught and balanced, by
    an LQR on its slowest modes and the base, which a Kalman filter tells. It is let go, and swung
    up again, only well beyond that.
    """

    pendulum: Pendulum
    balance: Balance
    sensor: str = eqx.field(static=True)
    """Name of the sensor of inclinations."""
    channel: int = eqx.field(static=True)
    """Index of the channel along which the base moves, and of its input."""
    period: Number
    """Time between two commands (s)."""
    late: int = eqx.field(static=True)
    """Control periods by which inclinations come late."""
    filter_time: Number
    """Time constant of the filter on rates (s)."""
    momentum: Number
    """Momentum ``p_0`` at which the base goes most of its travel (kg m/s)."""
    momentum_time: Number
    """Time constant of the filter on the momentum, which spares the faster modes (s)."""
    reach: Number
    """Length of the arm (m)."""
    energy: Number
    """Energy ``dE`` that is lacking where the base goes as far as it can (J)."""
    catch: Float[Array, "2"]
    """Lean of the arm (rad) and share of the base's limits up to which it is caught."""
    release: Float[Array, "2"]
    """Lean and share beyond which it is let go."""

    def start(self, seen: Seen) -> HybridMemory:
        reading = seen.readings[self.sensor]
        off, still = reading.value - _UP, jnp.zeros_like(reading.value)
        return HybridMemory(
            off=off,
            taken=reading.taken,
            rate=still,
            momentum=jnp.zeros(()),
            motion=self.balance.seen(_short_way(off), still),
            pushed=jnp.zeros(self.late + 1),
            speed=seen.actuators[0].velocity[self.channel],
            balances=jnp.asarray(False),
        )

    def command(self, memory: HybridMemory, seen: Seen) -> tuple[Command, HybridMemory]:
        reading, servo = seen.readings[self.sensor], seen.actuators[0]
        position, speed = servo.position[self.channel], servo.velocity[self.channel]
        off, rate = self._followed(memory, reading.value - _UP, reading.taken)

        told, model = self.balance.seen(_short_way(off), rate), self.balance.filter
        pushed = jnp.append(memory.pushed[1:], (speed - memory.speed) / self.period)
        followed = model.corrected(model.ahead(memory.motion, pushed[:1]), told)
        # far from upright the modes are not what they are there, and what is seen has to do
        motion = jnp.where(memory.balances, followed, told)
        now = model.ahead(motion, pushed[1:])
        state = jnp.concatenate([now, jnp.stack([position, speed])])
        met = jnp.stack([jnp.max(jnp.abs(_short_way(off))), self.balance.needed(state)])
        balances = jnp.all(met < jnp.where(memory.balances, self.release, self.catch))

        swing = self.pendulum.swing(off, rate, speed)
        share = self.period / (self.period + self.momentum_time)
        momentum = memory.momentum + share * (swing.momentum - memory.momentum)
        lacking = jnp.clip(-swing.energy / self.energy, -1.0, 1.0)
        swung = lacking * jnp.tanh(momentum / self.momentum + swing.ahead / self.reach)
        low, high = seen.lower[self.channel], seen.upper[self.channel]
        driven = jnp.where(
            balances,
            -product(self.balance.gain[None], state)[0],
            _ROOM * jnp.minimum(-low, high) * swung,
        )
        command = jnp.zeros_like(seen.command).at[self.channel].set(driven)
        return command, HybridMemory(
            off, reading.taken, rate, momentum, motion, pushed, speed, balances
        )

    def _followed(
        self, memory: HybridMemory, value: Stations, taken: Number
    ) -> tuple[Stations, Stations]:
        """Return angles that turn on and on, and their rates."""
        moved, lasted = _short_way(value - memory.off), taken - memory.taken
        new = lasted > 0
        share = lasted / (self.filter_time + lasted)
        rate = memory.rate + share * (moved / jnp.where(new, lasted, 1.0) - memory.rate)
        return memory.off + moved, jnp.where(new, rate, memory.rate)


def _short_way(turn: Stations) -> Stations:
    return turn - 2 * jnp.pi * jnp.round(turn / (2 * jnp.pi))
