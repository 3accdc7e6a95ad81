"""The command line: the program with its commands."""

from typing import Annotated

import typer

from crinoid.cli.commands import COMMANDS, GROUPS
from crinoid.cli.program import Program

app = typer.Typer(
    name="crinoid",
    cls=Program,
    help="Simulate and control a soft robotic arm in moving water.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@app.callback(invoke_without_command=True)
def _version(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version, and those that matter.")
    ] = False,
) -> None:
    if version:
        from crinoid.foundation.version import versions

        own, *others = (f"{name} {number}" for name, number in versions().items())
        typer.echo(f"{own}\n{', '.join(others)}")
        raise typer.Exit


_group_of = {name: group for group, names in GROUPS.items() for name in names}
for command in sorted(COMMANDS, key=lambda each: [*_group_of].index(each.name)):
    command.add_to(app, _group_of[command.name])
