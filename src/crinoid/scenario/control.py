"""The controller and what it sees.

A new kind is one class here, one field of `Control` and one entry in `ControlKind`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.channel import ChannelName
from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import AsTuple, Degrees, Hertz, Metres, Quantity, Seconds

__all__ = ["Control", "ControlKind", "Coordinate", "Pid", "PidGains", "Sensor"]

ControlKind = Literal["none", "pid"]
Coordinate = Literal["x", "z", "angle"]

_PARTNERS: dict[ChannelName, Coordinate] = {"slide": "x", "heave": "z", "tilt": "angle"}
_DEFAULT_RATE = "100 if left out, or once a time step where that is slower"


class Sensor(Model):
    """What the controller knows of the tip, and when."""

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
        description="Standard deviation of the noise on the direction of the tip.",
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
    heave: PidGains | None = Field(default=None, description="Gains of heave.")
    tilt: PidGains | None = Field(default=None, description="Gains of tilt.")

    @property
    def present(self) -> dict[ChannelName, PidGains]:
        """The gains there are, by channel, in the order slide, heave, tilt."""
        every: dict[ChannelName, PidGains | None]
        every = {"slide": self.slide, "heave": self.heave, "tilt": self.tilt}
        return {name: gains for name, gains in every.items() if gains is not None}


class Control(Model):
    """The controller; the settings of a kind that is not chosen are kept but not used."""

    kind: ControlKind = Field(default="none", description="Kind of controller.")
    rate_hz: Hertz | None = Field(
        default=None, gt=0, description=f"Commands a second; {_DEFAULT_RATE}."
    )
    start: Seconds = Field(
        default=0.0, ge=0, description="When it is switched on; the base rests until then."
    )
    controlled: Annotated[
        tuple[Coordinate, ...],
        AsTuple,
        Field(min_length=1),
        Quantity(takes='a list of "x", "z" and "angle"'),
    ] = Field(default=("x", "z"), description="Coordinates of the tip to bring to the target.")
    mapping: Literal["static-jacobian", "identity"] = Field(
        default="static-jacobian",
        description="From errors of the tip to channels: through the tip's response at rest, "
        "or one to one (x to slide, z to heave, angle to tilt).",
    )
    compare: bool = Field(
        default=True, description="Whether to run the same case with the controller off as well."
    )
    pid: Pid = Field(default=Pid(), description="Settings of kind pid: gains by channel.")

    def _conflicts(self) -> Iterator[Mistake]:
        if len(set(self.controlled)) < len(self.controlled):
            yield Mistake("controlled", f"got {shown(self.controlled)}, takes each one once")
        driven = self.pid.present
        if self.kind == "pid" and not driven:
            yield Mistake("pid", 'missing, kind = "pid" takes gains for at least one channel')
        if self.mapping == "identity" and driven:
            for channel, coordinate in _PARTNERS.items():
                if channel in driven and coordinate not in self.controlled:
                    text = f'mapping = "identity" takes "{coordinate}" in controlled along with it'
                    yield Mistake(f"pid.{channel}", text)
                elif channel not in driven and coordinate in self.controlled:
                    text = f'"{coordinate}" takes gains in pid.{channel} with mapping = "identity"'
                    yield Mistake("controlled", text)
