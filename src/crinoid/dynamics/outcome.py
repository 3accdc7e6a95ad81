"""Outcome of a solve and of a time step: convergence, and folds."""

import math
import warnings
from collections.abc import Sequence
from enum import IntEnum
from typing import TypeVar

import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.forces import Forces
from crinoid.foundation.axes import LARGEST_TURN
from crinoid.foundation.fixed_numbers import KNOWN_ROUND_OFF, UNSEEN_BEND
from crinoid.rod.reference import Reference


def round_off_note(
    stretching: float, bending: float, length: float, edge: float, largest: float
) -> str:
    """Return a sentence if round-off of the stretch is not small compared to the loads, or none.

    Positions on an arm of length L are accurate to about eps L, the strain of an edge l to
    eps L / l, and the forces on both of its ends add up.

    Parameters
    ----------
    stretching, bending
        Stiffness EA (N) and EI (N m2).
    length, edge
        Length of the arm and of an edge (m).
    largest
        Largest force on the base (N).
    """
    noise = 2 * np.finfo(float).eps * stretching * length / edge
    if noise <= max(KNOWN_ROUND_OFF * largest, UNSEEN_BEND * bending / length**2):
        return ""
    return (
        f"forces are accurate to {noise:.2g} N only, the round-off of an arm this stiff to "
        f"stretch (EA = {stretching:.2g} N), and the largest on the base is {largest:.2g} N. "
        "Lower arm.section.EA; that changes nothing else as long as the arm hardly stretches"
    )


def warn_of_round_off(reference: Reference, forces: Forces, base_force: Float[Array, " b"]) -> None:
    """Warn of `round_off_note` by the force on the base (N), outside of JAX transformations."""
    if forces.stretch is None:
        return
    sizes = forces.bending_stiffness(reference), reference.length, reference.rest_length
    values = forces.stretch.EA, *sizes, jnp.linalg.norm(base_force)
    if any(isinstance(each, jax.core.Tracer) for each in values):
        return
    if note := round_off_note(*(float(each.min()) for each in values)):
        warnings.warn(note, RuntimeWarning, stacklevel=3)


Tree = TypeVar("Tree")


class Reason(IntEnum):
    """Reason for rejecting a time step."""

    NONE = 0
    IMBALANCE = 1
    FOLDED = 2
    HIT = 3
    ERROR = 4

    @property
    def words(self) -> str:
        """Sentence for messages."""
        return _WORDS[self]


_WORDS = {
    Reason.NONE: "the time step is accepted",
    Reason.IMBALANCE: "Newton's method did not converge. Lower the time step",
    Reason.FOLDED: "the arm folds onto itself. Use more nodes or a smaller time step",
    Reason.HIT: "a contact force changes too fast for this time step. Lower it",
    Reason.ERROR: "the local error of the time step exceeds its limit. Lower the time step",
}


class Outcome(eqx.Module):
    """Outcome of a solve.

    Attributes
    ----------
    converged
        Whether the result is valid; if not, do not use it.
    iterations
        Iterations of Newton's method.
    residual
        Largest imbalance of a node, a free obstacle or a vehicle (N). A torque counts as a
        couple on an edge, that of a body over its radius of gyration.
    scale
        Largest single force in the balance (N).
    worst_node
        Node with the largest imbalance; the root is 0, the free obstacles come after the
        tip, then their rotations, then a vehicle.
    resolved
        Whether a balanced step was short enough for its contacts; if not it has not
        converged.
    folded
        Whether a balanced step bent an edge back onto the one before; then it is rejected.
    error
        Estimated local error of the positions after a balanced step (m); of an equilibrium,
        the last movement of an arm whose tendons rub, where it has not settled.

    Examples
    --------
    >>> import equinox as eqx
    >>> system = crinoid.system(crinoid.load("still-water", ["arm.nodes=5"]))
    >>> _, outcome = eqx.filter_jit(crinoid.System.find_equilibrium)(system, jnp.array(0.0))
    >>> bool(outcome.converged), bool(outcome.residual < 1e-6)
    (True, True)
    """

    converged: Bool[Array, ""]
    iterations: Int[Array, ""]
    residual: Float[Array, ""]
    scale: Float[Array, ""]
    worst_node: Int[Array, ""]
    resolved: Bool[Array, ""]
    folded: Bool[Array, ""]
    error: Float[Array, ""]

    @property
    def reason(self) -> Int[Array, ""]:
        """Reason for rejecting a step, or that it is accepted (`crinoid.dynamics.Reason`)."""
        found = jnp.where(self.error > 0, Reason.ERROR, Reason.IMBALANCE)
        found = jnp.where(self.folded, Reason.FOLDED, found)
        found = jnp.where(self.resolved, found, Reason.HIT)
        return jnp.where(self.converged, Reason.NONE, found)

    def imbalance(self, nodes: int, free: Sequence[int]) -> str:
        """Describe what an equilibrium lacks: the largest imbalance and where it is.

        ``nodes`` is the number of nodes, ``free`` has the indices of the floating obstacles.
        """
        if not np.isfinite(self.residual):
            return "forces grew without bound"
        if self.error > 0:
            return f"friction of tendons still moves the arm by {1e3 * float(self.error):.3g} mm"
        worst = int(self.worst_node)
        name, body = f"node {worst}", worst - nodes
        if body >= 0:
            # the positions of the free obstacles, then their rotations
            many = 2 * len(free)
            name = f"obstacle {free[body % len(free)]}" if body < many else "the vehicle"
        return (
            f"{name} is out of balance by {float(self.residual):.3g} N "
            f"among forces of up to {float(self.scale):.3g} N"
        )

    def raise_unless_converged(self, after: Tree) -> Tree:
        """Return the state after a step; raise the reason at run time if it has not converged."""
        words = [reason.words for reason in Reason if reason is not Reason.NONE]
        return eqxi.branched_error_if(after, ~self.converged, self.reason - 1, words)

    @staticmethod
    def of_nothing(*, converged: bool) -> "Outcome":
        """Return the outcome of no iterations, the start of a loop."""
        none, zero, yes, no = jnp.asarray(0), jnp.zeros(()), jnp.asarray(True), jnp.asarray(False)
        return Outcome(jnp.asarray(converged), none, zero, zero, none, yes, no, zero)


MIN_COSINE = math.cos(math.radians(LARGEST_TURN))
"""Cosine of the largest valid turn between two edges.

At half a turn the strains are infinite; a step can jump over it, to a bend of the other sign.
"""


def cos_turn_angle(forces: Forces, position: Float[Array, "rows b"]) -> Float[Array, " bent"]:
    """Return the cosine of the turn at each node but the tip.

    It is 1 without bending stiffness: a planar pinned root may point anywhere. One in space resists
    twist, which is undefined past half a turn.
    """
    edges = jnp.diff(forces.nodes(position)[:, : forces.axes], axis=0)
    tangent = edges / jnp.sqrt(jnp.sum(edges**2, axis=1))[:, None]
    cosine = jnp.sum(tangent[1:] * tangent[:-1], axis=1)
    bend = forces.bend
    if bend is None:
        return jnp.ones_like(cosine)
    resists = jnp.max(bend.stiffness.reshape(cosine.size, -1), axis=1) > 0
    return jnp.where(resists, cosine, 1.0)


class StepStatistics(eqx.Module):
    """Statistics of the solves of one or several time steps."""

    outcome: Outcome | None
    """Outcome of the last solve; None where only sums are kept."""
    residual: Float[Array, ""]
    """Largest imbalance of a substep that succeeded (N)."""
    error: Float[Array, ""]
    """Largest estimated local error of a substep that succeeded (m)."""
    steps: Int[Array, ""]
    """Number of substeps that succeeded."""
    iterations: Int[Array, ""]
    """Newton iterations of all solves, failed ones included."""

    @staticmethod
    def of_nothing() -> "StepStatistics":
        """Return the statistics of no solves."""
        zero, none = jnp.zeros(()), jnp.asarray(0)
        return StepStatistics(None, zero, zero, none, none)

    def with_solve(self, outcome: Outcome) -> "StepStatistics":
        """Return the statistics with one more solve."""
        good = outcome.converged
        return StepStatistics(
            outcome,
            jnp.maximum(self.residual, jnp.where(good, outcome.residual, 0.0)),
            jnp.maximum(self.error, jnp.where(good, outcome.error, 0.0)),
            self.steps + good,
            self.iterations + outcome.iterations,
        )
