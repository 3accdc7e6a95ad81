"""The command line, and the commands that run or examine one scenario."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from crinoid.cli.command import (
    MISSED,
    Force,
    ScenarioName,
    Settings,
    at_least,
    complete_key,
    complete_name,
    console,
    end,
    folder_for,
    load_scenario,
    one_line_errors,
    option,
    out_option,
    resume_option,
    stop,
)
from crinoid.cli.interruption import Loading
from crinoid.cli.result_commands import export, film, report
from crinoid.cli.study_commands import (
    compare,
    estimate,
    identify,
    optimise,
    sweep,
    train,
    tune,
)

_DEFAULT = "station-keeping"
_DURATION = "simulation.duration="
_MODELS = ("npz", "mat", "json")
"""Formats of a linear model."""

app = typer.Typer(
    name="crinoid",
    help="Simulate and control a soft robotic arm in moving water.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@app.callback(invoke_without_command=True)
def _version(
    version: Annotated[
        bool, option("Print the version, and those that matter.", name="--version")
    ] = False,
) -> None:
    if version:
        from crinoid.foundation.version import versions

        own, *others = (f"{name} {number}" for name, number in versions().items())
        typer.echo(f"{own}\n{', '.join(others)}")
        raise typer.Exit


@app.command()
@one_line_errors()
def run(
    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="[SCENARIO]",
            help="A TOML file, or the name of a built-in scenario.",
            show_default=_DEFAULT,
            autocompletion=complete_name,
        ),
    ] = None,
    settings: Settings = None,
    case: Annotated[
        tuple[Path, int] | None,
        option("Play run N of the sweep in DIR again.", "DIR N", default=False),
    ] = None,
    out: Annotated[Path | None, out_option("results/SCENARIO")] = None,
    resume: Annotated[bool, resume_option("run")] = False,
    force: Force = False,
) -> None:
    """Run a scenario and save what happened."""
    if case is None:
        name = _DEFAULT if scenario is None else scenario
        described, folder = load_scenario(name, settings), folder_for(out, name, "", settings)
        if resume and not folder.exists():  # of a run that is prolonged
            kept = [each for each in settings or () if not each.startswith(_DURATION)]
            folder = folder_for(out, name, "", kept)
    else:
        if scenario is not None or settings:
            stop("--case: excludes SCENARIO and --set. Leave them out; the sweep has them.")
        with Loading():
            from crinoid.scenario.errors import got
            from crinoid.studies.sweep.plan import read_plan

        place, number = case
        plan = read_plan(place)
        if not 1 <= number <= plan.runs:
            stop(f"--case: {got(number, f'be a run from 1 to {plan.runs}')}")
        described = plan.case(number)
        folder = folder_for(out or place / plan.name(number), str(place))
    with Loading():
        from crinoid.cli.run import run_scenario
        from crinoid.cli.study import run_study

    run_it = run_study if described.vary else run_scenario
    end(run_it(described, folder, resume=resume, force=force))


@app.command()
@one_line_errors()
def equilibrium(
    scenario: ScenarioName,
    vary: Annotated[
        list[str] | None,
        option(
            "Follow the equilibrium over a number, and back: a bending curve.",
            "KEY=FROM:TO:COUNT",
            complete=complete_key,
        ),
    ] = None,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-equilibrium")] = None,
    force: Force = False,
) -> None:
    """Find the shape of the arm at rest under the loads of t = 0, and save it."""
    from crinoid.scenario.variation import read_variation

    for each in vary or ():
        read_variation(each)
    described = load_scenario(scenario, settings)
    folder = folder_for(out, scenario, "-equilibrium", settings)
    with Loading():
        from crinoid.cli.analyses import show_equilibria
        from crinoid.cli.display import say_absent
        from crinoid.cli.run import find_equilibrium

    say_absent(described)
    if vary:
        end(show_equilibria(described, vary, folder, force=force))
        return
    end(find_equilibrium(described, folder, force=force))


@app.command()
@one_line_errors("interrupted")
def flow(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO|FILE",
            help="A TOML file, the name of a built-in scenario, or a record of the sea.",
            autocompletion=complete_name,
        ),
    ],
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-flow")] = None,
    force: Force = False,
) -> None:
    """Draw and sum up the current of a scenario at its arm, or a record of the sea by itself."""
    folder = folder_for(out, scenario, "-flow", settings)
    path = Path(scenario)
    bag = (path / "metadata.yaml").is_file()
    if bag or (path.suffix.lower() not in ("", ".toml") and path.exists()):
        with Loading():
            from crinoid.cli.record import show_record

        show_record(scenario, settings or (), folder, force=force)
        return
    described = load_scenario(scenario, settings)
    with Loading():
        from crinoid.cli.analyses import show_current

    show_current(described, folder, force=force)


@app.command()
@one_line_errors("interrupted")
def modes(
    scenario: ScenarioName,
    settings: Settings = None,
    count: Annotated[int, option("How many modes to find.", "N")] = 6,
    in_air: Annotated[
        bool, option("Leave out the water: those in air only.", name="--in-air")
    ] = False,
    out: Annotated[Path | None, out_option("results/SCENARIO-modes")] = None,
    force: Force = False,
) -> None:
    """Find small vibrations about the equilibrium: frequencies, damping ratios and shapes."""
    at_least(1, {"--count": count})
    described = load_scenario(scenario, settings)
    folder = folder_for(out, scenario, "-modes", settings)
    with Loading():
        from crinoid.cli.analyses import show_modes

    end(show_modes(described, folder, count=count, in_air=in_air, force=force))


@app.command()
@one_line_errors("interrupted")
def margins(
    scenario: ScenarioName,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-margins")] = None,
    force: Force = False,
) -> None:
    """Find the stability margins of the control loop of a scenario, and draw them."""
    described = load_scenario(scenario, settings)
    folder = folder_for(out, scenario, "-margins", settings)
    with Loading():
        from crinoid.cli.analyses import show_margins

    show_margins(described, folder, force=force)


@app.command()
@one_line_errors("interrupted")
def linearise(
    scenario: ScenarioName,
    settings: Settings = None,
    to: Annotated[str, option("Format of the model: npz, mat or json.", "FORMAT")] = "npz",
    order: Annotated[
        int | None, option("Reduce it to so many states.", "N", default="all states")
    ] = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-linearise")] = None,
    force: Force = False,
) -> None:
    """Linearise arm, actuators and sensors: A, B, C, D over a control period, with names."""
    from crinoid.scenario.errors import got, one_of, refusal

    if to not in _MODELS:
        raise refusal("--to", got(to, f"be {one_of(_MODELS)}"))
    at_least(1, {"--order": order})
    described = load_scenario(scenario, settings)
    folder = folder_for(out, scenario, "-linearise", settings)
    with Loading():
        from crinoid.cli.linearise import show_linearisation

    show_linearisation(described, folder, to=to, order=order, force=force)


@app.command()
@one_line_errors("interrupted")
def live(
    scenario: ScenarioName,
    settings: Settings = None,
    port: Annotated[int, option("Where the page is served, on this machine; 0: any.")] = 8080,
    browser: Annotated[
        bool | None,
        option(
            "Whether to open a browser.",
            name="--browser/--no-browser",
            default="where there is a display",
        ),
    ] = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-live")] = None,
) -> None:
    """Simulate a scenario in the browser, in real time: turn its numbers, push it, record it."""
    from crinoid.scenario.errors import got, refusal

    if not 0 <= port <= 65535:
        raise refusal("--port", got(port, "be 0 (any free port) to 65535"))
    described = load_scenario(scenario, settings)
    folder = folder_for(out, scenario, "-live", settings)
    with Loading():
        from crinoid.cli.live import run_live

    end(run_live(described, folder, port=port, browser=browser))


@app.command()
@one_line_errors("interrupted")
def doctor() -> None:
    """Examine the installation: versions, devices, optional parts, folders, a known solve."""
    with Loading():
        from crinoid.cli.doctor import examine

    end(examine(), code=MISSED)


@app.command()
@one_line_errors("interrupted")
def scenarios(
    copy: Annotated[
        str | None,
        option(
            "Write a built-in scenario to NAME.toml, to change it.", "NAME", complete=complete_name
        ),
    ] = None,
    schema: Annotated[
        bool, option("Print the JSON schema of a scenario, for editors.", name="--schema")
    ] = False,
) -> None:
    """List the built-in scenarios, copy one, or print their schema."""
    from crinoid.scenario import builtin_files, builtin_names, builtin_text, json_schema, load

    if schema:
        typer.echo(json.dumps(json_schema(), indent=2))
    elif copy is not None:
        contents = {Path(f"{copy}.toml"): builtin_text(copy).encode()}
        contents |= {Path(file.name): file.read_bytes() for file in builtin_files(copy)}
        for path in contents:
            if os.path.lexists(path):
                stop(f"{path}: already there; move it away first")
        for path, content in contents.items():
            with path.open("xb") as file:  # not through a link that came in between
                file.write(content)
            console.print(f"wrote {path}")
    else:
        names = builtin_names()
        width = max(map(len, names)) + 2
        for name in names:
            console.print(f"{name:{width}}{load(name).title}", soft_wrap=True)


for command in (
    compare, tune, identify, estimate, optimise, report, export, film, sweep, train
):  # fmt: skip
    app.command()(command)


def _moved(name: str, program: str) -> Callable[[], None]:
    return lambda: stop(f"{name}: not in the package. In a clone of crinoid, run: {program}")


_MOVED = {"validate": "python -m validation", "bench": "python -m benchmarks"}
"""Former commands, and the programs of the repository in their place."""
for name, program in _MOVED.items():
    anything = {"ignore_unknown_options": True, "allow_extra_args": True}
    as_before = app.command(name, hidden=True, add_help_option=False, context_settings=anything)
    as_before(_moved(name, program))
