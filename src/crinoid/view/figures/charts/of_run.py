"""The charts of a run: which there are, in which order, and as which figures."""

from collections.abc import Callable, Iterator

from crinoid.results.result import Result
from crinoid.view.figures.charts.chart import Chart
from crinoid.view.figures.charts.drive import drive_chart, effort_chart, energy_chart
from crinoid.view.figures.charts.estimate import estimate_chart
from crinoid.view.figures.charts.spectra import load_chart, spectrum_chart
from crinoid.view.figures.charts.tip import tip_chart
from crinoid.view.figures.charts.touch import contact_chart
from crinoid.view.figures.charts.vehicle import vehicle_chart
from crinoid.view.figures.charts.vortices import vortex_chart

_CHARTS: tuple[tuple[str, Callable[[Result], Chart | None]], ...] = (
    ("tip_error", tip_chart),
    ("", spectrum_chart),
    ("commands", drive_chart),
    ("estimate", estimate_chart),
    ("loads", load_chart),
    ("vehicle", vehicle_chart),
    ("contact", contact_chart),
    ("vortices", vortex_chart),
    ("energy", energy_chart),
    ("", effort_chart),
)
"""Names of the files of figures, empty for a chart of the page alone, and what draws them."""


def charts_of(run: Result) -> Iterator[tuple[str, Chart]]:
    """Yield the charts of a run with the names of their figures."""
    for figure, draw in _CHARTS:
        chart = draw(run)
        if chart is not None:
            yield figure, chart
