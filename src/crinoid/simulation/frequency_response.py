"""Frequency response of the tip to the inputs."""

import hashlib
import math
import pickle
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Inexact
from scipy.linalg import solve_banded

from crinoid.dynamics import Influence
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.numerics import banded

Bands = Float[np.ndarray, "n 5 b b"]
_MOST_KNOWN = 8
_known: dict[bytes, np.ndarray] = {}
"""Responses by all numbers that they depend on: runs that differ in their seed share one."""


class Plant(NamedTuple):
    """Small motions of an arm and of its tip, on the host. SI units."""

    stiffness: Bands
    damping: Bands
    mass: Bands
    influence: Influence  # loads of the inputs on it, and how its tip follows

    def response(self, frequency: Inexact[np.ndarray, " f"]) -> Complex[np.ndarray, "f pose input"]:
        """Return d(tip)/d(inputs) at frequencies (Hz); a negative imaginary part means growth.

        ``(K + i w C - w^2 M) x = f`` of the free nodes, with the held ones given for the channels
        of the base and the forces of the other inputs, exact for the discrete arm: one banded solve
        for all frequencies (LU, LAPACK).
        """
        key = hashlib.sha256(pickle.dumps((self, frequency))).digest()
        if (found := _known.get(key)) is None:
            found = self._solve(frequency)
            found.flags.writeable = False
            if len(_known) >= _MOST_KNOWN:
                _known.clear()
            _known[key] = found
        return found

    def _solve(self, frequency: Inexact[np.ndarray, " f"]) -> Complex[np.ndarray, "f pose input"]:
        held, loads, tip = map(np.asarray, self.influence[:3])
        size = self.stiffness.shape[-1]
        nodes = self.stiffness.shape[0] - BOUNDARY_NODES
        beyond, free = 3 * size - 1, nodes * size
        row, column = map(np.ravel, banded.places(nodes, size))
        # the free nodes are the unknowns; columns of the held ones are negative
        inside, known = np.flatnonzero((column >= 0) & (column < free)), np.flatnonzero(column < 0)
        pull, follow = np.zeros((free, 0)), np.zeros((0, math.prod(loads.shape[:2])))
        if self.influence.lines is not None:  # loads of lines, by held and free nodes
            pull, follow = map(np.asarray, self.influence.lines)
            pull = pull[BOUNDARY_NODES:].reshape(free, -1)
            follow = follow.reshape(follow.shape[0], -1)
        moved = np.pad(held.reshape(-1, held.shape[-1]), ((0, 0), (0, loads.shape[-1])))
        ahead = moved.shape[0]
        given = np.stack([self.stiffness, self.damping, self.mass])[:, BOUNDARY_NODES:]
        parts, rate = given.reshape(3, -1), 2 * np.pi * frequency[:, None, None]
        # a product with each matrix, then their sum at each frequency
        diagonals = np.zeros((3, free, 2 * beyond + 1))
        diagonals[:, column[inside], beyond + row[inside] - column[inside]] = parts[:, inside]
        reached = np.zeros((3, free, ahead))
        reached[:, row[known], column[known]] = parts[:, known]
        forced = np.pad(loads[BOUNDARY_NODES:].reshape(free, -1), ((0, 0), (held.shape[-1], 0)))
        forced = forced - pull @ (follow[:, :ahead] @ moved)
        entries, reactions = (
            stiffness + 1j * rate * damping - rate**2 * mass
            for stiffness, damping, mass in (diagonals, reached @ moved)
        )
        pushed = forced - reactions
        # the loads of lines couple all nodes: eliminated last (Woodbury)
        pulled = np.broadcast_to(pull, (frequency.size, *pull.shape))
        answers = solve_banded(
            (beyond, beyond),
            # all frequencies one behind the other: one system, whose parts do not meet
            entries.reshape(-1, 2 * beyond + 1).T,
            np.concatenate([pushed, pulled], axis=2).reshape(frequency.size * free, -1),
            overwrite_ab=True,
            overwrite_b=True,
            check_finite=False,
        ).reshape(frequency.size, free, -1)
        alone, taut = np.split(answers, [moved.shape[1]], axis=2)
        if pull.size:
            followed = follow[:, ahead:]
            load = np.linalg.solve(np.eye(pull.shape[1]) + followed @ taut, followed @ alone)
            alone = alone - taut @ load
        base = np.broadcast_to(moved, (frequency.size, *moved.shape))
        last = np.concatenate([base, alone], axis=1)[:, -3 * size :]
        last = last.reshape(frequency.size, 3, size, -1)[:, :, : tip.shape[2]]
        return np.einsum("pnd,fndc->fpc", tip, last)
