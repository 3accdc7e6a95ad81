"""The vehicle at the root of the arm, and its hull."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import (
    AsTuple,
    Count,
    CubicMetres,
    Hertz,
    InSpace,
    Kilograms,
    Metres,
    NewtonMetres,
    Newtons,
    Position,
    Quantity,
    Triple,
)

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
