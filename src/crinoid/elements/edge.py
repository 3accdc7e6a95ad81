"""Forces and masses spread along an edge: Simpson's rule, and the share that each end bears.

Positions, velocities and properties run linearly from end to end of an edge. A force per length
``f`` loads an end by the integral of ``f`` times the share of that end, which falls linearly from
one to none: the work of the forces on the ends is then that of the force along the edge. Simpson's
rule is exact for what is linear times what is linear, so a mass is shared as that of linear
finite elements, and together with the bends' own shares (`crinoid.rod.Rod.strain_length`) small
vibrations without a force along the arm are of fourth order in the edge length.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def at_ends(nodal: Float[Array, " n"]) -> Float[Array, "n-1 2"]:
    """Return the values at both ends of each edge."""
    return jnp.stack([nodal[:-1], nodal[1:]], axis=1)


def along(ends: Float[Array, "2 ..."]) -> Float[Array, "3 ..."]:
    """Return what runs linearly from end to end at the start, in the middle and at the end."""
    return jnp.stack([ends[0], 0.5 * (ends[0] + ends[1]), ends[1]])


def shared(force: Float[Array, "3 ..."]) -> Float[Array, "2 ..."]:
    """Return what falls to each end of a force given at the start, the middle and the end."""
    middle = force[1] / 3
    return jnp.stack([force[0] / 6 + middle, middle + force[2] / 6])


def mass_matrices(ends: Float[Array, "edge 2"]) -> Float[Array, "edge 2 2"]:
    """Return the mass matrix of each edge, by its mass per length at the ends times its length."""
    accelerations = along(jnp.eye(2))  # of one end, then of the other
    return jax.vmap(lambda mass: shared(along(mass)[:, None] * accelerations))(ends)
