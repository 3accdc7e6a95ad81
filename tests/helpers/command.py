"""Commands called in the process of the test."""

import re
from pathlib import Path

from typer import Typer
from typer.testing import CliRunner, Result

from crinoid.cli.app import app
from crinoid.scenario import Scenario

SMALL = Scenario(
    title="small",
    arm={"nodes": 5, "youngs_modulus": 5e5},
    base={"channels": {"tilt": {}}},
    flow=[{"kind": "uniform", "velocity": [0.2, 0.1], "ramp_time": 0.1}],
    control={"kind": "pid", "pid": {"tilt": {"kp": 0.5}}},
    simulation={"duration": 0.2},
)
"""A closed loop for commands whose result does not matter."""


def call(*arguments: object, of: Typer = app) -> Result:
    return CliRunner().invoke(of, [str(argument) for argument in arguments])


def succeeded(*arguments: object, of: Typer = app) -> str:
    """Call a command that ends well; return all that it writes."""
    ended = call(*arguments, of=of)
    assert ended.exit_code == 0, ended.output
    return ended.output


def one_line(ended: Result, code: int = 2) -> str:
    """Return the only line of errors of a command that ended with a code."""
    assert ended.exit_code == code, ended.output
    (line,) = ended.stderr.strip().splitlines()
    return line


def refused(*arguments: object, code: int = 2, of: Typer = app) -> str:
    """Call a command that ends with an error; return the only line that it writes of it."""
    return one_line(call(*arguments, of=of), code)


def assert_refused(line: str, answer: str) -> None:
    """Call a command line in this folder: one line says why not, and nothing is written."""
    before = sorted(Path().rglob("*"))
    said = refused(*line.split())
    assert re.match(f"crinoid: {answer}", said), said
    assert sorted(Path().rglob("*")) == before
