"""The command `sweep`, and its options."""

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
def sweep(
    scenario: ScenarioName,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUES",
            help="What varies: FROM:TO:COUNT, FROM:TO:COUNT:log or A,B,C; with --sample also "
            "FROM:TO and FROM:TO:log.",
            autocompletion=complete_key,
        ),
    ] = None,
    sample: Annotated[
        str,
        typer.Option(
            metavar="KIND", help="How ranges without a count are filled: lhs, sobol or saltelli."
        ),
    ] = "grid",
    count: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="How many points to sample; of saltelli, blocks of as many as keys and two.",
            show_default=False,
        ),
    ] = None,
    seeds: Annotated[
        int, typer.Option(metavar="N", help="How many seeds to run each with, from seed on.")
    ] = 1,
    batch: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Runs that are sent and saved together.",
            show_default="up to 100, in 200 batches",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", help="Workers on this machine.", show_default="one a core"),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Scheduler of dask.distributed whose workers are to run it.",
            show_default="this machine",
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Tell what it would take, and write nothing.")
    ] = False,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-sweep")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from where an interrupted sweep stopped.")
    ] = False,
    force: Force = False,
) -> None:
    """Run a scenario with many values and seeds, on all cores or on a cluster."""
    described, folder = load_scenario(scenario, settings), folder_for(out, scenario, "-sweep")
    with Loading():
        from crinoid.cli.crew import Hands, check_hands
        from crinoid.cli.sweeping import estimate_sweep, run_sweep
        from crinoid.sweep import Plan

    plan = Plan.of(described, vary or (), sampling=sample, count=count, seeds=seeds, batch=batch)
    hands = Hands(workers, scheduler)
    check_hands(hands)
    if dry_run:
        if resume or force:
            stop("--dry-run: takes no --resume and no --force beside it: it writes nothing")
        estimate_sweep(plan, hands, console)
        return
    end(
        run_sweep(
            plan,
            folder,
            hands,
            sized=batch is not None,
            resume=resume,
            force=force,
            console=console,
        )
    )
