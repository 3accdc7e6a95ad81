"""The scene of some runs: the arm, its mount, its target, obstacles and water over time."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from crinoid.results.chunks import chosen_pieces, join
from crinoid.results.report_error import ReportError
from crinoid.results.result import Result
from crinoid.results.scene.data import (
    Indices,
    Obstacle,
    Points,
    ToolBall,
    arm_length,
    bounded,
    even_indices,
    find_obstacles,
    find_tool,
    has_target,
    in_space,
    is_spatial,
    shaped,
    tool_held,
)
from crinoid.results.scene.mesh import at_nodes
from crinoid.results.scene.mount import ArmMount, Path, find_mount
from crinoid.results.scene.projection import left_of
from crinoid.results.scene.threads import ThreadLine, find_threads
from crinoid.scenario.errors import counted

Places = Float[np.ndarray, "_ axis"]
REACH = 0.2  # length of the longest arrow, of the arm's length
_PLACES = 7
_SPACING = 0.07  # arrows closer than this are left out, of the arm's length
_CLEAR = 0.06  # distance between the arrows and what the arm sweeps, of its length
CALM = 1e-9  # speed of water that is still (m/s)
TRAVELS, NEAR = 1.5, 0.35
"""Travel of a base from which on it is followed, and distance from the arm within which obstacles
are shown, of the arm's length."""


@dataclass(frozen=True)
class WaterArrows:
    """The velocity of the water at some places along the arm, as arrows next to it."""

    start: Float[np.ndarray, "place axis=3"]
    velocity: Float[np.ndarray, "time place axis=3"]
    scale: float  # m/s for each m of an arrow


def find_water(data: xr.Dataset, position: Points, length: float) -> WaterArrows | None:
    """Return the current along an arm, drawn next to all that it sweeps.

    Relative to the root the arrows are always at the same position, wherever the base goes.
    """
    if "flow_velocity" not in data:
        return None
    shape, root = position.mean(axis=0), position[:, :1]
    chosen = arrow_nodes(shape, length)
    velocity = in_space(data.isel(node=chosen), "flow_velocity")
    fastest = float(np.linalg.norm(velocity, axis=-1).max(initial=0.0))
    if fastest < CALM:
        return None
    target = in_space(data, "tip_target") - root[:, 0]
    swept = np.concatenate([(position - root).reshape(-1, 3), target])
    start = arrow_starts(shape, chosen, swept, velocity.mean(axis=(0, 1)), length)
    return WaterArrows(start, velocity, fastest / (REACH * length))


def arrow_nodes(shape: Places, length: float) -> Indices:
    """Choose nodes of a shape that are not too near to each other, the root first."""
    chosen: list[int] = []
    for node in even_indices(len(shape), _PLACES):
        apart = np.linalg.norm(shape[node] - shape[chosen], axis=1)
        if apart.min(initial=np.inf) > _SPACING * length:
            chosen.append(int(node))
    return np.array(chosen)


def arrow_starts(
    shape: Places, chosen: Indices, swept: Places, mean: Float[np.ndarray, " axis"], length: float
) -> Float[np.ndarray, "chosen axis"]:
    """Place arrows in space or on paper, next to all that an arm sweeps relative to its root.

    They are on the side from which the mean velocity comes, if it comes from a side.
    """
    chord = shape[-1] - shape[0]
    if np.linalg.norm(chord) < 0.05 * length:
        chord = shape[1] - shape[0]
    if np.linalg.norm(chord) < 1e-3 * length / len(shape):  # seen from its end
        chord = np.zeros_like(chord)
    along = chord / (np.linalg.norm(chord) or 1.0)
    across = mean - (mean @ along) * along
    if np.linalg.norm(across) > 0.2 * np.linalg.norm(mean):
        aside = -across / np.linalg.norm(across)
    else:
        aside = np.zeros_like(along)
        aside[[0, -1]] = left_of(along[[0, -1]])
        if not aside.any():
            aside[-1 if along.size == 2 else 0] = 1.0
        heights = swept @ aside
        if heights.max() > -heights.min() + 1e-9:
            aside = -aside
    clear = float(np.max(swept @ aside)) + (_CLEAR + REACH) * length
    inward = clear - (shape[chosen] - shape[0]) @ aside
    return np.asarray(shape[chosen] + inward[:, None] * aside)


_FAR = 0.25  # distance from obstacles above which colours do not vary, of the arm's length
_THICK = 0.04  # diameter of an arm whose result has none, of its length
_DRAWN = (
    *("position", "velocity", "curvature", "tension", "tip_target", "flow_velocity", "tool_held"),
    *("base_servo", "base_pose", "channel_lower", "channel_upper", "vehicle_pose"),
    *("actuator_state", "actuator_command"),
    *("obstacle_position", "obstacle_axis", "surface_point", "surface_facet", "facet_obstacle"),
)


@dataclass(frozen=True)
class NodeField:
    """A quantity at the nodes of the arm, by which it may be coloured."""

    name: str
    label: str
    unit: str
    signed: bool
    values: Float[np.ndarray, "time node"]


@dataclass(frozen=True)
class Keyframes:
    """Keyframes of a run: the arm, its mount, target and surroundings at some instants."""

    label: str
    records: int  # number of the instants of the result
    omitted: int  # how many of those chosen are left out, as a number cannot be drawn
    at: Int[np.ndarray, " time"]  # indices of these instants in the result
    time: Float[np.ndarray, " time"]
    position: Float[np.ndarray, "time node axis=3"]
    diameter: Float[np.ndarray, " node"]
    target: Path
    fields: tuple[NodeField, ...]
    mount: ArmMount
    obstacles: tuple[Obstacle, ...]
    water: WaterArrows | None
    tool: ToolBall | None
    held: Bool[np.ndarray, " time"]
    threads: tuple[ThreadLine, ...] = ()
    director: Float[np.ndarray, "time node axis=3"] | None = None
    """Director m_1 of an arm in space that has chambers or tendons."""

    def travels(self, length: float) -> bool:
        """Whether the base moves so far that pictures of an arm of some length (m) follow it."""
        away = self.position[:, 0] - self.position[0, 0]
        return bool(np.linalg.norm(away, axis=1).max() > TRAVELS * length)


@dataclass(frozen=True)
class Scene:
    """The scene of one or more runs, the second without control."""

    spatial: bool
    length: float
    nodes: int  # number of the nodes of the result
    members: tuple[Keyframes, ...]
    aims: bool = True  # whether there is a target


def build_scene(result: Result, most: int | None = None, most_nodes: int | None = None) -> Scene:
    """Return the scene of both runs of a result, with upper bounds on instants and nodes."""
    data = result.dataset
    runs = tuple(keyframes(label, each, most, most_nodes) for label, each in result.members)
    length, aims = arm_length(data), has_target(result)
    return Scene(is_spatial(data), length, data.sizes["node"], runs, aims)


def colour_ranges(scene: Scene) -> dict[str, tuple[float, float]]:
    """Return the values between which colours lie, the same for all runs."""
    found = {}
    for name in {field.name for each in scene.members for field in each.fields}:
        some = [f for each in scene.members for f in each.fields if f.name == name]
        # numbers that are not finite were left out before
        top = max(float(np.abs(field.values).max(initial=0.0)) for field in some) or 1.0
        signed = some[0].signed and any(field.values.min() < 0 for field in some)
        found[name] = (-top if signed else 0.0, top)
    return found


def omission_notes(scene: Scene) -> list[str]:
    """Say of each run how many instants are left out, as one of their numbers cannot be drawn."""
    return [
        f"{counted(each.omitted, 'instant')} {'is' if each.omitted == 1 else 'are'} left out: at "
        f"{'it' if each.omitted == 1 else 'these'} a number is not finite, or too large."
        for each in scene.members
        if each.omitted
    ]


def keyframes(label: str, result: Result, most: int | None, most_nodes: int | None) -> Keyframes:
    """Return a run, at no more than a number of instants and nodes."""
    data = result.dataset
    records = data.sizes["time"]
    nodes = even_indices(data.sizes["node"], most_nodes or data.sizes["node"])
    at = even_indices(records, most or records)
    directed = ("director",) if "actuator_state" in data else ()
    there = [name for name in (*_DRAWN, *directed) if name in data]
    chosen = join(list(chosen_pieces(data, there, at)))
    whole = shaped(chosen["position"].transpose("time", "node", "axis").values.astype(float))
    for name in there:
        if "time" in chosen[name].dims:
            whole &= bounded(chosen[name].transpose("time", ...).values.astype(float))
    if not whole.any():
        raise ReportError("no instant can be drawn: at each a number is not finite, or too large")
    some = chosen.isel(time=np.flatnonzero(whole))
    shown = Result(some)
    position, length = in_space(some, "position"), arm_length(some)
    obstacles = tuple(find_obstacles(shown))
    diameter = np.full(data.sizes["node"], _THICK * length)
    if "diameter" in some:
        diameter = np.asarray(some["diameter"].values, float)
    fields = _fields(some, position, diameter, obstacles)
    fields = [replace(field, values=field.values[:, nodes]) for field in fields]
    threads, director = tuple(find_threads(shown, nodes)), None
    if threads and "director" in some:  # of the edges
        director = some["director"].values[:, np.minimum(nodes, nodes[-1] - 1)]
    return Keyframes(
        label,
        records,
        int(np.sum(~whole)),
        at[whole],
        np.asarray(some["time"].values, float),
        position[:, nodes],
        diameter[nodes],
        in_space(some, "tip_target"),
        tuple(fields),
        find_mount(shown),
        obstacles,
        find_water(some, position, length),
        find_tool(shown),
        tool_held(some),
        threads,
        director,
    )


def _fields(
    data: xr.Dataset, position: Points, diameter: np.ndarray, obstacles: tuple[Obstacle, ...]
) -> list[NodeField]:
    found = []
    if "curvature" in data:
        bent = np.asarray(data["curvature"].values, float)
        whole = np.linalg.norm(bent, axis=-1) if bent.ndim == 3 else bent
        found.append(NodeField("curvature", "curvature", "1/m", bent.ndim == 2, whole))
    if "tension" in data:
        tension = at_nodes(np.asarray(data["tension"].values, float))
        found.append(NodeField("tension", "tension", "N", True, tension))
    if "velocity" in data:
        speed = np.linalg.norm(np.asarray(data["velocity"].values, float), axis=-1)
        found.append(NodeField("speed", "speed", "m/s", False, speed))
    if obstacles:
        gaps = [each.distance(position) - diameter / 2 for each in obstacles]
        near = np.clip(np.min(gaps, axis=0), 0.0, _FAR * arm_length(data))
        found.append(NodeField("distance", "distance to obstacles", "m", False, near))
    return found
