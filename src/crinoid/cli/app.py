"""The commands."""

import json
import os
from pathlib import Path
from typing import Annotated

import typer

from crinoid.cli.case import Case, RunName, load_run
from crinoid.cli.command import end, folder_for, load_scenario, told
from crinoid.cli.film import film
from crinoid.cli.interruption import Loading
from crinoid.cli.live import live
from crinoid.cli.options import (
    Force,
    ScenarioName,
    Settings,
    complete_name,
    console,
    out_option,
    stop,
)
from crinoid.cli.sweep import sweep
from crinoid.cli.train import train

app = typer.Typer(
    name="crinoid",
    help="Simulate and control a soft robotic arm in moving water.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@app.callback(invoke_without_command=True)
def _version(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        from crinoid.version import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.command()
@told()
def run(
    scenario: RunName = None,
    settings: Settings = None,
    case: Case = None,
    out: Annotated[Path | None, out_option("results/SCENARIO")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from where an interrupted run stopped.")
    ] = False,
    force: Force = False,
) -> None:
    """Run a scenario and save what happened."""
    described, folder = load_run(scenario, settings, case, out)
    with Loading():
        from crinoid.cli.play import run_scenario

    end(run_scenario(described, folder, resume=resume, force=force, console=console))


@app.command()
@told()
def equilibrium(
    scenario: ScenarioName,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-equilibrium")] = None,
    force: Force = False,
) -> None:
    """Find the shape of the arm at rest under the loads of t = 0, and save it."""
    described, folder = load_scenario(scenario, settings), folder_for(out, scenario, "-equilibrium")
    with Loading():
        from crinoid.cli.play import find_equilibrium

    end(find_equilibrium(described, folder, force=force, console=console))


@app.command()
@told("interrupted")
def flow(
    scenario: ScenarioName,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-flow")] = None,
    force: Force = False,
) -> None:
    """Draw and sum up the current of a scenario at its arm, without simulating the arm."""
    described, folder = load_scenario(scenario, settings), folder_for(out, scenario, "-flow")
    with Loading():
        from crinoid.cli.current import show_current
        from crinoid.report import ReportError

    try:
        show_current(described, folder, force=force, console=console)
    except ReportError as error:
        stop(str(error))


@app.command()
@told()
def compare(
    scenario: ScenarioName,
    controllers: Annotated[
        str,
        typer.Option(metavar="KINDS", help="Kinds of controllers, with commas between them."),
    ] = "none,pid",
    seeds: Annotated[int, typer.Option(help="Number of seeds.")] = 10,
    first_seed: Annotated[int, typer.Option(help="The first one of them.")] = 0,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-compare")] = None,
    force: Force = False,
) -> None:
    """Run a scenario under several controllers over several seeds, and compare them."""
    described, folder = load_scenario(scenario, settings), folder_for(out, scenario, "-compare")
    with Loading():
        from crinoid.cli.compare import compare_controllers, kinds_of, seeds_of

    kinds, every = kinds_of(controllers), seeds_of(seeds, first_seed)
    end(compare_controllers(described, kinds, every, folder, force=force, console=console))


@app.command()
@told("interrupted")
def modes(
    scenario: ScenarioName,
    settings: Settings = None,
    count: Annotated[int, typer.Option("--count", metavar="N", help="How many modes to find.")] = 6,
    in_air: Annotated[
        bool, typer.Option("--in-air", help="Leave out the water: those in air only.")
    ] = False,
    out: Annotated[Path | None, out_option("results/SCENARIO-modes")] = None,
    force: Force = False,
) -> None:
    """Find small vibrations about the equilibrium: frequencies, damping ratios and shapes."""
    described, folder = load_scenario(scenario, settings), folder_for(out, scenario, "-modes")
    with Loading():
        from crinoid.cli.modes import show_modes
        from crinoid.report import ReportError

    try:
        end(show_modes(described, folder, count=count, in_air=in_air, force=force, console=console))
    except ReportError as error:
        stop(str(error))


@app.command()
@told("interrupted")
def margins(
    scenario: ScenarioName,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-margins")] = None,
    force: Force = False,
) -> None:
    """Find how far the control loop of a scenario is from swinging by itself, and draw it."""
    described, folder = load_scenario(scenario, settings), folder_for(out, scenario, "-margins")
    with Loading():
        from crinoid.cli.margins import show_margins

    show_margins(described, folder, force=force, console=console)


@app.command()
@told()
def tune(
    scenario: ScenarioName,
    seeds: Annotated[int, typer.Option(help="Number of seeds that it is tuned for.")] = 4,
    iterations: Annotated[int, typer.Option(help="Largest number of trials from each start.")] = 25,
    margin: Annotated[
        float, typer.Option(help="Modulus margin that the loop is to keep; 0: none.")
    ] = 0.5,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-tune")] = None,
    force: Force = False,
) -> None:
    """Tune a PID, LQG or MPC by gradient, from several starts over several seeds."""
    described, folder = load_scenario(scenario, settings), folder_for(out, scenario, "-tune")
    with Loading():
        from crinoid.cli.tune import tune_controller

    numbers = seeds, iterations, margin
    end(tune_controller(described, *numbers, folder, force=force, console=console))


@app.command()
@told()
def identify(
    scenario: ScenarioName,
    record: Annotated[
        Path,
        typer.Argument(
            metavar="RECORD",
            show_default=False,
            help="What was measured: a CSV or netCDF file with time and coordinates of the tip, or "
            "a result.",
        ),
    ],
    of: Annotated[
        str,
        typer.Option(
            metavar="KEY,KEY",
            show_default=False,
            help="Keys of the numbers to find, such as arm.youngs_modulus,water.drag_normal.",
        ),
    ],
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-identify")] = None,
    force: Force = False,
) -> None:
    """Find stiffness, damping, drag and other numbers from a recorded motion of the tip."""
    described, folder = load_scenario(scenario, settings), folder_for(out, scenario, "-identify")
    with Loading():
        from crinoid.cli.identify import identify_numbers

    keys = [each for each in (part.strip() for part in of.split(",")) if each]
    end(identify_numbers(described, record, keys, folder, force=force, console=console))


@app.command()
@told("interrupted")
def scenarios(
    copy: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Write a built-in scenario to NAME.toml, to change it.",
            autocompletion=complete_name,
        ),
    ] = None,
    schema: Annotated[
        bool, typer.Option("--schema", help="Print the JSON schema of a scenario, for editors.")
    ] = False,
) -> None:
    """List the built-in scenarios, copy one, or print their schema."""
    from crinoid.scenario import builtin_names, json_schema, load

    if schema:
        typer.echo(json.dumps(json_schema(), indent=2))
    elif copy is not None:
        _copy(copy)
    else:
        names = builtin_names()
        width = max(map(len, names)) + 2
        for name in names:
            console.print(f"{name:{width}}{load(name).title}", soft_wrap=True)


@app.command()
@told("interrupted")
def report(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="A folder that `crinoid run` wrote.")
    ],
    out: Annotated[Path | None, out_option("beside the result")] = None,
) -> None:
    """Draw the figures of a result, and write its page."""
    with Loading():
        from crinoid.cli.lines import say_written
        from crinoid.report import ReportError, write_report

    try:
        paths = write_report(result, out)
    except ReportError as error:
        stop(str(error))
    say_written(console, paths)


@app.command()
@told("interrupted")
def export(
    result: Annotated[
        Path,
        typer.Argument(
            metavar="RESULT", help="A folder that `crinoid run` wrote, or a result in it."
        ),
    ],
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="FORMAT",
            show_default=False,
            help="vtkhdf, csv or gltf; of a policy, onnx.",
        ),
    ],
    variables: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME",
            show_default="all that are not along the arm",
            help="Of a table: variables, such as tip_position,tip_error.",
        ),
    ] = None,
    nodes: Annotated[
        str | None,
        typer.Option(
            metavar="N,N",
            show_default="all",
            help="Of a table: nodes or edges of variables along the arm; -1 is the last.",
        ),
    ] = None,
    instants: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            show_default="1501, in a table 1000000",
            help="Largest number of instants, evenly chosen.",
        ),
    ] = None,
    out: Annotated[Path | None, out_option("beside the result")] = None,
    force: Force = False,
) -> None:
    """Write a result for ParaView (vtkhdf), for spreadsheets (csv) or for Blender (gltf).

    A policy that `crinoid train` wrote is written for a vehicle (onnx).
    """
    with Loading():
        from crinoid.cli.export import Table, export_result
        from crinoid.report import ReportError

    table = Table(variables, nodes)
    try:
        export_result(result, to, out, table, instants=instants, force=force, console=console)
    except ReportError as error:
        stop(str(error))


app.command()(film)
app.command()(live)
app.command()(sweep)
app.command()(train)


def _copy(name: str) -> None:
    from crinoid.scenario import builtin_files, builtin_text

    contents = {Path(f"{name}.toml"): builtin_text(name).encode()}
    contents |= {Path(file.name): file.read_bytes() for file in builtin_files(name)}
    for path in contents:
        if os.path.lexists(path):
            stop(f"{path}: already there; move it away first")
    for path, content in contents.items():
        with path.open("xb") as file:  # not through a link that came in between
            file.write(content)
        console.print(f"wrote {path}")
