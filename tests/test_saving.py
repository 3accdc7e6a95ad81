"""Saving by the command line: files, refusals, and the fate of files from before.

No test here computes a motion: `Player` stands for the simulation.
"""

import contextlib
import errno
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import filelock
import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner
from typer.testing import Result as Ended

from crinoid.cli import study
from crinoid.cli.app import app
from crinoid.cli.folder import claimed
from crinoid.cli.interruption import Interrupted, Interruption
from crinoid.replacement import remove_unfinished, replacing
from crinoid.report.page.file import PAGE, save_page
from crinoid.result import Result, attributes
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.stream import open_lazily
from made_results import Player, case_rows, made_result
from test_streaming import grown

SMALL = """
title = "small"
[arm]
nodes = 5
[simulation]
duration = 1.0
"""
STUDY = SMALL + '[vary]\n"arm.length" = [0.4, 0.5, 0.6]\n'


def call(*arguments: object) -> Ended:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def player(monkeypatch) -> Player:
    player = Player()
    monkeypatch.setattr("crinoid.cli.attempt.play", player)
    return player


def blank_page(folder: Path) -> Path:
    return save_page('<meta name="generator" content="crinoid">', folder / PAGE)


@pytest.fixture
def drawn() -> None:
    """Draw pages; else they are blank, as that takes longer than all else here."""


@pytest.fixture
def here(tmp_path, monkeypatch, player, request) -> Path:
    if "drawn" not in request.fixturenames:
        monkeypatch.setattr("crinoid.cli.pages.write_page", blank_page)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(SMALL)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def one_line(ended: Ended, code: int) -> str:
    assert ended.exit_code == code, ended.output
    assert len(ended.stderr.strip().splitlines()) == 1
    return ended.stderr


def names(folder: Path) -> list[str]:
    """Names of what is in a folder, but for the page of a run."""
    return sorted(path.name for path in folder.iterdir() if path.name != PAGE)


@pytest.fixture
def small_disk(tmp_path):
    """A device of 200 kB, where we may mount one."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(disk)]
    try:
        mounted = subprocess.run(mount, capture_output=True, check=False)
    except OSError:
        pytest.skip("there is no mount here")
    if mounted.returncode:
        pytest.skip("only root may mount a small disk")
    yield disk
    subprocess.run(["umount", "--lazy", str(disk)], check=True)


def test_a_full_disk_costs_nothing_that_was_computed(here, small_disk, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(here))
    monkeypatch.setattr("tempfile.tempdir", None)
    rest = np.random.default_rng(0).random(60_000)  # does not compress

    def large(scenario: Scenario) -> Result:
        result = made_result(scenario)
        result.dataset["rest"] = ("rest", rest)
        return result

    monkeypatch.setattr("made_results.made_result", large)
    line = one_line(call("run", "small.toml", "--out", small_disk / "out"), 3)
    assert "No space left on device" in line
    (saved,) = here.glob("crinoid-*")
    assert f"what was computed is saved in {saved} instead" in line
    np.testing.assert_array_equal(Result.load(saved).dataset["rest"], rest)
    assert not list(small_disk.rglob("*.nc*"))


def test_a_run_that_can_no_longer_be_written_says_what_there_is(here, player):
    def fill(number: int) -> None:
        if number == 2:  # it had been written before
            grown(here / "out" / "result.nc")
        raise OSError(errno.ENOSPC, "No space left on device", "out")

    player.between = fill
    line = one_line(call("run", "small.toml", "--out", "out"), 3)
    assert line == "crinoid: out: No space left on device; nothing of the run could be written\n"
    assert not (here / "out").exists()
    line = one_line(call("run", "small.toml", "--out", "out"), 3)
    assert "what was written before is in out, --resume goes on from there" in line
    assert open_lazily(here / "out" / "result.nc").sizes["time"] == 209


def test_a_study_ends_where_a_case_can_no_longer_be_written(here, player):
    def fill(number: int) -> None:
        if number == 2:
            raise OSError(errno.ENOSPC, "No space left on device", "out/case-02")

    player.between = fill
    line = one_line(call("run", "study.toml", "--out", "out"), 3)
    assert line.startswith("crinoid: case-02: out/case-02: No space left on device; nothing")
    assert [row["case"] for row in case_rows(here / "out")] == ["case-01"]
    assert len(player.played) == 2


def test_a_run_is_written_beside_a_finished_result_until_it_is_finished_itself(here, player):
    def grow(number: int) -> None:
        grown(player.into[-1] / "result.nc")

    player.between = grow
    for _ in range(2):
        assert call("run", "small.toml", "--out", "out").exit_code == 0
    assert [path.name for path in player.into] == ["out", "out-unfinished"]
    assert names(here) == ["out", "small.toml", "study.toml"]
    assert names(here / "out") == ["result.nc"]


def no_space(*_: object, **__: object) -> None:
    raise RuntimeError("NetCDF: HDF error")


def test_half_a_pair_that_is_saved_is_said_to_be_so(here, player, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(here))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setenv("HOME", str(here / "home"))
    (here / "home").mkdir()

    def half(result: Result, folder: Path) -> list[Path]:
        if folder.name.startswith("crinoid-") and folder.parent not in room:
            folder.joinpath("uncontrolled.nc").write_bytes(whole)
        if folder.parent in room:
            return save(result, folder)
        raise OSError(errno.ENOSPC, "No space left on device", str(folder))

    save = Result.save
    room: list[Path] = []
    made_result(Scenario.from_toml(SMALL)).save(here / "other")
    whole = (here / "other" / "result.nc").read_bytes()
    monkeypatch.setattr(Result, "save", half)
    line = one_line(call("run", "small.toml", "--out", "out"), 3)
    parts = [next(folder.glob("crinoid-*/*.nc")) for folder in (here, here / "home")]
    assert f"only {parts[0]} and {parts[1]} could be saved, the rest is lost" in line
    # nothing of a half is left where another folder takes the whole
    for part in parts:
        part.unlink()
        part.parent.rmdir()
    room.append(here / "home")
    line = one_line(call("run", "small.toml", "--out", "out"), 3)
    (saved,) = (here / "home").iterdir()
    assert f"what was computed is saved in {saved} instead" in line
    assert not list(here.glob("crinoid-*"))


def test_what_cannot_be_saved_anywhere_is_said_to_be_lost(here, monkeypatch):
    monkeypatch.setattr("xarray.Dataset.to_netcdf", no_space)
    line = one_line(call("run", "small.toml", "--out", "out"), 3)
    assert "out: NetCDF: HDF error; what was computed could be saved nowhere" in line
    assert not (here / "out").exists()


def test_a_failed_replacement_leaves_the_earlier_result(here, monkeypatch):
    assert call("run", "small.toml", "--out", "out").exit_code == 0
    before = (here / "out" / "result.nc").read_bytes()
    with monkeypatch.context() as patched:
        patched.setattr("xarray.Dataset.to_netcdf", no_space)
        assert call("run", "small.toml", "--out", "out").exit_code == 3
    assert (here / "out" / "result.nc").read_bytes() == before
    assert names(here / "out") == ["result.nc"]


def test_a_study_on_a_full_disk_ends_with_the_cases_that_are_saved(here, player, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(here))
    monkeypatch.setattr("tempfile.tempdir", None)
    save = Result.save

    def full(result: Result, folder: Path) -> list[Path]:
        if folder.name == "case-02":
            raise OSError(errno.ENOSPC, "No space left on device", str(folder))
        return save(result, folder)

    monkeypatch.setattr(Result, "save", full)
    line = one_line(call("run", "study.toml", "--out", "out"), 3)
    assert "case-02: out/case-02: No space left on device; what was computed is saved in" in line
    assert len(player.played) == 2
    assert [row["case"] for row in case_rows(here / "out")] == ["case-01"]


def test_a_folder_in_use_is_refused_until_it_is_let_go(here):
    (here / "out").mkdir()
    held = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import filelock, sys, time\n"
            "lock = filelock.FileLock('out/.crinoid.lock'); lock.acquire()\n"
            "print('held', flush=True); time.sleep(60)",
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert held.stdout is not None
        assert held.stdout.readline() == "held\n"
        line = one_line(call("run", "small.toml", "--out", "out"), 2)
        assert "another command is writing to out" in line
        assert not (here / "out" / "result.nc").exists()
    finally:
        held.kill()  # the system lets go of the lock of what is killed
        held.wait()
    assert call("run", "small.toml", "--out", "out").exit_code == 0
    assert names(here / "out") == ["result.nc"]


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
    ended = call("run", "small.toml", "--out", "out")
    if goes_on:
        assert ended.exit_code == 0, ended.output
        assert names(here / "out") == ["result.nc"]
    else:
        assert one_line(ended, 2) == "crinoid: out: Read-only file system\n"
        assert not (here / "out").exists()


def test_what_a_killed_program_left_unfinished_goes(here):
    (here / "out").mkdir()
    (here / "out" / ".result.nc.abcd1234.unfinished").write_text("half a result")
    (here / "out" / ".result.nc.dcba4321.unfinished").mkdir()
    (here / "out" / ".result.nc.20260101").write_text("no name that crinoid gives")
    assert call("run", "small.toml", "--out", "out").exit_code == 0
    kept = [".result.nc.20260101", ".result.nc.dcba4321.unfinished", "result.nc"]
    assert names(here / "out") == kept


def test_what_a_killed_program_left_has_the_name_that_is_looked_for(tmp_path):
    with replacing(tmp_path / "result.nc") as temporary:
        assert names(tmp_path) == [temporary.name]
        remove_unfinished(tmp_path / "result.nc")
        assert names(tmp_path) == []
        temporary.write_text("whole")
    assert names(tmp_path) == ["result.nc"]


def test_a_finished_result_of_another_scenario_is_not_replaced(here, player):
    assert call("run", "small.toml", "--out", "out").exit_code == 0
    assert call("run", "small.toml", "--out", "out").exit_code == 0
    other = ("run", "small.toml", "--set", "arm.length=0.7", "--out", "out")
    line = one_line(call(*other), 2)
    assert "out/result.nc is a finished result of another scenario" in line
    assert "--force" in line
    assert Result.load(here / "out").scenario.arm.length == 0.5
    assert len(player.played) == 2
    assert call(*other, "--force").exit_code == 0
    assert Result.load(here / "out").scenario.arm.length == 0.7
    # an interrupted one of another scenario is no loss, one of the same is worth a word
    interrupted = made_result(Scenario.from_toml(SMALL), 0.5, "interrupted at t = 0.5 s")
    interrupted.save(here / "out")
    assert "--resume would go on with it" in call("run", "small.toml", "--out", "out").stdout
    interrupted.save(here / "out")
    assert call(*other).exit_code == 0


@pytest.mark.parametrize("status", ["interrupted at t = 0.5 s", "failed at t = 0.5 s: a hit"])
def test_a_finished_result_is_not_lost_to_a_run_that_ends_early(here, monkeypatch, status):
    assert call("run", "small.toml", "--out", "out").exit_code == 0
    assert call("report", "out").exit_code == 0
    before = {path.name: path.read_bytes() for path in (here / "out").iterdir()}

    def ends(*_: object, **__: object) -> Result:
        return made_result(Scenario.from_toml(SMALL), 0.5, status)

    code = 130 if status.startswith("interrupted") else 3
    with monkeypatch.context() as patched:
        patched.setattr("crinoid.cli.attempt.play", ends)
        for folder in ("out-unfinished", "out-unfinished-2"):
            line = one_line(call("run", "small.toml", "--out", "out"), code)
            text = f"{status}; saved in {folder}, the finished result in out stays"
            assert line == f"crinoid: {text}\n"
            assert Result.load(here / folder).status == status
        assert {path.name: path.read_bytes() for path in (here / "out").iterdir()} == before
        # also in the current folder
        monkeypatch.chdir(here / "out")
        assert "out-unfinished-3" in one_line(call("run", "../small.toml", "--out", "."), code)
        assert {path.name: path.read_bytes() for path in (here / "out").iterdir()} == before
        # but a run that is prolonged has it in itself
        monkeypatch.chdir(here)
        longer = ("--set", "simulation.duration=2.0")
        long = made_result(Scenario.from_toml(SMALL.replace("1.0", "2.0")), 1.5, status)
        patched.setattr("crinoid.cli.attempt.play", lambda *_, **__: long)
        one_line(call("run", "small.toml", *longer, "--out", "out", "--resume"), code)
    assert Result.load(here / "out").status == status
    assert not (here / "out-unfinished-4").exists()


def test_a_finished_case_is_not_lost_to_one_that_ends_early(here, player):
    player.between = lambda number: number != 5 or signal.raise_signal(signal.SIGTERM)
    assert call("run", "study.toml", "--out", "out").exit_code == 0
    line = one_line(call("run", "study.toml", "--out", "out"), 130)
    assert "interrupted in case-02; --resume goes on from there" in line
    assert "is in out/case-02-unfinished, its finished result stays" in line
    assert Result.load(here / "out" / "case-02").status == "ok"
    assert Result.load(here / "out" / "case-02-unfinished").status == "interrupted at t = 0.5 s"
    rows = case_rows(here / "out")
    # the table still has what the folders hold
    assert [row["directory"] for row in rows] == ["case-01", "case-02", "case-03"]
    assert [row["status"] for row in rows] == ["ok"] * 3
    assert call("run", "study.toml", "--out", "out", "--resume").exit_code == 0
    assert len(player.played) == 5


def test_the_table_keeps_the_rows_of_cases_that_are_not_run_again_yet(here, player):
    table = here / "out" / "cases.csv"
    assert call("run", "study.toml", "--out", "out").exit_code == 0
    whole = table.read_text()
    # what is not of the same case, or gone, is no row of this study
    rows = whole.splitlines()
    table.write_text("\n".join([*rows[:3], rows[3].replace("case-03", "case-04")]) + "\n")
    (here / "out" / "case-02" / "result.nc").unlink()
    player.played.clear()
    player.between = lambda number: number == 1 or signal.raise_signal(signal.SIGTERM)
    assert call("run", "study.toml", "--out", "out").exit_code == 130
    found = [(row["case"], row["status"][:11]) for row in case_rows(here / "out")]
    assert found == [("case-01", "ok"), ("case-02", "interrupted")]
    player.between = lambda _: None
    assert call("run", "study.toml", "--out", "out").exit_code == 0
    assert table.read_text() == whole


@pytest.mark.parametrize("name", ["result.nc", "uncontrolled.nc"])
def test_a_file_of_the_users_is_not_replaced_unless_forced(here, player, name):
    (here / "out").mkdir()
    (here / "out" / name).write_text("mine")
    for arguments in (("run", "small.toml"), ("equilibrium", "small.toml")):
        line = one_line(call(*arguments, "--out", "out"), 2)
        assert f"out/{name} was not written by crinoid, or cannot be read" in line
        assert "--force" in line
    assert names(here / "out") == [name]
    assert not player.played
    assert call("run", "small.toml", "--out", "out", "--force").exit_code == 0
    assert names(here / "out") == ["result.nc"]
    assert call("report", "out").exit_code == 0


def test_a_run_leaves_nothing_of_another_and_all_of_the_users(here):
    out = here / "out"
    mine = made_result(Scenario.from_toml(SMALL))
    mine.uncontrolled = made_result(Scenario.from_toml(SMALL))
    mine.save(out)
    assert call("report", out).exit_code == 0
    assert attributes(out / "uncontrolled.nc")
    (out / "notes.md").write_text("mine")
    (out / "photo.png").write_bytes(b"\x89PNG of the users")
    (out / "tip_error.png").unlink()
    (out / "tip_error.png").write_bytes(b"\x89PNG of the users as well")
    assert call("run", "small.toml", "--out", out).exit_code == 0
    assert names(out) == ["notes.md", "photo.png", "result.nc", "tip_error.png"]


@pytest.mark.usefixtures("drawn")
def test_a_run_writes_its_page_over_its_own_only(here):
    ended = call("run", "small.toml", "--out", "out")
    assert f"wrote out/{PAGE}" in ended.stdout
    page = here / "out" / PAGE
    assert "<h1>small</h1>" in page.read_text("utf-8")
    assert call("run", "small.toml", "--out", "out").exit_code == 0
    page.write_text("mine")
    again = call("run", "small.toml", "--out", "out")
    assert again.exit_code == 0
    assert f"no page: out/{PAGE}: not written by crinoid" in again.stdout
    assert page.read_text() == "mine"
    assert f"out/{PAGE}: not written by crinoid" in one_line(call("report", "out"), 2)


@pytest.mark.usefixtures("drawn")
def test_the_page_of_another_run_goes(here):
    assert call("run", "small.toml", "--out", "out").exit_code == 0
    assert call("run", "study.toml", "--out", "out", "--force").exit_code == 0
    assert "study of " in (here / "out" / PAGE).read_text("utf-8")
    assert (here / "out" / "case-01" / PAGE).is_file()


def test_a_smaller_study_a_run_and_a_study_replace_each_other_wholly(here):
    out = here / "out"
    assert call("run", "study.toml", "--out", out).exit_code == 0
    (out / "case-03" / "mine.txt").write_text("mine")
    smaller = ("run", "study.toml", "--set", "vary={'arm.length'=[0.4]}", "--out", out)
    assert "case-02" in one_line(call(*smaller), 2)
    assert call(*smaller, "--force").exit_code == 0
    assert names(out) == ["case-01", "case-03", "cases.csv"]
    assert names(out / "case-03") == ["mine.txt"]
    run = ("run", "small.toml", "--out", out)
    assert "case-01" in one_line(call(*run), 2)
    assert call(*run, "--force").exit_code == 0
    assert names(out) == ["case-03", "result.nc"]
    assert "result.nc" in one_line(call("run", "study.toml", "--out", out), 2)
    assert call("run", "study.toml", "--out", out, "--force").exit_code == 0
    assert names(out) == ["case-01", "case-02", "case-03", "cases.csv"]


def test_links_are_replaced_and_not_followed(here):
    out, precious = here / "out", here / "precious"
    out.mkdir()
    for name in ("cases.csv", "result.nc", "shape.png"):
        (precious.with_name(name)).write_text("precious")
        (out / name).symlink_to(here / name)
    assert "out/cases.csv was not written by crinoid" in one_line(
        call("run", "study.toml", "--out", "out"), 2
    )
    assert call("run", "study.toml", "--out", out, "--force").exit_code == 0
    assert call("report", out / "case-01", "--out", out).exit_code == 0
    for name in ("cases.csv", "result.nc", "shape.png"):
        assert (here / name).read_text() == "precious"
    assert not (out / "cases.csv").is_symlink()
    assert not (out / "shape.png").is_symlink()


def _attribute(name: str, value: object) -> Callable[[xr.Dataset], xr.Dataset]:
    def tamper(dataset: xr.Dataset) -> xr.Dataset:
        dataset.attrs[name] = value
        return dataset

    return tamper


BROKEN = {
    "no wall_time": (
        lambda data: data.attrs.pop("wall_time") and data,
        "does not say its wall_time",
    ),
    "wall_time in words": (_attribute("wall_time", "long"), "does not say its wall_time"),
    "no status": (lambda data: data.attrs.pop("status") and data, "does not say its status"),
    "no position": (lambda data: data.drop_vars("position"), "it has no position"),
    "no time": (lambda data: data.drop_vars("time"), "it has no time"),
    "no energy": (lambda data: data.drop_vars("energy"), "it has no energy"),
    "energy in words": (lambda data: data.assign(energy=data["energy"].astype(str)), "its energy"),
    "time in words": (lambda data: data.assign_coords(time=list("abcde")), "its time is no array"),
    "no names of axes": (lambda data: data.drop_vars("axis"), "it has no axis over axis"),
    "no instant": (lambda data: data.isel(time=slice(0)), "it holds no instant"),
    "no TOML": (_attribute("scenario", "= ="), "cannot be read: not valid TOML"),
    "another scenario": (
        _attribute("scenario", Scenario(seed=3).to_toml()),
        "is of another scenario; only its duration may be changed",
    ),
}


@pytest.mark.parametrize("status", ["ok", "interrupted at t = 0.5 s"])
@pytest.mark.parametrize(("tamper", "reason"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_result_is_not_gone_on_with_and_stays(here, player, tamper, reason, status):
    broken = made_result(Scenario.from_toml(SMALL), status=status)
    broken.dataset = tamper(broken.dataset)
    broken.save(here / "out")
    before = (here / "out" / "result.nc").read_bytes()
    line = one_line(call("run", "small.toml", "--out", "out", "--resume"), 2)
    assert line.startswith("crinoid: --resume: ")
    assert reason in line
    assert not player.played
    assert (here / "out" / "result.nc").read_bytes() == before


def test_a_longer_table_of_motion_is_another_scenario(here):
    table = '[[base.motion]]\nkind = "table"\nchannel = "slide"\n'
    text = f"{SMALL}{table}time = [0.0, 1.0]\nvalue = [0.0, 0.1]\n"
    made_result(Scenario.from_toml(text)).save(here / "out")
    longer = text.replace("0.0, 1.0]", "0.0, 2.0]").replace("duration = 1.0", "duration = 2.0")
    (here / "longer.toml").write_text(longer)
    line = one_line(call("run", "longer.toml", "--out", "out", "--resume"), 2)
    assert "the run in out is of another scenario; only its duration may be changed" in line


@pytest.mark.parametrize("size", [0, 1000, 20_000])
def test_a_cut_file_is_not_gone_on_with(here, size):
    made_result(Scenario.from_toml(SMALL), 0.5, "interrupted at t = 0.5 s").save(here / "out")
    path = here / "out" / "result.nc"
    path.write_bytes(path.read_bytes()[:size])
    line = one_line(call("run", "small.toml", "--out", "out", "--resume"), 2)
    assert "out/result.nc: not a result of crinoid" in line


def test_a_case_that_is_refused_is_named_and_the_others_are_run(here, player, caplog):
    def refuse(number: int) -> None:
        if number == 2:
            raise ScenarioError([Mistake("control.pid.tilt", "does nothing")])

    player.between = refuse
    line = one_line(call("run", "study.toml", "--out", "out"), 3)
    assert line == "crinoid: case-02: refused: control.pid.tilt: does nothing\n"
    rows = case_rows(here / "out")
    assert [row["status"] for row in rows] == [
        "ok",
        "refused: control.pid.tilt: does nothing",
        "ok",
    ]
    assert rows[1]["rms_error"] == ""
    assert float(rows[2]["rms_error"]) > 0
    assert call("report", "out").exit_code == 0
    assert not caplog.records  # nothing of matplotlib's that only it understands
    # in a run by itself it is a mistake, and no folder is left behind
    player.between = lambda number: refuse(2)
    assert "control.pid.tilt" in one_line(call("run", "small.toml", "--out", "alone/deep"), 2)
    assert not (here / "alone").exists()


def test_completed_cases_are_not_run_again(here, player):
    player.between = lambda number: number != 2 or signal.raise_signal(signal.SIGTERM)
    line = one_line(call("run", "study.toml", "--out", "out"), 130)
    assert line == "crinoid: interrupted in case-02; --resume goes on from there\n"
    assert len(player.played) == 2
    ended = call("run", "study.toml", "--out", "out", "--resume")
    assert ended.exit_code == 0, ended.output
    assert [each.arm.length for each in player.played[2:]] == [0.5, 0.6]
    rows = case_rows(here / "out")
    assert [row["status"] for row in rows] == ["ok"] * 3
    errors = [float(row["rms_error"]) for row in rows]
    assert errors == pytest.approx([errors[0]] * 3)
    # and a run that is complete is only shown
    assert call("run", "small.toml", "--out", "one").exit_code == 0
    count = len(player.played)
    again = call("run", "small.toml", "--out", "one", "--resume")
    assert again.exit_code == 0
    assert "is complete" in again.stdout
    assert len(player.played) == count


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_stop_a_run_that_is_saved_however_often_they_come(here, player, name):
    number = getattr(signal, name)
    earlier = signal.getsignal(number)
    player.between = lambda _: [signal.raise_signal(number) for _ in range(3)]
    line = one_line(call("run", "small.toml", "--out", "out"), 130)
    assert line.startswith("crinoid: interrupted at t = 0.5 s; what there is has been saved")
    assert Result.load(here / "out").status == "interrupted at t = 0.5 s"
    assert signal.getsignal(number) == earlier


def test_a_signal_while_saving_lets_the_result_be_saved(here, monkeypatch):
    save = Result.save

    def interrupted(result: Result, folder: Path) -> list[Path]:
        signal.raise_signal(signal.SIGINT)
        return save(result, folder)

    monkeypatch.setattr(Result, "save", interrupted)
    ended = call("run", "small.toml", "--out", "out")
    assert ended.exit_code == 0, ended.output
    assert Result.load(here / "out").status == "ok"
    # of a study the cases that are left wait
    line = one_line(call("run", "study.toml", "--out", "cases"), 130)
    assert "interrupted before case-02; --resume goes on from there" in line


def test_a_signal_while_the_table_is_written_waits_until_it_is(here, monkeypatch):
    assert call("run", "study.toml", "--out", "out").exit_code == 0
    write, written = study.write_rows, []

    def interrupted(path: Path, rows: list[dict[str, object]]) -> None:
        written.append(len(rows))
        if len(written) == 2:
            signal.raise_signal(signal.SIGINT)
        write(path, rows)

    monkeypatch.setattr(study, "write_rows", interrupted)
    ended = call("run", "study.toml", "--out", "out", "--resume")
    assert "interrupted before case-03; --resume goes on from there" in one_line(ended, 130)
    assert "wrote out/cases.csv" in ended.stdout
    assert [row["status"] for row in case_rows(here / "out")] == ["ok"] * 3
    assert written == [3, 3]


def test_an_empty_name_of_a_folder_is_a_mistake(here):
    line = one_line(call("run", "small.toml", "--out", ""), 2)
    assert line == "crinoid: --out: got an empty name, takes a folder\n"
    assert names(here) == ["small.toml", "study.toml"]


def test_a_copy_of_a_scenario_follows_no_link(here):
    (here / "still-water.toml").symlink_to(here / "elsewhere")
    assert "already there" in one_line(call("scenarios", "--copy", "still-water"), 2)
    assert not (here / "elsewhere").exists()


def test_a_signal_before_there_is_anything_to_save_stops_at_once(here, monkeypatch):
    def set_up(*_: object, **__: object) -> None:
        signal.raise_signal(signal.SIGHUP)
        raise AssertionError("not stopped")

    monkeypatch.setattr("crinoid.cli.attempt.play", set_up)
    for file in ("small.toml", "study.toml"):
        line = one_line(call("run", file, "--out", "out"), 130)
        assert line == "crinoid: interrupted before there was anything to save\n"
        assert not (here / "out").exists()


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_while_the_program_is_loaded_is_one_line(here, name, delay):
    # as soon as the program has begun: before that the interpreter itself speaks
    code = (
        "import signal, sys, threading, os, time\n"
        "import crinoid.cli\n"
        "def send():\n"
        f"    time.sleep({delay})\n"
        f"    os.kill(os.getpid(), signal.{name})\n"
        "heed = crinoid.cli.heed\n"
        "def heeded():\n"
        "    heed()\n"
        "    threading.Thread(target=send).start()\n"
        "crinoid.cli.heed = heeded\n"
        "sys.argv = ['crinoid', 'run', 'small.toml', '--out', 'out']\n"
        "crinoid.cli.main()\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120
    )
    assert ended.returncode == 130
    assert re.fullmatch(
        r"crinoid: interrupted( before there was anything to save)?\n", ended.stderr
    )
    assert not (here / "out").exists()


def test_a_wish_to_stop_that_was_lost_on_the_way_is_heard_again():
    with Interruption() as interruption:
        with contextlib.suppress(Interrupted):  # as a destructor would
            signal.raise_signal(signal.SIGTERM)
        with pytest.raises(Interrupted), Interruption():
            pass
        with pytest.raises(Interrupted):
            interruption.stop()


def test_signals_that_are_turned_off_stay_off(here, player):
    earlier = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        player.between = lambda _: signal.raise_signal(signal.SIGHUP)
        ended = call("run", "small.toml", "--out", "out")
    finally:
        signal.signal(signal.SIGHUP, earlier)
    assert ended.exit_code == 0, ended.output


def test_a_folder_that_vanishes_is_made_again(here, player):
    import shutil

    player.between = lambda _: shutil.rmtree(here / "out")
    assert call("run", "small.toml", "--out", "out").exit_code == 0
    assert Result.load(here / "out").status == "ok"


def test_a_result_keeps_the_pair_of_runs_together(here):
    pair = made_result(Scenario.from_toml(SMALL))
    pair.uncontrolled = made_result(Scenario.from_toml(SMALL))
    pair.save(here / "out")
    before = {path.name: path.read_bytes() for path in (here / "out").iterdir()}
    pair.dataset.attrs["title"] = "new"
    broken = xr.Dataset({"x": ("time", np.array([object()]))})  # netCDF takes none
    pair.uncontrolled.dataset = broken
    with pytest.raises((TypeError, ValueError, OSError), match=r"object|dtype"):
        pair.save(here / "out")
    assert {path.name: path.read_bytes() for path in (here / "out").iterdir()} == before


def test_a_claimed_folder_that_is_left_empty_goes(tmp_path):
    with claimed(tmp_path / "a" / "b"):
        assert os.listdir(tmp_path / "a" / "b") == [".crinoid.lock"]
    assert not (tmp_path / "a").exists()
    (tmp_path / "a").mkdir()
    with claimed(tmp_path / "a"):
        pass
    assert (tmp_path / "a").is_dir()
