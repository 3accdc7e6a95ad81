"""The water around the arm, and gravity."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import AfterValidator

from crinoid.scenario.errors import Mistake, got
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import Metres, Quantity

_NUMBERS: dict[str, dict[str, float]] = {
    "synchronisation": {"lift": 0.8, "centre": 0.18, "range": 0.08},
    "wake-oscillator": {"lift": 0.3, "strouhal": 0.2, "coupling": 12.0, "damping": 0.3},
}
"""Numbers of each model of vortices, with their defaults."""


class Vortices(Model):
    """Vortex shedding: lift across the flow and a smaller force along it at twice its frequency.

    A model's own numbers have its defaults where they are left out.
    """

    model: Literal["synchronisation", "wake-oscillator", "none"] = entry(
        "synchronisation",
        "A phase that follows the arm, or a van der Pol oscillator; none: no vortices.",
    )
    lift: float | None = entry(
        None, "Lift coefficient; 0.8 of synchronisation, 0.3 of wake-oscillator.", ge=0
    )
    in_line: float = entry(0.1, "In-line coefficient; 0: none.", ge=0)
    centre: float | None = entry(
        None, "Frequency of synchronisation over U/D, out of lock-in: 0.18.", gt=0
    )
    range: float | None = entry(
        None, "Half the width of lock-in of synchronisation, over U/D: 0.08.", ge=0
    )
    strouhal: float | None = entry(None, "Frequency of wake-oscillator over U/D: 0.2.", gt=0)
    coupling: float | None = entry(
        None, "Coupling of wake-oscillator to the arm's acceleration: 12.", ge=0
    )
    damping: float | None = entry(None, "Damping of wake-oscillator: 0.3.", gt=0)

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers of the model, by name."""
        defaults = _NUMBERS[self.model]
        given = {name: getattr(self, name) for name in defaults}
        return {name: defaults[name] if x is None else x for name, x in given.items()}

    def _conflicts(self) -> Iterator[Mistake]:
        if self.model == "none":  # an override, which leaves the other numbers as they are
            return
        numbers = self.numbers
        for name in ("centre", "range", "strouhal", "coupling", "damping"):
            if name not in numbers and getattr(self, name) is not None:
                yield Mistake(name, f"is no number of model {self.model}. Leave it out.")
        if numbers.get("range", 0.0) >= numbers.get("centre", 1.0):
            yield Mistake("range", got(numbers["range"], f"be below centre = {numbers['centre']}"))


def _unless_none(table: Vortices | None) -> Vortices | None:
    return None if table is None or table.model == "none" else table


class Water(Model):
    """The water around the arm, and gravity."""

    density: Annotated[float, Quantity("kg/m3")] = entry(1025.0, "Density; 0: no water.", ge=0)
    # sea water (3.5 % salt) at 14 to 15 degrees C: ITTC procedure 7.5-02-01-03 (2011)
    kinematic_viscosity: Annotated[float, Quantity("m2/s")] = entry(
        1.2e-6, "Kinematic viscosity, for Reynolds numbers only.", gt=0
    )
    coefficients: Literal["given", "literature"] = entry(
        "given",
        "literature: drag across the arm and its added mass are those of a smooth cylinder, by "
        "Reynolds and Keulegan-Carpenter number, in place of drag_normal and added_mass_normal.",
    )
    drag_normal: float = entry(1.1, "Drag coefficient across the arm.", ge=0)
    drag_tangential: float = entry(0.01, "Drag coefficient along the arm.", ge=0)
    added_mass_normal: float = entry(
        1.0, "Added mass across the arm, over the displaced mass.", ge=0
    )
    added_mass_tangential: float = entry(
        0.0, "Added mass along the arm, over the displaced mass.", ge=0
    )
    linear_drag: Annotated[float, Quantity("N s/m2")] = entry(
        0.0, "Drag in proportion to the speed, on a metre of arm.", ge=0
    )
    gravity: Annotated[float, Quantity("m/s2")] = entry(
        9.81, "Gravity; 0: none, or a planar arm seen from above.", ge=0
    )
    depth: Metres | None = entry(None, "Depth: the bed is at z = -depth, the surface at 0.", gt=0)
    vortices: Annotated[Vortices | None, AfterValidator(_unless_none)] = entry(
        None, "Vortex shedding; none without this table."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if self.coefficients == "literature":
            for name in ("drag_normal", "added_mass_normal"):
                if getattr(self, name) != type(self).model_fields[name].default:
                    yield self.mistake(name, 'be left out with coefficients = "literature"')
