"""Many runs as one dataset: each is that of `simulate`, in threads and together under vmap."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import crinoid
import crinoid.studies.batch
from crinoid.control import Controller
from crinoid.results.metrics import MEASURES, measured
from crinoid.scenario import Scenario
from crinoid.simulation import setup
from crinoid.simulation.batch import run_batch

SCENARIO = crinoid.Scenario(
    title="a batch",
    arm={"nodes": 5, "youngs_modulus": 1e6},
    base={"channels": {"tilt": {}}},
    flow=[{"kind": "uniform", "velocity": [0.2, 0.0]}],
    load=[{"kind": "tip", "force": [0.0, 0.0], "start": 0.095}],
    sensor={"noise_position": 1e-3},
    control={"kind": "pid", "controlled": ["z"], "pid": {"tilt": {"kp": 0.5, "ki": 2.0}}},
    simulation={"duration": 0.2, "max_halvings": 0},
    output={"interval": 0.05, "variables": ["position"]},
)
BREAKS = -1e5
"""Force along the arm (N) that folds any."""
OVER = {
    "arm.youngs_modulus": [1e6, 2e6, 1e6],
    "load.0.force": [[0.0, 0.0], [0.0, 0.1], [BREAKS, 0.0]],
}


@pytest.fixture(scope="module")
def batch():
    return crinoid.simulate_batch(SCENARIO, OVER, [3, 4], records=True)


@pytest.mark.slow
def test_each_run_is_that_of_simulate_to_the_bit(batch):
    values = {"arm.youngs_modulus": 2e6, "load.0.force": [0.0, 0.1], "seed": 4}
    alone = crinoid.simulate(SCENARIO.with_values(values))
    found = batch.isel(run=3)
    expected = measured(alone)
    for name in MEASURES:
        np.testing.assert_array_equal(found[name], expected.numbers[name], name)
    assert found["effort"].sel(driven="tilt") == expected.speed["tilt"] > 0
    for name in ("tip_position", "position", "energy", "natural_frequency"):
        np.testing.assert_array_equal(found[name], alone.dataset[name], name)
    assert len(set(batch["rms_error"].values[:4])) == 4


@pytest.mark.slow
def test_seeds_change_fastest_and_varied_keys_are_coordinates(batch, tmp_path):
    assert batch.sizes["run"] == 6
    assert batch["seed"].values.tolist() == [3, 4, 3, 4, 3, 4]
    assert batch["arm.youngs_modulus"].values.tolist() == [1e6, 1e6, 2e6, 2e6, 1e6, 1e6]
    assert batch["arm.youngs_modulus"].attrs["units"] == "Pa"
    assert batch["load.0.force"].values[2].tolist() == [0.0, 0.1]
    assert batch["rms_error"].attrs["units"] == "m"
    assert batch["position"].dims == ("run", "time", "node", "axis")
    assert batch["arc_length"].dims == ("node",)  # the same in all
    assert "velocity" not in batch  # [output] does not ask for it
    assert Scenario.from_toml(batch.attrs["scenario"]) == SCENARIO
    batch.to_netcdf(tmp_path / "batch.nc")
    xr.testing.assert_identical(xr.load_dataset(tmp_path / "batch.nc"), batch.load())


def test_a_failed_run_is_reported_and_masked_after_its_end(batch):
    words = batch["status"].values.tolist()
    assert words[:4] == ["ok"] * 4
    assert all(each.startswith("failed at t = 0.09 s") for each in words[4:])
    assert batch.attrs["status"] == "failed: 2 of 6 runs did not reach their end"
    assert np.isfinite(batch["rms_error"][:4]).all()
    assert np.isnan(batch["rms_error"][4:]).all()
    assert np.isfinite(batch["tip_position"][:4]).all()
    late, tip = batch["time"].values > 0.09, batch["tip_position"].values
    assert np.isnan(tip[4:, late]).all()
    np.testing.assert_array_equal(tip[4:, ~late], tip[:2, ~late])
    assert batch["newton_iterations"].dtype == float


@pytest.mark.release
def test_runs_together_as_on_an_accelerator_are_those_in_threads(batch, monkeypatch):
    monkeypatch.setattr(crinoid.studies.batch, "run_batch", partial(run_batch, together=True))
    together = crinoid.simulate_batch(SCENARIO, OVER, [3, 4], records=True)
    assert batch.attrs == together.attrs
    assert set(batch.variables) == set(together.variables)
    for name, values in batch.variables.items():
        found = together[name].values
        if values.dtype.kind != "f":
            assert found.tolist() == values.values.tolist(), name
        elif name != "residual":  # round-off of the last iteration
            scale = np.nanmax(np.abs(values.values), initial=0.0)
            np.testing.assert_allclose(found, values, atol=1e-10 * scale, rtol=0, err_msg=name)
    ours, theirs = batch["residual"].values, together["residual"].values
    np.testing.assert_array_equal(np.isnan(ours), np.isnan(theirs))


class Elsewhere(Controller):
    """Computes its command in Python, where no batch can follow."""

    def start(self, seen):
        return jnp.zeros(())

    def command(self, memory, seen):
        shape = jax.ShapeDtypeStruct(seen.command.shape, seen.command.dtype)
        grows = lambda time: np.full(shape.shape, 0.01 * time)  # noqa: E731
        return jax.pure_callback(grows, shape, seen.time), memory


@pytest.mark.release
def test_controllers_that_cannot_be_batched_run_in_threads(monkeypatch):
    monkeypatch.setattr(setup, "build_controller", lambda plan, parts: Elsewhere())
    case = SCENARIO.with_values({"control.kind": "none", "simulation.duration": 0.1})
    (found,) = run_batch([case], lambda result: result.dataset, together=True)
    assert found.status == "ok"
    expected = 0.01 * found.taken["time"][-2:].values - 1e-4
    np.testing.assert_allclose(found.taken["base_command"].sel(channel="tilt")[-2:], expected)


def test_a_stopped_batch_returns_its_complete_runs():
    done = []
    how = {"threads": 1, "report": done.append, "stop": lambda: bool(done)}
    found = crinoid.simulate_batch(SCENARIO, seeds=5, **how)
    unfinished = found["status"] == "interrupted before its end"
    assert unfinished.any()
    assert np.isnan(found["rms_error"][unfinished]).all()
    assert found.attrs["status"].startswith("interrupted: ")
    assert done[-1].duration == pytest.approx(5 * 0.2)


@pytest.mark.slow
def test_a_measure_of_a_package_is_in_the_batch_and_its_fault_is_a_status(tmp_path, monkeypatch):
    (tmp_path / "reefs.py").write_text(
        "def reach(run):\n"
        "    most = run['tip_position'].max()\n"
        "    return most if run.attrs['seed'] == 3 else run['time'].values\n"
        "reach.units = 'm'\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    own = SCENARIO.with_values({"output.measures": ["reefs:reach"]})
    found = crinoid.simulate_batch(own, seeds=[3, 4], records=True)
    assert found["reach"].attrs["units"] == "m"
    assert found["reach"].values[0] == found["tip_position"].values[0].max()
    assert np.isnan(found["reach"].values[1])
    assert found["status"].values[0] == "ok"
    assert (
        "refused: output.measures.0: reach of the run returned an array"
        in found["status"].values[1]
    )
