"""Largest pressure of the chambers in a run."""

import numpy as np

from crinoid.results.result import Result


def largest_pressure(result: Result) -> float | None:
    """Return the largest pressure in a chamber over the saved instants (Pa); None without any.

    Shares give it where the pressure is set, and ``line_load`` where the volume is.
    """
    data, chambers = result.dataset, result.scenario.chamber
    names = result.scenario.thread_names[: len(chambers)]
    found = [
        chamber.max_pressure * np.abs(data["actuator_state"].sel(input=name).values).max()
        for chamber, name in zip(chambers, names, strict=True)
        if not chamber.lined
    ]
    if "line_load" in data:
        fluid = data["line_unit"].values == "Pa"
        found += [load.max() for load in data["line_load"].values[:, fluid].T]
    return float(max(found)) if found else None
