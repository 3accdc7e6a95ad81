"""Chambers and tendons against the arm that they bend, and further sensors against the run."""

from __future__ import annotations

import math
from collections.abc import Iterator

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import Chamber, Tendon

_TURNS = 3.0
"""Turns into which a chamber or tendon may curl the free arm."""
_STRAIN = 0.5
"""Stretch of the free arm."""


def _threads(facts: Facts) -> Iterator[tuple[str, Chamber | Tendon, float, float]]:
    """Yield key, table, largest force (N) and largest offset (m) of each thread with a route.

    The force of one whose length or volume is given is what the free arm yields to by as much.
    """
    scenario, bending = facts.scenario, float(facts.bending.max())

    def force(thread: Chamber | Tendon, area: float, offset: float) -> float:
        if not thread.lined:
            return thread.largest * area
        span = (thread.span[1] - thread.span[0]) * facts.length
        return thread.largest / area / span / (1 / facts.stretching + offset**2 / bending)

    for index, chamber in enumerate(scenario.chamber):
        if chamber.area is not None:
            offset = _largest(chamber.offset)
            yield f"chamber.{index}", chamber, force(chamber, chamber.area, offset), offset
    for index, tendon in enumerate(scenario.tendon):
        offset = _largest(tendon.offset)
        yield f"tendon.{index}", tendon, force(tendon, 1.0, offset), offset


def _largest(offset: float | tuple[float, float] | None) -> float:
    return max(offset) if isinstance(offset, tuple) else offset or 0.0


def _offset(facts: Facts) -> Iterator[str]:
    most = facts.diameter / 2
    for key, _, _, offset in _threads(facts):
        if offset > most > 0:
            yield (
                f"{key}.offset: got {offset:g} m, outside of the arm's radius of {most:g} m; is it "
                "in mm?"
            )


def _force(facts: Facts) -> Iterator[str]:
    for key, thread, force, offset in _threads(facts):
        span = (thread.span[1] - thread.span[0]) * facts.length
        turns = force * offset * span / float(facts.bending.max()) / (2 * math.pi)
        strain = force / facts.stretching
        if turns > _TURNS or strain > _STRAIN:
            yield (
                f"{key}.{thread.largest_key}: curls the free arm into {turns:.2g} turns and "
                f"stretches it by {strain:.0%}; up to {_TURNS:g} turns and {_STRAIN:.0%} is "
                "usual; is the area in m2, or arm.youngs_modulus in Pa?"
            )


def _schedule(facts: Facts) -> Iterator[str]:
    scenario = facts.scenario
    duration = scenario.simulation.duration
    for group, threads in (("chamber", scenario.chamber), ("tendon", scenario.tendon)):
        for index, thread in enumerate(threads):
            if thread.schedule is not None and thread.schedule.time[0] >= duration:
                yield (
                    f"{group}.{index}.schedule.time: begins at {thread.schedule.time[0]:g} s in a "
                    f"run of {duration:g} s; is it in ms?"
                )


def _delay(facts: Facts) -> Iterator[str]:
    duration = facts.scenario.simulation.duration
    for index, sensor in enumerate(facts.scenario.sensors):
        if sensor.delay >= duration:
            yield (
                f"sensors.{index}.delay: got {sensor.delay:g} s in a run of {duration:g} s; "
                "nobody ever gets its readings; is it in ms?"
            )


THREAD = (
    Rule(("chamber.*.offset", "tendon.*.offset"), "within the arm's radius", _offset),
    Rule(
        (
            "chamber.*.max_pressure",
            "chamber.*.max_volume",
            "tendon.*.max_tension",
            "tendon.*.max_shortening",
        ),
        "up to 3 turns and a stretch of 50 % of the free arm",
        _force,
    ),
    Rule(("chamber.*.schedule.time", "tendon.*.schedule.time"), "within the run", _schedule),
    Rule(("sensors.*.delay",), "less than the run", _delay),
)
