"""Datasets in place of files: each becomes one file that the scenario names."""

import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from crinoid.scenario import Scenario
from helpers.measured import enu, measured, point, recorded
from helpers.refusals import mistake


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Return the folder of the written files."""
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache" / "crinoid" / "records"


@pytest.fixture
def dataset(tmp_path):
    point(tmp_path / "a.nc")
    with xr.open_dataset(tmp_path / "a.nc", decode_times=False) as opened:
        return opened.load()


def with_file(file, **keys):
    return Scenario(
        water={"depth": 20.0},
        flow=[{"kind": "measured", "file": file, **keys}],
        simulation={"duration": 10.0},
    )


def test_a_dataset_plays_as_its_file_does(tmp_path, folder, dataset):
    found, known = recorded(with_file(dataset)), recorded(with_file(str(tmp_path / "a.nc")))
    np.testing.assert_array_equal(found.time, known.time)
    np.testing.assert_array_equal(found.velocity, known.velocity)
    assert found.notes == known.notes


def test_dates_of_a_dataset_are_played(dataset):
    moments = np.datetime64("2024-03-01", "ns") + (1e9 * dataset.time).astype("m8[ns]").values
    # mhkit leaves such an attribute on dates
    dated = dataset.assign_coords(time=("time", moments, {"units": "seconds since 1970-01-01"}))
    found, known = recorded(with_file(dated)), recorded(with_file(dataset))
    np.testing.assert_allclose(found.time, known.time, atol=1e-9)
    np.testing.assert_array_equal(found.velocity, known.velocity)
    assert dated.time.attrs


def test_a_dataset_is_written_once_and_under_a_name_of_its_content(folder, dataset):
    first = with_file(dataset).flow[0].file
    status = Path(first).stat()
    time.sleep(1 - time.time() % 1)  # HDF5 writes the second into a file
    assert with_file(dataset.copy(deep=True)).flow[0].file == first
    assert Path(first).stat() == status
    assert [str(path) for path in folder.iterdir()] == [first]
    other = with_file(dataset.assign(u=2 * dataset.u))
    assert other.flow[0].file != first
    renamed = with_file(dataset.assign_attrs(title="another"))
    assert renamed.flow[0].file != first
    assert len(list(folder.iterdir())) == 3


def test_a_scenario_with_a_dataset_is_a_text(dataset):
    case = with_file(dataset)
    assert Scenario.from_toml(case.to_toml()) == case
    np.testing.assert_array_equal(
        recorded(Scenario.from_toml(case.to_toml())).velocity, recorded(case).velocity
    )


def test_values_may_be_a_dataset(tmp_path, dataset):
    case = measured(tmp_path / "a.nc")
    faster = case.with_values({"flow.0.file": dataset.assign(u=2 * dataset.u)})
    u = enu(recorded(case).time)[0]
    np.testing.assert_allclose(recorded(faster).velocity[:, 0, 0], 2 * u, rtol=1e-12)


def test_a_dataset_that_cannot_be_written_is_refused(tmp_path, dataset):
    line = mistake(with_file, dataset.assign_attrs(moored=None))
    assert line.startswith("flow.0.file: the dataset cannot be written as netCDF (Invalid value")
    assert mistake(with_file, 3) == "flow.0.file: got 3; must be the path of a CSV or netCDF file"
    (tmp_path / "cache").write_text("a file where the folder should be")
    assert "the dataset cannot be written: " in mistake(with_file, dataset)
