"""Plots of a result, in axes of one's own or in new figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from crinoid.notebook.runs import run_of
from crinoid.report.charts.chart import Chart
from crinoid.report.charts.drive import drive_chart
from crinoid.report.charts.effort import effort_chart
from crinoid.report.charts.energy import energy_chart
from crinoid.report.charts.spectrum import spectrum_chart
from crinoid.report.charts.tip import tip_chart
from crinoid.report.charts.touch import contact_chart, has_contact
from crinoid.report.run import Run
from crinoid.report.view import ABOVE, AHEAD, SIDE, is_spatial
from crinoid.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_VIEWS = {"side": SIDE, "above": ABOVE, "ahead": AHEAD}
_ALONG = {False: ("curvature", "tension"), True: ("kappa_1", "kappa_2", "twist", "tension")}
"""Quantities along an arm in the plane, and in space."""


class Plots:
    """Plots of a result, as ``crinoid report`` has them.

    Each takes ``ax``, matplotlib's axes to draw into, and makes a new figure without. Those of
    several panels take and return a list of axes. Over time the run without control is drawn too.

    Parameters
    ----------
    result
        The result.
    """

    def __init__(self, result: Result) -> None:
        self._result = result

    def tip_error(self, ax: Axes | None = None) -> Axes:
        """Plot how far the tip is from its target."""
        return self._panel(tip_chart, "tip_error", ax)

    def tip_miss(self, ax: Axes | None = None) -> Axes:
        """Plot the tip's position less its target's, along each axis."""
        return self._panel(tip_chart, "tip_miss", ax)

    def tip_off_direction(self, ax: Axes | None = None) -> Axes:
        """Plot the angle between where the tip points and where it should."""
        return self._panel(tip_chart, "tip_off_direction", ax)

    def tip_spectrum(self, ax: Axes | None = None) -> Axes:
        """Plot over which frequencies the tip's error spreads."""
        return self._panel(spectrum_chart, "tip_spectrum", ax)

    def water_speed(self, ax: Axes | None = None) -> Axes:
        """Plot the speed of the water at the tip."""
        return self._panel(tip_chart, "tip_water", ax)

    def commands(self, ax: Iterable[Axes] | None = None) -> list[Axes]:
        """Plot what is driven against its commands, and the load on the submarine.

        A panel each for the base's channels (in space for all shifts and all turns), for actuators
        of each unit, for the force and for the moment.
        """
        return self._chart(drive_chart, ax)

    def base_force(self, ax: Axes | None = None) -> Axes:
        """Plot the force of the arm on the submarine."""
        return self._panel(drive_chart, "base_force", ax)

    def base_moment(self, ax: Axes | None = None) -> Axes:
        """Plot the moment of the arm on the submarine."""
        return self._panel(drive_chart, "base_moment", ax)

    def energy(self, ax: Iterable[Axes] | None = None) -> list[Axes]:
        """Plot stored energies, works done, and how well they balance: three panels."""
        return self._chart(energy_chart, ax)

    def iterations(self, ax: Axes | None = None) -> Axes:
        """Plot Newton's iterations a step."""
        return self._panel(effort_chart, "newton_iterations", ax)

    def contact(self, ax: Iterable[Axes] | None = None) -> list[Axes]:
        """Plot when obstacles touch the arm, their forces, and their distances: three panels.

        Raises
        ------
        ValueError
            If the run has no obstacles.
        """
        if not has_contact(self._run):
            raise ValueError("the result has no obstacles, so no contact to plot")
        return self._chart(contact_chart, ax)

    def shape(
        self,
        ax: Axes | None = None,
        *,
        view: str = "side",
        times: Iterable[float] | None = None,
        legend: bool = True,
        colorbar: bool = True,
    ) -> Axes:
        """Plot the arm over time, its tip's path, target, obstacles and the water.

        Parameters
        ----------
        ax
            Axes to draw into.
        view
            From where it is seen: ``"side"``, ``"above"`` or ``"ahead"``.
        times
            When the arm is drawn (s), at the nearest saved instants; its tip's path joins them.
        legend, colorbar
            Whether the axes have a legend, and a colour bar of the time.

        Raises
        ------
        ValueError
            If there is no such view, a time is not of the run, or the result has no positions.
        """
        from crinoid.notebook.draw import draw_shape

        if view not in _VIEWS:
            raise ValueError(f"view: got {view!r}, takes {', '.join(map(repr, _VIEWS))}")
        data = self._run.result
        if "position" not in data:
            raise ValueError("the result has no position: output.variables left it out")
        return draw_shape(data, _VIEWS[view], ax, times, legend, colorbar)

    def bending(self, ax: Axes | None = None, *, of: str = "") -> Axes:
        """Plot a quantity along the arm over time.

        Parameters
        ----------
        ax
            Axes to draw into.
        of
            ``"curvature"`` or ``"tension"``, in space ``"kappa_1"``, ``"kappa_2"``, ``"twist"`` or
            ``"tension"``; the first of these by default.

        Raises
        ------
        ValueError
            If the arm has no such quantity.
        """
        from crinoid.notebook.draw import draw_along

        data = self._run.result
        takes = _ALONG[is_spatial(data)]
        if of and of not in takes:
            raise ValueError(f"of: got {of!r}, takes {', '.join(map(repr, takes))}")
        return draw_along(data, of or takes[0], ax)

    @property
    def _run(self) -> Run:
        return run_of(self._result)

    def _panel(self, chart: Callable[[Run], Chart], name: str, ax: Axes | None) -> Axes:
        from crinoid.notebook.draw import draw_panels

        run = self._run
        panels = [panel for panel in chart(run).panels if panel.name == name]
        (drawn,) = draw_panels(panels, run, None if ax is None else [ax])
        return drawn

    def _chart(self, chart: Callable[[Run], Chart], ax: Iterable[Axes] | None) -> list[Axes]:
        from crinoid.notebook.draw import draw_panels

        run = self._run
        return draw_panels(chart(run).panels, run, None if ax is None else list(ax))


def plots_of(result: Result) -> Plots:
    """Return the plots of a result."""
    return Plots(result)
