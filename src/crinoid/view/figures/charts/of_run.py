"""The charts of a run by their names, in the order of the page."""

from collections.abc import Callable

from crinoid.results.result import Result
from crinoid.view.figures.charts.chart import Chart
from crinoid.view.figures.charts.drive import drive_chart, effort_chart, energy_chart
from crinoid.view.figures.charts.estimate import estimate_chart
from crinoid.view.figures.charts.spectra import load_chart, spectrum_chart
from crinoid.view.figures.charts.tip import tip_chart
from crinoid.view.figures.charts.touch import contact_chart
from crinoid.view.figures.charts.vehicle import vehicle_chart
from crinoid.view.figures.charts.vortices import vortex_chart

CHARTS: dict[str, Callable[[Result], Chart | None]] = {
    "tip_error": tip_chart,
    "spectrum": spectrum_chart,
    "commands": drive_chart,
    "estimate": estimate_chart,
    "loads": load_chart,
    "vehicle": vehicle_chart,
    "contact": contact_chart,
    "vortices": vortex_chart,
    "energy": energy_chart,
    "effort": effort_chart,
}


def charts_of(run: Result) -> list[Chart]:
    """Return the charts of a run."""
    return [chart for draw in CHARTS.values() if (chart := draw(run)) is not None]
