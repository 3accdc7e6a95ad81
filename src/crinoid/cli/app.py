"""The command line: the program, and former commands."""

from collections.abc import Callable
from typing import Annotated

import typer

from crinoid.cli.command import stop
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


def _moved(name: str, program: str) -> Callable[[], None]:
    return lambda: stop(f"{name}: not in the package. In a clone of crinoid, run: {program}")


_group_of = {name: group for group, names in GROUPS.items() for name in names}
for command in sorted(COMMANDS, key=lambda each: [*_group_of].index(each.name)):
    command.add_to(app, _group_of[command.name])
_MOVED = {"validate": "python -m validation", "bench": "python -m benchmarks"}
"""Former commands, and the programs of the repository in their place."""
for name, program in _MOVED.items():
    anything = {"ignore_unknown_options": True, "allow_extra_args": True}
    as_before = app.command(name, hidden=True, add_help_option=False, context_settings=anything)
    as_before(_moved(name, program))
