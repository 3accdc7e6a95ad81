"""Scene of a page as data: a table, and packed numbers over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.results.result import Result
from crinoid.results.scene.bodies import rigid_bodies
from crinoid.results.scene.data import Obstacle, even_indices
from crinoid.results.scene.projection import OBLIQUE, SIDE
from crinoid.results.scene.scene import Keyframes, Scene, build_scene, colour_ranges, omission_notes
from crinoid.view.page import parts

if TYPE_CHECKING:
    from crinoid.view.page.plots import PlotDocument

FRAMES = 1501  # most instants of a run: 30 s at 50 a second
NODES = 201
NUMBERS = 600_000  # most coordinates of all arms together, above which instants are left out
_FINE = 1 / 16384  # resolution of positions, of the arm's length
_LEVELS = 250  # levels of a colour


def page_scene(result: Result) -> Scene:
    """Return the scene of a page, of limited instants and nodes."""
    sizes = result.dataset.sizes
    coordinates = min(sizes["node"], NODES) * sizes["axis"] * len(result.members)
    return build_scene(result, max(2, min(FRAMES, NUMBERS // coordinates)), NODES)


def scene_of(scene: Scene) -> tuple[dict[str, Any], str, list[str]]:
    """Return the table of a scene, its packed numbers, and notes on omissions."""
    pack, ranges, water = parts.Pack(), colour_ranges(scene), scene.members[0].water
    table = {
        "spatial": scene.spatial,
        "length": scene.length,
        "fields": [
            {"name": f.name, "label": f.label, "unit": f.unit, "signed": f.signed}
            | dict(zip(("low", "high"), ranges[f.name], strict=True))
            for f in scene.members[0].fields
        ],
        "members": [_member(each, scene, ranges, pack) for each in scene.members],
        "water": water
        and {
            "start": water.start.tolist(),
            "scale": water.scale,
            "velocity": pack.add(water.velocity, water.scale * scene.length / 4096),
        },
    }
    notes = omission_notes(scene)
    for each in scene.members:
        if each.records > each.time.size + each.omitted:
            whose = f" {each.label}" if each.label else ""
            notes.append(
                f"The animation{whose} shows {each.time.size} of {each.records} saved instants, "
                "and interpolates between them."
            )
    shown = scene.members[0].position.shape[1]
    if scene.nodes > shown:
        notes.append(f"The arm is drawn by {shown} of its {scene.nodes} nodes.")
    return table, pack.text(), notes


def animation_texts(
    scene: Scene, plots: PlotDocument, bar: str, keys: str, table: dict[str, Any]
) -> tuple[dict[str, str], list[str]]:
    """Return the texts of a page that shows a scene with charts, and notes on omissions.

    It has a ``bar`` of buttons in HTML, and a sentence on ``keys``. Scene and charts are added to
    the ``table`` of its script.
    """
    shapes, numbers, left_out = scene_of(scene)
    times = shapes["members"][0]["time"]
    table = table | {"times": times, "scene": shapes, "charts": plots.charts}
    data = {"table": parts.json_of(table), "document": parts.json_of(plots.document)}
    texts = {
        "stage": parts.filled("stage.html", still=still_of(scene), bar=bar, keys=keys),
        "data": parts.filled("data.html", numbers=numbers, **data),
        "footer": parts.bokeh_credit(),
    }
    return texts, left_out


Ranges = dict[str, tuple[float, float]]


def _member(each: Keyframes, scene: Scene, ranges: Ranges, pack: parts.Pack) -> dict[str, Any]:
    fine = _FINE * scene.length
    root = each.position[:, 0]
    flat = slice(None) if scene.spatial else slice(None, None, 2)  # a planar arm has no y
    offset = (each.position - root[:, None])[..., flat]

    def colours(values: np.ndarray, low: float, high: float) -> dict[str, Any]:
        return pack.add(np.clip(values, low, high), (high - low) / _LEVELS, low)

    def body(one: Obstacle) -> dict[str, Any]:
        some = slice(None if one.moves else 1)
        path, half = pack.add(one.path[some], fine), pack.add(one.half_axis[some], fine)
        shape = {"kind": one.kind, "radius": one.radius, "out": one.normal.tolist()}
        if one.solid is not None:
            points, facets = one.solid.points, one.solid.facets.astype(float)
            shape |= {"points": pack.add(points, fine), "facets": pack.add(facets, 1.0, 0.0)}
        return shape | {"path": path, "half": half}

    mount, target = each.mount, each.target
    bodies = {each.name: each for each in rigid_bodies(scene, each) if each.kind != "obstacle"}
    base = bodies["hull" if mount.has_hull else "base"]
    still = bool(np.ptp(target, axis=0).max() < 1e-6)
    director = None if each.director is None else pack.add(each.director, 1 / 120, -1.0)
    return {
        "label": each.label,
        "time": [round(float(t), 6) for t in each.time],
        "nodes": each.position.shape[1],
        "diameter": [round(float(d), 6) for d in each.diameter],
        "root": pack.add(root, fine),
        "offset": pack.add(offset, fine),
        "fields": {f.name: colours(f.values, *ranges[f.name]) for f in each.fields},
        "target": pack.add(target[:1] if still else target, fine),
        "anchor": pack.add(mount.anchor, fine),
        "ahead": pack.add(mount.direction, 1e-4, -1.0),
        "frame": pack.add(mount.attitude, 1e-4, -1.0),
        "rails": mount.rails,
        "capsule": "" if mount.hull is None else "floats" if mount.floats else "held",
        "bodies": [body(one) for one in each.obstacles],
        "sizes": {name: [one.shape.half, one.shape.radius] for name, one in bodies.items()},
        "out": (mount.attitude[0].T @ (mount.anchor[0] - base.position[0])).tolist(),
        "tool": None if each.tool is None else each.tool.offset,
        "held": pack.add(each.held.astype(float), 1.0, 0.0),
        "aims": scene.aims,
        "director": director,
        "threads": [
            {"kind": line.kind, "first": line.first, "pair": line.pair}
            | {"offset": np.round(line.offset, 6).tolist(), "largest": line.largest}
            | {"share": pack.add(line.share, 1 / _LEVELS)}
            for line in each.threads
        ],
    }


_SHAPES = 14
_NODES = 60
_MARGIN = 0.12  # of the larger side


def still_of(scene: Scene) -> str:
    """Return a drawing (SVG) of the arm over time, the last shape of each run in its colour."""
    view = OBLIQUE if scene.spatial else SIDE
    lines: list[tuple[str, float, Float[np.ndarray, "node 2"]]] = []
    for index, member in reversed(list(enumerate(scene.members))):
        some = even_indices(len(member.position), _SHAPES)
        shapes = view.paper(member.position[some][:, even_indices(len(member.diameter), _NODES)])
        if not index:
            parts = np.linspace(0.12, 0.4, len(shapes))
            lines += [("arm", o, shape) for o, shape in zip(parts, shapes, strict=True)]
        lines.append(("arm other" if index else "arm last", 1.0, shapes[-1]))
    target = view.paper(scene.members[0].target)[-1]
    points = np.concatenate([*(shape for _, _, shape in lines), target[None]])
    drawing = SvgDrawing.around(points, _MARGIN, 0.2 * scene.length)
    drawn = [
        f'<polyline class="{kind}" stroke-opacity="{opacity:.2f}" '
        f'stroke-width="{9 if opacity == 1.0 else 4}" points="{drawing.svg_points(shape)}"/>'
        for kind, opacity, shape in lines
    ]
    if scene.aims:
        x, y = drawing.svg_points(target[None]).split(",")
        drawn.append(f'<circle class="target" cx="{x}" cy="{y}" r="14" stroke-width="4"/>')
    return drawing.text(f"The arm over time{', and its target' * scene.aims}", drawn)


class SvgDrawing(NamedTuple):
    """A drawing (SVG) of 1000 units in its longer side."""

    low: Float[np.ndarray, " axis=2"]  # lower left corner (m)
    high: Float[np.ndarray, " axis=2"]

    @staticmethod
    def around(points: Float[np.ndarray, "point 2"], margin: float, least: float) -> SvgDrawing:
        """Return a drawing around points, its margin a share of its longer side or of a least."""
        low, high = points.min(axis=0), points.max(axis=0)
        room = margin * max(float((high - low).max()), least)
        return SvgDrawing(low - room, high + room)

    @property
    def scale(self) -> float:
        """Units of the drawing for a metre."""
        return 1000.0 / float((self.high - self.low).max())

    def svg_points(self, points: Float[np.ndarray, "point 2"]) -> str:
        """Return points (m) in the form of SVG."""
        across = self.scale * (points[:, 0] - self.low[0])
        down = self.scale * (self.high[1] - points[:, 1])
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(across, down, strict=True))

    def text(self, title: str, drawn: list[str]) -> str:
        """Return the SVG of elements, with a title that needs no escape."""
        wide, tall = self.scale * (self.high - self.low)
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide:.1f} {tall:.1f}">'
        return f"{head}<title>{title}</title>{''.join(drawn)}</svg>"
