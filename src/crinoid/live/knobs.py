"""The numbers that may be changed while it runs, each as a multiple of the scenario's."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from crinoid.scenario import Scenario

__all__ = ["SHARES", "Knobs", "described"]


@dataclass(frozen=True)
class Knobs:
    """Multiples of numbers of a scenario; 1 is as it describes them."""

    current: float = 1.0
    """For the velocities of all flows."""
    intensity: float = 1.0
    """For the intensity of turbulence."""
    length_scale: float = 1.0
    """For the length scale of turbulence."""
    gains: float = 1.0
    """For the gains of a PID."""
    stiffness: float = 1.0
    """For Young's modulus, and for EA, EI and GJ where the scenario gives them."""

    @property
    def turned(self) -> tuple[str, ...]:
        """Names of those that are not 1."""
        return tuple(each.name for each in fields(self) if getattr(self, each.name) != 1.0)


SHARES: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "uniform": {"current": ("velocity",)},
    "shear": {"current": ("velocity",)},
    "gust": {"current": ("velocity",)},
    "sine": {"current": ("amplitude",)},
    "gauss-markov": {"current": ("mean", "standard_deviation")},
    "turbulence": {
        "current": ("mean",),
        "intensity": ("intensity",),
        "length_scale": ("length_scale",),
    },
    "waves": {"current": ("significant_height",)},
}
"""Keys of each kind of flow that a knob multiplies."""


def described(scenario: Scenario, knobs: Knobs) -> tuple[Scenario, list[str]]:
    """Return a scenario with the numbers that knobs give it, and what no key of it can say.

    A flow that is turned down to nothing is left out.
    """
    document, left = scenario.to_dict(), []
    flows = []
    for index, table in enumerate(document.get("flow", [])):
        shares = SHARES.get(table["kind"], {})
        if knobs.current == 0.0:
            continue
        for knob, keys in shares.items():
            for key in keys:
                table[key] = _times(getattr(knobs, knob), table.get(key))
        if knobs.current != 1.0 and not shares:
            left.append(f"the velocity of flow.{index} is {knobs.current:g} times that of its file")
        flows.append(table)
    values: dict[str, Any] = {"flow": flows} if knobs.turned else {}
    arm = scenario.arm
    if knobs.stiffness != 1.0:
        values["arm.youngs_modulus"] = knobs.stiffness * arm.youngs_modulus
        for name in ("EA", "EI", "GJ"):
            if (given := getattr(arm.section, name)) is not None:
                values[f"arm.section.{name}"] = _times(knobs.stiffness, given)
    if knobs.gains != 1.0 and scenario.control.kind == "pid":
        for name, gains in scenario.control.pid.present.items():
            for key in ("kp", "ki", "kd"):
                values[f"control.pid.{name}.{key}"] = knobs.gains * getattr(gains, key)
    return (scenario.with_values(values) if values else scenario), left


def _times(factor: float, value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [factor * each for each in value]
    return factor * value
