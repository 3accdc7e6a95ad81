"""Flows of the water, which add up.

A new kind is one class here and one entry in `Flow`; or a table of an installed package
(`crinoid.scenario.kinds`).
"""
# ruff: noqa: D102  # the base class documents its methods

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pkgutil import resolve_name
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, Field

from crinoid.scenario.document import RecordFile
from crinoid.scenario.errors import Mistake, missing
from crinoid.scenario.flow_table import FlowTable
from crinoid.scenario.kinds import KindOf, part
from crinoid.scenario.model import entry
from crinoid.scenario.quantity import (
    AsTuple,
    Degrees,
    Hertz,
    InSpace,
    Metres,
    MetresPerSecond,
    Quantity,
    Seconds,
    Velocity,
)
from crinoid.scenario.random_flow import GaussMarkovFlow, TurbulenceFlow
from crinoid.scenario.ship_wake import ShipWakeFlow
from crinoid.scenario.waves import RegularWaveFlow, WavesFlow

_COMPONENT = re.compile(r"(-?)\s*([^\[\]]*[^\[\]\s])\s*(?:\[([^\[\]]+)\])?")


class Component(NamedTuple):
    """Place of a component of the velocity in a file."""

    name: str
    """Name or CF standard name of a variable."""
    entry: str
    """Label of an entry of its labelled dimension; empty for none."""
    sign: float

    @staticmethod
    def of(text: str) -> Component | None:
        """Read ``u``, ``-u`` or ``vel[E]``; None for ``0``, a component of zero."""
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
    Quantity(expects='the name of a variable, such as "u", "-u", "vel[E]", or "0" for none'),
]


_DEFAULT_VELOCITY = (("u", "w"), ("u", "v", "w"))
"""Names of the components in the plane and in space."""


class MeasuredFlow(FlowTable):
    """A measured current, from a CSV or netCDF file.

    A record at one point drifts past the arm with its mean velocity; a profile (`vertical`) is the
    same at all points of a height. With `phase_speed` either is delayed along x.
    """

    kind: Literal["measured"] = entry("measured", "A measured current.")
    file: RecordFile
    velocity: Annotated[
        tuple[Name, ...],
        AsTuple,
        Quantity(expects="a list of names"),
        InSpace(_DEFAULT_VELOCITY[1]),
    ] = entry(
        _DEFAULT_VELOCITY[0],
        "Variables, by name or CF standard name: along x and z, in space x, y and z; with "
        'heading_deg east, north and up. "-u" reverses one, "vel[E]" is an entry of a labelled '
        'dimension, "0" is zero.',
    )
    speed: str | None = entry(
        None, "Variable of the speed, with `direction` in place of `velocity`.", min_length=1
    )
    direction: str | None = entry(
        None, "Variable of the compass direction of the flow, clockwise from north.", min_length=1
    )
    direction_is: Literal["to", "from"] | None = entry(
        None, "Whether the water flows to it or from it; by default by its standard name, else to."
    )
    time: str = entry("time", "Variable of the time.", min_length=1)
    vertical: str | None = entry(
        None,
        'Variable of the levels of a profile, upward from z = origin; downward with "-range", or'
        " for a depth by its attributes or its name.",
        min_length=1,
    )
    origin: Metres | None = entry(
        None,
        "Height z from which levels count; by default the bed, for a depth or an elevation the "
        "surface.",
    )
    heading_deg: Degrees | None = entry(
        None, "Compass heading of x, clockwise from north; velocity then names east, north and up."
    )
    select: Annotated[
        dict[str, float], Quantity(expects="a table of numbers, such as {lat = 48.1}")
    ] = entry(
        {},
        "Place in the other dimensions, such as {lat = 48.1}: the nearest point; without "
        "coordinates the index, from 0.",
    )
    skip: Seconds = entry(
        0.0,
        "Time of the record at which the run starts; later if the drift past the arm needs it.",
        ge=0,
    )
    velocity_scale: float = entry(1.0, "Velocity in the run over that in the record.", gt=0)
    time_scale: float = entry(1.0, "Duration of a second of the record in the run.", gt=0)
    low_pass_hz: Hertz | None = entry(
        None,
        "Cut-off of a low-pass filter without delay (Butterworth), in the record's time.",
        gt=0,
    )
    phase_speed: MetresPerSecond | None = entry(
        None,
        "Speed along x at which the record travels in the run; negative: toward -x. By default a "
        "point's drifts with its mean velocity, and a profile is the same along x.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if (self.speed is None) != (self.direction is None):
            lacking = "direction" if self.direction is None else "speed"
            yield Mistake(lacking, missing("name a variable: a speed needs a direction"))
        if self.speed is not None:
            if self.velocity not in _DEFAULT_VELOCITY:
                hint = "Speed and direction are the velocity."
                yield self.mistake("velocity", "be left out with speed", hint)
            if self.heading_deg is None:
                hint = "90 for x toward the east."
                yield Mistake("heading_deg", missing("be the compass heading of x (deg)", hint))
        elif self.direction_is is not None:
            yield self.mistake("direction_is", "be left out without direction")
        elif all(component is None for component in self.components):
            yield self.mistake("velocity", "have the name of at least one variable")
        if self.phase_speed == 0:
            hint = "Leave it out for water that moves as one in a profile."
            yield self.mistake("phase_speed", "be a speed other than 0 (m/s)", hint)
        if self.origin is not None and self.vertical is None:
            hint = "Set vertical, the levels of a profile, to use it."
            yield self.mistake("origin", "be left out without vertical", hint)

    def build(self, scenario: Any, generator: Any, recording: Any) -> Any:  # type: ignore[override]
        """Return the `crinoid.Flow` of a recording that was read from the file."""
        played = resolve_name("crinoid.assembly.arrays:measured")
        return played(self.onset, recording, scenario)

    @property
    def components(self) -> tuple[Component | None, ...]:
        """Places of the components of the velocity; None for a component of zero.

        Without components it is given by speed and direction.
        """
        return () if self.speed is not None else tuple(Component.of(text) for text in self.velocity)


class UniformFlow(FlowTable):
    """The same velocity everywhere."""

    kind: Literal["uniform"] = entry("uniform", "The same velocity everywhere.")
    velocity: Velocity = Field(description="Velocity: where the water moves to.")

    @property
    def uniform_mean(self) -> tuple[float, ...]:
        return self.velocity

    def build(self, scenario: Any, generator: Any) -> Any:
        return part("crinoid.flow:Uniform", self.onset, self.velocity)


class ShearFlow(FlowTable):
    """A current that slows down towards the bed.

    At a height ``h`` above the bed, with ``h_ref = water.depth - reference_depth``, it is
    ``velocity * (h / h_ref)**exponent``, or with a roughness length ``z0``
    ``velocity * ln(h / z0) / ln(h_ref / z0)``.
    """

    kind: Literal["shear"] = entry("shear", "A current that slows towards the bed.")
    velocity: Velocity = Field(description="Velocity at the reference depth.")
    reference_depth: Metres = Field(ge=0, description="Depth below the surface of that velocity.")
    exponent: float | None = entry(None, "Exponent of the power law; 0.142857 by default.", ge=0)
    roughness_length: Metres | None = entry(
        None, "Roughness of the bed, for a logarithmic profile.", gt=0
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if self.exponent is not None and self.roughness_length is not None:
            yield self.mistake("exponent", "be left out with roughness_length")

    @property
    def power_exponent(self) -> float | None:
        """The exponent of the power law; None if the profile is logarithmic."""
        if self.roughness_length is not None:
            return None
        return 0.142857 if self.exponent is None else self.exponent

    def build(self, scenario: Any, generator: Any) -> Any:
        depth = scenario.water.depth
        profile = self.onset, self.velocity, depth - self.reference_depth, -depth
        if self.power_exponent is None:
            return part("crinoid.flow:LogarithmicShear", *profile, self.roughness_length)
        return part("crinoid.flow:PowerShear", *profile, self.power_exponent)


class GustFlow(FlowTable):
    """One gust that rises and falls: ``velocity * (1 - cos(2 pi (t - start) / duration)) / 2``."""

    kind: Literal["gust"] = entry("gust", "One gust that rises and falls.")
    velocity: Velocity = Field(description="Velocity at the peak.")
    duration: Seconds = Field(gt=0, description="Duration, from start.")

    def build(self, scenario: Any, generator: Any) -> Any:
        panels = resolve_name("crinoid.flow.flow:panels_of")(self.ramp_time, self.duration)
        return part("crinoid.flow:Gust", self.onset, self.velocity, self.duration, panels=panels)


class SineFlow(FlowTable):
    """A velocity that swings: ``amplitude * sin(2 pi frequency_hz t + phase)``."""

    kind: Literal["sine"] = entry("sine", "A velocity that swings.")
    amplitude: Velocity = Field(description="Velocity at the peak.")
    frequency_hz: Hertz = Field(gt=0, description="Frequency.")
    phase_deg: Degrees = entry(0.0, "Phase at t = 0.")

    def build(self, scenario: Any, generator: Any) -> Any:
        numbers = self.amplitude, self.frequency_hz, math.radians(self.phase_deg)
        return part("crinoid.flow:Sine", self.onset, *numbers)


Flow = Annotated[
    UniformFlow
    | ShearFlow
    | GustFlow
    | SineFlow
    | GaussMarkovFlow
    | TurbulenceFlow
    | WavesFlow
    | RegularWaveFlow
    | ShipWakeFlow
    | MeasuredFlow,
    Field(discriminator="kind"),
    KindOf("flows", FlowTable),
]
