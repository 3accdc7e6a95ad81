"""The command line: commands, progress, exit codes; no physics."""

import sys

from crinoid.cli.interruption import INTERRUPTED, Interrupted, heed


def main() -> None:
    """Run the command line."""
    try:
        heed()
        from crinoid.cli.app import app

        app()
    except Interrupted:  # while the program itself was loaded
        print("crinoid: interrupted before there was anything to save", file=sys.stderr)
        sys.exit(INTERRUPTED)
