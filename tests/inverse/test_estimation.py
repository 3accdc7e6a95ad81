"""Estimation from a log: the observer of LQG offline, missing readings, mistakes, the command."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.inverse.readings import read_readings
from crinoid.results.result import Result
from crinoid.scenario import Scenario
from helpers.command import succeeded
from helpers.figures import assert_shows_something
from helpers.refusals import mistake

STEP, NOISE = 0.02, 1e-3
HELD = Scenario(
    title="held",
    seed=4,
    arm={"nodes": 6, "radius": 0.015, "youngs_modulus": 4e6, "density": 1080.0},
    base={"tilt_deg": 90.0, "channels": {"slide": {"bandwidth_hz": 10.0}, "tilt": {}}},
    flow=[{"kind": "sine", "amplitude": [0.2, 0.0], "frequency_hz": 0.2, "ramp_time": 1.0}],
    sensor={"noise_position": NOISE, "noise_angle_deg": 0.1, "delay": STEP},
    sensors=[{"kind": "inclination", "stations": [0.5], "noise_deg": 0.2, "delay": 2 * STEP}],
    control={"kind": "lqg", "controlled": ["x", "angle"], "compare": False},
    simulation={"duration": 6.0, "time_step": STEP, "start": "equilibrium"},
    output={"interval": STEP},
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the folder of a run with noisy sensors."""
    folder = tmp_path_factory.mktemp("run")
    crinoid.simulate(HELD).save(folder)
    (folder / "held.toml").write_text(HELD.to_toml())
    return folder


@pytest.fixture(scope="module")
def found(run):
    """Return the estimate from the run."""
    return crinoid.estimate(HELD, run)


@pytest.fixture(scope="module")
def table(run):
    """Return the log of the run as a table: readings, and measured states of the actuators."""
    data = xr.open_dataset(run / "result.nc")
    readings = data["sensor_reading"].values
    # an instant knows a reading of the tip from a period before it, the other from two
    log = {"time": data["time"].values[:-2], "x (mm)": 1e3 * readings[1:-1, 0]}
    log |= {"z (m)": readings[1:-1, 1], "angle (rad)": readings[1:-1, 2]}
    log["inclination.inclination_0 (rad)"] = readings[2:, 3]
    for channel in ("slide", "tilt"):
        unit = "m" if channel == "slide" else "rad"
        log[f"{channel}.state ({unit})"] = data["base_servo"].sel(channel=channel).values[:-2]
    return pd.DataFrame(log)


def late(data):
    return data.isel(time=data["time"].values > 3.0)


@pytest.mark.slow
def test_a_log_gives_the_estimate_of_the_controller(run, found):
    online = xr.open_dataset(run / "result.nc").isel(time=slice(1, None))
    online = online.assign_coords(time=online["estimate_time"].values)
    both = xr.align(late(online), late(found), join="inner", exclude=["axis", "node"])
    assert both[0].sizes["time"] > 100
    for name in ("tip_position", "tip_angle", "position"):
        std = both[0][f"estimated_{name}_std"].values
        np.testing.assert_allclose(both[1][f"estimated_{name}_std"], std, rtol=0.02, atol=1e-9)
        apart = np.abs(both[1][f"estimated_{name}"].values - both[0][f"estimated_{name}"].values)
        # the prior of a log is wide, and is forgotten slowly
        assert (apart <= 0.2 * std + 1e-9).all()


@pytest.mark.release
def test_innovations_are_as_large_as_expected(found):
    new = np.isfinite(found["innovation"].values)
    assert new[5:].all()  # all of them arrive at each call
    assert found.attrs["readings_used"] == new.sum()
    assert 0.9 < found.attrs["within_two_std"] <= 1.0
    low, high = (found.attrs[f"mean_square_{end}"] for end in ("low", "high"))
    assert low < 1 < high
    assert 0.7 < found.attrs["mean_square"] < high


@pytest.mark.release
def test_measured_states_of_actuators_do_as_well_as_commands(run, found, table, tmp_path):
    table.to_csv(tmp_path / "log.csv", index=False)
    other = crinoid.estimate(HELD, tmp_path / "log.csv")
    both = xr.align(late(found), late(other), join="inner", exclude=["axis", "node"])
    std = both[0]["estimated_tip_position_std"].values
    apart = both[1]["estimated_tip_position"].values - both[0]["estimated_tip_position"].values
    assert np.sqrt(np.mean((apart / std) ** 2)) < 0.2


@pytest.mark.slow
def test_a_gap_widens_the_band_and_a_lost_column_as_well(run, table, found, tmp_path):
    gap = table.copy()
    gap.loc[150:200, [name for name in gap if "state" not in name and name != "time"]] = np.nan
    gap.drop(columns="angle (rad)").to_csv(tmp_path / "log.csv", index=False)
    data = crinoid.estimate(HELD, tmp_path / "log.csv")
    std = data["estimated_tip_position_std"].sel(axis="x").values
    time = data["time"].values
    assert std[(time > 3.5) & (time < 4.0)].min() > 3 * std[time < 2.9][-1]
    assert std[-1] < 1.1 * std[time < 2.9][-1]
    assert np.isnan(data["innovation"].sel(reading="tip.angle")).all()
    assert np.isnan(data["innovation"].isel(time=(time > 3.1) & (time < 4.0))).all()
    angle = (late(each)["estimated_tip_angle_std"].values[-1] for each in (data, found))
    assert next(angle) > 1.2 * next(angle)
    # the band has the truth in the gap too
    true = xr.open_dataset(run / "result.nc")["tip_position"].interp(time=time)
    error = np.abs((data["estimated_tip_position"] - true).sel(axis="x").values)
    assert (error < 3 * std)[time > 1.0].all()


@pytest.mark.release
def test_readings_of_one_sensor_other_than_the_tip_will_do(table, tmp_path):
    names = [name for name in table if "(mm)" not in name and "z" not in name]
    table[[name for name in names if name != "angle (rad)"]].to_csv(tmp_path / "log.csv")
    data = crinoid.estimate(HELD, tmp_path / "log.csv")
    tip = np.isfinite(data["innovation"].values)[:, :3]
    assert not tip.any()
    assert data.attrs["readings_used"] > 250


@pytest.mark.release
def test_an_arm_without_inputs_is_observed_too(tmp_path):
    still = HELD.with_values(
        {"base": {"tilt_deg": 90.0}, "control": {"kind": "none"}, "simulation.duration": 2.0}
    )
    crinoid.simulate(still).save(tmp_path)
    data = crinoid.estimate(still, tmp_path)
    true = xr.open_dataset(tmp_path / "result.nc")["tip_position"].interp(time=data["time"])
    error = (data["estimated_tip_position"] - true).values[20:]
    assert np.sqrt(np.nanmean(error**2)) < NOISE
    assert np.isfinite(data["estimated_flow_velocity"]).all()


@pytest.mark.slow
def test_the_command_writes_the_estimate_its_figure_and_its_consistency(run, tmp_path):
    out = tmp_path / "out"
    said = succeeded("estimate", run / "held.toml", run, "--out", out)
    assert "mean normalised innovation squared" in said
    data = xr.open_dataset(out / "estimate.nc")
    assert data["estimated_position"].dims == ("time", "node", "axis")
    assert_shows_something(out / "log_estimate.png")


def noted(data):
    return data.attrs["notes"].splitlines()


@pytest.mark.slow
def test_rows_of_the_tip_count_where_a_log_has_markers(table, tmp_path):
    tip = table[["time", "x (mm)", "z (m)"]].iloc[:50].assign(marker="tip")
    elbow = tip.assign(marker="elbow", **{"x (mm)": 0.5 * tip["x (mm)"]})
    for name, log in {"tip": tip, "both": pd.concat([tip, elbow]).sort_values("time")}.items():
        log.to_csv(tmp_path / f"{name}.csv", index=False)
    alone, both = (crinoid.estimate(HELD, tmp_path / f"{name}.csv") for name in ("tip", "both"))
    xr.testing.assert_equal(alone, both)
    assert "rows of markers other than tip are not read: elbow" in noted(both)
    assert not any("marker" in note for note in noted(alone))
    elbow.to_csv(tmp_path / "elbow.csv", index=False)
    line = mistake(crinoid.estimate, HELD, tmp_path / "elbow.csv")
    assert line == "RECORD: marker has elbow; must have rows of tip"


@pytest.mark.slow
def test_notes_name_inputs_without_commands_and_those_that_the_observer_lacks(table, tmp_path):
    log = table[["time", "x (mm)", "slide.state (m)"]].iloc[:50].assign(tilt=5.0)
    log.drop(columns="tilt").to_csv(tmp_path / "part.csv", index=False)
    notes = noted(crinoid.estimate(HELD, tmp_path / "part.csv"))
    assert "no commands or states of tilt, which count as at rest" in notes
    log.to_csv(tmp_path / "all.csv", index=False)
    sliding = HELD.with_values({"control.lqg": {"inputs": ["slide"]}})
    notes = noted(crinoid.estimate(sliding, tmp_path / "all.csv"))
    assert notes[-1] == "commands and states of tilt are left out: control.lqg.inputs has slide"


@pytest.mark.slow
def test_a_result_that_lacks_commands_has_a_note(run, tmp_path):
    prepared = Prepared(HELD)
    given = HELD, prepared.sensors, prepared.system.inputs
    assert read_readings(run, *given).notes == ()
    coarse = HELD.with_values({"output.interval": 2 * STEP})
    data = xr.load_dataset(run / "result.nc").isel(time=slice(None, None, 2))
    Result(data.assign_attrs(scenario=coarse.to_toml())).save(tmp_path)
    (note,) = read_readings(tmp_path, *given).notes
    assert note.endswith("output.interval of 0.04 s exceeds the control period of 0.02 s")
