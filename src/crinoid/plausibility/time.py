"""Times of the computation against those of what is computed."""

import math
from collections.abc import Iterator
from operator import attrgetter
from typing import NamedTuple

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import GaussMarkovFlow, GustFlow, SineFlow, TurbulenceFlow, WavesFlow
from crinoid.scenario.motion import SineMotion
from crinoid.scenario.obstacle import Plane

_DAMPED = 0.05
"""Damping ratio that a time integrator may add to the first vibration."""
_KEPT = 4.0
"""Saved instants in the arm's first period."""
_SYRUP = 10.0
"""Damping ratio of the first vibration that linear drag may give."""


class _Course(NamedTuple):
    """Something that goes to and fro, or passes."""

    name: str
    period: float
    """How long it takes (s)."""
    steps: float
    """How many time steps it takes to follow that."""


def _courses(facts: Facts) -> Iterator[_Course]:
    scenario = facts.scenario
    second = float(facts.frequencies[1])
    yield _Course(f"the arm's second bending mode (about {second:.2g} Hz)", 1 / second, 8)
    channels = scenario.base.channels.present
    for name in (name for name in scenario.driven if name in channels):
        band = channels[name].bandwidth_hz
        yield _Course(f"the servo of {name} ({band:g} Hz)", 1 / band, 4)
    for index, motion in enumerate(scenario.base.motion):
        if isinstance(motion, SineMotion):
            yield _Course(f"base.motion.{index}", 1 / motion.frequency_hz, 8)
    for index, flow in enumerate(scenario.flow):
        name = f"flow.{index}"
        match flow:
            case SineFlow():
                yield _Course(name, 1 / flow.frequency_hz, 8)
            case GustFlow():
                yield _Course(name, flow.duration, 8)
            case GaussMarkovFlow():
                yield _Course(f"the correlation time of {name}", flow.correlation_time, 3)
            case WavesFlow():
                yield _Course(f"the waves of {name}", flow.peak_period, 16)
            case TurbulenceFlow():
                passing = flow.length_scale / facts.current
                yield _Course(f"the passing of an eddy of {name}", passing, 8)
    for table in ("flow", "load", "base.motion"):
        for index, each in enumerate(attrgetter(table)(scenario)):
            if ramp := getattr(each, "ramp_time", 0.0):
                yield _Course(f"the ramp of {table}.{index}", ramp, 4)
    for index, obstacle in enumerate(scenario.obstacle):
        if not isinstance(obstacle, Plane) and obstacle.velocity != "flow":
            speed = math.hypot(*obstacle.velocity)
            size = 2 * obstacle.radius + facts.diameter
            if speed:
                yield _Course(f"the passing of obstacle.{index}", size / speed, 4)


def _time_step(facts: Facts) -> Iterator[str]:
    step = facts.scenario.simulation.time_step
    worst = min(_courses(facts), key=lambda course: course.period / course.steps)
    if step * worst.steps > worst.period:
        yield (
            f"simulation.time_step: got {step:g} s, which makes {worst.period / step:.2g} time "
            f"steps of {worst.name}, {worst.period:.2g} s; takes {worst.steps:g} to follow it: up "
            f"to {worst.period / worst.steps:.2g} s"
        )


def _integrator(facts: Facts) -> Iterator[str]:
    simulation = facts.scenario.simulation
    ratio = math.pi * simulation.time_step / facts.period
    if simulation.integrator == "implicit-euler" and ratio > _DAMPED:
        yield (
            f'simulation.integrator: got "implicit-euler" with steps of {simulation.time_step:g} '
            f"s, which by itself damps the arm's first vibration by {ratio:.0%} of critical; takes "
            f"{_DAMPED * facts.period / math.pi:.2g} s to stay below {_DAMPED:.0%}"
        )


def _interval(facts: Facts) -> Iterator[str]:
    interval = facts.scenario.output_interval
    if facts.scenario.output.interval is not None and interval > facts.period / _KEPT:
        yield (
            f"output.interval: got {interval:g} s; the arm's first period is about "
            f"{facts.period:.2g} s, and fewer than {_KEPT:g} instants of it do not show a vibration"
        )


def _damping(facts: Facts) -> Iterator[str]:
    arm = facts.scenario.arm
    if arm.damping_time > facts.period:
        yield (
            f"arm.damping_time: got {arm.damping_time:g} s, longer than the arm's first period of "
            f"about {facts.period:.3g} s: it creeps back where it would swing; is it in ms?"
        )


def _syrup(facts: Facts) -> Iterator[str]:
    water = facts.scenario.water
    ratio = water.linear_drag * facts.period / (4 * math.pi * float(facts.swung.mean()))
    if ratio > _SYRUP:
        yield (
            f"water.linear_drag: got {water.linear_drag:g} N s/m2, which damps the arm's first "
            f"vibration {ratio:.2g} times over: is that water?"
        )


TIME = (
    Rule(("arm.damping_time",), "up to the arm's first period", _damping),
    Rule(("water.linear_drag",), "up to ten times critical damping of the first vibration", _syrup),
    Rule(
        ("simulation.time_step",),
        "8 time steps to the period of the second bending mode, of sines and gusts and to the "
        "passing of an eddy, 16 to the peak period of waves, 4 to a period at a driven servo's "
        "bandwidth, to a ramp and to the passing of an obstacle, 3 to a correlation time",
        _time_step,
    ),
    Rule(
        ("simulation.integrator",),
        "implicit-euler that adds up to 5 % of critical damping to the first vibration",
        _integrator,
    ),
    Rule(("output.interval",), "4 instants to the arm's first period", _interval),
)
