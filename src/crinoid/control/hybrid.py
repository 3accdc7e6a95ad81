"""Swing-up and balance of an arm that is too heavy to stand."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.control.controller import Command, Controller, ControllerInput
from crinoid.numerics.small_matrices import product

Stations = Float[Array, " station"]
Moving = Float[Array, " motion"]
Number = Float[Array, ""]

_UP = 0.5 * jnp.pi
_ROOM = 0.98  # share of its travel that the base uses to swing the arm up


class Pendulum(eqx.Module):
    """Planar arm as a chain of straight edges, with directions from inclinations."""

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

    def swing(self, off: Stations, rate: Stations, speed: Number) -> tuple[Number, Number, Number]:
        """Return energy (J), forward momentum (kg m/s), and lead of the centre of mass (m).

        Energy counts from the arm at rest upright, the lead from the root. ``off`` is
        how far the inclinations are from upright (rad), ``rate`` their rates (rad/s), ``speed``
        that of the base (m/s).
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
        centre = jnp.sum(self.mass * ahead) / jnp.sum(self.mass)
        return kinetic + stored + lifted, jnp.sum(self.mass * forward), centre


class Filter(eqx.Module):
    """Steady Kalman filter of the upright arm's modes and their rates ("motion")."""

    advance: Float[Array, "motion motion"]
    """Transition matrix of the motion over a control period."""
    pushed: Moving
    """Its change meanwhile per acceleration of the base (m/s2)."""
    trust: Float[Array, "motion mode"]
    """Its correction per mode that is seen elsewhere than expected."""

    def correct(self, motion: Moving, seen: Moving) -> Moving:
        """Return the motion, corrected by measured modes."""
        count = self.trust.shape[1]
        return motion + product(self.trust, seen[:count] - motion[:count])

    def predict(self, motion: Moving, accelerations: Float[Array, " period"]) -> Moving:
        """Return the motion some control periods on, the base accelerating meanwhile (m/s2)."""
        for acceleration in accelerations:
            motion = product(self.advance, motion) + self.pushed * acceleration
        return motion


class UprightBalance(eqx.Module):
    """Balance of the upright arm in small motions: modes, filter, LQR gain and capture."""

    modes: Float[Array, "mode station"]
    """From inclinations, less those of the upright arm, to the modes."""
    filter: Filter
    gain: Float[Array, " state"]
    """Gain of the LQR on motion, displacement and speed of the base: less where it is to go (m)."""
    capture: Float[Array, "measure state"]
    """Least shares of the base's acceleration, speed and travel that bring back an unstable
    motion: beyond 1 the arm cannot be caught."""

    def modes_of(self, off: Stations, rate: Stations) -> Moving:
        """Return the motion by measurements alone."""
        return product(self.modes, jnp.stack([off, rate], axis=1)).T.reshape(-1)

    def effort(self, state: Float[Array, " state"]) -> Number:
        """Return the largest share of the base's limits needed to catch the arm."""
        return jnp.max(jnp.abs(product(self.capture, state)))


class HybridMemory(eqx.Module):
    """Memory of the swing-up controller."""

    off: Stations
    """Newest inclinations from upright (rad)."""
    taken: Number
    """Time of their measurement (s)."""
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
    an LQR on its slowest modes and the base, estimated by a Kalman filter. It is let go, and
    swung up again, only well beyond that.
    """

    pendulum: Pendulum
    balance: UprightBalance
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

    def start(self, seen: ControllerInput) -> HybridMemory:
        reading = seen.readings[self.sensor]
        off, still = reading.value - _UP, jnp.zeros_like(reading.value)
        return HybridMemory(
            off=off,
            taken=reading.measurement_time,
            rate=still,
            momentum=jnp.zeros(()),
            motion=self.balance.modes_of(_short_way(off), still),
            pushed=jnp.zeros(self.late + 1),
            speed=seen.actuators[0].velocity[self.channel],
            balances=jnp.asarray(False),
        )

    def command(self, memory: HybridMemory, seen: ControllerInput) -> tuple[Command, HybridMemory]:
        reading, servo = seen.readings[self.sensor], seen.actuators[0]
        position, speed = servo.position[self.channel], servo.velocity[self.channel]
        # unwrapped angles and their rates
        moved = _short_way(reading.value - _UP - memory.off)
        lasted = reading.measurement_time - memory.taken
        new, share = lasted > 0, lasted / (self.filter_time + lasted)
        rate = memory.rate + share * (moved / jnp.where(new, lasted, 1.0) - memory.rate)
        off, rate = memory.off + moved, jnp.where(new, rate, memory.rate)

        observed, model = self.balance.modes_of(_short_way(off), rate), self.balance.filter
        pushed = jnp.append(memory.pushed[1:], (speed - memory.speed) / self.period)
        followed = model.correct(model.predict(memory.motion, pushed[:1]), observed)
        # far from upright the modes of the upright arm do not apply: measurements alone count
        motion = jnp.where(memory.balances, followed, observed)
        now = model.predict(motion, pushed[1:])
        state = jnp.concatenate([now, jnp.stack([position, speed])])
        met = jnp.stack([jnp.max(jnp.abs(_short_way(off))), self.balance.effort(state)])
        balances = jnp.all(met < jnp.where(memory.balances, self.release, self.catch))

        energy, forward, ahead = self.pendulum.swing(off, rate, speed)
        share = self.period / (self.period + self.momentum_time)
        momentum = memory.momentum + share * (forward - memory.momentum)
        lacking = jnp.clip(-energy / self.energy, -1.0, 1.0)
        swung = lacking * jnp.tanh(momentum / self.momentum + ahead / self.reach)
        low, high = seen.lower[self.channel], seen.upper[self.channel]
        driven = jnp.where(
            balances,
            -product(self.balance.gain[None], state)[0],
            _ROOM * jnp.minimum(-low, high) * swung,
        )
        command = jnp.zeros_like(seen.command).at[self.channel].set(driven)
        return command, HybridMemory(
            off, reading.measurement_time, rate, momentum, motion, pushed, speed, balances
        )


def _short_way(turn: Stations) -> Stations:
    return turn - 2 * jnp.pi * jnp.round(turn / (2 * jnp.pi))
