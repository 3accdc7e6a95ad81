"""One document of a result: cover, numbers, figures with captions, notes, scenario, versions."""

import platform
import textwrap
from collections.abc import Callable, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from crinoid.foundation.status import Status
from crinoid.foundation.version import __version__, versions
from crinoid.results.result import Result
from crinoid.results.scene.data import is_spatial
from crinoid.results.scene.projection import SIDE
from crinoid.results.table import equilibrium_summary, summary
from crinoid.scenario import ScenarioError
from crinoid.view.figures import style
from crinoid.view.figures.arm import points_of, smooth_arm
from crinoid.view.figures.perspective import draw_over_time
from crinoid.view.figures.sheet import box_around, draw_in
from crinoid.view.page.parts import report_file

DOCUMENT = "report.pdf"

_A4 = 8.27, 11.69  # inches
_MARGIN, _FOOT = 0.75, 0.45  # inches, the foot that of the number of a page
_LINE = 0.175  # inches between two lines
_MOST_LINES = int((_A4[1] - 2 * _MARGIN - 0.9) / _LINE)  # of a page

CAPTIONS = {
    "shape": "The arm over time, with the path of its tip and the water.",
    "tip_path": "Path of the tip about its target, and spectral density of its distance from it.",
    "bending": "Bending, twist and tension along the arm over time.",
    "cycles": "Cycles of curvature of at least a range, where the range is largest.",
    "tip_error": "Distance of the tip from its target over time, and the water at the tip.",
    "commands": "Channels of the base and actuators with their commands, and the load on the base.",
    "estimate": "Tip and current, true and estimated, with two standard deviations.",
    "loads": "Spectral densities of the force and the moment on the base.",
    "section_loads": "Bending moment and shear force along the arm: least and greatest values.",
    "vehicle": "Motion of the submarine, and forces and moments of its thrusters.",
    "energy": "Stored energies, works, and the defect of their balance.",
    "vortices": "Frequency of the shedding of vortices along the arm, and their force at the tip.",
    "contact": "Times, forces and distances of contacts.",
    "flow": "Velocity of the current over time.",
    "spectrum": "Spectral density of the current.",
    "profile": "Mean and standard deviation of the current over the height.",
    "waves": "Waves of the file, and the components that represent them.",
    "record": "Velocity, spectrum and histogram of the record.",
    "modes": "Small vibrations about the equilibrium.",
    "curve": "Equilibria over a number of the scenario.",
    "compare": "Errors and efforts of the controllers, for each seed and as means.",
    "bode": "Eigenvalues of the open loop over the frequency.",
    "nyquist": "Eigenvalues of the open loop near \N{MINUS SIGN}1.",
    "response": "Size and phase of the response of the tip to commands and current.",
    "identify": "Measurements, and the arm before and after the identification.",
    "log_estimate": "Estimates from the log, with two standard deviations.",
    "optimise": "Measures of the trials over each number.",
    "tune": "Measures of the trials over each number.",
    "training": "Cost and error over the updates of the policy.",
}
"""Captions of figures by their names."""


class Part(NamedTuple):
    """A file of a result, and functions that draw its figures by their names."""

    source: Path
    data: xr.Dataset
    run: Result | None
    figures: Mapping[str, Callable[[], Figure]]

    @property
    def title(self) -> str:
        """Its title."""
        return str(self.data.attrs.get("title", "")).strip() or self.source.stem


def write_document(path: Path, parts: list[Part]) -> Path:
    """Write the document of the files of a folder; the first one gives its title."""
    first = parts[0]
    made = f"crinoid {__version__}"
    about = {"Title": first.title, "Author": made, "Creator": made, "Subject": first.source.name}
    with (
        report_file(path, "document") as temporary,
        style.printed(_A4[0] - 2 * _MARGIN),
        PdfPages(temporary, metadata=about) as pdf,
    ):
        _Pages(pdf).write(parts)
    return path


class _Pages(NamedTuple):
    """Pages of a document, with their numbers."""

    pdf: PdfPages

    def write(self, parts: list[Part]) -> None:
        first = parts[0]
        self._cover(first)
        for part in parts:
            if part.run is not None:
                self._numbers(part.run)
        figures = [figure for part in parts for figure in part.figures.items()]
        for number, (name, draw) in enumerate(figures, 1):
            self._figure(draw(), f"Figure {number}. {CAPTIONS[name]}")
        notes = "\n".join(str(part.data.attrs.get("notes", "")) for part in parts).splitlines()
        self._text("Notes", [f"\N{BULLET} {each}" for each in notes if each], 105, "  ")
        scenario = str(first.data.attrs.get("scenario", "")).splitlines()
        self._text("Scenario", scenario, 104, "    ", family="monospace")
        version = first.data.attrs.get("crinoid_version", "unknown")
        lines = [f"The result was made with crinoid {version}, this report with:"]
        lines += [f"{name} {number}" for name, number in versions().items() if number]
        self._text("Versions", [*lines, platform.platform(), f"{date.today():%Y-%m-%d}"])

    def _cover(self, part: Part) -> None:
        page = Figure(figsize=_A4)
        title = textwrap.wrap(part.title, 52)
        look: Any = {"va": "top", "parse_math": False}
        page.text(*_at(0.0, 1.0), "\n".join(title), fontsize=20.0, **look)
        below = 1.4 + 0.34 * len(title)
        made = f"{part.source.resolve().parent.name}, {date.today():%Y-%m-%d}"
        page.text(*_at(0.0, below), made, fontsize=11.0, **look)
        status = str(part.data.attrs.get("status", "")) or Status.OK.value
        if Status.of(status) is not Status.OK:
            words = textwrap.fill(status, 90)
            page.text(*_at(0.0, below + 0.3), words, color=style.VERMILLION, **look)
        if part.run is not None:
            wide = _A4[0] - 2 * _MARGIN
            axes = style.add_axes(page, _MARGIN, 1.4, wide, 6.2)
            member = part.run.scene.members[0]
            if is_spatial(part.run.dataset):
                box = box_around(points_of(part.run.scene))
                draw_over_time(axes, part.run.scene, smooth_arm(member), box)
                axes.set_title("", loc="left")
            else:
                draw_in(axes, part.run.dataset, SIDE, None, False)
        self._save(page)

    def _numbers(self, run: Result) -> None:
        try:
            still = run.dataset.sizes["time"] == 1
            table = equilibrium_summary(run) if still else summary(run, full=True)
        except (LookupError, ValueError, ScenarioError):
            self._text("Numbers", ["The result lacks variables of the summary."])
            return
        across = (0.0, 2.9) if len(table.heads) == 2 else (0.0, 3.1, 4.7, 6.1)
        self._write("Numbers", table.rows, across, table.heads)

    def _figure(self, figure: Figure, caption: str) -> None:
        style.space_numbers(figure)
        wide, tall = figure.get_size_inches()
        tall = min(tall, _A4[1] - 2 * _MARGIN - 0.4)
        figure.set_size_inches(wide, tall)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        for legend in figure.legends:  # else it goes to the foot of the page
            place = legend.get_bbox_to_anchor().transformed(figure.transFigure.inverted())
            legend.set_bbox_to_anchor(place, figure.transFigure)
        # the page is larger than the figure, which is at its top
        low = tall + _MARGIN - _A4[1]
        figure.text(0.0, -0.15 / tall, caption, va="top", fontsize=9.0).set_in_layout(False)
        self._save(figure, Bbox.from_bounds(-_MARGIN, low, *_A4))

    def _text(
        self, head: str, lines: list[str], wide: int = 105, indent: str = "", **look: Any
    ) -> None:
        """Write lines, broken where they are wider than a number of letters."""
        broken = (textwrap.wrap(line, wide, subsequent_indent=indent) or [""] for line in lines)
        self._write(head, [[line] for lines in broken for line in lines], **look)

    def _write(
        self,
        head: str,
        rows: list[list[str]],
        across: Sequence[float] = (0.0,),
        heads: Sequence[str] = (),
        **look: Any,
    ) -> None:
        """Write rows below a head on as many pages as they need; columns are inches apart."""
        look |= {"va": "top", "parse_math": False, "fontsize": 8.0}
        for begin in range(0, len(rows), _MOST_LINES):
            page = Figure(figsize=_A4)
            words = f"{head}, continued" if begin else head
            page.text(*_at(0.0, 0.0), words, fontsize=14.0, va="top")
            shown = rows[begin : begin + _MOST_LINES]
            for index, row in enumerate([heads, *shown] if heads else shown):
                for cell, left in zip(row, across, strict=False):
                    page.text(*_at(left, 0.5 + index * _LINE), cell, **look)
            self._save(page)

    def _save(self, page: Figure, box: Bbox | None = None) -> None:
        left, low = (0.0, 0.0) if box is None else box.min
        wide, tall = page.get_size_inches()
        place = (left + _A4[0] / 2) / wide, (low + _FOOT) / tall
        number = str(self.pdf.get_pagecount() + 1)
        page.text(*place, number, ha="center", color=style.GREY).set_in_layout(False)
        self.pdf.savefig(page, bbox_inches=box)


def _at(right: float, down: float) -> tuple[float, float]:
    """Return a place on a page, in inches from the corner of its margins."""
    return (_MARGIN + right) / _A4[0], 1.0 - (_MARGIN + down) / _A4[1]
