"""Identification from static holds, markers along the arm, and several experiments."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.inverse.experiment import Experiment
from crinoid.inverse.experiment_record import ExperimentRecord, Holds
from crinoid.inverse.experiments_file import read_experiments
from crinoid.inverse.identification import Identification, marker_errors
from crinoid.inverse.marker import Marker, MarkerWeights
from crinoid.inverse.unknowns import Unknowns
from crinoid.scenario import Scenario
from helpers.command import succeeded
from helpers.figures import assert_shows_something

LENGTH, NOISE = 0.4, 5e-4
ARM = Scenario(
    title="held",
    arm={"nodes": 9, "length": LENGTH, "radius": [0.012, 0.006], "youngs_modulus": 4e5}
    | {"relaxation": [{"ratio": 0.3, "time": 0.4}], "damping_time": 0.01},
    water={"density": 0.0},
    base={"tilt_deg": -90.0, "position": [0.0, 0.0]},
    tendon=[
        {"offset": [0.01, 0.004], "max_tension": 1.6, "friction": 0.3, "pretension": 0.1},
        {"offset": [0.01, 0.004], "max_tension": 1.6, "friction": 0.3, "angle_deg": 180.0},
    ],
    simulation={"duration": 1.0, "time_step": 0.005, "start": "equilibrium"},
)
MARKERS = (
    Marker(name="low", s=0.15, offset=(0.0, 0.02)),
    Marker(name="high", s=0.31, offset=(0.0, -0.015)),
)
SHARES = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [0.0, 0.6], [0.0, 1.0]])
KEYS = ("arm.youngs_modulus", "arm.density", "tendon.0.friction+tendon.1.friction")
QUIETLY = (lambda *_: None), (lambda: False)
"""How a search reports, and when it stops."""


# with a schedule, as the arm that moves has one: both share what they compile
HELD = ARM.with_values({"tendon.0.schedule": {"time": [0.0, 0.2, 0.6], "share": [0.2, 0.8, 0.1]}})


def unmeasured(shares=SHARES, name="", **settings):
    """Return a record of holds in which nothing was measured yet: markers and tip of each."""
    count = len(shares)
    holds = Holds(tuple("abcdefgh"[:count]), np.repeat(np.arange(count), 3), (0, 1), shares)
    zeros, of_row = np.zeros(3 * count), np.tile([0, 1, 2], count)
    values = np.zeros((3 * count, 2))
    return ExperimentRecord(
        zeros, ("x", "z"), values, None, (), MARKERS, of_row, holds, name, settings
    )


def computed(record, keys=KEYS, scenario=HELD):
    """Return the record as crinoid computes it."""
    case = scenario.with_values(record.settings)
    experiment = Experiment(case, Unknowns(scenario, keys), record)
    found = experiment.compare(experiment.motion(np.zeros(len(keys)))).computed
    assert np.isfinite(found).all()
    return replace(record, values=found)


def noisy(record, seed, scale=NOISE):
    noise = np.random.default_rng(seed).normal(scale=scale, size=record.values.shape)
    return replace(record, values=record.values + noise)


def search(records, given, keys=KEYS, scenario=HELD):
    """Return a search for three numbers, as all are here: they share what they compile."""
    found = Identification(scenario.with_values(given), keys, records)
    assert found.run(*QUIETLY)
    assert not found.failure
    return found


@pytest.fixture(scope="module")
def clean():
    """Return a record of all holds as crinoid computes it."""
    return computed(unmeasured())


WRONG = {"arm.youngs_modulus": 3e5, "arm.density": 1300.0} | {
    f"tendon.{k}.friction": 0.2 for k in (0, 1)
}
TRUE = np.array([4e5, 1080.0, 0.3])


@pytest.mark.slow
@pytest.mark.parametrize("axes", [2, 3])
def test_markers_on_a_circle(axes):
    # bent by 1.2 rad upward; in space m_1 is to port, m_2 upward
    curvature = 1.2 / LENGTH
    bent = {"rest_curvature": curvature if axes == 2 else [0.0, curvature, 0.0]}
    scenario = Scenario(
        arm={"dimension": axes, "nodes": 21, "length": LENGTH} | bent,
        base={"position": [0.3, -2.0] if axes == 2 else [0.3, 0.0, -2.0]},
    )
    offset = (0.003, 0.02) if axes == 2 else (0.003, 0.01, 0.02)
    markers = [Marker(name="a", s=s, offset=offset) for s in (0.0, 0.137, 0.3, LENGTH)]
    markers.append(Marker(name="axis", s=0.2))
    system = Prepared(scenario).system
    state = system.rest()
    found = np.asarray(MarkerWeights.of(markers, scenario).places(system, state))
    np.testing.assert_allclose(found[0], system.tip(state), atol=1e-12)
    for marker, place in zip(markers, found[1:], strict=True):
        turn, away = curvature * marker.s, marker.offset or (0.0,) * axes
        tangent, up = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        x, z = np.array([np.sin(turn), 1 - np.cos(turn)]) / curvature
        x, z = (0.3, -2.0) + np.array([x, z]) + away[0] * tangent + away[-1] * up
        expected = (x, z) if axes == 2 else (x, away[1], z)
        np.testing.assert_allclose(place[:axes], expected, atol=1e-3 * LENGTH / 21)


@pytest.mark.release
def test_standard_errors_agree_with_the_scatter_over_seeds(clean):
    # with little noise, as standard errors are those of a linear model
    found, errors = [], []
    for seed in range(8):
        done = search([noisy(clean, seed, NOISE / 5)], {})
        found.append(done.found.logs)
        errors.append(np.sqrt(np.diag(done.covariance())))
    scatter = np.sqrt(np.mean(np.square(found), axis=0))
    np.testing.assert_allclose(np.mean(errors, axis=0), scatter, rtol=0.5)  # 2 sigma of 8 draws


@pytest.mark.slow
@pytest.mark.parametrize(
    "keys",
    [
        KEYS,
        ("tendon.0.offset.0", "tendon.0.offset.1", "tendon.0.pretension"),
        ("arm.length", "arm.radius.1", "tendon.0.max_tension"),
    ],
)
def test_slopes_of_holds_are_those_of_central_differences(keys):
    experiment = Experiment(HELD, Unknowns(HELD, keys), unmeasured(SHARES[2:4]))

    def compared(logs):
        return experiment.compare(experiment.motion(logs))

    slope, step = compared(np.zeros(len(keys))).sensitivity, 1e-4
    for number, change in enumerate(step * np.eye(len(keys))):
        between = (compared(change).computed - compared(-change).computed) / (2 * step)
        scale = np.abs(between).max()
        assert scale > 1e-5
        np.testing.assert_allclose(slope[..., number], between, atol=1e-5 * scale)


@pytest.mark.release
def test_experiments_are_fitted_together():
    # holds have the stiffness, a motion at another tilt the relaxation
    keys = ("arm.youngs_modulus", "arm.relaxation.0.ratio", "arm.relaxation.0.time")
    time = np.repeat(np.arange(1, 20) * 0.025, 3)
    of_row, blank = np.tile([0, 1, 2], 19), np.zeros((time.size, 2))
    level = {"base.tilt_deg": 0.0, "simulation.start": "rest"}
    # without friction, which makes a motion slow to compile
    smooth = HELD.with_values({f"tendon.{k}.friction": 0.0 for k in (0, 1)})
    swing = ExperimentRecord(
        time, ("x", "z"), blank, None, (), MARKERS, of_row, None, "swing", level
    )
    records = [unmeasured(SHARES[:3], "holds"), swing]
    records = [noisy(computed(each, keys, smooth), 3) for each in records]
    relaxation = {"arm.relaxation.0.ratio": 0.2, "arm.relaxation.0.time": 0.6}
    given = {"arm.youngs_modulus": 3.6e5} | relaxation
    found = search(records, given, keys, smooth)
    data = found.dataset("ok")
    apart = data["found"].values - [4e5, 0.3, 0.4]
    assert np.abs(apart / data["standard_error"].values).max() < 3
    assert data["quantity"].values.tolist() == ["holds.x", "holds.z", "swing.x", "swing.z"]
    assert data["hold"].values[:4].tolist() == ["a", "a", "a", "b"]
    assert (data["hold"].values[9:] == "").all()
    empty = np.isnan(data["measured"].values)
    assert empty[:9, 2:].all()
    assert empty[9:, :2].all()
    assert not empty[:9, :2].any()
    assert not empty[9:, 2:].any()
    # about the true numbers, without a search
    alone = Identification(smooth, keys, records[1:])
    assert not alone.run(QUIETLY[0], lambda: True)
    assert (np.diag(found.covariance()) < np.diag(alone.covariance())).all()


TABLE = "hold,marker,x (mm),z,tendon_0 (N),tendon_1\na,low,1,-0.2,0.8,0\na,tip,2,-0.4,0.8,0\n"
FILE = """
[[marker]]
name = "low"
s = 0.15
offset = [0.0, 0.02]
[[experiment]]
file = "holds.csv"
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "arm.toml").write_text(ARM.to_toml())
    (tmp_path / "holds.csv").write_text(TABLE)
    (tmp_path / "all.toml").write_text(FILE)
    return tmp_path


def read(folder, keys=KEYS):
    return read_experiments(folder / "all.toml", Prepared(ARM), Unknowns(ARM, keys))


def test_holds_and_markers_are_read(folder):
    table = TABLE + "b,low,3,-0.1,0,0.25\nb,tip,,-0.1,0,0.25\n"
    (folder / "holds.csv").write_text(table)
    (folder / "all.toml").write_text(
        FILE + "set.base.tilt_deg = -80.0\n"
        '[[experiment]]\nfile = "holds.csv"\nname = "again"\nset = { "arm.damping_time" = 0.02 }\n'
    )
    one, other = read(folder)
    assert (one.name, other.name) == ("holds", "again")
    assert (one.settings, other.settings) == ({"base.tilt_deg": -80.0}, {"arm.damping_time": 0.02})
    assert one.markers == (MARKERS[0],)
    assert one.names == ("x", "z")
    np.testing.assert_allclose(one.values, [[1e-3, -0.2], [2e-3, -0.4], [3e-3, -0.1]])
    assert one.marker.tolist() == [1, 0, 1]
    assert one.holds.names == ("a", "b")
    assert one.holds.of_row.tolist() == [0, 0, 1]
    np.testing.assert_allclose(one.holds.shares, [[0.5, 0.0], [0.0, 0.25]])
    assert any("1 row without a value" in note for note in one.notes)


def test_a_motion_of_markers_is_read(folder):
    (folder / "holds.csv").write_text(
        "time,marker,x,z,tendon_0\n0,low,1,2,0\n0,tip,5,6,0\n0.1,low,3,4,0.5\n0.05,tip,7,8,0.2\n"
    )
    (record,) = read(folder)
    np.testing.assert_allclose(record.time, [0.0, 0.0, 0.05, 0.1])
    assert record.marker.tolist() == [1, 0, 0, 1]
    np.testing.assert_allclose(record.values[:, 0], [1, 5, 7, 3])
    np.testing.assert_allclose(record.commands.time, [0.0, 0.05, 0.1])
    names = [each.name for each in Prepared(ARM).system.inputs]
    given = record.commands.values[:, names.index("tendon_0")]
    np.testing.assert_allclose(given, [0.0, 0.2, 0.5])


@pytest.mark.release
def test_the_command_finds_the_numbers_of_holds_within_three_standard_errors(clean, folder):
    record, rows = noisy(clean, 5), []
    (folder / "arm.toml").write_text(HELD.to_toml())
    labels = ("tip", "low", "high")
    for row, (x, z) in enumerate(record.values):
        hold = record.holds.of_row[row]
        rows.append((record.holds.names[hold], labels[record.marker[row]], x, z, *SHARES[hold]))
    columns = ["hold", "marker", "x (m)", "z (m)", "tendon_0", "tendon_1"]
    pd.DataFrame(rows, columns=columns).to_csv(folder / "holds.csv", index=False)
    table = "".join(
        f'[[marker]]\nname = "{m.name}"\ns = {m.s}\noffset = {list(m.offset)}\n' for m in MARKERS
    )
    (folder / "all.toml").write_text(f'{table}[[experiment]]\nfile = "holds.csv"\n')
    settings = [word for key, value in WRONG.items() for word in ("--set", f"{key}={value}")]
    call = ("identify", folder / "arm.toml", folder / "all.toml", "--of", ",".join(KEYS))
    succeeded(*call, *settings, "--out", folder / "out")
    data = xr.load_dataset(folder / "out" / "identify.nc")
    apart = (data["found"].values - TRUE) / data["standard_error"].values
    assert np.abs(apart).max() < 3
    share = data["standard_error"].values / data["found"].values
    assert ((share > 1e-4) & (share < 0.25)).all()
    np.testing.assert_allclose(data["scatter"], NOISE, rtol=0.25)
    assert np.unique(data["scatter"]).size == 1  # one for all places of the holds
    assert max(marker_errors(data).values()) < 2 * NOISE
    assert list(marker_errors(data)) == ["tip", "low", "high"]
    assert_shows_something(folder / "out" / "identify.png")
    identified = crinoid.load(folder / "out" / "identified.toml")
    both = [each.friction for each in identified.tendon]
    assert both[0] == both[1] == pytest.approx(float(data["found"][2]), rel=1e-5)
