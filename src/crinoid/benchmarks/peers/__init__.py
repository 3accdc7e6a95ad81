"""Other programs that can state an arm of the releases: one file each."""

import time
from collections.abc import Callable
from importlib import import_module
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.benchmarks.releases import Release

Tips = Float[np.ndarray, "sample axis"]
"""Tip at each sample from the clamp, x, z or x, y, z (m); NaN from where an engine fails."""
Swing = Callable[[], tuple[Tips, float]]
"""A run from the start, without building and compiling; it returns tips and its time (s)."""


class Engine(NamedTuple):
    """A program that lets an arm go."""

    name: str
    states: tuple[str, ...]
    """Names of the releases that it can state."""
    omits: str
    """What it leaves out of the physics or does otherwise, in words."""
    order: int
    """Order in the time step."""
    meshes: tuple[int, ...]
    """Numbers of nodes, or of segments, from coarse to fine."""
    steps: tuple[float, float]
    """Largest and smallest time step (s)."""
    prepare: Callable[[Release, int, float], Swing]
    """Return the run of a release with some nodes and a time step (s)."""


def clocked(swing: Callable[[], Tips]) -> Swing:
    """Return a run that measures its time."""

    def run() -> tuple[Tips, float]:
        start = time.perf_counter()
        tips = swing()
        return tips, time.perf_counter() - start

    return run


PEERS = ("mujoco", "pyelastica", "soromox", "moordyn", "cabledyn")
"""Modules of the peers."""


def find_peers() -> tuple[tuple[Engine, ...], list[str]]:
    """Return the peers that are installed, and a line for each that is not."""
    found, missing = [], []
    for name in PEERS:
        try:
            found.append(import_module(f"{__name__}.{name}").ENGINE)
        except ImportError as error:
            missing.append(f"{name} is left out ({error}): pip install 'crinoid[bench]'")
    return tuple(found), missing
