"""Fewer states for a linear model: what its inputs and outputs hardly see is left out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Matrix = Float[np.ndarray, "_ _"]

_LASTING = 1.0 - 1e-9
"""Size of an eigenvalue, discounted, from which on a motion counts as lasting and is kept whole."""
_DOUBLINGS = 40


class Reduced(NamedTuple):
    """A linear model ``z' = A z + B u``, ``y = C z``; ``z = left x``, ``x = right z``."""

    A: Float[np.ndarray, "z z"]
    B: Float[np.ndarray, "z u"]
    C: Float[np.ndarray, "y z"]
    left: Float[np.ndarray, "z x"]
    right: Float[np.ndarray, "x z"]
    hankel: Float[np.ndarray, " h"]
    """Hankel singular values of what could be left out, largest first."""


def balanced(
    A: Matrix, B: Matrix, C: Matrix, *, share: float, most: int, discount: float = 1.0
) -> Reduced:
    """Reduce a discrete linear model by balanced truncation (Moore 1981).

    Inputs and outputs are to be scaled so that 1 is as much as they do. Left out are the states
    whose Hankel singular value is below ``share`` of the largest one; kept are ``most`` of the
    others at most, and all motions that last. The error of the transfer is at most twice the sum of
    the values left out (Glover 1984).

    Parameters
    ----------
    A, B, C
        Matrices of the model.
    share
        Hankel singular value, over the largest, of the least state that is kept.
    most
        Most states that are kept beside those that last.
    discount
        What a step leaves of a motion in the reckoning: below 1 it makes the Gramians of motions
        finite that hardly decay. The matrices of the reduced model are not discounted.
    """
    from scipy.linalg import schur, solve_sylvester  # slow to load

    size = A.shape[0]

    # lasting motions first, then uncoupled from the rest
    triangle, basis, kept = schur(
        A, sort=lambda real, imag=0.0: bool(discount * np.hypot(real, imag) >= _LASTING)
    )
    coupling = solve_sylvester(
        triangle[:kept, :kept], -triangle[kept:, kept:], -triangle[:kept, kept:]
    )
    into, out_of = np.eye(size), np.eye(size)
    into[:kept, kept:], out_of[:kept, kept:] = coupling, -coupling
    right, left = basis @ into, out_of @ basis.T
    rest = slice(kept, size)
    inner, driven, seen = triangle[rest, rest], left[rest] @ B, C @ right[:, rest]
    reached = _root(_gramian(discount * inner, driven))
    observed = _root(_gramian(discount * inner.T, seen.T))
    u, values, vt = np.linalg.svd(observed.T @ reached)
    count = min(most, int(np.sum(values > share * values.max(initial=0.0))))
    scale = 1 / np.sqrt(values[:count])
    far = reached @ vt[:count].T * scale
    near = (observed @ u[:, :count] * scale).T
    right = np.concatenate([right[:, :kept], right[:, rest] @ far], axis=1)
    left = np.concatenate([left[:kept], near @ left[rest]])
    return Reduced(left @ A @ right, left @ B, C @ right, left, right, values)


def _gramian(A: Matrix, B: Matrix) -> Matrix:
    """Return the sum of ``A^k B B^T A^kT`` by doubling the number of terms (Smith 1968)."""
    total = B @ B.T
    for _ in range(_DOUBLINGS):
        more = A @ total @ A.T
        total = total + more
        if np.abs(more).max(initial=0.0) <= 1e-15 * np.abs(total).max(initial=0.0):
            break
        A = A @ A
    return total


def _root(gramian: Matrix) -> Matrix:
    """Return ``R`` of ``R R^T``, which round-off has left indefinite."""
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
