"""Numbers by which instruments mark a missing value without saying so in the file."""

import numpy as np

from crinoid.recording.refusal import refusal

_MARKS = (999, 999.9, 999.99, 9999, 9999.9, 9999.99, 99999, 99999.9, 999999, 32767, 32768)
"""Sizes of the usual ones: nines, and the ends of a 16-bit counter."""
_CLOSE = 1e-6
"""Relative error of numbers in single precision."""


def check_marks(numbers: np.ndarray, key: str, name: str) -> None:
    """Refuse a variable that holds a mark of missing values among its numbers.

    A mark lies outside the other numbers by more than they differ from each other: 999 among
    998 and 1000 is a number.
    """
    found = numbers[np.isfinite(numbers)].astype(float)
    marked = np.zeros(found.size, bool)
    large = np.flatnonzero(np.abs(found) > _MARKS[0] * (1 - _CLOSE))
    for mark in _MARKS:
        marked[large] |= np.isclose(np.abs(found[large]), mark, rtol=_CLOSE, atol=0)
    if not marked.any():
        return
    others, marks = found[~marked], found[marked]
    if others.size:
        low, high = others.min(), others.max()
        marks = marks[np.maximum(low - marks, marks - high) > high - low]
    if marks.size:
        text = f"{name} holds {marks[0]:g}, far from its other numbers, as if a value were missing"
        raise refusal(key, f"{text}; takes an empty cell, or in a netCDF file a _FillValue")
