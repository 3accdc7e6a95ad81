"""How the tip follows the base at each frequency: what a controller closes its loop on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from scipy.linalg import solve_banded

from crinoid.dynamics.tangent import HELD

Bands = Float[np.ndarray, "n 5 b b"]


class Plant(NamedTuple):
    """Small motions of an arm and of its tip, on the host. SI units."""

    stiffness: Bands
    damping: Bands
    mass: Bands
    held: Float[np.ndarray, "2 b channel"]
    """How the ghost node and the root follow the channels."""
    tip: Float[np.ndarray, "pose 3 d"]
    """How the tip's pose follows the last three nodes."""

    def response(self, frequency: Float[np.ndarray, " f"]) -> Complex[np.ndarray, "f pose channel"]:
        """Return d(tip)/d(channels) at frequencies (Hz).

        ``(K + i w C - w^2 M) x = 0`` of the free nodes with the held ones given, exact for the
        discrete arm: one banded solve for each frequency (LU, LAPACK).
        """
        size = self.stiffness.shape[-1]
        row, column, inside, known = _layout(*self.stiffness.shape[:3:2])
        beyond = 3 * size - 1
        free = (self.stiffness.shape[0] - HELD) * size
        moved = self.held.reshape(-1, self.held.shape[-1])
        nodes = np.zeros((free + moved.shape[0], moved.shape[1]), complex)
        nodes[: moved.shape[0]] = moved
        found = np.empty((frequency.size, self.tip.shape[0], moved.shape[1]), complex)
        diagonals = np.zeros((2 * beyond + 1, free), complex)
        for index, rate in enumerate(2 * np.pi * frequency):
            dynamic = self.stiffness + 1j * rate * self.damping - rate**2 * self.mass
            entries = dynamic[HELD:].reshape(-1)
            diagonals[beyond + row[inside] - column[inside], column[inside]] = entries[inside]
            pushed = np.zeros((free, moved.shape[1]), complex)
            np.add.at(
                pushed,
                row[known],
                -entries[known, None] * moved[column[known] + moved.shape[0]],
            )
            nodes[moved.shape[0] :] = solve_banded(
                (beyond, beyond), diagonals, pushed, overwrite_b=True, check_finite=False
            )
            last = nodes[-3 * size :].reshape(3, size, -1)[:, : self.tip.shape[2]]
            found[index] = np.einsum("pnd,ndc->pc", self.tip, last)
        return found


def _layout(nodes: int, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return row and column of each entry of the bands among the free nodes, and which count.

    Columns of the held nodes are negative. ``inside`` are entries among free nodes, ``known`` those
    that meet what is held.
    """
    node, offset, i, j = np.indices((nodes - HELD, 5, size, size))
    row = (node * size + i).reshape(-1)
    column = ((node + offset - 2) * size + j).reshape(-1)
    inside = (column >= 0) & (column < (nodes - HELD) * size)
    return row, column, np.flatnonzero(inside), np.flatnonzero(column < 0)
