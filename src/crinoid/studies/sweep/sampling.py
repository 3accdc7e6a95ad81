"""Samples of several numbers, and Sobol's indices: each key's share of the variance."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

SAMPLINGS = ("lhs", "sobol", "saltelli")
"""Latin hypercube, scrambled Sobol sequence, and the points that Sobol's indices are made of."""


def points_of(kind: str, count: int, numbers: int) -> int:
    """Return how many points `sample` returns."""
    return count * (numbers + 2) if kind == "saltelli" else count


def sample(kind: str, count: int, numbers: int, seed: int) -> Float[np.ndarray, "point numbers"]:
    """Return points of the unit cube, the same ones for the same arguments.

    Those of ``saltelli`` (Saltelli et al. 2010) come in ``count`` blocks: a point of a Sobol
    sequence, the same with one number after the other replaced by that of a second point, and that
    one. A Sobol sequence is balanced where ``count`` is a power of two.
    """
    from scipy.stats import qmc  # slow to load; few need it

    generator = np.random.default_rng(seed)
    if kind == "lhs":
        return np.asarray(qmc.LatinHypercube(numbers, rng=generator).random(count))
    engine = qmc.Sobol(numbers if kind == "sobol" else 2 * numbers, rng=generator)
    # drawn in full powers of two: the engine warns of any other count, and so does the command
    found = np.asarray(engine.random_base2((count - 1).bit_length())[:count])
    if kind == "sobol":
        return found
    one, other = found[:, None, :numbers], found[:, None, numbers:]
    replaced = np.where(np.eye(numbers, dtype=bool), other, one)
    return np.concatenate([one, replaced, other], axis=1).reshape(-1, numbers)


class Index(NamedTuple):
    """Indices of a key, with the half widths of their intervals of 95 % confidence."""

    key: str
    first: float  # share of the variance that the key explains alone
    first_within: float
    total: float  # share that remains if all other keys are fixed: alone and by interaction
    total_within: float


def indices_of(keys: list[str], values: Float[np.ndarray, "point other"]) -> list[Index]:
    """Return the indices of keys that were sampled as ``saltelli``, from a measure of each run.

    By SALib (Iwanaga et al. 2022), first-order indices as in Saltelli et al. 2010, total ones as
    in Jansen 1999. Means over all other keys that vary. Blocks in which a run is unknown (NaN) are
    left out; without two blocks, or without any spread, there are no indices.
    """
    from SALib.analyze import sobol

    means = values.mean(axis=1).reshape(-1, len(keys) + 2)
    known = means[np.isfinite(means).all(axis=1)]
    if len(known) < 2 or np.ptp(known) <= 1e-9 * np.abs(known).max():
        return []
    problem = {"num_vars": len(keys), "names": keys, "bounds": [[0.0, 1.0]] * len(keys)}
    found = sobol.analyze(problem, known.ravel(), calc_second_order=False, seed=1)
    columns = (found[name].tolist() for name in ("S1", "S1_conf", "ST", "ST_conf"))
    return [Index(*row) for row in zip(keys, *columns, strict=True)]
