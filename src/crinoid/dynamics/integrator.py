"""Time integration: where in the step the forces are balanced, and how the motion follows."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.frames import Frames

Nodes = Float[Array, "n b"]


class Stage(eqx.Module):
    """The motion of the nodes as an affine function of the unknown correction ``d``.

    ``q = position + by_position d``, and so on for velocity and acceleration: all that Newton's
    method needs to know of an integrator. Measuring ``d`` from a prediction keeps the
    acceleration free of cancellation at small steps.
    """

    time: Float[Array, ""]
    position: Nodes
    velocity: Nodes
    acceleration: Nodes
    by_position: Float[Array, ""]
    by_velocity: Float[Array, ""]
    by_acceleration: Float[Array, ""]
    frames: Frames | None = None
    """In space the frames that the motion takes along."""


class Integrator(eqx.Module):
    """One-step methods of the generalized-alpha family; all of them differ by numbers only.

    With the correction ``d`` of the new positions,
    ``q' = q + h v + lead h^2 a + d``, ``v' = v + lag h a + gamma / (beta h) d`` and
    ``a' = d / (beta h^2)``; the forces are balanced at ``(1 - alpha_f) (q', v') + alpha_f (q, v)``
    and ``(1 - alpha_m) a' + alpha_m a``.
    """

    alpha_m: Float[Array, ""]
    alpha_f: Float[Array, ""]
    beta: Float[Array, ""]
    gamma: Float[Array, ""]
    lead: Float[Array, ""]
    lag: Float[Array, ""]

    @staticmethod
    def newmark(beta: float | Array = 0.25, gamma: float | Array = 0.5) -> "Integrator":
        """Newmark (1959); the default is the trapezoid rule: order 2, no numerical damping."""
        return _integrator(0.0, 0.0, beta, gamma, 0.5 - beta, 1.0 - gamma)

    @staticmethod
    def generalized_alpha(spectral_radius: float | Array = 0.8) -> "Integrator":
        """Chung and Hulbert (1993): order 2, damps what the step cannot resolve.

        ``spectral_radius`` is the share of amplitude that the fastest vibration keeps per step:
        1 damps nothing, 0 removes it at once.
        """
        alpha_m = (2 * spectral_radius - 1) / (spectral_radius + 1)
        alpha_f = spectral_radius / (spectral_radius + 1)
        gamma = 0.5 - alpha_m + alpha_f
        beta = 0.25 * (1 - alpha_m + alpha_f) ** 2
        return _integrator(alpha_m, alpha_f, beta, gamma, 0.5 - beta, 1.0 - gamma)

    @staticmethod
    def implicit_euler() -> "Integrator":
        """Backward Euler, to compare: order 1, damps strongly."""
        return _integrator(0.0, 0.0, 1.0, 1.0, 0.0, 0.0)

    def predict(
        self, position: Nodes, velocity: Nodes, acceleration: Nodes, step: Array
    ) -> tuple[Nodes, Nodes]:
        """Return new positions and velocities for ``d = 0``, a new acceleration of zero."""
        return (
            position + step * velocity + self.lead * step**2 * acceleration,
            velocity + self.lag * step * acceleration,
        )

    def rates(self, step: Array) -> tuple[Array, Array]:
        """Return d(velocity)/dd and d(acceleration)/dd."""
        return self.gamma / (self.beta * step), 1.0 / (self.beta * step**2)

    def error(self, before: Nodes, after: Nodes, step: Array) -> Nodes:
        """Estimate the local error of a step's positions (m) from the accelerations at both ends.

        The difference from the Taylor series with the rate of change of the acceleration:
        ``(beta - 1/6) h^2 (a' - a)`` of a Newmark method (Zienkiewicz and Xie 1991), less half of
        the lag that generalized-alpha's accelerations have; implicit Euler leaves out
        ``h^2 a / 2`` as well.
        """
        by_change = self.beta - 0.5 * (self.alpha_f - self.alpha_m) - 1 / 6
        whole = self.lead + self.beta - 0.5
        return step**2 * (whole * before + by_change * (after - before))


def _integrator(*numbers: float | Array) -> Integrator:
    return Integrator(*(jnp.asarray(number, float) for number in numbers))
