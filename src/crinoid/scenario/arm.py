"""The arm: its shape at rest and what it is made of."""

from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.dimension import Count, Only
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import (
    AsTuple,
    Metres,
    Newtons,
    Quantity,
    Seconds,
    SquareMetres,
    Triple,
)

__all__ = ["Arm", "Section"]

# The one place that says which arms there are.
Dimension = Annotated[
    Literal[2, 3], Quantity(takes="2 (a planar arm) or 3 (an arm that bends both ways and twists)")
]

_Above0 = Annotated[float, Field(gt=0)]
Radius = Annotated[
    _Above0 | Annotated[tuple[_Above0, _Above0], AsTuple],
    Quantity("m", "a number above 0, or [root, tip], both above 0"),
]
Bending = Annotated[
    _Above0 | Annotated[tuple[_Above0, _Above0], AsTuple] | None,
    Quantity("N m2", "a number above 0", "a number above 0, or [EI_1, EI_2], both above 0"),
    Count(plane=(1,), space=(1, 2)),
]
RestCurvature = Annotated[
    float | Triple,
    Quantity("1/m", "a number", "a number or [kappa_1, kappa_2, twist], twist in rad/m"),
    Count(plane=(1,), space=(1, 3)),
]
Nodes = Annotated[
    int,
    Field(ge=3, le=10_000),
    Quantity(takes="a whole number from 3 (an arm bends where edges meet) to 10000"),
]


class Section(Model):
    """Section properties that replace what radius, density and modulus would give."""

    EA: Newtons | None = Field(default=None, gt=0, description="Axial stiffness.")
    EI: Bending = Field(
        default=None,
        description="Bending stiffness; in space one for both ways, or those toward m_1 and m_2.",
    )
    GJ: Annotated[
        Annotated[float, Quantity("N m2")] | None, Only(3, "but only a spatial arm twists")
    ] = Field(default=None, gt=0, description="Twisting stiffness.")
    mass_per_length: Annotated[float, Quantity("kg/m")] | None = Field(
        default=None, gt=0, description="Mass of a metre of arm, without the water it moves."
    )
    diameter: Metres | None = Field(
        default=None, ge=0, description="Diameter that water and obstacles see."
    )
    displaced_area: SquareMetres | None = Field(
        default=None,
        ge=0,
        description="Section area that displaces water: buoyancy and added mass.",
    )


class Arm(Model):
    """The arm at rest, a round elastic rod."""

    dimension: Dimension = Field(
        default=2, description="2: the arm moves in the plane of x and z; 3: in space."
    )
    length: Metres = Field(default=0.5, gt=0, description="Length at rest.")
    nodes: Nodes = Field(default=21, description="Number of nodes, evenly spaced along the arm.")
    radius: Radius = Field(
        default=0.02,
        description="Radius of the section; a pair gives a linear taper from root to tip.",
    )
    density: Annotated[float, Quantity("kg/m3")] = Field(
        default=1080.0, gt=0, description="Density of the material."
    )
    youngs_modulus: Annotated[float, Quantity("Pa")] = Field(
        default=1.0e5, gt=0, description="Young's modulus of the material."
    )
    poisson_ratio: float = Field(
        default=0.5,
        ge=0,
        le=0.5,
        description="Poisson's ratio nu: the shear modulus, which resists twist in space, is "
        "youngs_modulus / (2 (1 + nu)); a planar arm does not feel it.",
    )
    damping_time: Seconds = Field(
        default=0.02, ge=0, description="Kelvin-Voigt damping: viscosity over modulus."
    )
    rest_curvature: RestCurvature = Field(
        default=0.0,
        description="Curvature at rest; positive curls the way tilt turns (in space kappa_2).",
    )
    section: Section = Field(
        default=Section(),
        description="Section properties given directly; each replaces a derived one.",
    )

    @property
    def diameters(self) -> tuple[float, ...]:
        """Diameter that the water sees at each node (m)."""
        if self.section.diameter is not None:
            return (self.section.diameter,) * self.nodes
        root, tip = self.radius if isinstance(self.radius, tuple) else (self.radius, self.radius)
        return tuple(2 * (root + (tip - root) * i / (self.nodes - 1)) for i in range(self.nodes))
