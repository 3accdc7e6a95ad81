"""From the description of a load to the element that it is, and the numbers that it takes."""

import numpy as np

from crinoid.assembly.numbers import Numbers, array
from crinoid.elements import DistributedLoad, TipLoad
from crinoid.onset import Onset
from crinoid.scenario import Load, Scenario
from crinoid.scenario.load import TipLoad as TipTable

LoadElement = DistributedLoad | TipLoad


def load_numbers(load: Load, scenario: Scenario) -> tuple[type[LoadElement], Numbers]:
    """Return the element of a load, and what its ``of`` takes beside the rod."""
    stop = np.inf if load.stop is None else load.stop
    onset = {"onset": Onset(*map(array, (load.start, load.ramp_time, stop)))}
    if isinstance(load, TipTable):
        force, moment = array(load.force), array(load.moment)
        if load.follower:
            return TipLoad, onset | {"follower_force": force, "follower_moment": moment}
        return TipLoad, onset | {"dead_force": force, "moment": moment}
    fixed = np.zeros(scenario.arm.dimension)
    if not isinstance(load.direction, str):
        fixed = np.asarray(load.direction) / np.linalg.norm(load.direction)
    return DistributedLoad, onset | {
        "tangential": array(load.magnitude * (load.direction == "tangential")),
        "normal": array(load.magnitude * (load.direction == "normal")),
        "fixed": array(load.magnitude * fixed),
    }
