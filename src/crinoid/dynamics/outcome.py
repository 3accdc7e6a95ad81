"""Outcome of a solve: whether it counts, and why not."""

from collections.abc import Sequence
from enum import IntEnum
from typing import TypeVar

import equinox as eqx
import equinox.internal as eqxi
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

Tree = TypeVar("Tree")


class Reason(IntEnum):
    """Why a time step does not count."""

    NONE = 0
    IMBALANCE = 1
    FOLDED = 2
    HIT = 3
    ERROR = 4

    @property
    def words(self) -> str:
        """A sentence for messages."""
        return _WORDS[self]


_WORDS = {
    Reason.NONE: "the time step counts",
    Reason.IMBALANCE: "Newton's method found no balance of forces; take a smaller time step",
    Reason.FOLDED: "the arm folds onto itself; take more nodes or a smaller time step",
    Reason.HIT: "a hit is too hard or too fast for the time step; take a smaller one",
    Reason.ERROR: "the time step errs by more than is allowed; take a smaller one",
}


class Outcome(eqx.Module):
    """How a solve ended."""

    converged: Bool[Array, ""]
    """Whether the result counts; if not, do not use it."""
    iterations: Int[Array, ""]
    """Iterations of Newton's method."""
    residual: Float[Array, ""]
    """Largest imbalance of a node, a free obstacle or a vehicle (N).

    A torque counts as a couple on an edge, that of a vehicle over its radius of gyration.
    """
    scale: Float[Array, ""]
    """Largest single force in the balance (N)."""
    worst_node: Int[Array, ""]
    """Node with the largest imbalance; the root is 0, the free obstacles come after the tip,
    then a vehicle."""
    resolved: Bool[Array, ""]
    """Whether a balanced step was short enough for its contacts; if not it has not converged."""
    folded: Bool[Array, ""]
    """Whether a balanced step bent an edge back onto the one before; then it does not count."""
    error: Float[Array, ""]
    """Estimated local error of the positions after a balanced step (m)."""

    @property
    def reason(self) -> Int[Array, ""]:
        """Why a step does not count, `crinoid.dynamics.Reason`, or that it does."""
        found = jnp.where(self.error > 0, Reason.ERROR, Reason.IMBALANCE)
        found = jnp.where(self.folded, Reason.FOLDED, found)
        found = jnp.where(self.resolved, found, Reason.HIT)
        return jnp.where(self.converged, Reason.NONE, found)

    def imbalance(self, nodes: int, free: Sequence[int]) -> str:
        """Say which node, obstacle or vehicle is out of balance, and by how much.

        The arm has so many ``nodes``; ``free`` are the indices of the obstacles that float.
        """
        if not np.isfinite(self.residual):
            return "forces grew without bound"
        worst = int(self.worst_node)
        name, body = f"node {worst}", worst - nodes
        if body >= 0:
            name = f"obstacle {free[body]}" if body < len(free) else "the vehicle"
        return (
            f"{name} is out of balance by {float(self.residual):.3g} N "
            f"among forces of up to {float(self.scale):.3g} N"
        )

    def required(self, after: Tree) -> Tree:
        """Return the state after a step, or raise an error that says why it does not count.

        Raises
        ------
        equinox.EquinoxRuntimeError
            When the computation runs, if the step has not converged.
        """
        words = [reason.words for reason in Reason if reason is not Reason.NONE]
        return eqxi.branched_error_if(after, ~self.converged, self.reason - 1, words)

    @staticmethod
    def of_nothing(*, converged: bool) -> "Outcome":
        """Return the outcome of no iterations, to start a loop with."""
        none, zero, yes, no = jnp.asarray(0), jnp.zeros(()), jnp.asarray(True), jnp.asarray(False)
        return Outcome(jnp.asarray(converged), none, zero, zero, none, yes, no, zero)
