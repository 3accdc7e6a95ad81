"""Numbers that sum up a run, with their units: the same in studies, comparisons and batches."""

from collections.abc import Callable
from typing import NamedTuple

from crinoid.metrics import (
    angle_error,
    deflection,
    input_speed,
    settling_time,
    spent_work,
    tip_error,
)
from crinoid.result import Result

__all__ = ["EFFORT", "MEASURES", "Measure", "Measures", "measured"]


class Measure(NamedTuple):
    """A number of a run."""

    unit: str
    meaning: str
    of: Callable[[Result], float | None]
    """None where a run has no such number."""

    @property
    def attributes(self) -> dict[str, str]:
        """Its attributes in a file."""
        return {"units": self.unit, "long_name": self.meaning}


class Measures(NamedTuple):
    """Sums of one run."""

    numbers: dict[str, float]
    """By name, such as ``rms_error``; NaN where a run has no such number."""
    speed: dict[str, float]
    """RMS speed of each input that can move."""
    unit: dict[str, str]
    """Units of the speeds."""


def _error_uncontrolled(result: Result) -> float | None:
    return None if result.uncontrolled is None else tip_error(result.uncontrolled).rms


MEASURES = {
    "rms_error": Measure(
        "m", "RMS distance of the tip from where it should be", lambda run: tip_error(run).rms
    ),
    "rms_error_uncontrolled": Measure(
        "m", "RMS distance of the tip from where it should be, without control", _error_uncontrolled
    ),
    "max_error": Measure(
        "m",
        "largest distance of the tip from where it should be",
        lambda run: tip_error(run).maximum,
    ),
    "steady_error": Measure(
        "m",
        "mean distance of the tip from where it should be, over the last tenth of the run",
        lambda run: tip_error(run).steady,
    ),
    "fluctuation": Measure(
        "m",
        "RMS distance of the tip from its own mean position",
        lambda run: tip_error(run).fluctuation,
    ),
    "deflection": Measure(
        "m",
        "mean distance of the tip without control from where it should be, over the last tenth",
        deflection,
    ),
    "settling_time": Measure(
        "s", "when the tip error last came into 5 % of the largest one", settling_time
    ),
    "rms_angle_error": Measure(
        "rad",
        "RMS angle between where the tip points and where it should",
        lambda run: angle_error(run).rms,
    ),
    "max_angle_error": Measure(
        "rad",
        "largest angle between where the tip points and where it should",
        lambda run: angle_error(run).maximum,
    ),
    "work": Measure(
        "J",
        "work that base and actuators did on the arm, what it gave back not counted",
        spent_work,
    ),
}
"""Numbers of each run by their names in tables and files."""
EFFORT = "RMS speed of the inputs, of means between saved instants"
"""The speeds of `measured` in words."""


def measured(result: Result) -> Measures:
    """Return the sums of a run that has reached its end."""
    data, speed = result.dataset, input_speed(result)
    unit = dict(zip(data["channel"].values, data["channel_unit"].values, strict=True))
    if "input" in data:
        unit |= dict(zip(data["input"].values, data["input_unit"].values, strict=True))
    found = {name: measure.of(result) for name, measure in MEASURES.items()}
    return Measures(
        {name: float("nan") if value is None else value for name, value in found.items()},
        speed,
        {name: _per_second(str(unit[name])) for name in speed},
    )


def _per_second(unit: str) -> str:
    return "s-1" if unit == "1" else f"{unit} s-1"
