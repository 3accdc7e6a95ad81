"""A sweep: every run once, whatever happens to workers, and what comes of it in files."""

import errno
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import crinoid
from crinoid.batch.measures import measured
from crinoid.cases import read_rows
from crinoid.cli import sweeping
from crinoid.result import Result
from crinoid.scenario import Scenario
from crinoid.sweep import CrewError, Plan, SweepStore, engine, run_batches
from crinoid.sweep.cluster import Cluster
from crinoid.sweep.crew import Ended
from crinoid.sweep.processes import Processes
from crinoid.sweep.work import OtherVersionError, Row, Work, perform
from test_cli import call

SCENARIO = """
title = "a sway"
[arm]
nodes = 4
[[flow]]
kind = "gauss-markov"
mean = [0.1, 0.0]
standard_deviation = [0.05, 0.05]
correlation_time = 0.2
[simulation]
duration = 0.1
"""
VARY = ["--vary", "arm.length=0.3:0.6:3", "--seeds", "2", "--batch", "2"]


class Here:
    """Workers that are this process, and give what they have found last first."""

    def __init__(self, number: int = 1, spoil=lambda given: None):
        self.idle = {str(index): 1 for index in range(number)}
        self.under: list[tuple[str, Work]] = []
        self.spoil, self.given, self.replaced = spoil, 0, 0

    def workers(self):
        return dict(self.idle)

    def give(self, worker, work):
        del self.idle[worker]
        self.given += 1
        self.under.append((worker, work, self.spoil(self.given)))

    def ended(self, seconds):
        found = []
        for worker, work, spoilt in reversed(self.under):
            if spoilt == "hangs":
                continue
            self.under.remove((worker, work, spoilt))
            self.idle[worker] = 1
            rows = None if spoilt else perform(work)
            found.append(Ended(worker, rows, spoilt or ""))
        return found

    def replace(self, worker):
        self.under = [each for each in self.under if each[0] != worker]
        self.idle[f"{worker}'"] = 1
        self.replaced += 1

    def close(self):
        self.idle = {}


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "arm.toml"
    path.write_text(SCENARIO)
    return path


def sweep(arm: Path, out: Path, *more: str, crew=None):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sweeping, "open_crew", lambda hands: Here() if crew is None else crew)
        return call("sweep", arm, *VARY, "--out", out, *more)


@pytest.fixture(scope="module")
def clean(arm, tmp_path_factory) -> Path:
    """Return the folder of a sweep that nothing disturbed."""
    out = tmp_path_factory.mktemp("sweeps") / "clean"
    ended = sweep(arm, out)
    assert ended.exit_code == 0, ended.output
    return out


def study(out: Path) -> xr.Dataset:
    return xr.open_zarr(out / "study.zarr", consolidated=False).load()


def assert_same(one: Path, other: Path) -> None:
    xr.testing.assert_identical(study(one), study(other))
    assert (one / "cases.csv").read_bytes() == (other / "cases.csv").read_bytes()


def saved(out: Path) -> list[Path]:
    return sorted((out / "batches").glob("*.nc"))


# --- what comes of it --------------------------------------------------------------------------


def test_a_study_holds_what_each_run_gives(clean):
    data = study(clean)
    assert dict(data.sizes) == {"run": 6, "input": 0}
    np.testing.assert_array_equal(data["run"], range(1, 7))
    np.testing.assert_allclose(data["arm.length"], [0.3, 0.3, 0.45, 0.45, 0.6, 0.6])
    np.testing.assert_array_equal(data["seed"], [0, 1] * 3)
    assert set(data["status"].values) == {"ok"}
    assert data["rms_error"].attrs["units"] == data["deflection"].attrs["units"] == "m"
    assert data["settling_time"].attrs["units"] == "s"
    assert data["work"].attrs["units"] == "J"
    assert data["arm.length"].attrs["units"] == "m"
    result = crinoid.simulate(Plan.from_toml(data.attrs["plan"]).case(4))
    told = measured(result).numbers
    assert sum(map(math.isfinite, told.values())) > 5
    for name, value in told.items():
        np.testing.assert_array_equal(value, data[name].sel(run=4))


def test_the_table_is_that_of_a_study(clean):
    columns, rows = read_rows(clean / "cases.csv")
    assert columns[:3] == ["case", "arm.length", "seed"]
    assert [row["case"] for row in rows] == [f"case-0{run}" for run in range(1, 7)]
    data = study(clean)
    assert [float(row["rms_error"]) for row in rows] == data["rms_error"].values.tolist()


def test_a_sweep_has_the_page_of_a_study(clean):
    page = (clean / "report.html").read_text("utf-8")
    for name in [f"case-0{run}" for run in range(1, 7)]:
        assert name in page


def test_batches_are_files_of_their_own(clean):
    assert [path.name for path in saved(clean)] == ["00000.nc", "00001.nc", "00002.nc"]
    with xr.open_dataset(saved(clean)[1]) as batch:
        np.testing.assert_array_equal(batch["run"], [3, 4])
        np.testing.assert_array_equal(batch["rms_error"], study(clean)["rms_error"][2:4])


def test_other_workers_and_batches_give_the_same_study(arm, clean, tmp_path):
    crew = Here(3)
    ended = sweep(arm, tmp_path / "other", "--batch", "1", crew=crew)
    assert ended.exit_code == 0, ended.output
    assert crew.given == 6
    data, other = study(clean), study(tmp_path / "other")
    data.attrs.pop("plan"), other.attrs.pop("plan")
    xr.testing.assert_identical(data, other)


def test_without_zarr_the_study_is_a_netcdf_file(arm, clean, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    ended = sweep(arm, tmp_path / "plain")
    assert ended.exit_code == 0, ended.output
    assert "note: Zarr is not installed" in ended.stdout
    monkeypatch.undo()
    with xr.open_dataset(tmp_path / "plain" / "study.nc") as data:
        for name, values in study(clean).variables.items():
            np.testing.assert_array_equal(data[name].values, values.values)


def test_the_worst_run_is_played_again_to_the_bit(arm, clean, tmp_path):
    data = study(clean)
    worst = int(data["rms_error"].values.argmax()) + 1
    told = sweep(arm, clean, "--resume").stdout  # all of it is there: only told again
    assert f"worst: run {worst} (arm.length = " in told
    assert f"crinoid run --case {clean} {worst}" in told
    ended = call("run", "--case", clean, worst, "--out", tmp_path / "again")
    assert ended.exit_code == 0, ended.output
    result = Result.load(tmp_path / "again")
    for name, value in measured(result).numbers.items():
        np.testing.assert_array_equal(value, data[name].sel(run=worst))
    for arguments, said in (
        (("--case", clean, 7), "--case: got 7, takes a run from 1 to 6"),
        (("--case", clean, 1, "--set", "seed=1"), "--case: takes no SCENARIO"),
        (("--case", tmp_path, 1), "there is none; takes the folder of a sweep"),
    ):
        ended = call("run", *arguments)
        assert (ended.exit_code, len(ended.stderr.splitlines())) == (2, 1)
        assert said in ended.stderr


def test_a_run_that_fails_is_a_row(arm, tmp_path):
    vary = ["--vary", "simulation.max_iterations=20,1"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sweeping, "open_crew", lambda hands: Here())
        ended = call("sweep", arm, *vary, "--out", tmp_path / "some")
    assert ended.exit_code == 3
    assert "1 of 2 runs did not reach their end: run 2 failed" in ended.stderr
    data = study(tmp_path / "some")
    assert data["status"].values[0] == "ok"
    assert data["status"].values[1].startswith("failed")
    assert np.isfinite(data["rms_error"].values).tolist() == [True, False]


# --- what happens to workers -------------------------------------------------------------------


def test_a_batch_is_tried_again_and_fails_in_the_end(arm, clean, tmp_path):
    crew = Here(spoil=lambda given: "its worker died" if given == 2 else None)
    ended = sweep(arm, tmp_path / "once", crew=crew)
    assert ended.exit_code == 0, ended.output
    assert crew.given == 4
    assert_same(clean, tmp_path / "once")
    # the third batch takes its worker with it each time
    plan = SweepStore(clean).read_plan()
    third = plan.values(5)

    class Deadly(Here):
        def give(self, worker, work):
            self.spoil = lambda given: "its worker died" if third in work.values else None
            super().give(worker, work)

    crew = Deadly()
    ended = sweep(arm, tmp_path / "never", crew=crew)
    assert ended.exit_code == 3
    assert crew.given == 5
    data = study(tmp_path / "never")
    assert data["status"].values.tolist() == ["ok"] * 4 + ["failed: its worker died, 3 times"] * 2
    assert np.isnan(data["rms_error"].values[4:]).all()
    kept = study(clean).isel(run=slice(4))
    xr.testing.assert_identical(data.isel(run=slice(4))["rms_error"], kept["rms_error"])


def test_a_batch_that_hangs_is_given_to_another_worker(arm, clean, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "_LEAST", 0.0)
    crew = Here(spoil=lambda given: "hangs" if given == 2 else None)
    ended = sweep(arm, tmp_path / "once", crew=crew)
    assert ended.exit_code == 0, ended.output
    assert crew.replaced == 1
    assert_same(clean, tmp_path / "once")


def test_processes_that_are_killed_are_replaced(clean, tmp_path):
    plan, store = SweepStore(clean).read_plan(), SweepStore(tmp_path)
    store.begin(plan)
    struck: list[int] = []

    class Struck(Processes):
        """Workers of which the first one dies when it is given its batch."""

        def give(self, worker, work):
            super().give(worker, work)
            if not struck:
                struck.append(self._all[worker].process.pid)
                os.kill(struck[0], signal.SIGKILL)

    crew = Struck(2)
    try:
        while not crew.workers():
            crew.ended(1.0)
        hung = next(iter(crew.workers()))
        process = crew._all[hung].process
        os.kill(process.pid, signal.SIGSTOP)
        crew.replace(hung)
        assert process.exitcode == -signal.SIGKILL
        done: set[int] = set()
        assert run_batches(plan, store, crew, done, lambda saved: None, lambda: False)
    finally:
        crew.close()
    assert struck
    assert done == {0, 1, 2}
    store.collect(plan)
    assert_same(clean, tmp_path)


def test_a_killed_sweep_is_resumed(arm, clean, tmp_path):
    out = tmp_path / "killed"
    program = "from crinoid.cli import main\nmain()"
    arguments = ["sweep", str(arm), *VARY, "--workers", "1", "--out", str(out)]
    with subprocess.Popen(
        [sys.executable, "-c", program, *arguments], stdout=subprocess.DEVNULL
    ) as command:
        while command.poll() is None and not saved(out):
            time.sleep(0.01)
        command.send_signal(signal.SIGKILL)
    assert command.returncode == -signal.SIGKILL
    there = len(saved(out))
    assert 1 <= there < 3
    crew = Here()
    ended = sweep(arm, out, "--resume", crew=crew)
    assert ended.exit_code == 0, ended.output
    assert crew.given == 3 - there
    assert_same(clean, out)
    assert not [path for path in out.rglob("*") if path.name.endswith(".unfinished")]


def test_workers_of_dask_that_die_are_replaced(clean, tmp_path):
    plan, store = SweepStore(clean).read_plan(), SweepStore(tmp_path)
    store.begin(plan)
    crew = Cluster(1)
    killed: list[str] = []
    give = crew.give

    def strike(worker, work):
        give(worker, work)
        if not killed:
            killed.append(worker)
            nanny = next(iter(crew._own.workers.values()))
            os.kill(nanny.pid, signal.SIGKILL)

    crew.give = strike
    try:
        assert run_batches(plan, store, crew, set(), lambda saved: None, lambda: False)
    finally:
        crew.close()
    store.collect(plan)
    assert_same(clean, tmp_path)


# --- ends before the end -----------------------------------------------------------------------


def test_ctrl_c_saves_and_is_resumed(arm, clean, tmp_path):
    out = tmp_path / "stopped"
    crew = Here(spoil=lambda given: given == 2 and os.kill(os.getpid(), signal.SIGINT))
    ended = sweep(arm, out, crew=crew)
    assert ended.exit_code == 130
    assert "interrupted: 1 of 3 batches is saved, --resume goes on from there" in ended.stderr
    assert not (out / "study.zarr").exists()
    assert sweep(arm, out, "--resume").exit_code == 0
    assert_same(clean, out)


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (OSError(errno.ENOSPC, "No space left on device", "there"), "there: No space left"),
        (CrewError("the scheduler at tcp://far:8786 went away"), "tcp://far:8786 went away"),
    ],
    ids=["full disk", "no scheduler"],
)
def test_a_sweep_that_cannot_go_on_says_so_and_is_resumed(arm, clean, tmp_path, error, told):
    out = tmp_path / "stopped"

    class Spoilt(Here):
        def ended(self, seconds):
            if self.given == 2:
                raise error
            return super().ended(seconds)

    ended = sweep(arm, out, crew=Spoilt())
    assert ended.exit_code == 3
    (line,) = ended.stderr.splitlines()
    assert told in line
    assert "1 of 3 batches is saved, --resume goes on from there" in line
    assert sweep(arm, out, "--resume").exit_code == 0
    assert_same(clean, out)


def test_a_damaged_batch_is_run_again(arm, clean, tmp_path):
    out = tmp_path / "damaged"
    assert sweep(arm, out).exit_code == 0
    saved(out)[1].write_bytes(saved(out)[1].read_bytes()[:1000])
    crew = Here()
    assert sweep(arm, out, "--resume", crew=crew).exit_code == 0
    assert crew.given == 1
    assert_same(clean, out)


# --- what is refused ---------------------------------------------------------------------------


def test_another_plan_is_refused_and_nothing_is_changed(arm, clean):
    before = {path: path.read_bytes() for path in clean.rglob("*") if path.is_file()}
    for more, told in (
        (("--resume", "--vary", "arm.radius=0.01,0.02"), "of another plan (varied differs)"),
        (("--resume", "--set", "arm.nodes=5"), "of another plan (scenario differs)"),
        (("--resume", "--batch", "5"), "of another plan (batch differs)"),
        ((), "holds plan.toml already"),
    ):
        ended = sweep(arm, clean, *more)
        assert ended.exit_code == 2, ended.output
        (line,) = ended.stderr.splitlines()
        assert told in line
    ended = call("run", arm, "--out", clean)
    assert ended.exit_code == 2
    assert "holds a sweep" in ended.stderr
    assert {path: path.read_bytes() for path in clean.rglob("*") if path.is_file()} == before


def test_force_replaces_a_sweep(arm, clean, tmp_path):
    assert sweep(arm, tmp_path, "--set", "arm.radius=0.01").exit_code == 0
    assert sweep(arm, tmp_path, "--force").exit_code == 0
    assert_same(clean, tmp_path)


def test_mistakes_are_told_before_anything_is_written(arm, tmp_path):
    out = tmp_path / "none"
    for arguments, told in (
        (["--vary", "arm.lenth=1,2"], "arm.lenth: unknown key; did you mean arm.length?"),
        (["--vary", "arm.length=0.5:-0.5:2"], "arm.length: got -0.5, takes a number above 0"),
        (["--vary", "arm.nodes=5:8:3"], "arm.nodes: got 5.0, takes a whole number"),
        (["--workers", "0"], "--workers: got 0"),
        (["--workers", "2", "--scheduler", "tcp://far:1"], "--workers: takes no --scheduler"),
        (["--dry-run", "--resume"], "--dry-run: takes no --resume"),
        (["--vary", "seed=1,2", "--seeds", "2"], "--seeds: takes no other values of seed"),
    ):
        ended = call("sweep", arm, *arguments, "--out", out)
        assert ended.exit_code == 2
        (line,) = ended.stderr.splitlines()
        assert told in line
        assert not out.exists()


def test_a_dry_run_estimates_and_writes_nothing(arm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ended = call("sweep", arm, "--vary", "arm.length=0.3:0.6:50", "--seeds", 20, "--dry-run")
    assert ended.exit_code == 0, ended.output
    lines = {line.strip("│ ").partition("│")[0].strip(): line for line in ended.stdout.splitlines()}
    assert "1000" in lines["runs"]
    assert "200 of up to 5 runs" in lines["batches"]
    assert "timed: the first run, whole" in lines["time of a run"]
    seconds = float(lines["time of a run"].split("│")[2].split()[0])
    workers, hours = (float(lines[name].split("│")[2]) for name in ("workers", "hours"))
    assert hours == pytest.approx(1000 * seconds / 3600 / workers, rel=0.02)
    assert list(tmp_path.iterdir()) == []


def test_a_worker_refuses_work_of_another_version():
    scenario = Scenario.from_toml(SCENARIO).to_toml()
    with pytest.raises(OtherVersionError, match=r"the sweep is 0\.0\.1"):
        perform(Work(scenario, [{}], version="0.0.1"))
    (row,) = perform(Work(scenario, [{"arm.length": -1.0}]))
    assert row == Row.without("refused: arm.length: got -1.0, takes a number above 0 (m)")
