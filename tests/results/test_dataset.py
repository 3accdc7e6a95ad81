"""The variables of a result, from what a run keeps: in the plane and in space."""

from dataclasses import fields

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.base import Servo
from crinoid.elements import ENERGIES, WORKS
from crinoid.results.chunks import join, unwrap_from
from crinoid.results.dataset import Instants, build_dataset
from crinoid.results.record import Record

NODES, RECORDS = 5, 4
ORIGIN = np.array([1.0, -2.0, -10.0])
SCENARIO = crinoid.Scenario.from_toml(f"[arm]\nnodes = {NODES}\nlength = 0.4\n")


@pytest.fixture(scope="module")
def system():
    """A planar arm's, moved out of the plane: of the rod only what the plane shares is asked."""
    planar = crinoid.system(SCENARIO)
    slide = jnp.eye(6)[0]
    servo = Servo(-slide, slide, *jnp.ones((3, 6)))
    return eqx.tree_at(
        lambda system: (system.forces.origin, system.base.servo),
        planar,
        (jnp.asarray(ORIGIN), servo),
    )


def kept(**changes):
    """Keep some instants of an arm that points up and to port, whose frame turns about it."""
    rng = np.random.default_rng(1)
    ahead = np.array([0.6, 0.48, 0.64])
    arc = 0.1 * np.arange(NODES)
    position = np.tile(arc[:, None] * ahead, (RECORDS, 1, 1))
    tip = np.tile(np.concatenate([ORIGIN + 0.4 * ahead, ahead]), (RECORDS, 1))

    def some(*shape):
        return rng.normal(size=(RECORDS, *shape))

    values = {
        "time": 0.5 * np.arange(RECORDS),
        "position": position,
        "velocity": 0 * position,
        "tip": tip,
        "reference": tip + np.array([0.03, 0.04, 0.12, 0.0, 0.0, 0.0]),
        "energy": some(len(ENERGIES) + len(WORKS)),
        "steps": np.arange(RECORDS),
        "iterations": np.arange(RECORDS),
        "residual": some(),
        "error": some(),
        "director": some(NODES - 1, 3),
        "curvature": some(NODES, 2),
        "moment": some(NODES, 3),
        "twist": some(NODES),
    }
    values |= {name: some(NODES, 3) for name in ("acceleration", "flow_velocity")}
    values |= {name: some(6) for name in ("command", "servo", "pose", "reading")}
    values |= {name: some(3) for name in ("base_force", "base_moment")} | changes
    nothing = dict.fromkeys((field.name for field in fields(Record)), None)
    return Record(**nothing | jax.tree.map(jnp.asarray, values))


def dataset_of(system, record):
    return build_dataset(Instants(system, record), SCENARIO.arm.diameters)


@pytest.fixture(scope="module")
def dataset(system):
    return dataset_of(system, kept())


def test_channels_in_space_are_shifts_and_turns_with_their_limits(dataset):
    assert float(dataset["channel_upper"].sel(channel="slide")) == 1
    assert float(dataset["channel_lower"].sel(channel="sway")) == 0
    assert dataset["twist"].attrs["units"] == "rad m-1"
    # no one unit that CF knows
    assert "units" not in dataset["base_pose"].attrs
    units = dict(zip(dataset["channel"].values, dataset["channel_unit"].values, strict=True))
    shifts, turns = ("slide", "sway", "heave"), ("pan", "tilt", "roll")
    assert units == dict.fromkeys(shifts, "m") | dict.fromkeys(turns, "rad")


def test_values_in_space_are_those_of_the_record(dataset):
    record = kept()
    np.testing.assert_array_equal(dataset["curvature"], record.curvature)
    np.testing.assert_array_equal(dataset["director"], record.director)
    np.testing.assert_array_equal(dataset["base_moment"], record.base_moment)
    twist = np.asarray(record.twist)
    np.testing.assert_allclose(dataset["twist"], (twist[:, 1:] + twist[:, :-1]) / 2)
    np.testing.assert_allclose(dataset["position"].values[0, 0], ORIGIN)
    np.testing.assert_allclose(dataset["tip_error"], 0.13)  # of the place alone: 3, 4, 12 cm
    np.testing.assert_allclose(dataset["tip_direction"].values[0], [0.6, 0.48, 0.64])
    np.testing.assert_allclose(dataset["tip_angle"], np.arcsin(0.64))
    np.testing.assert_allclose(
        dataset["flow_speed"], np.linalg.norm(dataset["flow_velocity"].values, axis=-1)
    )


@pytest.mark.parametrize(
    ("direction", "sine"),
    [
        ([0.0, 0.0, 1.0], 1.0),
        ([0.0, 0.0, -1.0], -1.0),
        ([-1.0, 0, 0], 0.0),
        ([0, -0.8, -0.6], -0.6),
    ],
)
def test_the_angle_of_the_tip_is_that_above_the_level_plane(system, direction, sine):
    angle = dataset_of(system, kept(tip=np.tile([*ORIGIN, *direction], (RECORDS, 1))))["tip_angle"]
    np.testing.assert_allclose(angle, np.arcsin(sine), atol=1e-12)


def test_the_angle_of_a_planar_tip_turns_on_across_a_cut():
    wide = np.cumsum(np.random.default_rng(2).uniform(-1.0, 2.5, 300))
    wrapped = np.arctan2(np.sin(wide), np.cos(wide))
    whole = unwrap_from(wrapped, None)
    np.testing.assert_allclose(whole, wide - wide[0] + wrapped[0], rtol=1e-12)
    assert whole[-1] > 20 * np.pi
    for cut in (1, 7, 150, 299):
        first = unwrap_from(wrapped[:cut], None)
        rest = unwrap_from(wrapped[cut:], first[-1])
        np.testing.assert_array_equal(np.concatenate([first, rest]), whole)
        # what is without jumps stays as it is
        np.testing.assert_array_equal(unwrap_from(whole[cut:], whole[cut - 1]), whole[cut:])


def test_joined_stretches_leave_the_angle_above_the_level_as_it_is():
    flips = [[-1.57, 1.575], [-1.575]]  # past straight down, and past up
    parts = []
    for angles in flips:
        direction = ("time", "axis"), np.ones((len(angles), 3))
        values = {"tip_angle": ("time", angles), "tip_direction": direction}
        parts.append(xr.Dataset(values, coords={"time": np.arange(float(len(angles)))}))
    np.testing.assert_array_equal(join(parts)["tip_angle"], np.concatenate(flips))
