"""Measures of known signals: errors, loads, curvature, cycles, extremes."""

import numpy as np
import pytest
from scipy import stats

import crinoid
from crinoid.foundation.result_variables import quantity
from crinoid.results.effort import CostWeights
from crinoid.results.errors import tip_error
from crinoid.results.extremes import Gumbel
from crinoid.results.fatigue import YEAR, combined_life
from crinoid.results.loads import bending_cycles
from crinoid.results.measure_labels import plain_unit
from crinoid.results.metrics import MEASURES
from crinoid.results.result import Result
from crinoid.results.smooth import SMOOTH, SeenMotion
from crinoid.results.table import summary
from helpers.made_results import of_values

LENGTH = 0.5
STATIONS = np.linspace(0.0, LENGTH, 6)


def made(dimension=2, time=None, error=0.0, force=0.0, curvature=None, stretch=1.0, **keys):
    """Make a straight arm along x of known tip error, base force and curvature."""
    time = np.linspace(0.0, 20.0, 4001) if time is None else time
    scenario = crinoid.Scenario().with_values(
        {"arm.dimension": dimension, "arm.nodes": 6, "simulation.duration": 20.0, **keys}
    )
    zero = np.zeros_like(time)

    def vector(along):
        found = np.zeros((time.size, dimension))
        found[:, 0] = zero + along
        return found

    position = np.zeros((time.size, 6, dimension))
    position[..., 0] = stretch * STATIONS
    bent = np.zeros((time.size, 6, *(() if dimension == 2 else (2,))))
    if curvature is not None:
        bent[:] = curvature
    data = of_values(
        dimension,
        time,
        STATIONS,
        np.full(6, 0.04),
        position=position,
        curvature=bent,
        tip_error=np.abs(zero + error),
        tip_position=vector(error),
        base_force=vector(force),
        base_moment=zero if dimension == 2 else vector(0.0),
    )
    attrs = {"title": "made", "scenario": scenario.to_toml(), "wall_time": 1.0, "status": "ok"}
    return Result(data.assign_attrs(attrs))


def measure(name, run):
    return MEASURES[name].of(run)


TIME = np.linspace(0.0, 20.0, 4001)
VEHICLE = {
    "vehicle": {"mass": 9.0, "inertia": 0.5, "hold": "thrusters", "max_force": 3.0},
}
SINE = np.sin(2 * np.pi * TIME)
BOTH = pytest.mark.parametrize("dimension", [2, 3])


@BOTH
def test_percentiles_and_shares_of_a_sine(dimension):
    run = made(dimension, error=0.1 * SINE, force=3 * SINE, **{"target.tolerance": 0.05})
    # the magnitude of a sine is below sin(a) for the share a / 90 degrees of the time
    assert measure("p95_error", run) == pytest.approx(0.1 * np.sin(0.95 * np.pi / 2), rel=2e-3)
    assert measure("within_tolerance", run) == pytest.approx(1 / 3, abs=5e-3)
    assert measure("max_base_force", run) == pytest.approx(3.0, rel=1e-4)
    assert measure("rms_base_force", run) == pytest.approx(3 / np.sqrt(2), rel=1e-3)
    assert measure("p95_base_force", run) == pytest.approx(3 * np.sin(0.95 * np.pi / 2), rel=2e-3)
    assert measure("max_base_moment", run) == 0.0


def test_without_a_tolerance_there_is_no_share_within_it():
    assert measure("within_tolerance", made()) is None


FLOW = {"kind": "uniform", "velocity": [0.1, 0.0], "start": 1.0, "ramp_time": 3.0}
LOAD = {"kind": "tip", "force": [0.1, 0.0], "start": 5.0}
MOVED = {"kind": "velocity", "channel": "slide", "velocity": 0.1, "start": 5.0}


@pytest.mark.parametrize(
    ("keys", "begin"),
    [
        ({}, 0.0),
        ({"load": [LOAD]}, 0.0),
        ({"flow": [FLOW], "load": [LOAD]}, 4.0),
        ({"flow": [FLOW], "load": [LOAD | {"ramp_time": 2.0}]}, 7.0),
        ({"flow": [FLOW], "base.motion": [MOVED]}, 6.0),
        ({"flow": [FLOW | {"ramp_time": 30.0}]}, 0.0),
        ({"flow": [FLOW], "target.judged_from": 0.0}, 0.0),
        ({"flow": [FLOW], "target.judged_from": 9.5}, 9.5),
    ],
)
def test_errors_count_from_the_end_of_the_last_ramp_or_a_given_time(keys, begin):
    scenario = crinoid.Scenario().with_values({"simulation.duration": 20.0, **keys})
    assert scenario.judged_from == begin
    assert crinoid.Scenario.from_toml(scenario.to_toml()).judged_from == begin


def test_a_time_to_judge_from_lies_within_the_run():
    values = {"simulation.duration": 20.0, "target.judged_from": 20.0}
    with pytest.raises(crinoid.ScenarioError, match=r"judged_from: got 20.*below.*duration"):
        crinoid.Scenario().with_values(values)


def test_errors_before_that_time_do_not_count_and_loads_do():
    early = np.where(TIME < 5.0, 10.0, 1.0)
    run = made(error=early * 0.01, force=early, **{"target.judged_from": 5.0})
    assert measure("max_error", run) == measure("p95_error", run) == pytest.approx(0.01)
    assert measure("rms_error", run) == pytest.approx(0.01)
    assert measure("fluctuation", run) == pytest.approx(0.0, abs=1e-12)
    assert measure("max_base_force", run) == 10.0


def test_a_run_that_ended_before_that_time_has_no_errors():
    short = TIME[TIME < 4.0]
    run = made(time=short, error=0.01, force=1.0, **{"target.judged_from": 5.0})
    assert np.isnan(tip_error(run)).all()
    assert measure("rms_error", run) is None
    assert measure("within_tolerance", run) is None
    assert measure("max_base_force", run) == 1.0


def bent_by(dimension, node, values):
    """Return curvature over time at one node; in space of its second component."""
    found = np.zeros((len(values), 6, *(() if dimension == 2 else (2,))))
    found[(slice(None), node, *(() if dimension == 2 else (1,)))] = values
    return found


@BOTH
def test_the_largest_curvature_and_strain_have_their_place(dimension):
    run = made(dimension, curvature=bent_by(dimension, 3, -2.0 * SINE), stretch=1.05)
    assert measure("max_curvature", run) == pytest.approx(2.0, rel=1e-4)
    assert measure("max_curvature_station", run) == pytest.approx(STATIONS[3])
    # half the diameter times the curvature, and the stretch
    assert measure("max_strain", run) == pytest.approx(0.02 * 2.0 + 0.05, rel=1e-4)
    assert measure("max_strain_station", run) == pytest.approx(STATIONS[3])


@pytest.mark.parametrize(
    ("dimension", "rest", "shape"),
    [(2, 3.0, 3.0), (3, 3.0, [0.0, 3.0]), (3, [1.0, 2.0, 5.0], [1.0, 2.0])],
)
def test_strain_counts_from_the_shape_without_load(dimension, rest, shape):
    curvature = np.zeros((TIME.size, 6, *(() if dimension == 2 else (2,)))) + shape
    run = made(dimension, curvature=curvature, **{"arm.rest_curvature": rest})
    assert measure("max_curvature", run) == pytest.approx(np.linalg.norm(shape))
    assert measure("max_strain", run) == pytest.approx(0.0, abs=1e-12)


ASTM = [-2, 1, -3, 5, -1, 3, -4, 4, -2]
"""The history of figure 6 of ASTM E1049-85."""


@BOTH
def test_cycles_are_those_of_the_example_of_astm_e1049(dimension):
    time = np.linspace(0.0, 20.0, len(ASTM))
    found = bending_cycles(made(dimension, time, curvature=bent_by(dimension, 2, ASTM)))
    counted = dict.fromkeys(found.ranges, 0.0)
    for size, count in zip(found.ranges, found.counts, strict=True):
        counted[size] += count
    assert counted == {9: 0.5, 8: 1.0, 6: 0.5, 4: 1.5, 3: 0.5}
    assert found.station == pytest.approx(STATIONS[2])
    assert found.number == 4.0
    damage = 0.5 * 9**4 + 8**4 + 0.5 * 6**4 + 1.5 * 4**4 + 0.5 * 3**4
    assert found.equivalent_range == pytest.approx((damage / 4.0) ** 0.25)


def test_a_bend_to_one_side_is_half_a_cycle_and_two_instants_are_none():
    ramp = bending_cycles(made(time=TIME, curvature=bent_by(2, 2, TIME)))
    assert (ramp.number, ramp.equivalent_range) == (0.5, pytest.approx(20.0))
    two = bending_cycles(made(time=TIME[[0, -1]], curvature=bent_by(2, 2, [0.0, 1.0])))
    assert (two.number, two.equivalent_range) == (0.0, 0.0)


def test_equal_cycles_are_their_own_equivalent_and_ripples_do_not_count():
    ripple = 1e-3 * np.sin(2 * np.pi * 45 * TIME)
    run = made(curvature=bent_by(2, 4, 2.0 * np.cos(np.pi * TIME) + ripple))
    assert measure("curvature_cycles", run) == pytest.approx(10.0, abs=0.5)
    assert measure("equivalent_curvature_range", run) == pytest.approx(4.0, rel=2e-3)
    assert measure("curvature_cycles", made(curvature=bent_by(2, 4, 1e-9 * SINE))) == 0.0


STEEL = {"arm.fatigue": {"slope": 3.0, "intercept": 1e12, "youngs_modulus": 2e5}}


@BOTH
def test_life_is_the_time_over_the_damage_of_equal_cycles(dimension):
    wave = 1.5 * np.cos(np.pi * TIME)  # of 2 s
    late = {"target.judged_from": 4.0}
    run = made(dimension, curvature=bent_by(dimension, 4, wave), **STEEL | late)
    stress = 2e5 * 0.02 * 3.0  # Pa, of the whole range
    assert measure("life", run) == pytest.approx(1e12 / stress**3 * 2.0 / YEAR, rel=1e-6)
    assert measure("life_station", run) == pytest.approx(STATIONS[4])
    assert measure("life", made(dimension, curvature=bent_by(dimension, 4, wave))) is None
    assert measure("life", made(dimension, **STEEL)) is None  # without end


def test_life_in_space_counts_where_two_bends_add_up_and_stretch_too():
    both = np.zeros((TIME.size, 6, 2))
    both[:, 2] = np.cos(np.pi * TIME)[:, None] * [0.6, 0.8]
    run = made(3, curvature=both, **STEEL)
    # the next of 16 points is 53.1 - 45 degrees away
    expected = 1e12 / (2e5 * 0.02 * 2.0 * np.cos(np.arctan2(0.8, 0.6) - np.pi / 4)) ** 3
    assert measure("life", run) == pytest.approx(expected * 2.0 / YEAR, rel=1e-6)
    pulled = made(**STEEL)
    swing = 1.0 + 1e-3 * np.cos(np.pi * TIME)
    pulled.dataset["position"].values[..., 0] *= swing[:, None]
    assert measure("life", pulled) == pytest.approx(1e12 / 400.0**3 * 2.0 / YEAR, rel=1e-6)


def test_lives_combine_by_miner_s_rule():
    lives = np.array([10.0, 40.0, np.inf, np.nan])
    # 0.2 / 10 + 0.4 / 40 in a year
    assert combined_life(lives, np.array([0.2, 0.4, 0.4, 0.0])) == pytest.approx(1 / 0.03)
    assert np.isnan(combined_life(lives, np.array([0.2, 0.4, 0.3, 0.1])))
    assert combined_life(lives, np.array([0.0, 0.0, 1.0, 0.0])) == np.inf


def test_loads_on_the_base_have_least_and_greatest_components_with_their_times():
    run = made(3, force=3 * SINE + 0.1 * TIME)
    assert measure("base_force_x_max", run) == pytest.approx(3 + 0.1 * 19.25, rel=1e-4)
    assert measure("base_force_x_max_time", run) == pytest.approx(19.25, abs=0.006)
    assert measure("base_force_x_min_time", run) == pytest.approx(0.75, abs=0.006)
    assert measure("base_moment_z_min", run) == 0.0
    planar = made(force=3 * SINE)
    planar.dataset["base_moment"].values[100] = 2.0  # from x toward z: about -y
    assert measure("base_moment_y_min", planar) == -2.0
    assert measure("base_moment_y_min_time", planar) == TIME[100]
    assert measure("base_force_y_max", planar) is None
    planar.dataset = planar.dataset.assign(steps=TIME, newton_iterations=TIME)
    planar.dataset.attrs["wall_time"] = 1.0
    rows = {name: cells for name, *cells in summary(planar, full=True).rows if "along" in name}
    assert [*rows] == [
        f"force on base along {axis}, {end}" for axis in "xz" for end in ("least", "greatest")
    ]
    rows = {name: cells for name, *cells in summary(planar, full=True).rows if "about" in name}
    assert rows["moment on base about y, least"] == ["-2 N m at 0.5 s"]


@BOTH
def test_the_largest_loads_of_sections_have_their_stations_and_times(dimension):
    run = made(dimension)
    shape = (TIME.size, 6) if dimension == 2 else (TIME.size, 6, 2)
    moment, shear = np.zeros(shape), np.zeros((TIME.size, 5, *shape[2:]))
    moment[70, 3], shear[90, 1] = -2.0, 3.0
    size = np.sqrt(dimension - 1.0)  # of two equal components
    for name, values in {"bending_moment": moment, "shear_force": shear}.items():
        run.dataset[name] = quantity(name, values, dimension)
    assert measure("max_bending_moment", run) == pytest.approx(2.0 * size)
    assert measure("max_bending_moment_station", run) == STATIONS[3]
    assert measure("max_bending_moment_time", run) == TIME[70]
    assert measure("max_shear_force", run) == pytest.approx(3.0 * size)
    assert measure("max_shear_force_station", run) == pytest.approx(0.15)  # middle of an edge
    assert measure("max_shear_force_time", run) == TIME[90]


def test_gumbel_s_parameters_are_recovered_from_many_runs():
    drawn = stats.gumbel_r.rvs(5.0, 2.0, size=4000, random_state=np.random.default_rng(1))
    fit = Gumbel(drawn)
    assert fit.location == pytest.approx(5.0, abs=0.12)
    assert fit.scale == pytest.approx(2.0, rel=0.04)
    level = fit.return_level(100)
    assert level.low < stats.gumbel_r.ppf(0.99, 5.0, 2.0) < level.high
    assert level.high - level.low < 0.1 * level.value


@pytest.mark.parametrize("count", [5, 20])
def test_intervals_of_return_levels_hold_as_often_as_they_say(count):
    truth, trials = stats.gumbel_r.ppf(0.98, 5.0, 2.0), 400
    generator = np.random.default_rng(2)
    drawn = stats.gumbel_r.rvs(5.0, 2.0, size=(trials, count), random_state=generator)
    levels = [Gumbel(sample).return_level(50, confidence=0.9) for sample in drawn]
    held = np.mean([level.low <= truth <= level.high for level in levels])
    assert held == pytest.approx(0.9, abs=3 * np.sqrt(0.9 * 0.1 / trials))


def test_a_return_level_over_conditions_solves_their_mixed_distribution():
    maxima, shares = [np.array([1.0, 1.2, 1.7, 1.4]), np.array([3.0, 2.1, 2.6])], [0.99, 0.01]

    def exceeded(level):
        """Add up by hand: L-moments by probability weights, Gumbel's distribution, shares."""
        found = 0.0
        for values, share in zip(map(np.sort, maxima), shares, strict=True):
            weight = np.arange(values.size) / (values.size - 1)
            scale = (2 * np.mean(weight * values) - values.mean()) / np.log(2)
            location = values.mean() - np.euler_gamma * scale
            found += share * (1 - np.exp(-np.exp(-(level - location) / scale)))
        return found

    fit = Gumbel(*maxima, shares=np.array(shares))
    for runs in (20.0, 1e3, 1e8):
        level = fit.return_level(runs)
        assert level.low < level.value < level.high
        assert exceeded(level.value) == pytest.approx(1 / runs, rel=1e-6)
    # equal conditions are one, and a condition without spread is a step
    alone, twice = Gumbel(maxima[0]), Gumbel(maxima[0], maxima[0], shares=np.array([0.3, 0.7]))
    np.testing.assert_allclose(twice.return_level(1e4), alone.return_level(1e4), rtol=1e-12)
    steady = Gumbel(maxima[0], np.full(3, 9.0), shares=np.array([0.9, 0.1]))
    assert steady.return_level(1e4).value == pytest.approx(9.0, rel=1e-6)
    assert steady.return_level(5.0).value < 2.0


@pytest.mark.parametrize("maxima", [[1.0, 2.0], [1.0, 2.0, np.nan], [1.0, 1.0, 1.0]])
def test_gumbel_needs_three_numbers_that_differ(maxima):
    with pytest.raises(ValueError, match="maxima: got"):
        Gumbel(np.array(maxima))


@BOTH
def test_a_vehicle_counts_from_the_start(dimension):
    run = made(dimension, **VEHICLE, **{"target.judged_from": 5.0})
    channels, axes = run.dataset["channel"].values, run.dataset["axis"].size
    early = np.where(TIME < 2.0, 1.0, 0.25)
    pose = np.zeros((TIME.size, channels.size))
    pose[:, channels == "slide"] = 0.1 * early[:, None]
    pose[:, channels == "tilt"] = -0.02 * early[:, None]
    force = np.zeros((TIME.size, axes))
    force[:, 0] = 3.0 * early
    moment = np.zeros(TIME.size) if axes == 2 else np.zeros((TIME.size, axes))
    data = run.dataset.assign(
        vehicle_pose=(("time", "channel"), pose),
        thruster_force=(("time", "axis"), force),
        thruster_moment=(("time", "axis")[: moment.ndim], moment),
    )
    floating = Result(data)
    assert measure("vehicle_excursion", floating) == pytest.approx(0.1)
    assert measure("vehicle_turn", floating) == pytest.approx(0.02)
    assert measure("max_thrust", floating) == pytest.approx(3.0)
    assert measure("rms_thrust", floating) == pytest.approx(3 * np.sqrt(0.1 + 0.9 / 16), rel=1e-3)
    assert measure("thrust_limit_share", floating) == pytest.approx(0.1, abs=1e-3)
    assert measure("max_thrust", run) is None


@BOTH
def test_measures_with_derivatives_are_those_of_the_result(dimension):
    """Errors count from 5 s on, and the last tenth is that of the whole run."""
    random = np.random.default_rng(0)
    error, force, turn = random.normal(0.0, [[0.1], [3.0], [0.4]], (3, TIME.size))
    run = made(dimension, TIME, error, force, **{"target.judged_from": 5.0})
    if dimension == 2:
        names, pose = ("tip_angle", "tip_angle_target"), (turn[:, None], 0.0 * turn[:, None])
    else:
        names = ("tip_direction", "tip_direction_target")
        pose = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1), np.eye(3)[[0] * TIME.size]
    for name, values in zip(names, pose, strict=True):
        run.dataset[name] = quantity(name, values.squeeze(), dimension)
    tip = run.dataset["tip_position"].values
    apart = [np.hstack([tip, pose[0]]), np.hstack([tip, pose[0] - pose[1]])]
    loads = [
        run.dataset[name].values.reshape(TIME.size, -1) for name in ("base_force", "base_moment")
    ]
    run.dataset["tip_target"] = quantity("tip_target", 0.0 * tip, dimension)
    command = random.normal(0.0, 0.2, (TIME.size, run.dataset["channel"].size))
    run.dataset["base_command"] = quantity("base_command", command, dimension)
    weights = CostWeights.of(run.scenario, list(run.dataset["channel_unit"].values))
    seen = SeenMotion(TIME, *apart, *loads, np.zeros((TIME.size, 1)), command, 1000, weights)
    names = [name for name, each in MEASURES.items() if each.smooth and name != "max_pressure"]
    found = {name: float(SMOOTH[name](seen)) for name in names}
    assert len(found) == 10
    assert found == pytest.approx({name: measure(name, run) for name in names}, abs=1e-11)


def test_units_are_shown_without_negative_powers():
    shown = {"1": "", "m": "m", "m-1": "1/m", "m s-1": "m/s", "N m": "N m", "J kg-1 s-1": "J/kg/s"}
    assert {unit: plain_unit(unit) for unit in shown} == shown
