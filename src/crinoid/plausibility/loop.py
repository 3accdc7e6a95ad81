"""Target, sensor and controller against the arm and the run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import Target, shown

_STRETCHED = 1.05
_NOISY = 0.05
"""Standard deviation of the sensor's noise over the length of the arm."""
_NOISY_ANGLE = 20.0


def _reach(facts: Facts) -> Iterator[str]:
    target = facts.scenario.target
    base = np.array(facts.scenario.base.position)
    root = np.zeros_like(base) if target.frame == "base" else base
    reach = _STRETCHED * facts.length + facts.travel
    for key, points in _wanted(target).items():
        farthest = float(np.linalg.norm(np.subtract(points, root), axis=1).max())
        if farthest > reach:
            yield (
                f"target.{key}: got {shown(getattr(target, key))}, a target {farthest:.4g} m from "
                f"the base; length and travel reach {facts.length + facts.travel:.3g} m; is it in "
                f"mm{', or seen from the base' if target.frame == 'world' else ''}?"
            )
            return


def _wanted(target: Target) -> dict[str, list[tuple[float, ...]]]:
    """Return what is known of where the tip should be, by key."""
    found: dict[str, list[tuple[float, ...]]] = {}
    if target.tip_path is not None:
        found["tip"] = list(target.tip_path)
    elif isinstance(target.tip, tuple):
        found["tip"] = [_point(target.tip)]
    if target.to is not None:
        found["to"] = [target.to]
    if target.centre is not None:
        found["centre"] = [target.centre]
    return found


def _point(given: tuple[object, ...]) -> tuple[float, ...]:
    return tuple(item for item in given if isinstance(item, float))


def _late(facts: Facts) -> Iterator[str]:
    scenario, duration = facts.scenario, facts.scenario.simulation.duration
    times = scenario.target.time
    if times is not None and times[0] >= duration:
        yield f"target.time.0: got {times[0]:g} s in a run of {duration:g} s; nothing is followed"
    if scenario.target.start is not None and scenario.target.start >= duration:
        yield (
            f"target.start: got {scenario.target.start:g} s in a run of {duration:g} s; the path "
            "never sets in"
        )
    if scenario.control.kind != "none" and scenario.control.start >= duration:
        yield (
            f"control.start: got {scenario.control.start:g} s in a run of {duration:g} s; it is "
            "never switched on"
        )


def _delay(facts: Facts) -> Iterator[str]:
    delay, duration = facts.scenario.sensor.delay, facts.scenario.simulation.duration
    if facts.scenario.control.kind == "none" or not delay:
        return
    if delay >= duration:
        yield (
            f"sensor.delay: got {delay:g} s in a run of {duration:g} s; the controller never sees "
            "what it does; is it in ms?"
        )
    elif delay > facts.period:
        yield (
            f"sensor.delay: got {delay:g} s, longer than the arm's first period of about "
            f"{facts.period:.3g} s; is it in ms?"
        )


def _noise(facts: Facts) -> Iterator[str]:
    sensor = facts.scenario.sensor
    if sensor.noise_position > _NOISY * facts.length:
        yield (
            f"sensor.noise_position: got {sensor.noise_position:g} m on an arm of "
            f"{facts.length:g} m; up to a twentieth of the length is usual; is it in mm?"
        )
    if sensor.noise_angle_deg > _NOISY_ANGLE:
        yield (
            f"sensor.noise_angle_deg: got {sensor.noise_angle_deg:g} degrees; up to "
            f"{_NOISY_ANGLE:g} is usual"
        )


def _filter(facts: Facts) -> Iterator[str]:
    control, rate = facts.scenario.control, facts.scenario.control_rate_hz
    for name, gains in control.pid.present.items() if control.kind == "pid" else ():
        if gains.kd and gains.derivative_filter_hz > rate / 2 and (control.rate_hz or rate == 100):
            yield (
                f"control.pid.{name}.derivative_filter_hz: got {gains.derivative_filter_hz:g} Hz; "
                f"{rate:g} commands a second carry nothing above {rate / 2:g} Hz, so it filters "
                "nothing"
            )


LOOP = (
    Rule(
        ("target.tip", "target.to", "target.centre"),
        "within 1.05 lengths of the arm and the base's travel",
        _reach,
    ),
    Rule(("target.time", "target.start", "control.start"), "before the end of the run", _late),
    Rule(("sensor.delay",), "up to the arm's first period, and less than the run", _delay),
    Rule(
        ("sensor.noise_position", "sensor.noise_angle_deg"),
        "up to a twentieth of the arm's length; up to 20 degrees",
        _noise,
    ),
    Rule(("control.pid.*.derivative_filter_hz",), "up to half of control.rate_hz", _filter),
)
