"""Reading of logs of robots: MCAP, and bags of ROS 2 and ROS 1, by the package rosbags."""

import re
from collections import defaultdict
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from crinoid.foundation.axes import ANGLES, CHANNELS, POSE
from crinoid.recording.axes import check_order
from crinoid.recording.numbers import check_count
from crinoid.recording.texts import REMARKS, listed, short
from crinoid.scenario.errors import counted, refusal

_ENDINGS = (".mcap", ".db3", ".bag")
_TIP, _COMMANDS, _MARKERS = "/tip/pose", "/commands", re.compile(r"/markers/([^/]+)(/pose)?")
"""Topics of the tip, of commands, and of markers, with their names."""
_JOINTS = "sensor_msgs/msg/JointState"
_NAMED = ["position", "velocity", "effort"]  # lists of `_JOINTS`, in the order of the names
_LOGGED, _MEASURED = "time of log", "time of measurement"
_WITHOUT = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
"""Parts of messages that have no numbers of interest."""
_PLACE = re.compile(r"(.*?)(position|translation|point)\.x")
_OWN = {*POSE[2], *POSE[3], "time", "marker"}  # names of joints that are no commands
_ALIKE = 10**4  # difference of times (ns) that counts as none: records have larger steps
_DATED = 10**17  # times (ns) above this one count from 1970, not from the start of a run


def is_bag(path: Path) -> bool:
    """Return whether a folder is a bag of ROS 2."""
    return (path / "metadata.yaml").is_file()


def reads(file: str, head: bytes) -> bool:
    """Return whether a file or folder is a log of ROS."""
    return Path(file).suffix.lower() in _ENDINGS or is_bag(Path(file))


def read(file: str) -> xr.Dataset:
    """Read the numbers of all topics, and as columns over time those of tip, markers and commands.

    A variable has the name of its topic and its field, such as ``/tip/pose.pose.position.x``, and
    the time of its topic, such as ``/tip/pose.time``. Numbers with names have these, such as
    ``/commands.position.slide``.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        text = f"{short(file)} is a log of ROS, and reading it needs rosbags"
        raise refusal("file", f'{text}: pip install "crinoid[ros]"') from error
    # old bags do not contain the definitions of their messages
    usual = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([Path(file)], default_typestore=usual) as reader:
        kinds = {each.topic: str(each.msgtype) for each in reader.connections}
        columns: dict[str, list[str]] = {_JOINTS: _NAMED}
        unknown: dict[str, str] = {}
        for topic, kind in kinds.items():
            try:
                columns[kind] = columns.get(kind) or _numbers(reader.typestore, kind)
            except KeyError as error:  # rosbags does not know it, or a part of it
                columns[kind], unknown[topic] = [], error.args[0]
        chosen = [each for each in reader.connections if columns[str(each.msgtype)]]
        count = sum(each.msgcount * len(columns[str(each.msgtype)]) for each in chosen)
        check_count(count, file, "its topics")
        rows: dict[str, list[dict[str, float]]] = defaultdict(list)
        for connection, logged, raw in reader.messages(chosen) if chosen else ():
            message: Any = reader.deserialize(raw, connection.msgtype)
            row = _row(message, str(connection.msgtype), columns[str(connection.msgtype)])
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            measured = stamp.sec * 10**9 + stamp.nanosec if stamp else 0
            rows[connection.topic].append({_LOGGED: logged, _MEASURED: measured, **row})
    if not rows:
        there = listed([f"{topic} ({kind})" for topic, kind in kinds.items()]) or "no topic"
        text = f"{short(file)} contains {there}"
        raise refusal("file", text, "have a topic of stamped geometry or of JointState")
    topics = {topic: pd.DataFrame(each) for topic, each in rows.items()}
    table, remarks = _table(topics, kinds)
    for topic, kind in unknown.items():
        remarks.append(f"{topic} is not read: the log has no definition of {kind}")
    tracks = {t: _track(frame, _clock([frame]), t, remarks) for t, frame in topics.items()}
    found = _dataset(table, remarks)
    for topic, track in tracks.items():
        clock = f"{topic}.time"
        found = found.assign_coords({clock: (clock, *_time(track.index))})
        found = found.assign({f"{topic}.{name}": (clock, track[name]) for name in track})
    return found


def _numbers(types: Any, kind: str) -> list[str]:
    """Return the names of the numbers in a type of message; none if it has lists of any length."""
    found: list[str] = []
    for name, (node, of) in types.fielddefs[kind][1]:
        if node.name == "SEQUENCE":
            return []
        if node.name == "NAME" and of not in _WITHOUT:
            inner = _numbers(types, of)
            if not inner:
                return []
            found += [f"{name}.{each}" for each in inner]
        if node.name == "BASE" and "string" not in of[0]:
            found.append(name)
    return found


def _row(message: Any, kind: str, names: list[str]) -> dict[str, float]:
    if kind != _JOINTS:
        return {name: float(attrgetter(name)(message)) for name in names}
    return {
        f"{field}.{name}": number
        for field in names
        for name, number in zip(message.name, getattr(message, field), strict=False)
    }


def _clock(frames: list[pd.DataFrame]) -> str:
    """Return the column of times: of the measurement, or of the log where one has none."""
    return _MEASURED if all(frame[_MEASURED].any() for frame in frames) else _LOGGED


def _track(frame: pd.DataFrame, clock: str, topic: str, remarks: list[str]) -> pd.DataFrame:
    """Return the numbers of a topic over time (ns); of messages at equal times the last one."""
    track = frame.set_index(clock).drop(columns={_MEASURED, _LOGGED} - {clock})
    last = np.diff(track.index, append=np.iinfo(np.int64).max) != 0
    if not last.all():
        left = counted(int((~last).sum()), "message")
        text = f"of messages of {topic} at the same time the last counts: {left} left out"
        remarks += [] if text in remarks else [text]
    return track[last]


def _time(index: pd.Index) -> tuple[Any, dict[str, str]]:
    """Return times with their unit: seconds of a run, or dates."""
    if index.size and index[0] > _DATED:
        return index.to_numpy(), {"units": "nanoseconds since 1970-01-01"}
    return index.to_numpy() / 1e9, {"units": "s"}


def _table(
    topics: dict[str, pd.DataFrame], kinds: dict[str, str]
) -> tuple[pd.DataFrame, list[str]]:
    """Return the places of tip and markers with the commands over time (ns), and remarks."""
    remarks: list[str] = []

    def track(topic: str) -> pd.DataFrame:
        found = _track(topics[topic], clock, topic, remarks)
        since = (found.index - found.index[0]).to_numpy() / 1e9
        check_order(found.index.to_numpy(), since, f"{clock} of {topic}", "file")
        return found

    placed = [t for t in topics if kinds[t] != _JOINTS and _place_of(topics[t])]
    markers = {found[1]: topic for topic in placed if (found := _MARKERS.fullmatch(topic))}
    placed = [topic for topic in placed if topic not in markers.values()]
    tip = _only(_TIP, placed, "the tip", remarks)
    driven = _only(_COMMANDS, [t for t in topics if kinds[t] == _JOINTS], "commands", remarks)
    labelled = ({"tip": tip} if tip else {}) | markers
    used = [*labelled.values(), *([driven] if driven else [])]
    clock = _clock([topics[topic] for topic in used])
    if clock == _LOGGED:
        remarks.append("times are those of the log: a topic has none of the measurement")
    commands = pd.DataFrame(index=pd.Index([], dtype=np.int64))
    if driven:
        commands = track(driven).filter(regex=r"^position\.").ffill()
        commands.columns = commands.columns.str.removeprefix("position.")
        commands = commands.drop(columns=[*_OWN], errors="ignore")
    parts: list[pd.DataFrame] = []
    for label, topic in labelled.items():
        places = _places(track(topic))
        times = places.index
        if not parts:  # with each command at its own time: none is lost at a lower rate
            at = times.get_indexer(commands.index, method="nearest", tolerance=_ALIKE)
            commands.index = pd.Index(np.where(at < 0, commands.index, times[at]))
            commands = commands[~commands.index.duplicated(keep="last")]
            times = times.union(commands.index)
        held = commands.reindex(times, method="ffill")
        part = pd.concat([places.reindex(times), held], axis=1)
        parts.append(part.assign(marker=label) if markers else part)
        if driven and not places.index.equals(times):
            text = f"time has the instants of {topic} and of {driven}"
            remarks.append(f"{text}; each command is valid until the next")
    return pd.concat(parts or [commands]).sort_index(kind="stable"), remarks


def _only(usual: str, topics: list[str], role: str, remarks: list[str]) -> str | None:
    """Return the usual topic of a role, or the only one that fits, with a remark on it."""
    if usual in topics:
        return usual
    if len(topics) != 1:
        return None
    remarks.append(f"{topics[0]} counts as {role}, as no other topic fits")
    return topics[0]


def _place_of(frame: pd.DataFrame) -> str | None:
    """Return the fields of a place but for their last letter, such as ``pose.position.``."""
    found = (_PLACE.fullmatch(name) for name in frame)
    return next((each[0][:-1] for each in found if each), None)


def _places(track: pd.DataFrame) -> pd.DataFrame:
    """Return the places (m) of a topic, and where its x axis points (unit vector, angle in rad)."""
    place = _place_of(track) or ""
    found = track[[f"{place}{axis}" for axis in "xyz"]].set_axis([*"xyz"], axis="columns")
    turned = re.sub(r"translation\.$", "rotation.", re.sub(r"position\.$", "orientation.", place))
    names = [f"{turned}{part}" for part in "xyzw"]
    if turned == place or not {*names} <= {*track} or (track[names] == 0).all(axis=1).any():
        return found  # a message without an orientation has zeros
    i, j, k, w = (track[names].to_numpy() / np.linalg.norm(track[names], axis=1)[:, None]).T
    ahead = {"x": 1 - 2 * (j * j + k * k), "y": 2 * (i * j + k * w), "z": 2 * (i * k - j * w)}
    found = found.assign(**{f"direction_{axis}": part for axis, part in ahead.items()})
    angle = np.arctan2(ahead["z"], ahead["x"])
    there = np.isfinite(angle)
    angle[there] = np.unwrap(angle[there])  # a gap would spread to all that follows
    return found.assign(angle=angle)


def _dataset(table: pd.DataFrame, remarks: list[str]) -> xr.Dataset:
    """Return the columns of a table over time, with their units as far as these are known."""
    units = dict.fromkeys(("x", "y", "z", *CHANNELS[3]), "m")
    units |= dict.fromkeys(("angle", *ANGLES), "rad")
    found = xr.Dataset(attrs={REMARKS: "\n".join(remarks)})
    if table.columns.size:
        found = found.assign_coords(time=("time", *_time(table.index)))
    for name in table:
        unit = {"units": units[name]} if name in units else {}
        values = table[name].to_numpy(str if name == "marker" else float)
        found[name] = ("time", values, unit)
    return found
