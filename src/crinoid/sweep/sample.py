"""Points that fill a space of several numbers more evenly than chance."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

__all__ = ["SAMPLINGS", "sample"]

SAMPLINGS = ("lhs", "sobol")
"""Latin hypercube and scrambled Sobol sequence."""


def sample(kind: str, count: int, numbers: int, seed: int) -> Float[np.ndarray, "count numbers"]:
    """Return points of the unit cube, the same ones for the same arguments.

    Parameters
    ----------
    kind
        One of `SAMPLINGS`.
    count
        How many points. Those of a Sobol sequence are balanced where it is a power of two.
    numbers
        Dimension of the cube.
    seed
        Seed of the draw, 0 or more.
    """
    generator = np.random.default_rng(seed)
    if kind == "lhs":
        return np.asarray(qmc.LatinHypercube(numbers, rng=generator).random(count))
    engine = qmc.Sobol(numbers, rng=generator)
    # drawn in full powers of two: the engine warns of any other count, and so does the command
    return np.asarray(engine.random_base2((count - 1).bit_length())[:count])
