"""The obstacles beside the arm: where they are, what they look like in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.patches import Polygon

from crinoid.report import plane
from crinoid.report.style import GREY, INK, time_map
from crinoid.scenario import Obstacle, Scenario, ScenarioError

_SOLID = "#C9C2B8"
_NEAR = 0.35  # how far beyond the arm's shapes a window looks for obstacles, of the arm's length
_BEHIND = 0.04  # depth shown behind a wall, of the arm's length
_STILL = 1e-6  # m: less is no motion


@dataclass(frozen=True)
class Body:
    """One obstacle: what it is, and where its middle is at each record."""

    name: str
    solid: Obstacle
    path: Float[np.ndarray, "time axis=2"]

    @property
    def moves(self) -> bool:
        """Whether it goes anywhere."""
        return bool(np.ptp(self.path, axis=0).max() > _STILL)

    def outline(
        self, record: int, low: Float[np.ndarray, "axis=2"], high: Float[np.ndarray, "axis=2"]
    ) -> Float[np.ndarray, "corner axis=2"]:
        """Corners of its cut at a record, of a wall as much as a window needs."""
        place = self.path[record]
        if self.solid.kind == "plane":
            out, foot = np.asarray(self.solid.out), self.nearest(record, (low + high) / 2)
            far = 2 * float(np.linalg.norm(high - low))
            side = far * plane.left_of(out)
            return np.stack(
                [foot + side, foot - side, foot - side - far * out, foot + side - far * out]
            )
        half = np.asarray(self.solid.half_axis)
        ahead = half / (np.linalg.norm(half) or 1.0)
        if not ahead.any():
            ahead = np.array([1.0, 0.0])
        turn = np.linspace(-np.pi / 2, np.pi / 2, 33)
        cap = self.solid.radius * np.outer(np.cos(turn), ahead)
        cap += self.solid.radius * np.outer(np.sin(turn), plane.left_of(ahead))
        return np.concatenate([place + half + cap, place - half - cap])

    def nearest(
        self, record: int, point: Float[np.ndarray, "axis=2"]
    ) -> Float[np.ndarray, "axis=2"]:
        """Point nearest to another one, of a wall's surface or of the line within what is round."""
        place = self.path[record]
        if self.solid.kind == "plane":
            out = np.asarray(self.solid.out)
            return np.asarray(point - ((point - place) @ out) * out)
        half = np.asarray(self.solid.half_axis)
        along = np.clip((point - place) @ half / ((half @ half) or 1.0), -1.0, 1.0)
        return np.asarray(place + along * half)


def name_of(index: int, data: xr.Dataset) -> str:
    """Name an obstacle by its place in the scenario, and its kind where that is known."""
    known = _solids(data)
    return f"{index} {known[index].kind}" if index < len(known) else f"obstacle {index}"


def find_bodies(data: xr.Dataset) -> list[Body]:
    """Find the obstacles of a result; none where it has none, or does not say what they are."""
    if "obstacle_position" not in data:
        return []
    paths = np.moveaxis(plane.project(data, "obstacle_position"), 1, 0)
    return [
        Body(str(index), solid, path)
        for index, (solid, path) in enumerate(zip(_solids(data), paths, strict=False))
    ]


def _solids(data: xr.Dataset) -> tuple[Obstacle, ...]:
    try:
        return Scenario.from_toml(str(data.attrs.get("scenario", ""))).obstacle
    except ScenarioError:
        return ()


def corners(
    bodies: list[Body], shapes: Float[np.ndarray, "point axis=2"], length: float
) -> Float[np.ndarray, "corner axis=2"]:
    """Points that a window must hold to show the obstacles, as far as they are near the arm."""
    low, high = shapes.min(axis=0) - _NEAR * length, shapes.max(axis=0) + _NEAR * length
    middle = (low + high) / 2
    points = [np.empty((0, 2))]
    for body in bodies:
        half = np.asarray(body.solid.half_axis)
        if body.solid.kind == "plane":
            feet = np.stack([body.nearest(r, middle) for r in range(len(body.path))])
            seen = np.concatenate([feet, feet - _BEHIND * length * np.asarray(body.solid.out)])
        else:
            if np.linalg.norm(half) > length:
                cores = np.stack([body.nearest(r, middle) for r in range(len(body.path))])
            else:
                cores = np.concatenate([body.path - half, body.path + half])
            seen = np.concatenate([cores - body.solid.radius, cores + body.solid.radius])
        points.append(np.clip(seen, low, high))
    return np.concatenate(points)


def draw_bodies(
    axes: Axes,
    bodies: list[Body],
    time: Float[np.ndarray, " time"],
    chosen: Int[np.ndarray, " shape"],
    low: Float[np.ndarray, "axis=2"],
    high: Float[np.ndarray, "axis=2"],
) -> None:
    """Draw obstacles at the end, and those that move at the chosen records too, in a window."""
    norm = Normalize(float(time[0]), float(max(time[-1], time[0] + 1e-12)))
    colours = time_map()(norm(time[chosen]))
    round_too = any(body.solid.kind != "plane" for body in bodies)  # rather in the key than a wall
    label = "obstacle at the end" if any(body.moves for body in bodies) else "obstacle"
    for body in bodies:
        wall = body.solid.kind == "plane"
        solid = Polygon(
            body.outline(-1, low, high),
            closed=True,
            facecolor="#F1EEEA" if wall else _SOLID,
            edgecolor=GREY if wall else INK,
            hatch="////" if wall else None,
            linewidth=0.8,
            zorder=1.2,
            label=None if wall and round_too else label,
        )
        axes.add_patch(solid)
        if body.moves:
            shapes = PolyCollection(
                [body.outline(int(record), low, high) for record in chosen],
                facecolors="none",
                edgecolors=colours,
                linewidths=0.6,
                alpha=0.55,
                zorder=1.4,
            )
            axes.add_collection(shapes, autolim=False)
            axes.plot(
                *body.path.T,
                color=INK,
                linewidth=0.8,
                linestyle=(0, (1, 1.5)),
                zorder=3.2,
                label="path of an obstacle",
            )
        if len(bodies) > 1:
            at = body.path[-1]
            if wall or np.any((at < low) | (at > high)):
                at = body.nearest(-1, (low + high) / 2)
            if wall:
                at = at - 0.025 * float(np.linalg.norm(high - low)) * np.asarray(body.solid.out)
            axes.annotate(
                body.name,
                (float(at[0]), float(at[1])),
                ha="center",
                va="center",
                fontsize=7.5,
                annotation_clip=True,
                bbox={"boxstyle": "round,pad=0.12", "facecolor": "white", "linewidth": 0},
                zorder=6,
            )
