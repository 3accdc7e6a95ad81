"""The draws of a training where nothing is said."""

from collections.abc import Iterator
from typing import Any

from crinoid.scenario import Scenario

_STRENGTHS = ("velocity", "amplitude", "mean", "standard_deviation", "significant_height")
_ERRORS = ("noise_position", "noise_angle_deg", "delay")


def usual_draws(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Return what episodes draw where nothing is said.

    Young's modulus, and a bending stiffness that is given, 30 % up and down; half to one and a half
    times the currents, the errors and the delay of the sensor, and the mass of a tool.
    """
    document = scenario.to_dict()
    arm, sensor, tool = (document.get(name) or {} for name in ("arm", "sensor", "tool"))
    stiffness = {
        "arm.youngs_modulus": scenario.arm.youngs_modulus,
        "arm.section.EI": arm.get("section", {}).get("EI"),
    }
    others = {
        f"flow.{index}.{name}": flow.get(name)
        for index, flow in enumerate(document.get("flow", []))
        for name in _STRENGTHS
    }
    others |= {f"sensor.{name}": sensor.get(name) for name in _ERRORS}
    others["tool.mass"] = tool.get("mass")
    found = {}
    for values, spread in ((stiffness, 0.3), (others, 0.5)):
        for key, number in _numbers(values):
            low, high = sorted(((1 - spread) * number, (1 + spread) * number))
            found[key] = low, high
    return found


def _numbers(values: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the numbers among values, and among the components of vectors, that are not 0."""
    for key, value in values.items():
        listed = isinstance(value, list)
        for index, each in enumerate(value if listed else [value]):
            if isinstance(each, float) and each:
                yield f"{key}.{index}" if listed else key, each
