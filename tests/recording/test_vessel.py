"""The motion of a vessel from its log moves the base as a rigid body."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.scenario import Scenario, ScenarioError

TIME = np.arange(0.0, 4.01, 0.1)
RATE = 2 * np.pi / 4


@pytest.fixture
def log(tmp_path):
    columns = {
        "time (s)": TIME,
        "surge (m)": 3 + 0.2 * np.sin(RATE * TIME),
        "sway (m)": -1 + 0.1 * np.cos(RATE * TIME),
        "heave (cm)": 30 * np.sin(RATE * TIME),
        "roll (deg)": 5 * np.sin(RATE * TIME),
        "pitch (deg)": 3 * np.cos(RATE * TIME),
        "heading (deg)": np.mod(359 + 8 * np.sin(RATE * TIME), 360),
    }
    rows = [
        ",".join(columns),
        *(",".join(map("{:.9f}".format, row)) for row in zip(*columns.values(), strict=True)),
    ]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return str(path)


def moved(log: str, dimension: int, motion=None, **values) -> Scenario:
    table = {"kind": "vessel", "file": log, "interpolation": "smooth"} | (motion or {})
    scenario = Scenario(arm={"nodes": 5, "dimension": dimension})
    return scenario.with_values({"simulation.duration": 4.0, "base.motion": [table]} | values)


def poses(scenario: Scenario, times) -> np.ndarray:
    base = Prepared(scenario).system.base
    still = base.servo.at_rest()
    return np.stack([base.pose(jnp.asarray(when), still)[0] for when in times])


def test_the_root_of_a_planar_arm_moves_with_its_lever(log):
    times = np.array([0.0, 0.7, 2.3, 4.0])
    found = poses(moved(log, 2, {"offset": [4.0, -6.0]}), times)
    pitch = np.deg2rad(3 * np.cos(RATE * times))
    slide = 0.2 * np.sin(RATE * times) + 4 * np.cos(pitch) + 6 * np.sin(pitch) - 4
    heave = 0.3 * np.sin(RATE * times) + 4 * np.sin(pitch) - 6 * np.cos(pitch) + 6
    assert found == pytest.approx(np.stack([slide, heave, pitch], axis=1), abs=2e-6)


@pytest.mark.parametrize("set_angles", [(0.0, -60.0, 0.0), (20.0, -30.0, 10.0), (0.0, -110.0, 0.0)])
def test_in_space_the_root_turns_as_the_vessel_does(log, set_angles):
    pan, tilt, roll = set_angles
    motion = {"offset": [4.0, 0.5, -6.0], "columns": {"yaw": "-heading"}}
    angles = {"base.pan_deg": pan, "base.tilt_deg": tilt, "base.roll_deg": roll}
    scenario = moved(log, 3, motion, **angles)
    base = Prepared(scenario).system.base
    for when, pose in zip(TIME[::7], poses(scenario, TIME[::7]), strict=True):
        sine, cosine = np.sin(RATE * when), np.cos(RATE * when)
        # compass headings are clockwise, and right-handed turns about y lower the bow
        turns = np.deg2rad([-8 * sine, -3 * cosine, 5 * sine])
        vessel = Rotation.from_euler("ZYX", turns)
        level = np.array(base.frame(jnp.zeros(6)))
        assert np.asarray(base.frame(jnp.asarray(pose))) == pytest.approx(
            vessel.apply(level), abs=1e-5
        )
        lever = vessel.apply([4.0, 0.5, -6.0]) - [4.0, 0.5, -6.0]
        shift = lever + np.array([0.2 * sine, 0.1 * (cosine - 1), 0.3 * sine])
        assert pose[:3] == pytest.approx(shift, abs=1e-5)
        assert np.abs(pose[3:]).max() < 0.6  # no whole turns


def test_columns_may_be_reversed_and_left_out(log):
    names = {"surge": "0", "heave": "-heave", "pitch": "0"}
    found = poses(moved(log, 2, {"columns": names}), [1.0])
    assert found[0] == pytest.approx([0.0, -0.3, 0.0], abs=1e-9)


@pytest.mark.slow
def test_an_arm_that_hangs_from_a_joint_feels_the_shift_of_its_root(log):
    values = {"base.mount": "pinned", "base.tilt_deg": -90.0, "simulation.duration": 0.5}
    result = crinoid.simulate(moved(log, 2, {"offset": [0.0, -6.0]}, **values))
    root = result.dataset["position"].values[:, 0] - result.dataset["position"].values[0, 0]
    pose = result.dataset["base_pose"].values
    assert root == pytest.approx(pose[:, :2] - pose[0, :2], abs=1e-12)
    assert np.ptp(result.dataset["tip_position"].values, axis=0).min() > 1e-3


STILL = dict.fromkeys(("surge", "heave", "pitch"), "0")
MISTAKES = [
    (2, {"columns": {"surge": "x"}}, 'columns.surge: got "x", no such column in log.csv'),
    (2, {"columns": {"yaw": "heading"}}, 'columns.yaw: got "heading"; must be left out in'),
    (2, {"columns": {"sge": "0"}}, "columns.sge: unknown key; did you mean .*columns.surge"),
    (2, {"offset": [1, 2, 3]}, r"offset: got \[1.0, 2.0, 3.0\]; must be \[x, z\]"),
    (2, {"skip": 3.0}, "time_column: ends at 1 s of the run; must end at simulation.duration"),
    (2, {"columns": STILL}, "columns: every motion is 0; must name a column"),
    (
        3,
        {"columns": {"yaw": "-heading"}},
        "columns: the arm has a tilt of -85 degrees while the",
    ),
]


@pytest.mark.parametrize(("dimension", "motion", "text"), MISTAKES)
def test_what_cannot_be_is_refused_in_one_line(log, dimension, motion, text):
    with pytest.raises(ScenarioError, match=rf"base.motion.0.{text}") as found:
        _ = Prepared(moved(log, dimension, motion, **{"base.tilt_deg": -85.0})).system
    assert len(found.value.lines) == 1
