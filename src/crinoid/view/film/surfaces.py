"""Surfaces of a film: the arm and rigid bodies between saved instants, coloured and lit."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.collections import PolyCollection
from matplotlib.colors import Colormap, to_rgba

from crinoid.results.scene.bodies import between, rigid_bodies
from crinoid.results.scene.data import Point
from crinoid.results.scene.mesh import AROUND, Facets, arm_facets
from crinoid.results.scene.projection import View
from crinoid.results.scene.scene import Keyframes, Scene

STEEL, STONE = "#75858F", "#C2B8A8"
_COLOURS = {"hull": "#C7D1D6", "steel": STEEL, "obstacle": STONE, "tool": "#B87399"}
_SOCKET = "#74848E"
_LONGEST = 0.05  # length of facets, of the arm's: long ones cannot be sorted by distance
_PIECES = 60  # of a coloured arm


@dataclass(frozen=True)
class RunInstant:
    """One run at one time."""

    run: Keyframes
    time: float  # s
    record: int  # the saved instant before that time
    share: float  # share of the way to the next one
    position: Float[np.ndarray, "node axis=3"]
    target: Point
    anchor: Point
    attitude: Float[np.ndarray, "axis=3 axis=3"]
    obstacles: tuple[Point, ...]


def instant_of(run: Keyframes, time: float) -> RunInstant:
    """Return a run at a time (s), still before its first saved instant and after the last one."""
    place = locate(run, time)
    moving = (run.position, run.target, run.mount.anchor, run.mount.attitude)
    obstacles = tuple(between(obstacle.path, *place) for obstacle in run.obstacles)
    position, target, anchor, attitude = (between(each, *place) for each in moving)
    return RunInstant(run, time, *place, position, target, anchor, attitude, obstacles)


def locate(run: Keyframes, time: float) -> tuple[int, float]:
    """Return the saved instant before a time, and the share of the way to the next one."""
    times = run.time
    i = int(np.clip(np.searchsorted(times, time, "right") - 1, 0, max(0, times.size - 2)))
    if times.size < 2:
        return 0, 0.0
    return i, float(np.clip((time - times[i]) / (times[i + 1] - times[i]), 0.0, 1.0))


@dataclass(frozen=True)
class Shading:
    """Colours of the arm: a quantity, its range, and a colour map."""

    name: str
    low: float
    high: float
    ramp: Colormap


@dataclass(frozen=True)
class ColouredSurface:
    """Facets and their colours."""

    facets: Facets
    colours: Float[np.ndarray, "facet 4"]
    lift: float = 0.0  # distance by which it is drawn as if it were nearer (m)


class BodySurfaces:
    """Surfaces of the rigid bodies of a run, without walls and the target."""

    def __init__(self, scene: Scene, run: Keyframes, size: float) -> None:
        self._bodies = [
            (body, body.shape.mesh(_LONGEST * scene.length).facets)
            for body in rigid_bodies(scene, run, size)
            if body.material in _COLOURS and body.shape.kind != "plate"
        ]
        self._lift = 2 * float(run.diameter[0])

    def at(self, now: RunInstant) -> Iterator[ColouredSurface]:
        """Yield the surfaces of all visible bodies at a time."""
        for body, mesh in self._bodies:
            if not body.scale[now.record].any():
                continue
            facets = body.transform(mesh, now.record, now.share)
            # the arm is not to cut the clamp around it
            lift = self._lift if body.material == "steel" else 0.0
            if body.name == "clamp":  # its end, where the arm leaves it
                yield plain_surface(facets[-AROUND:], _SOCKET)
                facets = facets[:-AROUND]
            yield plain_surface(facets, _COLOURS[body.material], lift)


def arm_surface(
    now: RunInstant, tone: str, shading: Shading | None = None, lift: float = 0.0
) -> ColouredSurface:
    """Return the surface of an arm, in one tone or coloured by a quantity."""
    points, diameter = now.position, now.run.diameter
    fields = {field.name: field for field in now.run.fields}
    if shading is None or shading.name not in fields:
        return plain_surface(arm_facets(points, diameter, None), tone, lift)
    values = between(fields[shading.name].values, now.record, now.share)
    # in shorter pieces, each of one colour
    edges = len(points) - 1
    fine = np.linspace(0.0, edges, max(1, round(_PIECES / edges)) * edges + 1)
    first = np.minimum(fine.astype(int), edges - 1)
    share = fine - first
    points, diameter, values = (
        ((1 - share) * each[first].T + share * each[first + 1].T).T
        for each in (points, diameter, values)
    )
    whole = np.concatenate([values[:1], values, values[-1:]])
    middle = (whole[1:] + whole[:-1]) / 2
    colours = shading.ramp((middle - shading.low) / (shading.high - shading.low))
    facets = arm_facets(points, diameter, None)
    return ColouredSurface(facets, np.repeat(np.asarray(colours), AROUND, axis=0), lift)


def plain_surface(facets: Facets, colour: str, lift: float = 0.0) -> ColouredSurface:
    """Return facets of one colour."""
    colours = np.tile(np.array(to_rgba(colour)), (len(facets), 1))
    return ColouredSurface(facets, colours, lift)


def set_surfaces(
    collection: PolyCollection, parts: Sequence[ColouredSurface], view: View, drift: Point
) -> None:
    """Light surfaces from the upper left, sort them by their distance, and project them."""
    if not parts:
        return
    facets = np.concatenate([part.facets for part in parts]) - drift
    colours = np.concatenate([part.colours for part in parts])
    lifts = np.concatenate([np.full(len(part.facets), part.lift) for part in parts])
    middle = facets.mean(axis=1)
    normal = np.cross(facets[:, 2] - facets[:, 0], facets[:, 3] - facets[:, 1])
    visible = np.flatnonzero(np.sum(normal * view.sight(middle), axis=1) > 0.0)
    nearness = view.depth(middle) + lifts
    order = visible[np.argsort(nearness[visible], kind="stable")]
    facets, colours, normal = facets[order], colours[order], normal[order]
    colours = view.lit(colours, normal, 0.6)
    corners: Any = view.paper(facets)
    collection.set_verts(corners)  # an array is much faster than a list
    collection.set(facecolors=colours, edgecolors=colours)
