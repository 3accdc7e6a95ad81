"""Surface waves in a file: the elevation at a gauge, or a spectrum."""

from typing import Annotated, Literal

from crinoid.scenario.document import RecordFile
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import (
    AsTuple,
    Count,
    Degrees,
    Hertz,
    InSpace,
    Metres,
    Quantity,
    Seconds,
)


class ElevationFile(Model):
    """The elevation of the surface at a gauge over time."""

    file: RecordFile
    time: str = entry("time", "Column of times; dates count from the first.", min_length=1)
    value: str = entry("elevation", "Column of the elevation, upward.", min_length=1)
    skip: Seconds = entry(0.0, "Time of the record at which the run starts.", ge=0)
    position: Annotated[
        tuple[Metres, ...],
        AsTuple,
        Quantity("m", "[x]", "[x, y]"),
        Count(plane=(1,), space=(2,)),
        InSpace((0.0, 0.0)),
    ] = entry((0.0,), "Place of the gauge.")
    cut_hz: Hertz | None = entry(
        None,
        "Highest frequency of the components; by default four times that of the peak, or more up "
        "to 99.9 % of the variance, and at most half the rate of the record.",
        gt=0,
    )


class SpectrumFile(Model):
    """The spectrum of the elevation, of frequency or of frequency and direction."""

    file: RecordFile
    density: str | None = entry(
        None, "Variable of the density; by default by its standard name or a usual name.",
        min_length=1,
    )  # fmt: skip
    frequency: str | None = entry(
        None, "Variable of the frequencies, as for density.", min_length=1
    )
    direction: str | None = entry(
        None, "Variable of the compass directions, as for density.", min_length=1
    )
    direction_is: Literal["to", "from"] | None = entry(
        None,
        "Whether waves travel to the directions or come from them; by default by the standard name "
        "of the directions.",
    )
    heading_deg: Degrees | None = entry(
        None, "Compass heading of x, clockwise from north: needed for a spectrum with directions."
    )
    select: Annotated[
        dict[str, float], Quantity(expects="a table of numbers, such as {time = 0}")
    ] = entry(
        {},
        "Place in the other dimensions, such as {time = 12402.5, station = 1}: the nearest point; "
        "without coordinates the index, from 0.",
    )
