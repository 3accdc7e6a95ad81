"""Obstacles: rigid bodies that the arm meets.

A new kind is one class here and one entry in `Obstacle`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import AsTuple, Metres, Pair, Position, Quantity, Vector

__all__ = ["Capsule", "Cylinder", "Obstacle", "Plane", "Sphere"]

_ENDLESS = 1e3
"""Half the length of a cylinder (m)."""
_STRAIGHT = 1e-9

Triple = Annotated[tuple[float, float, float], AsTuple]
Direction = Annotated[Triple, Quantity(takes="[x, y, z]")]
Drift = Annotated[Literal["flow"] | Pair, Quantity("m/s", '[x, z] or "flow"')]


class _Obstacle(Model):
    kind: str
    position: Position = Field(description="Where it is at the start.")
    velocity: Drift = Field(
        default=(0.0, 0.0), description='How it drifts; "flow": as the water does where it is.'
    )
    friction: float = Field(default=0.0, ge=0, description="Coulomb's coefficient of friction.")

    @property
    def half_axis(self) -> tuple[float, float]:
        """Half of the core that the surface is around, in the plane of the arm (m)."""
        return (0.0, 0.0)

    @property
    def out(self) -> tuple[float, float]:
        """Normal of a plane, of length one; zero for what is round."""
        return (0.0, 0.0)


class _Round(_Obstacle):
    radius: Metres = Field(gt=0, description="Radius.")


class _Long(_Round):
    axis: Direction = Field(
        default=(0.0, 1.0, 0.0),
        description="Direction of its axis, its length is ignored; a planar arm takes y, across "
        "its plane, or a direction in it.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        x, y, z = self.axis
        length = math.hypot(x, y, z)
        if length == 0:
            text = f"got {shown(self.axis)}, takes a vector that is not 0"
            yield Mistake("axis", text)
        elif abs(y) > _STRAIGHT * length and math.hypot(x, z) > _STRAIGHT * length:
            text = f"got {shown(self.axis)}, takes [0, 1, 0] or a vector with y = 0: oblique to "
            yield Mistake("axis", f"{text}the arm's plane its cut would be an ellipse")

    def _half(self, half: float) -> tuple[float, float]:
        x, y, z = self.axis
        scale = half / math.hypot(x, y, z)
        return (scale * x, scale * z)


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
    def half_axis(self) -> tuple[float, float]:
        """Half of the core that the surface is around, in the plane of the arm (m)."""
        return self._half(_ENDLESS)


class Capsule(_Long):
    """A rod with round ends, its middle at ``position``."""

    kind: Literal["capsule"] = Field(default="capsule", description="A rod with round ends.")
    length: Metres = Field(gt=0, description="Distance of the middles of its ends.")

    @property
    def half_axis(self) -> tuple[float, float]:
        """Half of the core that the surface is around, in the plane of the arm (m)."""
        return self._half(self.length / 2)


class Plane(_Obstacle):
    """A wall, or the bed: everything behind a plane is solid."""

    kind: Literal["plane"] = Field(default="plane", description="A wall; solid behind.")
    normal: Vector = Field(description="Out of the wall, its length is ignored.")

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        if math.hypot(*self.normal) == 0:
            yield Mistake("normal", f"got {shown(self.normal)}, takes a vector that is not 0")

    @property
    def out(self) -> tuple[float, float]:
        """Normal of the plane, of length one."""
        x, z = self.normal
        return (x / math.hypot(x, z), z / math.hypot(x, z))


Obstacle = Annotated[Sphere | Cylinder | Capsule | Plane, Field(discriminator="kind")]
