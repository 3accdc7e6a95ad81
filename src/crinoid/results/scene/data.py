"""Arrays of a result in three dimensions, and the tool and obstacles of its scenario."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from crinoid.foundation.axes import AXES
from crinoid.scenario import Scenario
from crinoid.scenario.obstacle import ENDLESS, Capsule, Cylinder, Plane, Sphere
from crinoid.scenario.obstacle import Obstacle as Described
from crinoid.scenario.quantity import unit_vector
from crinoid.scenario.tool import Tool

if TYPE_CHECKING:
    from crinoid.results.result import Result

STILL = 1e-6  # distance below which a point does not move (m)
LARGEST = 1e9  # largest size of a drawing, in SI units. Squares of far larger numbers overflow.

Indices = Int[np.ndarray, " chosen"]


def is_spatial(dataset: xr.Dataset) -> bool:
    """Whether the arm moves in space rather than in a plane."""
    return "y" in {str(label) for label in dataset["axis"].values}


def in_space(dataset: xr.Dataset, name: str) -> Float[np.ndarray, "*shape axis=3"]:
    """Values of a vector variable, the axis last; y is zero in the plane."""
    return in_three(dataset[name].transpose(..., "axis").values)


def in_three(vectors: Any) -> Float[np.ndarray, "*shape axis=3"]:
    """Vectors along all three axes; those of a planar arm have y = 0."""
    given = np.asarray(vectors, float)
    whole = np.zeros((*given.shape[:-1], 3))
    whole[..., [AXES[3].index(axis) for axis in AXES[given.shape[-1]]]] = given
    return whole


def moves(path: Float[np.ndarray, "time axis"]) -> bool:
    """Whether a point moves."""
    return bool(np.ptp(path, axis=0).max() > STILL)


def arm_length(data: xr.Dataset) -> float:
    """Length of the arm's first recorded shape in m, never zero."""
    return float(_first_edges(data).sum()) or 1.0


def arc_length(data: xr.Dataset) -> Float[np.ndarray, " node"]:
    """Arc length of the nodes (m), of the first recorded shape in results without it."""
    if "arc_length" in data:
        return np.asarray(data["arc_length"].values, float)
    return np.concatenate([[0.0], np.cumsum(_first_edges(data))])


def _first_edges(data: xr.Dataset) -> Float[np.ndarray, " edge"]:
    steps = np.diff(in_space(data.isel(time=[0]), "position")[0], axis=0)
    return np.linalg.norm(steps, axis=-1)


def has_target(result: Result) -> bool:
    """Whether the tip has a target, and not only a start from which errors count."""
    return result.known_scenario.aims or moves(in_space(result.dataset, "tip_target"))


def target_word(result: Result) -> str:
    """Return the noun for the target, which may be the start of a tip that nothing controls."""
    return "target" if has_target(result) else "start of the tip"


def base_word(scenario: Scenario) -> str:
    """Return the noun for the base of an arm."""
    return "base" if scenario.vehicle is None else "submarine"


def bounded(values: Float[np.ndarray, "time ..."]) -> Bool[np.ndarray, " time"]:
    """Whether all numbers of an instant are finite and small enough to be drawn."""
    return np.asarray(np.all(np.abs(values.reshape(len(values), -1)) <= LARGEST, axis=1))


def shaped(position: Float[np.ndarray, "time node axis"]) -> Bool[np.ndarray, " time"]:
    """Whether the arm has a shape to draw at an instant: no edge has the length zero."""
    with np.errstate(invalid="ignore"):
        edges = np.abs(np.diff(position, axis=1)).max(axis=2)
    return bounded(position) & (edges > 0.0).all(axis=1)


def even_indices(count: int, most: int) -> Int[np.ndarray, " chosen"]:
    """Return indices at even distances, the first and the last among them."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


def tool_held(data: xr.Dataset) -> Bool[np.ndarray, " time"]:
    """Whether the tip carries a tool, at each record."""
    if "tool_held" not in data:
        return np.zeros(data.sizes["time"], bool)
    return np.asarray(data["tool_held"].values > 0)


_DENSE = 7850.0  # density of a tool that displaces no water, as of steel (kg/m3)


class ToolBall(NamedTuple):
    """The ball by which a tool is drawn."""

    radius: float  # m
    offset: float  # distance of its centre from the tip, along the arm (m)

    @staticmethod
    def of(tool: Tool) -> ToolBall:
        """Return the ball of a tool: its own, of its volume, or of its mass in steel."""
        volume = tool.volume or tool.mass / _DENSE
        return ToolBall(tool.radius or (3.0 * volume / (4.0 * math.pi)) ** (1 / 3), tool.offset)


def find_tool(result: Result) -> ToolBall | None:
    """Return the tool of a result whose tip ever carries one."""
    tool = result.known_scenario.tool
    return ToolBall.of(tool) if tool is not None and tool_held(result.dataset).any() else None


Point = Float[np.ndarray, "axis=3"]
Points = Float[np.ndarray, "... axis=3"]


@dataclass(frozen=True)
class SolidShape:
    """Triangles of a solid from a file, relative to its position."""

    points: Float[np.ndarray, "point axis=3"]
    facets: Int[np.ndarray, "facet corner=3"]


@dataclass(frozen=True)
class Obstacle:
    """One obstacle, and where its middle and its axis are at each record."""

    name: str
    kind: str  # `"sphere"`, `"capsule"`, `"cylinder"`, `"plane"`, `"mesh"` or `"seabed"`
    radius: float  # m; zero for a wall, of a solid from a file that of a ball around it
    half_axis: Float[np.ndarray, "time axis=3"]  # half of the axis of a round obstacle (m)
    normal: Point  # normal of a wall, of length one; zero for a round obstacle
    path: Float[np.ndarray, "time axis=3"]
    solid: SolidShape | None = None

    @staticmethod
    def of(
        name: str,
        described: Described,
        path: Float[np.ndarray, "time axis=3"],
        axis: Float[np.ndarray, "time axis=3"] | None = None,
        solid: SolidShape | None = None,
    ) -> Obstacle:
        """Return an obstacle of a scenario, of a planar one or one in space.

        ``axis`` is a direction fixed to it at each record, of a capsule in the plane that of it.
        """
        kind, still, nowhere = described.kind, np.zeros_like(path), np.zeros(3)
        if solid is not None:
            around = float(np.linalg.norm(solid.points, axis=1).max())
            return Obstacle(name, kind, around, still, nowhere, path, solid)
        if isinstance(described, Plane):
            x, *y, z = described.out
            return Obstacle(name, kind, 0.0, still, np.array([x, *(y or [0.0]), z]), path)
        if not isinstance(described, Sphere | Cylinder | Capsule):
            raise ValueError(f"obstacle {name} is a solid, and the result has no surface of it")
        if isinstance(described, Sphere):
            return Obstacle(name, kind, described.radius, still, nowhere, path)
        half = described.length / 2 if isinstance(described, Capsule) else ENDLESS
        first = np.array(unit_vector(described.axis))
        # a planar result has the axis of a capsule across the plane nowhere
        turns = axis is not None and float(axis[0] @ first) > 0.5
        whole = half * (axis if axis is not None and turns else np.tile(first, (len(path), 1)))
        return Obstacle(name, kind, described.radius, whole, nowhere, path)

    @property
    def label(self) -> str:
        """Its index in the scenario and its kind."""
        return f"{self.name} {self.kind}"

    @property
    def moves(self) -> bool:
        """Whether it moves or turns."""
        return moves(self.path) or moves(self.half_axis)

    def nearest(self, record: int | tuple[slice, None], points: Points) -> Points:
        """Points nearest to others, on the surface of a wall or the axis of a round obstacle.

        With ``np.s_[:, None]`` as the record, points at each record are compared with the obstacle
        at the same record.
        """
        place, half = self.path[record], self.half_axis[record]
        if self.solid is not None:
            _, corner = cKDTree(self.solid.points).query(points - place)
            return np.asarray(place + self.solid.points[corner])
        if self.kind == "plane":
            return np.asarray(points - ((points - place) @ self.normal)[..., None] * self.normal)
        squared = np.sum(half**2, axis=-1)
        along = np.sum((points - place) * half, axis=-1) / np.where(squared > 0, squared, 1.0)
        along = np.clip(along, -1.0, 1.0)
        return np.asarray(place + along[..., None] * half)

    def corners_within(self, low: Point, high: Point) -> Points:
        """Return the corners of a solid from a file, first and last, that a box contains."""
        assert self.solid is not None
        corners = (self.path[[0, -1], None] + self.solid.points).reshape(-1, 3)
        return np.asarray(corners[((corners > low) & (corners < high)).all(axis=1)])

    def distance(self, points: Points) -> Float[np.ndarray, "time node"]:
        """Return the distance of points at each record from its surface (m)."""
        apart = points - self.nearest(np.s_[:, None], points)
        if self.kind == "plane":
            return np.asarray(apart @ self.normal)
        return np.linalg.norm(apart, axis=-1) - (0.0 if self.solid else self.radius)


def find_obstacles(result: Result) -> list[Obstacle]:
    """Return the obstacles of a result."""
    data = result.dataset
    if "obstacle_position" not in data:
        return []
    paths = np.moveaxis(in_space(data, "obstacle_position"), 1, 0)
    described = result.known_scenario.obstacle
    axes: list[np.ndarray | None] = [None] * len(described)
    if "obstacle_axis" in data:
        axes = list(np.moveaxis(in_space(data, "obstacle_axis"), 1, 0))
    rows = enumerate(zip(described, paths, axes, strict=True))
    return [Obstacle.of(str(i), *row, _solid(data, i)) for i, row in rows]


def _solid(data: xr.Dataset, index: int) -> SolidShape | None:
    if "facet_obstacle" not in data or not (own := data["facet_obstacle"].values == index).any():
        return None
    corners, facets = np.unique(data["surface_facet"].values[own], return_inverse=True)
    points = data["surface_point"].values[corners].astype(float)
    return SolidShape(points, facets.reshape(-1, 3))
