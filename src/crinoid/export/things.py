"""All that is about the arm as rigid surfaces that move: base, target, obstacles, tool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from crinoid.export.mesh import Mesh, ball, capsule, joined, plate, rod
from crinoid.export.pose import Turns, facing
from crinoid.report.charts.space import Moving, Path, Space
from crinoid.report.solids import Body

_HULL = (0.34, 6.0), (0.075, 1.5)
"""Half the length and half the width of the submarine: of the arm's length, and at most (m)."""
_ENDLESS = 0.5
"""Half of what is drawn of a pole without end, of the arm's length."""
_WALL = 2.0
"""Half a side of what is drawn of a wall, of the arm's length."""
_TARGET = 0.6
"""Radius of the ball at the target, of the tip's diameter."""
_SHORT = 0.2
"""Length of a boom that is not drawn, of the radius of the arm."""
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Thing:
    """A rigid surface over time: ``place + turn @ (size * point)``."""

    name: str
    kind: str
    """`"base"`, `"target"`, `"obstacle"` or `"tool"`, by which it is coloured."""
    mesh: Mesh
    place: Path
    turn: Turns
    size: Float[np.ndarray, "time axis=3"]

    def points(self, instants: slice) -> Float[np.ndarray, "time point axis=3"]:
        """Return its points at some instants (m)."""
        scaled = self.size[instants, None] * self.mesh.points
        turned = np.einsum("tij,tpj->tpi", self.turn[instants], scaled)
        return np.asarray(self.place[instants, None] + turned)


def things_of(space: Space) -> list[Thing]:
    """Return what is about the arm of a run."""
    (moving,) = space.members
    target = _thing("target", "target", ball(_TARGET * float(moving.diameter[-1])), moving.target)
    obstacles = [_obstacle(body, moving, space.length) for body in moving.bodies]
    return [*_base(space, moving), target, *obstacles, *_tool(moving)]


def _base(space: Space, moving: Moving) -> list[Thing]:
    """Return the hull of the submarine, the boom that its servos shift, and the clamp."""
    mount, root = moving.mount, moving.position[:, 0]
    thick = float(moving.diameter[0]) / 2
    half = np.array([min(share * space.length, most) for share, most in _HULL])[[0, 1, 1]]
    # the arm leaves the hull where a line from its middle in the arm's direction does
    out = half**2 * space.ahead / np.linalg.norm(half * space.ahead)
    middle = mount.anchor - np.einsum("tij,j->ti", mount.frame, out)
    clamp = joined([ball(1.35 * thick), rod(0.0, 4 * thick, 1.18 * thick)])
    found = [
        _thing("hull", "base", ball(1.0), middle, mount.frame, np.tile(half, (len(root), 1))),
        _thing("clamp", "base", clamp, root, facing(mount.ahead, _UP)),
    ]
    way, reach = _reached(root - mount.anchor)
    if np.abs(reach).max() > _SHORT * thick:
        stretch = np.stack([reach, np.ones_like(reach), np.ones_like(reach)], axis=1)
        boom = rod(0.0, 1.0, 0.6 * thick)
        found.append(_thing("boom", "base", boom, mount.anchor, facing(way, _UP), stretch))
    return found


def _reached(shift: Path) -> tuple[Path, Float[np.ndarray, " time"]]:
    """Return where a rod points that spans shifts, and its length.

    The length is negative where it would turn about otherwise.
    """
    way, reach = np.empty_like(shift), np.linalg.norm(shift, axis=1)
    before = shift[int(np.argmax(reach))] / (reach.max() or 1.0)
    for record, length in enumerate(reach):
        here = shift[record] / length if length > 0.0 else before
        if here @ before < 0.0:
            here, reach[record] = -here, -length
        way[record] = before = here
    return way, reach


def _obstacle(body: Body, moving: Moving, length: float) -> Thing:
    """Return an obstacle, of one without end the part that is nearest to the arm at first."""
    solid, name = body.solid, f"obstacle {body.name}"
    middle = moving.position[0].mean(axis=0)
    half = float(np.linalg.norm(solid.half_axis))
    if solid.kind == "plane":
        path = body.path + (body.nearest(0, middle) - body.path[0])
        return _thing(name, "obstacle", plate(_WALL * length), path, _along(solid.out, path))
    if not half:
        return _thing(name, "obstacle", ball(solid.radius), body.path)
    turn = _along(solid.half_axis / half, body.path)
    if solid.kind == "capsule":
        return _thing(name, "obstacle", capsule(half, solid.radius), body.path, turn)
    path = body.path + (body.nearest(0, middle) - body.path[0])
    reach = min(half, _ENDLESS * length)
    return _thing(name, "obstacle", rod(-reach, reach, solid.radius), path, turn)


def _tool(moving: Moving) -> list[Thing]:
    """Return what the tip carries, of no size while it does not."""
    if moving.tool is None:
        return []
    radius, offset = moving.tool
    before, tip = moving.position[:, -2], moving.position[:, -1]
    ahead = (tip - before) / np.linalg.norm(tip - before, axis=1, keepdims=True)
    mesh = ball(radius)
    size = np.where(moving.held, 1.0, 0.0)[:, None] * np.ones(3)
    return [_thing("tool", "tool", mesh, tip + offset * ahead, facing(ahead, _UP), size)]


def _along(direction: Float[np.ndarray, "axis=3"], path: Path) -> Turns:
    return facing(np.tile(direction, (len(path), 1)), _UP)


def _thing(
    name: str,
    kind: str,
    mesh: Mesh,
    place: Path,
    turn: Turns | None = None,
    size: Float[np.ndarray, "time axis=3"] | None = None,
) -> Thing:
    count = len(place)
    still = np.tile(np.eye(3), (count, 1, 1)) if turn is None else turn
    return Thing(name, kind, mesh, place, still, np.ones((count, 3)) if size is None else size)
