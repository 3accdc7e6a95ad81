"""Numbers of a pytree of parameters as text: their paths, values and units."""

from typing import Any

import jax
import numpy as np

from crinoid.scenario.kinds import units_of
from crinoid.scenario.scenario import scenario_schema

_FEW = 3  # numbers of an array that are shown


def parameter_rows(parameters: Any) -> dict[str, list[str]]:
    """Return the arrays of parameters by table, each as its name there and its value with unit.

    A unit is that of the key of the same name; other paths have none.
    """
    units, tables = units_of(scenario_schema()), dict[str, list[str]]()
    for path, leaf in jax.tree_util.tree_flatten_with_path(parameters)[0]:
        parts = jax.tree_util.keystr(path, simple=True, separator=".").split(".")
        indexed = 2 if len(parts) > 2 and parts[1].isdecimal() else 1
        key = ".".join("0" if part.isdecimal() else part for part in parts)
        table = parts[0] + "".join(f"[{index}]" for index in parts[1:indexed])
        if np.size(leaf):
            words = [".".join(parts[indexed:]), _value(leaf), units.get(key, "")]
            tables.setdefault(table, []).append(" ".join(words).strip())
    return tables


def _value(leaf: Any) -> str:
    shape = np.shape(leaf)
    if np.size(leaf) > _FEW:
        return f"({' x '.join(map(str, shape))} numbers)"
    try:
        numbers = [f"{float(each):.4g}" for each in np.ravel(np.asarray(leaf))]
    except TypeError:  # traced, or a shape alone
        return f"({type(leaf).__name__})"
    return f"[{', '.join(numbers)}]" if shape else numbers[0]
