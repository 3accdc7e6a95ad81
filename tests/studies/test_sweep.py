"""A sweep: every run once, also when workers die or hang, and its files."""

import errno
import math
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Future
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy import stats

import crinoid
from crinoid.results.metrics import measured, read_rows
from crinoid.results.result import Result
from crinoid.scenario import Scenario
from crinoid.simulation.batch import Arm
from crinoid.studies.sweep import engine
from crinoid.studies.sweep.engine import (
    OtherVersionError,
    Work,
    WorkerPoolError,
    perform,
    run_batches,
)
from crinoid.studies.sweep.plan import SweepDesign, read_plan
from crinoid.studies.sweep.store import SweepStore
from crinoid.studies.sweep.workers import Cluster, Processes
from helpers.command import call, one_line, refused, succeeded
from helpers.signals import usual_signals

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

signals = pytest.fixture(usual_signals, autouse=True)


class Here:
    """Workers that are this process, and return the newest batch first."""

    def __init__(self, number: int = 1, spoil=lambda given: None):
        self.names = {str(index): 1 for index in range(number)}
        self.under: list[tuple[Future, Work]] = []
        self.spoil, self.given, self.replaced = spoil, 0, 0

    def workers(self):
        if self.under:
            future, work = self.under.pop()
            future.set_result(perform(work))
        return dict(self.names)

    def submit(self, worker, work):
        self.given += 1
        future: Future = Future()
        spoilt = self.spoil(self.given)
        if spoilt is None:
            self.under.append((future, work))
        elif spoilt != "hangs":
            future.set_exception(BrokenExecutor(spoilt))
        return future

    def death(self, worker, error):
        return str(error)

    def replace(self, worker):
        del self.names[worker]
        self.names[f"{worker}'"] = 1
        self.replaced += 1

    def close(self):
        self.names = {}


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "arm.toml"
    path.write_text(SCENARIO)
    return path


def sweep(arm: Path, out: Path, *more: str, crew=None, vary=VARY):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("crinoid.cli.sweep.open_pool", lambda *_: crew or Here())
        return call("sweep", arm, *vary, "--out", out, *more)


def swept(arm: Path, out: Path, *more: str, crew=None, vary=VARY) -> str:
    """Return what a sweep prints that must succeed."""
    ended = sweep(arm, out, *more, crew=crew, vary=vary)
    assert ended.exit_code == 0, ended.output
    return ended.stdout


@pytest.fixture(scope="module")
def clean(arm, tmp_path_factory) -> Path:
    """Return the folder of a sweep that nothing disturbed."""
    out = tmp_path_factory.mktemp("sweeps") / "clean"
    swept(arm, out)
    return out


def study(out: Path) -> xr.Dataset:
    return xr.load_dataset(out / "study.nc")


def assert_same(one: Path, other: Path) -> None:
    xr.testing.assert_identical(study(one), study(other))
    assert (one / "cases.csv").read_bytes() == (other / "cases.csv").read_bytes()


def saved(out: Path) -> list[Path]:
    return sorted((out / "batches").glob("*.nc"))


@pytest.mark.slow
def test_a_study_holds_the_numbers_of_each_run(clean):
    data = study(clean)
    assert dict(data.sizes) == {"run": 6, "input": 0}
    np.testing.assert_array_equal(data["run"], range(1, 7))
    np.testing.assert_allclose(data["arm.length"], [0.3, 0.3, 0.45, 0.45, 0.6, 0.6])
    np.testing.assert_array_equal(data["seed"], [0, 1] * 3)
    assert set(data["status"].values) == {"ok"}
    for name, unit in {"rms_error": "m", "work": "J", "arm.length": "m"}.items():
        assert data[name].attrs["units"] == unit
    result = crinoid.simulate(SweepDesign.from_toml(data.attrs["plan"]).case(4))
    numbers = measured(result).numbers
    assert sum(map(math.isfinite, numbers.values())) > 5
    for name, value in numbers.items():
        np.testing.assert_array_equal(value, data[name].sel(run=4))


def test_a_sweep_has_the_table_and_the_page_of_a_study_and_a_file_for_each_batch(clean):
    data, cases = study(clean), [f"case-0{run}" for run in range(1, 7)]
    columns, rows = read_rows(clean / "cases.csv")
    assert columns[:3] == ["case", "arm.length", "seed"]
    assert [row["case"] for row in rows] == cases
    assert [float(row["rms_error"]) for row in rows] == data["rms_error"].values.tolist()
    page = (clean / "report.html").read_text("utf-8")
    assert all(name in page for name in cases)
    assert [path.name for path in saved(clean)] == ["00000.nc", "00001.nc", "00002.nc"]
    batch = xr.load_dataset(saved(clean)[1])
    np.testing.assert_array_equal(batch["run"], [3, 4])
    np.testing.assert_array_equal(batch["rms_error"], data["rms_error"][2:4])


def test_means_over_the_seeds_are_in_a_file(clean):
    columns, rows = read_rows(clean / "means.csv")
    assert columns[:5] == ["arm.length", "measure", "units", "runs", "mean"]
    errors = study(clean)["rms_error"].values
    found = [row for row in rows if row["measure"] == "rms_error"]
    np.testing.assert_allclose([float(row["mean"]) for row in found], errors.reshape(3, 2).mean(1))
    ends = stats.ttest_1samp(errors[:2], 0.0).confidence_interval()
    np.testing.assert_allclose([float(found[0][end]) for end in ("low", "high")], ends)
    assert {row["measure"] for row in rows} > {"max_base_force", "max_strain"}


@pytest.mark.slow
def test_a_sweep_over_shares_of_time_has_extremes_by_return_period(arm, tmp_path):
    weights, out = tmp_path / "scatter.csv", tmp_path / "year"
    text = "arm.length,flow.0.mean.0,share of time\n0.3,0.1,0.9\n0.6,0.2,0.1\n"
    weights.write_text(text)
    vary = ("--weights", weights, "--seeds", "3")
    assert re.search(r"runs +│ 6 ", call("sweep", arm, *vary, "--dry-run").stdout)
    printed = swept(arm, out, vary=vary)
    assert "note: extremes extrapolate 3 seeds of 0.1 s in each case to 100 years" in printed
    data = study(out)
    np.testing.assert_allclose(data["share_of_time"], [0.3] * 3 + [0.1 / 3] * 3)
    np.testing.assert_allclose(data["flow.0.mean.0"], [0.1] * 3 + [0.2] * 3)
    columns, rows = read_rows(out / "extremes.csv")
    assert columns == ["measure", "units", "return_period", "value", "low", "high"]
    found = [float(row["value"]) for row in rows if row["measure"] == "max_error"]
    years = [float(row["return_period"]) for row in rows if row["measure"] == "max_error"]
    assert years == [1.0, 10.0, 50.0, 100.0]
    np.testing.assert_array_equal(found, data["max_error_by_return_period"].sel(estimate="value"))
    assert float(data["max_error"].max()) < found[0] < found[-1]
    weights.write_text(text.replace("0.3,", "0.4,"))
    line = one_line(sweep(arm, out, "--resume", vary=vary))
    assert "--resume: the sweep in" in line
    weights.write_text(text)
    saved(out)[0].unlink()
    swept(arm, out, "--resume", vary=vary)
    xr.testing.assert_identical(study(out), data)
    succeeded("run", "--case", out, "4")
    assert Result.load(out / "case-04").scenario.arm.length == 0.6
    assert "no extremes by return period from 2 seeds" in swept(
        arm, tmp_path / "few", vary=("--weights", weights, "--seeds", "2")
    )


@pytest.mark.release
def test_other_workers_and_batches_give_the_same_study(arm, clean, tmp_path):
    crew = Here(3)
    swept(arm, tmp_path / "other", "--batch", "1", crew=crew)
    assert crew.given == 6
    data, other = study(clean), study(tmp_path / "other")
    data.attrs.pop("plan"), other.attrs.pop("plan")
    xr.testing.assert_identical(data, other)


@pytest.mark.slow
def test_the_worst_run_is_played_again_to_the_bit(arm, clean, tmp_path):
    data = study(clean)
    worst = int(data["rms_error"].values.argmax()) + 1
    shown = sweep(arm, clean, "--resume").stdout  # it is complete: only shown again
    assert f"worst: run {worst} (arm.length = " in shown
    succeeded("run", "--case", clean, worst, "--out", tmp_path / "again")
    result = Result.load(tmp_path / "again")
    for name, value in measured(result).numbers.items():
        np.testing.assert_array_equal(value, data[name].sel(run=worst))
    for arguments, words in (
        ((clean, 7), "--case: got 7; must be a run from 1 to 6"),
        ((clean, 1, "--set", "seed=1"), "--case: excludes SCENARIO"),
        ((tmp_path, 1), "does not exist. Name the folder of a sweep"),
    ):
        assert words in refused("run", "--case", *arguments)


def test_a_run_that_fails_is_a_row(arm, tmp_path):
    vary = ["--vary", "simulation.max_iterations=20,1"]
    ended = sweep(arm, tmp_path / "some", vary=vary)
    assert ended.exit_code == 3
    assert "1 of 2 runs did not reach their end: run 2 failed" in ended.stderr
    data = study(tmp_path / "some")
    assert data["status"].values[0] == "ok"
    assert data["status"].values[1].startswith("failed")
    assert np.isfinite(data["rms_error"].values).tolist() == [True, False]


@pytest.mark.slow
def test_a_batch_is_tried_again_and_fails_in_the_end(arm, clean, tmp_path):
    crew = Here(spoil=lambda given: "its worker died" if given == 2 else None)
    told = swept(arm, tmp_path / "once", crew=crew)
    assert crew.given == 4
    assert re.search(r"note: batch \d of 3 is tried again: its worker died\n[^$]*wrote", told)
    assert_same(clean, tmp_path / "once")
    # the third batch takes its worker with it each time
    plan = read_plan(clean)
    third = plan.values(5)

    class Deadly(Here):
        def submit(self, worker, work):
            self.spoil = lambda given: "its worker died" if third in work.values else None
            return super().submit(worker, work)

    crew = Deadly()
    ended = sweep(arm, tmp_path / "never", crew=crew)
    assert ended.exit_code == 3
    assert crew.given == 5
    data = study(tmp_path / "never")
    assert data["status"].values.tolist() == ["ok"] * 4 + ["failed: its worker died, 3 times"] * 2
    assert np.isnan(data["rms_error"].values[4:]).all()
    xr.testing.assert_identical(data["rms_error"][:4], study(clean)["rms_error"][:4])


@pytest.mark.release
def test_a_batch_that_hangs_is_given_to_another_worker(arm, clean, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "_LEAST", 0.0)
    crew = Here(spoil=lambda given: "hangs" if given == 2 else None)
    swept(arm, tmp_path / "once", crew=crew)
    assert crew.replaced == 1
    assert_same(clean, tmp_path / "once")


@pytest.mark.slow
def test_processes_that_are_killed_are_replaced(clean, tmp_path):
    plan, store = read_plan(clean), SweepStore(tmp_path)
    store.start(plan)
    struck: list[int] = []

    class Struck(Processes):
        """Workers of which the first one dies when it is given its batch."""

        def submit(self, worker, work):
            future = super().submit(worker, work)
            if not struck:
                struck.append(self._all[worker].process.pid)
                os.kill(struck[0], signal.SIGKILL)
            return future

    crew = Struck(2)
    try:
        while not crew.workers():
            time.sleep(0.1)
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


@pytest.mark.slow
def test_a_killed_sweep_is_resumed(arm, clean, tmp_path):
    out = tmp_path / "killed"
    program = "from crinoid.cli import main\nmain()"
    arguments = ["sweep", str(arm), *VARY, "--workers", "1", "--out", str(out)]
    command = [sys.executable, "-c", program, *arguments]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None and not saved(out):
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    there = len(saved(out))
    assert 1 <= there < 3
    crew = Here()
    swept(arm, out, "--resume", crew=crew)
    assert crew.given == 3 - there
    assert_same(clean, out)
    assert not [path for path in out.rglob("*") if path.name.endswith(".unfinished")]


@pytest.mark.release
def test_workers_of_dask_that_die_are_replaced(clean, tmp_path):
    distributed = pytest.importorskip("distributed")
    plan, store = read_plan(clean), SweepStore(tmp_path)
    store.start(plan)
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    )
    crew, killed = Cluster(cluster.scheduler_address), []
    submit = crew.submit

    def strike(worker, work):
        future = submit(worker, work)
        if not killed:
            killed.append(worker)
            nanny = next(iter(cluster.workers.values()))
            os.kill(nanny.pid, signal.SIGKILL)
        return future

    crew.submit = strike
    try:
        assert run_batches(plan, store, crew, set(), lambda saved: None, lambda: False)
    finally:
        crew.close()
        cluster.close()
    store.collect(plan)
    assert_same(clean, tmp_path)


FULL = OSError(errno.ENOSPC, "No space left on device", "there")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (None, "interrupted: "),
        (FULL, "there: No space left"),
        (WorkerPoolError("the scheduler at tcp://far:8786 went away"), "tcp://far:8786 went away"),
    ],
    ids=["Ctrl-C", "full disk", "no scheduler"],
)
def test_a_sweep_that_ends_early_says_so_and_is_resumed(arm, clean, tmp_path, error, words):
    class Spoilt(Here):
        def submit(self, worker, work):
            future = super().submit(worker, work)
            if self.given == 2 and error is None:
                signal.raise_signal(signal.SIGINT)
            return future

        def workers(self):
            if self.given == 2 and error is not None:
                raise error
            return super().workers()

    line = one_line(sweep(arm, tmp_path, crew=Spoilt()), 3 if error else 130)
    assert words in line
    assert "1 of 3 batches is saved, --resume goes on from there" in line
    assert not (tmp_path / "study.nc").exists()
    swept(arm, tmp_path, "--resume")
    assert_same(clean, tmp_path)


@pytest.mark.slow
def test_force_replaces_a_sweep_and_a_damaged_batch_is_run_again(arm, clean, tmp_path):
    out = tmp_path / "damaged"
    swept(arm, out, "--set", "arm.radius=0.01")
    swept(arm, out, "--force")
    assert_same(clean, out)
    saved(out)[1].write_bytes(saved(out)[1].read_bytes()[:1000])
    crew = Here()
    swept(arm, out, "--resume", crew=crew)
    assert crew.given == 1
    assert_same(clean, out)


def test_another_plan_is_refused_and_nothing_is_changed(arm, clean):
    def contents():
        return {path: path.read_bytes() for path in clean.rglob("*") if path.is_file()}

    before = contents()
    for more, words in (
        (("--resume", "--vary", "arm.radius=0.01,0.02"), "of another plan (varied differs)"),
        (("--resume", "--set", "arm.nodes=5"), "of another plan (scenario differs)"),
        (("--resume", "--batch", "5"), "of another plan (batch differs)"),
        ((), "contains plan.toml already"),
    ):
        assert words in one_line(sweep(arm, clean, *more))
    assert "contains a sweep" in refused("run", arm, "--out", clean)
    assert contents() == before


def test_a_dry_run_estimates_and_writes_nothing(arm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    vary = ("--vary", "arm.length=0.3:0.6:50", "--seeds", 20)
    shown = succeeded("sweep", arm, *vary, "--dry-run").splitlines()
    lines = {line.strip("│ ").partition("│")[0].strip(): line for line in shown}
    seconds = float(lines["time of a run"].split("│")[2].split()[0])
    workers, hours = (float(lines[name].split("│")[2]) for name in ("workers", "hours"))
    assert hours == pytest.approx(1000 * seconds / 3600 / workers, rel=0.02)
    assert list(tmp_path.iterdir()) == []


def test_a_worker_refuses_work_of_another_version():
    scenario = Scenario.from_toml(SCENARIO).to_toml()
    with pytest.raises(OtherVersionError, match=r"the sweep is 0\.0\.1"):
        perform(Work(scenario, [{}], version="0.0.1"))
    (row,) = perform(Work(scenario, [{"arm.length": -1.0}]))
    assert row == Arm(None, "refused: arm.length: got -1.0; must be a number above 0 (m)", [])
