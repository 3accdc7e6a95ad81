"""Time integration by methods of the generalized-alpha family."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements import Motion
from crinoid.numerics.frames import Frames

Nodes = Float[Array, "n b"]


class StepMap(eqx.Module):
    """Affine map from the correction ``d`` of the nodes to their motion at the end of a step.

    ``q = position + by_position d``, likewise velocity and acceleration: all that Newton's method
    needs of an integrator. With ``d`` measured from a prediction the acceleration is free of
    cancellation at small steps.
    """

    time: Float[Array, ""]
    position: Nodes
    velocity: Nodes
    acceleration: Nodes
    by_position: Float[Array, ""]
    by_velocity: Float[Array, ""]
    by_acceleration: Float[Array, ""]
    frames: Frames | None = None
    """Frames in space from which those of the motion follow."""
    fixed_fields: tuple[str, ...] = eqx.field(static=True, default=())
    """Fields without a derivative, of position and velocity: the tangent omits them."""


class Integrator(eqx.Module):
    """One-step methods of the generalized-alpha family, which differ by numbers only.

    The forces are balanced at the end of each step, at ``(q', v', acceleration')``. Positions and
    velocities follow an auxiliary acceleration ``a`` (Arnold and Bruels 2007, equations 6 and 7):
    ``q' = q + h v + h^2 (beta_old a + beta a')``, ``v' = v + h (gamma_old a + gamma a')`` and
    ``(1 - alpha_m) a' + alpha_m a = (1 - alpha_f) acceleration' + alpha_f acceleration``. The
    correction ``d`` that Newton's method finds is ``beta h^2 a'``.
    """

    alpha_m: Float[Array, ""]
    alpha_f: Float[Array, ""]
    beta: Float[Array, ""]
    gamma: Float[Array, ""]
    beta_old: Float[Array, ""]
    gamma_old: Float[Array, ""]

    @staticmethod
    def newmark(beta: float | Array = 0.25, gamma: float | Array = 0.5) -> "Integrator":
        """Newmark (1959); the default is the trapezoid rule: order 2, no numerical damping."""
        return _integrator(0.0, 0.0, beta, gamma, 0.5 - beta, 1.0 - gamma)

    @staticmethod
    def generalized_alpha(spectral_radius: float | Array = 0.8) -> "Integrator":
        """Chung and Hulbert (1993): order 2, damps what the step cannot resolve.

        ``spectral_radius`` is the factor of amplitude of the fastest vibration per step: 1 damps
        nothing, 0 removes it in one step.
        """
        alpha_m = (2 * spectral_radius - 1) / (spectral_radius + 1)
        alpha_f = spectral_radius / (spectral_radius + 1)
        gamma = 0.5 - alpha_m + alpha_f
        beta = 0.25 * (1 - alpha_m + alpha_f) ** 2
        return _integrator(alpha_m, alpha_f, beta, gamma, 0.5 - beta, 1.0 - gamma)

    @staticmethod
    def implicit_euler() -> "Integrator":
        """Backward Euler, for comparison: order 1, damps strongly."""
        return _integrator(0.0, 0.0, 1.0, 1.0, 0.0, 0.0)

    def stage(
        self, before: Motion, auxiliary_offset: Nodes, step: Array, frames: Frames | None
    ) -> StepMap:
        """Return the end of a step as a function of the correction.

        ``auxiliary_offset`` is the auxiliary acceleration at its start less the true one, over the
        length of the step before (m/s3): as a rate it serves steps of any length.
        """
        auxiliary = before.acceleration + step * auxiliary_offset
        held = self.alpha_m * auxiliary - self.alpha_f * before.acceleration
        per_step = self.beta * step
        return StepMap(
            before.time + step,
            before.position + step * before.velocity + self.beta_old * step**2 * auxiliary,
            before.velocity + self.gamma_old * step * auxiliary,
            held / (1 - self.alpha_f),
            jnp.ones(()),
            self.gamma / per_step,
            (1 - self.alpha_m) / ((1 - self.alpha_f) * per_step * step),
            frames,
        )

    def correction(self, acceleration: Nodes, step: Array) -> Nodes:
        """Return the correction of an auxiliary acceleration at the end of a step (m)."""
        return self.beta * step**2 * acceleration

    def auxiliary_offset(
        self, before: Nodes, auxiliary_offset: Nodes, after: Nodes, step: Array
    ) -> Nodes:
        """Return the auxiliary acceleration less the true one after a step, over its length.

        ``before`` and ``after`` are the true accelerations at its two ends.
        """
        change = self.alpha_f * (before - after) + self.alpha_m * (
            after - before - step * auxiliary_offset
        )
        return change / ((1 - self.alpha_m) * step)

    def error(self, before: Nodes, after: Nodes, step: Array) -> Nodes:
        """Estimate the local error of a step's positions (m) from the accelerations at both ends.

        The difference from the Taylor series with the rate of change of the acceleration:
        ``(beta - 1/6) h^2 (a' - a)`` of a Newmark method (Zienkiewicz and Xie 1991), less half of
        the time by which generalized-alpha's auxiliary acceleration lags; implicit Euler leaves
        out ``h^2 a / 2`` as well.
        """
        by_change = self.beta - 0.5 * (self.alpha_f - self.alpha_m) - 1 / 6
        whole = self.beta_old + self.beta - 0.5
        return step**2 * (whole * before + by_change * (after - before))


def _integrator(*numbers: float | Array) -> Integrator:
    return Integrator(*(jnp.asarray(number, float) for number in numbers))
