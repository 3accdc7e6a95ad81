"""A current as it was measured: which file, what in it, and how it is laid over the run."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

from pydantic import AfterValidator, Field

from crinoid.scenario.dimension import InSpace
from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.files import File
from crinoid.scenario.flow_table import FlowTable
from crinoid.scenario.quantity import AsTuple, Degrees, Hertz, Metres, Quantity, Seconds

__all__ = ["Component", "MeasuredFlow"]

_COMPONENT = re.compile(r"(-?)\s*([^\[\]]*[^\[\]\s])\s*(?:\[([^\[\]]+)\])?")


class Component(NamedTuple):
    """Where a component of the velocity stands in a file."""

    name: str
    """Name or CF standard name of a variable."""
    entry: str
    """Label of one entry of a dimension of it; empty for none."""
    sign: float

    @staticmethod
    def of(text: str) -> Component | None:
        """Read ``u``, ``-u`` or ``vel[E]``; None for ``0``, which stands for no component."""
        found = _COMPONENT.fullmatch(text.strip())
        if found is None:
            raise ValueError(text)
        sign, name, entry = found.groups()
        if name == "0":
            return None
        return Component(name, (entry or "").strip().strip("\"'"), -1.0 if sign else 1.0)


def _known(text: str) -> str:
    Component.of(text)
    return text


Name = Annotated[
    str,
    AfterValidator(_known),
    Quantity(takes='the name of a variable, such as "u", "-u", "vel[E]", or "0" for none'),
]


class MeasuredFlow(FlowTable):
    """A current as it was measured, from a CSV or netCDF file.

    A record at one point is carried past the arm by its mean velocity; a profile (`vertical`) is
    the same at all points of a height.
    """

    kind: Literal["measured"] = Field(
        default="measured", description="A current as it was measured."
    )
    file: File = Field(
        description="CSV or netCDF file. A relative path starts from the scenario file that names "
        "it, with --set and in Python from the working directory.",
    )
    velocity: Annotated[
        tuple[Name, ...],
        AsTuple,
        Quantity(takes="a list of names"),
        InSpace(("u", "v", "w")),
    ] = Field(
        default=("u", "w"),
        description="Variables, by name or CF standard name: along x and z, in space x, y and z; "
        'with heading_deg east, north and up. "-u" turns one round, "vel[E]" is one entry of a '
        'labelled dimension, "0" is none.',
    )
    time: str = Field(default="time", min_length=1, description="Variable that holds the time.")
    vertical: str | None = Field(
        default=None,
        min_length=1,
        description="Variable that holds the levels of a profile, upward from z = origin; "
        'downward with "-range" or if the file says so (positive = "down").',
    )
    origin: Metres | None = Field(
        default=None,
        description="Height z from which levels count; if left out, the bed for levels that count "
        "upward, the surface for a depth.",
    )
    heading_deg: Degrees | None = Field(
        default=None,
        description="Compass heading of x, clockwise from north; velocity then names east, north "
        "and up.",
    )
    select: Annotated[
        dict[str, float], Quantity(takes="a table of numbers, such as {lat = 48.1}")
    ] = Field(
        default={},
        description="Where in the other dimensions, as {lat = 48.1}: the nearest point; of a "
        "dimension without coordinates the index, from 0.",
    )
    skip: Seconds = Field(
        default=0.0,
        ge=0,
        description="Time of the record when the run begins; later if being carried past the arm "
        "takes longer.",
    )
    velocity_scale: float = Field(
        default=1.0, gt=0, description="Velocity in the run over that in the record."
    )
    time_scale: float = Field(
        default=1.0, gt=0, description="How long a second of the record lasts in the run."
    )
    low_pass_hz: Hertz | None = Field(
        default=None,
        gt=0,
        description="Cut-off of a low-pass filter (Butterworth, forth and back), in the record's "
        "own time.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if all(component is None for component in self.components):
            text = f"got {shown(self.velocity)}, takes the name of a variable for at least one"
            yield Mistake("velocity", text)
        if self.origin is not None and self.vertical is None:
            yield Mistake("origin", "goes with vertical, which names the levels of a profile")

    @property
    def components(self) -> tuple[Component | None, ...]:
        """Where the components of the velocity stand; None for one that there is not."""
        return tuple(Component.of(text) for text in self.velocity)
