"""Frequencies of beams, on paper."""

import numpy as np
from scipy.optimize import brentq

CANTILEVER = np.array(
    [brentq(lambda x: np.cos(x) * np.cosh(x) + 1, n - 0.5, n + 0.5) for n in (2.0, 4.5, 8.0)]
)
"""beta L: roots of cos(x) cosh(x) = -1 (Blevins 1979, table 8-1)."""


NATURAL = CANTILEVER**2
"""Circular frequencies of an arm with EI = m = L = 1 (rad/s)."""
