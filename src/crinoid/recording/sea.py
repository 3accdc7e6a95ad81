"""A measured sea: its statistics, and the arguments of the flow that represents it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from crinoid.numerics.sea_statistics import SeaStatistics
from crinoid.recording.series import Series


@dataclass(frozen=True)
class Sea:
    """Surface waves from a file."""

    name: str  # name of the file
    statistics: SeaStatistics  # statistics of the file
    given: Mapping[str, Any]
    """Arguments of `crinoid.flow.Waves.at_gauge` or `crinoid.flow.Waves.drawn`, in SI units."""
    record: Series | None
    """Elevation about its mean that the components have (m), over the time of the run."""
    notes: tuple[str, ...]  # assumptions, statistics and omitted parts, a sentence each
