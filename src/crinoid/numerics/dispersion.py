"""The dispersion relation of linear surface waves on a mean current."""

from typing import Any

import numpy as np
from jaxtyping import Float

_SLOWEST = 1e-100  # speed of a current whose square is a number (m/s)


def dispersion(number: Any, depth: Any, gravity: Any, xp: Any = np) -> tuple[Any, Any]:
    """Return the frequency from the water (rad/s) and the speed of the energy (m/s)."""
    if depth is None:
        sigma = xp.sqrt(gravity * number)
        return sigma, sigma / (2 * number)
    tanh = xp.tanh(number * depth)
    sigma = xp.sqrt(gravity * number * tanh)
    return sigma, gravity * (tanh + number * depth * (1 - tanh**2)) / (2 * sigma)


def deep_wave_number(frequency: Any, gravity: Any, current: Any = 0.0) -> Any:
    """Return the wave number in deep water (rad/m): the root of ``sqrt(g k) + k U = omega``."""
    return (2 * frequency / (1 + (1 + 4 * current * frequency / gravity) ** 0.5)) ** 2 / gravity


def stopped(against: Any, depth: float | None, gravity: float) -> Float[np.ndarray, "*f"]:
    """Return the lowest frequency at a fixed point that a current stops waves of (rad/s).

    ``against`` is its speed against the waves (m/s); infinite where it does not run against them.
    Where waves are stopped their energy travels as fast as the water comes.
    """
    against = np.asarray(against, float)
    against = np.where(against < _SLOWEST, 0.0, against)
    fast = np.full(against.shape, False) if depth is None else against**2 >= gravity * depth
    found = np.where(fast, 0.0, np.inf)
    slow = against[(against > 0) & ~fast]
    high = gravity / (4 * slow**2)  # that of deep water
    if depth is not None and slow.size:
        low, high = 0 * slow, np.maximum(high, 1 / depth)
        while np.any(behind := dispersion(high, depth, gravity)[1] > slow):
            high = np.where(behind, 2 * high, high)
        for _ in range(100):
            middle = 0.5 * (low + high)
            ahead = dispersion(middle, depth, gravity)[1] > slow
            low, high = np.where(ahead, middle, low), np.where(ahead, high, middle)
    found[(against > 0) & ~fast] = dispersion(high, depth, gravity)[0] - high * slow
    return np.where(against > 0, found, np.inf)
