"""Results in notebooks: a small animation, a table of their main numbers, and plots.

`crinoid.Result` imports it when it is displayed.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from html import escape
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.results.reading import with_shapes
from crinoid.results.result import Result
from crinoid.results.scene.projection import ABOVE, AHEAD, SIDE
from crinoid.scenario.errors import got, one_of
from crinoid.view.figures import style
from crinoid.view.figures.charts.of_run import CHARTS
from crinoid.view.figures.paper import draw_panel
from crinoid.view.figures.shape import ROWS, draw_lines, quantities_along
from crinoid.view.figures.sheet import draw_in
from crinoid.view.page.parts import list_of, numbers_of
from crinoid.view.page.write import small_page_of
from crinoid.view.refusals import width_of

__all__ = ["Plots", "html_of"]


class _Figure(Figure):  # is saved with whole fonts, as publishers ask for
    def savefig(self, *args: Any, **options: Any) -> None:
        with mpl.rc_context({"pdf.fonttype": 42, "ps.fonttype": 42}):
            super().savefig(*args, **options)


@contextmanager
def _axes(
    heights: list[float], given: Sequence[Axes] | None, wide: float | None
) -> Iterator[list[Axes]]:
    """Yield the given axes, or new ones of some heights (inches), in the style of reports."""
    if given is not None and len(given) != len(heights):
        raise ValueError(f"ax: got {len(given)} axes; must be {len(heights)}, one for each panel")
    plt.draw_if_interactive()  # loads the backend, whose setting "interactive" has to stay
    with style.printed(wide):
        if given is not None:
            yield list(given)
            return
        size = style.width(), style.scale() * (0.5 + sum(heights))
        figure = plt.figure(figsize=size, layout="constrained", FigureClass=_Figure)
        panels = figure.subplots(len(heights), sharex=True, squeeze=False, height_ratios=heights)
        yield list(panels.flat)


_VIEWS = {"side": SIDE, "above": ABOVE, "ahead": AHEAD}
_LACKING = {
    "loads": "the loads on the base have no spectrum: they do not change, or too few instants are "
    "saved. Make the run longer.",
    "vehicle": "the base is held, so no submarine floats. Add [vehicle].",
    "contact": "the result has no obstacles and no contact.self. Add one of them.",
    "vortices": "the water of the run sheds no vortices. Add [water.vortices].",
}
"""Why a run lacks a chart."""


class Plots:
    """Plots of a result, as ``crinoid report`` draws them.

    Each accepts ``ax``, matplotlib's axes to draw into, and makes a new figure without. Those of
    several panels accept and return a list of axes. Plots over time show the run without control
    too. A ``ValueError`` gives the reason where a run has nothing to plot: loads that do not
    change, no submarine, no obstacles or no vortices.

    Parameters
    ----------
    result
        The result.
    width
        Width of new figures (inches), for a paper; None for the screen.
    """

    def __init__(self, result: Result, width: float | None = None) -> None:
        self._result, self._width = result, width

    def __call__(self, *, width: str) -> "Plots":
        """Return plots for a paper, such as ``result.plot(width="85mm").tip_error()``.

        Parameters
        ----------
        width
            Width of new figures, of 60 to 500 mm: ``"85mm"``, ``"17.8cm"`` or ``"3.4in"``.

        Raises
        ------
        ReportError
            If it is no such width.
        """
        return Plots(self._result, width_of(width, "width"))

    def tip_error(self, ax: Axes | None = None) -> Axes:
        """Plot the distance of the tip from its target."""
        return self._panel("tip_error", "tip_error", ax)

    def tip_miss(self, ax: Axes | None = None) -> Axes:
        """Plot the position of the tip minus that of its target, along each axis."""
        return self._panel("tip_error", "tip_miss", ax)

    def tip_off_direction(self, ax: Axes | None = None) -> Axes:
        """Plot the angle between the direction of the tip and that of its target."""
        return self._panel("tip_error", "tip_off_direction", ax)

    def tip_spectrum(self, ax: Axes | None = None) -> Axes:
        """Plot the spectrum of the tip's error."""
        return self._panel("spectrum", "tip_spectrum", ax)

    def water_speed(self, ax: Axes | None = None) -> Axes:
        """Plot the speed of the water at the tip."""
        return self._panel("tip_error", "tip_water", ax)

    def commands(self, ax: Iterable[Axes] | None = None) -> list[Axes]:
        """Plot driven channels and actuators with their commands, and the load on the base.

        A panel each for the base's channels (in space for all shifts and all turns), for actuators
        of each unit, for the force and for the moment.
        """
        return self._chart("commands", ax)

    def base_force(self, ax: Axes | None = None) -> Axes:
        """Plot the force of the arm on its base."""
        return self._panel("commands", "base_force", ax)

    def base_moment(self, ax: Axes | None = None) -> Axes:
        """Plot the moment of the arm on its base."""
        return self._panel("commands", "base_moment", ax)

    def loads(self, ax: Iterable[Axes] | None = None) -> list[Axes]:
        """Plot the spectral densities of force and moment on the base: two panels."""
        return self._chart("loads", ax)

    def vehicle(self, ax: Iterable[Axes] | None = None) -> list[Axes]:
        """Plot shifts and turns of a floating submarine, and its thrusters: two or four panels."""
        return self._chart("vehicle", ax)

    def energy(self, ax: Iterable[Axes] | None = None) -> list[Axes]:
        """Plot stored energies, works, and the defect of their balance: three panels."""
        return self._chart("energy", ax)

    def iterations(self, ax: Axes | None = None) -> Axes:
        """Plot the iterations of Newton's method in each step."""
        return self._panel("effort", "newton_iterations", ax)

    def contact(self, ax: Iterable[Axes] | None = None) -> list[Axes]:
        """Plot contact with obstacles, the arm itself and a hull: times, forces and distances."""
        return self._chart("contact", ax)

    def vortices(self, ax: Iterable[Axes] | None = None) -> list[Axes]:
        """Plot the frequency of shedding against the arm's own, and the force: two panels."""
        return self._chart("vortices", ax)

    def shape(
        self,
        ax: Axes | None = None,
        *,
        view: str = "side",
        times: Iterable[float] | None = None,
        legend: bool = True,
        colorbar: bool = True,
    ) -> Axes:
        """Plot the arm over time with the path of its tip, target, obstacles and water.

        Parameters
        ----------
        ax
            Axes to draw into.
        view
            The view: ``"side"``, ``"above"`` or ``"ahead"``.
        times
            Times at which the arm is drawn (s), at the nearest saved instants.
        legend, colorbar
            Whether the axes have a legend, and a colour bar of the time.

        Raises
        ------
        ValueError
            For an unknown view, a time outside of the run, or a result without positions.
        """
        if view not in _VIEWS:
            raise ValueError(f"view: {got(view, f'be {one_of(_VIEWS)}')}")
        data, chosen = self._run.dataset, None
        if "position" not in data:
            raise ValueError("the result has no position: output.variables leaves it out")
        if times is not None:
            time, wanted = data["time"].values, np.asarray(list(times), float)
            if not wanted.size or not np.all((wanted >= time[0]) & (wanted <= time[-1])):
                must = f"one or more from {time[0]:g} to {time[-1]:g} (s)"
                raise ValueError(f"times: got {wanted.tolist()}; must be {must}")
            at = np.unique([np.abs(time - each).argmin() for each in wanted])
            data, chosen = data.isel(time=slice(at[0], at[-1] + 1)), at - at[0]
        with _axes([5.0], None if ax is None else [ax], self._width) as (axes,):
            if colorbar:  # first, as it narrows the axes
                style.time_bar(axes.figure, data, "t (s)", ax=axes, fraction=0.2)
            draw_in(axes, data, _VIEWS[view], chosen, legend)
            return axes

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
        data = self._run.dataset
        known = quantities_along(data)
        if of and of not in known:
            raise ValueError(f"of: {got(of, f'be {one_of(known)}')}")
        name = of or known[0]
        with _axes([2.4], None if ax is None else [ax], self._width) as (axes,):
            draw_lines(axes, data, name)
            axes.set(xlabel="distance from the root (m)", ylabel=ROWS[name].replace("\n", " "))
            style.time_bar(axes.figure, data, "t (s)", ax=axes, fraction=0.2)
            return axes

    @property
    def _run(self) -> Result:
        return _with_shapes(self._result)

    def _panel(self, chart: str, name: str, ax: Axes | None) -> Axes:
        (drawn,) = self._chart(chart, None if ax is None else [ax], name)
        return drawn

    def _chart(self, chart: str, ax: Iterable[Axes] | None, only: str = "") -> list[Axes]:
        """Draw panels of a chart below each other, or into one of the given axes each."""
        run, given = self._run, None if ax is None else list(ax)
        found = CHARTS[chart](run)
        if found is None:
            raise ValueError(_LACKING[chart])
        panels = [panel for panel in found.panels if only in ("", panel.name)]
        time = run.dataset["time"].values
        with _axes([panel.tall for panel in panels], given, self._width) as drawn:
            for axes, panel in zip(drawn, panels, strict=True):
                if given is not None:  # which may be small
                    traces = tuple(replace(trace, summary="") for trace in panel.traces)
                    panel = replace(panel, traces=traces)
                draw_panel(axes, panel)
                if given is not None:
                    room = style.key_within(axes)
                    scale = axes.yaxis.get_transform()  # keeps the legend clear of data
                    low, high = scale.transform(np.array(axes.get_ylim()))
                    top = low + (high - low) / (1.0 - room)
                    axes.set_ylim(top=float(scale.inverted().transform(np.array([top]))[0]))
                    axes.set_autoscaley_on(True)  # axes that share a scale show each other's data
                if not panel.over and time[-1] > time[0]:
                    axes.set_xlim(float(time[0]), float(time[-1]))
            drawn[-1].set_xlabel("frequency (Hz)" if panels[-1].over else "time (s)")
            return drawn


_HEIGHT = 440  # height of the animation (pixels)


def html_of(result: Result) -> str:
    """Return a result as HTML; a line gives the reason where a part of it cannot be shown.

    Texts of the scenario are escaped. The animation is a separate page in a frame, which can run
    its script and nothing else.
    """
    attributes = result.dataset.attrs
    title, status = (str(attributes.get(name, "")) for name in ("title", "status"))
    failed = f"<p>{escape(status)}</p>" if status and status != "ok" else ""
    animation = _part("animation", _animation, result)
    return f"<h3>{escape(title)}</h3>{failed}{animation}{_part('numbers', numbers_of, result)}"


def _part(name: str, draw: Callable[[Result], str], result: Result) -> str:
    try:
        return draw(result)
    except Exception as error:  # a notebook would show a traceback and nothing else
        text = " ".join(str(error).split())
        return f"<p>no {name}: {escape(f'{type(error).__name__}: {text}'[:300])}</p>"


def _animation(result: Result) -> str:
    page, left_out = small_page_of(_with_shapes(result))
    content = page.replace("&", "&amp;").replace("'", "&#39;")
    return (
        f"<iframe srcdoc='{content}' sandbox='allow-scripts' title='The arm over time' "
        f"style='width:100%;height:{_HEIGHT}px;border:0'></iframe>{list_of('Left out', left_out)}"
    )


def _with_shapes(result: Result) -> Result:
    return with_shapes(result, *["result", "result without control"][: len(result.members)])
