"""Signals as a terminal sends them."""

import signal
from collections.abc import Iterator

_USUAL = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}


def usual_signals() -> Iterator[None]:
    """Heed signals for the time of a test: in the background of a script some are ignored."""
    before = {number: signal.signal(number, handler) for number, handler in _USUAL.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
