"""Comparison of a measured sea with the components that represent it."""

from typing import Any

import numpy as np

from crinoid.assembly.prepared import Prepared
from crinoid.flow import Waves
from crinoid.numerics.sea_statistics import SeaStatistics
from crinoid.recording import Sea, at_gauge

_BANDS = 24  # bands of a spectrum, in which there are few of the components
_FINE = 4  # instants of the components between two of a record

SOURCES = ("file", "components")
Row = tuple[str, str, str, Any, str]


def sea_rows(prepared: Prepared) -> list[Row]:
    """Return the statistics of each sea in a file and of its components, and either over time.

    Of a spectrum, its density in bands. The axis ``source`` is `SOURCES`.
    """
    flows = prepared.system.forces.water.flows
    found: list[Row] = []
    for index, sea in prepared.seas.items():
        waves = flows[index]
        assert isinstance(waves, Waves)
        found += _rows(f"sea_{index}", sea, waves, prepared.scenario.simulation.duration)
    return found


def _rows(name: str, sea: Sea, waves: Waves, duration: float) -> list[Row]:
    order = np.argsort(waves.frequencies)
    frequency = np.asarray(waves.frequencies)[order] / (2 * np.pi)
    variance, headings = np.square(waves.amplitudes)[order] / 2, np.asarray(waves.headings)[order]
    angle = np.arctan2(headings[:, 1], headings[:, 0]) if headings.shape[1] == 2 else None
    found = SeaStatistics.of(frequency, variance, angle)
    if sea.record is not None:
        numbers = [np.asarray(each) for each in (waves.amplitudes, waves.frequencies, waves.phases)]
        time, record = sea.record.time, sea.record.values[:, 0]
        about = SeaStatistics.of_record(at_gauge(time, *numbers), float(time[1] - time[0]))
        found = about._replace(direction=found.direction, spreading=found.spreading)
        fine = np.linspace(time[0], time[-1], _FINE * (time.size - 1) + 1)
        measured = np.full(fine.size, np.nan)
        measured[::_FINE] = record
        run = (fine >= 0) & (fine <= duration)
        both = np.stack([measured[run], at_gauge(fine[run], *numbers)])
        rows = [
            (f"{name}_time", name, "s", fine[run], "time of the run"),
            (f"{name}_elevation", f"source {name}", "m", both, "elevation at the gauge"),
        ]
    else:
        fine, density = sea.given["frequency"] / (2 * np.pi), sea.given["density"] * 2 * np.pi
        if density.ndim > 1:
            turn = sea.given["direction"]
            steps = np.diff(turn, append=turn[0] + 2 * np.pi)
            density = density @ (0.5 * (steps + np.roll(steps, 1)))
        edges = np.linspace(fine[0], fine[-1], _BANDS + 1)
        below = np.append(0.0, np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(fine)))
        of_file = np.diff(np.interp(edges, fine, below))
        of_components, _ = np.histogram(frequency, edges, weights=variance)
        rows = [
            (f"{name}_frequency", name, "Hz", 0.5 * (edges[1:] + edges[:-1]), "frequency"),
            (f"{name}_density", f"source {name}", "m2 s",
             np.stack([of_file, of_components]) / np.diff(edges), "density of the elevation"),
        ]  # fmt: skip
    both = np.array([each.values() for each in (sea.statistics, found)])
    return [*rows, (f"{name}_statistics", "source statistic", "as named", both, sea.name)]
