"""The arm in space over time, and what is around it: geometry only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from crinoid.pieces import chosen_pieces, join
from crinoid.report.charts.pose import attitudes, base_directions, channel_of, read_scenario
from crinoid.report.charts.tool import ball, held
from crinoid.report.run import ReportError, bounded, shaped
from crinoid.report.solids import Body, find_bodies
from crinoid.report.units import largest
from crinoid.report.view import arm_length, in_space, is_spatial, left_of
from crinoid.scenario.errors import counted
from crinoid.space import CHANNEL_TABLE

_PLACES = 7
_SPACING = 0.07  # arrows closer than this, of the arm's length, are left out
_REACH = 0.2  # length of the longest arrow, of the arm's length
_CLEAR = 0.06  # between the arrows and what the arm sweeps, of its length
_FAR = 0.25  # distance from obstacles from which on it does not matter, of the arm's length
_SHIFTS = {row.name: "xyz".index(row.axis) for row in CHANNEL_TABLE if not row.turns}

_DRAWN = (
    *("position", "velocity", "curvature", "tension", "tip_target", "flow_velocity", "tool_held"),
    *("base_servo", "base_pose", "channel_lower", "channel_upper", "vehicle_pose"),
    "obstacle_position",
)

Path = Float[np.ndarray, "time axis=3"]


@dataclass(frozen=True)
class Field:
    """A quantity along the arm, by which it may be coloured, at nodes."""

    name: str
    label: str
    unit: str
    signed: bool
    values: Float[np.ndarray, "time node"]


@dataclass(frozen=True)
class Mount:
    """The submarine and the clamp that hold the arm's root."""

    anchor: Path
    """Where the submarine carries it, the servos at rest (m)."""
    ahead: Path
    """Where the clamp points."""
    frame: Float[np.ndarray, "time axis=3 axis=3"]
    """Attitude of the submarine."""
    rails: tuple[tuple[int, float, float], ...]
    """Axis of the submarine and ends of the travel (m) of each servo that shifts the root."""


@dataclass(frozen=True)
class Water:
    """The current beside the arm."""

    start: Float[np.ndarray, "place axis=3"]
    velocity: Float[np.ndarray, "time place axis=3"]
    scale: float
    """m/s for each m of an arrow."""


@dataclass(frozen=True)
class Moving:
    """One run: the arm, where it should be, and what is about it, at some instants."""

    label: str
    records: int
    """How many instants the result has."""
    lacking: int
    """How many of those chosen are left out, as a number cannot be drawn."""
    at: Int[np.ndarray, " time"]
    """Which of them these are."""
    time: Float[np.ndarray, " time"]
    position: Float[np.ndarray, "time node axis=3"]
    diameter: Float[np.ndarray, " node"]
    target: Path
    fields: tuple[Field, ...]
    mount: Mount
    bodies: tuple[Body, ...]
    water: Water | None
    tool: tuple[float, float] | None
    """Radius of its ball, and how far that is beyond the tip (m)."""
    held: Bool[np.ndarray, " time"]


@dataclass(frozen=True)
class Space:
    """A run, and where there is one that without control."""

    spatial: bool
    length: float
    nodes: int
    """Nodes of the result."""
    ahead: Float[np.ndarray, "axis=3"]
    """Where the arm leaves a submarine that is level."""
    members: tuple[Moving, ...]


def space_of(members: list[tuple[str, xr.Dataset]], most: int, most_nodes: int) -> Space:
    """Return what moves in some runs, at no more than a number of instants and nodes each."""
    first = members[0][1]
    return Space(
        is_spatial(first),
        arm_length(first.isel(time=[0])),
        first.sizes["node"],
        _set_direction(first),
        tuple(_moving(label, data, most, most_nodes) for label, data in members),
    )


def ranges_of(space: Space) -> dict[str, tuple[float, float]]:
    """Return the values between which colours lie, the same for all runs."""
    found = {}
    for name in {field.name for field in space.members[0].fields}:
        some = [f for each in space.members for f in each.fields if f.name == name]
        top = largest(*(field.values for field in some)) or 1.0
        signed = some[0].signed and any(field.values.min() < 0 for field in some)
        found[name] = (-top if signed else 0.0, top)
    return found


def lacking(space: Space) -> list[str]:
    """Say of each run how many instants are left out, as a number of theirs cannot be drawn."""
    return [
        f"{counted(each.lacking, 'instant')} {'is' if each.lacking == 1 else 'are'} left out: at "
        f"{'it' if each.lacking == 1 else 'these'} a number is not finite, or too large."
        for each in space.members
        if each.lacking
    ]


def evenly(count: int, most: int) -> Int[np.ndarray, " chosen"]:
    """Choose records evenly, the first and the last among them."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, most).round().astype(int))


def thinned(data: xr.Dataset, records: Int[np.ndarray, " chosen"]) -> xr.Dataset:
    """Return chosen instants of what is drawn here of a run, which may lie in a file."""
    return join(list(chosen_pieces(data, [name for name in _DRAWN if name in data], records)))


def _moving(label: str, data: xr.Dataset, most: int, most_nodes: int) -> Moving:
    records = data.sizes["time"]
    nodes = evenly(data.sizes["node"], most_nodes)
    at = evenly(records, most)
    chosen = thinned(data, at)
    whole = _whole(chosen)
    if not whole.any():
        raise ReportError("no instant can be drawn: at each a number is not finite, or too large")
    some = chosen.isel(time=np.flatnonzero(whole))
    position = in_space(some, "position")
    length = arm_length(some)
    bodies = tuple(find_bodies(some))
    if "diameter" in some:
        diameter = np.asarray(some["diameter"].values, float)
    else:
        diameter = np.full(data.sizes["node"], 0.04 * length)
    has_tool = bool(held(some).any())
    return Moving(
        label,
        records,
        int(np.sum(~whole)),
        at[whole],
        np.asarray(some["time"].values, float),
        position[:, nodes],
        diameter[nodes],
        in_space(some, "tip_target"),
        tuple(_thinned(each, nodes) for each in _fields(some, position, diameter, bodies)),
        _mount(some, position),
        bodies,
        _water(some, position, length),
        ball(some) if has_tool else None,
        held(some),
    )


def _whole(data: xr.Dataset) -> Bool[np.ndarray, " time"]:
    """Tell at which instants all can be drawn."""
    whole = shaped(data["position"].transpose("time", "node", "axis").values.astype(float))
    for name in _DRAWN:
        if name in data and "time" in data[name].dims:
            whole &= bounded(data[name].transpose("time", ...).values.astype(float))
    return whole


def _thinned(field: Field, nodes: Int[np.ndarray, " chosen"]) -> Field:
    return Field(field.name, field.label, field.unit, field.signed, field.values[:, nodes])


def _fields(
    data: xr.Dataset,
    position: Float[np.ndarray, "time node axis=3"],
    diameter: Float[np.ndarray, " node"],
    bodies: tuple[Body, ...],
) -> list[Field]:
    found = []
    if "curvature" in data:
        bent = np.asarray(data["curvature"].values, float)
        whole = np.linalg.norm(bent, axis=-1) if bent.ndim == 3 else bent
        found.append(Field("curvature", "curvature", "1/m", bent.ndim == 2, whole))
    if "tension" in data:
        edges = np.asarray(data["tension"].values, float)
        nodes = np.concatenate([edges[:, :1], (edges[:, 1:] + edges[:, :-1]) / 2, edges[:, -1:]], 1)
        found.append(Field("tension", "tension", "N", True, nodes))
    if "velocity" in data:
        speed = np.linalg.norm(np.asarray(data["velocity"].values, float), axis=-1)
        found.append(Field("speed", "speed", "m/s", False, speed))
    if bodies:
        far = _FAR * arm_length(data)
        gaps = [_distance(body, position) - diameter / 2 for body in bodies]
        near = np.clip(np.min(gaps, axis=0), 0.0, far)
        found.append(Field("distance", "distance to obstacles", "m", False, near))
    return found


def _distance(
    body: Body, points: Float[np.ndarray, "time node axis=3"]
) -> Float[np.ndarray, "time node"]:
    """Return the distance of points from the surface of an obstacle (m)."""
    apart = points - body.nearest(np.s_[:, None], points)
    if body.solid.kind == "plane":
        return np.asarray(apart @ body.solid.out)
    return np.linalg.norm(apart, axis=-1) - body.solid.radius


def _mount(data: xr.Dataset, position: Float[np.ndarray, "time node axis=3"]) -> Mount:
    every = np.arange(data.sizes["time"])
    frame = attitudes(data, every)
    servo = data.get("base_servo", data.get("base_pose"))
    shift, rails = np.zeros((every.size, 3)), []
    if servo is not None and "channel" in data.coords:
        for name, axis in _SHIFTS.items():
            shift[:, axis] = channel_of(servo, name)
            if shift[:, axis].any() and "channel_lower" in data:
                low = float(data["channel_lower"].sel(channel=name))
                high = float(data["channel_upper"].sel(channel=name))
                if low < high:
                    rails.append((axis, low, high))
    anchor = position[:, 0] - np.einsum("tij,tj->ti", frame, shift)
    return Mount(anchor, base_directions(data, every), frame, tuple(rails))


def _set_direction(data: xr.Dataset) -> Float[np.ndarray, "axis=3"]:
    """Return where the arm leaves a submarine that is level, by the scenario."""
    base = read_scenario(data).get("base", {})
    tilt, pan = (np.deg2rad(float(base.get(f"{name}_deg", 0.0))) for name in ("tilt", "pan"))
    level = np.cos(tilt)
    return np.array([level * np.cos(pan), level * np.sin(pan), np.sin(tilt)])


def _water(
    data: xr.Dataset, position: Float[np.ndarray, "time node axis=3"], length: float
) -> Water | None:
    """Return the current at some places along the arm, told beside all that it sweeps.

    They lie where the water comes from if it comes from a side, and from the root, wherever the
    base goes, always at the same position.
    """
    if "flow_velocity" not in data:
        return None
    root = position[:, :1]
    shape = position.mean(axis=0)
    chosen: list[int] = []
    for node in evenly(len(shape), _PLACES):
        apart = [np.linalg.norm(shape[node] - shape[other]) for other in chosen]
        if not apart or min(apart) > _SPACING * length:
            chosen.append(int(node))
    velocity = in_space(data.isel(node=chosen), "flow_velocity")
    fastest = float(np.linalg.norm(velocity, axis=-1).max(initial=0.0))
    if fastest < 1e-9:
        return None
    mean = velocity.mean(axis=(0, 1))
    chord = shape[-1] - shape[0]
    along = chord / (np.linalg.norm(chord) or 1.0)
    across = mean - (mean @ along) * along
    if np.linalg.norm(across) > 0.2 * np.linalg.norm(mean):
        aside = -across / np.linalg.norm(across)
    else:
        aside = np.zeros(3)
        aside[[0, 2]] = left_of(chord[[0, 2]])
        aside = aside if aside.any() else np.array([1.0, 0.0, 0.0])
    target = in_space(data, "tip_target") - root[:, 0]
    swept = np.concatenate([(position - root).reshape(-1, 3), target])
    clear = float(np.max(swept @ aside)) + (_CLEAR + _REACH) * length
    inward = clear - (shape[chosen] - shape[0]) @ aside
    start = shape[chosen] + inward[:, None] * aside
    return Water(start, velocity, fastest / (_REACH * length))
