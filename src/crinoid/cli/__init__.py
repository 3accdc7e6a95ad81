"""The command line: commands, progress, exit codes; no physics."""

import contextlib
import os
import sys

from crinoid.cli.interruption import INTERRUPTED, Interrupted, Loading, heed, ignore


def main() -> None:
    """Run the command line."""
    try:
        heed()
        with Loading():
            from crinoid.cli.app import app

        app()
    except Interrupted:  # while the program itself was loaded, or when it had said its last word
        print("crinoid: interrupted", file=sys.stderr)
        _leave()
    except SystemExit as end:
        if end.code == INTERRUPTED:
            _leave()
        raise
    finally:
        ignore()


def _leave() -> None:
    """End at once: amid its work stopped, JAX may crash while the interpreter ends in order."""
    ignore()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(INTERRUPTED)
