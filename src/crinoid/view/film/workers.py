"""Processes that draw the pictures of a film side by side."""

import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np

from crinoid.foundation.cores import cores
from crinoid.results.report_error import ReportError
from crinoid.results.scene.scene import Scene
from crinoid.view.film.camera import FilmSettings
from crinoid.view.film.encode import Image
from crinoid.view.film.picture import Picture, film_style
from crinoid.view.film.settings import CameraSettings

_LEAST = 60  # frames of a process: fewer are drawn by one before another has started
_MOST = 8  # processes, which keep the encoder busy

Order = tuple[Scene, CameraSettings, FilmSettings, str, str]
"""Arguments of `Picture`."""
_Worker = subprocess.Popen[bytes]


@contextmanager
def drawn(picture: Picture, order: Order, frames: FilmSettings) -> Iterator[Iterator[Image]]:
    """Draw all frames, in turn by some processes where they are many; kill these at the end."""
    number = min(cores(), _MOST, frames.times.size // _LEAST)
    if number < 2:
        yield map(picture.at, frames.times.tolist())
        return
    workers: list[_Worker] = []
    try:
        for _ in range(number):
            workers.append(_start())
        for first, worker in enumerate(workers):
            _send(worker, (*order, slice(first, None, number)))
        yield (_receive(workers[i % number], frames.size) for i in range(frames.times.size))
    finally:
        for worker in workers:
            worker.kill()
            with suppress(OSError), worker:  # its pipes, and an order that it did not read
                pass


def _start() -> _Worker:
    # not by `multiprocessing`, which would import a user's script again
    command = [sys.executable, "-P", "-m", __name__]
    path = os.pathsep.join(filter(None, sys.path))
    return subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": path},
        # a terminal's Ctrl-C is for the film itself, which kills them
        start_new_session=True,
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
    )


def _send(worker: _Worker, order: object) -> None:
    assert worker.stdin is not None
    with suppress(BrokenPipeError), worker.stdin:  # `_receive` tells that it ended
        pickle.dump(order, worker.stdin, pickle.HIGHEST_PROTOCOL)


def _receive(worker: _Worker, size: tuple[int, int]) -> Image:
    assert worker.stdout is not None
    picture = np.empty((size[1], size[0], 4), np.uint8)
    if worker.stdout.readinto(picture.data) < picture.nbytes:  # type: ignore[attr-defined]
        raise ReportError(f"a process that draws frames ended (exit code {worker.wait()})")
    return picture


def _work() -> None:
    """Draw the frames of an order, and write them to the standard output."""
    pictures, sys.stdout = sys.stdout.buffer, sys.stderr
    with suppress(EOFError, BrokenPipeError), film_style():  # the film was interrupted
        *order, part = pickle.load(sys.stdin.buffer)
        picture = Picture(*order)
        for time in order[2].times[part]:
            pictures.write(picture.at(float(time)).data)
            pictures.flush()


if __name__ == "__main__":
    _work()
