"""The linear quadratic regulator that both LQG and predictive control are built on."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from crinoid.assembly.known import Known

Matrix = Float[np.ndarray, "_ _"]

EFFORT = 0.02
"""Cost of an input at the end of its range over that of one at its greatest speed."""
SPARE = 1.0
"""The same for what inputs do among themselves and the tip at rest does not follow."""


def straight(looks: Int[np.ndarray, " look"], ticks: int) -> Float[np.ndarray, "look tick"]:
    """Return the weight of each look at each tick, for numbers that go straight in between."""
    every = np.arange(ticks + 1)
    return np.stack([np.interp(every, looks, row) for row in np.eye(looks.size)])


class Regulator(NamedTuple):
    """``z' = A z + B du`` for estimate, actuators, commands and integrals, and its cost."""

    A: Matrix
    B: Matrix
    cost: Matrix
    """Cost of a state ``z``."""
    rate: Matrix
    """Cost of changes ``du`` of the commands in a period."""
    steady: Matrix
    """State at rest by the commands that keep it there."""
    shift: Matrix
    """Change of a state in a period by the commands at which the tip would stand still where it is
    wanted: the integrals count from there."""

    @staticmethod
    def of(known: Known, integral_time: float, period: float) -> Regulator:
        """Build it for a control period (s)."""
        model, parts, size = known.model, known.parts, known.parts.known
        states, inputs = model.commanded.shape
        controlled = known.tip.shape[0]
        ends = list(np.cumsum([size, states, inputs, controlled]))
        x, s, u, q = (slice(*pair) for pair in pairwise([0, *ends]))
        A, B = np.zeros((ends[-1], ends[-1])), np.zeros((ends[-1], inputs))
        A[x, x] = parts.move[:size, :size]
        A[x, s] = parts.held[:size] + parts.driven[:size] @ model.actuators
        A[x, u] = B[x] = parts.driven[:size] @ model.commanded
        A[s, s] = model.actuators
        A[s, u] = B[s] = model.commanded
        A[u, u] = B[u] = np.eye(inputs)
        A[q, x] = period * known.tip
        A[q, q] = np.eye(controlled)
        cost = np.zeros_like(A)
        cost[x, x] = known.tip.T @ known.tip
        cost[q, q] = np.eye(controlled) / integral_time**2
        pull = EFFORT**2 * np.eye(inputs) + SPARE**2 * known.spare
        cost[u, u] = known.worth**2 * pull / np.outer(known.reach, known.reach)
        rate = np.diag((known.worth / (period * known.speed)) ** 2)
        # only the arm, first of the estimate, and the actuators answer to commands
        moving = np.r_[np.arange(parts.arm), np.arange(size, u.start)]
        still = np.eye(moving.size) - A[np.ix_(moving, moving)]
        steady, shift = np.zeros_like(B), np.zeros_like(B)
        steady[moving] = np.linalg.solve(still, A[moving, u])
        steady[u] = np.eye(inputs)
        shift[q] = -A[q, x] @ steady[x]
        return Regulator(A, B, cost, rate, steady, shift)

    def by_aim(self, later: Matrix, ticks: int) -> Float[np.ndarray, "tick u aim"]:
        """Return the best next move by the commands ``aim`` for where the tip is wanted at ticks.

        The first one is now; the target stays where it is at the last one. ``later`` is the cost of
        all that follows (`to_come`). The cost to go has a part that is linear in the state, which
        follows backward from the aims (Katayama, Ohki, Inoue and Kato 1985).
        """
        A, B, cost, rate, steady, shift = self
        known = np.linalg.solve(rate + B.T @ later @ B, B.T)
        closed = (A - B @ known @ later @ A).T
        pull = cost @ steady - closed @ later @ shift
        found = [-known @ later @ shift]
        for _ in range(ticks - 1):
            found.append(known @ pull)
            pull = closed @ pull
        lasting = np.linalg.solve(np.eye(A.shape[0]) - closed, pull)
        return np.stack([*found, known @ lasting])

    def to_come(self) -> Matrix:
        """Return the cost of all that follows a state, by the Riccati equation."""
        from scipy.linalg import solve_discrete_are  # slow to load

        return solve_discrete_are(self.A, self.B, self.cost, self.rate)
