"""Panel of a film: runs of a scene in axes, at one time after another."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_hex, to_rgb, to_rgba

from crinoid.results.scene.data import Point, moves
from crinoid.results.scene.scene import Keyframes, Scene
from crinoid.results.units import round_down
from crinoid.view.figures import painter
from crinoid.view.figures.style import BLUE, INK, VERMILLION
from crinoid.view.film.camera import Camera

PAPER, SOFT, FAINT = "#F0F5F7", "#5D686D", "#A4ADB1"
TONES = (BLUE, VERMILLION)  # with control, and without
WATER = "#12A0A6"

_STONE = "#C2B8A8"
_COLOURS = {"hull": "#C7D1D6", "steel": painter.STEEL, "obstacle": _STONE, "tool": "#B87399"}
_GHOST = 0.45  # share of the run's colour in that of a ghost
_TRAIL, _WAY = 250, 400  # pieces of the paths of tip and target
_TURN = np.linspace(0.0, 2 * np.pi, 33)

Strokes = tuple[list[Float[np.ndarray, "_ 2"]], Float[np.ndarray, "_ 4"]]
"""Lines on paper and their colours."""


class FilmPanel:
    """Runs in axes: the first one with its rigid bodies, the others as ghosts."""

    def __init__(
        self,
        axes: Axes,
        scene: Scene,
        shown: Sequence[int],
        camera: Camera,
        shading: painter.Shading | None,
        unit: float,
    ) -> None:
        self.axes, self.scene, self.camera, self.shading = axes, scene, camera, shading
        self.view = camera.view
        self._limits = np.array(axes.get_xlim()), np.array(axes.get_ylim())
        (self.run, self.tone), *self.ghosts = [(scene.members[i], TONES[i]) for i in shown]
        self._bodies = painter.BodySurfaces(scene, _COLOURS, camera.size)

        def lines(width: float, order: float, colour: Any = None) -> LineCollection:
            look: Any = {"capstyle": "butt", "zorder": order, "colors": colour}
            made = LineCollection([], linewidths=width * unit, **look)
            axes.add_collection(made, autolim=False)
            return made

        def surfaces(order: float, alpha: float = 1.0) -> PolyCollection:
            look: Any = {"linewidths": 0.4, "joinstyle": "round", "zorder": order}
            look |= {"facecolors": to_rgba(_STONE, alpha), "edgecolors": _STONE}
            made = PolyCollection([], **look)
            axes.add_collection(made, autolim=False)
            return made

        self.walls, self.shadow = surfaces(1.0, 0.55), lines(0.4, 1.2, "#B9C6CC")
        self.grid = [lines(0.06, 1.1, to_rgba(FAINT, 0.38)) for _ in range(2)]
        self.behind, self.solids, self.glass = lines(0.08, 1.3), surfaces(2.0), surfaces(2.1, 0.25)
        self.trail, self.aim = lines(0.12, 4.0), lines(0.13, 4.1)
        self.water: Any = None
        if (water := scene.members[0].water) is not None:
            look: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "minlength": 0.0}
            look |= {"units": "dots", "width": 0.19 * unit, "headwidth": 4.0, "headlength": 6.0}
            nothing = np.zeros((4, len(water.start)))
            self.water = axes.quiver(*nothing, color=WATER, **look)
        still = self.walls, *self.grid  # the backdrop of the axes, above which `draw` draws
        self._moving = [each for each in axes.collections if each not in still]
        for each in self._moving:
            each.set_animated(True)
        self._backdrop: list[np.ndarray] = []

    def draw(self) -> None:
        """Draw all that moves on the canvas."""
        for each in sorted(self._moving, key=lambda artist: artist.get_zorder()):
            self.axes.draw_artist(each)

    def show(self, time: float, drift: Point, along: Point) -> bool:
        """Show a time (s); the camera has moved by a drift, arrows of the water by another (m).

        Return whether the backdrop, walls and grid, differs from that of the time before.
        """
        scene, camera = self.scene, self.camera
        across, ahead, up = map(float, camera.view.centre + drift)
        self.view = view = replace(camera.view, centre=(across, ahead, up))
        x, y = (limits + way @ drift for limits, way in zip(self._limits, view.plane, strict=True))
        self.axes.set(xlim=x, ylim=y)
        low, high = camera.low + drift, camera.high + drift
        now = painter.instant(self.run, time)
        others = [(painter.instant(ghost, time), ghost, colour) for ghost, colour in self.ghosts]
        # ghosts are farther by the arm's thickness, so that arms in the same place do not mix; in
        # one plane they are always behind
        lift = -float(self.run.diameter[0]) if scene.spatial else -1e9
        arms = [painter.arm_surface(each, pale(colour), lift=lift) for each, _, colour in others]
        arm = painter.arm_surface(now, self.tone, self.shading)
        painter.paint(self.solids, [*self._bodies.at(now), arm, *arms], view)
        behind, before = painter.wall_outlines(now.obstacles, low, high, view)
        self.glass.set_verts(before)
        backdrop, earlier = [drift, *behind], self._backdrop
        fresh = len(backdrop) != len(earlier) or not all(map(np.array_equal, backdrop, earlier))
        if fresh:
            self._backdrop = backdrop
            self.walls.set_verts(behind)
            self._put_grid(low, high)
        if scene.spatial:
            flat = now.position[0].copy()
            flat[:, 2] = self._level
            self.shadow.set_segments([view.paper(flat)])
        # the travel of each servo that shifts the root
        anchor, attitude = now.mount.anchor[0], now.mount.attitude[0]
        rails = [r for r in self.run.mount.rails if r[2] - r[1] < 3 * scene.length]
        ends = [anchor + np.outer(r[1:], attitude[:, r[0]]) for r in rails]
        strokes = [([view.paper(each) for each in ends], _inks(SOFT, 0.4, len(ends)))]
        _put(self.behind, strokes + [self._trail(*other, 0.5) for other in others])
        _put(self.trail, [self._trail(now, self.run, self.tone, 1.0)])
        _put(self.aim, self._aim(now))
        if self.water is not None:
            self._put_water(now, along)
        return fresh

    def _put_grid(self, low: Point, high: Point) -> None:
        """Draw a grid: a floor in space, a wall behind a planar arm."""
        size, spatial = self.camera.size, self.scene.spatial
        # z of the floor, or y of the wall (m)
        self._level = float(low[2] - 0.02 * size if spatial else high[1] + 0.1 * size)
        a, b = (0, 1) if spatial else (0, 2)
        room, step = (1.5 if self.camera.flat else 0.3) * size, round_down(size / 6)
        begin = np.floor((low - room) / step) * step
        end = np.ceil((high + room) / step) * step
        for one, other, grid in ((a, b, self.grid[0]), (b, a, self.grid[1])):
            places = np.arange(begin[one], end[one] + step / 2, step)
            pieces = np.full((len(places), 2, 3), self._level)
            pieces[..., one], pieces[..., other] = places[:, None], (begin[other], end[other])
            grid.set_segments(list(self.view.paper(pieces)))

    def _trail(self, now: Keyframes, run: Keyframes, tone: str, strong: float) -> Strokes:
        """Return the path of the tip, paler for earlier times."""
        (record, _), times = painter.locate(run, now.time[0]), run.time
        count = min(record + 1, _TRAIL)
        some = np.linspace(max(0, record - 4 * _TRAIL), record, count).round().astype(int)
        points = self.view.paper(np.concatenate([run.position[some, -1], now.position[:, -1]]))
        span = (times[-1] - times[0]) / 6 or 1.0
        inks = _inks(tone, strong, count)
        inks[:, 3] *= np.clip(0.9 * (1 - (now.time[0] - times[some]) / span), 0.12, 0.9)
        return list(np.stack([points[:-1], points[1:]], axis=1)), inks

    def _aim(self, now: Keyframes) -> list[Strokes]:
        """Return the target, if there is one, as a ring with its dashed path."""
        if not self.scene.aims:
            return [([], _inks(INK, 0.0, 0))]
        run, view = self.run, self.view
        radius = max(0.024 * self.scene.length, 0.6 * float(run.diameter[-1]))
        ring = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)
        marks = [ring, *(np.outer([0.75, 1.35], ring[8 * i]) for i in range(4))]
        place, dashes = view.paper(now.target[0]), []
        if moves(run.target):
            way = view.paper(run.target[:: max(1, len(run.target) // _WAY)])
            dashes = [way[i : i + 2] for i in range(0, len(way) - 1, 2)]
        drawn = [place + radius * each for each in marks]
        return [(drawn, _inks(INK, 0.95, len(drawn))), (dashes, _inks(INK, 0.4, len(dashes)))]

    def _put_water(self, now: Keyframes, along: Point) -> None:
        """Draw the current as arrows next to the arm, in front of it where they are nearer."""
        water, view = painter.instant(self.scene.members[0], now.time[0]).water, self.view
        assert water is not None
        start = water.start + along
        ends = view.paper(np.stack([start, start + water.velocity[0] / water.scale]))
        self.water.set_offsets(ends[0])
        self.water.set_UVC(*(ends[1] - ends[0]).T)
        nearer = view.depth(start).mean() > view.depth(now.position[0]).mean() + 1e-9
        self.water.set_zorder(3.0 if nearer else 1.25)


def _put(collection: LineCollection, strokes: list[Strokes]) -> None:
    collection.set_segments([line for lines, _ in strokes for line in lines])
    collection.set(color=np.concatenate([inks for _, inks in strokes]))


def _inks(colour: str, alpha: float, count: int) -> Float[np.ndarray, "line 4"]:
    return np.tile(to_rgba(colour, alpha), (count, 1))


def pale(tone: str) -> str:
    """Return the colour of a ghost: a transparent tone on paper."""
    red, green, blue = _GHOST * np.array(to_rgb(tone)) + (1 - _GHOST) * np.array(to_rgb(PAPER))
    return to_hex((float(red), float(green), float(blue)))
