"""The picture that stands where nothing can move: on paper, and where there is no WebGL."""

from __future__ import annotations

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
    low, high = points.min(axis=0), points.max(axis=0)
    room = _MARGIN * max(float((high - low).max()), 0.2 * space.length)
    low, high = low - room, high + room
    scale = 1000.0 / float((high - low).max())

    def place(point: Float[np.ndarray, " axis=2"]) -> str:
        return f"{scale * (point[0] - low[0]):.1f},{scale * (high[1] - point[1]):.1f}"

    wide, tall = scale * (high - low)
    drawn = [
        f'<polyline class="{kind}" stroke-opacity="{opacity:.2f}" '
        f'stroke-width="{9 if opacity == 1.0 else 4}" points="{" ".join(map(place, shape))}"/>'
        for kind, opacity, shape in lines
    ]
    x, y = place(target).split(",")
    ring = f'<circle class="target" cx="{x}" cy="{y}" r="14" stroke-width="4"/>'
    title = "<title>The arm over time, and its target</title>"
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide:.1f} {tall:.1f}">'
    return f"{head}{title}{''.join(drawn)}{ring}</svg>"
