"""Processes that draw the pictures of a film side by side."""

from collections.abc import Generator
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection

from crinoid.foundation.child_processes import signals_blocked
from crinoid.foundation.cores import cores
from crinoid.results.report_error import ReportError
from crinoid.results.scene.scene import Scene
from crinoid.view.film.camera import FilmSettings
from crinoid.view.film.encode import Image
from crinoid.view.film.picture import Picture
from crinoid.view.film.settings import CameraSettings

_LEAST = 60  # frames of a process: fewer are drawn by one before another has started
_MOST = 8  # processes, which keep the encoder busy

Order = tuple[Scene, CameraSettings, FilmSettings, str, str]  # arguments of `Picture`


def drawn(picture: Picture, order: Order, frames: FilmSettings) -> Generator[Image, None, None]:
    """Yield all frames, in turn from some processes where they are many; closing kills these."""
    count = frames.times.size
    number = min(cores(), _MOST, count // _LEAST)
    if number < 2:
        yield from map(picture.at, frames.times.tolist())
        return
    context = get_context("spawn")
    # not a pool: one pipe of all processes stays open, and blocks, where one of them dies
    pipes = [context.Pipe() for _ in range(number)]
    workers = [context.Process(target=_work, args=(end,), daemon=True) for _, end in pipes]
    try:
        with signals_blocked():
            for worker, (_, end) in zip(workers, pipes, strict=True):
                worker.start()
                end.close()  # that of the worker stays open
        for first, (pipe, _) in enumerate(pipes):
            pipe.send((order, slice(first, None, number)))
        for index in range(count):
            yield pipes[index % number][0].recv()
    except (EOFError, OSError) as error:
        raise ReportError("a process that draws frames ended. Is there enough memory?") from error
    finally:
        for worker in workers:
            if worker.pid is not None:
                worker.kill()
                worker.join()


def _work(pipe: Connection) -> None:
    """Draw the part of the frames that an order names."""
    with suppress(EOFError, OSError):  # the film has ended
        order, part = pipe.recv()
        picture = Picture(*order)
        for time in order[2].times[part].tolist():
            pipe.send(picture.at(time))
