"""The controller and what it sees.

A new kind is one class here, one field of `Control` and one entry in `ControlKind`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.dimension import InSpace, Only
from crinoid.scenario.errors import Mistake, one_of, shown
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import AsTuple, Degrees, Hertz, Metres, Quantity, Seconds
from crinoid.space import AXES, CHANNELS

__all__ = ["Control", "ControlKind", "Coordinate", "Pid", "PidGains", "Sensor"]

ControlKind = Literal["none", "pid"]
COORDINATES = {2: (*AXES[2], "angle"), 3: (*AXES[3], "direction")}
"""Coordinates of the tip that a controller can bring to the target, by the number of axes."""

# spelled out for the type checker: those of the plane and of space
Coordinate = Annotated[
    Literal["x", "y", "z", "angle", "direction"],
    Quantity(takes=one_of(COORDINATES[2]), in_space=one_of(COORDINATES[3])),
]

_DEFAULT_RATE = "100 if left out, or once a time step where that is slower"


class Sensor(Model):
    """Sensor of the tip: when it reads, how late and how noisy."""

    rate_hz: Hertz | None = Field(
        default=None, gt=0, description=f"Readings a second; {_DEFAULT_RATE}."
    )
    delay: Seconds = Field(default=0.0, ge=0, description="Age of a reading when it arrives.")
    noise_position: Metres = Field(
        default=0.0,
        ge=0,
        description="Standard deviation of the noise on each coordinate of the tip.",
    )
    noise_angle_deg: Degrees = Field(
        default=0.0,
        ge=0,
        description="Standard deviation of the noise on the direction of the tip; in space, turned "
        "into rad, on each component of the unit vector.",
    )


class PidGains(Model):
    """Gains of one channel."""

    kp: float = Field(default=0.0, description="Proportional gain.")
    ki: Annotated[float, Quantity("1/s")] = Field(default=0.0, description="Integral gain.")
    kd: Annotated[float, Quantity("s")] = Field(default=0.0, description="Derivative gain.")
    derivative_filter_hz: Hertz = Field(
        default=10.0, gt=0, description="Corner frequency of the low-pass filter on the derivative."
    )


class Pid(Model):
    """A PID controller: gains for each channel it drives."""

    slide: PidGains | None = Field(default=None, description="Gains of slide.")
    sway: Annotated[PidGains | None, Only(3)] = Field(default=None, description="Gains of sway.")
    heave: PidGains | None = Field(default=None, description="Gains of heave.")
    pan: Annotated[PidGains | None, Only(3)] = Field(default=None, description="Gains of pan.")
    tilt: PidGains | None = Field(default=None, description="Gains of tilt.")
    roll: Annotated[PidGains | None, Only(3)] = Field(default=None, description="Gains of roll.")

    @property
    def present(self) -> dict[str, PidGains]:
        """The gains there are, by channel, in the order of `crinoid.space.CHANNELS`."""
        every = {name: getattr(self, name) for name in CHANNELS[3]}
        return {name: gains for name, gains in every.items() if gains is not None}


class Control(Model):
    """The controller; the settings of a kind that is not chosen are kept but not used."""

    kind: ControlKind = Field(default="none", description="Kind of controller.")
    rate_hz: Hertz | None = Field(
        default=None, gt=0, description=f"Commands a second; {_DEFAULT_RATE}."
    )
    start: Seconds = Field(
        default=0.0,
        ge=0,
        description="When it is switched on; the base rests until then. During a run it takes up "
        "the error that it finds over 1 s, without a jolt.",
    )
    controlled: Annotated[
        tuple[Coordinate, ...],
        AsTuple,
        Field(min_length=1),
        Quantity(
            takes=f"a list of {one_of(COORDINATES[2], 'and')}",
            in_space=f"a list of {one_of(COORDINATES[3], 'and')}",
        ),
        InSpace(("x", "y", "z")),
    ] = Field(default=("x", "z"), description="Coordinates of the tip to bring to the target.")
    mapping: Literal["static-jacobian", "identity"] = Field(
        default="static-jacobian",
        description="From errors of the tip to channels: through the tip's response at rest, "
        "or one to one (x to slide, z to heave, angle to tilt; in space x, y and z to slide, sway "
        "and heave).",
    )
    compare: bool = Field(
        default=True, description="Whether to run the same case with the controller off as well."
    )
    pid: Pid = Field(default=Pid(), description="Settings of kind pid: gains by channel.")

    def _conflicts(self) -> Iterator[Mistake]:
        if len(set(self.controlled)) < len(self.controlled):
            yield Mistake("controlled", f"got {shown(self.controlled)}, takes each one once")
        if self.kind == "pid" and not self.pid.present:
            yield Mistake("pid", 'missing, kind = "pid" takes gains for at least one channel')
