"""A controller that commands what it is given from outside."""

from crinoid.control import Controller, Seen
from crinoid.control.seen import Command


class Given(Controller):
    """Commands a number of its own for each input, whatever is seen."""

    value: Command
    """The command, in the units of the inputs (`crinoid.System.inputs`)."""

    def start(self, seen: Seen) -> None:
        return None

    def command(self, memory: None, seen: Seen) -> tuple[Command, None]:
        return self.value, None
