"""The command line: commands, progress, exit codes; no physics.

May import ``learning`` and lower folders.
"""

import contextlib
import gc
import io
import os
import sys
from importlib import import_module

from crinoid.cli.interruption import INTERRUPTED, Interrupted, Loading, heed, ignore

_ALLOCATIONS = 50_000  # new objects after which Python looks for garbage: libraries make many


def main(module: str = "crinoid.cli.app") -> None:
    """Run the command line that a module has as ``app``."""
    gc.set_threshold(_ALLOCATIONS)
    # matrices are small here: threads of linear algebra would only wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if isinstance(sys.stdout, io.TextIOWrapper):  # prints what its encoding lacks as escapes
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        heed()
        with Loading():
            app = import_module(module).app
        app()
    except Interrupted:  # while the program was loaded, or after its last output
        print("crinoid: interrupted", file=sys.stderr)
        _leave(INTERRUPTED)
    except SystemExit as end:
        if isinstance(end.code, int) and end.code:
            _leave(end.code)
        raise
    finally:
        ignore()
        gc.freeze()  # the system frees the memory of JAX, and much faster


def _leave(code: int) -> None:
    """End immediately: otherwise Python would wait for compilations, and JAX may crash."""
    ignore()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(code)
