"""The camera: from where it looks, what it keeps up with, and how much fits into a picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from crinoid.report.charts.space import Moving, Space, evenly
from crinoid.report.solids import Body
from crinoid.report.view import View

PRESETS = {
    "side": (-90.0, 0.0),
    "above": (-90.0, 90.0),
    "ahead": (0.0, 0.0),
    "angle": (-58.0, 27.0),
}
"""Azimuth and elevation (deg) of the presets, which are those of the page."""

_TRAVELS = 1.5  # a base that goes farther is followed, of the arm's length
_NEAR = 0.35  # how far beyond the arm obstacles are shown, of its length
_MARGIN = 1.12
_FAR = 2.2  # the eye's distance, of the diagonal of what it sees
_INSTANTS = 100

Point = Float[np.ndarray, "axis=3"]


@dataclass(frozen=True)
class Window:
    """A box and the points that are to be seen, without how far the camera has moved along."""

    low: Point
    high: Point
    cloud: Float[np.ndarray, "point axis=3"]

    @property
    def size(self) -> float:
        """Its longest side (m)."""
        return float((self.high - self.low).max())


@dataclass(frozen=True)
class Camera:
    """A view, and the part of its paper that is the picture."""

    view: View
    middle: Float[np.ndarray, " axis=2"]
    half: float
    """Half of the picture's height (m)."""
    flat: bool


def camera_of(
    window: Window, azimuth: float, elevation: float, *, flat: bool, aspect: float, zoom: float
) -> Camera:
    """Return the camera that has everything in its picture, or with a zoom as much less of it."""
    yaw, pitch = math.radians(azimuth), math.radians(elevation)
    across = (-math.sin(yaw), math.cos(yaw), 0.0)
    toward = (math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch))
    x, y, z = map(float, np.cross(toward, across))
    centre = (window.low + window.high) / 2
    far = math.inf if flat else _FAR * float(np.linalg.norm(window.high - window.low))
    a, b, c = map(float, centre)
    view = View("of the film", across, (x, y, z), (a, b, c), far)
    paper = view.paper(window.cloud)
    low, high = paper.min(axis=0), paper.max(axis=0)
    wide, tall = (high - low) / 2
    half = _MARGIN * max(float(tall), float(wide) / aspect, 1e-6) / zoom
    return Camera(view, (low + high) / 2, half, flat)


def followed_by(space: Space, wish: str | None) -> str:
    """Tell what the camera keeps up with: a base that travels far, where nothing is said."""
    if wish is not None:
        return wish
    root = space.members[0].position[:, 0]
    gone = np.linalg.norm(root - root[0], axis=1).max()
    return "base" if gone > _TRAVELS * space.length else "none"


def path_of(moving: Moving, followed: str) -> Float[np.ndarray, "time axis=3"]:
    """Where it is that a camera keeps up with; nowhere if with nothing."""
    if followed == "none":
        return np.zeros((moving.time.size, 3))
    return moving.position[:, 0 if followed == "base" else -1]


def window_of(
    space: Space, members: list[Moving], path: Float[np.ndarray, "time axis=3"]
) -> Window:
    """Return what some of the runs need, while the camera goes along a path of the first one."""
    length = space.length
    clouds = []
    for member in members:
        some = evenly(member.time.size, _INSTANTS)
        drift = np.zeros((some.size, 3))
        if np.ptp(path, axis=0).any():
            places = [np.interp(member.time[some], members[0].time, path[:, d]) for d in range(3)]
            drift = np.stack(places, axis=1) - path[0]
        thick = member.diameter[:, None] / 2
        arm = member.position[some] - drift[:, None]
        clouds += [(arm - thick).reshape(-1, 3), (arm + thick).reshape(-1, 3)]
        clouds.append(member.target[some] - drift)
        anchor, wide = member.mount.anchor[some] - drift, 0.05 * length
        clouds += [anchor - wide, anchor + wide]
    shapes = np.concatenate(clouds)
    low, high = shapes.min(axis=0) - _NEAR * length, shapes.max(axis=0) + _NEAR * length
    for member in members:
        clouds += [np.clip(near(body, low, high), low, high) for body in member.bodies]
    water = members[0].water
    if water is not None:
        start = water.start - (path.mean(axis=0) - path[0])
        ends = 0.06 * length
        clouds += [start - ends, start + ends]
    cloud = np.concatenate(clouds)
    return Window(cloud.min(axis=0), cloud.max(axis=0), cloud)


def near(body: Body, low: Point, high: Point) -> Float[np.ndarray, "point axis=3"]:
    """Points that show an obstacle, wherever it goes, as far as it is near a box."""
    path, solid = body.path, body.solid
    if solid.kind == "plane":
        middle = (low + high) / 2
        return np.asarray(middle - ((middle - path) @ solid.out)[:, None] * solid.out)
    return np.concatenate([path - solid.radius, path + solid.radius])
