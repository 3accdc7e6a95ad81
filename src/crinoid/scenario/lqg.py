"""Settings of LQG control."""

from typing import Annotated

from pydantic import Field

from crinoid.scenario.model import Model
from crinoid.scenario.quantity import AsTuple, Metres, Quantity, Seconds

__all__ = ["Lqg"]

_SMOOTHNESS = 0.01
"""Smoothness over the arm's length, where it is left out."""

_Inputs = Annotated[
    tuple[str, ...], AsTuple, Field(min_length=1), Quantity(takes="a list of names of inputs")
]


class ModelBased(Model):
    """Settings of controllers that know a linear model of the arm."""

    inputs: _Inputs | None = Field(
        default=None,
        description="Inputs that it drives: channels of the base, chambers, tendons; all if left "
        "out.",
    )
    smoothness: Metres | None = Field(
        default=None,
        gt=0,
        description="Error of the tip that counts as much as an input at its greatest speed: the "
        "smaller, the harder it works; a hundredth of the arm's length if left out.",
    )
    integral_time: Seconds = Field(
        default=5.0, gt=0, description="Time in which a lasting error is undone."
    )

    def smoothness_on(self, length: float) -> float:
        """Return the smoothness (m) for an arm of a length (m)."""
        return self.smoothness or _SMOOTHNESS * length


class Lqg(ModelBased):
    """LQG control: linear quadratic regulator on the estimate of a Kalman filter."""
