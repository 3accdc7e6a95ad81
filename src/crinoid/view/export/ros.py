"""MCAP of a run for ROS 2 and Foxglove: poses, commands, loads and currents as messages."""

from collections.abc import Callable, Iterable, Iterator
from heapq import merge
from operator import itemgetter
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float, Int
from mcap_ros2.writer import Writer
from rosbags.typesys import Stores, get_typestore

from crinoid.foundation.result_variables import LARGE
from crinoid.results.result import Result
from crinoid.results.scene.bodies import COLOURS, RigidBody, rigid_bodies
from crinoid.results.scene.data import in_space
from crinoid.results.scene.mesh import Rotations, look_rotation, quaternions
from crinoid.results.scene.mount import Path as Places
from crinoid.results.scene.scene import Keyframes, Scene
from crinoid.view.export.source import Files, Report, Shapes

WORLD, BASE, TIP, VEHICLE = "world", "base", "tip", "vehicle"
"""Frames of reference; z of the world is up."""
_SECOND = 1_000_000_000  # ns
_GAMMA = 1 / 2.2  # exponent from the light of a colour to its number on a screen
_SHAPES = {"ellipsoid": 2, "capsule": 3, "rod": 3, "plate": 1}  # markers: sphere, cylinder, cube
_LINE_STRIP, _SPHERE, _TRIANGLES, _DELETE = 4, 2, 11, 2
_THIN = 1e-3  # thickness of a plate (m)
_TURNED = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""From the axes of a marker, along z, to those of a body, along x."""

Message = dict[str, Any]
Stamps = Int[np.ndarray, " time"]  # times (ns)
Messages = Iterator[tuple[int, str, str, Message]]  # times (ns), topics, types and messages


def write_mcap(source: Shapes, files: Files, report: Report) -> list[str]:
    """Write the messages of a run in the order of their times, seconds since its start."""
    (path,) = files
    run, data = source.run, _small(source.data, source.run)
    stamps = _nanoseconds(run.time)
    parts = [
        *_poses(data, run, stamps, source.attitudes),
        *(_joints(data, name, stamps) for name in _JOINTS),
        _markers(source.scene, run, stamps, report),
    ]
    types, schemas = get_typestore(Stores.ROS2_JAZZY), {}
    with path.open("wb") as file, Writer(file) as writer:
        writer.add_metadata("crinoid", source.attributes)
        for time, topic, kind, message in merge(*parts, key=itemgetter(0)):
            if kind not in schemas:
                text, _ = types.generate_msgdef(kind, ros_version=2)
                schemas[kind] = writer.register_msgdef(kind, text)
            writer.write_message(topic, schemas[kind], message, time)
    return []


def _small(data: xr.Dataset, run: Keyframes) -> xr.Dataset:
    """Return the chosen instants, of the current along the arm its ends."""
    if "flow_velocity" in data:
        ends = data["flow_velocity"].isel(node=[0, -1]).rename(node="end")
        data = data.drop_vars("flow_velocity").assign(flow_velocity=ends)
    small = [name for name, each in data.data_vars.items() if not LARGE & {*each.dims}]
    return data[small].isel(time=run.at).load()


def _poses(data: xr.Dataset, run: Keyframes, stamps: Stamps, turn: Rotations) -> list[Messages]:
    """Return frames, poses of the tip and of its target, loads on the base, and currents."""
    aside, root, base = turn[:, -1, :, 1], run.position[:, 0], turn[:, 0]
    there, found = _topics_of(data), []
    frames = {BASE: (root, base)}
    if "/tip/pose" in there:
        frames[TIP] = in_space(data, "tip_position"), _pointing(data, "", aside)
        found.append(_stamped(stamps, "/tip/pose", "Pose", WORLD, _poses_of(*frames[TIP])))
    if run.mount.floats:
        frames = {VEHICLE: (run.mount.anchor, run.mount.attitude), **frames}
    found.insert(0, _frames(stamps, frames))
    if "/tip/target" in there:
        target = in_space(data, "tip_target"), _pointing(data, "_target", aside)
        found.append(_stamped(stamps, "/tip/target", "Pose", WORLD, _poses_of(*target)))
    if "/base/wrench" in there:
        # a load is drawn at the origin of its frame and along the axes of that
        given = in_space(data, "base_force"), _moment(data)
        loads = zip(*(np.einsum("tji,tj->ti", base, vector) for vector in given), strict=True)
        wrenches = ({"force": _vector(f), "torque": _vector(m)} for f, m in loads)
        found.append(_stamped(stamps, "/base/wrench", "Wrench", BASE, wrenches))
    if "/tip/current" in there:
        current = in_space(data, "flow_velocity")
        for end, name in enumerate((BASE, TIP)):
            vectors = map(_vector, current[:, end])
            found.append(_stamped(stamps, f"/{name}/current", "Vector3", WORLD, vectors))
    return found


_GEOMETRY = {
    "/tip/pose": ("tip_position", "tip_angle"),
    "/tip/target": ("tip_target", "tip_angle_target"),
    "/base/wrench": ("base_force", "base_moment"),
    "/tip/current": ("flow_velocity",),
}
"""Variables of each topic of geometry; in space directions replace angles."""


def _topics_of(data: xr.Dataset) -> set[str]:
    """Return the topics of geometry whose variables a result has."""

    def has(name: str) -> bool:
        return name in data or name.replace("angle", "direction") in data

    return {topic for topic, names in _GEOMETRY.items() if all(map(has, names))}


def _pointing(data: xr.Dataset, which: str, aside: Places) -> Rotations:
    """Return the attitude of the tip or of its target, whose x axis is where it points."""
    if f"tip_direction{which}" in data:
        return look_rotation(in_space(data, f"tip_direction{which}"), aside)
    angle = np.asarray(data[f"tip_angle{which}"].values, float)
    return look_rotation(np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=-1), aside)


def _moment(data: xr.Dataset) -> Places:
    """Return the moment on the base; from x toward z is a negative turn about y."""
    if "axis" in data["base_moment"].dims:
        return in_space(data, "base_moment")
    moment = np.zeros((data.sizes["time"], 3))
    moment[:, 1] = -data["base_moment"].values
    return moment


_JOINTS = {
    "/commands": {"base_command": "channel", "actuator_command": "input"},
    "/actuators": {"base_servo": "channel", "actuator_state": "input"},
    "/sensors": {"sensor_reading": "reading"},
}
"""Variables of each topic of numbers with names, and their dimension of names."""


def _joints(data: xr.Dataset, topic: str, stamps: Stamps) -> Messages:
    """Yield numbers of inputs or readings with their names.

    Channels that stay put are left out, and commands where there is no controller.
    """
    if topic == "/commands" and not Result(data).known_scenario.control.acts:
        return
    names: list[str] = []
    parts = []
    for variable, dim in _JOINTS[topic].items():
        if variable in data:
            part = data[variable].transpose("time", dim)
            if dim == "channel":
                part = part.isel(channel=(data["channel_lower"] < data["channel_upper"]).values)
            names += map(str, part[dim].values)
            parts.append(part.values)
    if not names:
        return
    rows = np.concatenate(parts, axis=1).astype(float)
    if topic == "/commands":
        # a result has the command of a time step at its end; before the start there is none
        step = Result(data).known_scenario.simulation.time_step
        stamps = np.maximum(stamps - _nanoseconds(np.array(step)), 0)
        last = np.append(np.diff(stamps) > 0, True)
        stamps, rows = stamps[last], rows[last]
    for time, row in zip(stamps.tolist(), rows.tolist(), strict=True):
        message = {"header": _header(time, ""), "name": names, "position": row}
        yield time, topic, "sensor_msgs/msg/JointState", message


def _markers(scene: Scene, run: Keyframes, stamps: Stamps, report: Report) -> Messages:
    """Yield the arm, a line of its diameter, and the bodies around it, for the eye."""
    level = _pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    edge = (run.diameter[1:] + run.diameter[:-1]) / 2
    # a line has one width: an arm that tapers has a line on each edge
    ends = np.flatnonzero(~np.isclose(np.diff(edge), 0.0, atol=1e-9)) + 1
    strips = np.split(np.arange(edge.size), ends)
    around = rigid_bodies(scene, run)
    bodies = [part for body in around if body.shape.solid is None for part in _marked(body)]
    solids = [body for body in around if body.shape.solid is not None]
    for row, time in enumerate(stamps.tolist()):
        header = _header(time, WORLD)
        points = [_vector(place) for place in run.position[row]]
        arm = []
        for number, strip in enumerate(strips):
            look: Message = {"scale": {"x": float(edge[strip[0]])}, "color": _colour("arm")}
            look["points"] = points[strip[0] : strip[-1] + 2]
            arm.append(_marker("arm", number, _LINE_STRIP, level) | look)
        # a viewer keeps those that stay
        moved = [_solid(each, row) for each in solids if not row or each.moves]
        every = (*arm, *(each(row) for each in bodies), *moved)
        found = [{"header": header, **marker} for marker in every]
        yield time, "/arm/markers", "visualization_msgs/msg/MarkerArray", {"markers": found}
        report(row + 1, stamps.size)


def _solid(body: RigidBody, row: int) -> Message:
    """Return the marker of a solid from a file, a list of triangles."""
    assert body.shape.solid is not None
    corners = body.shape.solid.points[body.shape.solid.facets.ravel()]
    pose = _pose(body.position[row], quaternions(body.attitude[[row]])[0])
    look = {"scale": _vector(np.ones(3)), "color": _colour(body.kind)}
    points = [_vector(corner) for corner in corners]
    return _marker(body.name, 0, _TRIANGLES, pose) | look | {"points": points}


def _marker(name: str, number: int, kind: int, pose: Message) -> Message:
    return {"ns": name, "id": number, "type": kind, "pose": pose}


def _marked(body: RigidBody) -> Iterator[Callable[[int], Message]]:
    """Yield functions of an instant that return the markers of a body; a capsule has three."""
    shape, turn = body.shape, quaternions(body.attitude @ _TURNED)
    across, along = 2 * shape.radius, 2 * shape.half or _THIN
    parts = [(_SHAPES[shape.kind], 0.0, np.array([across, across, along]))]
    if shape.kind == "capsule":
        parts += [(_SPHERE, end, np.full(3, across)) for end in (-shape.half, shape.half)]
    for number, (kind, shift, size) in enumerate(parts):
        sizes = size * np.abs(body.scale[:, [1, 2, 0]])
        place = body.position + shift * body.attitude[:, :, 0]

        def marker(
            row: int, number: int = number, kind: int = kind, sizes: Any = sizes, at: Any = place
        ) -> Message:
            found = _marker(body.name, number, kind, _pose(at[row], turn[row]))
            if not sizes[row].any():  # it is hidden
                return found | {"action": _DELETE}
            return found | {"scale": _vector(sizes[row]), "color": _colour(body.kind)}

        yield marker


def _stamped(
    stamps: Stamps, topic: str, kind: str, frame: str, messages: Iterable[Message]
) -> Messages:
    """Yield stamped geometry, such as ``PoseStamped``, of each instant."""
    field = {"Vector3": "vector"}.get(kind, kind.lower())
    for time, message in zip(stamps.tolist(), messages, strict=True):
        whole = {"header": _header(time, frame), field: message}
        yield time, topic, f"geometry_msgs/msg/{kind}Stamped", whole


def _frames(stamps: Stamps, frames: dict[str, tuple[Places, Rotations]]) -> Messages:
    turns = {name: quaternions(turn) for name, (_, turn) in frames.items()}
    for row, time in enumerate(stamps.tolist()):
        moved = [
            {
                "header": _header(time, WORLD),
                "child_frame_id": name,
                "transform": {
                    "translation": _vector(place[row]),
                    "rotation": _quaternion(turns[name][row]),
                },
            }
            for name, (place, _) in frames.items()
        ]
        yield time, "/tf", "tf2_msgs/msg/TFMessage", {"transforms": moved}


def _poses_of(place: Places, turn: Rotations) -> Iterable[Message]:
    return map(_pose, place, quaternions(turn))


def _pose(place: Float[np.ndarray, "axis=3"], turn: Float[np.ndarray, "4"]) -> Message:
    return {"position": _vector(place), "orientation": _quaternion(turn)}


def _vector(numbers: Float[np.ndarray, "axis=3"]) -> Message:
    return dict(zip("xyz", numbers.tolist(), strict=True))


def _quaternion(numbers: Float[np.ndarray, "4"]) -> Message:
    return dict(zip("xyzw", numbers.tolist(), strict=True))


def _colour(kind: str) -> Message:
    return dict(zip("rgba", (*(part**_GAMMA for part in COLOURS[kind]), 1.0), strict=True))


def _header(time: int, frame: str) -> Message:
    return {"stamp": {"sec": time // _SECOND, "nanosec": time % _SECOND}, "frame_id": frame}


def _nanoseconds(time: Float[np.ndarray, "*time"]) -> Int[np.ndarray, "*time"]:
    return np.asarray(np.rint(_SECOND * time), np.int64)
