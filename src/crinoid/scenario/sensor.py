"""Sensors: rate, delay, noise and resolution of their readings.

A new kind is one class here and one entry in `Sensors`.
"""
# ruff: noqa: D102  # the base class documents its methods

import math
from collections.abc import Iterator
from pkgutil import resolve_name
from typing import Annotated, Any, Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake, got
from crinoid.scenario.kinds import KindOf, part
from crinoid.scenario.model import Model, entry
from crinoid.scenario.obstacle import Obstacle
from crinoid.scenario.quantity import (
    PER_AXIS,
    AsTuple,
    Degrees,
    Hertz,
    Metres,
    MetresPerSecond,
    Name,
    NewtonMetres,
    Newtons,
    Pair,
    PerMetre,
    Position,
    Quantity,
    Seconds,
    name_conflicts,
    span_conflicts,
)

DEFAULT_RATE = "100 by default, or once a time step if that is slower"
_Stations = Annotated[
    tuple[Annotated[float, Field(ge=0, le=1)], ...],
    AsTuple,
    Field(min_length=1, max_length=1000),
    Quantity(expects="a list of numbers from 0 to 1"),
]


class Sampling(Model):
    """Rate and delay of a sensor."""

    rate_hz: Hertz | None = entry(None, f"Readings a second; {DEFAULT_RATE}.", gt=0)
    delay: Seconds = entry(0.0, "Age of a reading when it arrives.", ge=0)


class Sensor(Sampling):
    """Sensor of the tip's pose."""

    noise_position: Metres = entry(0.0, "Standard deviation of the noise of each coordinate.", ge=0)
    noise_angle_deg: Degrees = entry(
        0.0,
        "Standard deviation of the noise of the direction; in space, in rad, of each component "
        "of the unit vector.",
        ge=0,
    )
    resolution_position: Metres = entry(
        0.0, "Step to which coordinates are rounded; 0: none.", ge=0
    )
    resolution_angle_deg: Degrees = entry(
        0.0, "Step of the direction, in space in rad; 0: none.", ge=0
    )


class SensorTable(Sampling):
    """A further sensor; the controller finds its readings by its name."""

    kind: str
    name: Name = entry(None, "Name of its readings; by default its kind.")

    @property
    def called(self) -> str:
        """Name of its readings."""
        return self.name or self.kind

    def build(self, scenario: Any) -> tuple[Any, Any, Any]:
        """Return the `crinoid.Measurand`, and noise and resolution of its values (SI).

        ``scenario`` is the `crinoid.Scenario` with this table.
        """
        raise NotImplementedError


class ShapeSensor(SensorTable):
    """Curvature at stations along the arm, in space with twist, like fibre-optic sensors."""

    kind: Literal["shape"] = entry("shape", "Curvature along the arm.")
    stations: _Stations = Field(description="Distance from the root over the arm's length.")
    noise: PerMetre = entry(0.0, "Standard deviation of the noise.", ge=0)
    resolution: PerMetre = entry(0.0, "Step to which values are rounded; 0: none.", ge=0)

    def build(self, scenario: Any) -> tuple[Any, Any, Any]:
        return part("crinoid.control:Shape", self.stations), self.noise, self.resolution


class WrenchSensor(SensorTable):
    """Force and moment of the arm on the submarine, about the root."""

    kind: Literal["wrench"] = entry("wrench", "Force and moment at the base.")
    noise_force: Newtons = entry(0.0, "Standard deviation of the noise of each force.", ge=0)
    noise_moment: NewtonMetres = entry(0.0, "Standard deviation of the noise of each moment.", ge=0)
    resolution_force: Newtons = entry(0.0, "Step to which forces are rounded; 0: none.", ge=0)
    resolution_moment: NewtonMetres = entry(0.0, "Step to which they are rounded; 0: none.", ge=0)

    def build(self, scenario: Any) -> tuple[Any, Any, Any]:
        axes = scenario.arm.dimension
        noise, resolution = (
            [force] * axes + [moment] * (1 if axes == 2 else 3)
            for force, moment in (
                (self.noise_force, self.noise_moment),
                (self.resolution_force, self.resolution_moment),
            )
        )
        return part("crinoid.control:BaseWrench"), noise, resolution


class CurrentSensor(SensorTable):
    """Velocity of the water at points fixed to the submarine: a meter, or a profiler (ADCP)."""

    kind: Literal["current"] = entry("current", "Velocity of the water.")
    points: Annotated[
        tuple[Position, ...],
        AsTuple,
        Field(min_length=1, max_length=1000),
        Quantity(
            "m", "a list of points [x, z], one or more", "a list of points [x, y, z], one or more"
        ),
        PER_AXIS,
    ] = Field(description="Points, from the base's set position.")
    noise: MetresPerSecond = entry(0.0, "Standard deviation of the noise.", ge=0)
    resolution: MetresPerSecond = entry(0.0, "Step to which values are rounded; 0: none.", ge=0)

    def build(self, scenario: Any) -> tuple[Any, Any, Any]:
        return part("crinoid.control:WaterVelocity", self.points), self.noise, self.resolution


class InclinationSensor(SensorTable):
    """Angle of the arm above the horizontal at stations along it."""

    kind: Literal["inclination"] = entry("inclination", "Angle above the horizontal.")
    stations: _Stations = Field(description="Distance from the root over the arm's length.")
    noise_deg: Degrees = entry(0.0, "Standard deviation of the noise.", ge=0)
    resolution_deg: Degrees = entry(0.0, "Step to which values are rounded; 0: none.", ge=0)

    def build(self, scenario: Any) -> tuple[Any, Any, Any]:
        errors = math.radians(self.noise_deg), math.radians(self.resolution_deg)
        return part("crinoid.control:Inclination", self.stations), *errors


class ContactSensor(SensorTable):
    """Force of all obstacles on the arm, or on a part of it, along the axes of the world."""

    kind: Literal["contact"] = entry("contact", "Contact force.")
    span: Pair = entry(
        (0.0, 1.0), "Sensitive part of the arm, over its length; an edge of the mesh counts whole."
    )
    noise: Newtons = entry(0.0, "Standard deviation of the noise of each component.", ge=0)
    resolution: Newtons = entry(0.0, "Step to which components are rounded; 0: none.", ge=0)

    def _conflicts(self) -> Iterator[Mistake]:
        yield from span_conflicts("span", self.span)

    def build(self, scenario: Any) -> tuple[Any, Any, Any]:
        within = resolve_name("crinoid.assembly.bodies:edges_within")
        edges = within(self.span, scenario.arm.nodes)
        return part("crinoid.control:ContactForce", edges), self.noise, self.resolution


Sensors = Annotated[
    ShapeSensor | WrenchSensor | CurrentSensor | InclinationSensor | ContactSensor,
    Field(discriminator="kind"),
    KindOf("sensors", SensorTable),
]


def inclination_sensor(sensors: tuple[SensorTable, ...]) -> InclinationSensor | None:
    """Return the first sensor of inclinations, which a hybrid controller uses."""
    return next((each for each in sensors if isinstance(each, InclinationSensor)), None)


def sensor_conflicts(
    sensors: tuple[SensorTable, ...], obstacles: tuple[Obstacle, ...]
) -> Iterator[Mistake]:
    """Yield names that two sensors share, and sensors of contact without an obstacle."""
    for index, sensor in enumerate(sensors):
        if isinstance(sensor, ContactSensor) and not obstacles:
            text = got("contact", "have an obstacle to touch", "Add an [[obstacle]].")
            yield Mistake(f"sensors.{index}.kind", text)
    names = {f"sensors.{index}": sensor.called for index, sensor in enumerate(sensors)}
    yield from name_conflicts(names, {"tip": "the sensor of the tip"})
