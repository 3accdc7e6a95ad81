"""A current that is the same everywhere and always."""

from jaxtyping import Array, Float

from crinoid.flow.flow import Flow, Point, Time
from crinoid.onset import Onset


class Uniform(Flow):
    """``u = velocity``."""

    onset: Onset
    uniform_velocity: Float[Array, " b"]

    def fully_on(self, point: Point, time: Time) -> Point:
        return self.uniform_velocity
