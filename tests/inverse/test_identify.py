"""Identification: derivatives, records, the search, and what the command writes."""

import re
import signal
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.inverse.experiment import Experiment
from crinoid.inverse.experiment_record import ExperimentRecord, read_record
from crinoid.inverse.identification import Identification
from crinoid.inverse.unknowns import Unknowns
from crinoid.scenario import Scenario, ScenarioError
from crinoid.view.figures import write_report
from helpers.command import call, succeeded
from helpers.figures import assert_shows_something

SHAKEN = Scenario(
    title="shaken",
    seed=3,
    arm={"nodes": 5, "radius": 0.015, "youngs_modulus": 4e5, "damping_time": 0.02},
    base={
        "channels": {"tilt": {}},
        "motion": [{"kind": "sine", "channel": "tilt", "amplitude_deg": 10.0, "frequency_hz": 1.0}],
    },
    chamber=[
        {"name": "lift", "offset": 0.008, "area": 1e-4, "angle_deg": 180.0, "max_pressure": 5e4}
        | {"schedule": {"time": [0.0, 0.1, 0.6, 0.7], "share": [0.0, 1.0, 1.0, 0.0]}}
    ],
    sensor={"noise_position": 0.0005, "noise_angle_deg": 0.1},
    simulation={"duration": 2.0, "time_step": 0.02, "start": "equilibrium"},
)
KEYS = ("arm.youngs_modulus", "chamber.0.area")
TRUE = {"arm.youngs_modulus": 4e5, "chamber.0.area": 1e-4}
WRONG = {"arm.youngs_modulus": 3e5, "chamber.0.area": 1.4e-4}
QUIETLY = (lambda *_: None), (lambda: False)
"""How a search reports, and when it stops."""


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Return the folder of a run with a noisy sensor, and a table of its readings."""
    folder = tmp_path_factory.mktemp("measured")
    crinoid.simulate(SHAKEN).save(folder)
    (folder / "shaken.toml").write_text(SHAKEN.to_toml())
    record = read_record(folder, SHAKEN, ())
    x, z, angle = record.values.T
    table = pd.DataFrame({"time [s]": record.time, "x (mm)": 1e3 * x, "z (mm)": 1e3 * z})
    table["angle (deg)"] = np.rad2deg(angle)
    table.to_csv(folder / "tip.csv", index=False)
    return folder


@pytest.fixture(scope="module")
def record(measured):
    """Return what was measured in that run."""
    return read_record(measured / "tip.csv", SHAKEN, ())


def identify(measured, record, keys, *options):
    """Return the arguments of a call."""
    return "identify", measured / "shaken.toml", record, "--of", keys, *options


@pytest.fixture(scope="module")
def found(measured):
    """Return where `crinoid identify` has written."""
    out = measured / "found"
    settings = [word for key, value in WRONG.items() for word in ("--set", f"{key}={value}")]
    record = measured / "tip.csv"
    succeeded(*identify(measured, record, ",".join(KEYS), *settings, "--out", out))
    return out


NOISE = np.array([5e-4, 5e-4, np.deg2rad(0.1)])


@pytest.mark.slow
def test_the_numbers_are_found_within_their_errors(found):
    data = xr.load_dataset(found / "identify.nc")
    assert data.attrs["status"] == "ok"
    np.testing.assert_allclose(data["given"], list(WRONG.values()))
    apart = (data["found"].values - list(TRUE.values())) / data["standard_error"].values
    assert np.abs(apart).max() < 4
    share = data["standard_error"].values / data["found"].values
    assert ((share > 1e-5) & (share < 0.02)).all()
    assert ((data["lower"] < data["found"]) & (data["found"] < data["upper"])).all()
    # the residual is the sensor's noise
    np.testing.assert_allclose(data["scatter"], NOISE, rtol=0.25)
    identified = crinoid.load(str(found / "identified.toml"))
    np.testing.assert_allclose(Unknowns(identified, KEYS).given, data["found"], rtol=1e-5)


@pytest.mark.slow
def test_the_figure_shows_something(found, tmp_path):
    assert write_report(found, tmp_path) == [tmp_path / "identify.png"]
    assert_shows_something(tmp_path / "identify.png")


@pytest.mark.slow
def test_slopes_are_those_of_central_differences(record):
    def compared(logs):
        return experiment.compare(experiment.motion(logs))

    experiment, step = Experiment(SHAKEN, Unknowns(SHAKEN, KEYS), record), 1e-4
    at = np.array([-0.2, 0.3])
    slope = compared(at).sensitivity
    for number, change in enumerate(step * np.eye(2)):
        between = (compared(at + change).computed - compared(at - change).computed) / (2 * step)
        tolerance = 1e-6 * np.abs(between).max()
        np.testing.assert_allclose(slope[..., number], between, atol=tolerance)


@pytest.mark.slow
def test_a_search_that_is_stopped_keeps_the_best_so_far(record):
    search = Identification(SHAKEN.with_values(WRONG), KEYS, [record])
    assert not search.run(QUIETLY[0], lambda: search.trials >= 3)
    assert search.trials == 3
    assert search.found.cost < search.before.cost
    assert search.dataset("interrupted").attrs["status"] == "interrupted"


@pytest.mark.slow
def test_an_interruption_of_the_second_trial_saves_the_given_numbers(
    measured, found, tmp_path, monkeypatch
):
    motion, calls = Experiment.motion, []

    def interrupted(self, logs):
        calls.append(logs)
        if len(calls) == 2:
            signal.raise_signal(signal.SIGINT)
        return motion(self, logs)

    monkeypatch.setattr(Experiment, "motion", interrupted)
    given = f"arm.youngs_modulus={WRONG['arm.youngs_modulus']}"
    keys = ",".join(KEYS)
    words = identify(measured, measured / "tip.csv", keys, "--set", given, "--out", tmp_path)
    said = call(*words)
    assert said.exit_code == 130, said.output
    assert "interrupted after 2 trials; the best numbers so far are saved" in said.stderr
    assert not np.array_equal(*calls)  # the given numbers are run once
    data = xr.load_dataset(tmp_path / "identify.nc")
    assert data["given"][0] == WRONG["arm.youngs_modulus"]
    assert (tmp_path / "identified.toml").exists()


@pytest.mark.slow
def test_numbers_that_a_record_does_not_determine_are_refused(record):
    alike = Identification(SHAKEN, ("chamber.0.area", "chamber.0.max_pressure"), [record])
    with pytest.raises(ScenarioError, match=r"max_pressure: cannot be distinguished from ch"):
        alike.run(*QUIETLY)
    empty = SHAKEN.with_values({"chamber.0.schedule.share": [0.0, 0.0, 0.0, 0.0]})
    with pytest.raises(ScenarioError, match=r"^chamber.0.area: has no effect on the measured"):
        Identification(empty, KEYS, [record]).run(*QUIETLY)


def searched(record, values, given=WRONG, scenario=SHAKEN):
    """Return a search in other values of a record, from wrong numbers, and its standard errors.

    From the true numbers, ``given`` empty, a search needs about half as many trials.
    """
    other = ExperimentRecord(record.time, record.names, values, None)
    search = Identification(scenario.with_values(given), KEYS, [other])
    assert search.run(*QUIETLY)
    return search, np.sqrt(np.diag(search.covariance()))


def off(search):
    """Return how far the logarithms of the numbers are from the truth."""
    return search.found.logs - np.log(np.array([*TRUE.values()]) / search.unknowns.given)


@pytest.fixture(scope="module")
def clean(record):
    """Return a search in the record as it is, and its standard errors."""
    return searched(record, record.values, {})


@pytest.mark.slow
def test_a_clean_record_has_the_answer_of_least_squares(clean):
    search, errors = clean
    assert search.weights[0].used.all()
    assert search.notes == []
    slope = (search.found.runs[0].sensitivity / search.weights[0].scatter[:, None]).reshape(
        -1, len(KEYS)
    )
    left = (search.found.runs[0].residual / search.weights[0].scatter).ravel()
    step = np.linalg.lstsq(slope, left, rcond=None)[0]  # to the least sum of squares
    assert np.abs(step / errors).max() < 0.05


@pytest.mark.release
def test_motion_that_the_model_lacks_widens_the_errors(record, clean):
    plain, narrow = clean
    slow = 2e-3 * np.sin(7.0 * record.time)[:, None] * np.array([1.0, 1.0, 5.0])
    waving, wide = searched(record, record.values + slow, {})
    # the waves are correlated over many samples, and have the information of a few
    assert waving.correlation[0, 0] > 3 * plain.correlation[0, 0]
    assert (wide > 1.5 * narrow).all()


def lost(record, kind):
    """Return a record of which some markers were lost, and which rows these are."""
    values, dice = record.values.copy(), np.random.default_rng(5)
    rows = dice.permutation(len(values))[: len(values) // 12]
    if kind == "stuck":
        rows = np.arange(rows[0], rows[0] + 10)
        values[rows, :2] = values[rows[0], :2]
    elif kind == "outliers":
        values[rows] += dice.choice([-1, 1], (len(rows), 3)) * [0.02, 0.02, 0.2]
    else:
        rows = np.arange(30, 38) if kind == "stretch" else rows
        # ten metres above the arm, or within its reach, at the base
        values[rows, :2] = 0.0 if kind == "zeros" else SHAKEN.base.position
    return values, np.sort(rows)


@pytest.mark.release
@pytest.mark.parametrize("kind", ["stretch", "stuck", "outliers"])  # zeros: by the command
def test_lost_markers_are_set_aside_and_do_not_steer(record, kind):
    values, rows = lost(record, kind)
    search, errors = searched(record, values)
    assert np.flatnonzero(~search.weights[0].used).tolist() == rows.tolist()
    assert np.abs(off(search) / errors).max() < 4
    assert errors.max() < 2e-3  # those of the rows that are left
    np.testing.assert_allclose(search.weights[0].scatter, NOISE, rtol=0.25)


@pytest.mark.release
def test_errors_stay_honest_over_many_draws_of_lost_markers(record):
    experiment = Experiment(SHAKEN, Unknowns(SHAKEN, KEYS), record)
    path = experiment.compare(experiment.motion(np.zeros(2))).computed
    apart = []
    for seed in range(6):
        dice = np.random.default_rng(seed)
        values = path + dice.normal(size=path.shape) * NOISE
        rows = dice.permutation(len(values))[:8]
        values[rows] += dice.normal(size=(8, 3)) * [0.05, 0.05, 0.5]
        search, errors = searched(record, values, {})  # from wrong numbers: see above
        apart.append(off(search) / errors)
    assert 0.5 < np.sqrt(np.mean(np.square(apart))) < 1.6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("read", "cause"),
    [
        (lambda x, z: (x, -z), "heights are positive down"),
        (lambda x, z: (x, z + 10), "positions are measured from the base"),
        (lambda x, z: (x, -z - 10), "positions are measured from the base, positive down"),
        (lambda x, z: (1e3 * x, 1e3 * z), "lengths are in mm"),
        (lambda x, z: (1e3 * x, 1e3 * z + 1e4), "lengths are in mm; positions are measured from"),
        (lambda x, z: (z, x), "axes are swapped"),
    ],
)
def test_a_record_that_the_arm_cannot_reach_is_refused_with_its_cause(record, read, cause):
    x, z, angle = record.values.T
    words = f"got the tip at x = .*; must lie within 0.6.* m of the root at x = .*cause: {cause}"
    with pytest.raises(ScenarioError, match=rf"^RECORD: {words}") as caught:
        searched(record, np.stack([*read(x, z), angle], axis=1))
    assert len(caught.value.lines) == 1


@pytest.mark.slow
def test_a_record_without_a_likely_cause_is_refused(record):
    elsewhere = SHAKEN.with_values({"base.position": [0.0, -3.0]})
    with pytest.raises(ScenarioError, match="Check units, origin, axes and the sign of z"):
        searched(record, record.values, scenario=elsewhere)
    values = record.values.copy()
    values[50:] = values[50]
    with pytest.raises(ScenarioError, match="A stuck marker rests while the arm moves"):
        searched(record, values, {})


@pytest.mark.release
def test_a_record_within_reach_that_fits_another_way_is_noted(record):
    shallow = SHAKEN.with_values({"base.position": [0.0, -0.1]})
    down = record.values * [1, -1, 1] - [0.0, 9.9, 0.0]
    search, _ = searched(record, down, {}, scenario=shallow)
    assert "Likely cause: heights are positive down." in search.notes[0]


@pytest.mark.slow
def test_a_record_that_stands_still_determines_nothing_and_the_command_says_so(
    measured, record, tmp_path
):
    """The arm is straight in the record, as only a stiff one is: any stiff one."""
    draw = np.random.default_rng(0).normal(scale=1e-4, size=(2, record.time.size))
    base, length = SHAKEN.base.position, SHAKEN.arm.length
    columns = {"time": record.time, "x": base[0] + length + draw[0], "z": base[1] + draw[1]}
    pd.DataFrame(columns).to_csv(tmp_path / "tip.csv", index=False)
    # not the numbers of the other searches, but as many: it shares what they compile
    still = {"base.motion.0.amplitude_deg": 0.0, "chamber.0.schedule.share": [0.3] * 4}
    settings = [word for key, value in still.items() for word in ("--set", f"{key}={value}")]
    keys = identify(measured, tmp_path / "tip.csv", ",".join(KEYS), *settings)
    ended = call(*keys, "--out", tmp_path / "out")
    assert ended.exit_code == 1, ended.output
    first, *_ = KEYS
    said = f"the record does not determine all numbers; name fewer. {first}: its standard error"
    assert said in ended.stderr
    assert re.search(rf"{first} .* not determined", ended.stdout)
    data = xr.load_dataset(tmp_path / "out" / "identify.nc")
    assert said in data.attrs["status"]
    assert not data["determined"].sel(parameter=first)
    assert said in (tmp_path / "out" / "identified.toml").read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("share", "deviation", "why"),
    [
        (1.2, 0.01, ""),
        (1.2, 0.99, ""),
        (1e4, 0.01, "its search ends at 1e+04 times the given value"),
        (1e-4, np.inf, "its search ends at 0.0001 times the given value"),
        (1.2, 25.0, "its standard error exceeds it"),
        (1.2, np.inf, "its standard error exceeds it"),
        (1.2, np.nan, "its standard error exceeds it"),
    ],
)
def test_what_a_record_does_not_determine(share, deviation, why):
    search = Identification.__new__(Identification)
    search.unknowns = Unknowns(SHAKEN.with_values(WRONG), KEYS)
    search.found = SimpleNamespace(logs=np.log([share, 1.0]))
    search.covariance = lambda: np.diag([deviation**2, 1e-4])
    assert search.undetermined() == ({KEYS[0]: why} if why else {})


@pytest.mark.slow
def test_a_record_of_a_stuck_marker_alone_is_refused(record):
    still = np.zeros_like(record.values) + record.values[0]
    with pytest.raises(ScenarioError, match=r"got 100% of rows .* A stuck marker rests"):
        searched(record, still, {})


@pytest.mark.slow
def test_the_command_sets_lost_markers_aside_and_says_which_rows(measured, record, tmp_path):
    values, rows = lost(record, "zeros")
    table = pd.DataFrame({"time": record.time, "x": values[:, 0], "z": values[:, 1]})
    table.to_csv(tmp_path / "tip.csv", index=False)
    # the keys of the other searches, whose programs it shares
    settings = [word for key, value in WRONG.items() for word in ("--set", f"{key}={value}")]
    call = identify(measured, tmp_path / "tip.csv", ",".join(KEYS), *settings, "--out", tmp_path)
    output = succeeded(*call)
    words = f"{len(rows)} of {len(values)} rows"
    assert f"set aside as lost markers: {words}" in output
    assert words in (tmp_path / "identified.toml").read_text().splitlines()[0]
    data = xr.load_dataset(tmp_path / "identify.nc")
    assert np.flatnonzero(data["set_aside"]).tolist() == rows.tolist()
    # they do not steer
    apart = (data["found"].values - list(TRUE.values())) / data["standard_error"].values
    assert np.abs(apart).max() < 4
    assert (data["standard_error"].values / data["found"].values).max() < 2e-3
    np.testing.assert_allclose(data["scatter"], NOISE[:2], rtol=0.25)
    assert_shows_something(tmp_path / "identify.png")


@pytest.mark.slow
def test_readings_of_a_result_count_from_when_they_were_taken(tmp_path):
    late = {"noise_position": 0.0, "noise_angle_deg": 0.0, "delay": 0.05, "rate_hz": 20.0}
    result = crinoid.simulate(SHAKEN.with_values({f"sensor.{key}": late[key] for key in late}))
    result.save(tmp_path)
    record = read_record(tmp_path / "result.nc", SHAKEN, ())
    data = result.dataset.sel(time=record.time, method="nearest")
    assert np.diff(record.time).max() < 0.061  # at the steps after each twentieth of a second
    np.testing.assert_allclose(data["time"], record.time, atol=1e-9)
    np.testing.assert_allclose(record.values[:, :2], data["tip_position"], atol=1e-12)
    np.testing.assert_allclose(record.values[:, 2], data["tip_angle"], atol=1e-12)


@pytest.mark.release
def test_recorded_commands_move_the_arm_as_they_did(tmp_path):
    pid = {"kind": "pid", "controlled": ["angle"], "pid": {"tilt": {"kp": 0.2, "ki": 1.0}}}
    held = SHAKEN.with_values({"control": pid | {"compare": False}})
    result = crinoid.simulate(held)
    result.save(tmp_path)
    record = read_record(tmp_path, held, Prepared(held).system.inputs)
    assert np.abs(record.commands.values).max() > 1e-3
    path = Experiment(held, Unknowns(held, KEYS), record).motion(np.zeros(2)).places.marker[:, 0]
    np.testing.assert_allclose(path[:, :2], result.dataset["tip_position"][: len(path)], atol=1e-9)


def test_a_table_of_motion_and_commands_is_read(tmp_path):
    inputs = Prepared(SHAKEN).system.inputs
    (tmp_path / "a.csv").write_text(
        "time (ms);z (cm);tilt (deg);lift;lfit\n"
        "-20;1;0;0;7\n0;2;0;0;7\n20;3;90;0,5;7\n40;;90;0,5;7\n60;5;0;0;7\n"
    )
    record = read_record(tmp_path / "a.csv", SHAKEN, inputs)
    assert record.names == ("z",)
    np.testing.assert_allclose(record.time, [0.0, 0.02, 0.06])
    np.testing.assert_allclose(record.values[:, 0], [0.02, 0.03, 0.05])
    np.testing.assert_allclose(record.commands.time, [-0.02, 0.0, 0.02, 0.04, 0.06])
    names = [each.name for each in inputs]
    at = record.commands.values[2, [names.index("tilt"), names.index("lift")]]
    np.testing.assert_allclose(at, [np.pi / 2, 0.5])
    assert any("before the start" in note for note in record.notes)
    assert any("1 of 5 rows" in note for note in record.notes)
    assert "not read: lfit" in record.notes


@pytest.mark.slow
def test_a_result_of_another_dimension_is_no_record(measured):
    with pytest.raises(ScenarioError, match="the arm has 2 axes; must have 3"):
        read_record(measured, SHAKEN.with_values({"arm.dimension": 3}), ())
