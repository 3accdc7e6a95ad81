"""The water: what it weighs, and how it drags on the arm."""

from typing import Annotated

from pydantic import Field

from crinoid.scenario.model import Model
from crinoid.scenario.quantity import Metres, Quantity

__all__ = ["Water"]


class Water(Model):
    """The water around the arm, and gravity."""

    density: Annotated[float, Quantity("kg/m3")] = Field(
        default=1025.0, ge=0, description="Density; 0: no water."
    )
    # sea water (3.5 % salt) at 14 to 15 degrees C: ITTC procedure 7.5-02-01-03 (2011)
    kinematic_viscosity: Annotated[float, Quantity("m2/s")] = Field(
        default=1.2e-6,
        gt=0,
        description="Kinematic viscosity: Reynolds numbers in the result; no force depends on it.",
    )
    drag_normal: float = Field(default=1.1, ge=0, description="Drag coefficient across the arm.")
    drag_tangential: float = Field(
        default=0.01, ge=0, description="Drag coefficient along the arm."
    )
    added_mass_normal: float = Field(
        default=1.0,
        ge=0,
        description="Added mass across the arm, as a share of the water displaced.",
    )
    added_mass_tangential: float = Field(
        default=0.0,
        ge=0,
        description="Added mass along the arm, as a share of the water displaced.",
    )
    linear_drag: Annotated[float, Quantity("N s/m2")] = Field(
        default=0.0, ge=0, description="Drag in proportion to the speed, for a metre of arm."
    )
    gravity: Annotated[float, Quantity("m/s2")] = Field(
        default=9.81, ge=0, description="Gravity; 0: none, or a planar arm seen from above."
    )
    depth: Metres | None = Field(
        default=None,
        gt=0,
        description="Depth of the water: the bed is at z = -depth, the surface at 0.",
    )
