"""The tip of an arm: where it is and where it points."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.elements.geometry import unit
from crinoid.frames import dot


def tip_pose(position: Float[Array, "n d"]) -> Float[Array, " pose"]:
    """Return the tip's place (m) and direction, `crinoid.space.POSE`, in the arm's coordinates.

    The last edge points where the arm does half an edge before the tip: its turn is carried on.
    """
    last, before = position[-1] - position[-2], position[-2] - position[-3]
    if position.shape[1] == 3:
        (before, _), (last, _) = unit(before), unit(last)
        middle, _ = unit(before + last)
        return jnp.append(position[-1], 2.0 * dot(middle, last) * last - middle)
    turn = jnp.arctan2(before[0] * last[1] - before[1] * last[0], jnp.sum(before * last))
    angle = jnp.arctan2(last[1], last[0]) + 0.5 * turn
    return jnp.append(position[-1], angle)
