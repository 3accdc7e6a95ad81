"""Logs of ROS 2, as the reader of MCAP decodes them."""

import numpy as np
import pytest

from crinoid.foundation.result_variables import quantity
from crinoid.results.own_files import is_own
from crinoid.results.result import Result
from crinoid.results.scene.bodies import rigid_bodies
from crinoid.results.scene.data import in_space
from crinoid.results.scene.scene import build_scene
from crinoid.view.export import write_export
from helpers.command import refused, succeeded
from helpers.made_results import PID
from helpers.planar_result import swaying_arm
from helpers.spatial_result import among_obstacles, curling_arm
from helpers.studies import save

pytest.importorskip("rosbags", reason="rosbags is not installed")
mcap = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")

SMALL = {"records": 5, "duration": 2.0, "nodes": 7}
STEP = "[simulation]\ntime_step = 0.1\n"
TOOL = "[tool]\nmass = 0.2\nvolume = 5e-5\noffset = 0.03\n"
RUNS = {
    "planar": lambda: swaying_arm(**SMALL, moving_target=True),
    "spatial": lambda: curling_arm(**SMALL, moving_target=True),
}


@pytest.fixture(params=RUNS)
def run(request, tmp_path):
    data = RUNS[request.param]()
    data = data.assign_attrs(scenario=data.attrs["scenario"] + PID + STEP)
    return save(data, tmp_path / "result.nc"), data


def decoded(path):
    """Messages of each topic with their times (s)."""
    found = {}
    for each in mcap.read_ros2_messages(str(path)):
        found.setdefault(each.channel.topic, []).append((each.log_time_ns / 1e9, each.ros_msg))
    return found


def vector(message):
    return [message.x, message.y, message.z]


def turn(message):
    """Rotation matrix of a quaternion."""
    x, y, z, w = message.x, message.y, message.z, message.w
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def test_messages_have_the_numbers_of_the_result(run, tmp_path):
    path, data = run
    written = write_export(path, tmp_path, "mcap")
    assert [file.name for file in written.files] == ["result.mcap"]
    assert written.notes == []
    topics = decoded(written.files[0])
    poses = [message for _, message in topics["/tip/pose"]]
    assert [time for time, _ in topics["/tip/pose"]] == data["time"].values.tolist()
    stamps = [each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for each in poses]
    np.testing.assert_allclose(stamps, data["time"].values)
    assert {each.header.frame_id for each in poses} == {"world"}
    tip = [vector(each.pose.position) for each in poses]
    np.testing.assert_array_equal(tip, in_space(data, "tip_position"))
    target = [vector(each.pose.position) for _, each in topics["/tip/target"]]
    np.testing.assert_array_equal(target, in_space(data, "tip_target"))
    ahead = np.array([turn(each.pose.orientation)[:, 0] for each in poses])
    if "tip_direction" in data:
        np.testing.assert_allclose(ahead, data["tip_direction"].values, atol=1e-12)
    else:
        angle = data["tip_angle"].values
        np.testing.assert_allclose(ahead[:, 0], np.cos(angle), atol=1e-12)
        np.testing.assert_allclose(ahead[:, 2], np.sin(angle), atol=1e-12)
    current = [vector(each.vector) for _, each in topics["/tip/current"]]
    np.testing.assert_array_equal(current, in_space(data, "flow_velocity")[:, -1])


def test_loads_on_the_base_are_in_its_frame(run, tmp_path):
    path, data = run
    topics = decoded(write_export(path, tmp_path, "mcap").files[0])
    force, moment = in_space(data, "base_force"), np.zeros((5, 3))
    if data["base_moment"].ndim == 2:
        moment = in_space(data, "base_moment")
    else:
        moment[:, 1] = -data["base_moment"].values  # from x toward z
    for record, (_, tree) in enumerate(topics["/tf"]):
        frames = {each.child_frame_id: each.transform for each in tree.transforms}
        base, loads = frames["base"], topics["/base/wrench"][record][1]
        root = in_space(data, "position")[record, 0]
        np.testing.assert_array_equal(vector(base.translation), root)
        assert loads.header.frame_id == "base"
        turned = turn(base.rotation)
        np.testing.assert_allclose(turned @ vector(loads.wrench.force), force[record], atol=1e-12)
        found = turned @ vector(loads.wrench.torque)
        np.testing.assert_allclose(found, moment[record], atol=1e-12)
        np.testing.assert_allclose(turned.T @ turned, np.eye(3), atol=1e-12)
        first = in_space(data, "tangent")[record, 0]
        np.testing.assert_allclose(turned[:, 0], first, atol=1e-12)


def test_a_floating_vehicle_has_a_frame_from_which_servos_move_the_root(tmp_path):
    data = swaying_arm(**SMALL)
    pitch = 0.0 * data["base_pose"]
    pitch[:, 2] = np.linspace(0.0, 0.5, 5)
    data = data.assign(base_servo=data["base_pose"], vehicle_pose=pitch)
    data = data.assign_attrs(
        scenario=data.attrs["scenario"] + "[vehicle]\nmass = 30.0\ninertia = 1.0\n"
    )
    log = write_export(save(data, tmp_path / "result.nc"), tmp_path, "mcap").files[0]
    for record, (_, tree) in enumerate(decoded(log)["/tf"]):
        frames = {each.child_frame_id: each.transform for each in tree.transforms}
        turned = turn(frames["vehicle"].rotation)
        angle = pitch.values[record, 2]
        np.testing.assert_allclose(turned[:, 0], [np.cos(angle), 0, np.sin(angle)], atol=1e-12)
        slide = data["base_servo"].values[record, 0]
        root = vector(frames["vehicle"].translation) + slide * turned[:, 0]
        np.testing.assert_allclose(root, in_space(data, "position")[record, 0], atol=1e-12)


def test_commands_have_the_time_at_which_they_begin(run, tmp_path):
    path, data = run
    commands = decoded(write_export(path, tmp_path, "mcap").files[0])["/commands"]
    times = [time for time, _ in commands]
    np.testing.assert_allclose(times, [0.0, *(data["time"].values[1:] - 0.1)])
    assert commands[0][1].name == data["channel"].values.tolist()
    rows = [message.position for _, message in commands]
    np.testing.assert_array_equal(rows, data["base_command"].values)


def test_still_channels_and_what_a_result_lacks_are_left_out(tmp_path):
    data = swaying_arm(**SMALL)
    data.attrs["scenario"] += PID
    for name, ends in {"channel_lower": [-1.0, 0, -1], "channel_upper": [1.0, 0, 1]}.items():
        data[name] = quantity(name, ends, 2)
    whole = decoded(write_export(save(data, tmp_path / "result.nc"), tmp_path, "mcap").files[0])
    assert whole["/commands"][0][1].name == ["slide", "tilt"]
    idle = data.drop_vars(["flow_velocity", "base_force", "tip_angle", "tip_angle_target"])
    idle = idle.assign_attrs(scenario='[control]\nkind = "none"\n')
    topics = decoded(write_export(save(idle, tmp_path / "result.nc"), tmp_path, "mcap").files[0])
    missing = {"/commands", "/tip/current", "/base/current", "/base/wrench"}
    missing |= {"/tip/pose", "/tip/target"}
    assert set(topics) == set(whole) - missing
    assert "tip" not in {each.child_frame_id for each in topics["/tf"][0][1].transforms}


def test_markers_are_where_the_arm_and_the_bodies_are(tmp_path):
    data = among_obstacles(**SMALL)
    data = data.assign(tool_held=("time", 1.0 * (np.arange(5) >= 2)))
    data = data.assign_attrs(scenario=data.attrs["scenario"] + TOOL)
    path = save(data, tmp_path / "result.nc")
    shown = decoded(write_export(path, tmp_path, "mcap").files[0])["/arm/markers"]
    scene = build_scene(Result(data), 99, 99)
    bodies = {body.name: body for body in rigid_bodies(scene, scene.members[0])}
    position, diameter = in_space(data, "position"), data["diameter"].values
    for record, (_, message) in enumerate(shown):
        arm = [each for each in message.markers if each.ns == "arm"]
        # it tapers: a line on each edge
        widths = [each.scale.x for each in arm]
        np.testing.assert_allclose(widths, (diameter[1:] + diameter[:-1]) / 2)
        ends = np.array([[vector(point) for point in each.points] for each in arm])
        np.testing.assert_array_equal(ends[:, 0], position[record, :-1])
        np.testing.assert_array_equal(ends[:, 1], position[record, 1:])
        others = [each for each in message.markers if each.ns != "arm"]
        assert {each.ns for each in others} == set(bodies)
        for each in others:
            body = bodies[each.ns]
            assert each.action == (0 if body.scale[record].any() else 2)
            along = turn(each.pose.orientation)[:, 2]
            np.testing.assert_allclose(along, body.attitude[record, :, 0], atol=1e-7)
            if each.id == 0:
                np.testing.assert_allclose(vector(each.pose.position), body.position[record])
        assert len({(each.ns, each.id) for each in message.markers}) == len(message.markers)


def test_the_command_replaces_its_own_files_only(tmp_path):
    path = save(swaying_arm(**SMALL), tmp_path / "result.nc")
    succeeded("export", path, "--to", "mcap", "--instants", 3)
    log = tmp_path / "result.mcap"
    assert is_own(log)
    assert len(decoded(log)["/tip/pose"]) == 3
    succeeded("export", path, "--to", "mcap")
    log.write_bytes(b"\x89MCAP0\r\n of others")
    assert "result.mcap" in refused("export", path, "--to", "mcap")
