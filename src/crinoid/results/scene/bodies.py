"""Rigid bodies around the arm: its mount, target, obstacles and tool."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from crinoid.results.scene.data import Obstacle, Points, ToolBall, moves
from crinoid.results.scene.mesh import BodyShape, Rotations, look_rotation, unit_vectors
from crinoid.results.scene.mount import ArmMount, Path
from crinoid.results.scene.scene import Keyframes, Scene

_HULL = (0.34, 6.0), (0.075, 1.5)
"""Half the length and half the width of the submarine: of the arm's length, and at most (m)."""
_PLATE = 0.1, 1.5  # radius of the plate that is the base of other arms, likewise
_ENDLESS = 0.5  # half of the drawn length of an endless pole, of the arm's length
_DISC = 0.08  # half of the drawn length of a pole across a planar arm, of the arm's length
_WALL = 2.0  # half of the drawn side of a wall, of the arm's length
_TARGET = 0.6  # radius of the ball at the target, of the tip's diameter
_SHORT = 0.2  # length below which a boom is not drawn, of the radius of the arm
_JOINT, _BOOM, _CLAMP, CLAMP_LENGTH = 1.35, 0.6, 1.18, 4.0
"""Radii of the joint, boom and clamp and length of the clamp, of the radius of the arm."""
_STOUT = 0.1  # largest radius of an arm that its joint and clamp are drawn for, of its length
_STEM = 0.2  # radius of the stem of a tool, of that of its ball
_UP = np.array([0.0, 0.0, 1.0])
COLOURS = {
    "arm": (0.0, 0.17, 0.45),
    "base": (0.42, 0.47, 0.5),
    "target": (0.67, 0.11, 0.0),
    "obstacle": (0.35, 0.31, 0.26),
    "tool": (0.6, 0.19, 0.39),
}
"""Linear red, green and blue of the arm and of each kind of body in exports."""

Kind = Literal["base", "target", "obstacle", "tool"]


@dataclass(frozen=True)
class RigidBody:
    """A shape that moves: its points are at ``position + attitude @ (scale * point)``."""

    name: str
    kind: Kind
    shape: BodyShape
    position: Path
    attitude: Rotations
    scale: Float[np.ndarray, "time axis=3"]
    """Zero while the body is hidden; a boom varies in length."""

    @property
    def material(self) -> str:
        """Material: `"steel"` for boom, joint, clamp and stem, else `"hull"` or its kind."""
        if self.name in ("boom", "joint", "clamp", "stem"):
            return "steel"
        return "hull" if self.kind == "base" else self.kind

    @property
    def moves(self) -> bool:
        """Whether its position changes."""
        return moves(self.position)

    def transform(self, points: Points, record: int) -> Points:
        """Move points of its shape to where they are at a record (m)."""
        moved = (points * self.scale[record]) @ self.attitude[record].T
        return np.asarray(self.position[record] + moved)

    def paths(self, points: Points, instants: slice) -> Float[np.ndarray, "time point axis=3"]:
        """Return where points of its shape are at some instants (m)."""
        matrix = self.attitude[instants] * self.scale[instants, None]
        moved = np.einsum("tij,pj->tpi", matrix, points)
        return np.asarray(self.position[instants, None] + moved)


def rigid_bodies(scene: Scene, run: Keyframes, reach: float | None = None) -> list[RigidBody]:
    """Return the bodies around the arm of a run; endless poles are shown to a reach (m)."""
    obstacles = [obstacle_body(each, scene, run, reach) for each in run.obstacles]
    thick = float(run.diameter[0]) / 2
    return [
        *mount_bodies(run.mount, run.position[:, 0], thick, scene.length),
        _body("target", "target", _ball(_TARGET * float(run.diameter[-1])), run.target),
        *obstacles,
        *([] if run.tool is None else tool_bodies(run.tool, run.position, run.held)),
    ]


def mount_bodies(mount: ArmMount, root: Path, thick: float, length: float) -> list[RigidBody]:
    """Return the hull or the plate, the boom that servos shift, the joint and the clamp.

    ``thick`` is the radius of the arm at its root. A hull that the arm can touch has its size. Any
    other submarine has a hull, any other base is a plate; neither is of its true size.
    """
    thick, leaves = min(thick, _STOUT * length), mount.level_direction
    along = look_rotation(mount.direction, _UP)
    attitude = mount.attitude @ look_rotation(leaves, _UP)
    if mount.hull is not None:  # the arm leaves its nose
        long, wide = (size / 2 for size in mount.hull)
        shape, nose = BodyShape("capsule", long - wide, wide), mount.anchor
        if not mount.floats:
            nose, attitude = root, along
        middle = nose - long * attitude[:, :, 0]
    else:
        shape = BodyShape("rod", _JOINT * thick / 2, min(_PLATE[0] * length, _PLATE[1]))
        out = shape.half * leaves
        if mount.floats:
            long, wide = (min(share * length, most) for share, most in _HULL)
            half = np.array([long, wide, wide])
            # the arm leaves the hull where a line from its middle in the arm's direction does
            out = half**2 * leaves / (np.linalg.norm(half * leaves) or 1.0)
            shape, attitude = BodyShape("ellipsoid", long, wide), mount.attitude
        middle = mount.anchor - np.einsum("tij,j->ti", mount.attitude, out)
    found = [_body("hull" if mount.has_hull else "base", "base", shape, middle, attitude)]
    way, reach = _spanned(root - mount.anchor)
    apart = mount.floats or mount.hull is None  # else the hull moves with the root
    if apart and np.abs(reach).max() > _SHORT * thick:
        stretch = np.stack([reach, np.ones_like(reach), np.ones_like(reach)], axis=1)
        boom = BodyShape("rod", 0.5, _BOOM * thick)
        middle, attitude = (mount.anchor + root) / 2, look_rotation(way, _UP)
        found.append(_body("boom", "base", boom, middle, attitude, stretch))
    clamp = BodyShape("rod", CLAMP_LENGTH * thick / 2, _CLAMP * thick)
    middle = root + clamp.half * mount.direction
    return [
        *found,
        _body("joint", "base", _ball(_JOINT * thick), root),
        _body("clamp", "base", clamp, middle, along),
    ]


def _spanned(shift: Path) -> tuple[Path, Float[np.ndarray, " time"]]:
    """Return the direction of a rod that spans shifts, and its length, negative if reversed."""
    way, reach = np.empty_like(shift), np.linalg.norm(shift, axis=1)
    before = shift[int(np.argmax(reach))] / (reach.max() or 1.0)
    for record, length in enumerate(reach):
        here = shift[record] / length if length > 0.0 else before
        if here @ before < 0.0:
            here, reach[record] = -here, -length
        way[record] = before = here
    return way, reach


def obstacle_body(
    obstacle: Obstacle, scene: Scene, run: Keyframes, reach: float | None = None
) -> RigidBody:
    """Return an obstacle, of an endless one the part nearest to the first shape of the arm."""
    name, path = f"obstacle {obstacle.name}", obstacle.path
    middle = run.position[0].mean(axis=0)
    half = float(np.linalg.norm(obstacle.half_axis[0]))
    if obstacle.solid is not None:
        return _body(name, "obstacle", BodyShape("solid", 0.0, 0.0, obstacle.solid), path)
    if obstacle.kind in ("plane", "cylinder"):
        path = path + (obstacle.nearest(0, middle) - path[0])
    if obstacle.kind == "plane":
        shape, axis = BodyShape("plate", 0.0, _WALL * scene.length), obstacle.normal[None]
    elif not half:
        return _body(name, "obstacle", _ball(obstacle.radius), path)
    else:
        axis = obstacle.half_axis / half
        if obstacle.kind == "cylinder":
            half = min(half, _ENDLESS * scene.length if reach is None else reach)
        if not scene.spatial and abs(axis[0, 1]) > 0.9:
            half = min(half, _DISC * scene.length)
        kind: Literal["capsule", "rod"] = "capsule" if obstacle.kind == "capsule" else "rod"
        shape = BodyShape(kind, half, obstacle.radius)
    attitude = np.broadcast_to(_turning(axis), (len(path), 3, 3))
    return _body(name, "obstacle", shape, path, attitude)


def _turning(axis: Path) -> Rotations:
    """Return attitudes that follow an axis over time without a turn about it."""
    found = [look_rotation(axis[:1], _UP)[0]]
    for before, after in pairwise(axis) if moves(axis) else ():
        swing, _ = Rotation.align_vectors(after[None], before[None])
        found.append(swing.as_matrix() @ found[-1])
    return np.array(found)


def tool_bodies(
    tool: ToolBall, position: Points, held: Bool[np.ndarray, " time"]
) -> list[RigidBody]:
    """Return the tool, and its stem where it is off the tip; hidden while it is not held."""
    before, tip = position[:, -2], position[:, -1]
    forward = unit_vectors(tip - before)
    attitude, scale = look_rotation(forward, _UP), held[:, None] * np.ones(3)
    centre = tip + tool.offset * forward
    found = [_body("tool", "tool", _ball(tool.radius), centre, attitude, scale)]
    if tool.offset > tool.radius:
        stem = BodyShape("rod", tool.offset / 2, _STEM * tool.radius)
        middle = (tip + centre) / 2
        found.append(_body("stem", "tool", stem, middle, attitude, scale))
    return found


def _ball(radius: float) -> BodyShape:
    return BodyShape("ellipsoid", radius, radius)


def _body(
    name: str, kind: Kind, shape: BodyShape, position: Path, *pose: Float[np.ndarray, "time ..."]
) -> RigidBody:
    """Return a body with an attitude and a scale, by default level and of its own size."""
    still = np.tile(np.eye(3), (len(position), 1, 1)), np.ones((len(position), 3))
    return RigidBody(name, kind, shape, position, *pose, *still[len(pose) :])
