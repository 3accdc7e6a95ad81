"""The command `live`, and its options."""

from pathlib import Path
from typing import Annotated

import typer

from crinoid.cli.command import end, folder_for, load_scenario, told
from crinoid.cli.interruption import Loading
from crinoid.cli.options import ScenarioName, Settings, console, out_option


@told("interrupted")
def live(
    scenario: ScenarioName,
    settings: Settings = None,
    port: Annotated[
        int, typer.Option("--port", help="Where the page is served, on this machine; 0: any.")
    ] = 8080,
    browser: Annotated[
        bool | None,
        typer.Option(
            "--browser/--no-browser",
            show_default="where there is a display",
            help="Whether to open a browser.",
        ),
    ] = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-live")] = None,
) -> None:
    """Simulate a scenario in the browser, in real time: turn its numbers, push it, record it."""
    described, folder = load_scenario(scenario, settings), folder_for(out, scenario, "-live")
    with Loading():
        from crinoid.cli.watching import run_live

    end(run_live(described, folder, port=port, browser=browser, console=console))
