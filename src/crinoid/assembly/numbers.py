"""Numbers by name, and arrays, which the builders hand over."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Array

Numbers = dict[str, Any]


def array(value: object) -> Array:
    """Return an array of floats, for which nothing need be compiled."""
    return jax.device_put(np.asarray(value, float))
