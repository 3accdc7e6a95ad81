"""Instants of a scene in axes of matplotlib: lit surfaces sorted by their distance, and walls."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.collections import PolyCollection
from matplotlib.colors import Colormap, to_rgba

from crinoid.results.scene.bodies import rigid_bodies
from crinoid.results.scene.clip import cut_box, obstacle_outline, shows_edge
from crinoid.results.scene.data import Obstacle, Point, Points
from crinoid.results.scene.mesh import AROUND, Facets, arm_facets
from crinoid.results.scene.projection import PaperPoints, View
from crinoid.results.scene.scene import Keyframes, Scene

STEEL = "#75858F"
_SOCKET = "#74848E"  # the end of the clamp, where the arm leaves it
_LONGEST = 0.05  # length of facets, of the arm's: long ones cannot be sorted by distance
_PIECES = 60  # of a coloured arm
_DARK = 0.6  # brightness of facets in shadow

Colours = Float[np.ndarray, "_ 4"]


class Shading(NamedTuple):
    """Colours of the arm: a quantity, its range, and a colour map."""

    name: str
    low: float
    high: float
    ramp: Colormap


class Surface(NamedTuple):
    """Facets, their colours, and the distance by which they are drawn as if nearer (m)."""

    facets: Facets
    colours: Colours  # of each facet, or of all
    lift: float = 0.0


def locate(run: Keyframes, time: float) -> tuple[int, float]:
    """Return the saved instant before a time (s), and the share of the way to the next one."""
    place = float(np.interp(time, run.time, np.arange(run.time.size)))
    record = min(int(place), max(run.time.size - 2, 0))
    return record, place - record


def instant(run: Keyframes, time: float) -> Keyframes:
    """Return a run at a time (s), still before its first saved instant and after the last one."""
    record, share = locate(run, time)

    def at(values: np.ndarray) -> np.ndarray:
        here = values[[record]]
        return here if share == 0.0 else (1.0 - share) * here + share * values[[record + 1]]

    mount = run.mount
    held = [at(each) for each in (mount.anchor, mount.direction, mount.attitude)]
    bodies = [(each, at(each.path), at(each.half_axis)) for each in run.obstacles]
    return replace(
        run,
        at=run.at[[record]],
        time=np.array([time]),
        position=at(run.position),
        target=at(run.target),
        fields=tuple(replace(field, values=at(field.values)) for field in run.fields),
        mount=replace(mount, anchor=held[0], direction=held[1], attitude=held[2]),
        obstacles=tuple(replace(body, path=path, half_axis=half) for body, path, half in bodies),
        water=run.water and replace(run.water, velocity=at(run.water.velocity)),
        held=run.held[[record]],
    )


def line_surface(points: Points, colour: Any) -> Surface:
    """Return a line as facets without width, which bodies may hide in part."""
    ends = np.stack([points[:-1], points[1:]], axis=1)
    return Surface(ends[:, [0, 1, 1, 0]], np.array([to_rgba(colour)]))


class BodySurfaces:
    """Surfaces of the rigid bodies of runs, without walls and the target.

    ``colours`` are those of the materials that are drawn; endless poles have a reach (m).
    """

    def __init__(self, scene: Scene, colours: Mapping[str, str], reach: float) -> None:
        self._scene, self._colours, self._reach = scene, colours, reach
        self._meshes: dict[str, Facets] = {}

    def at(self, now: Keyframes) -> Iterator[Surface]:
        """Yield the surfaces of all visible bodies at an instant."""
        inks = {name: np.array([to_rgba(each)]) for name, each in self._colours.items()}
        for body in rigid_bodies(self._scene, now, self._reach):
            if body.material not in inks or body.shape.kind == "plate" or not body.scale.any():
                continue
            if body.name not in self._meshes:
                longest = _LONGEST * self._scene.length
                self._meshes[body.name] = body.shape.mesh(longest).facets
            facets = body.transform(self._meshes[body.name], 0)
            # the arm is not to cut the clamp around it, of which it leaves the end
            lift = 2 * float(now.diameter[0]) if body.material == "steel" else 0.0
            if body.name == "clamp":
                yield Surface(facets[-AROUND:], np.array([to_rgba(_SOCKET)]))
                facets = facets[:-AROUND]
            yield Surface(facets, inks[body.material], lift)


def arm_surface(
    now: Keyframes, tone: str, shading: Shading | None = None, lift: float = 0.0
) -> Surface:
    """Return the surface of an arm at an instant, in one tone or coloured by a quantity."""
    points, thick, edges = now.position[0], now.diameter, len(now.diameter) - 1
    fields = {field.name: field.values[0] for field in now.fields}
    if shading is None or shading.name not in fields:
        return Surface(arm_facets(points, thick, None), np.array([to_rgba(tone)]), lift)
    # in shorter pieces, each of one colour
    nodes = np.arange(edges + 1)
    fine = np.linspace(0.0, edges, max(1, round(_PIECES / edges)) * edges + 1)
    *line, thick, values = (
        np.interp(fine, nodes, each) for each in (*points.T, thick, fields[shading.name])
    )
    values = np.concatenate([values[:1], values, values[-1:]])
    shares = ((values[1:] + values[:-1]) / 2 - shading.low) / (shading.high - shading.low)
    facets = arm_facets(np.stack(line, axis=1), thick, None)
    return Surface(facets, np.repeat(shading.ramp(shares), AROUND, axis=0), lift)


def paint(
    collection: PolyCollection, parts: Iterable[Surface], view: View, *, whole: bool = True
) -> None:
    """Put surfaces into a collection: lit from the upper left, from far to near, on paper.

    Of whole bodies the far side is left out; others are open, and lines are among them.
    """
    parts = list(parts)
    facets = np.concatenate([part.facets for part in parts])
    colours = np.concatenate([np.broadcast_to(p.colours, (len(p.facets), 4)) for p in parts])
    lifts = np.repeat([part.lift for part in parts], [len(part.facets) for part in parts])
    middle = facets.mean(axis=1)
    normal = np.cross(facets[:, 2] - facets[:, 0], facets[:, 3] - facets[:, 1])
    toward = np.sum(normal * view.sight(middle), axis=1)
    if not whole:
        normal *= np.where(toward < 0.0, -1.0, 1.0)[:, None]
        toward = np.abs(toward)
    seen = np.flatnonzero(toward >= 0.0)
    order = seen[np.argsort((view.depth(middle) + lifts)[seen], kind="stable")]
    lit = view.lit(colours[order], normal[order], _DARK)
    corners: Any = view.paper(facets[order])
    collection.set_verts(corners)  # an array is much faster than a list
    collection.set(facecolors=lit, edgecolors=lit)
    if not whole:  # lines have no area
        collection.set(linewidths=np.where(normal[order].any(axis=1), 0.4, 1.0))


def wall_outlines(
    obstacles: Iterable[Obstacle], low: Point, high: Point, view: View
) -> tuple[list[PaperPoints], list[PaperPoints]]:
    """Return outlines of walls in a box: those behind all bodies, and those around the eye."""
    behind: list[PaperPoints] = []
    before: list[PaperPoints] = []
    for body in (body for body in obstacles if body.kind == "plane"):
        if shows_edge(body, view):
            behind.append(obstacle_outline(body, 0, low, high, view))
            continue
        cut, _ = cut_box(body.normal, body.nearest(0, (low + high) / 2), low, high)
        if len(cut):
            seen = float(view.sight(cut[0]) @ body.normal) > 0.0
            (behind if seen else before).append(view.paper(cut))
    return behind, before
