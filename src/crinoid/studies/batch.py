"""`crinoid.simulate_batch`: runs that differ in values or seeds, as one dataset."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from typing import Any

import jax
import numpy as np
import xarray as xr

from crinoid.assembly.prepared import Prepared, require_one_case
from crinoid.foundation.status import summed
from crinoid.results.dataset import describe
from crinoid.results.metrics import Measures, measured, measures_of
from crinoid.results.result import Result
from crinoid.scenario import Scenario, ScenarioError, counted, got, refusal, shown
from crinoid.scenario.errors import mistakes_at
from crinoid.scenario.library import Source, scenario_of
from crinoid.scenario.variation import Levels
from crinoid.simulation import Progress
from crinoid.simulation.batch import run_batch
from crinoid.simulation.run import CtrlC
from crinoid.studies.design import SEED, Design
from crinoid.studies.measures import stacked, tabulated

_SHAPING = ("control", "sensor", "sensors", "target")
"""Tables that `crinoid.assembly.parameters.Parameters` describe in part only."""


def batch_of(
    scenario: Scenario, over: Any, seeds: Any, *, records: bool
) -> tuple[Design, list[Scenario]]:
    """Return each entry of ``over`` with each seed as a design, and its cases.

    All have the same compiled programs, and with ``records`` also the same instants.
    """
    columns, drawn = _columns(over), _seeds(scenario, seeds)
    if not columns and drawn is None:
        raise refusal("over", "missing, like seeds. Pass at least one of them.")
    if SEED in columns and drawn is not None:
        raise refusal("seeds", f"excludes over[{shown(SEED)}]. Pass one of the two.")
    rows = zip(*columns.values(), strict=True)
    entries = [dict(zip(columns, row, strict=True)) for row in rows] if columns else [{}]
    repeated = {} if drawn is None else {SEED: Levels.of(SEED, drawn)}
    design = Design(scenario, {"over": Levels(len(entries), entries.__getitem__)} | repeated)
    repeats, cases = design.runs // len(entries), []
    for run in range(design.runs):
        with mistakes_at("", f"over: entry {run // repeats}, "):
            cases.append(design.case(run + 1))
    _require_alike(scenario, entries, cases[::repeats], structure, _OTHER_STRUCTURE)
    if records:
        _require_alike(scenario, entries, cases[::repeats], _instants, _OTHER_INSTANTS)
    return design, cases


def _columns(over: Any) -> dict[str, list[Any]]:
    """Return the values by key, as lists of one length."""
    if over is not None and not isinstance(over, Mapping):
        raise refusal("over", got(over, "map keys to lists of values"))
    found = {}
    for key, given in (over or {}).items():
        values = given.tolist() if hasattr(given, "tolist") else given
        if not isinstance(values, (list, tuple, range)):
            raise refusal("over", f"{key}: {got(values, 'be a list with a value for each run')}")
        if not values:
            raise refusal("over", f"{key}: got no values; must have at least one")
        found[key] = [value.tolist() if hasattr(value, "tolist") else value for value in values]
    lengths = {key: len(values) for key, values in found.items()}
    if len(set(lengths.values())) > 1:
        sizes = ", ".join(f"{counted(size, 'value')} of {key}" for key, size in lengths.items())
        raise refusal("over", f"got {sizes}; must have as many of each")
    return found


def _seeds(scenario: Scenario, given: Any) -> list[Any] | None:
    if given is None:
        return None
    if hasattr(given, "tolist"):
        given = given.tolist()
    if isinstance(given, int) and not isinstance(given, bool) and given > 0:
        return list(range(given))
    if not isinstance(given, (list, tuple, range)) or not given:
        raise refusal("seeds", got(given, "be a number of at least 1, or a list of seeds"))
    for row, seed in enumerate(given):
        with mistakes_at("", f"seeds: entry {row}, "):
            scenario.with_values({SEED: seed})
    return list(given)


_OTHER_STRUCTURE = (
    "which changes the compiled program that runs of a batch share. Make a batch for each, or a "
    "study with [vary]."
)
_OTHER_INSTANTS = (
    "which changes the saved instants, which runs of a batch share with records. Set "
    "output.interval so that they do, or make a batch for each."
)


def _require_alike(
    scenario: Scenario,
    entries: Sequence[Mapping[str, Any]],
    cases: Sequence[Scenario],
    trait: Callable[[Scenario], Any],
    why: str,
) -> None:
    """Refuse entries that differ from the first one in what all runs must share."""
    wanted = trait(cases[0])
    for row, case in enumerate(cases):
        if trait(case) == wanted:
            continue
        for key, value in entries[row].items():
            try:
                other = scenario.with_values({**entries[0], key: value})
            except ScenarioError:  # it needs the other changes
                continue
            if trait(other) != wanted:
                break
        first = shown(entries[0][key])
        raise refusal("over", f"entry {row}, {key}: got {shown(value)} after {first}, {why}")


def structure(scenario: Scenario) -> Any:
    """Return the traits of a scenario that determine its programs and the sizes of results."""
    numbers, tree = jax.tree.flatten(Prepared(scenario).parameters)
    document = scenario.to_dict()
    tables = [_without_numbers(document.get(name)) for name in _SHAPING]
    return tree, [(number.shape, number.dtype) for number in numbers], tables


def _without_numbers(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_numbers(item) for item in value]
    return None if isinstance(value, float) else value


def _instants(scenario: Scenario) -> tuple[float, float]:
    duration = scenario.simulation.steps * scenario.simulation.time_step
    return float(f"{scenario.output_interval:.9g}"), float(f"{duration:.9g}")


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

    Each run equals that of `simulate` with the same scenario. A run that fails is reported, and
    stops no other one. On a CPU runs are spread over threads; where JAX computes on an accelerator
    they advance together, under `jax.vmap`.

    Parameters
    ----------
    scenario : Scenario, str or path
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.
    over : mapping of str to sequence
        Dotted keys of the scenario, as for ``--set``, each with a list of values, one for each run:
        the first run has the first of each list. Not keys that change the compiled
        program, such as ``arm.nodes``.
    seeds : int or sequence of int
        Values of ``seed``, or their number: 3 is 0, 1 and 2. With ``over`` each of its entries runs
        with each seed, and the seeds change fastest.
    records : bool
        Whether to keep the saved instants of all runs (``[output]``) as well.
    report : function
        Called about ten times a second with the `crinoid.simulation.Progress` of all runs together.
    stop : function
        Asked as often whether to stop; the complete runs are returned. Ctrl-C does by default.
    threads : int
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
        If a key, a value or a seed is wrong, with one line a mistake.
    ValueError
        If the scenario has several cases.

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "simulation.duration=0.2"])
    >>> runs = crinoid.simulate_batch(scenario, {"arm.youngs_modulus": [4e5, 5e5]})  # Pa
    >>> runs.status.values.tolist()
    ['ok', 'ok']
    >>> runs.rms_error.round(3).values.tolist(), runs.rms_error.units
    ([0.211, 0.178], 'm')
    """
    described = scenario_of(scenario)
    require_one_case(described)
    design, cases = batch_of(described, over, seeds, records=records)

    def data_of(result: Result) -> xr.Dataset | None:
        return result.dataset if records else None

    with CtrlC() if stop is None else nullcontext(stop) as asked:
        arms = run_batch(
            cases,
            lambda result: (measured(result), data_of(result)),
            take_unfinished=lambda result: (None, data_of(result)),
            report=report,
            stop=asked,
            threads=threads,
            steps=sum(run.simulation.steps for run in cases),
        )
    taken: list[tuple[Measures | None, xr.Dataset | None]]
    taken = [(None, None) if arm.taken is None else arm.taken for arm in arms]
    status, registry = np.array([arm.status for arm in arms], object), measures_of(described)
    numbers = [measures for measures, _ in taken]
    found = tabulated(("run",), numbers, status, registry, along="driven")
    found = found.assign_coords(design.coordinates())
    notes = np.array(["\n".join(arm.notes) for arm in arms], object)
    found["notes"] = "run", notes, {"long_name": "notes on a run, a line each"}
    if records:
        data = stacked([data for _, data in taken])
        found = xr.merge([found, data], join="exact", combine_attrs="override")
    return found.assign_attrs(describe(described) | {"status": summed(status)})
