"""The vehicle: the submarine that holds the arm, where it floats."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.dimension import Count, InSpace
from crinoid.scenario.errors import Mistake
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import (
    AsTuple,
    Hertz,
    Kilograms,
    Metres,
    Newtons,
    Position,
    Quantity,
    Triple,
)

__all__ = ["Vehicle"]

_AXES = Annotated[tuple[float, ...], AsTuple, Field(min_length=2, max_length=3)]
_TURNS = Count(plane=(1,), space=(1, 3))


def _along(unit: str) -> Quantity:
    return Quantity(unit, "a number of 0 or more, or [x, z]", "a number of 0 or more, or [x, y, z]")


def _about(unit: str, least: str = "of 0 or more") -> Quantity:
    return Quantity(unit, f"a number {least}", f"a number {least}, or three: about x, y, z")


_ALONG = Count(plane=(1, 2), space=(1, 3))


class Vehicle(Model):
    """The submarine as a body that floats: the arm pushes it, and its channels ride on it.

    Without this table the base goes where channels and prescribed motion say, whatever the arm
    does. Its axes are those of the world while it is not turned. It starts at rest.
    """

    mass: Kilograms = Field(gt=0, description="Its mass, without the arm.")
    inertia: Annotated[float | Triple, _about("kg m2", "above 0"), _TURNS] = Field(
        description="Moment of inertia about its centre of mass: in the plane across it, in space "
        "about all axes alike, or one for each."
    )
    offset: Annotated[Position, InSpace((0.0, 0.0, 0.0))] = Field(
        default=(0.0, 0.0),
        description="Its centre of mass, from where it holds the arm at the start.",
    )
    volume: Annotated[float, Quantity("m3")] | None = Field(
        default=None,
        ge=0,
        description="Volume of the water that it displaces; left out, as much as carries it.",
    )
    metacentric_height: Metres = Field(
        default=0.0,
        ge=0,
        description="Height of its centre of buoyancy above its centre of mass, which rights it.",
    )
    added_mass: Annotated[float | _AXES, _along("kg"), _ALONG] = Field(
        default=0.0, description="Mass of the water that moves along with it, along its axes."
    )
    added_inertia: Annotated[float | Triple, _about("kg m2"), _TURNS] = Field(
        default=0.0, description="Inertia of the water that turns along with it."
    )
    drag_area: Annotated[float | _AXES, _along("m2"), _ALONG] = Field(
        default=0.0, description="Area times drag coefficient, along its axes."
    )
    angular_drag: Annotated[float | Triple, _about("N m s2"), _TURNS] = Field(
        default=0.0,
        description="Moment that brakes its turning, over the squared rate.",
    )
    hold: Literal["free", "thrusters"] = Field(
        default="free",
        description="free: nothing holds it; thrusters: they pull it back to where it started, as "
        "it was turned.",
    )
    bandwidth_hz: Hertz = Field(
        default=0.1,
        gt=0,
        description="Natural frequency at which thrusters hold it, critically damped. A vehicle "
        "that is free has no use for it, nor for their limits.",
    )
    max_force: Newtons | None = Field(
        default=None, gt=0, description="Largest thrust along each axis; no limit if left out."
    )
    max_moment: Annotated[float, Quantity("N m")] | None = Field(
        default=None, gt=0, description="Largest moment about each axis; no limit if left out."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        for name in ("inertia", "added_mass", "added_inertia", "drag_area", "angular_drag"):
            value = getattr(self, name)
            least = min(value) if isinstance(value, tuple) else value
            if least < 0 or (least == 0 and name == "inertia"):
                yield self.refused(name)
