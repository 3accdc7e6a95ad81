"""Random flows, drawn from the seed of a scenario: Gauss-Markov processes and turbulence."""
# ruff: noqa: D102  # the base class documents its methods

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake
from crinoid.scenario.flow_table import FlowTable
from crinoid.scenario.model import entry
from crinoid.scenario.quantity import AsTuple, Count, Metres, Quantity, Seconds, Velocity

_From0 = Annotated[float, Field(ge=0)]
StandardDeviation = Annotated[
    _From0 | Annotated[tuple[_From0, ...], AsTuple, Field(min_length=2, max_length=3)],
    Quantity(
        "m/s",
        "a number of 0 or more, or [x, z], both 0 or more",
        "a number of 0 or more, or [x, y, z], all 0 or more",
    ),
    Count(plane=(1, 2), space=(1, 3)),
]


class GaussMarkovFlow(FlowTable):
    """A velocity that wanders about its mean: a Gauss-Markov process for each axis.

    The same everywhere; drawn from `seed`.
    """

    drawn: ClassVar[bool] = True
    kind: Literal["gauss-markov"] = entry("gauss-markov", "A velocity that wanders about its mean.")
    mean: Velocity = Field(description="Mean velocity.")
    standard_deviation: StandardDeviation = Field(
        description="Standard deviation of all components or of each."
    )
    correlation_time: Seconds = Field(
        gt=0, description="Time in which its correlation falls to 1/e."
    )

    @property
    def uniform_mean(self) -> tuple[float, ...]:
        return self.mean

    def build(self, scenario: Any, generator: Any) -> Any:
        keys = ("mean", "standard_deviation", "correlation_time")
        duration = scenario.simulation.duration
        return self._made("GaussMarkov.of", *keys, duration=duration, generator=generator)


class TurbulenceFlow(FlowTable):
    """Turbulence that the water carries along: Fourier modes with a von Karman spectrum.

    The mean and all flows that are the same everywhere carry it past the arm. The mean is part of
    the flow: a uniform flow of the same velocity would double it.

    Drawn from `seed`. A planar arm sees a cut through three-dimensional turbulence.
    """

    drawn: ClassVar[bool] = True
    kind: Literal["turbulence"] = entry("turbulence", "Turbulence that the water carries along.")
    mean: Velocity = Field(description="Mean velocity.")
    intensity: float = Field(
        gt=0, le=1, description="Standard deviation of each component over the mean's magnitude."
    )
    length_scale: Metres = Field(gt=0, description="Longitudinal integral scale.")
    modes: int = entry(256, "Number of Fourier modes.", ge=8, le=10_000)

    def _conflicts(self) -> Iterator[Mistake]:
        if not any(self.mean):
            hint = "The intensity is a share of it."
            yield self.mistake("mean", "be a velocity other than 0", hint)

    @property
    def uniform_mean(self) -> tuple[float, ...]:
        return self.mean

    def build(self, scenario: Any, generator: Any) -> Any:
        keys = ("mean", "intensity", "length_scale", "modes")
        return self._made("Turbulence.of", *keys, generator=generator)
