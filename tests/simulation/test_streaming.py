"""Runs that are written while they last: what the disk holds can be continued at any time."""

import contextlib
import errno
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.cli.folder import claimed
from crinoid.foundation.result_variables import large_names, numbers
from crinoid.results.result import Result, ResultError
from crinoid.results.stream import is_stream, open_lazily, read_checkpoint
from crinoid.scenario import Scenario, ScenarioError
from crinoid.simulation import play
from crinoid.simulation import run as running
from crinoid.simulation import sink as sinking
from crinoid.simulation.sink import require_space
from helpers.command import succeeded
from helpers.loops import assert_listed, of_loop
from helpers.made_results import made_result
from helpers.streams import grown, instants, state


def test_a_file_that_grows_holds_all_instants_to_the_bit(tmp_path):
    stream = grown(tmp_path / "result.nc")
    whole = instants(0, 209)
    for found in (stream.dataset(), open_lazily(tmp_path / "result.nc")):
        for name, variable in whole.variables.items():
            np.testing.assert_array_equal(found[name].values, variable.values, str(name))
        assert found["position"].attrs == {"units": "m"}
        piece = found.isel(time=slice(100, 103)).load()
        np.testing.assert_array_equal(piece["position"], whole["position"][100:103])
        np.testing.assert_array_equal(found["position"][-1, :, 1], whole["position"][-1, :, 1])
    xr.testing.assert_identical(stream.dataset().load(), whole)  # kinds of numbers as well
    with xr.open_dataset(tmp_path / "result.nc", engine="scipy") as read:  # any netCDF reader
        np.testing.assert_array_equal(read["position"], whole["position"])


def test_a_file_has_its_own_checkpoint_and_run_time(tmp_path):
    path = tmp_path / "result.nc"
    grown(path, (4,))
    data = open_lazily(path)
    found = read_checkpoint(path, data)
    assert data.attrs["wall_time"] == 0.5
    assert found.keys() == state(9).keys()
    for name, leaf in state(9).items():
        np.testing.assert_array_equal(found[name], leaf)
        assert found[name].dtype == leaf.dtype
    grown(path, ())  # another run takes its place, with its checkpoint
    assert len(list(tmp_path.iterdir())) == 2
    assert read_checkpoint(path, open_lazily(path))["state.steps"] == 5


def test_an_instant_that_is_half_written_does_not_count(tmp_path):
    path = tmp_path / "result.nc"
    stream = grown(path)
    with path.open("ab") as file:
        file.write(b"half an instant")
    assert open_lazily(path).sizes["time"] == 209
    stream.append(instants(209, 212))
    assert open_lazily(path).sizes["time"] == 209  # nor does it before it is on the disk
    stream.keep(state(212), 1.0)
    np.testing.assert_array_equal(open_lazily(path)["position"], instants(0, 212)["position"])


def test_a_file_that_claims_more_than_it_can_hold_is_refused(tmp_path):
    path = made_result(Scenario(arm={"nodes": 5})).save(tmp_path)[0]
    with netCDF4.Dataset(path, "a") as file:
        file.createDimension("large", 10**9)
        file.createVariable("claimed", "f8", ("large",), chunksizes=(100,))
    with pytest.raises(ResultError, match=r"have 80000\d+ bytes, more than it can hold"):
        Result.load(tmp_path)


def test_numbers_of_a_replaced_file_are_not_read(tmp_path):
    path = tmp_path / "result.nc"
    data = grown(path).dataset()
    instants(0, 9).to_netcdf(path)
    assert not is_stream(path)
    with pytest.raises(OSError, match="no longer there"):
        data["position"].load()
    np.testing.assert_array_equal(data["tip_angle"], -np.arange(209.0))  # small: in memory


@contextlib.contextmanager
def written_at_each_step() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sinking, "_EVERY", -1.0)
        patch.setattr(running, "_CHUNK_SECONDS", 0.0)
        yield


MEMORY = {
    "arm.relaxation": [{"ratio": 0.3, "time": 0.05}],
    "water.vortices": {"model": "synchronisation"},
}
"""Elements whose memory a checkpoint must have."""


def scenario(duration: float = 0.3) -> crinoid.Scenario:
    values = {"simulation__duration": duration, "simulation__start": "rest"}
    return of_loop(**values, output__interval=0.02).with_values(MEMORY)


BARE = scenario().with_values({"output.variables": ["curvature"]})
BOTH = ["result.nc", "uncontrolled.nc"]


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def put(files: dict[str, bytes], folder: Path) -> None:
    """Make a folder hold some files and no others."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)


def same(mine: Result, other: Result) -> None:
    for run, as_ in ((mine, other), (mine.uncontrolled, other.uncontrolled)):
        xr.testing.assert_identical(
            *(each.dataset.assign_attrs(wall_time=0.0) for each in (run, as_))
        )
        for name, leaf in as_.checkpoint.items():
            np.testing.assert_array_equal(run.checkpoint[name], leaf, name)


@pytest.fixture(scope="module")
def whole() -> Result:
    return crinoid.simulate(scenario())


@pytest.fixture(scope="module")
def snapshots(tmp_path_factory) -> list[dict[str, bytes]]:
    """The files of a run at each instant at which a program that is killed leaves others."""
    folder = tmp_path_factory.mktemp("run")
    found: list[dict[str, bytes]] = []

    def taken(*_: object) -> None:
        files = {path.name: path.read_bytes() for path in folder.iterdir()}
        if not found or files != found[-1]:
            found.append(files)

    def after(function):
        def called(*arguments, **options):
            taken()
            result = function(*arguments, **options)
            taken()
            return result

        return called

    with pytest.MonkeyPatch.context() as patch, written_at_each_step():
        for owner, name in ((os, "fsync"), (Path, "replace"), (Path, "unlink"), (Path, "chmod")):
            patch.setattr(owner, name, after(getattr(owner, name)))
        play(Prepared(scenario()), into=folder).save(folder)
    taken()
    return found


@pytest.mark.slow
def test_a_run_on_the_disk_equals_that_in_memory(whole, tmp_path):
    with written_at_each_step():
        run = play(Prepared(scenario()), into=tmp_path)
    assert is_stream(tmp_path / "result.nc")
    same(run, whole)
    run.save(tmp_path)
    same(Result.load(tmp_path), whole)
    same(Result.load(tmp_path, lazily=True), whole)
    assert names(tmp_path) == BOTH


@pytest.mark.slow
def test_a_run_that_is_killed_leaves_a_result_and_a_checkpoint_at_each_instant(
    snapshots, whole, tmp_path
):
    assert len(snapshots) > 80
    reached = 0
    some = sorted(random.Random(5).sample(range(len(snapshots)), 40))
    for files in [snapshots[0], *(snapshots[number] for number in some), snapshots[-1]]:
        put(files, tmp_path)
        if "result.nc" not in files:
            assert not reached
            continue
        result = Result.load(tmp_path)
        for run, as_ in ((result, whole), (result.uncontrolled, whole.uncontrolled)):
            if run is None:
                continue
            count = run.dataset.sizes["time"]
            expected = as_.dataset.isel(time=slice(count))
            for name in ("time", "position", "energy", "reynolds_number"):
                np.testing.assert_array_equal(run.dataset[name], expected[name], name)
            steps = int(run.checkpoint["steps"])
            assert 0 <= steps // 2 <= count - 1 <= (steps + 2) // 2
        steps = int(result.checkpoint["steps"])
        assert steps >= reached
        reached = steps
    assert reached == 30


@pytest.mark.slow
def test_a_run_that_was_killed_at_any_instant_continues_to_the_bit(snapshots, whole, tmp_path):
    started = [files for files in snapshots if "result.nc" in files]
    chosen = random.Random(4).sample(started, 4)
    # the one without control is in its final form and the other is not; then both are
    kinds = [{name: file[:3] == b"CDF" for name, file in files.items()} for files in started]
    for grows in ({"result.nc": True, "uncontrolled.nc": False}, {"result.nc": False}):
        chosen.append(next(f for f, k in zip(started, kinds, strict=True) if k | grows == k))
    assert any("checkpoint" in name for name in chosen[-1])
    for files in chosen:
        put(files, tmp_path)
        with claimed(tmp_path):
            earlier = Result.load(tmp_path, lazily=True)
            play(Prepared(scenario()), resume=earlier, into=tmp_path).save(tmp_path)
        same(Result.load(tmp_path), whole)
        assert names(tmp_path) == BOTH


def test_a_file_without_its_checkpoint_is_read_but_not_continued(snapshots, tmp_path):
    put({"result.nc": snapshots[len(snapshots) // 3]["result.nc"]}, tmp_path)
    result = Result.load(tmp_path)
    assert result.status.startswith("unfinished")
    with pytest.raises(ResultError, match="holds no state"):
        play(Prepared(scenario()), resume=result)


def test_a_disk_that_fills_up_stops_a_run_and_loses_nothing_written(whole, tmp_path, monkeypatch):
    written = 0

    def fsync(handle: int) -> None:
        nonlocal written
        written += 1
        if written == 20:
            raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched, written_at_each_step():
        patched.setattr(os, "fsync", fsync)
        with pytest.raises(OSError, match="No space left on device"):
            play(Prepared(scenario()), into=tmp_path)
    earlier = Result.load(tmp_path, lazily=True)
    assert 2 < earlier.dataset.sizes["time"] < 16
    play(Prepared(scenario()), resume=earlier, into=tmp_path).save(tmp_path)
    same(Result.load(tmp_path), whole)


def test_a_result_has_no_strings_with_which_netcdf4_crashes_where_it_is_open_twice(whole, tmp_path):
    whole.save(tmp_path)
    with xr.open_dataset(tmp_path / "result.nc") as data, netCDF4.Dataset(data.encoding["source"]):
        same(Result.load(tmp_path), whole)
    with netCDF4.Dataset(tmp_path / "result.nc") as file:
        assert str not in {each.dtype for each in file.variables.values()}


def test_a_result_has_the_listed_variables(whole):
    without = ("obstacles", "bodies", "solids", "actuators", "lines", "tool", "vehicle")
    without += ("estimate", "self", "hull")
    there, sizes = assert_listed(whole.dataset, without), whole.dataset.sizes
    kept = sum(v.nbytes for v in whole.dataset.data_vars.values() if "time" in v.dims)
    assert kept == 8 * sizes["time"] * numbers(there.values(), sizes)


def test_a_finished_run_leaves_out_unwanted_variables(whole, tmp_path):
    with written_at_each_step():
        play(Prepared(BARE), into=tmp_path).save(tmp_path)
    found = Result.load(tmp_path)
    for one, all_ in ((found, whole), (found.uncontrolled, whole.uncontrolled)):
        left = set(all_.dataset.data_vars) - set(one.dataset.data_vars)
        assert left == set(large_names(2, without=["estimate", "self", "hull"])) - {"curvature"}
        for name in one.dataset.data_vars:
            np.testing.assert_array_equal(one.dataset[name], all_.dataset[name], str(name))
    assert found.notes == whole.notes
    longer = BARE.with_values({"simulation.duration": 0.4})
    with pytest.raises(ResultError, match=r"position, which output\.variables may have left out"):
        play(Prepared(longer), resume=found)


def test_a_run_that_is_interrupted_keeps_all_variables(whole):
    wishes = iter([False, True, True, True])
    with written_at_each_step():
        part = play(Prepared(BARE), stop=lambda: next(wishes))
    assert part.interrupted
    assert set(part.dataset.data_vars) >= set(large_names(2, without=["estimate", "self", "hull"]))
    rest = play(Prepared(BARE), resume=part)
    assert set(rest.dataset.data_vars) & set(
        large_names(2, without=["estimate", "self", "hull"])
    ) == {"curvature"}
    np.testing.assert_array_equal(rest.dataset["curvature"], whole.dataset["curvature"])


def test_a_run_too_large_for_memory_or_the_disk_is_refused(tmp_path, monkeypatch):
    large = of_loop(arm__nodes=101, simulation__duration=5000.0, output__interval=0.02)
    line = r"output\.interval: keeps 250001 instants of 101 nodes, which need about "
    with pytest.raises(ScenarioError, match=line + r"13 GB of memory; must fit into 8 GB"):
        require_space(large, None)
    alone = large.with_values({"control.compare": False, "simulation.duration": 4000.0})
    require_space(alone, None)
    require_space(large, tmp_path / "new")  # on the disk there is room
    disk = shutil.disk_usage(tmp_path)._replace(free=10**9)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: disk)
    line += rf"7.\d* GB on the disk of {tmp_path}; must fit into 1 GB"
    with pytest.raises(ScenarioError, match=line):
        require_space(large, tmp_path / "new")


@pytest.mark.slow
def test_a_command_that_is_killed_is_resumed(tmp_path):
    (tmp_path / "arm.toml").write_text(scenario(3.0).to_toml())
    program = (
        "import crinoid.simulation.sink as sink, crinoid.simulation.run as run\n"
        "sink._EVERY, run._CHUNK_SECONDS = -1.0, 0.0\n"
        "from crinoid.cli import main\n"
        "main()"
    )
    out = tmp_path / "killed"
    arguments = ["run", str(tmp_path / "arm.toml"), "--out", str(out)]
    command = [sys.executable, "-c", program, *arguments]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None and not is_stream(out / "result.nc"):
            time.sleep(0.01)
        time.sleep(0.3)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    assert 0 < open_lazily(out / "result.nc").sizes["time"] < 151
    succeeded(*arguments, "--resume")
    same(Result.load(out), crinoid.simulate(scenario(3.0)))
    assert names(out) == sorted(["report.html", "summary.csv", "summary.json", *BOTH])
