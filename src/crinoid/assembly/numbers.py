"""What the builders hand over: numbers by name, and arrays."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

Numbers = dict[str, Any]


def array(value: object) -> Array:
    """Return an array of floats; made by NumPy, for which nothing need be compiled."""
    return jnp.asarray(np.asarray(value, float))
