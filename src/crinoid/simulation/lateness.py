"""Delay of a paced session."""

from typing import NamedTuple


class Lateness(NamedTuple):
    """Delay of a paced session behind the wall clock."""

    steps: int = 0
    """Number of paced steps."""
    late: int = 0
    """Number of those that ended after their time."""
    mean: float = 0.0
    """Mean delay of late steps (s); 0 without any."""
    largest: float = 0.0
    """Largest delay (s); 0 without any."""
    last: float = 0.0
    """Delay of the last step (s), negative if it was in time."""

    def with_step(self, delay: float) -> "Lateness":
        """Return that with one more step, with its delay (s), negative if it was in time."""
        if delay <= 0:
            return self._replace(steps=self.steps + 1, last=delay)
        late = self.late + 1
        mean = self.mean + (delay - self.mean) / late
        return Lateness(self.steps + 1, late, mean, max(delay, self.largest), delay)
