"""`crinoid.simulate_batch`: runs that differ in values or seeds, as one dataset."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from typing import Any, NamedTuple

import jax
import numpy as np
import xarray as xr

from crinoid.assembly.prepared import Prepared, require_one_case
from crinoid.foundation.status import summed
from crinoid.results.dataset import describe
from crinoid.results.metrics import Measures, measured, measures_of
from crinoid.results.result import Result
from crinoid.scenario import Mistake, Scenario, ScenarioError, counted, got, refusal, shown
from crinoid.scenario.kinds import unit_at
from crinoid.scenario.library import Source, scenario_of
from crinoid.scenario.scenario import scenario_schema
from crinoid.simulation import Progress
from crinoid.simulation.batch import run_batch
from crinoid.simulation.run import CtrlC
from crinoid.studies.measures import stacked, tabulated

_DRAWN = "seed"
"""Key of everything random."""
_SHAPING = ("control", "sensor", "sensors", "target")
"""Tables that `crinoid.assembly.parameters.Parameters` describe in part only."""


class Variation(NamedTuple):
    """The runs of a batch, of which all have the same compiled programs."""

    runs: list[Scenario]
    coordinates: dict[str, tuple[Any, ...]]
    """The keys that vary and the seed, along ``run``, for xarray."""

    @staticmethod
    def of(scenario: Scenario, over: Any, seeds: Any, *, records: bool) -> Variation:
        """Return the runs, each entry of ``over`` with each seed, the seeds changing fastest.

        With ``records`` all runs must have the same instants.
        """
        columns, drawn = _columns(over), _seeds(seeds)
        if not columns and drawn is None:
            raise refusal("over", "missing, like seeds. Pass at least one of them.")
        if _DRAWN in columns and drawn is not None:
            raise refusal("seeds", f"excludes over[{shown(_DRAWN)}]. Pass one of the two.")
        count = len(next(iter(columns.values()), [None]))
        entries = [{key: values[row] for key, values in columns.items()} for row in range(count)]
        cases = [_placed(f"over: entry {n}, ", scenario, each) for n, each in enumerate(entries)]
        _require_alike(scenario, entries, cases, structure, _OTHER_STRUCTURE)
        if records:
            _require_alike(scenario, entries, cases, _instants, _OTHER_INSTANTS)
        runs = cases
        if drawn is not None:
            runs = [
                _placed(f"seeds: entry {row}, ", case, {_DRAWN: seed})
                for case in cases
                for row, seed in enumerate(drawn)
            ]
        repeats = len(runs) // count
        coordinates = {
            key: coordinate(key, [value for value in values for _ in range(repeats)])
            for key, values in columns.items()
        }
        coordinates[_DRAWN] = coordinate(_DRAWN, [run.seed for run in runs])
        return Variation(runs, coordinates)


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


def _seeds(given: Any) -> list[Any] | None:
    if given is None:
        return None
    if hasattr(given, "tolist"):
        given = given.tolist()
    if isinstance(given, int) and not isinstance(given, bool) and given > 0:
        return list(range(given))
    if not isinstance(given, (list, tuple, range)) or not given:
        raise refusal("seeds", got(given, "be a number of at least 1, or a list of seeds"))
    return list(given)


def _placed(where: str, scenario: Scenario, values: Mapping[str, Any]) -> Scenario:
    """Return a scenario with other values; add to mistakes the entry that they are in."""
    try:
        return scenario.with_values(values)
    except ScenarioError as error:
        mistakes = [Mistake("", f"{where}{mistake}") for mistake in error.mistakes]
        raise ScenarioError(mistakes) from error


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


def coordinate(key: str, values: list[Any]) -> tuple[Any, ...]:
    """Return a key's values along ``run``; tables and lists of other lengths as JSON."""
    unit = unit_at(scenario_schema(), key)
    about = {"long_name": "seed of everything random" if key == _DRAWN else key}
    about |= {"units": unit} if unit else {}
    try:
        found = np.array(values)
    except ValueError:  # lists of several lengths
        found = np.array(None)
    if found.dtype.kind not in "biufU":
        found = np.array([json.dumps(value) for value in values])
    if found.dtype.kind == "U":
        found = found.astype(object)
    return ("run", *(f"{key}.{axis}" for axis in range(found.ndim - 1))), found, about


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
    variation = Variation.of(described, over, seeds, records=records)

    def data_of(result: Result) -> xr.Dataset | None:
        return result.dataset if records else None

    with CtrlC() if stop is None else nullcontext(stop) as asked:
        arms = run_batch(
            variation.runs,
            lambda result: (measured(result), data_of(result)),
            take_unfinished=lambda result: (None, data_of(result)),
            report=report,
            stop=asked,
            threads=threads,
            steps=sum(run.simulation.steps for run in variation.runs),
        )
    taken: list[tuple[Measures | None, xr.Dataset | None]]
    taken = [(None, None) if arm.taken is None else arm.taken for arm in arms]
    complete = {(row,): measures for row, (measures, _) in enumerate(taken) if measures}
    status = np.array([arm.status for arm in arms], object)
    found = tabulated(("run",), complete, status, measures_of(described), along="driven")
    found = found.assign_coords(variation.coordinates)
    notes = np.array(["\n".join(arm.notes) for arm in arms], object)
    found["notes"] = "run", notes, {"long_name": "notes on a run, a line each"}
    if records:
        data = stacked([data for _, data in taken])
        found = xr.merge([found, data], join="exact", combine_attrs="override")
    return found.assign_attrs(describe(described) | {"status": summed(status)})
