"""Chambers and tendons against the arm that they bend, and further sensors against the run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import Chamber, Tendon

_TURNS = 3.0
"""Turns into which a chamber or tendon may curl the free arm."""
_STRAIN = 0.5
"""Stretch of the free arm."""
_SECTIONS = 33
"""Sections at which the arm is looked at along the span of a thread."""


class _Pull(NamedTuple):
    """A thread with a route, and what the free arm does at its largest drive."""

    key: str
    thread: Chamber | Tendon
    offset: float
    """Largest offset (m)."""
    turns: float
    strain: float
    """Largest stretch of a section."""


def _threads(facts: Facts) -> Iterator[_Pull]:
    scenario = facts.scenario
    for index, chamber in enumerate(scenario.chamber):
        if chamber.area is not None:
            yield _pull(facts, f"chamber.{index}", chamber, chamber.area)
    for index, tendon in enumerate(scenario.tendon):
        yield _pull(facts, f"tendon.{index}", tendon, 1.0)


def _pull(facts: Facts, key: str, thread: Chamber | Tendon, area: float) -> _Pull:
    """Return what a thread does to the sections of its span.

    The force of one whose length or volume is given is what the free arm yields to by as much.
    """
    at, span = np.linspace(*thread.span, _SECTIONS), float(np.ptp(thread.span)) * facts.length
    bending, stretching = facts.stiffness(at)
    offset = np.interp(at, thread.span, np.broadcast_to(thread.offset or 0.0, 2))
    force = thread.largest * area
    if thread.lined:
        force = thread.largest / area / span / _mean(1 / stretching + offset**2 / bending)
    turns = force * _mean(offset / bending) * span / (2 * math.pi)
    strain = force / float(stretching.min())
    return _Pull(key, thread, float(offset.max()), turns, strain)


def _mean(values: Float[np.ndarray, " at"]) -> float:
    return float(np.mean(values[1:] + values[:-1]) / 2)


def _offset(facts: Facts) -> Iterator[str]:
    most = facts.diameter / 2
    for key, _, offset, _, _ in _threads(facts):
        if offset > most > 0:
            yield (
                f"{key}.offset: got {offset:g} m, outside of the arm's radius of {most:g} m; is it "
                "in mm?"
            )


def _force(facts: Facts) -> Iterator[str]:
    for key, thread, _, turns, strain in _threads(facts):
        if turns > _TURNS or strain > _STRAIN:
            yield (
                f"{key}.{thread.largest_key}: curls the free arm into {turns:.2g} turns and "
                f"stretches it by {100 * strain:.3g}%; up to {_TURNS:g} turns and {_STRAIN:.0%} is "
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
