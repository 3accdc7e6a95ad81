"""The workers that a sweep is given."""

import os
from typing import NamedTuple

from crinoid.scenario import Mistake, ScenarioError
from crinoid.simulation.batch import cores
from crinoid.sweep import Crew, CrewError

_ONE_THREAD = ("NPROC", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables that keep XLA and linear algebra of a worker to one thread."""


class Hands(NamedTuple):
    """Wishes of a user about workers."""

    workers: int | None
    scheduler: str | None


def check_hands(hands: Hands) -> None:
    """Refuse what does not go together."""
    if hands.workers is not None and hands.scheduler is not None:
        text = "takes no --scheduler beside it, whose workers are those that it has"
        raise ScenarioError([Mistake("--workers", text)])
    if hands.workers is not None and hands.workers < 1:
        text = f"got {hands.workers}, takes a number of 1 or more"
        raise ScenarioError([Mistake("--workers", text)])


def count_of(hands: Hands) -> int:
    """Return how many workers there will be on this machine."""
    return hands.workers or cores()


def open_crew(hands: Hands) -> Crew:
    """Start workers, or find those of a scheduler; without dask.distributed they are processes."""
    for name in _ONE_THREAD:
        os.environ.setdefault(name, "1")
    try:
        from crinoid.sweep.cluster import Cluster
    except ImportError:
        if hands.scheduler is not None:
            text = "needs dask.distributed: pip install 'crinoid[sweep]'"
            raise ScenarioError([Mistake("--scheduler", text)]) from None
        from crinoid.sweep.processes import Processes

        return Processes(count_of(hands))
    try:
        return Cluster(count_of(hands), hands.scheduler)
    except CrewError as error:
        raise ScenarioError([Mistake("--scheduler", str(error))]) from error
