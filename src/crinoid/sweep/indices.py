"""Sobol's indices: how much of the spread of a measure each sampled key explains."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.sweep.plan import Plan

__all__ = ["Index", "indices_of"]


class Index(NamedTuple):
    """Indices of a key, with the half widths of their intervals of 95 % confidence."""

    key: str
    first: float
    """Share of the variance that the key explains alone."""
    first_within: float
    total: float
    """Share that goes where all other keys are held: with what it does together with them."""
    total_within: float


def indices_of(plan: Plan, values: Float[np.ndarray, " run"]) -> list[Index]:
    """Return the indices of all sampled keys of a plan whose sampling is ``saltelli``.

    By SALib (Iwanaga et al. 2022), first-order indices as in Saltelli et al. 2010, total ones as in
    Jansen 1999. What varies beside the samples is averaged over. Blocks in which a run is unknown
    are left out; without two blocks, or without any spread, there are no indices.

    Parameters
    ----------
    plan
        Plan of the sweep.
    values
        A measure of each run; NaN where it is not known.
    """
    from SALib.analyze import sobol

    keys = plan.sampled
    means = plan.by_point(values).mean(axis=1).reshape(-1, len(keys) + 2)
    known = means[np.isfinite(means).all(axis=1)]
    if len(known) < 2 or np.ptp(known) <= 1e-9 * np.abs(known).max():
        return []
    problem = {"num_vars": len(keys), "names": keys, "bounds": [[0.0, 1.0]] * len(keys)}
    found = sobol.analyze(problem, known.ravel(), calc_second_order=False, seed=1)
    columns = (found[name].tolist() for name in ("S1", "S1_conf", "ST", "ST_conf"))
    return [Index(*row) for row in zip(keys, *columns, strict=True)]
