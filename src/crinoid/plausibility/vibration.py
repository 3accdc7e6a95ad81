"""How fast an arm vibrates in water, from its description alone."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

_PARTS = 24


def bending_frequencies(
    length: float,
    bending: Float[np.ndarray, " ends"],
    mass: Float[np.ndarray, " ends"],
    *,
    taper: float = 1.0,
    clamped: bool = True,
    tip: Float[np.ndarray, "2 2"] | None = None,
) -> Float[np.ndarray, " mode"]:
    """Return the natural frequencies of a straight cantilever, slowest first (Hz).

    An Euler beam in `_PARTS` finite elements with cubic shapes (Petyt 2010, Introduction to Finite
    Element Vibration Analysis, section 3.5). Weight, tension and curvature at rest are left out. A
    root that turns freely has no stiffness of its own: its first frequency is 0 and not returned.

    Parameters
    ----------
    length
        Length (m).
    bending, mass
        Bending stiffness (N m2) and mass per length with added mass (kg/m), at root and tip.
    taper
        Radius of the tip over that of the root: bending stiffness runs from root to tip as the
        fourth power of the radius, mass as the second, where root and tip differ in them.
    clamped
        Whether the root is held in its direction.
    tip
        Inertia of what the tip carries against shifts and turns: kg, kg m, kg m, kg m2.
    """
    size = length / _PARTS
    middle = (np.arange(_PARTS) + 0.5) / _PARTS
    radius = 1 + (taper - 1) * middle
    EI = bending[0] * (radius**4 if bending[0] != bending[1] else np.ones(_PARTS))
    line = mass[0] * (radius**2 if mass[0] != mass[1] else np.ones(_PARTS))
    # of deflections and slopes times the element's length, at both its ends
    stiff = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    heavy = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
    K, M = np.zeros((2, 2 * _PARTS + 2, 2 * _PARTS + 2))
    for part in range(_PARTS):
        at = slice(2 * part, 2 * part + 4)
        K[at, at] += EI[part] / size**3 * stiff
        M[at, at] += line[part] * size / 420 * heavy
    if tip is not None:
        lengths = np.array([1.0, size])
        M[-2:, -2:] += tip / np.outer(lengths, lengths)
    held = 2 if clamped else 1
    half = np.linalg.inv(np.linalg.cholesky(M[held:, held:]))
    squared = np.linalg.eigvalsh(half @ K[held:, held:] @ half.T)[2 - held :]
    return np.sqrt(np.maximum(squared, 0.0)) / (2 * np.pi)
