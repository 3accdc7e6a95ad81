"""Target, sensor and controller against the arm and the run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import Target, shown
from crinoid.scenario.quantity import unit_vector

_Point = Float[np.ndarray, " axis"]
_Points = Float[np.ndarray, "time axis"]

_STRETCHED = 1.05
_NOISY = 0.05
"""Standard deviation of the sensor's noise over the length of the arm."""
_NOISY_ANGLE = 20.0


def _reach(facts: Facts) -> Iterator[str]:
    target = facts.scenario.target
    base = np.array(facts.scenario.base.position)
    root = np.zeros_like(base) if target.frame == "base" else base
    reach = _STRETCHED * facts.length + facts.travel
    for key, points in _wanted(facts, root).items():
        farthest = float(np.linalg.norm(points, axis=1).max())
        if farthest > reach:
            yield (
                f"target.{key}: got {shown(getattr(target, key))}, a target {farthest:.4g} m from "
                f"the base; length and travel reach {facts.length + facts.travel:.3g} m; is it in "
                f"mm{', or seen from the base' if target.frame == 'world' else ''}?"
            )
            return


def _wanted(facts: Facts, root: _Point) -> dict[str, _Points]:
    """Return what is known of where the tip should be, seen from the base, by key."""
    target, axes = facts.scenario.target, root.size
    found: dict[str, _Points] = {}
    if target.tip != "initial":
        found["tip"] = np.array(target.tip, ndmin=2) - root
    if target.to is not None:
        found["to"] = np.array([target.to]) - root
    if target.centre is not None:
        found["centre"] = np.array([target.centre]) - root
    centre = found.get("centre")
    if target.radius is not None:
        found["radius"] = np.array([_far_on_circle(target, centre, axes)])
    if target.amplitude is not None:
        # without a centre: two points are so far apart that one of them is as far from the base
        middle = np.zeros((1, axes)) if centre is None else centre
        found["amplitude"] = middle + np.multiply.outer([-1, 1], target.amplitude)
    if target.path == "file":
        _, points = facts.prepared.series["target"].during(facts.scenario.simulation.duration)
        found["file"] = points[:, :axes] - root
    return found


def _far_on_circle(target: Target, centre: _Points | None, axes: int) -> _Point:
    """Return the point of a circle that is farthest from the base, or one that is nearer."""
    radius = target.radius or 0.0
    if centre is None:  # two points are so far apart that one of them is as far from the base
        return radius * np.eye(axes)[0]
    (across,) = centre
    if across.size == 3:
        normal = np.array(unit_vector(target.normal or (0.0, -1.0, 0.0)))
        across = across - (across @ normal) * normal
    length = float(np.linalg.norm(across))
    return centre[0] + (radius * across / length if length else 0.0)


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
        (
            "target.tip",
            "target.to",
            "target.centre",
            "target.radius",
            "target.amplitude",
            "target.file",
        ),
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
