"""The variables of a result, from what a run keeps: in the plane and in space."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from rich.console import Console

import crinoid
from crinoid.base import Servo
from crinoid.cli.tables import equilibrium_table
from crinoid.dataset import Instants, build_dataset
from crinoid.dynamics import Touch
from crinoid.elements import ENERGIES, WORKS
from crinoid.metrics import tip_error
from crinoid.pieces import join, turned_on
from crinoid.record import Record
from crinoid.report.run import Run
from crinoid.report.sheet import draw_sheet
from crinoid.result import Result

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


def kept(touch=None, **changes):
    """Keep some instants of an arm that points up and to port, whose frame turns about it."""
    rng = np.random.default_rng(1)
    ahead = np.array([0.6, 0.48, 0.64])
    arc = 0.1 * np.arange(NODES)
    position = np.tile(arc[:, None] * ahead, (RECORDS, 1, 1))
    tip = np.tile(np.concatenate([ORIGIN + 0.4 * ahead, ahead]), (RECORDS, 1))
    wanted = tip + np.array([0.03, 0.04, 0.12, 0.0, 0.0, 0.0])

    def some(*shape):
        return rng.normal(size=(RECORDS, *shape))

    fields = {
        "time": 0.5 * np.arange(RECORDS),
        "position": position,
        "velocity": 0 * position,
        "acceleration": some(NODES, 3),
        "flow_velocity": some(NODES, 3),
        "tip": tip,
        "wanted": wanted,
        "command": some(6),
        "servo": some(6),
        "pose": some(6),
        "base_force": some(3),
        "base_moment": some(3),
        "energy": some(len(ENERGIES) + len(WORKS)),
        "steps": np.arange(RECORDS),
        "iterations": np.arange(RECORDS),
        "residual": some(),
        "error": some(),
        "obstacle_position": None,
        "obstacle_velocity": None,
        "gap": None,
        "touch": touch,
        "drive_command": None,
        "drive": None,
        "reading": some(6),
        "director": some(NODES - 1, 3),
        "curvature": some(NODES, 2),
        "twist": some(NODES),
    } | changes
    return Record(
        **{
            name: jnp.asarray(value) if isinstance(value, np.ndarray) else value
            for name, value in fields.items()
        }
    )


def test_every_variable_in_space_has_its_dimensions_and_units(system):
    record = kept()
    dataset = build_dataset(Instants(system, record), SCENARIO.arm.diameters)
    expected = {
        "position": ("time", "node", "axis"),
        "tangent": ("time", "edge", "axis"),
        "director": ("time", "edge", "axis"),
        "curvature": ("time", "node", "bending"),
        "twist": ("time", "edge"),
        "tension": ("time", "edge"),
        "tip_position": ("time", "axis"),
        "tip_target": ("time", "axis"),
        "tip_direction": ("time", "axis"),
        "tip_direction_target": ("time", "axis"),
        "tip_angle": ("time",),
        "tip_error": ("time",),
        "base_command": ("time", "channel"),
        "base_servo": ("time", "channel"),
        "base_pose": ("time", "channel"),
        "base_force": ("time", "axis"),
        "base_moment": ("time", "axis"),
    }
    for name, dims in expected.items():
        assert dataset[name].dims == dims, name
    # channels are shifts and turns: no one unit that CF knows
    without_unit = {name for name, v in dataset.data_vars.items() if not v.attrs.get("units")}
    limits = {"channel_lower", "channel_upper", "channel_max_speed", "channel_max_acceleration"}
    assert without_unit == {"base_command", "base_servo", "base_pose", *limits}
    assert all(dataset[name].dims == ("channel",) for name in limits)
    assert float(dataset["channel_upper"].sel(channel="slide")) == 1
    assert all(float(dataset[name].sel(channel="sway")) == 0 for name in limits)
    assert "tip_angle_target" not in dataset
    assert dataset["twist"].attrs["units"] == "rad m-1"
    labels = {name: list(dataset[name].values) for name in ("axis", "channel", "bending")}
    assert labels == {
        "axis": ["x", "y", "z"],
        "channel": ["slide", "sway", "heave", "pan", "tilt", "roll"],
        "bending": ["kappa_1", "kappa_2"],
    }
    units = dict(zip(labels["channel"], dataset["channel_unit"].values, strict=True))
    assert [name for name, unit in units.items() if unit == "rad"] == ["pan", "tilt", "roll"]
    comment = "slide, sway and heave in m, pan, tilt and roll in rad: see channel_unit"
    assert dataset["base_pose"].attrs["comment"] == comment


def test_values_in_space_are_those_kept(system):
    record = kept()
    dataset = build_dataset(Instants(system, record), SCENARIO.arm.diameters)
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
    ("direction", "angle"),
    [
        ([0.0, 0.0, 1.0], np.pi / 2),
        ([0.0, 0.0, -1.0], -np.pi / 2),
        ([-1.0, 0.0, 0.0], 0.0),
        ([0.0, -0.8, -0.6], -np.arcsin(0.6)),
    ],
)
def test_the_angle_of_the_tip_is_that_above_the_level_plane(system, direction, angle):
    tip = np.tile(np.concatenate([ORIGIN, direction]), (RECORDS, 1))
    dataset = build_dataset(Instants(system, kept(tip=tip)), SCENARIO.arm.diameters)
    np.testing.assert_allclose(dataset["tip_angle"], angle, atol=1e-12)


def test_obstacles_in_space_have_three_axes(system):
    arrays = {
        "force": np.ones((RECORDS, 2, 3)),
        "in_contact": np.zeros((RECORDS, 2), dtype=bool),
        "impulse": np.ones((RECORDS, 2, 3)),
        "duration": np.zeros((RECORDS, 2)),
        "closest": np.full((RECORDS, 2), 0.1),
    }
    one = Touch(**{name: jnp.asarray(value[0]) for name, value in arrays.items()})
    touch = eqx.tree_at(
        lambda t: [getattr(t, name) for name in arrays], one, [*map(jnp.asarray, arrays.values())]
    )
    place = np.zeros((RECORDS, 2, 3))
    gap = np.full((RECORDS, 2, NODES - 1), 0.1)
    record = kept(touch, gap=gap, obstacle_position=place, obstacle_velocity=place)
    dataset = build_dataset(Instants(system, record), SCENARIO.arm.diameters)
    assert dataset["contact_force"].dims == ("time", "obstacle", "axis")
    np.testing.assert_allclose(dataset["obstacle_position"].values[0], np.tile(ORIGIN, (2, 1)))


def angles(values, **more):
    time = ("time", np.arange(len(values), dtype=float))
    return xr.Dataset({"tip_angle": ("time", values), **more}, coords={"time": time})


def test_the_angle_of_a_planar_tip_turns_on_wherever_a_run_is_cut():
    wide = np.cumsum(np.random.default_rng(2).uniform(-1.0, 2.5, 300))
    wrapped = np.arctan2(np.sin(wide), np.cos(wide))
    whole = turned_on(wrapped, None)
    np.testing.assert_allclose(whole, wide - wide[0] + wrapped[0], rtol=1e-12)
    assert whole[-1] > 20 * np.pi
    for cut in (1, 7, 150, 299):
        first = turned_on(wrapped[:cut], None)
        rest = turned_on(wrapped[cut:], first[-1])
        np.testing.assert_array_equal(np.concatenate([first, rest]), whole)
        # what is without jumps stays as it is
        np.testing.assert_array_equal(turned_on(whole[cut:], whole[cut - 1]), whole[cut:])


def test_joined_stretches_leave_the_angle_above_the_level_as_it_is():
    flips = [np.array([-1.57, 1.575]), np.array([-1.575])]  # past straight down, and past up
    parts = [angles(v, tip_direction=(("time", "axis"), np.ones((len(v), 3)))) for v in flips]
    np.testing.assert_array_equal(join(parts)["tip_angle"], np.concatenate(flips))


def test_measures_tables_and_figures_read_a_run_in_space(system):
    dataset = build_dataset(Instants(system, kept()), SCENARIO.arm.diameters).assign_attrs(
        title="in space", scenario="", status="ok"
    )
    result = Result(dataset)
    errors = tip_error(result)
    assert errors.rms == pytest.approx(0.13)
    assert errors.fluctuation == pytest.approx(0.0, abs=1e-12)
    console = Console(width=120)
    with console.capture() as said:
        console.print(equilibrium_table(result))
    text = said.get()
    assert "x 1.24 m, y -1.808 m, z -9.744 m" in text
    assert "x 0.6, y 0.48, z 0.64" in text
    assert "greatest twist" in text
    assert len(draw_sheet(Run(dataset)).axes) == 5
