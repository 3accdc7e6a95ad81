"""The dimensionless numbers of a run, and the notes that follow from them, on made-up motions."""

import re

import numpy as np
import pytest
import xarray as xr
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import crinoid
import crinoid.results.chunks
from crinoid.assembly.prepared import Prepared
from crinoid.diagnostics import run_notes
from crinoid.diagnostics.run_notes import tear_failure
from crinoid.dynamics import Modes
from crinoid.results.dimensionless import (
    VelocityMoments,
    dimensionless,
    normal_velocity,
    with_velocity_moments,
)
from helpers.made_results import of_values

DIAMETER, LENGTH, NODES = 0.04, 0.5, 11
FREQUENCY = np.array([0.5, 3.0, 3.2])
WATER = crinoid.Scenario()


def notes(run, scenario):
    return run_notes.notes(run, Prepared(scenario).facts)


def held_still(
    across,
    *,
    along=0.0,
    duration=20.0,
    length=LENGTH,
    diameter=DIAMETER,
    force=1e-3,
    scenario=WATER,
) -> xr.Dataset:
    """Make the run of an arm along x that does not move in water that does, in three modes.

    The third one is a vibration along the arm.
    """
    across = np.asarray(across, float)
    time = np.linspace(0.0, duration, across.shape[0])
    still = np.zeros((time.size, NODES, 2))
    position, flow = still.copy(), still.copy()
    position[..., 0] = np.linspace(0.0, length, NODES)
    flow[..., 0], flow[..., 1] = along, across.reshape(time.size, -1)
    shape = np.zeros((3, NODES, 2))
    shape[:2, :, 1] = np.linspace(0.0, 1.0, NODES) ** 2
    shape[2, :, 0] = np.linspace(0.0, 1.0, NODES)
    dataset = bare(time, position, still, flow, force, diameter)
    return numbered(dataset, scenario, Modes(FREQUENCY, shape))


def numbered(dataset: xr.Dataset, scenario: crinoid.Scenario, modes: Modes | None) -> xr.Dataset:
    flow = (dataset["flow_velocity"] - dataset["velocity"]).values
    along = dataset["tangent"].values, dataset["diameter"].values
    found = dimensionless(flow, *along, scenario, modes)
    return with_velocity_moments(dataset.assign_coords(found.coordinates).assign(found.variables))


def bare(time, position, velocity, flow, force=1e-3, diameter=DIAMETER) -> xr.Dataset:
    """Make what of a run the numbers follow from."""
    edges = np.diff(position, axis=1)
    return of_values(
        position.shape[2],
        time,
        np.linspace(0.0, LENGTH, NODES),
        np.full(NODES, diameter),
        position=position,
        velocity=velocity,
        tangent=edges / np.linalg.norm(edges, axis=2, keepdims=True),
        flow_velocity=flow,
        base_force=np.full((time.size, position.shape[2]), force),
        tip_position=position[:, -1],
        step_error=np.zeros(time.size),
    )


def speed_at(reduced_velocity: float, mode: int = 0) -> float:
    return reduced_velocity * FREQUENCY[mode] * DIAMETER


ASLANT = Rotation.from_rotvec([0.3, -0.8, 0.5])


def in_space(flow: ArrayLike, duration: float = 20.0, modes: Modes | None = None) -> xr.Dataset:
    """Make the run of a still arm aslant; the water is given along the arm and across it."""
    flow = np.asarray(flow, float)
    time = np.linspace(0.0, duration, flow.shape[0])
    straight = np.linspace(0.0, LENGTH, NODES)[:, None] * ASLANT.apply([1.0, 0.0, 0.0])
    position = np.tile(straight, (time.size, 1, 1))
    water = np.tile(ASLANT.apply(flow)[:, None], (1, NODES, 1))
    return numbered(bare(time, position, 0 * position, water), WATER, modes or whipping(FREQUENCY))


def whipping(frequency: np.ndarray, spun: tuple[int, ...] = ()) -> Modes:
    """Return modes that bend the arm aslant one way and the other, or spin it about itself."""
    shape = np.zeros((frequency.size, NODES, 4))
    swing = np.linspace(0.0, 1.0, NODES) ** 2
    for mode in range(frequency.size):
        way = ASLANT.apply([0.0, 1.0 - mode % 2, float(mode % 2)])
        shape[mode, :, :3] = swing[:, None] * way * (1e-9 if mode in spun else 1.0)
        shape[mode, :, 3] = swing if mode in spun else 0.0
    return Modes(frequency, shape)


# --- the numbers -------------------------------------------------------------------------------


def test_numbers_of_a_steady_oblique_current_are_those_on_paper():
    for run in held_still(np.full(5, 0.3), along=0.4), in_space([[0.4, 0.18, -0.24]] * 3):
        np.testing.assert_allclose(run["reynolds_number"], 0.5 * DIAMETER / 1.2e-6)
        np.testing.assert_allclose(run["reduced_velocity"], 0.3 / (0.5 * DIAMETER))
        np.testing.assert_allclose(run["keulegan_carpenter"], 0.0, atol=1e-12)  # nothing swings
        np.testing.assert_array_equal(run["natural_frequency"].sel(mode=[1, 2]), [0.5, 3.0])


def test_velocity_across_the_arm_is_positive_along_its_normal():
    run = held_still(np.full(2, 0.3), along=0.4)
    np.testing.assert_allclose(normal_velocity(run), 0.3)  # the normal of x is z
    # two edges at a right angle: their joint points between them
    bent = run.isel(node=slice(3), edge=slice(2)).copy(deep=True)
    bent["tangent"][:, 1] = [0.0, 1.0]
    half = np.sqrt(0.5)
    np.testing.assert_allclose(normal_velocity(bent)[..., 0], [[0.3, half * (0.3 - 0.4), -0.4]] * 2)


def test_keulegan_carpenter_number_of_a_sine_is_u_t_over_d():
    time = np.arange(0.0, 40.001, 0.02)  # whole periods
    swing = 0.1 + np.outer(np.sin(2 * np.pi * 0.25 * time), [0.2, 0.1])
    number = VelocityMoments.of(swing[..., None], time).keulegan_carpenter(np.array([0.04, 0.02]))
    np.testing.assert_allclose(number, 0.2 * 4.0 / 0.04, rtol=1e-4)
    # and of two sines what their spectral moments say
    low, high = 2 * np.pi * 0.25, 2 * np.pi * 0.75
    both = np.sin(low * time) + 0.5 * np.sin(high * time)
    m0, m2 = (1 + 0.25) / 2, (low**2 + 0.25 * high**2) / 2
    expected = np.sqrt(2 * m0) * 2 * np.pi * np.sqrt(m0 / m2) / 0.04
    found = VelocityMoments.of(both[:, None, None], time).keulegan_carpenter(np.array([0.04]))
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_keulegan_carpenter_number_weighs_samples_by_the_time_they_stand_for():
    even = np.linspace(0.0, 8.0, 1601)
    uneven = even[(even < 4.0) | (np.arange(even.size) % 2 == 0)]
    finely, coarsely = (
        VelocityMoments.of(np.sin(3 * t)[:, None, None], t).keulegan_carpenter(np.ones(1))[0]
        for t in (even, uneven)
    )
    assert coarsely == pytest.approx(finely, rel=1e-4)


@pytest.mark.parametrize("instants", [1, 2])
def test_few_instants_of_steady_water_have_finite_numbers(instants):
    run = held_still(np.full(instants, 0.3), duration=0.02 * (instants - 1))
    for name in ("reynolds_number", "reduced_velocity", "keulegan_carpenter"):
        assert np.isfinite(run[name].values).all(), name
    assert notes(run, WATER) == []


def test_numbers_without_meaning_are_left_out():
    flows = {"reynolds_number", "reduced_velocity", "keulegan_carpenter"}
    vacuum = WATER.with_values({"water.density": 0.0})
    for change in ({"scenario": vacuum}, {"diameter": 0.0}):
        run = held_still(np.zeros(5), **change)
        assert not flows & set(run)
        assert "natural_frequency" in run
        assert notes(run, vacuum) == []
    plain = held_still(np.ones(5)).drop_vars([*flows, "natural_frequency", "mode_shape"])
    assert "reduced_velocity" not in numbered(plain, WATER, None)
    loose = Modes(np.zeros(1), np.zeros((1, NODES, 2)))
    assert flows - set(numbered(plain, WATER, loose)) == {"reduced_velocity"}


# --- in space ----------------------------------------------------------------------------------


def test_normals_of_a_spatial_arm_are_all_ways_across_it():
    run = in_space([[0.4, 0.18, -0.24]] * 3)
    across = ASLANT.apply([0.0, 0.18, -0.24])
    np.testing.assert_allclose(normal_velocity(run), np.broadcast_to(across, (3, NODES, 3)))


def test_a_spatial_run_in_the_plane_has_the_numbers_of_the_planar_one():
    rng = np.random.default_rng(1)
    along, up = rng.normal(size=(2, 60, NODES))
    bend = np.cumsum(rng.uniform(-0.3, 0.3, NODES - 1))
    edges = LENGTH / (NODES - 1) * np.stack([np.cos(bend), np.sin(bend)], axis=1)
    shape = np.concatenate([np.zeros((1, 2)), np.cumsum(edges, axis=0)])
    time = np.linspace(0.0, 3.0, 60)
    position, flow = np.tile(shape, (60, 1, 1)), np.stack([along, up], axis=2)
    motion = (position, 0 * position, flow)
    planar = numbered(bare(time, *motion), WATER, lifted(0.0, 1.0))
    wide = (np.insert(rows, 1, 0.0, axis=2) for rows in motion)
    spatial = numbered(bare(time, *wide), WATER, lifted(0.0, 0.0, 1.0, 0.0))
    for name in ("reynolds_number", "reduced_velocity", "keulegan_carpenter"):
        np.testing.assert_allclose(spatial[name], planar[name], rtol=1e-12)


def lifted(*way: float) -> Modes:
    return Modes(FREQUENCY[:1], np.tile(way, (1, NODES, 1)))


def test_swings_in_space_count_along_the_way_that_they_are_largest():
    time = np.arange(0.0, 40.001, 0.02)  # whole periods
    phase = 2 * np.pi * 0.25 * time
    # an ellipse across the arm, its long axis aslant, on top of a steady current
    long, short = 0.2 * np.sin(phase), 0.05 * np.cos(phase)
    across = np.stack([0.6 * long - 0.8 * short, 0.8 * long + 0.6 * short], axis=1)
    flow = np.concatenate([0.3 + 0 * time[:, None], 0.1 + across], axis=1)
    run = in_space(flow, duration=40.0)
    np.testing.assert_allclose(run["keulegan_carpenter"], 0.2 * 4.0 / DIAMETER, rtol=1e-4)
    # whichever way round it is taken to be: of a swing to and fro all of it
    swing = np.outer(np.sin(phase), [0.0, -0.6, 0.8])[:, None]
    along = VelocityMoments.of(swing, time).principal()
    np.testing.assert_allclose(np.abs(along), [[0.0, 0.6, 0.8]], atol=1e-12)


def test_lock_in_in_space_is_that_of_modes_that_bend_the_arm_whichever_way():
    speed = speed_at(6.0)
    (note,) = notes(in_space([[0.0, 0.6 * speed, 0.8 * speed]] * 101), WATER)
    assert "mode 1 (0.5 Hz) for 100% of the time on 100% of the length" in note
    assert "its lift, across both arm and current, is not modelled" in note
    # a pair of modes, and in between one that spins the arm about itself: vortices do not
    modes = whipping(np.array([0.45, 0.5, 0.5]), spun=(0,))
    run = in_space([[0.0, 0.6 * speed, 0.8 * speed]] * 101, modes=modes)
    np.testing.assert_allclose(run["reduced_velocity"], 6.0)  # of the first that bends
    (note,) = notes(run, WATER)
    assert "mode 2 (0.5 Hz)" in note
    assert "mode 3 (0.5 Hz)" in note
    assert "mode 1" not in note
    only = whipping(np.array([0.5]), spun=(0,))
    assert "reduced_velocity" not in in_space([[0.0, speed, 0.0]] * 5, modes=only)


# --- the notes ---------------------------------------------------------------------------------


def test_a_note_names_the_part_of_the_arm_and_of_the_time():
    # the outer half of the arm for the first quarter of the time, in the second mode
    across = np.zeros((401, NODES))
    across[:101, 6:] = speed_at(5.0, mode=1)
    (note,) = notes(held_still(across), WATER)
    assert "vortex shedding may lock in to mode 2 (3 Hz) for 25% of the time" in note
    assert "on 45% of the length" in note
    assert "mode 1" not in note
    # the third mode is in its range too, but runs along the arm, where there is no lift
    assert across.max() == pytest.approx(speed_at(4.6875, mode=2))
    assert "mode 3" not in note


STILL, SLOW, FAST = np.zeros(5), np.full(5, 2e-3), np.full(5, 10.0)  # SLOW: Re = 67
LOCKED = np.full(101, speed_at(6.0))
SWINGING = speed_at(10.0) * np.sin(2 * np.pi * 0.5 * np.linspace(0.0, 20.0, 1001))
AROUND = speed_at(8.0) + 0.6 * SWINGING
"""A speed about a mean in the range of lock-in, with short gaps."""
LITERATURE = {"water.coefficients": "literature"}


def syrup(reynolds_number):
    viscosity = speed_at(6.0) * DIAMETER / reynolds_number
    return {"water.kinematic_viscosity": viscosity, "water.drag_normal": 1.5}


def stiff(EA):
    return {"arm.section": {"EI": 0.05, "EA": EA}}


@pytest.mark.parametrize(
    ("across", "changes", "options", "said"),
    [
        *((np.full(101, speed_at(each)), {}, {}, "") for each in (0.0, 3.9, 18.6)),
        # faster through the range than lock-in builds up
        (SWINGING, {}, {}, ""),
        (AROUND, {}, {}, r"mode 1 \(0.5 Hz\)"),
        (AROUND[:51], {}, {"duration": 1.0}, ""),
        (speed_at(5.0) + 0.8 * SWINGING, {}, {}, ""),  # which reverses
        # nothing is shed below a Reynolds number of 50
        (LOCKED, syrup(45), {}, ""),
        (LOCKED, syrup(55), {}, "lock in"),
        # the default drag where drag is felt, and not where the base carries much else
        (SLOW, {}, {"force": 1e-5}, "numbers near 67; the default water.drag_normal = 1.1"),
        (SLOW, {}, {"force": 1.0}, ""),
        (STILL, {}, {"force": 0.0}, ""),
        (FAST, {}, {"force": 1.0}, r"near 3.3e\+05"),
        # a coefficient of the user's, where a cylinder has 1.55
        (SLOW, {"water.drag_normal": 1.8}, {"force": 1e-5}, ""),
        (SLOW, {"water.drag_normal": 2.5}, {"force": 1e-5}, "1.6 and water.drag_normal is 2.5"),
        (SLOW, {"water.drag_normal": 1.1}, {"force": 1e-5}, "water.drag_normal"),
        (SLOW, {"water.drag_normal": 0.9}, {"force": 1e-5}, "1.6 and water.drag_normal is 0.9"),
        (SLOW, LITERATURE, {"force": 1e-5}, ""),
        (FAST, LITERATURE, {"force": 1.0}, "for up to 2e5"),
        # strain
        (STILL, {}, {"length": 2.4 * LENGTH}, "stretched by 140%.* linear elasticity"),
        (STILL, {}, {"length": 0.4 * LENGTH}, "compressed by 60%.* linear elasticity"),
        (STILL, {}, {"length": 1.4 * LENGTH}, ""),
        # a force of 2 eps EA L / l is round-off: of an arm of 1e12 N some mN
        (STILL, stiff(1e12), {"force": 6e-3}, r"EA = 1e\+12 N"),
        (STILL, stiff(1e12), {"force": 10.0}, ""),  # of which that is less than a hundredth
        (STILL, stiff(1e7), {"force": 1e-4}, ""),
        (STILL, stiff(1e9), {"force": 1e-4}, "round-off"),
        (STILL, stiff(1e3), {"force": 1e-13}, ""),  # of an arm without loads, and nobody minds
    ],
)
def test_what_deserves_a_note_gets_one_and_nothing_else_does(across, changes, options, said):
    scenario = WATER.with_values(changes)
    found = notes(held_still(across, scenario=scenario, **options), scenario)
    assert len(found) == bool(said)
    assert not found or re.search(said, found[0])


UNREAD = [[0.0, 0.0]] * 3 + [[0.0, np.nan]] * 2


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"curvature": (("time", "node"), np.full((5, NODES), 1.2 / DIAMETER))}, "surface is 60%"),
        ({"curvature": (("time", "node"), np.full((5, NODES), 0.8 / DIAMETER))}, ""),
        ({"self_gap": ("time", np.full(5, -4e-4))}, "penetrated itself by 0.4 mm"),
        ({"self_pairs": ("time", np.full(5, 21))}, "21 pairs .* nearest 20"),
        ({"self_pairs": ("time", np.full(5, 20))}, ""),
        (
            {"sensor_reading": (("time", "reading"), UNREAD)},
            "range.rate is not finite at t = 3.5 s",
        ),
    ],
)
def test_what_a_run_found_gets_a_note(values, said):
    run = held_still(STILL, duration=14 / 3).assign_attrs(scenario=WATER.to_toml())
    nothing = {"self_gap": ("time", np.zeros(5)), "self_pairs": ("time", np.zeros(5))}
    run = run.assign(nothing | values).assign_coords(reading=["range.range", "range.rate"])
    found = notes(run, WATER)
    assert len(found) == bool(said)
    assert not found or re.search(said, found[0])


def test_an_equilibrium_that_does_not_hold_the_arm_gets_a_note():
    from_rest = WATER.with_values({"simulation.start": "rest"})
    run = in_space([[0.0, 0.0, 0.0]] * 5, modes=whipping(np.array([0.0, 0.0, 3.2])))
    (note,) = notes(run, WATER)
    assert "the equilibrium at the start is unstable in its 2 slowest modes." in note
    assert notes(run, from_rest) == []  # which is no equilibrium


def test_a_strain_that_no_rubber_bears_is_a_failure():
    for length, share in ((12.0, "12"), (0.05, "20")):
        failure = tear_failure(held_still(np.zeros(5), length=length * LENGTH))
        assert failure.startswith(f"failed at t = 0 s: an edge of the arm is {share} ")
    for length in (9.0, 0.2):
        assert tear_failure(held_still(np.zeros(5), length=length * LENGTH)) == ""


@pytest.mark.parametrize(
    ("changes", "noted"),
    [
        ({}, True),
        ({"simulation": {"time_step": 0.005, "duration": 20.0}}, False),
        ({"obstacle": [{"kind": "sphere", "position": [0, -12], "radius": 0.1}]}, False),
        ({"base": {"channels": {"tilt": {}}}, "control": {"kind": "lqg"}}, False),
    ],
)
def test_errors_of_steps_that_add_up_get_a_note(changes, noted):
    # Newmark's error of a step falls with the cube of it: a released arm that nothing damps
    arm = {"damping_time": 0.0}
    simulation = {"time_step": 0.01, "duration": 20.0}
    scenario = crinoid.Scenario(**({"arm": arm, "simulation": simulation} | changes))
    data = held_still(np.zeros(201))
    swings = 0.02 * np.sin(data["time"].values)[:, None]
    error = 2e-6 * (scenario.simulation.time_step / 0.01) ** 3
    data = data.assign(
        tip_position=data["tip_position"] + xr.DataArray(swings * [0, 1], dims=("time", "axis")),
        step_error=("time", np.full(201, error)),
    )
    said = [note for note in notes(data, scenario) if "errors of the time steps" in note]
    assert bool(said) is noted
    assert not noted or said[0].endswith("Compare with simulation.time_step = 0.005.")


# --- in pieces ---------------------------------------------------------------------------------


def test_a_run_in_pieces_has_the_numbers_and_notes_of_the_whole(monkeypatch):
    time = np.linspace(0.0, 20.0, 301)
    swing = speed_at(6.0) * (1 + 0.2 * np.sin(3 * time)) * (1 + 1e-3 * time)
    thick = WATER.with_values({"water.kinematic_viscosity": 1e-5})
    whole = held_still(swing, scenario=thick)
    told = notes(whole, thick)
    assert len(told) == 2  # lock-in and drag
    monkeypatch.setattr(crinoid.results.chunks, "_NUMBERS", 40 * NODES)
    parts = held_still(swing, scenario=thick)
    assert notes(parts, thick) == told
    ours, theirs = (run["keulegan_carpenter"] for run in (parts, whole))
    np.testing.assert_allclose(ours, theirs, rtol=1e-12)
