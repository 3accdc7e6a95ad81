"""The commands."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.console import Console

from crinoid.scenario import (
    Scenario,
    ScenarioError,
    builtin_files,
    builtin_names,
    builtin_text,
    json_schema,
    load,
)

BAD_INPUT, FAILED, INTERRUPTED = 2, 3, 130

app = typer.Typer(
    name="crinoid",
    help="Simulate and control a soft robotic arm in moving water.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
console = Console(highlight=False, markup=False)
errors = Console(stderr=True, highlight=False, soft_wrap=True, markup=False)

ScenarioName = Annotated[
    str,
    typer.Argument(metavar="SCENARIO", help="A TOML file, or the name of a built-in scenario."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a key, such as arm.length=0.6."),
]
Out = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Where to write.", show_default="results/SCENARIO"),
]


@app.callback(invoke_without_command=True)
def _version(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        from crinoid.version import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.command()
def run(
    scenario: ScenarioName = "station-keeping",
    settings: Settings = None,
    out: Out = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from where an interrupted run stopped.")
    ] = False,
) -> None:
    """Run a scenario and save what happened."""
    described = _load(scenario, settings)
    folder = _folder(out, scenario)
    from crinoid.cli.play import run_scenario

    with _told():
        trouble = run_scenario(described, folder, resume=resume, console=console)
    _end(trouble)


@app.command()
def equilibrium(
    scenario: ScenarioName,
    settings: Settings = None,
    out: Out = None,
) -> None:
    """Find the shape of the arm at rest under the loads of t = 0, and save it."""
    described = _load(scenario, settings)
    folder = _folder(out, scenario, "-equilibrium")
    from crinoid.cli.play import find_equilibrium

    with _told():
        trouble = find_equilibrium(described, folder, console=console)
    _end(trouble)


@app.command()
def flow(
    scenario: ScenarioName,
    settings: Settings = None,
    out: Out = None,
) -> None:
    """Draw and sum up the current of a scenario at its arm, without simulating the arm."""
    described = _load(scenario, settings)
    folder = _folder(out, scenario, "-flow")
    from crinoid.cli.current import show_current

    with _told():
        show_current(described, folder, console=console)


@app.command()
def scenarios(
    copy: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Write a built-in scenario to NAME.toml, to change it."),
    ] = None,
    schema: Annotated[
        bool, typer.Option("--schema", help="Print the JSON schema of a scenario, for editors.")
    ] = False,
) -> None:
    """List the built-in scenarios, copy one, or print their schema."""
    if schema:
        typer.echo(json.dumps(json_schema(), indent=2))
    elif copy is not None:
        with _told():
            contents = {Path(f"{copy}.toml"): builtin_text(copy).encode()}
            contents |= {Path(file.name): file.read_bytes() for file in builtin_files(copy)}
            for path in contents:
                if path.exists():
                    _stop(f"{path}: already there; move it away first")
            for path, content in contents.items():
                path.write_bytes(content)
                console.print(f"wrote {path}")
    else:
        for name in builtin_names():
            console.print(f"{name:18}{load(name).title}")


@app.command()
def report(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="A folder that `crinoid run` wrote.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to write.", show_default="beside the result"),
    ] = None,
) -> None:
    """Draw the figures of a result."""
    from crinoid.report import ReportError, write_report

    try:
        with _told():
            paths = write_report(result, out)
    except ReportError as error:
        _stop(str(error))
    for path in paths:
        console.print(f"wrote {path}", soft_wrap=True)


def _load(name: str, settings: list[str] | None) -> Scenario:
    with _told():
        return load(name, settings or ())


def _folder(out: Path | None, name: str, ending: str = "") -> Path:
    folder = out if out is not None else Path("results") / f"{Path(name).stem}{ending}"
    with _told():
        if folder.exists() and not folder.is_dir():
            _stop(f"--out: {folder} is a file, takes a folder")
    return folder


@contextmanager
def _told() -> Iterator[None]:
    """Turn what a user can mend into one line each, and no traceback."""
    try:
        yield
    except ScenarioError as error:
        _stop(*error.lines)
    except OSError as error:
        _stop(f"{error.filename or 'file'}: {error.strerror or error}")
    except KeyboardInterrupt:
        errors.print("crinoid: interrupted before there was anything to save")
        raise typer.Exit(INTERRUPTED) from None


def _stop(*lines: str) -> NoReturn:
    for line in lines:
        errors.print(f"crinoid: {line}")
    raise typer.Exit(BAD_INPUT)


def _end(trouble: str) -> None:
    if trouble:
        errors.print(f"crinoid: {trouble}")
        raise typer.Exit(INTERRUPTED if trouble.startswith("interrupted") else FAILED)
