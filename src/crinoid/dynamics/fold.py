"""Folds: edges that turn back onto the ones before them."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.dynamics.forces import Forces
from crinoid.space import LARGEST_TURN

SHARPEST = math.cos(math.radians(LARGEST_TURN))
"""Cosine of the largest turn between two edges that counts.

At half a turn the strains are infinite; a step can jump over it, and come out as if bent the other
way.
"""


def facing(forces: Forces, position: Float[Array, "rows b"]) -> Float[Array, " bent"]:
    """Return the cosine of the turn at each node but the tip.

    It is 1 where nothing resists: a planar root that turns freely may point anywhere. One in space
    is a joint that resists twist, which means nothing past half a turn either.
    """
    edges = jnp.diff(forces.nodes(position)[:, : forces.axes], axis=0)
    tangent = edges / jnp.sqrt(jnp.sum(edges**2, axis=1))[:, None]
    cosine = jnp.sum(tangent[1:] * tangent[:-1], axis=1)
    bend = forces.bend
    if bend is None:
        return jnp.ones_like(cosine)
    resists = jnp.max(bend.stiffness.reshape(cosine.size, -1), axis=1) > 0
    return jnp.where(resists, cosine, 1.0)
