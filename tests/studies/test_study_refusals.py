"""Mistakes in sweeps, batches and comparisons: one line each, and nothing is written."""

import re
from functools import partial

import pytest
import tomli_w
import xarray as xr

from crinoid.cli.weights import read_weights
from crinoid.results.report_error import ReportError
from crinoid.scenario import Scenario
from crinoid.studies.batch import batch_of
from crinoid.studies.sweep.plan import SweepDesign
from crinoid.view.figures import write_report
from helpers.command import assert_refused, refused
from helpers.refusals import mistake

ARM = Scenario(
    arm={"nodes": 5},
    base={"channels": {"tilt": {}}},
    flow=[{"kind": "uniform", "velocity": [0.1, 0.0]}],
    control={"kind": "pid", "pid": {"tilt": {"ki": 2.0}}},
    simulation={"duration": 0.1},
)
GRID, SPAN, YOUNG = "arm.length=0.3:0.6:4", "arm.length=0.3:0.6", "arm.youngs_modulus"
PROGRAM = "which changes the compiled program"


def sweep(*texts, **options):
    return partial(SweepDesign.of, ARM, texts, **options)


def plan(**changes):
    document = SweepDesign.of(ARM, [GRID]).to_dict() | changes
    return partial(SweepDesign.from_toml, tomli_w.dumps(document))


def batch(over=None, seeds=None):
    return partial(batch_of, ARM, over, seeds, records=True)


MISTAKES = [
    (sweep("arm.length"), "--vary: .*must be KEY=FROM:TO:COUNT or KEY=A,B"),
    (sweep("arm.length=1,,2"), "--vary: .*or values with commas between them"),
    (sweep("arm.length=0.3:nan:4"), "--vary: .*a finite number at each end"),
    (sweep("arm.length=0.3:0.3:4"), "--vary: .*two different ends"),
    (sweep("arm.length=0.3:0.6:1"), "--vary: .*a count of 2 or more"),
    (sweep("arm.length=0:1:3:log"), "--vary: .*ends of one sign"),
    (sweep("arm.length=1:2:3:4"), "--vary: .*must be FROM:TO:COUNT"),
    (sweep(SPAN), "--vary: .*must have a count"),
    (sweep("arm.length=0.3:0.6:10000001"), "--vary: .*10000001 runs; must make at most 10000000"),
    (sweep("vary.arm=1"), "--vary: .*must begin with a key that can vary"),
    (sweep(GRID, GRID), "--vary: got arm.length twice"),
    (sweep(GRID, seeds=2**63), "--vary: makes .* runs; must make at most 10000000"),
    (sweep(GRID, seeds=0), "--seeds: got 0"),
    (sweep("seed=1,2", seeds=2), "--seeds: excludes other values of seed"),
    (sweep(GRID, batch=0), "--batch: got 0; must be at least 1"),
    (sweep(GRID, seeds=10**6, batch=8), "--batch: makes 500000 batches, a file each; must make at"),
    (sweep(SPAN, sampling="halton", count=4), '--sample: got "halton"; must be "grid"'),
    (sweep(SPAN, sampling="lhs"), "--sample: needs --count N"),
    (sweep(GRID, sampling="lhs", count=4), "--sample: needs a range to sample"),
    (sweep(SPAN, sampling="lhs", count=0), "--count: got 0"),
    (sweep(SPAN, sampling="lhs", count=10**9), "--count: got 1000000000"),
    (sweep(GRID, count=4), "--count: needs --sample"),
    (sweep(GRID, rows={YOUNG: [1e6]}), "--weights: excludes --vary"),
    (sweep(f"{YOUNG}=1e5,2e5", rows={YOUNG: [1e5, 1e6]}), f"--vary: {YOUNG} lacks 1e[+]06, which"),
    (sweep(f"{YOUNG}=1e5:1e6", rows={YOUNG: [1e5]}), f"--vary: {YOUNG} lacks 100000, which"),
    (sweep(rows={YOUNG: [1e6]}, sampling="lhs", count=4), "--weights: excludes --vary"),
    (sweep(rows={"arm.lengt": [0.3]}), "--weights: .*arm.lengt: unknown key; did you mean arm.len"),
    (sweep(GRID, sampling="rows"), "--sample: rows needs --weights FILE"),
    (
        plan(sampling="rows", varied={"arm.length": [0.3], "arm.radius": [0.01, 0.02]}),
        r"varied: got \[1, 2\] values in rows; must be as many of each key",
    ),
    (plan(version="0.0.1"), 'version: got "0.0.1"'),
    (plan(count="1"), 'count: got "1"; must be of type int'),
    (plan(varied={"arm.nodes": "5:200004:200000"}), "--batch: makes 200000 batches, a file each"),
    (plan(varied={"arm.length": 3}), "varied.arm.length: got 3; must be a list of values"),
    (plan(varied={"arm.length": []}), r"varied.arm.length: got \[\]; must be a list of values"),
    (batch(), "over: missing, like seeds. Pass at least one of them."),
    (batch([YOUNG]), r"over: got \["),
    (batch({YOUNG: 1e6}), f"over: {YOUNG}: got 1000000.0; must be a list"),
    (batch({YOUNG: []}), f"over: {YOUNG}: got no values; must have at least one"),
    (batch({YOUNG: [1e6, -1.0]}), f"over: entry 1, {YOUNG}: got -1.0; must be a number"),
    (
        batch({YOUNG: [1e6, 2e6], "seed": [1]}),
        "over: got 2 values of .*; must have as many of each",
    ),
    (batch({"arm.nodes": [5, 7]}), f"over: entry 1, arm.nodes: got 7 after 5, {PROGRAM}"),
    (batch({"control.kind": ["pid", "none"]}), f'over: .*: got "none" after "pid", {PROGRAM}'),
    (batch({"simulation.duration": [0.1, 0.2]}), "over: .*: got 0.2 after 0.1, .* the saved"),
    (batch(seeds=0), "seeds: got 0; must be a number of at least 1, or a list of seeds"),
    (batch(seeds=True), "seeds: got true; must be a number of at least 1"),
    (batch(seeds=[1, -1]), "seeds: entry 1, seed: got -1; must be a whole number"),
    (batch({"seed": [1]}, 2), 'seeds: excludes over."seed".'),
]


@pytest.mark.parametrize(("call", "line"), MISTAKES, ids=[line for _, line in MISTAKES])
def test_a_mistake_in_python_is_one_line(call, line):
    assert re.match(line, mistake(call))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", 'must have finite numbers in a column "share of time" and in one for each key'),
        ("share of time\n1\n", "must have finite numbers in a column"),
        ("water.depth,share of time\n9,few\n", "must have finite numbers in a column"),
        ("water.depth,share of time\n9\n", "must have finite numbers in a column"),
        ("water.depth,share\n9,1\n", "must have finite numbers in a column"),
        (
            "water.depth,share of time\n8,0.4\n9,0.4\n",
            "shares of time of 0.4 or more that add up to",
        ),
        ("water.depth,share of time\n8,1.2\n9,-0.2\n", "shares of time of -0.2 or more"),
    ],
)
def test_weights_that_do_not_fit_are_one_line(tmp_path, text, line):
    file = tmp_path / "scatter.csv"
    file.write_text(text)
    assert re.match(f"--weights: .*{line}", mistake(read_weights, file))


def test_weights_of_a_spreadsheet_with_decimal_commas_are_read(tmp_path):
    file = tmp_path / "scatter.csv"
    file.write_text("water.depth;share of time\r\n8,5;0,4\r\n9;0,6\r\n")
    rows, shares = read_weights(file)
    assert rows == {"water.depth": [8.5, 9]}
    assert shares.tolist() == [0.4, 0.6]


COMMANDS = {
    "sweep --vary arm.length=0.5:-0.5:2": "arm.length: got -0.5; must be a number above 0",
    "sweep --vary arm.nodes=5:8:3": "arm.nodes: got 5.0; must be a whole number",
    "sweep --vary arm.lengt=0.3,0.4": "arm.lengt: unknown key; did you mean arm.length?",
    "sweep --workers 0": "--workers: got 0",
    "sweep --workers 2 --scheduler tcp://far:1": "--workers: excludes --scheduler",
    "sweep --dry-run --resume": "--dry-run: excludes --resume",
    "compare --controllers none,custom": '--controllers: got "custom"; must be "none"',
    "compare --controllers pid,pid": '--controllers: got "pid" twice',
    "compare --seeds 0": "--seeds: got 0; must be at least 1",
    "compare --first-seed -1": "--first-seed: got -1; must be at least 0",
    "compare --set vary={'arm.length'=[0.5,0.6]}": "vary: a comparison is of one case",
}


@pytest.mark.parametrize("call", COMMANDS)
def test_a_mistake_in_a_command_is_one_line_and_nothing_is_written(tmp_path, monkeypatch, call):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text(ARM.to_toml())
    command, options = call.split(maxsplit=1)
    assert_refused(f"{command} arm.toml {options}", f".*{re.escape(COMMANDS[call])}")


def test_a_comparison_of_others_is_neither_replaced_nor_drawn(tmp_path):
    file, arm = tmp_path / "compare.nc", tmp_path / "arm.toml"
    arm.write_text(ARM.to_toml())
    file.write_text("theirs")
    assert "compare.nc was not written by crinoid" in refused("compare", arm, "--out", tmp_path)
    assert file.read_text() == "theirs"
    file.unlink()
    xr.Dataset({"a": ("b", [1.0])}).to_netcdf(file)
    with pytest.raises(ReportError, match="it has no rms_error"):
        write_report(file)
