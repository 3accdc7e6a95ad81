"""The linear quadratic regulator that both LQG and predictive control are built on."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.assembly.known import Known

Matrix = Float[np.ndarray, "_ _"]

_EFFORT = 0.02
"""Cost of an input at the end of its range over that of one at its greatest speed."""


class Regulator(NamedTuple):
    """``z' = A z + B du`` for estimate, actuators, commands and integrals, and its cost."""

    A: Matrix
    B: Matrix
    cost: Matrix
    """Cost of a state ``z``."""
    rate: Matrix
    """Cost of changes ``du`` of the commands in a period."""
    controlled: int
    """How many integrals there are, at the end of a state."""

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
        cost[u, u] = np.diag((_EFFORT * known.worth / known.reach) ** 2)
        rate = np.diag((known.worth / (period * known.speed)) ** 2)
        return Regulator(A, B, cost, rate, controlled)
