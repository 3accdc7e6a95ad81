"""A chart: panels of traces over one time axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from crinoid.report.units import Unit

Role = str
"""Meaning of a trace, which gives it its colour: `"run"`, `"free"` (without control), an axis
`"x"`, `"y"` or `"z"`, `"ink"`, `"faint"`, a number of a series such as `"series 2"`, or a part of
many such as `"part 0.25"`."""

Series = Float[np.ndarray, " time"]


@dataclass(frozen=True)
class Trace:
    """Values (SI) over time (s), or over frequency (Hz) where their panel is."""

    name: str
    at: Series
    values: Series
    role: Role
    line: Literal["solid", "dashed", "dotted", "filled"] = "solid"
    """`"filled"`: steps down to zero, a value from each instant to the next."""
    behind: bool = False
    """Whether it is there to be compared with, fainter and behind the others."""
    told: str = ""
    """Numbers that sum it up."""
    quiet: bool = False
    """Whether it has no entry of its own in the key."""

    @property
    def words(self) -> str:
        """Its entry in the key."""
        return ": ".join(part for part in (self.name, self.told) if part)


@dataclass(frozen=True)
class Level:
    """A value (SI) that does not change."""

    value: float
    role: Role
    line: Literal["solid", "dashed"] = "solid"
    of: str = ""
    """Its meaning, such as a limit."""


@dataclass(frozen=True)
class Row:
    """Stretches of time in which something held."""

    name: str
    spans: Float[np.ndarray, "span 2"]
    """Beginnings and ends (s)."""
    role: Role
    behind: bool = False


@dataclass(frozen=True)
class Panel:
    """Traces of one unit above each other."""

    name: str
    label: str
    unit: Unit | None = None
    """None of what has no unit."""
    traces: tuple[Trace, ...] = ()
    levels: tuple[Level, ...] = ()
    rows: tuple[Row, ...] = ()
    """Rows of a panel that has no traces."""
    low: float | None = None
    high: float | None = None
    """Ends of its axis (SI); None where the data say."""
    tall: float = 1.6
    """Its height on paper, with its key (inches)."""
    over: tuple[float, float] | None = None
    """Ends of its frequencies (Hz), both axes logarithmic; None of what is over time."""
    columns: int = 4
    """Columns of the key."""
    nothing: str = ""
    """Why there is nothing to see, where that is so."""
    left_out: str = ""
    """A remark on data that are cut off; empty if none are."""
    also: tuple[tuple[str, Literal["dashed", "filled", "none"]], ...] = ()
    """Further entries of the key, and how their lines look."""

    @property
    def factor(self) -> float:
        """From SI to the unit of the panel."""
        return self.unit.factor if self.unit else 1.0

    @property
    def axis(self) -> str:
        """Text beside the axis."""
        return f"{self.label} ({self.unit.name})" if self.unit else self.label


@dataclass(frozen=True)
class Chart:
    """Panels that share their time."""

    name: str
    title: str
    panels: tuple[Panel, ...]
    remark: str = ""


MEMBER_ROLES = ("run", "free")
"""Roles of a run and of that without control."""


def rms(values: Series) -> float:
    """Root of the mean square of what is finite; NaN where nothing is."""
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else math.nan


def power_of_ten(power: int) -> str:
    """Write a power of ten as people do."""
    raised = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{raised}"
