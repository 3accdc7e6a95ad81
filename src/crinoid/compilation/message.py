"""Message about a long compilation, with its duration the last time."""

import json
import logging
import multiprocessing
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from crinoid.foundation.atomic_file import atomic_write

_LONG = 5.0
"""Compile time in all from which a message is worth its line (s)."""
_SOON = 1.0
"""Time after which a compilation that was long the last time is reported (s)."""
_TIMES = "times.json"
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
def reported(folder: Path) -> Iterator[None]:
    """Report a compilation if it is long, once for each subject, and save its time in a folder."""
    subject, times = _subject, dict[str, float]()
    with suppress(OSError, ValueError, TypeError):  # none, or a damaged one
        times = dict(json.loads((folder / _TIMES).read_text("utf-8")))
    last = times.get(subject, 0.0)
    wait = _SOON if last > _LONG else max(_SOON, _LONG - _spent[subject])
    timer = threading.Timer(wait, _say, [subject, last])
    timer.daemon = True
    timer.start()
    start = time.perf_counter()
    try:
        yield
    finally:
        timer.cancel()
        _spent[subject] += time.perf_counter() - start
        if _spent[subject] > _LONG:
            times[subject] = round(_spent[subject], 1)
            with suppress(OSError), atomic_write(folder / _TIMES, private=True) as temporary:
                temporary.write_text(json.dumps(times), "utf-8")


def _say(subject: str, last: float) -> None:
    # a worker leaves it to the sweep that started it
    if subject not in _said and multiprocessing.parent_process() is None:
        _said.add(subject)
        before = f"; about {last:.0f} s" if last else "; usually 5 to 30 s"
        _LOGGER.warning(f"crinoid: compiling {subject} (once for this kind of arm{before})")
