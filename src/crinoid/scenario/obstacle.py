"""Obstacles: rigid bodies that the arm can touch."""
# ruff: noqa: D102  # the base class documents its methods

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.document import FileName, RecordFile
from crinoid.scenario.errors import Mistake
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import (
    PER_AXIS,
    Components,
    Count,
    Degrees,
    InSpace,
    Metres,
    Position,
    Quantity,
    Triple,
    Vector,
    direction_conflicts,
    unit_vector,
)

ENDLESS = 1e3  # half the length of a cylinder (m)
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
        x, y, z = unit_vector(self.axis)
        seen = (x, z) if len(self.position) == 2 else (x, y, z)
        return tuple(half * component for component in seen)


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
        return self._half(ENDLESS)


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
