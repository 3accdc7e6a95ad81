"""Settings of a training, and default ranges of what its episodes draw."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from crinoid.scenario import Scenario, got, refusal


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of a training."""

    teacher: str = "lqg"  # kind of controller that the policy imitates first; none for `"none"`
    arms: int = 16  # number of arms that run between two updates
    updates: int = 1500
    seed: int = 0
    draw: Mapping[str, tuple[float, float]] | None = None
    """Keys of the scenario that each episode draws, with the smallest and the largest value."""


_STRENGTHS = ("velocity", "amplitude", "mean", "standard_deviation", "significant_height", "height")
_ERRORS = ("noise_position", "noise_angle_deg", "delay")


def default_randomization(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Return the default ranges of what episodes draw.

    Young's modulus and a given bending stiffness vary by 30 %; currents, the errors and the delay
    of the sensor, and the mass of a tool by 50 %.
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
    ranges = {}
    for key, value in (stiffness | others).items():
        spread = 0.3 if key in stiffness else 0.5
        numbers = {f"{key}.{i}": x for i, x in enumerate(value)} if isinstance(value, list) else {}
        for name, number in (numbers or {key: value}).items():
            if isinstance(number, float) and number:
                low, high = sorted(((1 - spread) * number, (1 + spread) * number))
                ranges[name] = low, high
    return ranges


def drawn_keys(scenario: Scenario, given: Sequence[str] | None) -> dict[str, tuple[float, float]]:
    """Return the keys that episodes draw, with the smallest and the largest value of each."""
    if not given:
        return default_randomization(scenario)
    found: dict[str, tuple[float, float]] = {}
    for each in given:
        key, _, pair = (part.strip() for part in each.partition("="))
        try:
            low, high = map(float, pair.split(":"))
        except ValueError:
            text = got(each, "be KEY=LOW:HIGH, such as arm.youngs_modulus=3e6:5e6")
            raise refusal("--draw", text) from None
        if low > high or key in found:
            must = "have the smaller number first" if low > high else "name each key once"
            raise refusal("--draw", got(each, must))
        found[key] = low, high
    scenario.with_values({key: low for key, (low, _) in found.items()})  # which refuses others
    return found
