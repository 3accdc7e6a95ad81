"""Prescribed motions of the base: of one channel, or of the vessel that carries it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from crinoid.foundation.axes import ANGLES, CHANNELS
from crinoid.scenario.document import RecordFile
from crinoid.scenario.errors import Mistake, ScenarioError, got, missing, one_of, refusal
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import (
    LATEST,
    AsTuple,
    Degrees,
    DegreesPerSecond,
    Hertz,
    InSpace,
    Metres,
    MetresPerSecond,
    Only,
    Position,
    Quantity,
    Seconds,
    Times,
    length_conflicts,
    time_conflicts,
)

if TYPE_CHECKING:
    ChannelName = str
else:
    ChannelName = Annotated[
        Literal[CHANNELS[3]], Quantity(expects=one_of(CHANNELS[2]), in_space=one_of(CHANNELS[3]))
    ]


Interpolation = Annotated[
    Literal["monotone", "smooth"],
    Field(
        description="monotone: between two points it rises or falls as they do, and never swings "
        "past them; smooth: a cubic spline, more accurate where the points follow a smooth curve. "
        "Either has a continuous acceleration."
    ),
]


class ChannelMotion(Model):
    """A motion of one channel."""

    size_key: ClassVar[str] = ""
    """Key of its size, which ends in ``_deg`` for a turn; none of a motion in a file."""
    kind: str
    channel: ChannelName = Field(
        description="Channel that moves: slide (x), heave (z) or tilt; in space also sway "
        "(y), pan or roll."
    )

    def moved(self, axes: int) -> tuple[str, ...]:
        """Return the channels that it moves."""
        return (self.channel,)

    @property
    def size_si(self) -> Any:
        """Its amplitude (m), its velocity (m/s) or its shifts (m); those of a turn in rad."""
        shift, turn = getattr(self, self.size_key), getattr(self, f"{self.size_key}_deg")
        if turn is None:
            return shift
        return tuple(map(math.radians, turn)) if isinstance(turn, tuple) else math.radians(turn)

    def _conflicts(self) -> Iterator[Mistake]:
        """Yield an angle without degrees, or a shift with them."""
        if not self.size_key:
            return
        right, wrong = self.size_key, f"{self.size_key}_deg"
        if self.channel in ANGLES:
            right, wrong = wrong, right
        where = f'with channel = "{self.channel}"'
        value = getattr(self, wrong)
        if value is not None:
            yield Mistake(wrong, got(value, f"be left out {where}", f"Use {right} instead."))
        elif getattr(self, right) is None:
            yield Mistake(right, missing(f"be given {where}"))


class SineMotion(ChannelMotion):
    """A motion ``amplitude * sin(2 pi frequency_hz t + phase)``."""

    size_key: ClassVar[str] = "amplitude"
    kind: Literal["sine"] = entry("sine", "A sine.")
    amplitude: Metres | None = entry(None, "Amplitude of a shift.")
    amplitude_deg: Degrees | None = entry(None, "Amplitude of a turn.")
    frequency_hz: Hertz = Field(gt=0, description="Frequency.")
    phase_deg: Degrees = entry(0.0, "Phase at t = 0.")

    def farthest(self, duration: float) -> float:
        """Return the largest displacement during a run (m or rad), or a bound to it."""
        return abs(self.size_si)


class VelocityMotion(ChannelMotion):
    """A constant velocity, reached along half a cosine from rest."""

    size_key: ClassVar[str] = "velocity"
    kind: Literal["velocity"] = entry("velocity", "A constant velocity.")
    velocity: MetresPerSecond | None = entry(None, "Velocity of a shift.")
    velocity_deg: DegreesPerSecond | None = entry(None, "Velocity of a turn.")
    start: Seconds = entry(0.0, "Start time.", ge=0, le=LATEST)
    ramp_time: Seconds = entry(1.0, "Time to reach the velocity.", gt=0)

    def farthest(self, duration: float) -> float:
        """Return the largest displacement during a run (m or rad), or a bound to it."""
        return abs(self.size_si) * duration


_Shifts = Annotated[tuple[Metres, ...], AsTuple, Quantity("m", "a list of numbers")]
_Turns = Annotated[tuple[Degrees, ...], AsTuple, Quantity("degrees", "a list of numbers")]


class TableMotion(ChannelMotion):
    """A motion through points in time."""

    size_key: ClassVar[str] = "value"
    kind: Literal["table"] = entry("table", "Points in time.")
    time: Times = Field(description="Times, increasing, from 0 or before to the end of the run.")
    value: _Shifts | None = entry(None, "Shift at these times.")
    value_deg: _Turns | None = entry(None, "Turn at these times.")
    interpolation: Interpolation = "monotone"

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        yield from time_conflicts(self.time)
        for key, values in (("value", self.value), ("value_deg", self.value_deg)):
            if values is not None:
                yield from length_conflicts(key, values, self.time)

    def farthest(self, duration: float) -> float:
        """Return the largest displacement during a run (m or rad), or a bound to it."""
        return max(map(abs, self.size_si))


class InFile(Model):
    """Keys of every motion in a file."""

    kind: str
    file: RecordFile
    time_column: str = entry(
        "time",
        "Column of times, from 0 or earlier to the end of the run; dates count from the first.",
        min_length=1,
    )
    skip: Seconds = entry(0.0, "Time of the file at which the run starts.", ge=0)
    interpolation: Interpolation = "monotone"


class FileMotion(ChannelMotion, InFile):
    """A motion as in a file, such as a record of heave."""

    kind: Literal["file"] = entry("file", "Points in time from a file.")
    value_column: str | None = entry(
        None,
        "Column of shifts, or of turns (in degrees without a unit); by default the name of the "
        "channel.",
        min_length=1,
    )


def _column(name: str, about: str) -> Any:
    return entry(None, f'{about}; by default "{name}".', min_length=1)


class VesselColumns(Model):
    """Columns of a vessel's motion: "-heading" reverses one, "0" is no motion."""

    surge: str | None = _column("surge", "Shift forward; of a log along x from the start")
    sway: Annotated[str | None, Only(3)] = _column(
        "sway", "Shift to port; of a log along y from the start"
    )
    heave: str | None = _column("heave", "Shift upward")
    roll: Annotated[str | None, Only(3)] = _column("roll", "Turn that lifts the port side")
    pitch: str | None = _column("pitch", "Turn that lifts the bow")
    yaw: Annotated[str | None, Only(3)] = _column(
        "yaw", "Turn of the bow to port; of a log from the start"
    )

    def given(self, axes: int) -> dict[str, tuple[float, str]]:
        """Return sign and column of each degree of freedom of a base, sign 0 for no motion."""
        names = ("surge", "heave", "pitch") if axes == 2 else VESSEL
        columns = {name: getattr(self, name) or name for name in names}
        return {
            name: (
                0.0 if given == "0" else -1.0 if given[0] == "-" else 1.0,
                given.removeprefix("-"),
            )
            for name, given in columns.items()
        }


VESSEL = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Degrees of freedom of a vessel."""


class OnVessel(Model):
    """Keys of every motion of a vessel that carries the base."""

    kind: str
    columns: VesselColumns = entry(VesselColumns(), "Columns of the motions, by their names.")
    offset: Annotated[Position, InSpace((0.0, 0.0, 0.0))] = entry(
        (0.0, 0.0),
        "Place of the arm's root from the point that the file belongs to; x forward, y to port, "
        "z up.",
    )

    def moved(self, axes: int) -> tuple[str, ...]:
        """Return the channels that it moves, of a planar or spatial base."""
        return CHANNELS[axes]


class VesselMotion(OnVessel, InFile):
    """The motion of a vessel that carries the base, as in its log."""

    kind: Literal["vessel"] = entry("vessel", "All motions of a vessel from a file.")


class ResponseMotion(OnVessel):
    """The motion of a vessel in the surface waves of the scenario, by its RAOs.

    Response amplitude operators, from a table or from a netCDF file of capytaine.
    """

    kind: Literal["rao"] = entry("rao", "A vessel by its response amplitude operators.")
    file: RecordFile
    heading_deg: Degrees = entry(
        0.0, "Direction of the bow: 0 toward +x, 90 toward +y; in the plane 0 or 180."
    )
    phase_is: Literal["lag", "lead"] | None = entry(
        None,
        "Whether phases lag or lead the crest at that point: a table needs it; lag by default of "
        "complex RAOs, with exp(-i omega t).",
    )
    direction_is: Literal["to", "from"] | None = entry(
        None,
        "Whether waves travel to the headings of the file or come from them: a table needs it; to "
        "by default of capytaine. Head seas are 180 with to, 0 with from.",
    )
    symmetric: bool = entry(
        False, "Whether port and starboard are alike, for a file with headings of one side only."
    )


def too_steep(tilt: float) -> ScenarioError:
    """Return the mistake of an arm in space whose root points so steeply (rad) on a vessel."""
    text = (
        f"the arm has a tilt of {math.degrees(tilt):.0f} degrees while the vessel rolls or pitches"
    )
    hint = 'Or set roll to "0", and yaw to "0" or base.pan_deg to 0.'
    return refusal("columns", text, "point less steeply in space", hint)


Motion = Annotated[
    SineMotion | VelocityMotion | TableMotion | FileMotion | VesselMotion | ResponseMotion,
    Field(discriminator="kind"),
]
