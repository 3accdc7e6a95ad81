"""Pictures of a film: panels of runs, and texts, scales and colours over them."""

import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from crinoid.results.report_error import ReportError
from crinoid.results.scene.data import Points
from crinoid.results.scene.scene import Scene, colour_ranges
from crinoid.results.units import round_down
from crinoid.scenario.errors import got, one_of, shown
from crinoid.view.figures.painter import Shading
from crinoid.view.figures.style import INK, STYLE, VERMILLION
from crinoid.view.film.camera import Camera, FilmSettings, camera_of, cloud_of, followed_path
from crinoid.view.film.encode import Image
from crinoid.view.film.panel import FAINT, PAPER, SOFT, TONES, WATER, FilmPanel, pale
from crinoid.view.film.settings import PRESETS, RAMPS, CameraSettings

_DPI = 100.0
_POINT = 72.0 / _DPI  # points of a pixel
_LONGEST = 1000  # characters of a title
_ROOM = 32.0  # least width of a picture with a scale of speeds, in heights of type
_SPARE = 0.9  # of the width of a title: some lines have wider letters than the mean


@contextmanager
def _style() -> Iterator[None]:
    """Let all that is drawn meanwhile look as figures do."""
    with mpl.rc_context(STYLE), warnings.catch_warnings():
        # letters of a title that no installed font has become boxes
        warnings.filterwarnings("ignore", message="Glyph")
        yield


class PictureFrame:
    """A figure of a size (pixels) with panels side by side, and text above and below them."""

    def __init__(self, size: tuple[int, int], title: str, status: str, panels: int) -> None:
        self.size = size
        wide, high = size
        self.figure = Figure(figsize=(wide / _DPI, high / _DPI), dpi=_DPI, facecolor=PAPER)
        self.canvas = FigureCanvasAgg(self.figure)
        self.unit = max(7.0, 0.027 * min(high, 0.75 * wide) + 2.0)  # height of type (pixels)
        u = self.unit
        self.clock = self._text(wide - u, 0.7 * u, "", size=1.15, ha="right")
        head = self._wrapped(title, wide - 9.5 * u)
        lines = [*head, *self._wrapped(status, wide - 2 * u)]
        for i, line in enumerate(lines):
            style: dict[str, Any] = {"weight": "bold"} if i < len(head) else {"color": VERMILLION}
            self._text(u, (0.7 + 1.35 * i) * u, line, **style)
        self._below_title = (0.8 + 1.35 * len(lines)) * u
        self._top = (1.1 + 1.35 * max(1, len(lines))) * u
        self._foot = 3.0 * u
        self.tall = max(u, high - self._top - self._foot)
        """Height between the texts above and below (pixels)."""
        self.panel = wide / panels
        self.axes = []
        for i in range(panels):
            self.axes.append(self.figure.add_axes((i / panels, 0.0, 1.0 / panels, 1.0)))
            self.axes[i].set_axis_off()
            if i:
                self._line([i * self.panel] * 2, [self._top, high - self._foot], color=FAINT)

    @property
    def aspect(self) -> float:
        """Width over height of a panel."""
        return self.panel / self.tall

    def set_camera(self, camera: Camera, water: float) -> None:
        """Set the limits of the panels to those of a camera, text and all, and draw scales.

        They are of lengths, and of speeds unless those of the water are 0 (m/s for each m).
        """
        metres = 2 * camera.half / self.tall
        x, y = camera.middle
        across = x + np.array([-0.5, 0.5]) * self.panel * metres
        up = y - camera.half - self._foot * metres, y + camera.half + self._top * metres
        for axes in self.axes:
            axes.set(xlim=across, ylim=up)
        # at the lower left; a pixel is so many metres
        u, longest = self.unit, min(7.0 * self.unit, 0.2 * self.size[0])
        long = round_down(longest * metres)
        text = f"{100 * long:.2g} cm" if long >= 0.01 else f"{1000 * long:.2g} mm"
        text = f"{long:g} m" if long >= 1.0 else text
        right = self._scale(u, long / metres, text, color=SOFT, arrow=False)
        if water and self.size[0] > _ROOM * u:  # else the colour bar needs the room
            fast = round_down(longest * metres * water)
            left, text = right + 1.5 * u, f"water {fast:g} m/s"
            self._scale(left, fast / water / metres, text, color=WATER, arrow=True)

    def _scale(self, left: float, long: float, text: str, *, color: str, arrow: bool) -> float:
        """Draw a line or arrow of a length (pixels), and return where it and its text end."""
        u, foot = self.unit, self.size[1] - self.unit
        head = 0.5 * u if arrow else 0.0
        look: dict[str, Any] = {"marker": ">", "markevery": [1], "markersize": head * _POINT}
        ends = [left, left + long - head / 2]  # the middle of a head
        self._line(ends, [foot, foot], color=color, **look if arrow else {})
        for end in ends[: 1 if arrow else 2]:
            self._line([end, end], [foot - 0.25 * u, foot], color=color)
        self._text(left, foot - 0.35 * u, text, va="bottom", color=color)
        return left + max(long, self._width(text))

    def points(self, units: float) -> float:
        """Convert a width in heights of type to points."""
        return units * self.unit * _POINT

    def add_speed(self, speed: float) -> None:
        """Write the speed of the film unless it is 1."""
        if abs(speed - 1.0) > 1e-9:
            text = f"{speed:.3g} \N{MULTIPLICATION SIGN}"
            self._text(self.unit, self._below_title, text, color=SOFT)

    def name_panels(self, names: Sequence[str]) -> None:
        """Write a name over each panel."""
        for i, name in enumerate(names):
            x, y = (i + 0.5) * self.panel, self._top + 0.2 * self.unit
            self._text(x, y, name, ha="center", color=INK)

    def add_key(self, names: Sequence[str], colours: Sequence[str]) -> None:
        """Add a legend of the runs below the clock."""
        u, right = self.unit, self.size[0] - self.unit
        for i, (name, colour) in enumerate(zip(names, colours, strict=True)):
            x, y = right - self._width(name) - 1.3 * u, (2.9 + 1.3 * i) * u
            self._line([x, x + 0.7 * u], [y, y], color=colour, linewidth=0.55)
            self._text(right, y, name, va="center", ha="right", color=SOFT)

    def add_colours(self, label: str, low: float, high: float, ramp: Colormap) -> None:
        """Add a colour bar at the lower right."""
        u, (wide, tall) = self.unit, self.size
        names = [f"{value:.3g}".replace("-", "\N{MINUS SIGN}") for value in (low, high)]
        bar, right = 6.0 * u, wide - u - self._width(names[1]) - 0.4 * u
        y = tall - 1.15 * u
        rect = ((right - bar) / wide, (tall - y - 0.25 * u) / tall, bar / wide, 0.5 * u / tall)
        axes = self.figure.add_axes(rect)
        axes.imshow(np.linspace(0.0, 1.0, 256)[None], aspect="auto", cmap=ramp)
        axes.set_axis_off()
        self._text(right + 0.4 * u, y, names[1], va="center", color=SOFT)
        self._text(right - bar - 0.4 * u, y, names[0], va="center", ha="right", color=SOFT)
        self._text(wide - u, y - 0.55 * u, label, va="bottom", ha="right", color=SOFT)

    def keep(self) -> None:
        """Draw once all that lies over the panels except the clock, to lay it over pictures."""
        figure = self.figure
        others = (figure.patch, self.clock, *self.axes)
        for each in (*self.axes, figure.patch):
            each.set_visible(False)
        self.canvas.draw()
        drawn = np.array(self.canvas.buffer_rgba()).reshape(-1, 4)
        for each in figure.get_children():
            each.set_visible(each in others)
        self.clock.set_animated(True)
        self._inked = np.flatnonzero(drawn[:, 3])
        ink = drawn[self._inked].astype(float)
        share, ink[:, 3] = ink[:, 3:] / 255.0, 255.0
        self._paper, self._ink = 1.0 - share, share * ink + 0.5

    def draw(self, panels: Sequence[FilmPanel], *, fresh: bool) -> Image:
        """Draw panels, whose backdrop is drawn again if it is fresh."""
        if fresh:
            self.canvas.draw()
            self._backdrop = self.canvas.copy_from_bbox(self.figure.bbox)
        else:
            self.canvas.restore_region(self._backdrop)
        for panel in panels:
            panel.draw()
        self.figure.draw_artist(self.clock)
        picture = np.array(self.canvas.buffer_rgba())
        pixels = picture.reshape(-1, 4)
        pixels[self._inked] = self._ink + self._paper * pixels[self._inked]
        return picture

    def _text(self, x: float, y: float, words: str, *, size: float = 1.0, **look: Any) -> Text:
        """Write text at a place in pixels from the upper left."""
        wide, high = self.size
        style: dict[str, Any] = {"va": "top", "color": INK, "parse_math": False} | look
        points = size * self.unit * _POINT
        place = x / wide, 1.0 - y / high
        return self.figure.text(*place, words, fontsize=points, **style)

    def _line(self, x: list[float], y: list[float], *, linewidth: float = 0.1, **look: Any) -> None:
        wide, high = self.size
        across, up = [each / wide for each in x], [1.0 - each / high for each in y]
        look |= {"linewidth": self.points(linewidth), "solid_capstyle": "round"}
        self.figure.add_artist(Line2D(across, up, **look))

    def _width(self, words: str, **look: Any) -> float:
        text = self._text(0.0, 0.0, words, **look)
        width = float(text.get_window_extent(self.canvas.get_renderer()).width)
        text.remove()
        return width

    def _wrapped(self, words: str, width: float) -> list[str]:
        """Break a text into two lines at most."""
        printable = "".join(each if each.isprintable() else " " for each in words)
        line = " ".join(printable.split())[:_LONGEST]
        share = _SPARE * width / max(self._width(line, weight="bold"), 1.0)
        columns = max(8, len(line) if share >= _SPARE else int(share * len(line)))
        return textwrap.wrap(line, columns, max_lines=2, placeholder=" ...") if line else []


class Picture:
    """The pictures of a film, all of one size.

    The status of the run is empty unless it failed; the pictures contain a cloud of points, by
    default of the whole run.
    """

    @_style()
    def __init__(
        self,
        scene: Scene,
        settings: CameraSettings,
        frames: FilmSettings,
        title: str,
        status: str,
        cloud: Points | None = None,
    ) -> None:
        first = scene.members[0]
        wish, parts = settings.uncontrolled, [list(range(len(scene.members)))]
        if wish in ("ghost", "beside") and len(scene.members) == 1:
            text = f"got {shown(wish)}, but the result has no uncontrolled run"
            raise ReportError(f"--uncontrolled: {text}")
        if wish in ("beside", "none"):  # the runs of each panel
            parts = [[i] for i in parts[0]] if wish == "beside" else [[0]]
        shading = _shading(scene, settings.colour, plain=len(parts[0]) > 1)
        frame = PictureFrame(frames.size, title, status, len(parts))
        self._path, self._run = followed_path(scene, settings.follow), first
        drawn = [scene.members[i] for part in parts for i in part]
        cloud = cloud_of(scene, drawn, self._path) if cloud is None else cloud
        name = settings.view or ("angle" if scene.spatial else "side")
        wishes = settings.azimuth, settings.elevation
        angles = [b if a is None else a for a, b in zip(wishes, PRESETS[name], strict=True)]
        flat = name != "angle" and wishes == (None, None)
        camera = camera_of(cloud, *angles, flat=flat, aspect=frame.aspect, zoom=settings.zoom)
        frame.add_speed(frames.speed)
        frame.set_camera(camera, first.water.scale if first.water else 0.0)
        self._panels = [
            FilmPanel(axes, scene, part, camera, shading, frame.points(1.0))
            for axes, part in zip(frame.axes, parts, strict=True)
        ]
        labels = [each.label for each in drawn]
        if len(parts) > 1:
            frame.name_panels(labels)
        elif len(drawn) > 1:
            inks = [TONES[0], pale(TONES[1])]
            first_named = 0 if shading is None else 1
            frame.add_key(labels[first_named:], inks[first_named:])
        if shading is not None:
            field = next(each for each in first.fields if each.name == shading.name)
            label = f"{field.label} ({field.unit})"
            frame.add_colours(label, shading.low, shading.high, shading.ramp)
        frame.keep()
        self._frame = frame
        self._digits = 3 if frames.times[-1] - frames.times[0] < 5.0 else 2

    @_style()
    def at(self, time: float) -> Image:
        """Draw a time (s)."""
        times = self._run.time
        place = np.array([np.interp(time, times, each) for each in self._path.T])
        drift, along = place - self._path[0], place - self._path.mean(axis=0)
        fresh = [panel.show(time, drift, along) for panel in self._panels]
        self._frame.clock.set_text(f"{time:.{self._digits}f} s")
        return self._frame.draw(self._panels, fresh=any(fresh))


def _shading(scene: Scene, wish: str | None, *, plain: bool) -> Shading | None:
    """Return the colours of the arm; by default none next to a ghost (``plain``)."""
    fields = [field.name for field in scene.members[0].fields]
    if wish == "none" or (wish is None and (plain or not fields)):
        return None
    if wish is not None and wish not in fields:
        must = f"be {one_of([*fields, 'none'])} for this result"
        raise ReportError(f"--colour: {got(wish, must)}")
    name = wish or fields[0]
    low, high = colour_ranges(scene)[name]
    ramp = LinearSegmentedColormap.from_list(name, RAMPS["two" if low < 0.0 else "one"])
    return Shading(name, low, high, ramp)
