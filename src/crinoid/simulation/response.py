"""How the tip follows the inputs at each frequency: what a controller closes its loop on."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from scipy.linalg import solve_banded

from crinoid.dynamics import Influence
from crinoid.dynamics.tangent import HELD

Bands = Float[np.ndarray, "n 5 b b"]


class Plant(NamedTuple):
    """Small motions of an arm and of its tip, on the host. SI units."""

    stiffness: Bands
    damping: Bands
    mass: Bands
    influence: Influence
    """Loads of the inputs on it, and how its tip follows."""

    def response(self, frequency: Float[np.ndarray, " f"]) -> Complex[np.ndarray, "f pose input"]:
        """Return d(tip)/d(inputs) at frequencies (Hz).

        ``(K + i w C - w^2 M) x = f`` of the free nodes, with the held ones given for the channels
        of the base and the forces of the other inputs, exact for the discrete arm: one banded solve
        for each frequency (LU, LAPACK).
        """
        held, loads, tip = map(np.asarray, self.influence[:3])
        size = self.stiffness.shape[-1]
        row, column, inside, known = _layout(*self.stiffness.shape[:3:2])
        beyond = 3 * size - 1
        free = (self.stiffness.shape[0] - HELD) * size
        pull, follow = _lines(self.influence, free)
        forced = np.pad(loads[HELD:].reshape(free, -1), ((0, 0), (held.shape[-1], 0)))
        moved = np.pad(held.reshape(-1, held.shape[-1]), ((0, 0), (0, loads.shape[-1])))
        nodes = np.zeros((free + moved.shape[0], moved.shape[1]), complex)
        nodes[: moved.shape[0]] = moved
        found = np.empty((frequency.size, tip.shape[0], moved.shape[1]), complex)
        diagonals = np.zeros((2 * beyond + 1, free), complex)
        for index, rate in enumerate(2 * np.pi * frequency):
            dynamic = self.stiffness + 1j * rate * self.damping - rate**2 * self.mass
            entries = dynamic[HELD:].reshape(-1)
            diagonals[beyond + row[inside] - column[inside], column[inside]] = entries[inside]
            pushed = forced.astype(complex)
            np.add.at(
                pushed,
                row[known],
                -entries[known, None] * moved[column[known] + moved.shape[0]],
            )
            # the loads of lines couple all nodes: eliminated last (Woodbury)
            pushed = np.concatenate(
                [pushed - pull @ (follow[:, : moved.shape[0]] @ moved), pull], 1
            )
            answers = solve_banded(
                (beyond, beyond), diagonals, pushed, overwrite_b=True, check_finite=False
            )
            alone, taut = np.split(answers, [moved.shape[1]], axis=1)
            followed = follow[:, moved.shape[0] :]
            load = np.linalg.solve(np.eye(taut.shape[1]) + followed @ taut, followed @ alone)
            nodes[moved.shape[0] :] = alone - taut @ load
            last = nodes[-3 * size :].reshape(3, size, -1)[:, : tip.shape[2]]
            found[index] = np.einsum("pnd,ndc->pc", tip, last)
        return found


def _lines(
    influence: Influence, free: int
) -> tuple[Float[np.ndarray, "free line"], Float[np.ndarray, "line all"]]:
    """Return what lines pull at, and what they follow: free nodes, and held ones before them."""
    if influence.lines is None:
        return np.zeros((free, 0)), np.zeros((0, math.prod(influence.loads.shape[:2])))
    pull, follow = map(np.asarray, influence.lines)
    return pull[HELD:].reshape(free, -1), follow.reshape(follow.shape[0], -1)


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
