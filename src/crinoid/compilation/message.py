"""Message about a long compilation."""

import logging
import multiprocessing
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

_LONG = 5.0  # compile time in all from which a message is worth its line (s)
_SOON = 1.0  # least time of one compilation before it is reported (s)
_LOGGER = logging.getLogger(__name__)
_subject = "the arm"
_spent: defaultdict[str, float] = defaultdict(float)
"""Compile time of each subject in this process (s)."""
_said: set[str] = set()


def about(subject: str) -> None:
    """Set the subject of later messages, such as "the arm in space"."""
    global _subject
    _subject = subject


@contextmanager
def reported() -> Iterator[None]:
    """Report a compilation if it is long, once for each subject."""
    subject = _subject
    timer = threading.Timer(max(_SOON, _LONG - _spent[subject]), _say, [subject])
    timer.daemon = True
    timer.start()
    start = time.perf_counter()
    try:
        yield
    finally:
        timer.cancel()
        _spent[subject] += time.perf_counter() - start


def _say(subject: str) -> None:
    # a worker leaves it to the sweep that started it
    if subject not in _said and multiprocessing.parent_process() is None:
        _said.add(subject)
        words = "once for this kind of arm; usually 5 to 30 s"
        _LOGGER.warning(f"crinoid: compiling {subject} ({words})")
