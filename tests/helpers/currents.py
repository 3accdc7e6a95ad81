"""What tests of flows share."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np


def numbers(*values):
    return tuple(jnp.asarray(value, float) for value in values)


@eqx.filter_jit
def _gradients(flow, points, time):
    def gradient(point):
        return jax.jacfwd(lambda x: flow.velocity(x, time))(point)

    return jax.vmap(gradient)(points)


def gradients(flow, points):
    """Return how the velocity of a flow changes with the place, at some points."""
    return np.asarray(_gradients(flow, *numbers(points, 3.7)))
