"""Ctrl-C during a run: it ends after the chunk that is running."""

from __future__ import annotations

import signal
import threading


class CtrlC:
    """Turns the first Ctrl-C into a request to stop after the chunk that is running."""

    def __init__(self) -> None:
        self._asked = False

    def __call__(self) -> bool:
        """Tell whether to stop."""
        return self._asked

    def __enter__(self) -> CtrlC:
        self._main = threading.current_thread() is threading.main_thread()
        if self._main:  # where alone Python lets signals be handled
            self._earlier = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        if self._main:
            signal.signal(signal.SIGINT, self._earlier)

    def _ask(self, *_: object) -> None:
        self._asked = True
        signal.signal(signal.SIGINT, self._earlier)  # a second one stops at once
