"""The command ``python -m validation``: choice of cases, files, exit codes, interruption."""

import json
import os
import signal
from functools import partial

import pytest

import crinoid
from helpers import command
from helpers.command import one_line
from validation.case import Case, Check, Evidence
from validation.command import app

call, refused, succeeded = (
    partial(each, of=app) for each in (command.call, command.refused, command.succeeded)
)


def case(name, value=1.0, draw=None, **changes):
    """Return a case that computes nothing; a function as ``value`` is called."""

    def run():
        found = value() if callable(value) else value
        scenario = crinoid.Scenario(title=name)
        return Evidence(
            [Check("length", 1.0, found, 0.1, "m")],
            order=2.0,
            scenarios={"": scenario},
            draw=draw or (lambda axes: axes.plot([0, 1], [0, found])),
            remarks=["A remark."],
        )

    words = dict.fromkeys(("title", "source", "method", "reason"), "A sentence.")
    return Case(name=name, kind="exact", run=run, **words | changes)


def fail(*_):
    raise RuntimeError("no\nequilibrium")


@pytest.fixture
def cases(monkeypatch, tmp_path):
    """Return the list of cases that the command knows."""
    monkeypatch.chdir(tmp_path)
    known = [case("good"), case("far", long=True), case("other", needs=("no_such_package",))]
    monkeypatch.setattr("validation.command.all_cases", lambda: known)
    return known


def record(folder):
    return json.loads((folder / "validation.json").read_text("utf-8"))


def test_record_figure_and_scenario_are_written(cases, tmp_path):
    said = succeeded()
    assert "order 2.00" in said
    folder = tmp_path / "results" / "validation"
    assert {path.name for path in folder.iterdir()} == {
        *("validation.json", "good.png", "good.toml")
    }
    assert crinoid.load(str(folder / "good.toml")).title == "good"
    found = record(folder)
    assert {"crinoid", "jax", "python", "machine", "date", "cases", "checks"} == set(found)
    assert found["cases"][0]["seconds"] >= 0.0
    (check,) = found["checks"]
    assert check == {
        "name": "good",
        "quantity": "length",
        "source": "A sentence.",
        "kind": "exact",
        "reference": 1.0,
        "value": 1.0,
        "error": 0.0,
        "tolerance": 0.1,
        "relative": False,
        "unit": "m",
        "order": 2.0,
        "holds": True,
    }


def test_long_cases_and_those_of_peers_are_run_on_request(cases, tmp_path):
    assert "far" in succeeded("--all", "--out", "all")
    for words in (("--peers", "--out", "peers"), ("other",)):
        said = refused(*words, code=1)
        assert said == "crinoid: other: not run: needs no_such_package, which is not installed"
    assert [each["name"] for each in record(tmp_path / "peers")["cases"]] == ["good", "other"]
    assert "far" in succeeded("far")
    assert [each["name"] for each in record(tmp_path / "results/validation-far")["cases"]] == [
        "far"
    ]
    listed = succeeded("--list")
    assert [line.split()[0] for line in listed.splitlines()] == ["good", "far", "other"]


def test_unknown_names_and_an_earlier_validation_are_refused(cases, tmp_path):
    assert refused("god") == ('crinoid: CASE: got "god"; must be "good", "far" or "other"')
    succeeded("good", "far", "--out", "x")
    assert "contains a validation" in refused("--out", "x")
    (tmp_path / "x" / "own.png").touch()
    succeeded("good", "--out", "x", "--force")
    names = {path.name for path in (tmp_path / "x").iterdir()}
    assert names == {"validation.json", "good.png", "good.toml", "own.png"}


@pytest.mark.parametrize("value", [1.2, float("nan")])
def test_a_check_that_does_not_hold_and_an_error_give_exit_1(cases, tmp_path, value):
    cases[:] = [case("bad", value), case("broken", fail), case("blank", draw=fail), case("good")]
    ended = call("--out", "x")
    line = one_line(ended, 1)
    assert line == "crinoid: bad does not hold: length; broken failed; blank failed"
    assert "note: broken: RuntimeError: no equilibrium" in ended.output
    found = record(tmp_path / "x")
    assert [each["holds"] for each in found["cases"]] == [False, False, False, True]
    assert found["checks"][0]["holds"] is False


def test_an_interrupted_validation_keeps_the_cases_that_are_done(cases, tmp_path):
    def interrupt():
        os.kill(os.getpid(), signal.SIGINT)
        return 1.0

    cases[:] = [case("good"), case("slow", interrupt), case("later")]
    said = refused("--out", "x", code=130)
    assert said == "crinoid: interrupted after 1 of 3 cases, and saved"
    assert [each["name"] for each in record(tmp_path / "x")["cases"]] == ["good"]
    said = refused("slow", "--out", "y", code=130)
    assert said == "crinoid: interrupted"
    assert not (tmp_path / "y").exists()
