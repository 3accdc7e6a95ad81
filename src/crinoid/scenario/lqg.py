"""Settings of LQG control."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from crinoid.scenario.model import Model
from crinoid.scenario.quantity import AsTuple, Metres, Quantity, Seconds

__all__ = ["Lqg"]

_Inputs = Annotated[
    tuple[str, ...], AsTuple, Field(min_length=1), Quantity(takes="a list of names of inputs")
]


class ModelBased(Model):
    """Settings of controllers that know a linear model of the arm."""

    usual_smoothness: ClassVar[float] = 0.005
    """Smoothness over the arm's length, where it is left out."""

    inputs: _Inputs | None = Field(
        default=None,
        description="Inputs that it drives: channels of the base, chambers, tendons; all if left "
        "out.",
    )
    smoothness: Metres | None = Field(
        default=None,
        gt=0,
        description="Error of the tip that counts as much as an input at its greatest speed: the "
        "smaller, the harder it works; of the arm's length 0.01 for lqg and 0.005 for mpc if left "
        "out.",
    )
    integral_time: Seconds = Field(
        default=5.0, gt=0, description="Time in which a lasting error is undone."
    )

    def smoothness_on(self, length: float) -> float:
        """Return the smoothness (m) for an arm of a length (m)."""
        return self.smoothness or self.usual_smoothness * length


class Lqg(ModelBased):
    """LQG control: linear quadratic regulator on the estimate of a Kalman filter."""

    usual_smoothness: ClassVar[float] = 0.01
