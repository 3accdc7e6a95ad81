"""From the description of a load to the element that it is, and the numbers that it takes."""

from collections.abc import Callable

import numpy as np

from crinoid.assembly.door import made
from crinoid.assembly.numbers import Numbers, array
from crinoid.elements import DistributedLoad, Element, TipLoad
from crinoid.onset import Onset
from crinoid.scenario import Load, Scenario
from crinoid.scenario.load import DistributedLoad as DistributedTable
from crinoid.scenario.load import LoadTable
from crinoid.scenario.load import TipLoad as TipTable

Builder = Callable[..., Element]
"""Builds an element from a rod and numbers by name."""


def load_numbers(load: Load, index: int, scenario: Scenario) -> tuple[Builder, Numbers]:
    """Return what builds the element of load ``index``, and its arguments after the rod."""
    onset = {"onset": load_onset(load)}
    match load:
        case TipTable():
            force, moment = array(load.force), array(load.moment)
            if load.follower:
                return TipLoad.of, onset | {"follower_force": force, "follower_moment": moment}
            return TipLoad.of, onset | {"dead_force": force, "moment": moment}
        case DistributedTable():
            fixed = np.zeros(scenario.arm.dimension)
            if not isinstance(load.direction, str):
                fixed = np.asarray(load.direction) / np.linalg.norm(load.direction)
            return DistributedLoad.of, onset | {
                "tangential": array(load.magnitude * (load.direction == "tangential")),
                "normal": array(load.magnitude * (load.direction == "normal")),
                "fixed": array(load.magnitude * fixed),
            }
        case _:  # of an installed package
            return made(f"load {index}", 2, load.build, scenario)


def load_onset(load: LoadTable) -> Onset:
    """Return when and how a load sets in, and when it is taken off."""
    stop = np.inf if load.stop is None else load.stop
    return Onset(*map(array, (load.start, load.ramp_time, stop)))
