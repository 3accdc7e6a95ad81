"""Settings of model predictive control."""

from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake
from crinoid.scenario.lqg import ModelBased
from crinoid.scenario.quantity import Seconds

__all__ = ["Mpc"]


class Mpc(ModelBased):
    """Model predictive control: a receding horizon within the limits of the inputs."""

    horizon: Seconds = Field(
        default=1.0, gt=0, le=10, description="How far ahead it plans the commands."
    )
    current: Literal["unknown", "measured", "known"] = Field(
        default="unknown",
        description="What it knows of the water beside what the observer makes of the sensors: "
        "nothing; what the readings of the first sensor of kind current tell of the water at the "
        "arm, now and later, by the statistics of the flows; or the flows of the scenario "
        "themselves, ahead of time, as no controller in the sea would.",
    )
    model: Literal["frozen", "scheduled"] = Field(
        default="frozen",
        description="Linear model of the arm: that of the start; or those of several poses of the "
        "base on the way of the target, each the more the nearer the base is to it, for arms that "
        "turn far.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if self.model == "scheduled" and self.current != "unknown":
            yield Mistake("model", 'got "scheduled", goes with current = "unknown"')
