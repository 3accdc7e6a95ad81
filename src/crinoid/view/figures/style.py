"""How every figure looks: colours, type, and the frame around the panels."""

import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float, Int
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator

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

WIDTH = 7.4  # inches
_EDGE = 0.08  # inches, paper's edge to the title
_LETTERS = 20  # of a line of a legend that lies within narrow axes
_LINE = 0.185  # inches, a line of the title
_KEY: Any = {"bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2, "borderpad": 0.1}
_KEY |= {"columnspacing": 1.6, "handlelength": 1.9}
_TITLE: Any = {"fontsize": 10.5, "fontweight": "bold"}

STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
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


def time_map() -> Colormap:
    """Perceptually uniform colours for time, without the yellow that white paper swallows."""
    return ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.9, 256)), name="time")


def time_norm(time: Float[np.ndarray, " time"]) -> Normalize:
    """From the times of a run to their positions among the colours."""
    return Normalize(float(time[0]), float(max(time[-1], time[0] + 1e-12)))


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
        bar.ax.set_title(title, fontsize=8.5)
        bar.ax.grid(visible=False)


def narrow_time_bar(
    figure: Figure, data: xr.Dataset, left: float, foot: float, high: float
) -> None:
    """Draw the colour bar of times at a place in inches, if there is more than one time."""
    if data.sizes["time"] > 1:
        ticks = MaxNLocator(max(2, min(6, int(high / 0.4))))
        axes = add_axes(figure, left, foot, 0.13, high)
        time_bar(figure, data, cax=axes, ticks=ticks, label="time (s)")


def key_below(figure: Figure, panels: Iterable[Axes], where: Any = "lower center") -> None:
    """Put one legend of all panels at the foot of the page; outside: panels make room for it."""
    found = [axes.get_legend_handles_labels() for axes in panels]
    entries = {label: handle for each in found for handle, label in zip(*each, strict=True)}
    figure.legend(list(entries.values()), list(entries), loc=where, ncols=4, borderaxespad=0.3)


def head_of(figure: Figure, data: xr.Dataset, title: str = "") -> None:
    """Write the title and the status of a dataset; without a title the given one."""
    found = str(data.attrs.get("title", "")).strip() or title
    head(figure, found, str(data.attrs.get("status", "")) or Status.OK.value)


def head(figure: Figure, title: str, status: str) -> None:
    """Write the title, and under it what went wrong where something did; keep panels clear."""
    wide, tall = figure.get_size_inches()
    lines, notes = _head_lines(title, status, wide)
    x, y = _EDGE / wide, 1.0 - _EDGE / tall
    literal: Any = {"va": "top", "parse_math": False}
    figure.text(x, y, "\n".join(lines), **literal, **_TITLE)
    below = y - len(lines) * _LINE / tall
    figure.text(x, below, "\n".join(notes), **literal, color=VERMILLION)
    lay_out_below(figure, tall - head_height(title, status, wide))


def lay_out_below(figure: Figure, height: float) -> None:
    """Keep the panels that lay themselves out below a height in inches."""
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0.0, 0.0, 1.0, height / float(figure.get_size_inches()[1])))


def head_height(title: str, status: str, wide: float) -> float:
    """Height of the head of a figure, in inches, as `head` writes it."""
    return _EDGE + _LINE * sum(len(lines) for lines in _head_lines(title, status, wide))


def _head_lines(title: str, status: str, wide: float) -> tuple[list[str], list[str]]:
    lines = textwrap.wrap(title, int(10.5 * wide), max_lines=2, placeholder=" ...") or [" "]
    if Status.of(status) is Status.OK:
        return lines, []
    return lines, textwrap.wrap(status, int(11.5 * wide), max_lines=3, placeholder=" ...")


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
        words = [textwrap.fill(label, _LETTERS) if within else label for label in entries]
        corner: Any = "upper left" if within else "lower left"
        axes.legend(list(entries.values()), words, loc=corner, ncols=columns, **_KEY)


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
