"""Balance of forces at the end of a step, and the derivative of its solution."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.dynamics.acting import ActingForces
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import BOUNDARY_NODES, Rows
from crinoid.dynamics.tangent import Tangent
from crinoid.dynamics.tangent_assembly import assemble_tangent
from crinoid.dynamics.windows import Surroundings
from crinoid.elements import Motion


class Balance(eqx.Module):
    """Balance of forces at the end of a step, as a function of the correction."""

    forces: ActingForces
    around: Surroundings
    """The water, expanded about given positions."""
    stage: StepMap
    load_factor: Float[Array, ""] | None = None
    """Factor on the forces from outside; None for 1."""

    def motion(self, correction: Rows) -> Motion:
        """Return the motion of all rows for a correction."""
        return self.forces.motion(self.stage, correction, self.around)

    def residual(self, motion: Motion) -> tuple[Rows, Float[Array, " b"]]:
        """Return the residual, and the largest single force in it of each column (N)."""
        return self.forces.residual(motion, self.load_factor)

    def tangent(self, motion: Motion) -> Tangent:
        """Return d(residual)/d(correction)."""
        return assemble_tangent(self.forces, self.stage, motion, self.around, self.load_factor)


def implicit_derivative(
    balance: Balance, t_balance: Any, correction: Rows, tangent: Tangent
) -> tuple[Rows, Float[Array, "held b"]]:
    """Return the derivatives of a converged correction and of the forces on prescribed nodes.

    ``t_balance`` is the tangent of the balance, ``tangent`` the matrix at the correction.
    """
    _, t_residual = eqx.filter_jvp(
        lambda balance: balance.residual(balance.motion(correction))[0], (balance,), (t_balance,)
    )
    if t_residual is None:  # no force depends on the varied numbers
        t_residual = jnp.zeros_like(correction)
    t_correction = tangent.solve(-t_residual)
    return t_correction, t_residual[:BOUNDARY_NODES] + tangent.on_held(t_correction)


def zero_tangents(tree: Any) -> Any:
    """Return zero tangents."""
    return jax.tree.map(lambda x: jnp.zeros_like(x) if eqx.is_inexact_array(x) else None, tree)
