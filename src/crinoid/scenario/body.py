"""Rigid bodies: obstacles, the tool at the tip, and the vehicle at the root."""
# ruff: noqa: D102  # the base class documents its methods

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.document import FileName, RecordFile
from crinoid.scenario.errors import Mistake, got
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import (
    PER_AXIS,
    AsTuple,
    Components,
    Count,
    CubicMetres,
    Degrees,
    Hertz,
    InSpace,
    Kilograms,
    Metres,
    NewtonMetres,
    Newtons,
    Pair,
    Position,
    Quantity,
    Seconds,
    SquareMetres,
    Triple,
    Vector,
    direction_conflicts,
    span_conflicts,
    unit_vector,
)

_ENDLESS = 1e3
"""Half the length of a cylinder (m)."""
_STRAIGHT = 1e-9

Direction = Annotated[Triple, Quantity(expects="[x, y, z]")]
Drift = Annotated[
    Literal["flow"] | Components,
    Quantity("m/s", '[x, z] or "flow"', '[x, y, z] or "flow"'),
    PER_AXIS,
    InSpace((0.0, 0.0, 0.0)),
]


class _Obstacle(Model):
    kind: str
    position: Position = Field(description="Position at the start.")
    velocity: Drift = entry(
        (0.0, 0.0), 'Velocity of its drift; "flow": that of the water around it.'
    )
    friction: float = entry(0.0, "Coulomb's coefficient of friction.", ge=0)
    rolling_friction: Metres = entry(
        0.0,
        "Moment against rolling over the force, of a free body and another one; of both the "
        "larger value counts.",
        ge=0,
    )
    spinning_friction: Metres = entry(
        0.0, "Likewise against spinning about the normal of the surface, in space.", ge=0
    )

    @property
    def free(self) -> bool:
        """Whether the arm, the water and its weight move it."""
        return False

    @property
    def half_axis(self) -> tuple[float, ...]:
        """Half of the core that the surface is around (m); of a planar arm, its part in the plane.

        It has the axes of ``position``.
        """
        return (0.0,) * len(self.position)

    @property
    def out(self) -> tuple[float, ...]:
        """Unit normal of a plane; zero for a round body."""
        return (0.0,) * len(self.position)


class _Round(_Obstacle):
    radius: Metres = Field(gt=0, description="Radius.")


class _Long(_Round):
    axis: Direction = entry(
        (0.0, 1.0, 0.0),
        "Direction of its axis, of any length; in space any, with a planar arm y, across its "
        "plane, or in the plane.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        yield from direction_conflicts("axis", self.axis)

    @property
    def oblique(self) -> bool:
        """Whether the axis is neither in the plane of x and z nor normal to it."""
        x, y, z = unit_vector(self.axis)
        return abs(y) > _STRAIGHT and math.hypot(x, z) > _STRAIGHT

    def _half(self, half: float) -> tuple[float, ...]:
        x, y, z = self.axis
        scale = half / math.hypot(x, y, z)
        seen = (x, z) if len(self.position) == 2 else (x, y, z)
        return tuple(scale * component for component in seen)


Moments = Annotated[
    float | Triple,
    Quantity("kg m2", "a number above 0", "a number above 0, or three: about x, y, z"),
    Count(plane=(1,), space=(1, 3)),
]
Spin = Annotated[
    float | Triple,
    Quantity("rad/s", "a number", "[about x, about y, about z]"),
    Count(plane=(1,), space=(3,)),
    InSpace((0.0, 0.0, 0.0)),
]


class _Movable(_Round):
    mass: Annotated[float, Quantity("kg")] | None = entry(None, "Mass of a free body.", gt=0)
    inertia: Moments | None = entry(
        None,
        "Moment of inertia of a free body about its centre, in space one for all axes or one for "
        "each at the start; by default that of a homogeneous solid.",
    )
    spin: Spin = entry(
        0.0, "Angular velocity of a free body at the start, in the plane from x toward z."
    )
    metacentric_height: Metres = entry(
        0.0,
        "Height of a free body's centre of buoyancy above its centre of mass, at the start: one "
        "with a heavy bottom rights itself.",
        ge=0,
    )

    @property
    def free(self) -> bool:
        return self.mass is not None

    @property
    def volume(self) -> float:
        """Volume (m3)."""
        return 4 / 3 * math.pi * self.radius**3

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        turning = any(self.spin) if isinstance(self.spin, tuple) else self.spin
        given = {
            "inertia": self.inertia is not None,
            "spin": turning,
            "metacentric_height": self.metacentric_height,
        }
        for name, there in given.items():
            if self.mass is None and there:
                yield self.mistake(name, "be left out without a mass", "Set mass to free the body.")
        moments = self.inertia if isinstance(self.inertia, tuple) else (self.inertia,)
        if any(each is not None and each <= 0 for each in moments):
            yield self.mistake("inertia")
        elif len(moments) == 3 and max(moments) > 0.5 * (1 + _STRAIGHT) * sum(moments):
            yield self.mistake("inertia", "have no moment above the sum of the other two")


class Sphere(_Movable):
    """A ball; one with a mass is free.

    The arm, other obstacles, the water and its weight move and turn a free body. It has the
    buoyancy, drag and added mass of its shape; one that neither sinks nor rises has the mass
    ``water.density * volume``. Without a mass it moves at its velocity through any contact.
    """

    kind: Literal["sphere"] = entry("sphere", "A ball.")


class Cylinder(_Long):
    """A pole, pipe or cable without an end."""

    kind: Literal["cylinder"] = entry("cylinder", "A pole without an end.")

    @property
    def half_axis(self) -> tuple[float, ...]:
        return self._half(_ENDLESS)


class Capsule(_Movable, _Long):
    """A rod with round ends, its middle at ``position``; one with a mass is free, as a sphere."""

    kind: Literal["capsule"] = entry("capsule", "A rod with round ends.")
    length: Metres = Field(gt=0, description="Distance of the middles of its ends.")

    @property
    def volume(self) -> float:
        return super().volume + math.pi * self.radius**2 * self.length

    @property
    def half_axis(self) -> tuple[float, ...]:
        return self._half(self.length / 2)


class Plane(_Obstacle):
    """A wall, or the bed: everything behind a plane is solid."""

    kind: Literal["plane"] = entry("plane", "A wall; solid behind.")
    normal: Vector = Field(description="Direction out of the wall, of any length.")

    def _conflicts(self) -> Iterator[Mistake]:
        yield from direction_conflicts("normal", self.normal)

    @property
    def out(self) -> tuple[float, ...]:
        return unit_vector(self.normal)


class Mesh(_Obstacle):
    """A solid of any shape, as a closed mesh of triangles in a file.

    Signed distances from its surface, sampled once on a grid, are interpolated by cubic splines.
    Features finer than the grid are rounded; a note says by how much. Where an edge of the arm
    touches it at several places, the nearest one counts. It has no mass: it moves at its velocity
    through any contact. A planar arm meets its cut at y = 0.
    """

    kind: Literal["mesh"] = entry("mesh", "A solid from a mesh.")
    file: Annotated[FileName, Quantity(expects="the path of an STL, OBJ, PLY or GLB file")] = Field(
        description="STL, OBJ, PLY, GLB or another file that the library trimesh reads. Axes are "
        "those of the world, z up; y is up in GLB and glTF files. Paths are as in [[flow]]."
    )
    position: Position = Field(description="Place of the origin of its axes at the start.")
    scale: float = entry(1.0, "Length of its unit in m; 0.001 for a file in mm.", gt=0)
    pan_deg: Degrees = entry(0.0, "Turn of the mesh from x towards y, after tilt and roll.")
    tilt_deg: Degrees = entry(0.0, "Turn from x towards z, after roll.")
    roll_deg: Degrees = entry(0.0, "Turn from y towards z.")
    spacing: Metres | None = entry(
        None,
        "Spacing of the grid of distances; by default half of the arm's smallest radius, or more "
        "for a large mesh.",
        gt=0,
    )


class Seabed(_Obstacle):
    """A bed as heights in a file; all below is solid.

    A cubic spline is the surface between the heights. Outside of them the height is that of the
    nearest edge. Surface waves count with ``water.depth`` still. A planar arm meets the profile at
    y = 0, of heights over x and y or over x alone.
    """

    kind: Literal["seabed"] = entry("seabed", "A bed from heights.")
    file: RecordFile
    height: str = Field(
        min_length=1,
        description="Variable of heights over x and y, or its CF standard name; depths count down.",
    )
    x: str = entry("x", "Coordinate forward, in m, at even steps.", min_length=1)
    y: str = entry("y", "Coordinate to port, in m, at even steps.", min_length=1)
    position: Annotated[Position, InSpace((0.0, 0.0, 0.0))] = entry(
        (0.0, 0.0), "Place of the origin of the file's axes."
    )


Obstacle = Annotated[
    Sphere | Cylinder | Capsule | Plane | Mesh | Seabed, Field(discriminator="kind")
]


_TIP = (0.9, 1.0)
"""Part of the arm that counts as its tip."""

Index = Annotated[int, Quantity(expects="the index of an obstacle, 0 for the first")]

Inertia = Annotated[
    float | Triple,
    Quantity(
        "kg m2", "a number of 0 or more", "a number of 0 or more, or three: about t, m_1 and m_2"
    ),
    Count(plane=(1,), space=(1, 3)),
]


class Tool(Model):
    """A rigid body at the tip: a gripper, a camera, a sample.

    It is fixed to the last edge and turns with it. With a radius it touches obstacles.
    """

    mass: Kilograms = Field(gt=0, description="Its mass.")
    volume: CubicMetres = entry(0.0, "Volume of displaced water.", ge=0)
    drag_area: SquareMetres = entry(0.0, "Its area times its drag coefficient.", ge=0)
    added_mass: Kilograms = entry(0.0, "Mass of the water that moves with it.", ge=0)
    inertia: Inertia = entry(
        0.0,
        "Moment of inertia about its centre of mass, across the plane; in space also three: "
        "about the arm's direction t and its directors m_1 and m_2.",
    )
    offset: Metres = entry(0.0, "Distance of its centre of mass beyond the tip.", ge=0)
    radius: Metres | None = entry(
        None,
        "Radius of a ball about its centre of mass, by which it touches obstacles and is drawn; "
        "it touches nothing by default.",
        gt=0,
    )
    from_: Seconds = entry(
        0.0, "Time when the tip picks it up; it moves like the tip then.", ge=0, alias="from"
    )
    until: Seconds | None = entry(None, "Time when the tip drops it; never by default.", gt=0)
    take_at_touch: Index | None = entry(
        None,
        "Obstacle, from 0, at whose first touch at or after from the tip picks it up; before, "
        "the arm has no tool.",
        ge=0,
    )
    drop_at_touch: Index | None = entry(
        None, "Obstacle at whose touch the tip drops it, before until.", ge=0
    )
    touch_span: Pair | None = entry(
        None,
        "Part of the arm whose touches count, over its length; by default its last tenth. An "
        "edge of the mesh counts whole.",
    )

    @property
    def touches(self) -> bool:
        """Whether touches attach or detach it."""
        return self.take_at_touch is not None or self.drop_at_touch is not None

    @property
    def touched(self) -> tuple[float, float]:
        """The part of the arm whose touches count, over its length."""
        return self.touch_span or _TIP

    def _conflicts(self) -> Iterator[Mistake]:
        moments = self.inertia if isinstance(self.inertia, tuple) else (self.inertia,)
        if min(moments) < 0:
            yield self.mistake("inertia")
        if self.until is not None and self.until <= self.from_:
            yield self.mistake("until", f"be after from = {self.from_} (s)")
        if self.radius and (self.from_ or self.until is not None or self.touches):
            hint = "A tool that touches is held all the time."
            yield self.mistake("radius", "be left out with from, until and touches", hint)
        if self.take_at_touch is not None and self.take_at_touch == self.drop_at_touch:
            hint = "The arm still touches that obstacle when it has the tool."
            yield self.mistake("drop_at_touch", "differ from take_at_touch", hint)
        if self.touch_span is not None:
            yield from span_conflicts("touch_span", self.touch_span)
            if not self.touches:
                hint = "Set take_at_touch or drop_at_touch to use it."
                yield self.mistake("touch_span", "be left out without touches", hint)


def tool_conflicts(tool: Tool | None, obstacles: int) -> Iterator[Mistake]:
    """Yield touches of obstacles that do not exist, from the number of obstacles."""
    for name in ("take_at_touch", "drop_at_touch"):
        index = getattr(tool, name, None)
        if index is not None and index >= obstacles:
            must = f"be at most {obstacles - 1}, the index of the last [[obstacle]]"
            must = must if obstacles else "be left out without an [[obstacle]]"
            yield Mistake(f"tool.{name}", got(index, must))


_AXES = Annotated[tuple[float, ...], AsTuple, Field(min_length=2, max_length=3)]
_TURNS = Count(plane=(1,), space=(1, 3))


def _along(unit: str) -> Quantity:
    return Quantity(unit, "a number of 0 or more, or [x, z]", "a number of 0 or more, or [x, y, z]")


def _about(unit: str, least: str = "of 0 or more") -> Quantity:
    return Quantity(unit, f"a number {least}", f"a number {least}, or three: about x, y, z")


_BY_AXIS = (
    "added_mass", "added_inertia", "drag_area", "angular_drag", "linear_drag", "angular_linear_drag"
)  # fmt: skip
"""Keys of a vehicle with a value of 0 or more for each axis."""
_ALONG = Count(plane=(1, 2), space=(1, 3))


class Hull(Model):
    """The vehicle's hull: a capsule that the arm can touch.

    Its nose is at the arm's root, and it extends from there against the arm's direction there, both
    while all channels are at zero.
    """

    length: Metres = Field(gt=0, description="From end to end.")
    diameter: Metres = Field(gt=0, description="Diameter, at most the length.")

    def _conflicts(self) -> Iterator[Mistake]:
        if self.length < self.diameter:
            must = f"be at least diameter = {self.diameter} (m), which is a sphere"
            yield self.mistake("length", must)


class Vehicle(Model):
    """The submarine as a floating body that the arm pushes; the channels move relative to it.

    Without mass and inertia it does not float: channels and prescribed motion alone set the pose of
    the base, as without this table, and the hull follows the base. The axes of a floating one are
    those of the world while it is not turned. It starts at rest.
    """

    mass: Kilograms | None = entry(None, "Its mass, without the arm; without it only hull.", gt=0)
    inertia: Annotated[float | Triple, _about("kg m2", "above 0"), _TURNS] | None = entry(
        None,
        "Moment of inertia about its centre of mass: in the plane across it, in space one for all "
        "axes or one for each. Belongs to mass.",
    )
    hull: Hull | None = entry(None, "The hull that the arm can touch.")
    offset: Annotated[Position, InSpace((0.0, 0.0, 0.0))] = entry(
        (0.0, 0.0), "Centre of mass, from the arm's root at the start."
    )
    volume: CubicMetres | None = entry(
        None, "Volume of displaced water; by default neutrally buoyant.", ge=0
    )
    metacentric_height: Metres = entry(
        0.0, "Height of its centre of buoyancy above its centre of mass.", ge=0
    )
    added_mass: Annotated[float | _AXES, _along("kg"), _ALONG] = entry(
        0.0, "Mass of the water that moves with it, along its axes."
    )
    added_inertia: Annotated[float | Triple, _about("kg m2"), _TURNS] = entry(
        0.0, "Inertia of the water that turns with it."
    )
    drag_area: Annotated[float | _AXES, _along("m2"), _ALONG] = entry(
        0.0, "Area times drag coefficient, along its axes."
    )
    angular_drag: Annotated[float | Triple, _about("N m s2"), _TURNS] = entry(
        0.0, "Moment of drag over the squared rate of turn."
    )
    linear_drag: Annotated[float | _AXES, _along("N s/m"), _ALONG] = entry(
        0.0, "Drag in proportion to the speed through the water, along its axes."
    )
    angular_linear_drag: Annotated[float | Triple, _about("N m s"), _TURNS] = entry(
        0.0, "Moment of drag in proportion to the rate of turn."
    )
    hold: Literal["free", "thrusters"] = entry(
        "free", "free: no force; thrusters: forces and moments back to the initial pose."
    )
    bandwidth_hz: Hertz = entry(
        0.1,
        "Natural frequency of the hold by thrusters, critically damped; not used, like their "
        "limits, by a free vehicle.",
        gt=0,
    )
    max_force: Newtons | None = entry(
        None, "Largest thrust along each axis; unlimited by default.", gt=0
    )
    max_moment: NewtonMetres | None = entry(
        None, "Largest moment about each axis; unlimited by default.", gt=0
    )

    @property
    def floats(self) -> bool:
        """Whether it is a free body; else it is a hull on the base."""
        return self.mass is not None

    def _conflicts(self) -> Iterator[Mistake]:
        if self.mass is None and self.inertia is None and self.hull is not None:
            hint = "A hull alone follows the base. Add mass and inertia to let it float."
            for name, field in type(self).model_fields.items():
                value = getattr(self, name)
                # the default of a place has as many zeros as the arm has dimensions
                given = any(value) if name == "offset" else value != field.default
                if given and name != "hull":
                    yield self.mistake(name, "be left out without mass", hint)
            return
        for name in ("mass", "inertia"):
            if getattr(self, name) is None:
                yield self.mistake(name)
        for name in (*_BY_AXIS, "inertia"):
            value = getattr(self, name)
            least = min(value) if isinstance(value, tuple) else value
            if least is not None and (least < 0 or (least == 0 and name == "inertia")):
                yield self.mistake(name)
