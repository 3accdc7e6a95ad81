"""Plausibility rules on the task of an arm: target, actuators and policy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from crinoid.assembly.description import KEY, PHYSICAL, Description
from crinoid.assembly.facts import Facts
from crinoid.diagnostics.plausibility.rule import rule
from crinoid.scenario import Chamber, ScenarioError, shown
from crinoid.scenario.actuator import keyed_threads
from crinoid.scenario.document import flat

Vector = Float[np.ndarray, " axis"]

_TURNS, _STRETCH = 3.0, 0.5
"""Largest usual turns and stretch of the free arm under a chamber or tendon."""
_PARTS = 32  # parts of a thread over which turns and stretch are integrated
_HARDLY = 1e-3  # turns and stretch below which it does not seem to move
_REACH = 1.05  # distance of a target from the base over the arm's length
_BENT = 0.05
"""Displacement of the tip over the arm's length by random water from which the start matters."""


@rule(
    *(f"target.{key}" for key in ("tip", "to", "centre", "radius", "amplitude", "file")),
    limit="within 1.05 lengths of the arm and the base's travel",
)
def _reach(facts: Facts) -> Iterator[str]:
    target = facts.scenario.target
    base = np.array(facts.scenario.base.position)
    root = np.zeros_like(base) if target.frame == "base" else base
    for key, points in _target_points(facts, root).items():
        farthest = float(np.linalg.norm(points, axis=1).max())
        if farthest > _REACH * facts.length + facts.travel:
            yield (
                f"target.{key}: got {shown(getattr(target, key))}, a target {farthest:.4g} m or "
                f"more from the base; length and travel reach {facts.length + facts.travel:.3g} m. "
                f"Is it in mm{', or seen from the base' if target.frame == 'world' else ''}?"
            )
            return


@rule(
    "target.tip",
    limit="where it stays initial: no random flow without a ramp that bends the arm by 5 % of its "
    "length at t = 0",
)
def _random_start(facts: Facts) -> Iterator[str]:
    scenario, water = facts.scenario, facts.scenario.water
    if scenario.target.tip != "initial" or scenario.target.moves:
        return
    blind = scenario.control.acts and not scenario.control.settings.feeds_back
    if blind or scenario.simulation.start != "equilibrium" or scenario.base.mount != "clamped":
        return
    acting = [i for i, flow in enumerate(scenario.flow) if not (flow.start or flow.ramp_time)]
    still = (0.0,) * scenario.arm.dimension
    means = [scenario.flow[index].uniform_mean or still for index in acting]
    mean = float(np.linalg.norm(np.sum(means, axis=0)))
    for index in acting:
        flow = scenario.flow[index]
        if not flow.drawn:
            continue
        own = math.hypot(*flow.uniform_mean or (0.0,))
        more = (mean + facts.speeds[index] - own) ** 2 - mean**2
        drag = 0.5 * water.density * water.drag_normal * facts.diameter * more
        if facts.limpness(drag, 3) / 8 > _BENT:
            key = f"flow.{index}"
            yield (
                f'target.tip: got "initial", the pose in the water of t = 0, where {key} '
                f"({flow.kind}) is at a random instant. Errors count from there. With "
                f"{key}.ramp_time the arm starts without it."
            )


def _target_points(facts: Facts, root: Vector) -> dict[str, Float[np.ndarray, "time axis"]]:
    """Return points relative to the base by key: known ones of the target, or no farther ones."""
    target, axes = facts.scenario.target, root.size
    found = {
        key: np.array(getattr(target, key), ndmin=2) - root
        for key in ("tip", "to", "centre")
        if getattr(target, key) not in (None, "initial")
    }
    # of two opposite points, as of a circle, one is at least so far from the base
    middle = found.get("centre", np.zeros((1, axes)))
    if target.radius is not None:
        found["radius"] = np.hypot(np.linalg.norm(middle), target.radius) * np.eye(1, axes)
    if target.amplitude is not None:
        found["amplitude"] = middle + np.multiply.outer([-1, 1], target.amplitude)
    if target.path == "file":
        _, points = facts.prepared.series["target"].during(facts.scenario.simulation.duration)
        found["file"] = points[:, :axes] - root
    return found


@rule(
    "chamber.*.max_pressure",
    "chamber.*.max_volume",
    "tendon.*.max_tension",
    "tendon.*.max_shortening",
    limit="up to 3 turns and a stretch of 50 % of the free arm, and a thousandth of either",
)
def _curling(facts: Facts) -> Iterator[str]:
    threads = keyed_threads(facts.scenario.chamber, facts.scenario.tendon)
    for key, thread in threads.items():
        area = thread.area if isinstance(thread, Chamber) else 1.0
        if area is None:
            continue
        at, span = np.linspace(*thread.span, 1 + _PARTS), float(np.ptp(thread.span)) * facts.length
        bending, stretching = facts.stiffness(at)
        offset = np.interp(at, thread.span, np.broadcast_to(thread.offset or 0.0, 2))
        force = thread.largest * area
        if not isinstance(thread, Chamber):
            force += thread.pretension
        if thread.lined:  # the force at which the free arm yields by the length or volume
            yielding = np.trapezoid(1 / stretching + offset**2 / bending, dx=1 / _PARTS)
            force = thread.largest / area / span / float(yielding)
        turns = force * float(np.trapezoid(offset / bending, dx=1 / _PARTS)) * span / (2 * math.pi)
        strain = force / float(stretching.min())
        moves = f"curls the free arm into {turns:.2g} turns and stretches it by {100 * strain:.3g}%"
        hint = "Are pressure and arm.youngs_modulus in Pa, the area in m2 and the offset in m?"
        if turns > _TURNS or strain > _STRETCH:
            usual = f"up to {_TURNS:g} turns and {_STRETCH:.0%}"
        elif max(turns, strain) < _HARDLY:
            usual = f"{_HARDLY:g} turns or {_HARDLY:.1%} or more"
        else:
            continue
        yield f"{key}.{thread.largest_key}: {moves}; usual is {usual}. {hint}"


@rule(KEY, limit="the arm, the water and the sensors on which its policy was trained")
def _training(facts: Facts) -> Iterator[str]:
    if (policy := facts.scenario.control.policy) is None:
        return
    try:
        trained = Description.of(Path(policy))
    except ScenarioError:
        return  # the assembly of the controller refuses it
    here, there = (dict(flat(each)) for each in (facts.scenario.to_dict(), trained.scenario))
    standard, found = dict(flat(type(facts.scenario)().to_dict())), []
    for key in dict.fromkeys([*here, *there, *trained.draw]):
        if key not in trained.draw and key.split(".")[0] not in PHYSICAL:
            continue
        # a key that is newer than the policy had its default
        low, high = trained.draw.get(key, [there.get(key, standard.get(key))] * 2)
        if not _within(here.get(key), low, high):
            met = _number(low) if low == high else f"{_number(low)} to {_number(high)}"
            found.append(f"{key} = {_number(here.get(key))} (trained on {met})")
    if found:
        more = f" and {len(found) - 3} more" if len(found) > 3 else ""
        words = ", ".join(found[:3])
        yield f"{KEY}: the policy has not met {words}{more}, and may fail"


def _number(value: Any) -> str:
    return "none" if value is None else f"{value:.4g}" if isinstance(value, float) else shown(value)


def _within(got: Any, low: Any, high: Any) -> bool:
    if not all(isinstance(each, int | float) for each in (got, low, high)):
        return bool(got == low)
    room = 1e-6 * max(abs(low), abs(high))
    return bool(low - room <= got <= high + room)


TASK_CHECKS = (_reach, _random_start, _curling, _training)
