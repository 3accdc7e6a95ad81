"""Loads and weight against what bends, stretches and buckles the arm."""

import math
from collections.abc import Iterator

import numpy as np

from crinoid.plausibility.facts import Facts
from crinoid.plausibility.rule import Rule
from crinoid.scenario import DistributedLoad, TipLoad

_LIMP = 1000.0
"""Force times length squared over EI; of a force per length, times length cubed."""
_TOLD = 10.0
"""Speed of the water (m/s) that is told as such."""
_STRAIN = 0.3
_WOUND = 20.0
"""Moment times length over EI: three turns."""
_EULER = math.pi**2 / 4
"""Force over EI / length^2 at which a cantilever buckles."""
_GREENHILL = 7.837
"""Force per length over EI / length^3 at which a cantilever buckles (Greenhill 1881)."""
_BECK = 20.05
"""Force that follows the tip, over EI / length^2, under which it flutters (Beck 1952)."""


def _size(facts: Facts) -> Iterator[str]:
    bending, length = float(facts.bending.max()), facts.length
    for index, load in enumerate(facts.scenario.load):
        key = f"load.{index}"
        if isinstance(load, TipLoad):
            force, given = math.hypot(*load.force), load.moment
            moment = math.hypot(*given) if isinstance(given, tuple) else abs(given)
            got, unit = f"{key}.force: got {force:g} N", "it is"
            bent = force * length**2 / bending
            if moment * length / bending > _WOUND:
                yield (
                    f"{key}.moment: got {moment:g} N m, which winds the arm up "
                    f"{moment * length / bending / (2 * math.pi):.2g} times; is it in N mm?"
                )
        elif isinstance(load, DistributedLoad):
            force = abs(load.magnitude) * length
            got, unit = f"{key}.magnitude: got {load.magnitude:g} N/m", "times the length it is"
            bent = abs(load.magnitude) * length**3 / bending
        else:
            continue
        if force > _STRAIN * facts.stretching:
            yield (
                f"{got}; {unit} {force / facts.stretching:.2g} of the arm's EA "
                f"({facts.stretching:.3g} N), more than it may be strained by; is "
                "arm.youngs_modulus in kPa or MPa?"
            )
        elif bent > _LIMP:
            yield (
                f"{got}, {bent:.2g} times what EI and length of the arm stand against "
                f"(up to {_LIMP:g} is usual); is it in mN, or arm.youngs_modulus in kPa or MPa?"
            )
    for name, (push, couple) in facts.foreign[1].items():
        for got, times, most in (
            (f"{push:.3g} N", push * length**2 / bending, _LIMP),
            (f"{couple:.3g} N m", couple * length / bending, _WOUND),
        ):
            if times > most:
                yield (
                    f"load: {name} puts {got} on the arm, {times:.2g} times the scale of EI and "
                    f"length (up to {most:g} is usual); is it in mN or N mm?"
                )


def _buckling(facts: Facts) -> Iterator[str]:
    scenario, along = facts.scenario, np.array(facts.direction)
    if scenario.base.mount != "clamped":
        return
    bending, length = float(facts.bending.min()), facts.length
    for index, load in enumerate(scenario.load):
        if isinstance(load, TipLoad):
            forward = load.force[0] if load.follower else float(along @ load.force)
            most = (_BECK if load.follower else _EULER) * bending / length**2
            if -forward > most:
                does = "sets it swinging" if load.follower else "buckles it"
                yield (
                    f"load.{index}.force: pushes the arm back along itself with {-forward:.3g} N; "
                    f"more than {most:.2g} N {does}, and which way is chance"
                )
        elif isinstance(load, DistributedLoad) and isinstance(load.direction, tuple):
            way = np.array(load.direction) / math.hypot(*load.direction)
            pushed, most = -load.magnitude * float(along @ way), _GREENHILL * bending / length**3
            if pushed > most:
                yield (
                    f"load.{index}.magnitude: pushes the arm back along itself with {pushed:.3g} "
                    f"N/m; more than {most:.2g} N/m buckles it, and which way is chance"
                )


def _weight(facts: Facts) -> Iterator[str]:
    gravity = facts.scenario.water.gravity
    weight = gravity * float((facts.mass - facts.displaced).mean())
    bending, length = float(facts.bending.min()), facts.length
    got = f"arm.youngs_modulus: got {facts.scenario.arm.youngs_modulus:g} Pa"
    if facts.scenario.arm.section.EI is not None:
        got = f"arm.section.EI: got {bending:g} N m2"
    bent = abs(weight) * length**3 / float(facts.bending.max())
    pushed, most = weight * facts.direction[-1], _GREENHILL * bending / length**3
    if bent > _LIMP:
        yield (
            f"{got}; the arm's weight in the water ({weight:.3g} N/m) is {bent:.2g} times what EI "
            f"and length stand against (up to {_LIMP:g} is usual); is it in kPa or MPa?"
        )
    elif facts.scenario.control.kind == "hybrid":  # which brings up what does not stand
        return
    elif pushed > most and facts.scenario.base.mount == "clamped":
        yield (
            f"{got}; the arm points {'up' if weight > 0 else 'down'} and buckles under its "
            f"{'weight' if weight > 0 else 'buoyancy'} of {abs(weight):.3g} N/m: it holds "
            f"{most / abs(facts.direction[-1]):.2g} N/m, and which way it goes is chance"
        )


def _drag(facts: Facts) -> Iterator[str]:
    water = facts.scenario.water
    drag = 0.5 * water.density * water.drag_normal * facts.diameter * facts.current**2
    bent = drag * facts.length**3 / float(facts.bending.max())
    if bent > _LIMP and facts.current < _TOLD:
        yield (
            f"flow: gets up to {facts.current:.3g} m/s; the drag of {drag:.3g} N/m is {bent:.2g} "
            f"times what EI and length of the arm stand against (up to {_LIMP:g} is usual); is "
            "arm.youngs_modulus in kPa or MPa?"
        )


LOAD = (
    Rule(
        ("load.*.force", "load.*.magnitude", "load.*.moment"),
        "a strain of up to 0.3; F L^2 / EI and q L^3 / EI up to 1000, M L / EI up to 20; a "
        "load of a package by its sums of force and couple on the arm at rest",
        _size,
    ),
    Rule(
        ("load.*.force", "load.*.magnitude"),
        "a push along the arm up to what buckles it (Euler, Greenhill), or makes it flutter (Beck)",
        _buckling,
        "buckling",
    ),
    Rule(
        ("arm.youngs_modulus", "arm.section.EI"),
        "a weight in water w with w L^3 / EI up to 1000; on an arm that points up, 7.8",
        _weight,
    ),
    Rule(("flow",), "a drag q of all flows together with q L^3 / EI up to 1000", _drag),
)
