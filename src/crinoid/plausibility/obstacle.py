"""Obstacles against the arm that meets them."""

import math
from collections.abc import Iterator

import numpy as np

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import shown
from crinoid.scenario.obstacle import Plane, Sphere

_HUGE, _TINY = 100.0, 0.02
"""Radius over the arm's length, and over its radius."""
_DENSITY = (20.0, 12e3)


def _radius(facts: Facts) -> Iterator[str]:
    for index, obstacle in enumerate(facts.scenario.obstacle):
        if isinstance(obstacle, Plane):
            continue
        got = f"obstacle.{index}.radius: got {obstacle.radius:g} m"
        if obstacle.radius > _HUGE * facts.length:
            yield f"{got}; more than {_HUGE:g} lengths of the arm are a wall; is it in mm?"
        elif obstacle.radius < _TINY * facts.diameter / 2:
            yield f"{got}; less than a fiftieth of the arm's radius is a wire; is it in km?"


def _mass(facts: Facts) -> Iterator[str]:
    for index, obstacle in enumerate(facts.scenario.obstacle):
        if not isinstance(obstacle, Sphere) or obstacle.mass is None:
            continue
        density = obstacle.mass / (4 / 3 * math.pi * obstacle.radius**3)
        if not _DENSITY[0] <= density <= _DENSITY[1]:
            yield (
                f"obstacle.{index}.mass: got {obstacle.mass:g} kg on a radius of "
                f"{obstacle.radius:g} m, a density of {density:.2g} kg/m3; "
                f"{_DENSITY[0]:g} to {_DENSITY[1]:g} kg/m3 is usual; is it in g?"
            )


def _meeting(facts: Facts) -> Iterator[str]:
    scenario, base = facts.scenario, np.array(facts.scenario.base.position)
    reach = facts.length + facts.travel + facts.diameter / 2
    for index, obstacle in enumerate(scenario.obstacle):
        if obstacle.velocity == "flow" or (isinstance(obstacle, Sphere) and obstacle.mass):
            continue  # it goes where the water and its weight take it
        far = np.array(obstacle.position) - base
        path = np.array(obstacle.velocity) * scenario.simulation.duration
        if isinstance(obstacle, Plane):
            out = np.array(obstacle.out)
            gap = min(-float(far @ out), -float((far + path) @ out))
        else:
            half = np.array(obstacle.half_axis)
            corners = [far - half, far + half, far + path + half, far + path - half]
            gap = _nearest(corners) - obstacle.radius
        if gap > reach:
            yield (
                f"obstacle.{index}.position: got {shown(obstacle.position)}, {gap:.3g} m from the "
                f"base at its nearest; length and travel reach {reach:.3g} m, so the arm never "
                "meets it"
            )


def _nearest(corners: list[np.ndarray]) -> float:
    """Return the distance of the origin from a parallelogram: from its inside, or its edges."""
    first, second = corners[1] - corners[0], corners[3] - corners[0]
    sides = np.stack([first, second], axis=1)
    share = np.linalg.lstsq(sides, -corners[0], rcond=None)[0]
    if np.all((share >= 0) & (share <= 1)):
        return float(np.linalg.norm(corners[0] + sides @ share))
    edges = zip(corners, [*corners[1:], corners[0]], strict=True)
    return min(float(np.linalg.norm(_closest(start, end))) for start, end in edges)


def _closest(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the point of a segment that is closest to the origin."""
    way = end - start
    share = np.clip(-(start @ way) / max(float(way @ way), np.finfo(float).tiny), 0.0, 1.0)
    return start + share * way


OBSTACLE = (
    Rule(
        ("obstacle.*.radius",),
        "1/50 of the arm's radius to 100 of its lengths",
        _radius,
    ),
    Rule(("obstacle.*.mass",), "a density of 20 to 12000 kg/m3", _mass),
    Rule(("obstacle.*.position",), "where the arm reaches it some time", _meeting),
)
