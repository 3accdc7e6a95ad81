"""Round-off of the force that stretches an arm, compared with the loads."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.dynamics.forces import Forces
from crinoid.reference import Reference

_KNOWN = 0.01
"""Share of the largest force on the base that round-off may have of it."""
_BENDS = 1e-6
"""Share of EI / L^2 up to which a force bends no arm that anyone could see."""


def round_off_note(
    stretching: float, bending: float, length: float, edge: float, largest: float
) -> str:
    """Return a sentence if round-off of the stretch is not small compared with the loads.

    Positions on an arm of length L are known to about eps L, the strain of an edge l to
    eps L / l, and the forces on both ends of it add up.

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
    if noise <= max(_KNOWN * largest, _BENDS * bending / length**2):
        return ""
    return (
        f"forces are known to about {noise:.2g} N only, the round-off of an arm this stiff to "
        f"stretch (EA = {stretching:.2g} N), and the largest on the base is {largest:.2g} N: "
        "a smaller arm.section.EA changes nothing else as long as the arm hardly stretches"
    )


def warn_of_round_off(reference: Reference, forces: Forces, base_force: Float[Array, " b"]) -> None:
    """Warn as `round_off_note` says, by the force on the base (N); JAX transformations cannot."""
    if forces.stretch is None:
        return
    sizes = forces.bending_stiffness(reference), reference.length, reference.rest_length
    values = forces.stretch.EA, *sizes, jnp.linalg.norm(base_force)
    if any(isinstance(each, jax.core.Tracer) for each in values):
        return
    if note := round_off_note(*(float(each.min()) for each in values)):
        warnings.warn(note, RuntimeWarning, stacklevel=3)
