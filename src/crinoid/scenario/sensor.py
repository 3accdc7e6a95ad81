"""Sensors: when they read, how late, how noisy and how finely.

A new kind is one class here and one entry in `Sensors`.
"""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.kinds import KindOf
from crinoid.scenario.model import Model
from crinoid.scenario.obstacle import Obstacle
from crinoid.scenario.quantity import (
    NAME,
    PER_AXIS,
    AsTuple,
    Degrees,
    Hertz,
    Metres,
    MetresPerSecond,
    Newtons,
    Pair,
    Position,
    Quantity,
    Seconds,
    span_conflicts,
)

__all__ = [
    "ContactSensor",
    "CurrentSensor",
    "InclinationSensor",
    "Sensor",
    "SensorTable",
    "Sensors",
    "ShapeSensor",
    "WrenchSensor",
    "sensor_conflicts",
]

DEFAULT_RATE = "100 if left out, or once a time step where that is slower"
_PerMetre = Annotated[float, Quantity("1/m")]
_Moment = Annotated[float, Quantity("N m")]
_Stations = Annotated[
    tuple[Annotated[float, Field(ge=0, le=1)], ...],
    AsTuple,
    Field(min_length=1, max_length=1000),
    Quantity(takes="a list of numbers from 0 to 1"),
]


class Reading(Model):
    """When a sensor reads, and how late its readings arrive."""

    rate_hz: Hertz | None = Field(
        default=None, gt=0, description=f"Readings a second; {DEFAULT_RATE}."
    )
    delay: Seconds = Field(default=0.0, ge=0, description="Age of a reading when it arrives.")


class Sensor(Reading):
    """Sensor of the tip's pose."""

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
    resolution_position: Metres = Field(
        default=0.0,
        ge=0,
        description="Coordinates are rounded to multiples of it; 0: not.",
    )
    resolution_angle_deg: Degrees = Field(
        default=0.0, ge=0, description="The same of the direction, in space turned into rad."
    )


class SensorTable(Reading):
    """A further sensor; the controller finds its readings by its name."""

    kind: str
    name: Annotated[str | None, NAME] = Field(
        default=None,
        pattern="^[a-z][a-z0-9_]*$",
        description="Name of its readings; that of its kind if left out.",
    )

    @property
    def called(self) -> str:
        """The name of its readings."""
        return self.name or self.kind

    def build(self, scenario: Any) -> tuple[Any, Any, Any]:
        """Return the `crinoid.Measurand`, and noise and resolution of its values (SI).

        For tables of installed packages; ``scenario`` is the `crinoid.Scenario` that holds it.
        """
        raise NotImplementedError


class ShapeSensor(SensorTable):
    """Curvature at stations along the arm, in space with twist, as fibre-optic sensors give it."""

    kind: Literal["shape"] = Field(default="shape", description="Curvature along the arm.")
    stations: _Stations = Field(description="Distance from the root over the arm's length.")
    noise: _PerMetre = Field(default=0.0, ge=0, description="Standard deviation of the noise.")
    resolution: _PerMetre = Field(
        default=0.0, ge=0, description="Values are rounded to multiples of it; 0: not."
    )


class WrenchSensor(SensorTable):
    """Force and moment of the arm on the submarine, about the root."""

    kind: Literal["wrench"] = Field(default="wrench", description="Force and moment at the base.")
    noise_force: Newtons = Field(
        default=0.0, ge=0, description="Standard deviation of the noise on each force."
    )
    noise_moment: _Moment = Field(
        default=0.0, ge=0, description="Standard deviation of the noise on each moment."
    )
    resolution_force: Newtons = Field(
        default=0.0, ge=0, description="Forces are rounded to multiples of it; 0: not."
    )
    resolution_moment: _Moment = Field(
        default=0.0, ge=0, description="Moments are rounded to multiples of it; 0: not."
    )


class CurrentSensor(SensorTable):
    """Velocity of the water at points that the submarine carries: a meter, or a profiler (ADCP)."""

    kind: Literal["current"] = Field(default="current", description="Velocity of the water.")
    points: Annotated[
        tuple[Position, ...],
        AsTuple,
        Field(min_length=1, max_length=1000),
        Quantity(
            "m", "a list of points [x, z], one or more", "a list of points [x, y, z], one or more"
        ),
        PER_AXIS,
    ] = Field(description="Where it measures, from the base's set position.")
    noise: MetresPerSecond = Field(
        default=0.0, ge=0, description="Standard deviation of the noise."
    )
    resolution: MetresPerSecond = Field(
        default=0.0, ge=0, description="Values are rounded to multiples of it; 0: not."
    )


class InclinationSensor(SensorTable):
    """Angle of the arm above the horizontal at stations along it."""

    kind: Literal["inclination"] = Field(
        default="inclination", description="Angle above the horizontal."
    )
    stations: _Stations = Field(description="Distance from the root over the arm's length.")
    noise_deg: Degrees = Field(default=0.0, ge=0, description="Standard deviation of the noise.")
    resolution_deg: Degrees = Field(
        default=0.0, ge=0, description="Values are rounded to multiples of it; 0: not."
    )


class ContactSensor(SensorTable):
    """Force of all obstacles on the arm, or on a part of it, along the axes of the world."""

    kind: Literal["contact"] = Field(default="contact", description="Contact force.")
    span: Pair = Field(
        default=(0.0, 1.0),
        description="Part of the arm that feels, over its length; an edge of the mesh feels whole "
        "where any of it does.",
    )
    noise: Newtons = Field(
        default=0.0, ge=0, description="Standard deviation of the noise on each component."
    )
    resolution: Newtons = Field(
        default=0.0, ge=0, description="Components are rounded to multiples of it; 0: not."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        yield from span_conflicts("span", self.span)


Sensors = Annotated[
    ShapeSensor | WrenchSensor | CurrentSensor | InclinationSensor | ContactSensor,
    Field(discriminator="kind"),
    KindOf("sensors", SensorTable),
]


def sensor_conflicts(
    sensors: tuple[SensorTable, ...], obstacles: tuple[Obstacle, ...]
) -> Iterator[Mistake]:
    """Yield names that two sensors share, and contact where there is nothing to touch."""
    names = [sensor.called for sensor in sensors]
    for index, name in enumerate(names):
        if isinstance(sensors[index], ContactSensor) and not obstacles:
            text = 'got "contact", where there is nothing to touch; takes an [[obstacle]] with it'
            yield Mistake(f"sensors.{index}.kind", text)
        if name == "tip":
            text = 'got "tip", as the sensor of the tip is called; takes another'
            yield Mistake(f"sensors.{index}.name", text)
        if name in names[:index]:
            text = f"got {shown(name)}, as sensors.{names.index(name)} is called; takes another"
            yield Mistake(f"sensors.{index}.name", text)
