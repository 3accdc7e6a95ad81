"""Forces of shed vortices on the arm: lift across the flow and a smaller force along it.

At the middle of an edge ``w = u - v`` is the velocity of the water relative to the arm, ``w_n``
its part across the arm, ``U = |w_n|``, ``t`` the tangent, ``D`` the diameter, ``e = t x w_n / U``.
An oscillator at the edge gives a signal ``s``; the lift per length is ``1/2 rho D U^2 C s e``. It
feels how the arm oscillates in the water along ``e``, so vortices and arm lock in. A second
oscillator, of twice the frequency, acts along ``w_n / U``.

The oscillation has the velocity ``y' = (mean(w) - w) . e`` and the acceleration
``y'' = (a - Du/Dt) . e``. In a steady uniform current that is the arm's own velocity about its
mean. All of it is relative to the water: a towed arm has the vortices of one held in a current.
Eddies that a current carries past the arm are in ``y'``, but hardly in ``Du/Dt``.

The signal at the end of a step is predicted from the state at its start, the state follows from
the motion at the end: both to second order, and iterations see a force that depends on the
relative velocity alone. In an equilibrium vortices exert no mean force. A planar arm has the part
along the flow only: its lift points out of the plane.
"""

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.elements.water import smooth_speed
from crinoid.numerics.frames import cross, unit
from crinoid.rod import Rod
from crinoid.rod.reference import along, at_ends

Scalar = Float[Array, "*count"]

_PERIODS = 5.0
"""Shedding periods over which `Synchronisation` averages flow and motion of the arm."""
_STILL = 1e-3
"""Speed of the arm over that of the water below which it counts as still: 0.001 D of amplitude."""
_FIRST_SIGNAL = 0.1
"""Largest wake variable at the start."""


class Oscillation(NamedTuple):
    """Flow and motion of the arm at a place, along one direction."""

    shedding: Scalar
    """``U / D`` (1/s)."""
    speed: Scalar
    """``U`` (m/s)."""
    diameter: Scalar
    """m."""
    direction: Float[Array, "*count d"]
    """Unit vector of the oscillation."""
    relative: Float[Array, "*count d"]
    """Velocity of the water relative to the arm (m/s)."""
    acceleration: Scalar
    """Acceleration of the arm relative to the water, along the direction (m/s2)."""


class Oscillator(eqx.Module):
    """Oscillator of the vortices at a place; ``harmonic`` times the frequency of shedding."""

    harmonic: eqx.AbstractVar[int]

    @abstractmethod
    def start(self, angle: Scalar, at: Oscillation) -> Any:
        """Return the state at the start, from the phase of the signal (rad) and the motion."""

    @abstractmethod
    def advance(self, state: Any, at: Oscillation, step: Scalar) -> Any:
        """Return the state after a step of given length (s), from the motion at its end."""

    @abstractmethod
    def signal(self, state: Any, step: Scalar) -> Scalar:
        """Return the force over ``1/2 rho D U^2 C`` after a step, predicted from the state before.

        1 is the amplitude on a fixed cylinder. The prediction is of second order.
        """

    @abstractmethod
    def phase(self, state: Any) -> Scalar:
        """Return the phase of the signal (rad)."""


class Synchronised(NamedTuple):
    """State of `Synchronisation`."""

    angle: Scalar
    """Phase of the lift (rad)."""
    rate: Scalar
    """Its rate (rad/s)."""
    flows: Float[Array, "*count 3 d"]
    """Velocity of the water relative to the arm: now, its mean, the mean of this mean (m/s)."""
    mean_squares: Float[Array, "*count 2"]
    """Mean squares of the oscillation's velocity (m2/s2) and acceleration (m2/s4)."""
    squares: Float[Array, "*count 2"]
    """Present squares of both."""


class Synchronisation(Oscillator):
    """Phase oscillator that follows the arm's velocity where the frequencies are near.

    ``phi' = 2 pi (U / D) (centre + range sin(phi_v - phi))``, signal ``cos phi``, with the phase
    ``phi_v = atan2(-y'' / y''_rms, y' / y'_rms)`` of the arm (Thorsen, Saevik and Larsen 2014,
    Journal of Fluids and Structures 51, eq. 12 and 13). The means are over five shedding periods.
    That of the flow is taken twice, which shifts no phase: one mean alone would by 2 degrees.
    """

    harmonic: int = eqx.field(static=True)
    centre: Scalar
    """Frequency of shedding over ``U / D`` out of lock-in."""
    range: Scalar
    """Half the width of lock-in, over ``U / D``."""

    def start(self, angle: Scalar, at: Oscillation) -> Synchronised:
        flows = jnp.stack([at.relative] * 3, axis=-2)
        velocity = self._velocity(flows, at)
        squares = self._squares(velocity, at)
        return Synchronised(
            angle, self._rate(angle, velocity, squares, at), flows, squares, squares
        )

    def advance(self, state: Synchronised, at: Oscillation, step: Scalar) -> Synchronised:
        left = jnp.exp(-step * self.harmonic * self.centre * at.shedding / _PERIODS)

        def mean(past: Array, before: Array, after: Array) -> Array:
            return left[..., None] * past + (1.0 - left[..., None]) * 0.5 * (before + after)

        once = mean(state.flows[..., 1, :], state.flows[..., 0, :], at.relative)
        twice = mean(state.flows[..., 2, :], state.flows[..., 1, :], once)
        flows = jnp.stack([at.relative, once, twice], axis=-2)
        velocity = self._velocity(flows, at)
        squares = self._squares(velocity, at)
        means = mean(state.mean_squares, state.squares, squares)
        # Heun's method
        guess = self._rate(state.angle + step * state.rate, velocity, means, at)
        angle = state.angle + 0.5 * step * (state.rate + guess)
        rate = self._rate(angle, velocity, means, at)
        return Synchronised(angle, rate, flows, means, squares)

    def signal(self, state: Synchronised, step: Scalar) -> Scalar:
        return jnp.cos(state.angle + step * state.rate)

    def phase(self, state: Synchronised) -> Scalar:
        return state.angle

    def _velocity(self, flows: Float[Array, "*count 3 d"], at: Oscillation) -> Scalar:
        return jnp.sum((flows[..., 2, :] - flows[..., 0, :]) * at.direction, axis=-1)

    def _squares(self, velocity: Scalar, at: Oscillation) -> Float[Array, "*count 2"]:
        return jnp.stack([velocity**2, at.acceleration**2], axis=-1)

    def _rate(
        self, angle: Scalar, velocity: Scalar, means: Float[Array, "*count 2"], at: Oscillation
    ) -> Scalar:
        frequency = 2.0 * jnp.pi * self.harmonic * at.shedding
        still = _STILL * at.speed
        floor = jnp.finfo(float).tiny
        own = jnp.sqrt(
            (means[..., 1] + (self.centre * frequency * still) ** 2 + floor)
            / (means[..., 0] + still**2 + floor)
        )
        # of a still arm the phase is 0
        cosine, sine, none = own * velocity, -at.acceleration, own * still
        size = jnp.sqrt(cosine**2 + sine**2 + none**2 + floor)
        ahead = (sine * jnp.cos(angle) - (cosine + none) * jnp.sin(angle)) / size
        return frequency * (self.centre + self.range * ahead)


class Wake(NamedTuple):
    """State of `WakeOscillator`."""

    variable: Float[Array, "*count 2"]
    """The wake variable ``q`` and its rate (1/s)."""
    frequency: Scalar
    """Circular frequency of shedding (rad/s)."""
    forcing: Scalar
    """Forcing by the arm (1/s2)."""


class WakeOscillator(Oscillator):
    """Van der Pol oscillator that the arm's acceleration drives.

    ``q'' + damping W (q^2 - 1) q' + W^2 q = (coupling / D) y''`` with ``W = 2 pi strouhal U / D``
    and the signal ``q / 2`` (Facchinetti, de Langre and Biolley 2004, Journal of Fluids and
    Structures 19, eq. 9 and 18). A step is one of the classical Runge-Kutta method, with W and y''
    linear in between.
    """

    harmonic: int = eqx.field(static=True)
    strouhal: Scalar
    """Frequency of shedding over ``U / D``."""
    coupling: Scalar
    damping: Scalar

    def start(self, angle: Scalar, at: Oscillation) -> Wake:
        frequency, forcing = self._frequency(at), self._forcing(at)
        turned = jnp.stack([jnp.cos(angle), -frequency * jnp.sin(angle)], axis=-1)
        return Wake(_FIRST_SIGNAL * turned, frequency, forcing)

    def advance(self, state: Wake, at: Oscillation, step: Scalar) -> Wake:
        return self._advance(state, self._frequency(at), self._forcing(at), step)

    def _advance(self, state: Wake, frequency: Scalar, forcing: Scalar, step: Scalar) -> Wake:
        def rate(share: float, variable: Array) -> Array:
            W = state.frequency + share * (frequency - state.frequency)
            force = state.forcing + share * (forcing - state.forcing)
            q, speed = variable[..., 0], variable[..., 1]
            slowed = self.damping * W * (q**2 - 1.0) * speed + W**2 * q
            return jnp.stack([speed, force - slowed], axis=-1)

        y, h = state.variable, step[..., None]
        a = rate(0.0, y)
        b = rate(0.5, y + 0.5 * h * a)
        c = rate(0.5, y + 0.5 * h * b)
        d = rate(1.0, y + h * c)
        return Wake(y + h / 6.0 * (a + 2.0 * (b + c) + d), frequency, forcing)

    def signal(self, state: Wake, step: Scalar) -> Scalar:
        after = self._advance(state, state.frequency, state.forcing, step)
        return 0.5 * after.variable[..., 0]

    def phase(self, state: Wake) -> Scalar:
        q, speed = state.variable[..., 0], state.variable[..., 1]
        return jnp.arctan2(-speed, state.frequency * q)

    def _frequency(self, at: Oscillation) -> Scalar:
        return 2.0 * jnp.pi * self.harmonic * self.strouhal * at.shedding

    def _forcing(self, at: Oscillation) -> Scalar:
        return self.coupling / at.diameter * at.acceleration


class VortexForces(NamedTuple):
    """Forces of vortices on the edges, and their phase."""

    force: Float[Array, "*many d"]
    """Force per length (N/m)."""
    phase: Float[Array, "*many"]
    """Phase of the lift, that of the part along the flow in the plane (rad)."""


class Vortices(Element):
    """Forces of shed vortices, one oscillator across and one along the flow at each edge."""

    stencil: ClassVar[int] = 2
    external: ClassVar[bool] = True
    worked: ClassVar[str] = "drag"
    first: int = eqx.field(static=True)
    diameter: Float[Array, "*count"]
    """m."""
    length: Float[Array, "*count"]
    """Length of the edge (m)."""
    density: Float[Array, "*count"]
    """Density of the water (kg/m3)."""
    coefficients: Float[Array, "*count 2"]
    """Amplitude of the force over ``1/2 rho D U^2``, across and along the flow."""
    angles: Float[Array, "*count 2"]
    """Seeded angles of both oscillators at the start (rad)."""
    oscillators: tuple[Oscillator, Oscillator]
    """Across and along the flow."""
    memory: Any = None
    step: Float[Array, "*count"] | None = None
    signals: Float[Array, "*count 2"] | None = None
    """Signals of both at the end of the step."""

    @staticmethod
    def of(
        rod: Rod,
        *,
        density: float | Array,
        coefficients: Float[Array, "2"],
        angles: Float[Array, "e 2"],
        oscillators: tuple[Oscillator, Oscillator],
    ) -> "Vortices":
        """Build the vortices of a rod; the numbers of the oscillators are scalars."""
        edges = rod.rest_length.shape

        def each(number: Array) -> Array:
            return jnp.broadcast_to(number, (*edges, *number.shape))

        return Vortices(
            1,
            jax.vmap(along)(at_ends(rod.diameter))[:, 1],
            rod.rest_length,
            each(jnp.asarray(density, float)),
            each(coefficients),
            angles,
            jax.tree.map(each, oscillators),
        )

    def remembering(self, memory: Any, step: Array | None) -> "Vortices":
        signals = None
        if memory is not None and step is not None:
            pairs = zip(self.oscillators, memory, strict=True)
            # once a step and not in each iteration
            signals = jnp.stack([each.signal(state, step) for each, state in pairs], axis=-1)
        return replace(self, memory=memory, step=step, signals=signals)

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        if self.signals is None:
            return jnp.zeros_like(motion.position)
        half = 0.5 * self.length * self._force(*self._directions(motion))
        return -jnp.stack([half, half])

    def steady(self, motion: Motion) -> Any:
        return tuple(
            oscillator.start(angle, at)
            for oscillator, angle, at in zip(
                self.oscillators, self.angles, self._oscillations(motion), strict=True
            )
        )

    def advance(self, motion: Motion) -> Any:
        assert self.step is not None
        return tuple(
            oscillator.advance(state, at, self.step)
            for oscillator, state, at in zip(
                self.oscillators, self.memory, self._oscillations(motion), strict=True
            )
        )

    def forces(self, motion: Motion) -> VortexForces:
        """Return force per length (N/m) and phase of the lift (rad) in a state, without a step."""
        directions, speed = self._directions(motion)
        shown = int(directions.shape[-1] == 2)
        phase = self.oscillators[shown].phase(self.memory[shown])
        return VortexForces(self._force(directions, speed), phase)

    def _force(
        self, directions: Float[Array, "2 d"], speed: Float[Array, ""]
    ) -> Float[Array, " d"]:
        assert self.signals is not None
        pressure = 0.5 * self.density * self.diameter * speed**2
        return pressure * jnp.sum((self.coefficients * self.signals)[:, None] * directions, axis=0)

    def _directions(self, motion: Motion) -> tuple[Float[Array, "2 d"], Float[Array, ""]]:
        """Return the directions across and along the flow, and its speed across the arm."""
        tangent, _ = unit(motion.position[1] - motion.position[0])
        ends = motion.flow_velocity - motion.velocity
        relative = 0.5 * (ends[0] + ends[1])
        normal = relative - jnp.sum(relative * tangent) * tangent
        speed = smooth_speed(jnp.sum(normal**2))
        downstream = normal / speed
        # out of the plane of a planar arm
        aside = cross(tangent, downstream) if tangent.size == 3 else jnp.zeros(2)
        return jnp.stack([aside, downstream]), speed

    def _oscillations(self, motion: Motion) -> list[Oscillation]:
        """Return the oscillation across and along the flow."""
        directions, speed = self._directions(motion)
        velocity, acceleration = (
            0.5 * (ends[0] + ends[1])
            for ends in (
                motion.flow_velocity - motion.velocity,
                motion.acceleration - motion.flow_acceleration,
            )
        )
        return [
            Oscillation(
                speed / self.diameter,
                speed,
                self.diameter,
                direction,
                velocity,
                jnp.sum(direction * acceleration),
            )
            for direction in directions
        ]
