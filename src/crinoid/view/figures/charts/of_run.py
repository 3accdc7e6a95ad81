"""The charts of a run: which there are, in which order, and as which figures."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from crinoid.results.result import Result
from crinoid.view.figures.charts.chart import Chart
from crinoid.view.figures.charts.drive import drive_chart, effort_chart, energy_chart
from crinoid.view.figures.charts.estimate import estimate_chart
from crinoid.view.figures.charts.spectra import load_chart, spectrum_chart
from crinoid.view.figures.charts.tip import tip_chart
from crinoid.view.figures.charts.touch import contact_chart
from crinoid.view.figures.charts.vehicle import vehicle_chart
from crinoid.view.figures.charts.vortices import vortex_chart


class RunChart(NamedTuple):
    """A chart of the page of a run, and of a figure."""

    figure: str
    """Name of the file of its figure; empty for a chart of the page alone."""
    draw: Callable[[Result], Chart | None]
    """Returns None for a run that has nothing of it."""


CHARTS = (
    RunChart("tip_error", tip_chart),
    RunChart("", spectrum_chart),
    RunChart("commands", drive_chart),
    RunChart("estimate", estimate_chart),
    RunChart("loads", load_chart),
    RunChart("vehicle", vehicle_chart),
    RunChart("contact", contact_chart),
    RunChart("vortices", vortex_chart),
    RunChart("energy", energy_chart),
    RunChart("", effort_chart),
)


def charts_of(run: Result) -> Iterator[tuple[str, Chart]]:
    """Yield the charts of a run with the names of their figures."""
    for figure, draw in CHARTS:
        chart = draw(run)
        if chart is not None:
            yield figure, chart
