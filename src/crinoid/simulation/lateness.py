"""Delay of a paced session."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class Lateness(NamedTuple):
    """Delay of a paced session behind the wall clock."""

    steps: int
    """Number of paced steps."""
    late: int
    """Number of those that ended after their time."""
    mean: float
    """Mean delay of late steps (s); 0 without any."""
    largest: float
    """Largest delay (s); 0 without any."""
    last: float
    """Delay of the last step (s), negative if it was in time."""

    @staticmethod
    def of(delays: Sequence[float]) -> Lateness:
        """Return that of steps with delays (s), negative where they were in time."""
        late = [each for each in delays if each > 0]
        mean, largest = (sum(late) / len(late), max(late)) if late else (0.0, 0.0)
        return Lateness(len(delays), len(late), mean, largest, delays[-1] if delays else 0.0)
