"""Film of a result, from its file to an MP4 or GIF."""

from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.status import Status
from crinoid.foundation.version import __version__
from crinoid.results.metrics import CASES, is_table
from crinoid.results.own_files import MADE
from crinoid.results.reading import open_drawable
from crinoid.results.report_error import ReportError
from crinoid.results.result import RESULT, Result
from crinoid.results.scene.scene import Scene, build_scene, omission_notes
from crinoid.view.film.camera import FilmSettings, film_settings
from crinoid.view.film.encode import FILMS, Image, check_place, has_encoder, write_gif, write_mp4
from crinoid.view.film.picture import Picture
from crinoid.view.film.settings import CameraSettings, ending_of
from crinoid.view.film.workers import drawn
from crinoid.view.refusals import require_path

_NODES = 81
_NUMBERS = 10_000_000  # most coordinates of all arms together, above which instants are left out
_SAMPLES = 8  # number of pictures that decide the colours of a GIF

Report = Callable[[int, int], None]


def film_run(
    path: Path, to: Path | None, settings: CameraSettings, report: Report, *, force: bool
) -> tuple[Path, list[str]]:
    """Film a result in a folder or file; return the film and sentences on omissions.

    ``report`` receives the numbers of drawn and of all frames, before each and at the end; with
    ``force`` a file that is not crinoid's is replaced.
    """
    source = _result_of(path)
    target = to or source.with_name(FILMS[0 if has_encoder() else 1])
    ending = ending_of(target)
    check_place(target, ending, force=force)
    run = open_drawable(source, lazily=True)
    time = np.asarray(run.dataset["time"].values, float)
    frames = film_settings(settings, float(time[0]), float(time[-1]), ending)
    scene = _scene_of(run, frames)
    status = "" if run.ended is Status.OK else run.status
    comment = f"{MADE} {__version__}"
    order = scene, settings, frames, run.title, status
    with atomic_write(target) as temporary:
        picture = Picture(*order)
        with closing(drawn(picture, order, frames)) as all_pictures:
            pictures = _told(all_pictures, frames, report)
            if ending == ".mp4":
                write_mp4(temporary, pictures, frames, title=run.title, comment=comment)
            else:
                some = np.linspace(0, frames.times.size - 1, _SAMPLES).astype(int)
                few = [picture.at(frames.times[i]) for i in some]
                write_gif(temporary, pictures, frames, few=few, comment=comment)
    return target, [*run.left_out, *omission_notes(scene)]


def _told(pictures: Iterator[Image], frames: FilmSettings, report: Report) -> Iterator[Image]:
    for done in range(frames.times.size):
        report(done, frames.times.size)
        yield next(pictures)
    report(frames.times.size, frames.times.size)


def _result_of(path: Path) -> Path:
    require_path(path)
    if not path.is_dir():
        return path
    if (path / RESULT).is_file():
        return path / RESULT
    if is_table(path / CASES):
        raise ReportError(f"{path}: contains a study. Name the folder of one of its cases.")
    raise ReportError(f"{path}: contains no result, as there is no {RESULT}")


def _scene_of(run: Result, frames: FilmSettings) -> Scene:
    """Return the scene between the first frame and the last, with an instant before and after."""
    parts = []
    for _, each in run.members:
        data = each.dataset
        time = np.asarray(data["time"].values, float)
        begin = max(0, int(np.searchsorted(time, frames.times[0], "right")) - 1)
        end = int(np.searchsorted(time, frames.times[-1], "left")) + 1
        some = slice(min(begin, time.size - 1), max(end, begin + 1))
        parts.append(Result(data.isel(time=some)))
    first, *other = parts
    sizes, first.uncontrolled = first.dataset.sizes, other[0] if other else None
    numbers = sizes["node"] * sizes["axis"] * len(parts)
    most = max(2, min(2 * frames.times.size + 2, _NUMBERS // numbers))
    return build_scene(first, most, _NODES)
