"""Saving by the command line: files, refusals, and the fate of files from before.

No test here computes a motion: `Player` stands for the simulation.
"""

import contextlib
import errno
import json
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import filelock
import numpy as np
import pytest
import xarray as xr

from crinoid.cli import study
from crinoid.cli.finding import finding, write_page
from crinoid.cli.folder import _APART
from crinoid.cli.interruption import Interrupted, Interruption
from crinoid.foundation.atomic_file import atomic_write, remove_unfinished
from crinoid.results.result import Result
from crinoid.results.result_file import attributes
from crinoid.results.stream import open_lazily
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.view.figures import write_report
from crinoid.view.figures.book import _FINDINGS
from crinoid.view.page.parts import PAGE, save_page
from helpers.command import call, one_line, refused, succeeded
from helpers.made_results import Player, case_rows, made_result
from helpers.signals import usual_signals
from helpers.streams import grown

SMALL = """
title = "small"
[arm]
nodes = 5
[simulation]
duration = 1.0
"""
STUDY = SMALL + '[vary]\n"arm.length" = [0.4, 0.5, 0.6]\n'
RUN = ("run", "small.toml", "--out", "out")
RUN_STUDY = ("run", "study.toml", "--out", "out")

signals = pytest.fixture(usual_signals, autouse=True)


@pytest.fixture
def player(monkeypatch) -> Player:
    player = Player()
    monkeypatch.setattr("crinoid.cli.run.play", player)
    return player


def blank_page(folder: Path) -> Path:
    return save_page('<meta name="generator" content="crinoid">', folder / PAGE)


@pytest.fixture
def here(tmp_path, monkeypatch, player) -> Path:
    # pages take longer than all else here
    monkeypatch.setattr("crinoid.cli.finding.write_page", blank_page)
    monkeypatch.chdir(tmp_path)
    # where a run is saved whose folder takes no more
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    (tmp_path / "small.toml").write_text(SMALL)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def small() -> Result:
    return made_result(Scenario.from_toml(SMALL))


def interrupted() -> Result:
    return made_result(Scenario.from_toml(SMALL), 0.5, "interrupted at t = 0.5 s")


def no_space(path: object) -> OSError:
    return OSError(errno.ENOSPC, "No space left on device", str(path))


OF_A_RUN = ["result.nc", "summary.csv", "summary.json"]


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def names(folder: Path) -> list[str]:
    """Names of what is in a folder, but for the page of a run."""
    return sorted(path.name for path in folder.iterdir() if path.name != PAGE)


@pytest.fixture(scope="module")
def figures(tmp_path_factory) -> Path:
    """Return a folder of the figures of a run, drawn once."""
    run, figures = (tmp_path_factory.mktemp(name) for name in ("run", "figures"))
    small().save(run)
    write_report(run, figures)
    return figures


@pytest.fixture
def small_disk(tmp_path):
    """A device of 200 kB, where we may mount one."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(disk)]
    try:
        subprocess.run(mount, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("only root may mount a small disk, and not everywhere")
    yield disk
    subprocess.run(["umount", "--lazy", str(disk)], check=True)


def test_a_full_disk_costs_nothing_that_was_computed(here, small_disk, monkeypatch):
    rest = np.random.default_rng(0).random(60_000)  # does not compress

    def large(scenario: Scenario) -> Result:
        result = made_result(scenario)
        result.dataset["rest"] = ("rest", rest)
        return result

    monkeypatch.setattr("helpers.made_results.made_result", large)
    line = one_line(call("run", "small.toml", "--out", small_disk / "out"), 3)
    assert "No space left on device" in line
    (saved,) = here.glob("crinoid-*")
    assert f"what was computed is saved in {saved} instead" in line
    np.testing.assert_array_equal(Result.load(saved).dataset["rest"], rest)
    assert not list(small_disk.rglob("*.nc*"))


def test_a_search_that_cannot_be_written_is_saved_elsewhere(here, monkeypatch):
    write = Path.write_text

    def full(path: Path, *arguments: object) -> int:
        if path.parent.name == "out":
            raise no_space(path)
        return write(path, *arguments)

    monkeypatch.setattr(Path, "write_text", full)
    monkeypatch.setattr("crinoid.cli.finding.write_report", lambda path: [])
    data = xr.Dataset({"found": ("trial", [1.0, 2.0])})
    place = here / "out" / "tune.nc"
    scenario = Scenario.from_toml(SMALL)
    files = {"tuned.toml": "x = 1", "mark": lambda path: path.touch()}
    with finding(scenario, place, "a tuning", force=False, doubts=False) as found:
        shutil.rmtree(place.parent)  # it is made again
        with pytest.raises(OSError, match="saved in") as caught:
            found.save(data, files)
    (saved,) = here.glob("crinoid-*")
    assert str(caught.value.strerror).endswith(f"what was computed is saved in {saved} instead")
    assert sorted(contents(saved)) == ["mark", "tune.nc", "tuned.toml"]
    xr.testing.assert_identical(xr.load_dataset(saved / "tune.nc"), data)


def test_a_name_that_netcdf_cannot_take_is_refused_before_the_run(here, player):
    line = one_line(call("run", "small.toml", "--out", "caf\udce9"))
    assert re.match(r"crinoid: .*/caf.+: must be text in utf-8, as netCDF needs it\. Ch", line)
    assert not player.played
    with pytest.raises(OSError, match="surrogates not allowed"):
        small().save(here / "caf\udce9")


def test_a_run_that_cannot_be_written_says_what_was_written_before(here, player):
    def fill(number: int) -> None:
        if number == 2:
            grown(here / "out" / "result.nc")
        raise no_space("out")

    player.between = fill
    line = one_line(call(*RUN), 3)
    assert line == "crinoid: out: No space left on device; nothing of the run could be written"
    assert not (here / "out").exists()
    line = one_line(call(*RUN), 3)
    assert "what was written before is in out, --resume goes on from there" in line
    assert open_lazily(here / "out" / "result.nc").sizes["time"] == 209


@pytest.mark.parametrize(
    ("runs", "end"), [(True, "nothing"), (False, "what was computed is saved in")]
)
def test_a_study_ends_at_a_case_that_cannot_be_written(here, player, monkeypatch, runs, end):
    save = Result.save

    def fill(number: int) -> None:
        if number == 2:
            raise no_space("out/case-02")

    def full(result: Result, folder: Path) -> list[Path]:
        if folder.name == "case-02":
            raise no_space(folder)
        return save(result, folder)

    if runs:
        player.between = fill
    else:
        monkeypatch.setattr(Result, "save", full)
    line = one_line(call(*RUN_STUDY), 3)
    assert line.startswith(f"crinoid: case-02: out/case-02: No space left on device; {end}")
    assert [row["case"] for row in case_rows(here / "out")] == ["case-01"]
    assert len(player.played) == 2


def test_a_run_grows_in_another_folder_than_a_finished_result(here, player):
    player.between = lambda _: grown(player.into[-1] / "result.nc")
    for _ in range(2):
        assert call(*RUN).exit_code == 0
    assert [path.name for path in player.into] == ["out", "out-unfinished"]
    assert names(here) == ["out", "small.toml", "study.toml"]
    assert names(here / "out") == OF_A_RUN


def broken(*_: object, **__: object) -> None:
    raise RuntimeError("NetCDF: HDF error")


def test_a_half_of_a_pair_is_reported_where_the_rest_is_lost(here, monkeypatch):
    monkeypatch.setenv("HOME", str(here / "home"))
    (here / "home").mkdir()

    def half(result: Result, folder: Path) -> list[Path]:
        if folder.parent in room:
            return save(result, folder)
        if folder.name.startswith("crinoid-"):
            folder.joinpath("uncontrolled.nc").write_bytes(whole)
        raise no_space(folder)

    save = Result.save
    room: list[Path] = []
    small().save(here / "other")
    whole = (here / "other" / "result.nc").read_bytes()
    monkeypatch.setattr(Result, "save", half)
    line = one_line(call(*RUN), 3)
    parts = [next(folder.glob("crinoid-*/*.nc")) for folder in (here, here / "home")]
    assert f"only {parts[0]} and {parts[1]} could be saved, the rest is lost" in line
    # nothing of a half is left where another folder takes the whole
    for part in parts:
        part.unlink()
        part.parent.rmdir()
    room.append(here / "home")
    line = one_line(call(*RUN), 3)
    (saved,) = (here / "home").iterdir()
    assert f"what was computed is saved in {saved} instead" in line
    assert not list(here.glob("crinoid-*"))


def test_a_run_that_fits_nowhere_is_lost_and_leaves_an_earlier_one(here, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr("xarray.Dataset.to_netcdf", broken)
        line = one_line(call(*RUN), 3)
    assert "out: NetCDF: HDF error; what was computed could be saved nowhere" in line
    assert not (here / "out").exists()
    assert call(*RUN).exit_code == 0
    before = (here / "out" / "result.nc").read_bytes()
    monkeypatch.setattr("xarray.Dataset.to_netcdf", broken)
    assert call(*RUN).exit_code == 3
    assert (here / "out" / "result.nc").read_bytes() == before
    assert names(here / "out") == OF_A_RUN


def test_a_folder_in_use_is_refused_until_it_is_free(here):
    (here / "out").mkdir()
    code = (
        "import filelock, sys, time\n"
        "lock = filelock.FileLock('out/.crinoid.lock'); lock.acquire()\n"
        "print('held', flush=True); time.sleep(60)"
    )
    held = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    try:
        assert held.stdout is not None
        assert held.stdout.readline() == "held\n"
        assert "out is in use by another crinoid process" in refused(*RUN)
        assert not (here / "out" / "result.nc").exists()
    finally:
        held.kill()  # the system lets go of the lock of a process that is killed
        held.wait()
    assert call(*RUN).exit_code == 0
    assert names(here / "out") == OF_A_RUN


@pytest.mark.parametrize(
    ("raised", "goes_on"),
    [
        (NotImplementedError(), True),
        (OSError(errno.ENOTSUP, "not supported"), True),
        (OSError(errno.EROFS, "Read-only file system"), False),
    ],
)
def test_file_systems_without_locks_and_without_writing(here, monkeypatch, raised, goes_on):
    def acquire(*_: object, **__: object) -> None:
        raise raised

    monkeypatch.setattr(filelock.FileLock, "acquire", acquire)
    if goes_on:
        assert call(*RUN).exit_code == 0
        assert names(here / "out") == OF_A_RUN
    else:
        assert refused(*RUN) == "crinoid: out: Read-only file system"
        assert not (here / "out").exists()


def test_a_run_removes_what_a_killed_one_left_unfinished(here, tmp_path):
    with atomic_write(here / "result.nc") as temporary:
        assert temporary.name in names(here)
        remove_unfinished(here / "result.nc")
        assert names(here) == ["small.toml", "study.toml"]
        temporary.write_text("whole")
    assert "result.nc" in names(here)
    (here / "out").mkdir()
    (here / "out" / ".result.nc.abcd1234.unfinished").write_text("half a result")
    (here / "out" / ".result.nc.dcba4321.unfinished").mkdir()
    (here / "out" / ".result.nc.20260101").write_text("no name that crinoid gives")
    assert call(*RUN).exit_code == 0
    kept = [".result.nc.20260101", ".result.nc.dcba4321.unfinished", *OF_A_RUN]
    assert names(here / "out") == kept


def test_a_finished_result_of_another_scenario_is_not_replaced(here, player):
    assert call(*RUN).exit_code == 0
    assert call(*RUN).exit_code == 0
    other = (*RUN, "--set", "arm.length=0.7")
    line = refused(*other)
    assert "out/result.nc is a finished result of another scenario (arm.length differs)." in line
    assert "--force" in line
    assert Result.load(here / "out").scenario.arm.length == 0.5
    assert len(player.played) == 2
    assert call(*other, "--force").exit_code == 0
    assert Result.load(here / "out").scenario.arm.length == 0.7
    # an interrupted one of another scenario is no loss, one of the same is worth a word
    interrupted().save(here / "out")
    assert "Use --resume to continue it" in call(*RUN).stdout
    interrupted().save(here / "out")
    assert call(*other).exit_code == 0


@pytest.mark.parametrize("status", ["interrupted at t = 0.5 s", "failed at t = 0.5 s: a hit"])
def test_a_finished_result_is_not_lost_to_a_run_that_ends_early(here, monkeypatch, figures, status):
    assert call(*RUN).exit_code == 0
    shutil.copytree(figures, here / "out", dirs_exist_ok=True)
    before = contents(here / "out")

    def ends(*_: object, **__: object) -> Result:
        return made_result(Scenario.from_toml(SMALL), 0.5, status)

    code = 130 if status.startswith("interrupted") else 3
    with monkeypatch.context() as patched:
        patched.setattr("crinoid.cli.run.play", ends)
        assert status in one_line(call("run", "small.toml", "--out", "first"), code)
        assert Result.load(here / "first").status == status
        for folder in ("out-unfinished", "out-unfinished-2"):
            line = one_line(call(*RUN), code)
            text = f"{status}; saved in {folder}; the finished result in out is kept"
            assert line == f"crinoid: {text}"
            assert Result.load(here / folder).status == status
        assert contents(here / "out") == before
        # also in the current folder
        monkeypatch.chdir(here / "out")
        assert "out-unfinished-3" in one_line(call("run", "../small.toml", "--out", "."), code)
        assert contents(here / "out") == before
        # but a run that is prolonged has it in itself
        monkeypatch.chdir(here)
        long = made_result(Scenario.from_toml(SMALL.replace("1.0", "2.0")), 1.5, status)
        patched.setattr("crinoid.cli.run.play", lambda *_, **__: long)
        one_line(call(*RUN, "--set", "simulation.duration=2.0", "--resume"), code)
    assert Result.load(here / "out").status == status
    assert not (here / "out-unfinished-4").exists()


def test_a_finished_case_is_not_lost_to_one_that_ends_early(here, player):
    player.between = lambda number: number != 5 or signal.raise_signal(signal.SIGTERM)
    assert call(*RUN_STUDY).exit_code == 0
    line = one_line(call(*RUN_STUDY), 130)
    assert "interrupted in case-02; --resume goes on from there" in line
    assert "is in out/case-02-unfinished, its finished result is kept" in line
    assert Result.load(here / "out" / "case-02").status == "ok"
    assert Result.load(here / "out" / "case-02-unfinished").status == "interrupted at t = 0.5 s"
    # the table still has what the folders hold
    rows = [(row["directory"], row["status"]) for row in case_rows(here / "out")]
    assert rows == [("case-01", "ok"), ("case-02", "ok"), ("case-03", "ok")]
    assert call(*RUN_STUDY, "--resume").exit_code == 0
    assert len(player.played) == 5


def test_the_table_keeps_the_rows_of_cases_that_are_not_run_again_yet(here, player):
    table = here / "out" / "cases.csv"
    assert call(*RUN_STUDY).exit_code == 0
    whole = table.read_text()
    # what is not of the same case, or gone, is no row of this study
    rows = whole.splitlines()
    table.write_text("\n".join([*rows[:3], rows[3].replace("case-03", "case-04")]) + "\n")
    (here / "out" / "case-02" / "result.nc").unlink()
    player.played.clear()
    player.between = lambda number: number == 1 or signal.raise_signal(signal.SIGTERM)
    assert call(*RUN_STUDY).exit_code == 130
    found = [(row["case"], row["status"][:11]) for row in case_rows(here / "out")]
    assert found == [("case-01", "ok"), ("case-02", "interrupted")]
    player.between = lambda _: None
    assert call(*RUN_STUDY).exit_code == 0
    assert table.read_text() == whole


@pytest.mark.parametrize("name", [*OF_A_RUN, "uncontrolled.nc"])
def test_a_file_of_the_users_is_not_replaced_unless_forced(here, player, name):
    (here / "out").mkdir()
    (here / "out" / name).write_text("mine")
    for command in ("run", "equilibrium"):
        line = refused(command, "small.toml", "--out", "out")
        assert f"out/{name} was not written by crinoid, or cannot be read" in line
        assert "--force" in line
    assert names(here / "out") == [name]
    assert not player.played
    assert call(*RUN, "--force").exit_code == 0
    assert names(here / "out") == OF_A_RUN


def test_a_run_leaves_nothing_of_another_and_all_of_the_users(here, figures):
    out, mine = here / "out", small()
    mine.uncontrolled = small()
    mine.save(out)
    shutil.copytree(figures, out, dirs_exist_ok=True)
    assert len(names(out)) > 5
    assert attributes(out / "uncontrolled.nc")
    (out / "notes.md").write_text("mine")
    (out / "photo.png").write_bytes(b"\x89PNG of the users")
    (out / "tip_error.png").unlink()
    (out / "tip_error.png").write_bytes(b"\x89PNG of the users as well")
    assert call(*RUN).exit_code == 0
    assert names(out) == ["notes.md", "photo.png", *OF_A_RUN, "tip_error.png"]


@pytest.mark.slow
def test_a_run_writes_its_page_over_its_own_only(here, monkeypatch):
    monkeypatch.setattr("crinoid.cli.finding.write_page", write_page)
    page = here / "out" / PAGE
    assert f"wrote out/{PAGE}" in succeeded(*RUN)
    assert "<h1>small</h1>" in page.read_text("utf-8")
    assert call(*RUN_STUDY, "--force").exit_code == 0
    assert "study of " in page.read_text("utf-8")
    assert (here / "out" / "case-01" / PAGE).is_file()
    assert call(*RUN, "--force").exit_code == 0
    assert call(*RUN).exit_code == 0
    page.write_text("mine")
    assert f"no page: out/{PAGE}: not written by crinoid" in succeeded(*RUN)
    assert page.read_text() == "mine"
    assert f"out/{PAGE}: not written by crinoid" in refused("report", "out")


def test_a_smaller_study_a_run_and_a_study_replace_each_other_wholly(here):
    assert call(*RUN_STUDY).exit_code == 0
    (here / "out" / "case-03" / "mine.txt").write_text("mine")
    for arguments, lost, left in (
        ((*RUN_STUDY, "--set", "vary={'arm.length'=[0.4]}"), "case-02", ["case-01", "cases.csv"]),
        (RUN, "case-01", OF_A_RUN),
        (
            RUN_STUDY,
            "result.nc",
            ["case-01", "case-02", "cases.csv", "means.csv", "means.png"],
        ),
    ):
        assert lost in refused(*arguments)
        assert call(*arguments, "--force").exit_code == 0
        assert names(here / "out") == sorted(["case-03", *left])
        case = names(here / "out" / "case-03")
        assert case == ["mine.txt", *OF_A_RUN * (arguments is RUN_STUDY)]


@pytest.mark.slow
def test_links_are_replaced_and_not_followed(here):
    out = here / "out"
    out.mkdir()
    for name in ("cases.csv", "result.nc", "shape.png"):
        (here / name).write_text("precious")
        (out / name).symlink_to(here / name)
    assert "out/cases.csv was not written by crinoid" in refused(*RUN_STUDY)
    assert call(*RUN_STUDY, "--force").exit_code == 0
    assert call("report", out / "case-01", "--out", out).exit_code == 0
    for name in ("cases.csv", "result.nc", "shape.png"):
        assert (here / name).read_text() == "precious"
    assert not (out / "cases.csv").is_symlink()
    assert not (out / "shape.png").is_symlink()
    # nor does a copy of a scenario follow one
    (here / "still-water.toml").symlink_to(here / "elsewhere")
    assert "already there" in refused("scenarios", "--copy", "still-water")
    assert not (here / "elsewhere").exists()


BROKEN = {
    "no wall_time": (lambda data: data.attrs.pop("wall_time") and data, "not say its wall_time"),
    "no position": (lambda data: data.drop_vars("position"), "it has no position"),
    "no travel": (lambda data: data.drop_vars("channel_lower"), "it has no channel_lower"),
    "energy in words": (lambda data: data.assign(energy=data["energy"].astype(str)), "its energy"),
    "no names of axes": (lambda data: data.drop_vars("axis"), "it has no axis over axis"),
    "no instant": (lambda data: data.isel(time=slice(0)), "it holds no instant"),
    "no TOML": (lambda data: data.assign_attrs(scenario="= ="), "cannot be read: not valid TOML"),
    "another scenario": (lambda data: data.assign_attrs(scenario="seed = 3"), "(title, seed, "),
}


@pytest.mark.parametrize("status", ["ok", "interrupted at t = 0.5 s"])
@pytest.mark.parametrize(("tamper", "reason"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_result_is_not_continued_and_stays(here, player, tamper, reason, status):
    broken = made_result(Scenario.from_toml(SMALL), status=status)
    broken.dataset = tamper(broken.dataset)
    broken.save(here / "out")
    before = (here / "out" / "result.nc").read_bytes()
    line = refused(*RUN, "--resume")
    assert line.startswith("crinoid: --resume: ")
    assert reason in line
    assert not player.played
    assert (here / "out" / "result.nc").read_bytes() == before


def test_a_cut_file_is_not_continued(here):
    interrupted().save(here / "out")
    path = here / "out" / "result.nc"
    content = path.read_bytes()
    for size in (0, 1000, 20_000):
        path.write_bytes(content[:size])
        line = refused(*RUN, "--resume")
        assert "out/result.nc: not a result of crinoid" in line
        assert "Errno" not in line


@pytest.mark.slow
def test_a_case_that_is_refused_is_named_and_the_others_are_run(here, player, caplog):
    def refuse(number: int) -> None:
        if number == 2:
            raise ScenarioError([Mistake("control.pid.tilt", "does nothing")])

    player.between = refuse
    line = one_line(call(*RUN_STUDY), 3)
    assert line == "crinoid: case-02: refused: control.pid.tilt: does nothing"
    first, second, third = case_rows(here / "out")
    assert first["status"] == third["status"] == "ok"
    assert second["status"] == "refused: control.pid.tilt: does nothing"
    assert second["rms_error"] == ""
    assert float(third["rms_error"]) > 0
    assert call("report", "out").exit_code == 0
    assert not caplog.records  # nothing of matplotlib's that only it understands
    # in a run by itself it is a mistake, and no folder is left behind
    player.between = lambda number: refuse(2)
    assert "control.pid.tilt" in refused("run", "small.toml", "--out", "alone/deep")
    assert not (here / "alone").exists()


def test_completed_cases_are_not_run_again(here, player):
    player.between = lambda number: number != 2 or signal.raise_signal(signal.SIGTERM)
    line = one_line(call(*RUN_STUDY), 130)
    assert line == "crinoid: interrupted in case-02; --resume goes on from there"
    assert len(player.played) == 2
    assert call(*RUN_STUDY, "--resume").exit_code == 0
    assert [each.arm.length for each in player.played[2:]] == [0.5, 0.6]
    rows = case_rows(here / "out")
    assert [row["status"] for row in rows] == ["ok"] * 3
    errors = [float(row["rms_error"]) for row in rows]
    assert errors == pytest.approx([errors[0] * length / 0.4 for length in (0.4, 0.5, 0.6)])
    # and a run that is complete is only shown
    assert call("run", "small.toml", "--out", "one").exit_code == 0
    assert "is complete" in succeeded("run", "small.toml", "--out", "one", "--resume")
    assert len(player.played) == 5
    # which writes what a run that was killed at its end lacks
    (here / "one" / "summary.json").unlink()
    assert "wrote one/summary.json" in succeeded("run", "small.toml", "--out", "one", "--resume")
    assert json.loads((here / "one" / "summary.json").read_text())["status"] == "ok"
    assert len(player.played) == 5


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_stop_a_run_that_is_saved_however_often_they_come(here, player, name):
    number = getattr(signal, name)
    earlier = signal.getsignal(number)
    player.between = lambda _: [signal.raise_signal(number) for _ in range(3)]
    line = one_line(call(*RUN), 130)
    assert line.startswith("crinoid: interrupted at t = 0.5 s; the run so far is saved")
    assert Result.load(here / "out").status == "interrupted at t = 0.5 s"
    assert signal.getsignal(number) == earlier


def test_a_signal_while_saving_lets_the_result_be_saved(here, monkeypatch):
    save = Result.save

    def interrupted(result: Result, folder: Path) -> list[Path]:
        signal.raise_signal(signal.SIGINT)
        return save(result, folder)

    monkeypatch.setattr(Result, "save", interrupted)
    assert call(*RUN).exit_code == 0
    assert Result.load(here / "out").status == "ok"
    # of a study the cases that are left wait
    line = one_line(call("run", "study.toml", "--out", "cases"), 130)
    assert "interrupted before case-02; --resume goes on from there" in line


def test_a_signal_while_the_table_is_written_waits_until_it_is(here, monkeypatch):
    assert call(*RUN_STUDY).exit_code == 0
    write, written = study.metrics.write_rows, []

    def interrupted(path: Path, rows: list[dict[str, object]]) -> None:
        written.append(len(rows))
        if len(written) == 2:
            signal.raise_signal(signal.SIGINT)
        write(path, rows)

    monkeypatch.setattr(study.metrics, "write_rows", interrupted)
    ended = call(*RUN_STUDY, "--resume")
    assert "interrupted before case-03; --resume goes on from there" in one_line(ended, 130)
    assert "wrote out/cases.csv" in ended.stdout
    assert [row["status"] for row in case_rows(here / "out")] == ["ok"] * 3
    assert written == [3, 3]


def test_a_signal_before_there_is_anything_to_save_stops_at_once(here, monkeypatch):
    def set_up(*_: object, **__: object) -> None:
        signal.raise_signal(signal.SIGHUP)
        raise AssertionError("not stopped")

    monkeypatch.setattr("crinoid.cli.run.play", set_up)
    for file in ("small.toml", "study.toml"):
        line = one_line(call("run", file, "--out", "out"), 130)
        assert line == "crinoid: interrupted before there was anything to save"
        assert not (here / "out").exists()


@pytest.mark.parametrize(
    ("name", "delay"), [("SIGINT", 0.0), ("SIGHUP", 0.1), ("SIGTERM", 0.3), ("SIGINT", 0.3)]
)
def test_a_signal_while_the_program_loads_is_one_line(here, name, delay):
    # as soon as the program has started: before that the interpreter itself speaks
    code = (
        "import signal, sys, threading, os\n"
        "import crinoid.cli\n"
        "heed = crinoid.cli.heed\n"
        "def heeded():\n"
        "    heed()\n"
        f"    threading.Timer({delay}, os.kill, (os.getpid(), signal.{name})).start()\n"
        "crinoid.cli.heed = heeded\n"
        "sys.argv = ['crinoid', 'run', 'small.toml', '--out', 'out']\n"
        "crinoid.cli.main()\n"
    )
    command = [sys.executable, "-c", code]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 130
    line = r"crinoid: interrupted( before there was anything to save)?\n"
    assert re.fullmatch(line, ended.stderr)
    assert not (here / "out").exists()


def test_a_wish_to_stop_that_was_lost_on_the_way_is_heard_again():
    with Interruption() as interruption:
        with contextlib.suppress(Interrupted):  # as a destructor would
            signal.raise_signal(signal.SIGTERM)
        with pytest.raises(Interrupted), Interruption():
            pass
        with pytest.raises(Interrupted):
            interruption.stop()


def test_a_search_in_threads_keeps_what_it_has_found_between_two_looks():
    found = []
    with Interruption() as interruption:
        interruption.has_some = lambda: bool(found)
        assert not interruption.stop()
        found.append("a trial")  # of another thread
        signal.raise_signal(signal.SIGINT)
        assert interruption.stop()
    with Interruption() as interruption:
        interruption.has_some = lambda: False
        assert not interruption.stop()
        with pytest.raises(Interrupted):
            signal.raise_signal(signal.SIGINT)


def test_signals_that_are_turned_off_stay_off(here, player):
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # until the test ends
    player.between = lambda _: signal.raise_signal(signal.SIGHUP)
    assert call(*RUN).exit_code == 0


def test_a_folder_that_vanishes_is_made_again(here, player):
    player.between = lambda _: shutil.rmtree(here / "out")
    assert call(*RUN).exit_code == 0
    assert Result.load(here / "out").status == "ok"


def test_a_result_keeps_the_pair_of_runs_together(here):
    pair = small()
    pair.uncontrolled = small()
    pair.save(here / "out")
    before = contents(here / "out")
    pair.dataset.attrs["title"] = "new"
    # netCDF takes no objects
    pair.uncontrolled.dataset = xr.Dataset({"x": ("time", np.array([object()]))})
    with pytest.raises((TypeError, ValueError, OSError), match=r"object|dtype"):
        pair.save(here / "out")
    assert contents(here / "out") == before


def test_files_of_findings_are_those_that_are_drawn_and_kept_apart():
    assert set(_APART) == set(_FINDINGS)
