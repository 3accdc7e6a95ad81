"""Points that fill a space of several numbers more evenly than chance."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

__all__ = ["SAMPLINGS", "points_of", "sample"]

SAMPLINGS = ("lhs", "sobol", "saltelli")
"""Latin hypercube, scrambled Sobol sequence, and the points that Sobol's indices are made of."""


def points_of(kind: str, count: int, numbers: int) -> int:
    """Return how many points `sample` returns."""
    return count * (numbers + 2) if kind == "saltelli" else count


def sample(kind: str, count: int, numbers: int, seed: int) -> Float[np.ndarray, "point numbers"]:
    """Return points of the unit cube, the same ones for the same arguments.

    Those of ``saltelli`` (Saltelli et al. 2010) come in blocks: a point of a Sobol sequence, the
    same with one number after the other replaced by that of a second point, and that one.

    Parameters
    ----------
    kind
        One of `SAMPLINGS`.
    count
        How many points, or blocks. Those of a Sobol sequence are balanced where it is a power of
        two.
    numbers
        Dimension of the cube.
    seed
        Seed of the draw, 0 or more.
    """
    from scipy.stats import qmc  # slow to load; few need it

    generator = np.random.default_rng(seed)
    if kind == "lhs":
        return np.asarray(qmc.LatinHypercube(numbers, rng=generator).random(count))
    engine = qmc.Sobol(numbers if kind == "sobol" else 2 * numbers, rng=generator)
    # drawn in full powers of two: the engine warns of any other count, and so does the command
    found = np.asarray(engine.random_base2((count - 1).bit_length())[:count])
    return found if kind == "sobol" else _crossed(found[:, :numbers], found[:, numbers:])


def _crossed(
    one: Float[np.ndarray, "count numbers"], other: Float[np.ndarray, "count numbers"]
) -> Float[np.ndarray, "point numbers"]:
    replaced = np.where(np.eye(one.shape[1], dtype=bool), other[:, None], one[:, None])
    blocks = np.concatenate([one[:, None], replaced, other[:, None]], axis=1)
    return blocks.reshape(-1, one.shape[1])
