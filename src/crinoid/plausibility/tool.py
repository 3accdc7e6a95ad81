"""The tool at the tip against the arm that carries it."""

from collections.abc import Iterator

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule

_LIMP = 1000.0
"""Force times length squared over EI."""
_DENSITY = (20.0, 22e3)
_LEVER = 3.0
"""Lengths of the arm."""
_SPREAD = 3.0
"""Radius of gyration over the arm's length."""


def _weight(facts: Facts) -> Iterator[str]:
    tool = facts.scenario.tool
    if tool is None:
        return
    water = facts.scenario.water
    force = abs(tool.mass - water.density * tool.volume) * water.gravity
    bent = force * facts.length**2 / float(facts.bending.max())
    if bent > _LIMP:
        yield (
            f"tool.mass: got {tool.mass:g} kg, a weight in water of {force:.3g} N, {bent:.2g} "
            f"times what EI and length of the arm stand against (up to {_LIMP:g} is usual); is it "
            "in g, or arm.youngs_modulus in kPa or MPa?"
        )


def _volume(facts: Facts) -> Iterator[str]:
    tool = facts.scenario.tool
    if tool is None or tool.volume == 0:
        return
    low, high = _DENSITY
    density = tool.mass / tool.volume
    if not low <= density <= high:
        yield (
            f"tool.volume: got {tool.volume:g} m3 for {tool.mass:g} kg, a density of "
            f"{density:.2g} kg/m3; {low:g} to {high:g} kg/m3 is usual; is it in litres or cm3?"
        )


def _lever(facts: Facts) -> Iterator[str]:
    tool = facts.scenario.tool
    if tool is not None and tool.offset > _LEVER * facts.length:
        yield (
            f"tool.offset: got {tool.offset:g} m, {tool.offset / facts.length:.2g} lengths of the "
            f"arm; up to {_LEVER:g} is usual; is it in mm?"
        )


def _inertia(facts: Facts) -> Iterator[str]:
    tool = facts.scenario.tool
    if tool is None:
        return
    largest = max(tool.inertia) if isinstance(tool.inertia, tuple) else tool.inertia
    radius = (largest / tool.mass) ** 0.5
    if radius > _SPREAD * facts.length:
        yield (
            f"tool.inertia: got {largest:g} kg m2 for {tool.mass:g} kg, a radius of gyration of "
            f"{radius:.2g} m; up to {_SPREAD:g} lengths of the arm is usual; is it in kg cm2?"
        )


def _times(facts: Facts) -> Iterator[str]:
    tool, duration = facts.scenario.tool, facts.scenario.simulation.duration
    if tool is not None and tool.from_ >= duration:
        yield (f"tool.from: got {tool.from_:g} s in a run of {duration:g} s; it is never taken up")


TOOL = (
    Rule(("tool.mass",), "a weight in water F with F L^2 / EI up to 1000", _weight),
    Rule(("tool.volume",), "a density of 20 to 22000 kg/m3", _volume),
    Rule(("tool.offset",), "up to three lengths of the arm", _lever),
    Rule(("tool.inertia",), "a radius of gyration of up to three lengths of the arm", _inertia),
    Rule(("tool.from",), "within the run", _times),
)
