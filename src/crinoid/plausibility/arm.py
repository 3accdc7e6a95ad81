"""The sizes of an arm against one another."""

import math
from collections.abc import Iterator

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import shown

_SLENDER = 0.1
"""Radius over length up to which a rod theory without shear holds within some percent."""
_THREAD = 1e-4
_WIDENS = 2.0
_SHORT = 0.25
"""Length of an edge over the radius, from which on finer nodes show nothing that a rod has."""
_FEWEST = 5
_CURLED = 0.3
"""Curvature at rest times radius: the section's own size no longer is small."""
_TURN = 30.0
"""Largest turn between two edges at rest (degrees)."""
_COILS = 10.0
_FACTOR = 10.0
"""By how much a section property may differ from that of a round section."""
_DENSITY = (100.0, 12e3)
_TWISTS = 3.0


def _radius(facts: Facts) -> Iterator[str]:
    root, tip = facts.radii
    got = f"arm.radius: got {shown(facts.scenario.arm.radius)} m"
    if max(root, tip) > _SLENDER * facts.length:
        yield (
            f"{got} on an arm of {facts.length:g} m; a slender rod has a radius below a tenth of "
            "its length; is it in mm?"
        )
    elif max(root, tip) < _THREAD * facts.length:
        yield (
            f"{got} on an arm of {facts.length:g} m; that is a thread, below "
            f"{_THREAD:g} of its length; is arm.length in mm?"
        )
    elif tip > _WIDENS * root:
        yield f"{got}; the tip is more than twice as thick as the root; is it [root, tip]?"


def _nodes(facts: Facts) -> Iterator[str]:
    nodes = facts.scenario.arm.nodes
    if nodes < _FEWEST:
        yield (
            f"arm.nodes: got {nodes}; an arm of so few edges bends at one or two places only; "
            f"takes {_FEWEST} to be coarse and about 20 to be right"
        )
    elif facts.edge < _SHORT * min(facts.radii) < _SLENDER * facts.length:
        yield (
            f"arm.nodes: got {nodes}, which makes edges of {facts.edge:.3g} m on a radius of "
            f"{min(facts.radii):g} m; edges below a quarter of the radius cost time and show "
            "nothing that a rod has; are there too many?"
        )


def _curvature(facts: Facts) -> Iterator[str]:
    given = facts.scenario.arm.rest_curvature
    bend, twist = (math.hypot(*given[:2]), given[2]) if isinstance(given, tuple) else (given, 0.0)
    got = f"arm.rest_curvature: got {shown(given)} 1/m"
    coils = facts.length * math.hypot(bend, twist) / (2 * math.pi)
    turn = math.degrees(abs(bend) * facts.edge)
    if abs(bend) * max(facts.radii) > _CURLED:
        yield (
            f"{got} on a radius of {max(facts.radii):g} m; a rod's curvature times its radius is "
            f"below {_CURLED:g}; is it in degrees/m?"
        )
    elif coils > _COILS:
        yield f"{got}, which winds the arm up {coils:.3g} times; is it in degrees/m?"
    elif turn > _TURN:
        nodes = math.ceil(abs(bend) * facts.length / math.radians(_TURN)) + 1
        yield (
            f"{got}, a turn of {turn:.0f} degrees from one edge to the next; up to {_TURN:.0f} "
            f"draw a curve: takes {nodes} arm.nodes or more"
        )


def _section(facts: Facts) -> Iterator[str]:
    section, water = facts.scenario.arm.section, facts.scenario.water
    radius = max(facts.radii)
    name = "arm.section"
    if section.EI is not None or section.EA is not None:
        key = "EI" if section.EI is not None else "EA"
        round_ = 2 * math.sqrt(float(facts.bending.max()) / facts.stretching)
        got = f"{name}.{key}: got {shown(getattr(section, key))}"
        if round_ > _SLENDER * facts.length:
            yield (
                f"{got}; sqrt(EI / EA) is that of a section with a radius of {round_:.3g} m, "
                "above a tenth of the length; such an arm stretches before it bends"
            )
        elif round_ < radius / 100:
            yield (
                f"{got}; sqrt(EI / EA) is that of a section with a radius of {round_:.3g} m on "
                f"an arm of {radius:g} m; is it in N mm2?"
            )
    if section.GJ is not None and _TWISTS * facts.bending.max() < section.GJ:
        yield (
            f"{name}.GJ: got {section.GJ:g} N m2; that is more than {_TWISTS:g} times the bending "
            f"stiffness ({facts.bending.max():.3g} N m2); a round section has 2/3 to 1 of it"
        )
    if section.diameter and not 1 / _FACTOR <= section.diameter / (2 * radius) <= _FACTOR:
        yield (
            f"{name}.diameter: got {section.diameter:g} m on an arm.radius of {radius:g} m; the "
            "two are more than ten times apart; is it in mm?"
        )
    area = math.pi * (facts.diameter / 2) ** 2
    if (
        section.displaced_area
        and area
        and not (1 / _FACTOR <= section.displaced_area / area <= _FACTOR)
    ):
        yield (
            f"{name}.displaced_area: got {section.displaced_area:g} m2; a section of this diameter "
            f"has {area:.3g} m2; is it in cm2?"
        )
    if section.mass_per_length is not None:
        area = float(max(facts.displaced)) / water.density if water.density else area
        density = section.mass_per_length / area if area else _DENSITY[0]
        if not _DENSITY[0] <= density <= _DENSITY[1]:
            yield (
                f"{name}.mass_per_length: got {section.mass_per_length:g} kg/m; on its section "
                f"that is a density of {density:.3g} kg/m3; is it in g/m?"
            )


ARM = (
    Rule(
        ("arm.radius",),
        "1e-4 to 0.1 of the length; a tip up to twice the root",
        _radius,
    ),
    Rule(("arm.nodes",), "5 or more; edges of a quarter of the radius or longer", _nodes),
    Rule(
        ("arm.rest_curvature",),
        "up to 0.3 over the radius, 10 turns in all, and 30 degrees from one edge to the next",
        _curvature,
    ),
    Rule(
        ("arm.section.*",),
        "EI and EA of one section, with a radius up to a tenth of the length; GJ up to 3 EI; "
        "diameter and area within a factor of ten; a density of 100 to 12000 kg/m3",
        _section,
    ),
)
