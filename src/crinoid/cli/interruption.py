"""Interruption by Ctrl-C or another signal: the program stops, and loses nothing."""

from __future__ import annotations

import os
import signal
import stat
import sys
from collections.abc import Callable
from typing import Any

INTERRUPTED = 130  # exit code


class Interrupted(BaseException):
    """An immediate request to stop; on KeyboardInterrupt typer would end without a message."""


_HANG_UP = getattr(signal, "SIGHUP", None)  # Windows has none
_SIGNALS = [number for number in (signal.SIGINT, signal.SIGTERM, _HANG_UP) if number is not None]


def heed() -> None:
    """Treat a request to end the program, and the end of its terminal, like Ctrl-C."""
    sys.unraisablehook = _overlook
    Interruption().__enter__()


def ignore() -> None:
    """Ignore all signals, which could make the program crash while it ends."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


class Interruption:
    """A request to stop: raised immediately, or kept while there is something to save.

    Within ``with``, call `stop` to learn whether to stop; from the first call on a request is only
    kept, until `release`.
    """

    has_some: Callable[[], bool] | None = None
    """Whether there is something to save, of a search in threads, which may find it at any time."""

    def __init__(self) -> None:
        self.asked = False
        self._held = False

    def __enter__(self) -> Interruption:
        # `nohup` and the shell's ``&`` turn some off
        now = {number: signal.getsignal(number) for number in _SIGNALS}
        self._earlier = {number: how for number, how in now.items() if how is not signal.SIG_IGN}
        for number, handler in self._earlier.items():
            outer = getattr(handler, "__self__", None)
            if isinstance(outer, Interruption) and outer.asked:
                raise Interrupted  # the earlier exception was lost on the way
            signal.signal(number, self._hear)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._earlier.items():
            signal.signal(number, handler)

    def stop(self) -> bool:
        """Return whether to stop, and keep later requests if there is something to save now."""
        if self.asked and not self._held:
            raise Interrupted  # again: a destructor or the like has lost it
        self._held = self.has_some is None or self.has_some()
        return self.asked

    def release(self) -> bool:
        """Return whether to stop, and no longer keep such a request: all is saved."""
        self._held = False
        return self.asked

    def _hear(self, number: int, frame: Any) -> None:
        self.asked = True
        if number == _HANG_UP:
            _leave_terminal()
        self._held = self._held or (self.has_some is not None and self.has_some())
        if not self._held:
            raise Interrupted


class Loading(Interruption):
    """Loading of libraries: a request to stop ends the program, as there is nothing to save yet.

    Libraries in C answer an exception with messages and errors that mean nothing to users.
    """

    def _hear(self, number: int, frame: Any) -> None:
        if number == _HANG_UP:
            _leave_terminal()
        os.write(2, b"crinoid: interrupted\n")
        os._exit(INTERRUPTED)


def _overlook(lost: Any) -> None:
    """Suppress the message of an interrupt raised in a destructor; it is raised again later."""
    if lost.exc_type is not Interrupted:
        sys.__unraisablehook__(lost)


def _leave_terminal() -> None:
    """Redirect output from a closed terminal, which would raise, to nowhere."""
    for stream in (1, 2):
        try:
            gone = stat.S_ISCHR(os.fstat(stream).st_mode) and not os.isatty(stream)
        except OSError:
            continue  # it was closed from the start
        if gone:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream)
            os.close(nowhere)
