"""The rim of a picture: title, clock, names, a length and the colours; where the panels are."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from crinoid.report.film.camera import Camera
from crinoid.report.style import INK, VERMILLION

PAPER, SOFT, FAINT = "#F0F5F7", "#5D686D", "#A4ADB1"

_DPI = 100.0
_POINT = 72.0 / _DPI  # points of a pixel


class Frame:
    """A figure of some size in pixels: panels, and what is written above and below them.

    Parameters
    ----------
    size
        Width and height (pixels).
    title, status
        Of the run; the status is empty if nothing went wrong.
    panels
        How many there are beside each other.
    """

    def __init__(self, size: tuple[int, int], title: str, status: str, panels: int) -> None:
        self.size = size
        wide, high = size
        self.figure = Figure(figsize=(wide / _DPI, high / _DPI), dpi=_DPI, facecolor=PAPER)
        self.canvas = FigureCanvasAgg(self.figure)
        self.unit = max(7.0, 0.027 * min(high, 0.75 * wide) + 2.0)
        """Height of type (pixels)."""
        u = self.unit
        self._over: list[Artist] = []
        self._clock = self._text(wide - u, 0.7 * u, "", size=1.15, ha="right")
        lines = self._wrapped(title, wide - 9.5 * u, 2)
        said = self._wrapped(status, wide - 2 * u, 2) if status else []
        for i, line in enumerate(lines):
            self._text(u, (0.7 + 1.35 * i) * u, line, weight="bold")
        for i, line in enumerate(said, len(lines)):
            self._text(u, (0.7 + 1.35 * i) * u, line, color=VERMILLION)
        self._said = (0.8 + 1.35 * (len(lines) + len(said))) * u
        self._top = (1.1 + 1.35 * max(1, len(lines) + len(said))) * u
        self._foot = 3.0 * u
        self.tall = max(u, high - self._top - self._foot)
        """Height of what is between what is written above and below (pixels)."""
        self.panel = wide / panels
        self.axes = [self._panel(i) for i in range(panels)]
        for i in range(1, panels):
            self._line([i * self.panel] * 2, [self._top, high - self._foot], color=FAINT)

    @property
    def aspect(self) -> float:
        """Width over height of what a panel shows."""
        return self.panel / self.tall

    def draw_over(self, clock: str) -> None:
        """Write all over what the panels show, and what time it is."""
        self._clock.set_text(clock)
        renderer = self.canvas.get_renderer()
        for artist in self._over:
            artist.draw(renderer)

    def look(self, camera: Camera) -> None:
        """Let the panels show what a camera sees; what is beyond is below what is written."""
        metres = 2 * camera.half / self.tall
        x, y = camera.middle
        across = x + np.array([-0.5, 0.5]) * self.panel * metres
        up = y - camera.half - self._foot * metres, y + camera.half + self._top * metres
        for axes in self.axes:
            axes.set(xlim=across, ylim=up)
        self._add_scale(metres)

    def points(self, units: float) -> float:
        """Width of a line (points), from one in heights of type."""
        return units * self.unit * _POINT

    def say_speed(self, speed: float) -> None:
        """Say how much faster than the run the film is, if it is."""
        if abs(speed - 1.0) > 1e-9:
            self._text(self.unit, self._said, f"{speed:.3g} \N{MULTIPLICATION SIGN}", color=SOFT)

    def name_panels(self, names: Sequence[str]) -> None:
        """Write over each panel what it shows."""
        for i, name in enumerate(names):
            x, y = (i + 0.5) * self.panel, self._top + 0.2 * self.unit
            self._text(x, y, name, ha="center", color=INK)

    def add_key(self, names: Sequence[str], colours: Sequence[str]) -> None:
        """Say below the clock which colour is whose."""
        u, right = self.unit, self.size[0] - self.unit
        for i, (name, colour) in enumerate(zip(names, colours, strict=True)):
            x, y = right - self._width(name) - 1.3 * u, (2.9 + 1.3 * i) * u
            self._line([x, x + 0.7 * u], [y, y], color=colour, linewidth=0.55)
            self._text(right, y, name, va="center", ha="right", color=SOFT)

    def _add_scale(self, metres: float) -> None:
        """Draw a length below at the left, by how many metres a pixel is."""
        u, high = self.unit, self.size[1]
        long = _nice(min(7.0 * u, 0.2 * self.size[0]) * metres)
        x, y = [u, u + long / metres], high - 1.0 * u
        self._line(x, [y, y], color=SOFT)
        for end in x:
            self._line([end, end], [y - 0.25 * u, y], color=SOFT)
        self._text(x[0], y - 0.35 * u, _length(long), va="bottom", color=SOFT)

    def add_colours(self, label: str, low: float, high: float, ramp: Colormap) -> None:
        """Say below at the right which colour is which value."""
        u, (wide, tall) = self.unit, self.size
        names = [f"{value:.3g}".replace("-", "\N{MINUS SIGN}") for value in (low, high)]
        bar, right = 6.0 * u, wide - u - self._width(names[1]) - 0.4 * u
        y = tall - 1.15 * u
        rect = ((right - bar) / wide, (tall - y - 0.25 * u) / tall, bar / wide, 0.5 * u / tall)
        axes = self.figure.add_axes(rect)
        axes.imshow(np.linspace(0.0, 1.0, 256)[None], aspect="auto", cmap=ramp)
        axes.set_axis_off()
        self._over.append(axes)
        axes.set_animated(True)
        self._text(right + 0.4 * u, y, names[1], va="center", color=SOFT)
        self._text(right - bar - 0.4 * u, y, names[0], va="center", ha="right", color=SOFT)
        self._text(wide - u, y - 0.55 * u, label, va="bottom", ha="right", color=SOFT)

    def _panel(self, number: int) -> Axes:
        wide = self.size[0]
        axes = self.figure.add_axes((number * self.panel / wide, 0.0, self.panel / wide, 1.0))
        axes.set_axis_off()
        return axes

    def _text(self, x: float, y: float, words: str, *, size: float = 1.0, **look: Any) -> Text:
        """Write something, in pixels from the upper left."""
        wide, high = self.size
        style: dict[str, Any] = {"va": "top", "color": INK, "parse_math": False} | look
        points = size * self.unit * _POINT
        place = x / wide, 1.0 - y / high
        text = self.figure.text(*place, words, fontsize=points, animated=True, **style)
        self._over.append(text)
        return text

    def _line(self, x: list[float], y: list[float], *, linewidth: float = 0.1, **look: Any) -> None:
        wide, high = self.size
        across, up = [each / wide for each in x], [1.0 - each / high for each in y]
        look |= {"linewidth": self.points(linewidth), "solid_capstyle": "round"}
        self._over.append(self.figure.add_artist(Line2D(across, up, animated=True, **look)))

    def _width(self, words: str, **look: Any) -> float:
        """Width of some words (pixels)."""
        text = self._text(0.0, 0.0, words, **look)
        width = float(text.get_window_extent(self.canvas.get_renderer()).width)
        text.remove()
        self._over.remove(text)
        return width

    def _wrapped(self, words: str, width: float, most: int) -> list[str]:
        """Break a text into lines that are as wide as there is room; what is too much goes."""
        fits = lambda line: self._width(line, weight="bold") <= width  # noqa: E731
        shown = "".join(each if each.isprintable() else " " for each in words)
        left, lines = " ".join(shown.split()), list[str]()
        while left and len(lines) < most:
            taken = _most_that_fits(left, fits)
            if taken < len(left):
                blank = left.rfind(" ", 0, taken + 1)
                taken = blank if blank > 0 else max(1, taken)
            lines.append(left[:taken])
            left = left[taken:].lstrip()
        if left:
            last = f"{lines[-1]} {left}"
            fits_dots = lambda line: fits(f"{line} ...")  # noqa: E731
            lines[-1] = f"{last[: _most_that_fits(last, fits_dots)].rstrip()} ..."
        return lines


def _most_that_fits(text: str, fits: Callable[[str], bool]) -> int:
    """Return how many characters of a text fit, at least none, by halving."""
    low, high = 0, min(len(text), 1000)
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if fits(text[:middle]) else (low, middle - 1)
    return low


def _nice(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not above a number."""
    power = 10.0 ** math.floor(math.log10(value))
    return (
        next(factor for factor in (5.0, 2.0, 1.0) if factor * power <= value * (1 + 1e-9)) * power
    )


def _length(long: float) -> str:
    if long >= 1.0:
        return f"{long:g} m"
    return f"{100 * long:.2g} cm" if long >= 0.01 else f"{1000 * long:.2g} mm"
