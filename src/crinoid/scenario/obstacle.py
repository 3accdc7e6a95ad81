"""Obstacles: rigid bodies that the arm meets.

A new kind is one class here and one entry in `Obstacle`.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.dimension import InSpace
from crinoid.scenario.errors import Mistake
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import (
    PER_AXIS,
    Components,
    Metres,
    Position,
    Quantity,
    Triple,
    Vector,
    direction_conflicts,
    unit_vector,
)

__all__ = ["Capsule", "Cylinder", "Obstacle", "Plane", "Sphere"]

_ENDLESS = 1e3
"""Half the length of a cylinder (m)."""
_STRAIGHT = 1e-9

Direction = Annotated[Triple, Quantity(takes="[x, y, z]")]
Drift = Annotated[
    Literal["flow"] | Components,
    Quantity("m/s", '[x, z] or "flow"', '[x, y, z] or "flow"'),
    PER_AXIS,
    InSpace((0.0, 0.0, 0.0)),
]


class _Obstacle(Model):
    kind: str
    position: Position = Field(description="Where it is at the start.")
    velocity: Drift = Field(
        default=(0.0, 0.0), description='How it drifts; "flow": as the water does where it is.'
    )
    friction: float = Field(default=0.0, ge=0, description="Coulomb's coefficient of friction.")

    @property
    def half_axis(self) -> tuple[float, ...]:
        """Half of the core that the surface is around (m); of a planar arm, what is in its plane.

        It has the axes of ``position``.
        """
        return (0.0,) * len(self.position)

    @property
    def out(self) -> tuple[float, ...]:
        """Normal of a plane, of length one; zero for what is round."""
        return (0.0,) * len(self.position)


class _Round(_Obstacle):
    radius: Metres = Field(gt=0, description="Radius.")


class _Long(_Round):
    axis: Direction = Field(
        default=(0.0, 1.0, 0.0),
        description="Direction of its axis, its length is ignored; in space any, with a planar arm "
        "y, across its plane, or a direction in it.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        yield from direction_conflicts("axis", self.axis)

    @property
    def oblique(self) -> bool:
        """Whether the axis neither lies in the plane of x and z nor stands across it."""
        x, y, z = unit_vector(self.axis)
        return abs(y) > _STRAIGHT and math.hypot(x, z) > _STRAIGHT

    def _half(self, half: float) -> tuple[float, ...]:
        x, y, z = self.axis
        scale = half / math.hypot(x, y, z)
        seen = (x, z) if len(self.position) == 2 else (x, y, z)
        return tuple(scale * component for component in seen)


class Sphere(_Round):
    """A ball; with a mass the arm can push it away.

    A free sphere has inertia, weight, buoyancy and the drag and added mass of a sphere in the
    water; one that neither sinks nor rises has the mass ``water.density * 4/3 pi radius**3``.
    Without a mass it moves at its velocity whatever it meets. Spheres do not spin, nor touch one
    another.
    """

    kind: Literal["sphere"] = Field(default="sphere", description="A ball.")
    mass: Annotated[float, Quantity("kg")] | None = Field(
        default=None, gt=0, description="Its mass, if it is free to be pushed."
    )


class Cylinder(_Long):
    """A pole, pipe or cable without an end."""

    kind: Literal["cylinder"] = Field(default="cylinder", description="A pole without an end.")

    @property
    def half_axis(self) -> tuple[float, ...]:
        """Half of the core that the surface is around (m)."""
        return self._half(_ENDLESS)


class Capsule(_Long):
    """A rod with round ends, its middle at ``position``."""

    kind: Literal["capsule"] = Field(default="capsule", description="A rod with round ends.")
    length: Metres = Field(gt=0, description="Distance of the middles of its ends.")

    @property
    def half_axis(self) -> tuple[float, ...]:
        """Half of the core that the surface is around (m)."""
        return self._half(self.length / 2)


class Plane(_Obstacle):
    """A wall, or the bed: everything behind a plane is solid."""

    kind: Literal["plane"] = Field(default="plane", description="A wall; solid behind.")
    normal: Vector = Field(description="Out of the wall, its length is ignored.")

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        yield from direction_conflicts("normal", self.normal)

    @property
    def out(self) -> tuple[float, ...]:
        """Normal of the plane, of length one."""
        return unit_vector(self.normal)


Obstacle = Annotated[Sphere | Cylinder | Capsule | Plane, Field(discriminator="kind")]
