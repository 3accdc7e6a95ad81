"""Runs that differ in values of keys, or in seeds."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import jax
import numpy as np

from crinoid.assembly.prepared import Prepared
from crinoid.scenario import Mistake, Scenario, ScenarioError, counted, shown
from crinoid.scenario.keys import unit_at

__all__ = ["Variation", "coordinate", "structure"]

_DRAWN = "seed"
"""The key of what is random."""
_SHAPING = ("control", "sensor", "sensors", "target")
"""Tables that no `crinoid.assembly.parameters.Parameters` tells all of."""


class Variation(NamedTuple):
    """The runs of a batch, of which all have the same compiled programs."""

    runs: list[Scenario]
    coordinates: dict[str, tuple[Any, ...]]
    """The keys that vary and the seed, along ``run``, for xarray."""

    @staticmethod
    def of(scenario: Scenario, over: Any, seeds: Any, *, records: bool) -> Variation:
        """Return the runs, each entry of ``over`` with each seed, the seeds changing fastest.

        Parameters
        ----------
        scenario
            One case.
        over, seeds
            As `crinoid.simulate_batch` takes them.
        records
            Whether all runs are to have the same instants.
        """
        columns, drawn = _columns(over), _seeds(seeds)
        if not columns and drawn is None:
            _refuse("over", "missing, and so are seeds; takes at least one of them")
        if _DRAWN in columns and drawn is not None:
            _refuse("seeds", f"given beside over[{shown(_DRAWN)}], takes one of the two")
        count = len(next(iter(columns.values()), [None]))
        entries = [{key: values[row] for key, values in columns.items()} for row in range(count)]
        cases = [
            _placed(f"over: entry {row}, ", scenario, each) for row, each in enumerate(entries)
        ]
        _require_alike(scenario, entries, cases, structure, _OTHER_STRUCTURE)
        if records:
            _require_alike(scenario, entries, cases, _instants, _OTHER_INSTANTS)
        runs = cases
        if drawn is not None:
            draws = list(enumerate(drawn))
            runs = [
                _placed(f"seeds: entry {row}, ", case, {_DRAWN: seed})
                for case in cases
                for row, seed in draws
            ]
        repeats = len(runs) // count
        coordinates = {
            key: coordinate(key, [value for value in values for _ in range(repeats)])
            for key, values in columns.items()
        }
        about = {"long_name": "seed of everything random"}
        coordinates[_DRAWN] = ("run", [run.seed for run in runs], about)
        return Variation(runs, coordinates)


def _columns(over: Any) -> dict[str, list[Any]]:
    """Return the values by key, as lists of one length."""
    if over is not None and not isinstance(over, Mapping):
        _refuse("over", f"got {shown(over)}, takes keys, each with a list of values")
    found = {}
    for key, given in (over or {}).items():
        values = given.tolist() if hasattr(given, "tolist") else given
        if not isinstance(values, (list, tuple, range)):
            _refuse("over", f"{key}: got {shown(values)}, takes a list, with a value for each run")
        if not values:
            _refuse("over", f"{key}: got no values, takes one or more")
        found[key] = [value.tolist() if hasattr(value, "tolist") else value for value in values]
    lengths = {key: len(values) for key, values in found.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{counted(size, 'value')} of {key}" for key, size in lengths.items())
        _refuse("over", f"got {told}; takes as many of each")
    return found


def _seeds(given: Any) -> list[Any] | None:
    if given is None:
        return None
    if hasattr(given, "tolist"):
        given = given.tolist()
    if isinstance(given, int) and not isinstance(given, bool) and given > 0:
        return list(range(given))
    if not isinstance(given, (list, tuple, range)) or not given:
        _refuse("seeds", f"got {shown(given)}, takes a number of 1 or more, or a list of seeds")
    return list(given)


def _placed(where: str, scenario: Scenario, values: Mapping[str, Any]) -> Scenario:
    """Return a scenario with other values; tell of a mistake which entry it is in."""
    try:
        return scenario.with_values(values)
    except ScenarioError as error:
        raise ScenarioError(
            Mistake("", f"{where}{mistake}") for mistake in error.mistakes
        ) from error


_OTHER_STRUCTURE = (
    "which changes the compiled program; the runs of a batch share theirs: take a batch for each, "
    "or a study with [vary]"
)
_OTHER_INSTANTS = (
    "which changes the instants that are saved; with records the runs of a batch share theirs: "
    "take output.interval so that they do, or a batch for each"
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
            except ScenarioError:  # it goes only with what else is changed
                continue
            if trait(other) != wanted:
                break
        first = shown(entries[0][key])
        _refuse("over", f"entry {row}, {key}: got {shown(value)} after {first}, {why}")


def structure(scenario: Scenario) -> Any:
    """Return what decides on the programs that a scenario compiles, and on the sizes of results."""
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
    unit = unit_at(_schema(), key)
    about = {"long_name": key} | ({"units": unit} if unit else {})
    try:
        found = np.array(values)
    except ValueError:  # lists of several lengths
        found = np.array(None)
    if found.dtype.kind not in "biufU":
        found = np.array([json.dumps(value) for value in values])
    if found.dtype.kind == "U":
        found = found.astype(object)
    return ("run", *(f"{key}.{axis}" for axis in range(found.ndim - 1))), found, about


@cache
def _schema() -> dict[str, Any]:
    """Return the schema of all tables, made once."""
    return Scenario.model_json_schema()


def _refuse(key: str, text: str) -> None:
    raise ScenarioError([Mistake(key, text)])
