"""The arguments that commands have in common, and how they speak."""

from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from crinoid.cli.terminal import Terminal

BAD_INPUT = 2

console = Terminal()
errors = Terminal(stderr=True, soft_wrap=True)


def stop(*lines: str) -> NoReturn:
    """Say what is wrong with the input, and end."""
    for line in lines:
        errors.print(f"crinoid: {' '.join(line.splitlines())}")
    raise typer.Exit(BAD_INPUT)


def complete_name(begun: str) -> list[str]:
    """Complete the name of a built-in scenario."""
    from crinoid.scenario import builtin_names

    return [name for name in builtin_names() if name.startswith(begun)]


def complete_key(begun: str) -> list[str]:
    """Complete a key of a scenario, up to its equals sign."""
    from crinoid.scenario import Scenario
    from crinoid.scenario.keys import all_keys

    found = all_keys(Scenario.model_json_schema())
    return [f"{key}=" for key, table in found.items() if key.startswith(begun) and not table]


ScenarioName = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="A TOML file, or the name of a built-in scenario.",
        autocompletion=complete_name,
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a key, such as arm.length=0.6.",
        autocompletion=complete_key,
    ),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force", help="Replace the finished result of another scenario, or files of others."
    ),
]


def out_option(folder: str) -> Any:
    """Return the option that names the folder to write to; ``folder`` says which by default."""
    return typer.Option(
        "--out", metavar="DIR", help="Where to write.", show_default=folder, parser=_named
    )


def _named(folder: str) -> Path:
    if not folder:
        stop("--out: got an empty name, takes a folder")
    return Path(folder)
