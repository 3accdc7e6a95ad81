"""Delay of a paced session."""

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
