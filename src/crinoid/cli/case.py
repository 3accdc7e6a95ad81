"""The runs that `run` plays: a scenario, or one run of a sweep again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from crinoid.cli.command import folder_for, load_scenario
from crinoid.cli.interruption import Loading
from crinoid.cli.options import complete_name, stop

if TYPE_CHECKING:
    from crinoid.scenario import Scenario

_DEFAULT = "station-keeping"

RunName = Annotated[
    str | None,
    typer.Argument(
        metavar="[SCENARIO]",
        help="A TOML file, or the name of a built-in scenario.",
        show_default=_DEFAULT,
        autocompletion=complete_name,
    ),
]
Case = Annotated[
    tuple[Path, int] | None,
    typer.Option(metavar="DIR N", help="Play run N of the sweep in DIR again.", show_default=False),
]


def load_run(
    name: str | None,
    settings: list[str] | None,
    case: tuple[Path, int] | None,
    out: Path | None,
) -> tuple[Scenario, Path]:
    """Load what is to be run, and find the folder for it."""
    if case is None:
        name = _DEFAULT if name is None else name
        return load_scenario(name, settings), folder_for(out, name)
    if name is not None or settings:
        stop("--case: takes no SCENARIO and no --set beside it: the sweep has them")
    with Loading():
        from crinoid.sweep import SweepStore

    folder, number = case
    plan = SweepStore(folder).read_plan()
    if not 1 <= number <= plan.runs:
        stop(f"--case: got {number}, takes a run from 1 to {plan.runs}")
    place = folder / plan.name(number)
    return plan.case(number), folder_for(out or place, str(place))
