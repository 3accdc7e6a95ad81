"""The running accounts of an arm: works of the energy ledger, and what contacts did."""

import equinox as eqx
from jaxtyping import Array, Float

from crinoid.dynamics.obstacles import Touch


class Books(eqx.Module):
    """Sums since the start. No step needs them: only runs that ask keep them. SI units."""

    working: Float[Array, "work n b"]
    """Forces on the nodes whose work is not stored, in the order of `crinoid.elements.WORKS` (N),
    torques about the edges (N m)."""
    work: Float[Array, " work"]
    """Work done on the arm since the start, in the same order (J)."""
    touch: Touch | None
    """Forces, impulses and times of the obstacles on the arm."""
