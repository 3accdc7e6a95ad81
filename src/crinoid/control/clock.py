"""Sample times of what runs at its own rate."""

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int


class Clock(eqx.Module):
    """Ticks every ``period`` seconds, at the first time step that begins at or after a tick."""

    period: Float[Array, ""]
    """Time between two ticks (s)."""

    def due(self, ticks: Int[Array, ""], time: Float[Array, ""]) -> Bool[Array, ""]:
        """Return whether the tick that follows ``ticks`` earlier ones has come.

        A tick that a rounded sum of time steps misses by a millionth of the period still counts.
        """
        return time >= (ticks - 1e-6) * self.period
