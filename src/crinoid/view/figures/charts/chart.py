"""A chart: panels of traces over one time axis."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from crinoid.results.units import Unit, largest

Role = str
"""Meaning of a trace, which gives it its colour: `"run"`, `"free"` (without control), an axis
`"x"`, `"y"` or `"z"`, `"ink"`, `"faint"`, a number of a series such as `"series 2"`, or a part of
many such as `"part 0.25"`."""

Series = Float[np.ndarray, " time"]


@dataclass(frozen=True)
class Trace:
    """Values (SI) over time (s), or over frequency (Hz) or distance (m) where their panel is."""

    name: str
    at: Series
    values: Series
    role: Role
    line: Literal["solid", "dashed", "dotted", "filled", "points"] = "solid"
    """`"filled"`: steps down to zero, a value from each instant to the next; points: on paper."""
    reference: bool = False  # whether others are compared with it, as with a run without control
    summary: str = ""  # numbers that summarise it
    quiet: bool = False  # whether it has no entry in the key

    @property
    def behind(self) -> bool:
        """Whether it is drawn fainter and behind the others."""
        return self.reference or self.role == "free"

    @property
    def words(self) -> str:
        """Its entry in the key."""
        return ": ".join(part for part in (self.name, self.summary) if part)


@dataclass(frozen=True)
class Level:
    """A value (SI) that does not change."""

    value: float
    role: Role
    line: Literal["solid", "dashed"] = "solid"


@dataclass(frozen=True)
class IntervalRow:
    """Intervals of time."""

    name: str
    spans: Float[np.ndarray, "span 2"]  # beginnings and ends (s)
    role: Role
    behind: bool = False


@dataclass(frozen=True)
class Panel:
    """Traces of one unit above each other."""

    name: str
    label: str
    unit: Unit | None = None  # None without a unit
    traces: tuple[Trace, ...] = ()
    levels: tuple[Level, ...] = ()
    rows: tuple[IntervalRow, ...] = ()  # rows of a panel that has no traces
    low: float | None = None
    high: float | None = None  # ends of its axis (SI); None from the data
    tall: float = 1.6  # its height on paper, with its key (inches)
    over: tuple[float, float] | None = None  # ends of its frequencies (Hz) on logarithmic axes
    along: float | None = None  # length of the arm (m), where traces are over that from the root
    aside: float | None = None  # time (s) before which values do not count, and are shaded
    columns: int = 4  # columns of the key
    nothing: str = ""  # why the panel is empty, where it is
    left_out: str = ""  # a remark on data that are cut off
    also: tuple[tuple[str, Literal["dashed", "filled", "none"]], ...] = ()
    """Further entries of the key, and how their lines look."""

    @property
    def factor(self) -> float:
        """From SI to the unit of the panel."""
        return self.unit.factor if self.unit else 1.0

    @property
    def axis(self) -> str:
        """Label of its axis."""
        return f"{self.label} ({self.unit.name})" if self.unit else self.label

    def without_round_off(self) -> Panel:
        """Return it with zeros in place of values that are only round-off."""
        if self.over:
            return self
        most = largest(*(trace.values for trace in self.traces))
        least = max(_ROUND_OFF * most, _SMALLEST / self.factor if self.unit else 0.0)
        zeroed = [np.where(np.abs(each.values) < least, 0.0, each.values) for each in self.traces]
        pairs = zip(self.traces, zeroed, strict=True)
        traces = tuple(replace(trace, values=values) for trace, values in pairs)
        return replace(self, traces=traces, high=None if 0.0 < most < least else self.high)


@dataclass(frozen=True)
class Chart:
    """Panels that share their time."""

    name: str
    title: str
    panels: tuple[Panel, ...]
    remark: str = ""

    @property
    def filled(self) -> tuple[Panel, ...]:
        """Its panels that are not empty; all if each is."""
        some = [panel for panel in self.panels if not panel.nothing] or self.panels
        return tuple(panel.without_round_off() for panel in some)


_ROUND_OFF, _SMALLEST = 1e-9, 1e-7
"""Largest round-off: of the largest value of a panel, and in its unit."""
ZERO = (Level(0.0, "faint"),)
MEMBER_ROLES = ("run", "free")  # roles of a run and of that without control


def rms(values: Series) -> float:
    """Root mean square of the finite values; NaN without any."""
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else math.nan
