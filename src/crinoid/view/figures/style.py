"""How every figure looks: colours, type, and the frame around the panels."""

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from jaxtyping import Float, Int
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.textpath import TextPath
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator
from matplotlib.transforms import Bbox

from crinoid.foundation.status import Status

# the palette of Okabe and Ito (2008), for all common kinds of colour blindness and in grey
BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY = "#56B4E9"
INK = "#262626"
GREY = "#8C8C8C"
PALE = "#DDE3E6"
AXIS_COLOURS = {"x": GREEN, "y": PURPLE, "z": ORANGE}
SERIES = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY, INK, GREY)

_SCREEN = 7.4  # inches, width of figures that are for no journal
_NARROW = 5.0  # inches, width below which panels are below each other
BAR_BELOW = 0.6  # inches, from the foot of panels to that of a bar below them
_PRINTED: ContextVar[float | None] = ContextVar("printed", default=None)
"""Width of the figures of a paper (inches); None on the screen."""
_EDGE = 0.08  # inches, paper's edge to the title
_LETTERS = 20  # of a line of a legend that lies within narrow axes
_LINE = 0.185  # inches, a line of the title
_KEY: Any = {"bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2, "borderpad": 0.1}
_KEY |= {"columnspacing": 1.6, "handlelength": 1.9}
_HANDLE = 3.5  # heights of letters that an entry of a legend has besides its words

STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "figure.labelsize": "medium",
    "axes.labelsize": 9.0,
    "axes.titlesize": 9.5,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.3,
    "lines.solid_capstyle": "round",
    "pdf.fonttype": 42,  # whole fonts: publishers refuse type 3
    "ps.fonttype": 42,
    "savefig.dpi": 200,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "crinoid",  # the same figure gives the same file
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "axes.unicode_minus": True,
    "text.usetex": False,
    "agg.path.chunksize": 10000,
}
_PAPER: Any = STYLE | {
    **dict.fromkeys(("font.size", "axes.labelsize", "axes.titlesize"), 8.0),
    **dict.fromkeys(("legend.fontsize", "xtick.labelsize", "ytick.labelsize"), 7.0),
    **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width"), 0.5),
    "lines.linewidth": 1.0,
    "grid.linewidth": 0.4,
    "savefig.dpi": 600,
}
"""Style of the figures of a paper: in a journal, 7 to 8 pt."""


@contextmanager
def printed(width: float | None) -> Iterator[None]:
    """Draw within the style: for the screen, or in a width (inches) for a paper, untitled."""
    token = _PRINTED.set(width)
    try:
        with mpl.rc_context(_PAPER if width else STYLE):
            yield
    finally:
        _PRINTED.reset(token)


def width() -> float:
    """Return the width of a figure (inches)."""
    return _PRINTED.get() or _SCREEN


def scale() -> float:
    """Return the scale of heights and margins: figures of a paper are smaller."""
    return 1.0 if _PRINTED.get() is None else 0.8 if narrow() else 0.9


def narrow() -> bool:
    """Whether figures are as narrow as a column of a journal."""
    return width() < _NARROW


def new_figure(tall: float) -> Figure:
    """Return a figure of some height on the screen (inches), which lays out its panels."""
    return Figure(figsize=(width(), scale() * tall), layout="constrained")


def columns(wide: float, most: int) -> int:
    """Return how many panels of a width (inches) at least are side by side."""
    return max(1, min(most, int(width() / wide)))


def small() -> float:
    """Return the size of small letters (pt)."""
    return 8.5 if _PRINTED.get() is None else 7.0


def time_map() -> Colormap:
    """Perceptually uniform colours for time, without the yellow that white paper swallows."""
    return ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.9, 256)), name="time")


def time_norm(time: Float[np.ndarray, " time"]) -> Normalize:
    """From the times of a run, or other numbers, to their positions among the colours."""
    return Normalize(float(time.min()), float(max(time.max(), time.min() + 1e-12)))


def timed(time: Float[np.ndarray, " time"], records: Int[np.ndarray, " chosen"]) -> dict[str, Any]:
    """Keywords of a collection with a colour of the time for each of some records."""
    return {"array": time[records], "cmap": time_map(), "norm": time_norm(time)}


def add_axes(figure: Figure, left: float, foot: float, wide: float, high: float) -> Axes:
    """Add axes to a figure, in inches."""
    width, height = figure.get_size_inches()
    return figure.add_axes((left / width, foot / height, wide / width, high / height))


def time_bar(figure: Figure | SubFigure, data: xr.Dataset, title: str = "", **place: Any) -> None:
    """Draw the colour bar of times at a place, if there is more than one time."""
    if data.sizes["time"] > 1:
        bar = figure.colorbar(ScalarMappable(time_norm(data["time"].values), time_map()), **place)
        bar.ax.set_title(title, fontsize=small())
        bar.ax.grid(visible=False)


def time_bar_at(figure: Figure, data: xr.Dataset, panels: Bbox) -> None:
    """Draw the colour bar of times right of panels (inches), or below in a narrow figure."""
    wide, thick = (panels.width if narrow() else panels.height), 0.13 * scale()
    place = panels.x1 + 0.15, panels.y0, thick, wide
    look: Any = {}
    if narrow():
        place = panels.x0, panels.y0 - BAR_BELOW, wide, thick
        look = {"orientation": "horizontal"}
    if data.sizes["time"] > 1:
        ticks = MaxNLocator(max(2, min(6, int(wide / 0.4))))
        time_bar(figure, data, cax=add_axes(figure, *place), ticks=ticks, label="time (s)", **look)


def key_of(figure: Figure, panels: Iterable[Axes], where: str = "outside lower center") -> None:
    """Put one legend of all panels into a figure; see `key_with`."""
    found = [axes.get_legend_handles_labels() for axes in panels]
    entries = {label: handle for each in found for handle, label in zip(*each, strict=True)}
    key_with(figure, list(entries.values()), where)


def key_with(figure: Figure, handles: list[Any], where: str) -> None:
    """Put a legend of some handles into a figure.

    Outside of panels that lay themselves out these make room; else the figure grows at its foot.
    """
    words = [str(each.get_label()) for each in handles]
    most = 1 if "right" in where else 4
    place: Any = {"loc": where, "ncols": _columns(words, width() - 0.3, most), "borderaxespad": 0.3}
    legend = figure.legend(handles=handles, **place)
    if "lower" not in where or "outside" in where:
        return
    wide, tall = figure.get_size_inches()
    more = legend.get_window_extent().height / figure.dpi + 0.05
    figure.set_size_inches(wide, tall + more)
    for axes in figure.axes:
        left, low, right, high = axes.get_position().extents
        ends = ((each * tall + more) / (tall + more) for each in (low, high))
        axes.set_position(Bbox.from_extents(left, next(ends), right, next(ends)))
    for text in figure.texts:
        text.set_y((text.get_position()[1] * tall + more) / (tall + more))


def _columns(words: Iterable[str], room: float, most: int) -> int:
    """Return how many columns of a legend have room (inches), of at most some."""
    size = small()
    wide = [TextPath((0.0, 0.0), each, size=size).get_extents().width for each in words]
    return max(1, min(most, len(wide), int(72 * room / (max(wide, default=0) + _HANDLE * size))))


def head_of(figure: Figure, data: xr.Dataset, title: str = "") -> None:
    """Write the title and the status of a dataset; without a title the given one."""
    found = str(data.attrs.get("title", "")).strip() or title
    head(figure, found, str(data.attrs.get("status", "")) or Status.OK.value)


def head(figure: Figure, title: str, status: str) -> None:
    """Write the title, and under it what went wrong where something did; keep panels clear.

    Figures of a paper have no title.
    """
    wide, tall = figure.get_size_inches()
    lines, notes = _head_lines(title, status)
    x, y = _EDGE / wide, 1.0 - _EDGE / tall
    literal: Any = {"va": "top", "parse_math": False}
    if lines:
        figure.text(x, y, "\n".join(lines), fontsize=10.5, **literal)
    below = y - len(lines) * _LINE / tall
    figure.text(x, below, "\n".join(notes), **literal, color=VERMILLION)
    lay_out_below(figure, tall - head_height(title, status))


def lay_out_below(figure: Figure, height: float) -> None:
    """Keep the panels that lay themselves out below a height in inches."""
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0.0, 0.0, 1.0, height / float(figure.get_size_inches()[1])))


def head_height(title: str, status: str) -> float:
    """Height of the head of a figure, in inches, as `head` writes it."""
    return _EDGE + _LINE * sum(len(lines) for lines in _head_lines(title, status))


def _head_lines(title: str, status: str) -> tuple[list[str], list[str]]:
    look: Any = {"width": int(11.5 * width()), "placeholder": " ..."}
    lines = [] if _PRINTED.get() else textwrap.wrap(title, max_lines=2, **look) or [" "]
    failed = Status.of(status) is not Status.OK
    return lines, textwrap.wrap(status, max_lines=3, **look) if failed else []


def key_within(axes: Axes) -> float:
    """Put the legend into the upper left corner of axes; return its share of their height."""
    key(axes, 1, within=True)
    legend = axes.get_legend()
    texts = [] if legend is None else legend.get_texts()
    lines = sum(1 + text.get_text().count("\n") for text in texts)
    return min(0.5, lines * line_share(axes))


def line_share(axes: Axes) -> float:
    """Return the share of the height of axes that a line of text needs."""
    return min(0.25, _LINE * axes.figure.dpi / axes.bbox.height)


def key(axes: Axes, columns: int = 4, *, within: bool = False) -> None:
    """Put the legend above the panel, where no data can be under it, each entry once."""
    handles, labels = axes.get_legend_handles_labels()
    entries = dict(zip(labels, handles, strict=True))
    if entries:
        room = axes.bbox.width / axes.figure.dpi
        letters = _LETTERS if within else int(72 * room / (0.6 * small())) - 4
        words = [textwrap.fill(label, max(_LETTERS, letters)) for label in entries]
        corner: Any = "upper left" if within else "lower left"
        most = columns if within else _columns(words, room, columns)
        axes.legend(list(entries.values()), words, loc=corner, ncols=most, **_KEY)


def space_numbers(figure: Figure) -> None:
    """Write fewer numbers at axes where they would touch, and turn names."""
    figure.draw_without_rendering()
    for axis in [each for axes in figure.axes for each in (axes.xaxis, axes.yaxis)]:
        labels = [each for each in axis.get_ticklabels() if each.get_visible() and each.get_text()]
        boxes = [each.get_window_extent() for each in labels]
        across = axis.axis_name == "x"
        ends = sorted((box.intervalx if across else box.intervaly).tolist() for box in boxes)
        room = figure.dpi * (small() / 216 if across else 0.0)  # a third of a letter
        if not any(next_[0] - last[1] < room for last, next_ in pairwise(ends)):
            continue
        locator = axis.get_major_locator()
        if isinstance(locator, LogLocator):
            locator.set_params(subs=(1.0,), numticks=3)
        elif isinstance(locator, FixedLocator):
            axis.set_tick_params(labelrotation=45)
        elif isinstance(locator, MaxNLocator):
            axis.set_major_locator(MaxNLocator(max(1, len(labels) // 2), steps=[1, 2, 5, 10]))


def wrap(words: str, panels: int = 1) -> str:
    """Break words into lines that fit below one of some panels that are side by side."""
    return textwrap.fill(words, int(72 * width() * 0.85 / panels / (0.55 * small())))


def note(axes: Axes, text: str) -> None:
    """Write a sentence in the middle of an empty panel."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=GREY)


def share_time(panels: Sequence[Axes], time: Float[np.ndarray, " time"]) -> None:
    """Set one time axis for stacked panels, labelled on the last."""
    for axes in panels:
        if time.size > 1 and time[-1] > time[0]:
            axes.set_xlim(float(time[0]), float(time[-1]))
        axes.label_outer()
    panels[-1].set_xlabel("time (s)")
