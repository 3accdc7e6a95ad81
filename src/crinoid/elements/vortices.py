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

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.element import Element, Motion
from crinoid.elements.oscillators import Oscillation, Oscillator
from crinoid.elements.water import smooth_speed
from crinoid.numerics.frames import cross, unit
from crinoid.rod import Rod


class VortexForces(NamedTuple):
    """Forces of vortices on the edges, and their phase."""

    force: Float[Array, "*many d"]
    """Force per length (N/m)."""
    phase: Float[Array, "*many"]
    """Phase of the lift, that of the part along the flow in the plane (rad)."""


class Shedding(NamedTuple):
    """Memory of shed vortices during a step."""

    state: Any
    """State of the oscillators at its start."""
    signals: Float[Array, "*count 2"]
    """Signals of both at its end."""


class Vortices(Element):
    """Forces of shed vortices, one oscillator across and one along the flow at each edge."""

    stencil: ClassVar[int] = 2
    external: ClassVar[bool] = True
    worked: ClassVar[str] = "drag"
    first: int = eqx.field(static=True)
    diameter: Float[Array, "*count"]  # m
    length: Float[Array, "*count"]
    """Length of the edge (m)."""
    density: Float[Array, "*count"]
    """Density of the water (kg/m3)."""
    coefficients: Float[Array, "*count 2"]
    """Amplitude of the force over ``1/2 rho D U^2``, across and along the flow."""
    angles: Float[Array, "*count 2"]
    """Seeded angles of both oscillators at the start (rad)."""
    oscillator: Oscillator
    """Both, across and along the flow, by the harmonic."""

    @staticmethod
    def of(
        rod: Rod,
        *,
        density: float | Array,
        coefficients: Float[Array, "2"],
        angles: Float[Array, "e 2"],
        oscillator: Oscillator,
    ) -> "Vortices":
        """Build the vortices of a rod; the oscillator's numbers have two entries."""
        edges = rod.rest_length.shape

        def each(number: Array) -> Array:
            return jnp.broadcast_to(number, (*edges, *number.shape))

        return Vortices(
            1,
            rod.edge_diameter[:, 1],
            rod.rest_length,
            each(jnp.asarray(density, float)),
            each(coefficients),
            angles,
            jax.tree.map(each, oscillator),
        )

    def prepared(self, memory: Any, step: Float[Array, "*count"]) -> "Shedding":
        return Shedding(memory, self.oscillator.signal(memory, step[..., None]))

    def residual(self, motion: Motion) -> Float[Array, "2 b"]:
        if motion.memory is None:
            return jnp.zeros_like(motion.position)
        half = 0.5 * self.length * self._force(*self._directions(motion), motion.memory.signals)
        return -jnp.stack([half, half])

    def steady(self, motion: Motion) -> Any:
        return self.oscillator.start(self.angles, self._oscillation(motion))

    def advance(self, motion: Motion) -> Any:
        assert motion.step is not None
        return self.oscillator.advance(motion.memory.state, self._oscillation(motion), motion.step)

    def forces(self, motion: Motion) -> VortexForces:
        """Return force per length (N/m) and phase of the lift (rad) in a state, without a step."""
        directions, speed = self._directions(motion)
        shown = int(directions.shape[-1] == 2)
        state, signals = motion.memory
        phase = self.oscillator.phase(state)[shown]
        return VortexForces(self._force(directions, speed, signals), phase)

    def _force(
        self, directions: Float[Array, "2 d"], speed: Float[Array, ""], signals: Float[Array, "2"]
    ) -> Float[Array, " d"]:
        pressure = 0.5 * self.density * self.diameter * speed**2
        return pressure * jnp.sum((self.coefficients * signals)[:, None] * directions, axis=0)

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

    def _oscillation(self, motion: Motion) -> Oscillation:
        """Return the oscillation across and along the flow."""
        directions, speed = self._directions(motion)
        flow = motion.flow_velocity - motion.velocity
        acceleration = motion.acceleration - motion.flow_acceleration
        return Oscillation(
            speed / self.diameter,
            speed,
            self.diameter,
            directions,
            jnp.broadcast_to(0.5 * (flow[0] + flow[1]), directions.shape),
            jnp.sum(directions * (0.5 * (acceleration[0] + acceleration[1])), axis=-1),
        )
