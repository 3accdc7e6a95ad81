"""All that moves in a panel: lines and lit surfaces, the near ones over the far ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Colormap, to_hex, to_rgb, to_rgba

from crinoid.report.charts.space import Space
from crinoid.report.film.camera import Camera, Window
from crinoid.report.film.course import Course, Now, Point, between
from crinoid.report.film.frame import FAINT, PAPER, SOFT
from crinoid.report.film.parts import STEEL, STONE, mount_parts, obstacle_surface, tool_parts
from crinoid.report.style import BLUE, INK, VERMILLION
from crinoid.report.surface import AROUND, Facets, cut_box, tube

TONES = (BLUE, VERMILLION)
"""With control, and without."""
WATER = "#12A0A6"

_GHOST = 0.45  # how much of its own colour a ghost has
_TRAIL = 250  # pieces of the tip's path
_WAY = 400  # and of its target's
_PIECES = 60  # of the arm where it is coloured
_RIM = 0.4  # points about facets, so that none is seen between them
_TURN = np.linspace(0.0, 2 * np.pi, 33)


@dataclass(frozen=True)
class Surface:
    """Facets of something, with their colours."""

    facets: Facets
    colours: Float[np.ndarray, "facet 4"]
    lift: float = 0.0
    """By how much it is taken to be nearer than it is (m)."""


@dataclass(frozen=True)
class Strokes:
    """Short lines, with their colours."""

    lines: Float[np.ndarray, "piece 2 axis=3"]
    colours: Float[np.ndarray, "piece 4"]


@dataclass(frozen=True)
class Shading:
    """How the arm is coloured: by which quantity, between which values."""

    name: str
    low: float
    high: float
    ramp: Colormap


class Panel:
    """Some runs in axes: the first one with all that is about it, the others as ghosts."""

    def __init__(
        self,
        axes: Axes,
        space: Space,
        shown: Sequence[int],
        camera: Camera,
        window: Window,
        shading: Shading | None,
        unit: float,
    ) -> None:
        self.space, self.camera, self.window, self.shading = space, camera, window, shading
        self.main, *self.ghosts = [(Course(space.members[i]), TONES[i]) for i in shown]
        self._still: dict[int, Facets] = {}
        self._drift: Point = np.zeros(3)
        self._ruled: Point | None = None  # the drift for which the grid was made

        def lines(width: float) -> LineCollection:
            made = LineCollection([], linewidths=width * unit, capstyle="butt", animated=True)
            axes.add_collection(made, autolim=False)
            return made

        def surfaces(rim: float = _RIM) -> PolyCollection:
            made = PolyCollection([], linewidths=rim, joinstyle="round", animated=True)
            axes.add_collection(made, autolim=False)
            return made

        self.walls, self.grid, self.shadow = surfaces(), lines(0.06), lines(0.4)
        self.ghost_trails, self.ghost_arms = lines(0.09), surfaces()
        self.rails, self.solids, self.glass = lines(0.07), surfaces(), surfaces()
        self.trail, self.aim = lines(0.12), lines(0.13)
        self.shafts, self.heads = lines(0.14), surfaces(0.0)

    def draw(self, renderer: RendererBase, time: float, drift: Point, along: Point) -> None:
        """Draw a time (s), with the camera moved by a drift and the water's arrows along (m)."""
        course, tone = self.main
        now = course.at(time)
        self._drift = drift
        self._put_grid()
        self._put_walls(now)
        self._put_shadow(now)
        self._put_rails(now)
        thick = float(course.moving.diameter[0])
        lift = 2 * thick  # what clasps the arm is not to be cut by it
        parts = [
            _tinted(facets, ink, lift if ink == STEEL else 0.0) for facets, ink in self._things(now)
        ]
        parts.append(self._arm(course, now, tone))
        others = [(ghost.at(time), ghost, colour) for ghost, colour in self.ghosts]
        # by as much farther as an arm is thick: two that meet are not to be patched together
        arms = [
            _tinted(tube(other.position, ghost.moving.diameter, None), pale(colour), -thick)
            for other, ghost, colour in others
        ]
        if self.space.spatial:
            parts += arms
        else:  # in one plane: always behind
            self._put_surfaces(self.ghost_arms, arms)
        self._put_surfaces(self.solids, parts)
        trails = [self._trail(ghost, other, time, colour, 0.5) for other, ghost, colour in others]
        self._put_lines(self.ghost_trails, trails)
        self._put_lines(self.trail, [self._trail(course, now, time, tone, 1.0)])
        self._put_aim(now)
        water = [self.shafts, self.heads]
        nearer = self._put_water(now, time, along)
        for artist in (
            *(self.walls, self.grid, self.shadow, self.ghost_trails, self.ghost_arms),
            *([] if nearer else water),
            *(self.rails, self.solids, self.glass),
            *(water if nearer else []),
            *(self.trail, self.aim),
        ):
            artist.draw(renderer)

    def _things(self, now: Now) -> Iterator[tuple[Facets, str]]:
        moving = self.main[0].moving
        yield from mount_parts(now, moving, self.space)
        yield from tool_parts(now, moving, self.space)
        for i, (body, place) in enumerate(zip(moving.bodies, now.bodies, strict=True)):
            if body.solid.kind == "plane":
                continue
            if i not in self._still or body.moves:
                spatial, size = self.space.spatial, self.window.size
                self._still[i] = obstacle_surface(body.solid, place, size, spatial=spatial)
            yield self._still[i], STONE

    def _arm(self, course: Course, now: Now, tone: str) -> Surface:
        points, diameter, shading = now.position, course.moving.diameter, self.shading
        fields = {field.name: field for field in course.moving.fields}
        if shading is None or shading.name not in fields:
            return _tinted(tube(points, diameter, None), tone)
        values = between(fields[shading.name].values, now.at, now.share)
        # in shorter pieces, each of which has one colour
        edges = len(points) - 1
        fine = np.linspace(0.0, edges, max(1, round(_PIECES / edges)) * edges + 1)
        points, diameter, values = (_at(fine, each) for each in (points, diameter, values))
        facets = tube(points, diameter, None)
        whole = np.concatenate([values[:1], values, values[-1:]])
        middle = (whole[1:] + whole[:-1]) / 2
        colours = shading.ramp((middle - shading.low) / (shading.high - shading.low))
        return Surface(facets, np.repeat(np.asarray(colours), AROUND, axis=0))

    def _put_surfaces(self, collection: PolyCollection, parts: Sequence[Surface]) -> None:
        """Light surfaces from the upper left, and sort them by how near they are."""
        if not parts:
            return
        view = self.camera.view
        facets = np.concatenate([part.facets for part in parts]) - self._drift
        colours = np.concatenate([part.colours for part in parts])
        lifts = np.concatenate([np.full(len(part.facets), part.lift) for part in parts])
        middle = facets.mean(axis=1)
        normal = np.cross(facets[:, 2] - facets[:, 0], facets[:, 3] - facets[:, 1])
        seen = np.sum(normal * view.sight(middle), axis=1) > 0.0
        nearness = view.depth(middle) + lifts
        order = np.flatnonzero(seen)
        order = order[np.argsort(nearness[order], kind="stable")]
        facets, colours, normal = facets[order], colours[order], normal[order]
        light = view.toward + 0.8 * np.array(view.up) - 0.6 * np.array(view.across)
        area = np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)
        bright = 0.6 + 0.4 * np.maximum(normal @ light / (area * np.linalg.norm(light)), 0.0)
        colours = np.column_stack([colours[:, :3] * bright[:, None], colours[:, 3]])
        corners: Any = view.paper(facets)
        collection.set_verts(corners)  # an array is taken much faster than a list
        collection.set(facecolors=colours, edgecolors=colours)

    def _put_lines(self, collection: LineCollection, parts: Sequence[Strokes]) -> None:
        pieces = np.concatenate([np.empty((0, 2, 3)), *(part.lines for part in parts)])
        collection.set_segments(list(self.camera.view.paper(pieces - self._drift)))
        collection.set(colors=np.concatenate([np.empty((0, 4)), *(part.colours for part in parts)]))

    def _put_grid(self) -> None:
        """Lay a floor in space, and squared paper behind what is planar."""
        if self._ruled is not None and np.array_equal(self._ruled, self._drift):
            return
        self._ruled = self._drift
        spatial, window, size = self.space.spatial, self.window, self.window.size
        a, b, c = (0, 1, 2) if spatial else (0, 2, 1)
        room, step = (1.5 if self.camera.flat else 0.3) * size, _step(size / 6)
        low, high = window.low + self._drift, window.high + self._drift
        level = self._level()
        begin = np.floor((low - room) / step) * step
        end = np.ceil((high + room) / step) * step
        pieces = []
        for one, other in ((a, b), (b, a)):
            for at in np.arange(begin[one], end[one] + step / 2, step):
                piece = np.zeros((2, 3))
                piece[:, one], piece[:, other] = at, (begin[other], end[other])
                piece[:, c] = level
                pieces.append(piece)
        lines = np.array(pieces)
        self._put_lines(self.grid, [_stroked(lines, FAINT, 0.38)])

    def _level(self) -> float:
        """Height of the floor, or how far behind an arm in the plane the paper is (m)."""
        low, high = self.window.low + self._drift, self.window.high + self._drift
        size = self.window.size
        return float(low[2] - 0.02 * size if self.space.spatial else high[1] + 0.1 * size)

    def _put_walls(self, now: Now) -> None:
        """Draw walls behind everything, or like glass before it where the eye is within."""
        view = self.camera.view
        low, high = self.window.low, self.window.high
        behind: list[np.ndarray] = []
        before: list[np.ndarray] = []
        for body, place in zip(self.main[0].moving.bodies, now.bodies, strict=True):
            if body.solid.kind != "plane":
                continue
            here = replace(body, path=(place - self._drift)[None])
            if here.shows_edge(view):
                behind.append(here.outline(0, low, high, view))
                continue
            cut, _ = cut_box(body.solid.out, here.nearest(0, (low + high) / 2), low, high)
            if len(cut):
                seen = float(view.sight(cut[0]) @ body.solid.out) > 0.0
                (behind if seen else before).append(view.paper(cut))
        for collection, outlines, alpha in ((self.walls, behind, 0.55), (self.glass, before, 0.25)):
            collection.set_verts(outlines)
            collection.set(facecolors=to_rgba(STONE, alpha), edgecolors=STONE)

    def _put_shadow(self, now: Now) -> None:
        if self.space.spatial:
            flat = now.position.copy()
            flat[:, 2] = self._level()
            lines = np.stack([flat[:-1], flat[1:]], axis=1)
            self._put_lines(self.shadow, [_stroked(lines, "#B9C6CC", 1.0)])

    def _put_rails(self, now: Now) -> None:
        """Draw how far each servo can shift the root."""
        pieces = [np.empty((0, 2, 3))]
        for axis, low, high in self.main[0].moving.mount.rails:
            if high - low < 3 * self.space.length:
                ends = now.anchor + np.multiply.outer([low, high], now.frame[:, axis])
                pieces.append(ends[None])
        lines = np.concatenate(pieces)
        self._put_lines(self.rails, [_stroked(lines, SOFT, 0.4)])

    def _trail(self, course: Course, now: Now, time: float, tone: str, strong: float) -> Strokes:
        """Return where the tip went, paler the longer ago."""
        times, tips = course.moving.time, course.moving.position[:, -1]
        count = min(now.at + 1, _TRAIL)
        some = np.linspace(max(0, now.at - 4 * _TRAIL), now.at, count).round().astype(int)
        points = np.concatenate([tips[some], now.position[-1:]])
        lines = np.stack([points[:-1], points[1:]], axis=1)
        span = (times[-1] - times[0]) / 6 or 1.0
        made = _stroked(lines, tone, 1.0)
        made.colours[:, 3] = strong * np.clip(0.9 * (1 - (time - times[some]) / span), 0.12, 0.9)
        return made

    def _put_aim(self, now: Now) -> None:
        """Draw the target as a ring, and dashed the path that it takes."""
        moving, view = self.main[0].moving, self.camera.view
        radius = max(0.024 * self.space.length, 0.6 * float(moving.diameter[-1]))
        place = view.paper(now.target - self._drift)
        round_ = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)
        ticks = [np.outer([0.75, 1.35], round_[8 * i]) for i in range(4)]
        segments = [place + radius * each for each in (round_, *ticks)]
        inks = [to_rgba(INK, 0.95)] * len(segments)
        step = max(1, len(moving.target) // _WAY)
        if np.ptp(moving.target, axis=0).max() > 1e-6:
            way = view.paper(moving.target[::step] - self._drift)
            dashes = [way[i : i + 2] for i in range(0, len(way) - 1, 2)]
            segments += dashes
            inks += [to_rgba(INK, 0.4)] * len(dashes)
        self.aim.set_segments(segments)
        self.aim.set_color(inks)

    def _put_water(self, now: Now, time: float, along: Point) -> bool:
        """Draw the current as arrows beside the arm; tell whether that is nearer than the arm."""
        water, view, length = self.space.members[0].water, self.camera.view, self.space.length
        if water is None:
            return False
        course = Course(self.space.members[0])
        velocity = between(water.velocity, *course.locate(time))
        start = water.start + along - self._drift
        ends = view.paper(np.stack([start, start + velocity / water.scale]))
        way = ends[1] - ends[0]
        long = np.linalg.norm(way, axis=1)
        there = long > 1e-3 * length
        begin, way, long = ends[0][there], way[there], long[there, None]
        head = np.minimum(0.04 * length, 0.5 * long)
        ahead = way / long
        aside = 0.36 * head * np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        neck = begin + way - head * ahead
        self.shafts.set_segments(list(np.stack([begin, neck], axis=1)))
        self.heads.set_verts(list(np.stack([begin + way, neck + aside, neck - aside], axis=1)))
        self.shafts.set_color(to_rgba(WATER, 0.85))
        self.heads.set(facecolors=WATER, edgecolors="none")
        arm = now.position - self._drift
        return bool(view.depth(start).mean() > view.depth(arm).mean() + 1e-9)


def _at(
    place: Float[np.ndarray, " fine"], values: Float[np.ndarray, " node *shape"]
) -> Float[np.ndarray, " fine *shape"]:
    """Values at places along the arm, counted in nodes."""
    first = np.minimum(place.astype(int), len(values) - 2)
    share = (place - first).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1 - share) * values[first] + share * values[first + 1])


def _tinted(facets: Facets, colour: str, lift: float = 0.0) -> Surface:
    return Surface(facets, np.tile(np.array(to_rgba(colour)), (len(facets), 1)), lift)


def _stroked(lines: Float[np.ndarray, "piece 2 axis=3"], colour: str, alpha: float) -> Strokes:
    return Strokes(lines, np.tile(np.array(to_rgba(colour, alpha)), (len(lines), 1)))


def pale(tone: str) -> str:
    """Return the colour of a ghost: a tone on paper, as if one saw through it."""
    red, green, blue = _GHOST * np.array(to_rgb(tone)) + (1 - _GHOST) * np.array(to_rgb(PAPER))
    return to_hex((float(red), float(green), float(blue)))


def _step(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not above a number."""
    power = 10.0 ** np.floor(np.log10(value))
    part = value / power
    return float((5 if part >= 5 else 2 if part >= 2 else 1) * power)
