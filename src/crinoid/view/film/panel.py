"""Panel of a film: lit surfaces sorted by distance, and lines."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_hex, to_rgb, to_rgba

from crinoid.results.scene.bodies import between
from crinoid.results.scene.clip import cut_box, obstacle_outline, shows_edge
from crinoid.results.scene.data import Point
from crinoid.results.scene.scene import Scene
from crinoid.results.units import round_down
from crinoid.view.figures.style import BLUE, INK, VERMILLION
from crinoid.view.film import surfaces as film
from crinoid.view.film.camera import Camera, Window

PAPER, SOFT, FAINT = "#F0F5F7", "#5D686D", "#A4ADB1"
TONES = (BLUE, VERMILLION)  # with control, and without
WATER = "#12A0A6"

_GHOST = 0.45  # share of the run's colour in that of a ghost
_TRAIL, _WAY = 250, 400  # pieces of the paths of tip and target
_RIM = 0.4  # points around facets, which close gaps between them
_TURN = np.linspace(0.0, 2 * np.pi, 33)


@dataclass(frozen=True)
class Strokes:
    """Short lines and their colours."""

    lines: Float[np.ndarray, "piece 2 axis=3"]
    colours: Float[np.ndarray, "piece 4"]


class FilmPanel:
    """Runs in axes: the first one with its rigid bodies, the others as ghosts."""

    def __init__(
        self,
        axes: Axes,
        scene: Scene,
        shown: Sequence[int],
        camera: Camera,
        window: Window,
        shading: film.Shading | None,
        unit: float,
    ) -> None:
        self.scene, self.camera, self.window, self.shading = scene, camera, window, shading
        (self.run, self.tone), *self.ghosts = [(scene.members[i], TONES[i]) for i in shown]
        self._bodies = film.BodySurfaces(scene, self.run, window.size)
        self._drift: Point = np.zeros(3)
        self._ruled: Point | None = None  # the drift of the present grid

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
        """Draw a time (s); the camera has moved by a drift, arrows of the water by another (m)."""
        now = film.instant_of(self.run, time)
        self._drift = drift
        self._put_grid()
        self._put_walls(now)
        if self.scene.spatial:
            flat = now.position.copy()
            flat[:, 2] = self._level()
            lines = np.stack([flat[:-1], flat[1:]], axis=1)
            self._put_lines(self.shadow, [_stroked(lines, "#B9C6CC", 1.0)])
        # the travel of each servo that shifts the root
        rails = [r for r in self.run.mount.rails if r[2] - r[1] < 3 * self.scene.length]
        ends = [now.anchor + np.multiply.outer(r[1:], now.attitude[:, r[0]]) for r in rails]
        rails_drawn = _stroked(np.reshape(ends, (-1, 2, 3)), SOFT, 0.4)
        self._put_lines(self.rails, [rails_drawn])
        thick = float(self.run.diameter[0])
        parts = [*self._bodies.at(now), film.arm_surface(now, self.tone, self.shading)]
        others = [(film.instant_of(ghost, time), colour) for ghost, colour in self.ghosts]
        # farther by the arm's thickness, so that arms in the same place do not mix
        arms = [film.arm_surface(other, pale(colour), lift=-thick) for other, colour in others]
        if self.scene.spatial:
            parts += arms
        else:  # in one plane: always behind
            film.set_surfaces(self.ghost_arms, arms, self.camera.view, drift)
        film.set_surfaces(self.solids, parts, self.camera.view, drift)
        self._put_lines(self.ghost_trails, [_trail(other, ink, 0.5) for other, ink in others])
        self._put_lines(self.trail, [_trail(now, self.tone, 1.0)])
        self._put_aim(now)
        water = [self.shafts, self.heads]
        nearer = self._put_water(now, along)
        for artist in (
            *(self.walls, self.grid, self.shadow, self.ghost_trails, self.ghost_arms),
            *([] if nearer else water),
            *(self.rails, self.solids, self.glass),
            *(water if nearer else []),
            *(self.trail, self.aim),
        ):
            artist.draw(renderer)

    def _put_lines(self, collection: LineCollection, parts: Sequence[Strokes]) -> None:
        pieces = np.concatenate([np.empty((0, 2, 3)), *(part.lines for part in parts)])
        collection.set_segments(list(self.camera.view.paper(pieces - self._drift)))
        collection.set(colors=np.concatenate([np.empty((0, 4)), *(part.colours for part in parts)]))

    def _put_grid(self) -> None:
        """Draw a grid: a floor in space, a wall behind a planar arm."""
        if self._ruled is not None and np.array_equal(self._ruled, self._drift):
            return
        self._ruled = self._drift
        spatial, window, size = self.scene.spatial, self.window, self.window.size
        a, b, c = (0, 1, 2) if spatial else (0, 2, 1)
        room, step = (1.5 if self.camera.flat else 0.3) * size, round_down(size / 6)
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
        self._put_lines(self.grid, [_stroked(np.array(pieces), FAINT, 0.38)])

    def _level(self) -> float:
        """Height of the floor, or distance of the grid behind a planar arm (m)."""
        low, high = self.window.low + self._drift, self.window.high + self._drift
        size = self.window.size
        return float(low[2] - 0.02 * size if self.scene.spatial else high[1] + 0.1 * size)

    def _put_walls(self, now: film.RunInstant) -> None:
        """Draw walls behind all bodies, or transparent in front where the eye is inside."""
        view = self.camera.view
        low, high = self.window.low, self.window.high
        behind: list[np.ndarray] = []
        before: list[np.ndarray] = []
        for body, place in zip(self.run.obstacles, now.obstacles, strict=True):
            if body.kind != "plane":
                continue
            here = replace(body, path=(place - self._drift)[None], half_axis=body.half_axis[:1])
            if shows_edge(here, view):
                behind.append(obstacle_outline(here, 0, low, high, view))
                continue
            cut, _ = cut_box(body.normal, here.nearest(0, (low + high) / 2), low, high)
            if len(cut):
                seen = float(view.sight(cut[0]) @ body.normal) > 0.0
                (behind if seen else before).append(view.paper(cut))
        for collection, outlines, alpha in ((self.walls, behind, 0.55), (self.glass, before, 0.25)):
            collection.set_verts(outlines)
            collection.set(facecolors=to_rgba(film.STONE, alpha), edgecolors=film.STONE)

    def _put_aim(self, now: film.RunInstant) -> None:
        """Draw the target as a ring with its dashed path."""
        run, view = self.run, self.camera.view
        radius = max(0.024 * self.scene.length, 0.6 * float(run.diameter[-1]))
        place = view.paper(now.target - self._drift)
        round_ = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)
        ticks = [np.outer([0.75, 1.35], round_[8 * i]) for i in range(4)]
        segments = [place + radius * each for each in (round_, *ticks)]
        inks = [to_rgba(INK, 0.95)] * len(segments)
        step = max(1, len(run.target) // _WAY)
        if np.ptp(run.target, axis=0).max() > 1e-6:
            way = view.paper(run.target[::step] - self._drift)
            dashes = [way[i : i + 2] for i in range(0, len(way) - 1, 2)]
            segments += dashes
            inks += [to_rgba(INK, 0.4)] * len(dashes)
        self.aim.set_segments(segments)
        self.aim.set_color(inks)

    def _put_water(self, now: film.RunInstant, along: Point) -> bool:
        """Draw the current as arrows next to the arm; return whether they are nearer than it."""
        water, view, length = self.scene.members[0].water, self.camera.view, self.scene.length
        if water is None:
            return False
        velocity = between(water.velocity, *film.locate(self.scene.members[0], now.time))
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


def _trail(now: film.RunInstant, tone: str, strong: float) -> Strokes:
    """Return the path of the tip, paler for earlier times."""
    times, tips = now.run.time, now.run.position[:, -1]
    count = min(now.record + 1, _TRAIL)
    some = np.linspace(max(0, now.record - 4 * _TRAIL), now.record, count).round().astype(int)
    points = np.concatenate([tips[some], now.position[-1:]])
    lines = np.stack([points[:-1], points[1:]], axis=1)
    span = (times[-1] - times[0]) / 6 or 1.0
    made = _stroked(lines, tone, 1.0)
    made.colours[:, 3] = strong * np.clip(0.9 * (1 - (now.time - times[some]) / span), 0.12, 0.9)
    return made


def _stroked(lines: Float[np.ndarray, "piece 2 axis=3"], colour: str, alpha: float) -> Strokes:
    return Strokes(lines, np.tile(np.array(to_rgba(colour, alpha)), (len(lines), 1)))


def pale(tone: str) -> str:
    """Return the colour of a ghost: a transparent tone on paper."""
    red, green, blue = _GHOST * np.array(to_rgb(tone)) + (1 - _GHOST) * np.array(to_rgb(PAPER))
    return to_hex((float(red), float(green), float(blue)))
