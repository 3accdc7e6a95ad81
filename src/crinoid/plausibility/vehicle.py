"""The submarine that floats against what its numbers say of it, and against its arm."""

from collections.abc import Iterator

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import Vehicle

_LIGHT = 0.5
"""Mass over that of the arm."""
_FLOATS = (0.8, 1.25)
"""Mass over that of the water displaced."""
_GYRATION = (0.02, 20.0)
"""Radius of gyration (m)."""
_OF_THRUSTERS = ("bandwidth_hz", "max_force", "max_moment")


def _mass(facts: Facts) -> Iterator[str]:
    vehicle = facts.scenario.vehicle
    if vehicle is None:
        return
    arm = float(facts.mass.mean()) * facts.length
    if vehicle.mass < _LIGHT * arm:
        yield (
            f"vehicle.mass: got {vehicle.mass:g} kg, {vehicle.mass / arm:.2g} of the arm's "
            f"{arm:.3g} kg; {_LIGHT:g} of it or more is usual; is it in t?"
        )


def _volume(facts: Facts) -> Iterator[str]:
    vehicle, density = facts.scenario.vehicle, facts.scenario.water.density
    if vehicle is None or vehicle.volume is None or not facts.wet:
        return
    low, high = _FLOATS
    displaced = density * vehicle.volume
    if not low * displaced <= vehicle.mass <= high * displaced:
        does = "sinks" if vehicle.mass > displaced else "rises"
        yield (
            f"vehicle.volume: got {vehicle.volume:g} m3, which displaces {displaced:.3g} kg of "
            f"water: with {vehicle.mass:g} kg it {does}; is it in litres?"
        )


def _inertia(facts: Facts) -> Iterator[str]:
    vehicle = facts.scenario.vehicle
    if vehicle is None:
        return
    moments = vehicle.inertia if isinstance(vehicle.inertia, tuple) else (vehicle.inertia,)
    low, high = _GYRATION
    for moment in moments:
        radius = (moment / vehicle.mass) ** 0.5
        if not low <= radius <= high:
            yield (
                f"vehicle.inertia: got {moment:g} kg m2 for {vehicle.mass:g} kg, a radius of "
                f"gyration of {radius:.2g} m; {low:g} to {high:g} m is usual; is it in kg cm2?"
            )


def _idle(facts: Facts) -> Iterator[str]:
    vehicle = facts.scenario.vehicle
    for name in _OF_THRUSTERS if vehicle is not None and vehicle.hold == "free" else ():
        if getattr(vehicle, name) != Vehicle.model_fields[name].default:
            yield f'vehicle.{name}: has no effect with vehicle.hold = "free"'


VEHICLE = (
    Rule(("vehicle.mass",), "half the mass of the arm or more", _mass),
    Rule(("vehicle.volume",), "a mass of 0.8 to 1.25 times that of the water displaced", _volume),
    Rule(("vehicle.inertia",), "a radius of gyration of 0.02 to 20 m", _inertia),
    Rule(tuple(f"vehicle.{name}" for name in _OF_THRUSTERS), 'not with hold = "free"', _idle),
)
