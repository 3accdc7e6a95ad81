"""The tip of an arm: where it is and where it points."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.geometry import beyond, unit


def tip_pose(position: Float[Array, "n d"]) -> Float[Array, " pose"]:
    """Return the tip's position (m) and direction, `crinoid.space.POSE`, in the arm's coordinates.

    The last edge points where the arm does half an edge before the tip: its turn is carried on.
    """
    (last, _), (before, _) = unit(position[-1] - position[-2]), unit(position[-2] - position[-3])
    direction = beyond(before, last)
    if position.shape[1] == 2:
        direction = jnp.arctan2(direction[1], direction[0])
    return jnp.append(position[-1], direction)
