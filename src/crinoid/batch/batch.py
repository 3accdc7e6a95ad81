"""`crinoid.simulate_batch`: runs of one structure, summed up in one dataset."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from crinoid.batch.measures import EFFORT, MEASURES, Measures, measured
from crinoid.batch.records import stacked
from crinoid.batch.variation import Variation
from crinoid.dataset import describe
from crinoid.result import Result
from crinoid.scenario.library import Source, scenario_of
from crinoid.simulation import Progress
from crinoid.simulation.batch import Arm, run_batch
from crinoid.simulation.ctrl_c import CtrlC
from crinoid.simulation.setup import require_one_case
from crinoid.status import summed

__all__ = ["simulate_batch"]


class _Kept(NamedTuple):
    """The part of one run that is kept."""

    measures: Measures | None
    """None of a run that did not reach its end."""
    data: xr.Dataset | None


def simulate_batch(
    scenario: Source,
    over: Mapping[str, Sequence[Any] | np.ndarray] | None = None,
    seeds: int | Sequence[int] | np.ndarray | None = None,
    *,
    records: bool = False,
    report: Callable[[Progress], None] | None = None,
    stop: Callable[[], bool] | None = None,
    threads: int | None = None,
) -> xr.Dataset:
    """Run a scenario many times, with other numbers or seeds, and sum all runs up.

    Each run is the one that `simulate` does of the same scenario. A run that fails is told, and
    stops no other one. On a CPU runs are spread over threads; where JAX computes on an accelerator
    they take their time steps together, under `jax.vmap`.

    Parameters
    ----------
    scenario
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.
    over
        Dotted keys of the scenario, as ``--set`` takes them, each with a list of values, one for
        each run: the first run takes the first of each list. Not keys that change the compiled
        program, such as ``arm.nodes``.
    seeds
        Values of ``seed``, or their number: 3 is 0, 1 and 2. With ``over`` each of its entries runs
        with each seed, and the seeds change fastest.
    records
        Whether to keep the saved instants of all runs (``[output]``) as well.
    report
        Called about ten times a second with the `crinoid.simulation.Progress` of all runs together.
    stop
        Asked as often whether to stop; what is complete then is returned. Ctrl-C does by default.
    threads
        Runs that are computed at a time on a CPU; as many as there are cores if left out.

    Returns
    -------
    xarray.Dataset
        Along ``run``: coordinates of what varies and the ``seed``; ``status``, ``ok`` or what went
        wrong and when; ``notes``, a line each; the measures of ``crinoid compare`` and of a study
        with their units, NaN of a run that did not reach its end; and ``effort (run, driven)``.
        With ``records`` also the variables of a result, ``(run, time, ...)``, NaN from where a run
        ended.

    Raises
    ------
    ScenarioError
        If a key, a value or a seed is not what the scenario takes, with one line a mistake.
    ValueError
        If the scenario stands for several cases.
    """
    described = scenario_of(scenario)
    require_one_case(described)
    variation = Variation.of(described, over, seeds, records=records)

    def take(result: Result) -> _Kept:
        return _Kept(measured(result), result.dataset if records else None)

    def take_unfinished(result: Result) -> _Kept:
        return _Kept(None, result.dataset if records else None)

    with CtrlC() if stop is None else nullcontext(stop) as asked:
        arms = run_batch(
            variation.runs,
            take,
            take_unfinished=take_unfinished,
            report=report,
            stop=asked,
            threads=threads,
        )
    found = _sums(arms, variation.coordinates)
    if records:
        data = stacked([None if arm.taken is None else arm.taken.data for arm in arms])
        found = xr.merge([found, data], join="exact", combine_attrs="override")
    status = summed(arm.status for arm in arms)
    return found.assign_attrs(describe(described) | {"status": status})


def _sums(arms: Sequence[Arm[_Kept]], coordinates: dict[str, tuple[Any, ...]]) -> xr.Dataset:
    """Return what sums up each run."""
    complete = {
        row: arm.taken.measures
        for row, arm in enumerate(arms)
        if arm.taken is not None and arm.taken.measures is not None
    }
    units: dict[str, str] = {}
    for measures in complete.values():
        units |= measures.unit
    numbers = {name: np.full(len(arms), np.nan) for name in MEASURES}
    effort = np.full((len(arms), len(units)), np.nan)
    for row, measures in complete.items():
        for name, values in numbers.items():
            values[row] = measures.numbers[name]
        effort[row] = [measures.speed[name] for name in units]
    told = {
        "status": ([arm.status for arm in arms], "ok, or what went wrong and when"),
        "notes": (["\n".join(arm.notes) for arm in arms], "what is odd about a run, a line each"),
    }
    found: dict[str, tuple[Any, ...]] = {
        name: ("run", np.array(words, object), {"long_name": meaning})
        for name, (words, meaning) in told.items()
    }
    for name, values in numbers.items():
        found[name] = "run", values, MEASURES[name].attributes
    # CF has no unit for a mixture
    about = {"long_name": EFFORT, "comment": "in driven_unit"}
    found["effort"] = ("run", "driven"), effort, about
    return xr.Dataset(
        found,
        coordinates
        | {
            "driven": ("driven", list(units), {"long_name": "input that can move"}),
            "driven_unit": ("driven", list(units.values()), {"long_name": "unit of effort"}),
        },
    )
