"""A current that is the same everywhere and always."""

from typing import ClassVar

from jaxtyping import Array, Float

from crinoid.flow.flow import Everywhere, Point, Time
from crinoid.onset import Onset


class Uniform(Everywhere):
    """``u = velocity``."""

    steady: ClassVar[bool] = True
    onset: Onset
    uniform_velocity: Float[Array, " b"]
    """Velocity (m/s)."""

    def at(self, time: Time) -> Point:
        return self.uniform_velocity

    def displacement(self, time: Time) -> Point:
        return self.uniform_velocity * self.onset.elapsed(time)
