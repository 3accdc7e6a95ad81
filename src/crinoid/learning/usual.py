"""The draws of a training where nothing is said."""

from __future__ import annotations

from crinoid.scenario import Scenario

_STRENGTHS = ("velocity", "amplitude", "mean", "standard_deviation", "significant_height")
_ERRORS = ("noise_position", "noise_angle_deg", "delay")


def usual_draws(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Return what episodes draw where nothing is said.

    Young's modulus 30 % up and down, and half to one and a half times the currents, the errors and
    the delay of the sensor, and the mass of a tool.
    """
    stiffness = scenario.arm.youngs_modulus
    found = {"arm.youngs_modulus": (0.7 * stiffness, 1.3 * stiffness)}
    document = scenario.to_dict()
    some = {
        f"flow.{index}.{name}": flow[name]
        for index, flow in enumerate(document.get("flow", []))
        for name in _STRENGTHS
        if name in flow
    }
    some |= {f"sensor.{name}": document.get("sensor", {}).get(name, 0.0) for name in _ERRORS}
    some["tool.mass"] = (document.get("tool") or {}).get("mass", 0.0)
    for key, value in some.items():
        parts = (
            {f"{key}.{k}": x for k, x in enumerate(value)}
            if isinstance(value, list)
            else {key: value}
        )
        for each, number in parts.items():
            if isinstance(number, float) and number:
                low, high = sorted((0.5 * number, 1.5 * number))
                found[each] = low, high
    return found
