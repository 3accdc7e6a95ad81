"""Text representation of a scenario: its main tables in a few lines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from math import prod
from typing import TYPE_CHECKING, Any

from crinoid.foundation.axes import ANGLES
from crinoid.foundation.representation import cut_list, titled
from crinoid.scenario.errors import counted, shown

if TYPE_CHECKING:
    from crinoid.scenario.scenario import Scenario


def represent(scenario: Scenario) -> tuple[str, dict[str, str]]:
    """Return the title of a scenario and its main tables in words, without empty ones."""
    arm, base, control, time = scenario.arm, scenario.base, scenario.control, scenario.simulation
    place = "in space" if arm.dimension == 3 else "in the plane"
    E, EI = f"E = {arm.youngs_modulus:g} Pa", arm.section.EI
    section = f"radius {shown(arm.radius)} m, {E if EI is None else f'EI = {shown(EI)} N m2'}"
    motions = counted(len(base.motion), "motion") if base.motion else ""
    pose = f"at {shown(base.position)} m, {'floats' if scenario.floats else base.mount}"
    drives = [f"{name} ({'rad' if name in ANGLES else 'm'})" for name in base.channels.present]
    drives += [f"{name} (share)" for name in scenario.threads]
    drives += [each.called for each in scenario.actuator]
    also = [*_kinds("load", scenario.load), *_kinds("obstacle", scenario.obstacle)]
    also += ["tool"] * (scenario.tool is not None)
    acts = f"{control.kind} at {scenario.control_rate_hz:g} Hz" if control.acts else "none"
    cases = prod(map(len, scenario.vary.values()))
    return titled("Scenario", scenario.title), {
        "arm": f"{arm.length:g} m {place}, {counted(arm.nodes, 'node')}, {section}",
        "base": ", ".join(filter(None, [pose, motions])),
        "inputs": cut_list(drives),
        "flow": cut_list(_kinds("", scenario.flow)) or "none",
        "also": cut_list(also),
        "control": acts,
        "time": f"{time.duration:g} s in steps of {time.time_step:g} s, seed {scenario.seed}",
        "vary": f"{counted(cases, 'case')} over {cut_list(scenario.vary)}" if scenario.vary else "",
    }


def _kinds(noun: str, tables: Iterable[Any]) -> list[str]:
    """Return the kinds of tables, each once with how many there are of it."""
    kinds = Counter(f"{noun} {each.kind}".strip() for each in tables)
    return [f"{kind} x {many}" if many > 1 else kind for kind, many in kinds.items()]
