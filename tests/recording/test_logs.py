"""Logs of ROS: MCAP, bags of ROS 2 and ROS 1, and a run's own log read back."""

import sqlite3
import sys

import jax.numpy as jnp
import numpy as np
import pytest

from crinoid.actuation import Input
from crinoid.foundation.axes import ANGLES
from crinoid.inverse.experiment_record import read_record
from crinoid.inverse.marker import Marker
from crinoid.recording import read_dataset
from crinoid.recording.numbers import Column
from crinoid.recording.series import read_series
from crinoid.recording.units import length_factor
from crinoid.scenario import Scenario
from crinoid.view.export import write_export
from helpers.made_results import PID
from helpers.planar_result import swaying_arm
from helpers.refusals import mistake
from helpers.spatial_result import curling_arm
from helpers.studies import save

pytest.importorskip("mcap_ros2", reason="mcap-ros2-support is not installed")
pytest.importorskip("rosbags", reason="rosbags is not installed")
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

SECOND = 10**9
STAMP = 1_760_000_000 * SECOND
"""A date (ns since 1970)."""
X = Column("value_column", "/other.pose.position.x", length_factor, "m", 1e3)
RUNS = {2: swaying_arm, 3: curling_arm}
TWO, THREE = (get_typestore(each) for each in (Stores.ROS2_HUMBLE, Stores.ROS1_NOETIC))


def inputs(*names):
    ends = jnp.array(-1.0), jnp.array(1.0)
    return [Input(name, "rad" if name in ANGLES else "m", "shift", *ends) for name in names]


def header(types, time):
    parts = {} if types is TWO else {"seq": 0}
    stamp = types.types["builtin_interfaces/msg/Time"](time // SECOND, time % SECOND)
    return types.types["std_msgs/msg/Header"](stamp=stamp, frame_id="world", **parts)


def pose(time, place, turn=(0.0, 0.0, 0.0, 1.0), types=TWO):
    """Return the type and the message of a stamped pose."""
    of = types.types
    point, quaternion = of["geometry_msgs/msg/Point"], of["geometry_msgs/msg/Quaternion"]
    whole = of["geometry_msgs/msg/Pose"](point(*place), quaternion(*turn))
    name = "geometry_msgs/msg/PoseStamped"
    return name, of[name](header(types, time), whole)


def joints(time, types=TWO, **positions):
    name = "sensor_msgs/msg/JointState"
    empty = np.zeros(0)
    row = np.array([*positions.values()], float)
    return name, types.types[name](header(types, time), [*positions], row, empty, empty)


def text(words):
    return "std_msgs/msg/String", TWO.types["std_msgs/msg/String"](words)


def bag(path, messages, *, types=TWO, **options):
    """Write messages, each with its time of receipt (ns) and its topic, into a bag."""
    writer = rosbag1.Writer(path) if types is THREE else rosbag2.Writer(path, **options)
    written = {}
    with writer:
        for time, topic, (kind, message) in sorted(messages, key=lambda each: each[0]):
            if topic not in written:
                written[topic] = writer.add_connection(topic, kind, typestore=types)
            coded = types.serialize_ros1 if types is THREE else types.serialize_cdr
            writer.write(written[topic], time, coded(message, kind))
    return path


@pytest.mark.parametrize("axes", RUNS)
def test_the_log_of_a_run_is_a_record_of_it(axes, tmp_path):
    data = RUNS[axes](records=21, duration=2.0, nodes=5)
    tables = data.attrs["scenario"] + PID + "[simulation]\ntime_step = 0.05\n"
    path = save(data.assign_attrs(scenario=tables), tmp_path / "result.nc")
    log = write_export(path, tmp_path, "mcap").files[0]
    names = data["channel"].values.tolist()
    record = read_record(log, Scenario(arm={"dimension": axes}), inputs(*names))
    np.testing.assert_allclose(record.time, data["time"].values, atol=1e-9)  # stamps are in ns
    tip = {name: data["tip_position"].values[:, k] for k, name in enumerate("xyz"[:axes])}
    if axes == 2:
        tip = {"x": tip["x"], "z": tip["y"], "angle": data["tip_angle"].values}
    else:
        ahead = data["tip_direction"].values.T
        tip |= {f"direction_{name}": part for name, part in zip("xyz", ahead, strict=True)}
    assert record.names == tuple(tip)
    np.testing.assert_allclose(record.values, np.stack([*tip.values()], axis=1), atol=1e-14)
    # a command is that of a time step, which a result has at the end of the step
    starts = np.maximum(data["time"].values - 0.05, 0.0)
    rows = np.searchsorted(record.commands.time, starts - 1e-9)
    np.testing.assert_allclose(record.commands.time[rows], starts, atol=1e-9)
    np.testing.assert_array_equal(record.commands.values[rows], data["base_command"].values)
    first = "time has the instants of /tip/pose and of /commands; each command is valid until the"
    assert record.notes[0] == f"{first} next"


TIP = STAMP + np.arange(5) * SECOND // 10
"""Times of the measurement (ns), which the log receives 30 ms later."""
FAST = STAMP + np.arange(41) * SECOND // 100
PLACES = np.stack(
    [0.4 + 0.01 * np.arange(5), 0.1 * np.ones(5), -10.0 - 0.02 * np.arange(5)], axis=1
)
SLIDE = np.sin(np.arange(41))


def motion(types=TWO, tip="/tip/pose", commands="/commands"):
    half = np.deg2rad(30.0) / 2
    turn = (0.0, -np.sin(half), 0.0, np.cos(half))  # from x toward z is a negative turn about y
    late = 3 * SECOND // 100
    return [
        *(
            (int(t) + late, tip, pose(int(t), p, turn, types))
            for t, p in zip(TIP, PLACES, strict=True)
        ),
        *(
            (int(t) + 1, commands, joints(int(t), types, slide=s))
            for t, s in zip(FAST, SLIDE, strict=True)
        ),
    ]


MCAP = {"version": 9, "storage_plugin": rosbag2.StoragePlugin.MCAP}
KINDS = {
    "folder": ("walk", {"version": 9}, TWO, ""),
    "db3": ("walk", {"version": 9}, TWO, "walk.db3"),
    "mcap": ("walk", MCAP, TWO, "walk.mcap"),
    "ROS 1": ("walk.bag", {}, THREE, ""),
}


@pytest.mark.parametrize("kind", KINDS)
def test_bags_are_read_at_the_times_of_measurement(kind, tmp_path):
    name, options, types, inner = KINDS[kind]
    path = bag(tmp_path / name, motion(types), types=types, **options) / inner
    record = read_record(path, Scenario(arm={"dimension": 2}), inputs("slide"))
    np.testing.assert_allclose(record.time, 0.1 * np.arange(5), atol=1e-12)
    np.testing.assert_array_equal(record.values[:, :2], PLACES[:, [0, 2]])
    np.testing.assert_allclose(record.values[:, 2], np.deg2rad(30.0))
    # commands keep their own rate, ten times that of the tip
    np.testing.assert_allclose(record.commands.time, 0.01 * np.arange(41), atol=1e-12)
    np.testing.assert_array_equal(record.commands.values[:, 0], SLIDE)


def test_the_only_topic_that_fits_is_named(tmp_path):
    other = (STAMP, "/talk", text("hello"))
    path = bag(tmp_path / "a", [*motion(tip="/mocap/ball", commands="/rail"), other], version=9)
    record = read_record(path, Scenario(arm={"dimension": 2}), inputs("slide"))
    np.testing.assert_array_equal(record.values[:, 0], PLACES[:, 0])
    assert record.notes[:2] == (
        "/mocap/ball counts as the tip, as no other topic fits",
        "/rail counts as commands, as no other topic fits",
    )


def test_a_type_without_definition_costs_its_topic_alone(tmp_path):
    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg("float64 depth", "sea_msgs/msg/Depth"))
    depth = "sea_msgs/msg/Depth", types.types["sea_msgs/msg/Depth"](3.0)
    path = bag(tmp_path / "a", [*motion(), (STAMP, "/depth", depth)], types=types, version=9)
    assert "/depth.depth" in read_dataset(str(path))
    with sqlite3.connect(path / "a.db3") as file:
        file.execute("delete from message_definitions")
    record = read_record(path, Scenario(arm={"dimension": 2}), inputs("slide"))
    np.testing.assert_array_equal(record.values[:, 0], PLACES[:, 0])
    assert "/depth is not read: the log has no definition of sea_msgs/msg/Depth" in record.notes


def test_two_topics_that_fit_are_no_tip(tmp_path):
    more = [(time, "/mocap/other", each) for time, topic, each in motion() if topic == "/tip/pose"]
    path = bag(tmp_path / "a", [*motion(tip="/mocap/ball"), *more], version=9)
    line = mistake(read_record, path, Scenario(arm={"dimension": 2}), inputs("slide"))
    assert line.endswith("must have time and some of x, z, angle")


def test_joints_with_the_name_of_a_coordinate_are_no_place_of_the_tip(tmp_path):
    messages = [(int(t), "/gantry", joints(int(t), x=0.1, slide=0.2)) for t in TIP]
    found = read_dataset(str(bag(tmp_path / "a", messages, version=9)))
    assert "x" not in found
    assert found["/gantry.position.x"].values.tolist() == [0.1] * 5
    assert found["slide"].values.tolist() == [0.2] * 5


def test_an_angle_turns_on_over_a_gap(tmp_path):
    halves = np.deg2rad([170.0, 178.0, np.nan, 186.0, 194.0]) / 2
    messages = [
        (int(t), "/tip/pose", pose(int(t), p, (0.0, -np.sin(h), 0.0, np.cos(h))))
        for t, p, h in zip(TIP, PLACES, halves, strict=True)
    ]
    found = read_dataset(str(bag(tmp_path / "a", messages, version=9)))
    np.testing.assert_allclose(found["angle"].values, 2 * halves)


def test_markers_have_rows_with_their_name(tmp_path):
    late = TIP[1:] + SECOND // 50
    elbow = [
        (int(time), "/markers/elbow", pose(int(time), place))
        for time, place in zip(late, 0.5 * PLACES[1:], strict=True)
    ]
    path = bag(tmp_path / "a", [*motion(), *elbow], version=9)
    marker = Marker(name="elbow", s=0.1)
    record = read_record(path, Scenario(arm={"dimension": 2}), inputs("slide"), (marker,))
    assert record.names == ("x", "z")
    np.testing.assert_array_equal(record.values[record.marker == 0], PLACES[:, [0, 2]])
    np.testing.assert_array_equal(record.values[record.marker == 1], 0.5 * PLACES[1:, [0, 2]])
    np.testing.assert_allclose(record.time[record.marker == 1], (late - STAMP) / SECOND)
    values = dict(zip(record.commands.time.round(6), record.commands.values[:, 0], strict=True))
    assert [values[time] for time in (0.01, 0.12, 0.33)] == SLIDE[[1, 12, 33]].tolist()


def test_without_times_of_measurement_those_of_the_log_count(tmp_path):
    messages = motion()
    for _, topic, (_, each) in messages:
        if topic == "/commands":
            each.header.stamp = TWO.types["builtin_interfaces/msg/Time"](0, 0)
    path = bag(tmp_path / "a", messages, version=9)
    record = read_record(path, Scenario(arm={"dimension": 2}), inputs("slide"))
    assert record.notes[0] == "times are those of the log: a topic has none of the measurement"
    found = read_dataset(str(path))
    tip = found["time"].values[np.isfinite(found["x"].values)]
    assert found["time"].attrs["units"] == "nanoseconds since 1970-01-01"
    np.testing.assert_array_equal(tip, TIP + 3 * SECOND // 100)
    np.testing.assert_array_equal(found["/tip/pose.time"].values, TIP)
    assert found["slide"].attrs["units"] == "m"


def at_stamps(order):
    """Return messages of the tip, received in turn, whose stamps have an order."""
    return [
        (STAMP + k * SECOND, "/tip/pose", pose(int(TIP[at]), PLACES[at]))
        for k, at in enumerate(order)
    ]


def test_stamps_that_go_back_are_refused_and_not_sorted(tmp_path):
    line = mistake(read_dataset, str(bag(tmp_path / "a", at_stamps([0, 1, 3, 2, 4]), version=9)))
    text = "file: time of measurement of /tip/pose goes back at entry 3, 0.3 s after the first"
    assert line == f"{text}; must increase"
    # a topic that has no role is refused where it is used
    others = [(time, "/other", each) for time, _, each in at_stamps([0, 1, 3, 2, 4])]
    path = str(bag(tmp_path / "b", [*motion(), *others], version=9))
    assert mistake(read_series, path, "/other.time", [X], 0.0).startswith(
        "time_column: /other.time goes back at entry 3, 0.3 s after the first"
    )


def test_of_messages_with_one_stamp_the_last_counts_and_is_said(tmp_path):
    path = bag(tmp_path / "a", at_stamps([0, 1, 1, 1, 2]), version=9)
    record = read_record(path, Scenario(arm={"dimension": 2}), inputs("slide"))
    np.testing.assert_allclose(record.time, [0.0, 0.1, 0.2], atol=1e-12)
    text = "of messages of /tip/pose at the same time the last counts: 2 messages left out"
    assert record.notes.count(text) == 1


def test_what_is_no_log_is_refused_in_a_line(tmp_path, monkeypatch):
    talk = bag(tmp_path / "talk", [(STAMP, "/talk", text("hello"))], version=9)
    line = mistake(read_dataset, str(talk))
    assert "must have a topic of stamped geometry or of JointState" in line
    (talk / "talk.db3").unlink()
    assert mistake(read_dataset, str(talk)).startswith("file: talk is broken (")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(b"\x89MCAP0\r\nabc")
    assert mistake(read_dataset, str(cut)).startswith("file: cut.mcap is broken (")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    line = mistake(read_dataset, str(cut))
    assert line.endswith('reading it needs rosbags: pip install "crinoid[ros]"')
