"""A validation case: its reference, how crinoid computes it, and the checks of both."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any, Literal

from matplotlib.axes import Axes

from crinoid.scenario import Scenario

Kind = Literal["exact", "published", "measured", "peer"]
KINDS: tuple[Kind, ...] = ("exact", "published", "measured", "peer")
"""Origins of a reference: solution on paper, numbers in print, experiment, another program."""


@dataclass(frozen=True)
class Check:
    """A computed value and its reference.

    Parameters
    ----------
    quantity
        Name of the quantity.
    reference, value
        Number of the source and number of crinoid, in ``unit``.
    tolerance
        Largest error that holds.
    unit
        SI unit; ``1`` without one.
    relative
        Whether error and tolerance are shares of the reference.

    Raises
    ------
    ValueError
        If the tolerance is not a finite number of 0 or more, or a relative error has no reference.
    """

    quantity: str
    reference: float
    value: float
    tolerance: float
    unit: str = "1"
    relative: bool = False

    def __post_init__(self) -> None:
        for name in ("reference", "value", "tolerance"):  # also from arrays
            object.__setattr__(self, name, float(getattr(self, name)))
        if not 0 <= self.tolerance < math.inf:
            raise ValueError(f"{self.quantity}: tolerance must be a finite number of 0 or more")
        if self.relative and not self.reference:
            raise ValueError(f"{self.quantity}: a reference of 0 has no relative error")

    @property
    def error(self) -> float:
        """Distance from the reference, in ``unit`` or as a share of the reference."""
        distance = abs(self.value - self.reference)
        return distance / abs(self.reference) if self.relative else distance

    @property
    def holds(self) -> bool:
        """Whether the error is within the tolerance; never for NaN."""
        return self.error <= self.tolerance


@dataclass(frozen=True)
class Evidence:
    """The result of a case: its checks, and material to judge them by.

    Parameters
    ----------
    checks
        One or more checks.
    order
        Measured order of convergence, if there is one.
    scenarios
        Scenarios of the case by label; the label of a single one may be empty.
    draw
        Function that draws the case into axes, if there is a figure.
    remarks
        Sentences on limits, such as the error of the source's own model.
    """

    checks: Sequence[Check]
    order: float | None = None
    scenarios: Mapping[str, Scenario] = field(default_factory=dict)
    draw: Callable[[Axes], None] | None = None
    remarks: Sequence[str] = ()

    def __post_init__(self) -> None:
        if not self.checks:
            raise ValueError("a case needs at least one check")


@dataclass(frozen=True)
class Case:
    """A validation case; its texts are sentences."""

    name: str
    """Name on the command line, in kebab-case: that of its function."""
    run: Callable[[], Evidence]
    kind: Kind
    title: str
    """Statement of the case."""
    source: str
    """Paper and equation of the reference."""
    method: str
    """How crinoid computes it: mesh, time step."""
    reason: str
    """Reason for the tolerances."""
    long: bool = False
    """Whether it costs more than about a minute."""
    needs: tuple[str, ...] = ()
    """Packages of other programs."""

    @property
    def missing(self) -> list[str]:
        """Packages that are not installed."""
        return [package for package in self.needs if find_spec(package) is None]


def case(**about: Any) -> Callable[[Callable[[], Evidence]], Case]:
    """Make a function the `Case` of its name; the arguments are the texts and the kind."""
    return lambda run: Case(run.__name__.replace("_", "-"), run, **about)
