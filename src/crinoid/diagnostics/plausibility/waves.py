"""Usual ranges of surface waves: height before they break, and depth of their troughs."""

from __future__ import annotations

import math
from typing import Any

from crinoid.assembly.facts import Facts
from crinoid.diagnostics.plausibility.rule import Rule, range_rule
from crinoid.scenario import SurfaceWaves


def _steepness(facts: Facts, height: Any, flow: Any) -> float | None:
    if not isinstance(flow, SurfaceWaves):
        return None
    return height / (facts.scenario.water.gravity * flow.wave_period**2 / (2 * math.pi))


def _height_over_depth(facts: Facts, height: Any, flow: Any) -> float | None:
    depth = facts.scenario.water.depth
    return height / depth if isinstance(flow, SurfaceWaves) and depth is not None else None


def _below_troughs(facts: Facts, height: Any, flow: Any) -> float | None:
    root = facts.scenario.base.position[-1]
    top = max(root, root + facts.length * facts.direction[-1])
    return float(-top - height) if isinstance(flow, SurfaceWaves) and top <= 0 else None


def wave_rules(key: str) -> tuple[Rule, ...]:
    """Return the rules on the height of surface waves with that key."""
    # fmt: off
    return (
        # Miche 1944: waves break in deep water at this height over length
        range_rule(f"flow.*.{key}", 0.0, 0.14, "m", quantity="height / wavelength",
                   of=_steepness, above="Such waves break."),
        range_rule(f"flow.*.{key}", 0.0, 0.6, "m", quantity="height / water.depth",
                   of=_height_over_depth, above="Such waves break."),
        range_rule(f"flow.*.{key}", 0.0, math.inf, "m",
                   quantity="depth of the arm below troughs",
                   quantity_unit="m", of=_below_troughs,
                   below="The troughs leave the arm in the air, which is computed as water."),
    )
    # fmt: on
