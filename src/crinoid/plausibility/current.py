"""The current against the arm and the run, and what never comes."""

import math
from collections.abc import Iterator

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import GaussMarkovFlow, TurbulenceFlow, WavesFlow

_EDDIES = 2.0
"""Length scale over diameter from which on the water is as good as the same across the arm."""
_STEEP = 0.14
"""Height over length of a wave that breaks in deep water (Miche 1944)."""
_SHALLOW = 0.6
"""Significant height over depth that waves hardly exceed."""
_SLOW = 10.0
_HALF = 0.5


def _turbulence(facts: Facts) -> Iterator[str]:
    for index, flow in enumerate(facts.scenario.flow):
        if isinstance(flow, TurbulenceFlow) and flow.length_scale < _EDDIES * facts.diameter:
            yield (
                f"flow.{index}.length_scale: got {flow.length_scale:g} m on an arm "
                f"{facts.diameter:g} m thick; drag is that of water which is the same all across "
                f"the arm, so takes {_EDDIES:g} diameters or more"
            )


def _waves(facts: Facts) -> Iterator[str]:
    water, height = facts.scenario.water, facts.scenario.base.position[-1]
    for index, flow in enumerate(facts.scenario.flow):
        if not isinstance(flow, WavesFlow):
            continue
        length = water.gravity * flow.peak_period**2 / (2 * math.pi)
        got = f"flow.{index}.significant_height: got {flow.significant_height:g} m"
        top = max(height, height + facts.length * facts.direction[-1])
        if flow.significant_height > _STEEP * length:
            yield (
                f"{got} with a peak_period of {flow.peak_period:g} s, whose waves are "
                f"{length:.3g} m long; they break at {_STEEP:g} of their length"
            )
        elif water.depth is not None and flow.significant_height > _SHALLOW * water.depth:
            yield f"{got} in {water.depth:g} m of water; waves break at {_SHALLOW:g} of the depth"
        elif -flow.significant_height < top <= 0:
            yield (
                f"{got} over an arm that reaches up to z = {top:.3g} m; the troughs leave it in "
                "the air, which is computed as water"
            )


def _wandering(facts: Facts) -> Iterator[str]:
    duration = facts.scenario.simulation.duration
    for index, flow in enumerate(facts.scenario.flow):
        if isinstance(flow, GaussMarkovFlow) and flow.correlation_time > _SLOW * duration:
            yield (
                f"flow.{index}.correlation_time: got {flow.correlation_time:g} s in a run of "
                f"{duration:g} s, in which it hardly wanders; is it in ms?"
            )


def _coming(facts: Facts) -> Iterator[str]:
    duration = facts.scenario.simulation.duration
    tables = {"flow": facts.scenario.flow, "load": facts.scenario.load}
    for name, entries in tables.items():
        for index, entry in enumerate(entries):
            key = f"{name}.{index}"
            if entry.start >= duration:
                yield (
                    f"{key}.start: got {entry.start:g} s in a run of {duration:g} s; it never "
                    "sets in"
                )
            elif entry.start + _HALF * entry.ramp_time > duration:
                yield (
                    f"{key}.ramp_time: got {entry.ramp_time:g} s in a run of {duration:g} s; it "
                    "does not reach half its strength; is it in ms?"
                )


CURRENT = (
    Rule(("flow.*.length_scale",), "twice the arm's diameter or more", _turbulence, "the arm"),
    Rule(
        ("flow.*.significant_height",),
        "up to 0.14 of the length of a wave and 0.6 of the depth; troughs that stay above the arm",
        _waves,
        "the water",
    ),
    Rule(("flow.*.correlation_time",), "up to ten times the run", _wandering),
    Rule(
        ("flow.*.start", "flow.*.ramp_time", "load.*.start", "load.*.ramp_time"),
        "what sets in within the run, and reaches half its strength",
        _coming,
    ),
)
