"""The command `train`, and its options."""

from pathlib import Path
from typing import Annotated

import typer

from crinoid.cli.command import end, folder_for, load_scenario, told
from crinoid.cli.interruption import Loading
from crinoid.cli.options import (
    Force,
    ScenarioName,
    Settings,
    complete_key,
    console,
    out_option,
    stop,
)


@told()
def train(
    scenario: ScenarioName,
    method: Annotated[
        str, typer.Option(metavar="KIND", help="How it is improved: gradient or ppo.")
    ] = "gradient",
    teacher: Annotated[
        str,
        typer.Option(metavar="KIND", help="What it imitates first: lqg, mpc, pid or none."),
    ] = "lqg",
    draw: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=LOW:HIGH",
            help="Key that each episode draws.",
            show_default="stiffness, currents, sensor, tool",
            autocompletion=complete_key,
        ),
    ] = None,
    arms: Annotated[int, typer.Option(metavar="N", help="Arms that are run at a time.")] = 16,
    updates: Annotated[int, typer.Option(metavar="N", help="Largest number of updates.")] = 1500,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of everything random.")] = 0,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-train")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from where an interrupted training stopped.")
    ] = False,
    force: Force = False,
) -> None:
    """Train a neural policy in simulation."""
    described, folder = load_scenario(scenario, settings), folder_for(out, scenario, "-train")
    try:
        with Loading():
            from crinoid.cli.training import drawn_keys, train_policy
            from crinoid.learning.settings import Settings as How
    except ImportError as error:
        stop(f'training needs {error.name or "Gymnasium"}: pip install "crinoid[learn]"')

    how = How(method, teacher, arms, updates, seed, drawn_keys(described, draw))
    end(train_policy(described, how, folder, resume=resume, force=force, console=console))
