"""Commands on one scenario, up to where JAX is loaded."""

import json
import os
from pathlib import Path

import typer

from crinoid.analysis.curve import Curve
from crinoid.cli.command import console, folder_for, load_text, stop
from crinoid.cli.commands import DEFAULT
from crinoid.cli.interruption import Loading
from crinoid.scenario import Scenario, builtin_files, builtin_names, builtin_text, json_schema, load
from crinoid.scenario.errors import got

_DURATION = "simulation.duration="


def run(
    scenario: str | None,
    settings: list[str] | None,
    case: tuple[Path, int] | None,
    out: Path | None,
    *,
    resume: bool,
    force: bool,
    full: bool,
) -> str:
    """Run a scenario, a study, or a run of a sweep again."""
    if case is None:
        name = DEFAULT if scenario is None else scenario
        described = load_text(name, settings).scenario
        folder = folder_for(out, name, "", settings)
        if resume and not folder.exists():  # of a run that is prolonged
            kept = [each for each in settings or () if not each.startswith(_DURATION)]
            folder = folder_for(out, name, "", kept)
    else:
        if scenario is not None or settings:
            stop("--case: excludes SCENARIO and --set. Leave them out; the sweep has them.")
        with Loading():
            from crinoid.studies.sweep.plan import read_plan

        place, number = case
        plan = read_plan(place)
        if not 1 <= number <= plan.runs:
            stop(f"--case: {got(number, f'be a run from 1 to {plan.runs}')}")
        described = plan.case(number)
        folder = folder_for(out or place / plan.name(number), str(place))
    if full and described.vary:
        stop("--all: excludes a study, whose cases.csv has all numbers. Omit it.")
    with Loading():
        from crinoid.cli.run import run_scenario
        from crinoid.cli.study import run_study

    if described.vary:
        return run_study(described, folder, resume=resume, force=force)
    return run_scenario(described, folder, resume=resume, force=force, full=full)


def equilibrium(scenario: Scenario, vary: list[str] | None, folder: Path, *, force: bool) -> str:
    """Find the equilibrium of a scenario, or follow it over a number."""
    curve = Curve.of(scenario, vary) if vary else None
    with Loading():
        from crinoid.cli.analyses import show_equilibria
        from crinoid.cli.display import say_absent
        from crinoid.cli.run import find_equilibrium

    say_absent(scenario)
    if curve is not None:
        return show_equilibria(scenario, curve, folder, force=force)
    return find_equilibrium(scenario, folder, force=force)


def flow(scenario: str, settings: list[str] | None, out: Path | None, *, force: bool) -> None:
    """Examine the current of a scenario, or a record of the sea."""
    folder = folder_for(out, scenario, "-flow", settings)
    path = Path(scenario)
    bag = (path / "metadata.yaml").is_file()
    if bag or (path.suffix.lower() not in ("", ".toml") and path.exists()):
        with Loading():
            from crinoid.cli.sea_record import show_record

        show_record(scenario, settings or (), folder, force=force)
        return
    described = load_text(scenario, settings).scenario
    with Loading():
        from crinoid.cli.analyses import show_current

    show_current(described, folder, force=force)


def scenarios(copy: str | None, *, schema: bool) -> None:
    """List the built-in scenarios, copy one, or print their schema."""
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
