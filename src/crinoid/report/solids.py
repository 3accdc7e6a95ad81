"""The obstacles beside the arm, as the scenario describes them, and where they go."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.report.surface import cut_box
from crinoid.report.view import View, convex_outline, in_space, left_of

STILL = 1e-6  # m: less is no motion
_NEAR = 0.35  # how far beyond the arm's shapes a window looks for obstacles, of the arm's length
_BEHIND = 0.04  # depth shown behind a wall, of the arm's length
_ENDLESS = 1e3  # m, half the length of what has no end

Point = Float[np.ndarray, "axis=3"]


@dataclass(frozen=True)
class Solid:
    """An obstacle, as the scenario describes it."""

    kind: str
    radius: float
    """m; zero for a wall."""
    half_axis: Point
    """Half of the line within what is round (m)."""
    out: Point
    """Normal of a wall, of length one; zero for what is round."""

    @staticmethod
    def of(table: dict[str, Any]) -> Solid:
        """Read a table of the scenario, of a planar one or one in space."""
        kind = str(table["kind"])
        if kind == "plane":
            return Solid(kind, 0.0, np.zeros(3), _direction("normal", table["normal"], (2, 3)))
        half = {"cylinder": _ENDLESS, "capsule": table.get("length", 0.0) / 2}.get(kind, 0.0)
        axis = _direction("axis", table.get("axis", [0.0, 1.0, 0.0]), (3,))
        return Solid(kind, float(table["radius"]), half * axis, np.zeros(3))


def _direction(name: str, parts: Sequence[float], counts: tuple[int, ...]) -> Point:
    """Return a direction, of length one, from its parts: x and z, or x, y and z."""
    numbers = [float(part) for part in parts]
    size = math.hypot(*numbers)
    if len(numbers) not in counts or not 0.0 < size < math.inf:
        raise ValueError(f"{name} {numbers}")
    x, *y, z = numbers
    return np.array([x, *(y or [0.0]), z]) / size


@dataclass(frozen=True)
class Body:
    """One obstacle: what it is, and where its middle is at each record."""

    name: str
    solid: Solid
    path: Float[np.ndarray, "time axis=3"]

    @property
    def moves(self) -> bool:
        """Whether it goes anywhere."""
        return bool(np.ptp(self.path, axis=0).max() > STILL)

    def outline(
        self, record: int, low: Point, high: Point, view: View
    ) -> Float[np.ndarray, "corner 2"]:
        """Corners of what is seen of it at a record in a parallel view, of a wall in a window."""
        if self.solid.kind == "plane":
            out, foot = self.solid.out, self.nearest(record, (low + high) / 2)
            if not self.shows_edge(view):
                cut, behind = cut_box(out, foot, low, high)
                return convex_outline(view.paper(np.concatenate([cut, behind])))
            far = 2 * float(np.linalg.norm(view.paper(high - low)))
            out, foot = view.paper(out), view.paper(foot)
            side = far * left_of(out)
            return np.stack(
                [foot + side, foot - side, foot - side - far * out, foot + side - far * out]
            )
        place, half = view.paper(self.path[record]), view.paper(self.solid.half_axis)
        ahead = half / (np.linalg.norm(half) or 1.0)
        if not ahead.any():
            ahead = np.array([1.0, 0.0])
        turn = np.linspace(-np.pi / 2, np.pi / 2, 129)
        cap = self.solid.radius * np.outer(np.cos(turn), ahead)
        cap += self.solid.radius * np.outer(np.sin(turn), left_of(ahead))
        return np.concatenate([place + half + cap, place - half - cap])

    def is_in(self, low: Point, high: Point, view: View) -> bool:
        """Whether it is ever as far from the eye as a window: what is not would only confuse."""
        if self.solid.kind == "plane":
            return True
        middle, records = (low + high) / 2, range(len(self.path))
        depth = view.depth(np.stack([self.nearest(record, middle) for record in records]))
        near, far = sorted((float(view.depth(low)), float(view.depth(high))))
        return bool(np.any((depth > near - self.solid.radius) & (depth < far + self.solid.radius)))

    def shows_edge(self, view: View) -> bool:
        """Whether a view looks along a wall, so that its surface is a line on paper."""
        return bool(abs(view.depth(self.solid.out)) < 1e-9)

    def nearest(
        self, record: int | tuple[slice, None], points: Float[np.ndarray, "*shape axis=3"]
    ) -> Float[np.ndarray, "*shape axis=3"]:
        """Points nearest to others, of a wall's surface or of the line within what is round.

        Of points at each record, ``np.s_[:, None]`` takes it where it is at the same.
        """
        place, half, out = self.path[record], self.solid.half_axis, self.solid.out
        if self.solid.kind == "plane":
            return np.asarray(points - ((points - place) @ out)[..., None] * out)
        along = np.clip((points - place) @ half / ((half @ half) or 1.0), -1.0, 1.0)
        return np.asarray(place + along[..., None] * half)

    def is_behind(self, arm: Float[np.ndarray, "node axis=3"], view: View) -> bool:
        """Whether it is farther from the eye at the end than an arm, where they meet on paper."""
        core = self.nearest(-1, arm)
        apart = np.linalg.norm(view.paper(core) - view.paper(arm), axis=1)
        meet = np.argmin(apart)
        return bool(view.depth(core[meet]) < view.depth(arm[meet]) - STILL)


def name_of(index: int, data: xr.Dataset) -> str:
    """Name an obstacle by its index in the scenario and its kind."""
    return f"{index} {_solids(data)[index].kind}"


def find_bodies(data: xr.Dataset) -> list[Body]:
    """Find the obstacles of a result; none where it has none."""
    if "obstacle_position" not in data:
        return []
    paths = np.moveaxis(in_space(data, "obstacle_position"), 1, 0)
    return [
        Body(str(index), solid, path)
        for index, (solid, path) in enumerate(zip(_solids(data), paths, strict=True))
    ]


def _solids(data: xr.Dataset) -> tuple[Solid, ...]:
    tables = tomllib.loads(str(data.attrs["scenario"])).get("obstacle", [])
    return tuple(Solid.of(table) for table in tables)


def corners(
    bodies: list[Body], shapes: Float[np.ndarray, "point axis=3"], length: float
) -> Float[np.ndarray, "corner axis=3"]:
    """Points that a window must hold to show the obstacles, as far as they are near the arm."""
    low, high = shapes.min(axis=0) - _NEAR * length, shapes.max(axis=0) + _NEAR * length
    middle = (low + high) / 2
    points = [np.empty((0, 3))]
    for body in bodies:
        half = body.solid.half_axis
        if body.solid.kind == "plane":
            feet = np.stack([body.nearest(r, middle) for r in range(len(body.path))])
            seen = np.concatenate([feet, feet - _BEHIND * length * body.solid.out])
        else:
            if np.linalg.norm(half) > length:
                cores = np.stack([body.nearest(r, middle) for r in range(len(body.path))])
            else:
                cores = np.concatenate([body.path - half, body.path + half])
            seen = np.concatenate([cores - body.solid.radius, cores + body.solid.radius])
        points.append(np.clip(seen, low, high))
    return np.concatenate(points)
