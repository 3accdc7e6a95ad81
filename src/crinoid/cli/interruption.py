"""Ctrl-C, and the signals that end a program as well: they stop it, and it loses nothing."""

from __future__ import annotations

import os
import signal
import stat
import sys
from typing import Any

INTERRUPTED = 130
"""Exit code."""


class Interrupted(BaseException):
    """A wish to stop that is heard at once; typer would end without a word on KeyboardInterrupt."""


_HANG_UP = getattr(signal, "SIGHUP", None)  # Windows has none
_SIGNALS = [number for number in (signal.SIGINT, signal.SIGTERM, _HANG_UP) if number is not None]


def heed() -> None:
    """Let a request to end the program, and the end of its terminal, do what Ctrl-C does."""
    sys.unraisablehook = _overlook
    Interruption().__enter__()


def ignore() -> None:
    """Let the program end in peace, which a signal on the way would make it crash."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


class Interruption:
    """A wish to stop: heard at once, or, while there is something to save, after that is saved.

    Within ``with``, `stop` is to be asked whether to stop; from the first time on the wish is only
    kept, until `release`.
    """

    def __init__(self) -> None:
        self.asked = False
        self._held = False

    def __enter__(self) -> Interruption:
        self._earlier = {number: signal.getsignal(number) for number in _heeded()}
        for number, handler in self._earlier.items():
            outer = getattr(handler, "__self__", None)
            if isinstance(outer, Interruption) and outer.asked:
                raise Interrupted  # what it raised was lost on the way
            signal.signal(number, self._hear)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._earlier.items():
            signal.signal(number, handler)

    def stop(self) -> bool:
        """Tell whether to stop, and hold later wishes: now there is something to save."""
        if self.asked and not self._held:
            raise Interrupted  # again: something on the way, such as a destructor, has lost it
        self._held = True
        return self.asked

    def release(self) -> bool:
        """Tell whether to stop, and no longer hold such a wish: all is saved."""
        self._held = False
        return self.asked

    def _hear(self, number: int, frame: Any) -> None:
        self.asked = True
        if number == _HANG_UP:
            _leave_terminal()
        if not self._held:
            raise Interrupted


class Loading(Interruption):
    """While libraries are loaded: a wish to stop ends the program at once, as nothing is there yet.

    Libraries in C answer an exception with words and errors of their own.
    """

    def _hear(self, number: int, frame: Any) -> None:
        if number == _HANG_UP:
            _leave_terminal()
        os.write(2, b"crinoid: interrupted\n")
        os._exit(INTERRUPTED)


def _overlook(lost: Any) -> None:
    """Say nothing of a wish to stop that a destructor lost: it is kept, and heard later."""
    if lost.exc_type is not Interrupted:
        sys.__unraisablehook__(lost)


def _heeded() -> list[signal.Signals]:
    """Return the signals that are to be heeded: `nohup` and the shell's ``&`` turn some off."""
    return [number for number in _SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]


def _leave_terminal() -> None:
    """Write to nowhere instead of to a terminal that is gone, which would raise."""
    for stream in (1, 2):
        try:
            gone = stat.S_ISCHR(os.fstat(stream).st_mode) and not os.isatty(stream)
        except OSError:
            continue  # it was closed from the start
        if gone:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream)
            os.close(nowhere)
