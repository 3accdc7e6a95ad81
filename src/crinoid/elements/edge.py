"""Forces and masses spread along an edge: Simpson's rule, and the share that each end bears.

Positions, velocities and diameters run linearly from end to end of an edge. A force per length
``f`` loads an end by the integral of ``f`` times the share of that end, which falls linearly from
one to none: the work of the forces on the ends is then that of the force along the edge. Simpson's
rule is exact for cubics, such as the weight of a frustum times a share. A mass matrix is that of
linear finite elements, exact for a frustum as well. Together with the bends' own shares
(`crinoid.rod.Rod.strain_length`) it makes small vibrations without a force along the arm of fourth
order in the edge length.
"""

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


def mass_matrices(mass: Float[Array, "edge 3"]) -> Float[Array, "edge 2 2"]:
    """Return the integrals of ``mass`` times the shares of two ends; it runs along a parabola."""
    start, middle = jnp.array([[9.0, 1.0], [1.0, -1.0]]), jnp.array([[12.0, 8.0], [8.0, 12.0]])
    return jnp.tensordot(mass, jnp.stack([start, middle, start[::-1, ::-1]]) / 60, 1)
