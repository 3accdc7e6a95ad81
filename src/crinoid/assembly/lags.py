"""By how much inputs come behind their commands."""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from crinoid.actuation import Actuator

_SLOW = 1e-6
"""Frequency of a slow command (Hz)."""


def lags(followers: Iterable[Actuator]) -> Float[np.ndarray, " input"]:
    """Return by how much each input comes behind a slow command (s)."""
    slow = np.array([_SLOW])
    found = np.concatenate([each.response(slow)[0] for each in followers])
    return -found.imag / (2 * np.pi * _SLOW)
