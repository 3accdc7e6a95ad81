"""Readers of other packages: they come first, and what is wrong with them is said in one line."""

from importlib.metadata import EntryPoint

import numpy as np
import pytest
import xarray as xr

from crinoid.recording import read_dataset, readers
from helpers.measured import M_PER_S, measured, recorded
from helpers.refusals import mistake, refusal

TIME = np.datetime64("2024-03-01T06:00:00", "ns") + np.arange(40) * np.timedelta64(500, "ms")
SPEED = np.linspace(0.2, 0.4, TIME.size)


class Log:
    """A reader of files that begin with LOG; what it returns may be replaced."""

    def __init__(self, found=None):
        self.found = found

    def reads(self, file, head):
        return head.startswith(b"LOG")

    def read(self, file):
        if isinstance(self.found, Exception):
            raise self.found
        return self.found


def record(time=TIME):
    return xr.Dataset({"u": ("time", SPEED, M_PER_S)}, {"time": time})


@pytest.fixture
def package(monkeypatch):
    """Return a function that installs a reader, or an entry point to what is not there."""

    def install(reader=None):
        class Entry(EntryPoint):
            def load(self):
                return super().load() if reader is None else reader

        entry = Entry("log", "nowhere.to:be", "crinoid.readers")
        known = {"readers": {"log": entry}}
        monkeypatch.setattr(readers, "installed", lambda group: known[group])

    return install


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("LOG\n")
    return path


def test_a_reader_of_a_package_comes_first(package, log):
    package(Log(record()))
    found = recorded(measured(log, velocity=["u", "0"]))
    np.testing.assert_allclose(found.time, 0.5 * np.arange(TIME.size), rtol=1e-15)
    np.testing.assert_array_equal(found.velocity[:, 0, 0], SPEED)


def test_other_files_go_to_the_readers_of_crinoid(package, log):
    package(Log(record()))
    log.write_text("time (s),u (m/s)\n0,0.1\n1,0.2\n")
    assert read_dataset(str(log))["u"].values.tolist() == [0.1, 0.2]


def test_dates_must_not_be_missing(package, log):
    package(Log(record(np.where(np.arange(TIME.size) == 7, np.datetime64("NaT"), TIME))))
    assert "has an entry without a date" in refusal(measured(log, velocity=["u", "0"]))


@pytest.mark.parametrize(
    ("reader", "line"),
    [
        (None, " fails: No module named 'nowhere'"),
        (Log(ValueError("line 3\nis odd")), " cannot read a.csv (line 3 is odd)"),
        (Log(), " returns NoneType; must return an xarray.Dataset"),
    ],
)
def test_a_reader_that_is_broken_is_named(package, log, reader, line):
    package(reader)
    start = "file: the reader log of the installed package nowhere.to:be"
    assert mistake(read_dataset, str(log)) == start + line
