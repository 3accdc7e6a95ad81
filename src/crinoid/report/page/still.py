"""The picture that stands where nothing can move: on paper, and where there is no WebGL."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.report.charts.space import Space, evenly
from crinoid.report.view import OBLIQUE, SIDE

_SHAPES = 14
_NODES = 60
_MARGIN = 0.12  # of the larger side


def still_of(space: Space) -> str:
    """Return a drawing (SVG) of the arm over time, the last shape of each run in its colour."""
    view = OBLIQUE if space.spatial else SIDE
    lines: list[tuple[str, float, Float[np.ndarray, "node 2"]]] = []
    for index, member in reversed(list(enumerate(space.members))):
        some = evenly(len(member.position), _SHAPES)
        shapes = view.paper(member.position[some][:, evenly(len(member.diameter), _NODES)])
        if not index:
            parts = np.linspace(0.12, 0.4, len(shapes))
            lines += [("arm", o, shape) for o, shape in zip(parts, shapes, strict=True)]
        lines.append(("arm other" if index else "arm last", 1.0, shapes[-1]))
    target = view.paper(space.members[0].target)[-1]
    points = np.concatenate([*(shape for _, _, shape in lines), target[None]])
    drawing = Drawing.around(points, _MARGIN, 0.2 * space.length)
    drawn = [
        f'<polyline class="{kind}" stroke-opacity="{opacity:.2f}" '
        f'stroke-width="{9 if opacity == 1.0 else 4}" points="{drawing.placed(shape)}"/>'
        for kind, opacity, shape in lines
    ]
    x, y = drawing.placed(target[None]).split(",")
    ring = f'<circle class="target" cx="{x}" cy="{y}" r="14" stroke-width="4"/>'
    return drawing.text("The arm over time, and its target", [*drawn, ring])


class Drawing(NamedTuple):
    """A sheet 1000 units long that lines are drawn on (SVG)."""

    low: Float[np.ndarray, " axis=2"]
    """Lower left corner (m)."""
    high: Float[np.ndarray, " axis=2"]

    @staticmethod
    def around(points: Float[np.ndarray, "point 2"], margin: float, least: float) -> Drawing:
        """Return one around points (m), with a margin as a share of its longer side.

        Room is left as if that were at least ``least`` long (m).
        """
        low, high = points.min(axis=0), points.max(axis=0)
        room = margin * max(float((high - low).max()), least)
        return Drawing(low - room, high + room)

    @property
    def scale(self) -> float:
        """Units of the sheet for a metre."""
        return 1000.0 / float((self.high - self.low).max())

    def placed(self, points: Float[np.ndarray, "point 2"]) -> str:
        """Write points (m) as SVG does."""
        across = self.scale * (points[:, 0] - self.low[0])
        down = self.scale * (self.high[1] - points[:, 1])
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(across, down, strict=True))

    def text(self, title: str, drawn: list[str]) -> str:
        """Write it with some elements, and a title of which no letter needs to be escaped."""
        wide, tall = self.scale * (self.high - self.low)
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide:.1f} {tall:.1f}">'
        return f"{head}<title>{title}</title>{''.join(drawn)}</svg>"
