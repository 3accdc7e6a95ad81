"""The arm: its shape at rest, material and section."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from crinoid.scenario.errors import Mistake, got, missing
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import (
    AsTuple,
    Count,
    Follows,
    ListOf,
    Metres,
    Only,
    Pascals,
    Quantity,
    Seconds,
    SquareMetres,
    Triple,
)

# The only list of the dimensions of an arm.
Dimension = Annotated[
    Literal[2, 3],
    Quantity(expects="2 (a planar arm) or 3 (an arm that bends both ways and twists)"),
]

_DAMPING_TIME = 0.02  # viscosity over modulus of a material without branches (s)

_Above0 = Annotated[float, Field(gt=0)]
Radius = Annotated[
    _Above0 | Annotated[tuple[_Above0, _Above0], AsTuple],
    Quantity("m", "a number above 0, or [root, tip], both above 0"),
]
_Ends = Annotated[tuple[_Above0, _Above0], AsTuple]
_TAPER = "a number above 0, or [root, tip], both above 0"
Bending = Annotated[
    _Above0 | _Ends | Annotated[tuple[_Ends, _Ends], AsTuple] | None,
    Quantity(
        "N m2",
        _TAPER,
        "a number above 0, [EI_1, EI_2] or [[EI_1, EI_2] at the root, [EI_1, EI_2] at the tip], "
        "all above 0",
    ),
]
RestCurvature = Annotated[
    float | Triple,
    Quantity("1/m", "a number", "a number or [kappa_1, kappa_2, twist], twist in rad/m"),
    Count(plane=(1,), space=(1, 3)),
]
Nodes = Annotated[
    int,
    Field(ge=3, le=10_000),
    Quantity(expects="a whole number from 3 (an arm bends where edges meet) to 10000"),
]


class Section(Model):
    """Section properties that replace what radius, density and modulus would give."""

    EA: Annotated[_Above0 | _Ends | None, Quantity("N", _TAPER)] = entry(
        None, "Axial stiffness, linear from root to tip."
    )
    EI: Bending = entry(
        None,
        "Bending stiffness, linear from root to tip; in space one for both directions, or those "
        "toward m_1 and m_2, or such a pair for the root and one for the tip.",
    )
    GJ: Annotated[
        _Above0 | _Ends | None, Quantity("N m2", _TAPER), Only(3, "Only a spatial arm twists.")
    ] = entry(None, "Twisting stiffness, linear from root to tip.")
    mass_per_length: Annotated[float, Quantity("kg/m")] | None = entry(
        None, "Mass of a metre of arm, without added mass.", gt=0
    )
    diameter: Metres | None = entry(None, "Diameter for water and obstacles.", ge=0)
    displaced_area: SquareMetres | None = entry(
        None, "Section area for buoyancy and added mass.", ge=0
    )


class Relaxation(Model):
    """A Maxwell branch of the material, next to its spring."""

    ratio: float = Field(gt=0, description="Modulus of the branch over `youngs_modulus`.")
    time: Seconds = Field(gt=0, description="Relaxation time.")


class LossFactor(Model):
    """A loss factor that is nearly constant over a band of frequencies, by Maxwell branches."""

    value: float = Field(gt=0, le=1.5, description="Loss modulus over storage modulus.")
    band_hz: Annotated[
        tuple[float, float], AsTuple, Quantity("Hz", "[lowest, highest], 0 < lowest < highest")
    ] = Field(description="Lowest and highest frequency.")

    def _conflicts(self) -> Iterator[Mistake]:
        lowest, highest = self.band_hz
        if not 0 < lowest < highest <= 1e6 * lowest:
            yield self.mistake("band_hz")


class Fatigue(Model):
    """The fatigue strength of the material: N cycles of a stress range S, N S^slope = intercept."""

    slope: float = Field(gt=0, description="Slope of the curve of stress range over cycles.")
    intercept: Annotated[float, Quantity("Pa^slope")] = Field(
        gt=0, description="Cycles that a stress range of 1 Pa would need, N S^slope."
    )
    youngs_modulus: Pascals | None = entry(
        None,
        "Young's modulus from strain to stress; `arm.youngs_modulus` by default, needed with "
        "`section.EI`.",
        gt=0,
    )


class Arm(Model):
    """The arm at rest, a round elastic rod."""

    dimension: Dimension = entry(2, "2: the arm moves in the plane of x and z; 3: in space.")
    length: Metres = entry(0.5, "Length at rest.", gt=0)
    nodes: Nodes = entry(21, "Number of nodes, evenly spaced along the arm.")
    radius: Radius = entry(0.02, "Radius of the section; a pair gives a linear taper.")
    density: Annotated[float, Quantity("kg/m3")] = entry(1080.0, "Density of the material.", gt=0)
    youngs_modulus: Pascals = entry(1.0e5, "Young's modulus of the material.", gt=0)
    poisson_ratio: float = entry(
        0.5, "Poisson's ratio, for the shear modulus, which resists twist in space.", ge=0, le=0.5
    )
    relaxation: ListOf[Relaxation] = entry(
        (), "Maxwell branches: E(t) = youngs_modulus (1 + sum of ratio exp(-t / time))."
    )
    loss_factor: LossFactor | None = entry(None, "In place of `relaxation`: a loss factor.")
    damping_time: Annotated[Seconds, Follows()] = Field(
        # branches are all of the damping, unless more is asked for
        default_factory=lambda given: (
            0.0 if given.get("relaxation") or given.get("loss_factor") else _DAMPING_TIME
        ),
        ge=0,
        description="Kelvin-Voigt damping: viscosity over modulus; by default 0 with `relaxation` "
        "or `loss_factor`.",
        json_schema_extra={"default": _DAMPING_TIME},
    )
    rest_curvature: RestCurvature = entry(
        0.0, "Curvature at rest; positive curls like tilt (in space kappa_2)."
    )
    section: Section = entry(Section(), "Section properties that replace derived ones.")
    fatigue: Fatigue | None = entry(None, "Fatigue strength of the material, for a `life`.")

    def _conflicts(self) -> Iterator[Mistake]:
        if self.relaxation and self.loss_factor is not None:
            yield Mistake("loss_factor", "got both loss_factor and relaxation; must be one of them")
        bending = self.section.EI
        if self.dimension == 2 and isinstance(bending, tuple) and isinstance(bending[0], tuple):
            hint = "Set arm.dimension = 3 to use it."
            yield Mistake("section.EI", got(bending, f"be {_TAPER} (N m2)", hint))

        if self.fatigue is not None and self.fatigue.youngs_modulus is None and bending is not None:
            text = missing("be a number above 0 (Pa), as section.EI gives no stress")
            yield Mistake("fatigue.youngs_modulus", text)

    @property
    def diameters(self) -> tuple[float, ...]:
        """Diameter that the water sees at each node (m)."""
        if self.section.diameter is not None:
            return (self.section.diameter,) * self.nodes
        root, tip = self.radius if isinstance(self.radius, tuple) else (self.radius, self.radius)
        return tuple(2 * (root + (tip - root) * i / (self.nodes - 1)) for i in range(self.nodes))
