"""Processes that draw the pictures of a film side by side."""

from collections import deque
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing import get_context
from typing import Any

from crinoid.foundation.child_processes import leave_with_parent, signals_blocked
from crinoid.foundation.cores import cores
from crinoid.results.report_error import ReportError
from crinoid.results.scene.scene import Scene
from crinoid.view.film.camera import FilmSettings
from crinoid.view.film.encode import Image
from crinoid.view.film.picture import Picture
from crinoid.view.film.settings import CameraSettings

_LEAST = 60  # frames of a process: fewer are drawn by one before another has started
_MOST = 8  # processes, which keep the encoder busy

_DIED = "a process that draws frames ended. Is there enough memory?"

Order = tuple[Scene, CameraSettings, FilmSettings, str, str]
"""Arguments of `Picture`."""


def drawn(picture: Picture, order: Order, frames: FilmSettings) -> Iterator[Image]:
    """Yield all frames, drawn by some processes where they are many; closing it ends these."""
    times = iter(frames.times.tolist())
    number = min(cores(), _MOST, frames.times.size // _LEAST)
    if number < 2:
        yield from map(picture.at, times)
        return
    pool = ProcessPoolExecutor(number, get_context("spawn"), _begin, order)
    try:
        with signals_blocked():  # the first frame starts all processes
            ahead = deque(pool.submit(_draw, time) for time in islice(times, 2 * number))
        while ahead:
            yield ahead.popleft().result()
            ahead.extend(pool.submit(_draw, time) for time in islice(times, 1))
    except BrokenProcessPool as error:
        raise ReportError(_DIED) from error
    finally:
        pool.shutdown(cancel_futures=True)


_pictures: list[Picture] = []  # that of a process


def _begin(*order: Any) -> None:
    leave_with_parent()
    _pictures.append(Picture(*order))


def _draw(time: float) -> Image:
    return _pictures[0].at(time)
