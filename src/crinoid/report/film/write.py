"""Writing a film: its frames, one after the other, into one file."""

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr

from crinoid.cases import CASES, is_table
from crinoid.replacement import replacing
from crinoid.report.charts.space import Space, lacking, space_of
from crinoid.report.film.encode import Image, write_gif, write_mp4
from crinoid.report.film.file import FILMS, MADE, check_place, has_encoder
from crinoid.report.film.picture import Picture
from crinoid.report.film.shot import Reel, Shot, ending_of, reel_of
from crinoid.report.run import RESULT, ReportError, Run, open_run
from crinoid.report.style import STYLE
from crinoid.status import Status
from crinoid.version import __version__

_NODES = 81
_NUMBERS = 10_000_000
"""Most coordinates of all arms together, over which instants are left out."""
_SAMPLES = 8
"""Pictures of which a GIF takes its colours."""

Report = Callable[[int, int], None]


def film_run(
    path: Path, to: Path | None, shot: Shot, report: Report, *, force: bool
) -> tuple[Path, list[str]]:
    """Film a result.

    Parameters
    ----------
    path
        A folder that holds a result, or the result's file.
    to
        The film; beside the result by default.
    shot
        How it is filmed.
    report
        Called before each frame, and at the end, with how many are done of how many.
    force
        Whether a file may be replaced that is not crinoid's.

    Returns
    -------
    film
        The file.
    notes
        What was left out, in words.
    """
    shot.check()
    source = _result_of(path)
    target = to or source.with_name(FILMS[0 if has_encoder() else 1])
    ending = ending_of(target)
    check_place(target, ending, force=force)
    run = open_run(source, lazily=True)
    time = np.asarray(run.result["time"].values, float)
    reel = reel_of(shot, float(time[0]), float(time[-1]), ending)
    space = _space(run, reel)
    status = "" if Status.of(run.status) is Status.OK else run.status
    comment = f"{MADE} {__version__}"
    with mpl.rc_context(STYLE), replacing(target) as temporary, warnings.catch_warnings():
        # a title in letters that no font here has is drawn with boxes for them
        warnings.filterwarnings("ignore", message="Glyph")
        picture = Picture(space, shot, reel, run.title, status)
        pictures = _told(picture, reel, report)
        if ending == ".mp4":
            write_mp4(
                temporary,
                pictures,
                size=reel.size,
                fps=reel.fps,
                title=run.title,
                comment=comment,
            )
        else:
            some = np.linspace(0, reel.times.size - 1, _SAMPLES).astype(int)
            few = [picture.at(reel.times[i]) for i in some]
            count = reel.times.size
            write_gif(temporary, pictures, fps=reel.fps, count=count, few=few, comment=comment)
    return target, [*run.left_out, *lacking(space)]


def _told(picture: Picture, reel: Reel, report: Report) -> Iterator[Image]:
    for done, time in enumerate(reel.times):
        report(done, reel.times.size)
        yield picture.at(float(time))
    report(reel.times.size, reel.times.size)


def _result_of(path: Path) -> Path:
    if not path.exists():
        raise ReportError(f"{path}: no such file or directory")
    if not path.is_dir():
        return path
    if (path / RESULT).is_file():
        return path / RESULT
    if is_table(path / CASES):
        raise ReportError(f"{path}: holds a study; takes the folder of one of its cases")
    raise ReportError(f"{path}: no result here, there is no {RESULT}")


def _space(run: Run, reel: Reel) -> Space:
    """Return what moves between the first frame and the last."""
    members = [(label, _within(data, reel)) for label, data in run.members]
    first = members[0][1]
    numbers = first.sizes["node"] * first.sizes["axis"] * len(members)
    most = max(2, min(2 * reel.times.size + 2, _NUMBERS // numbers))
    return space_of(members, most, _NODES)


def _within(data: xr.Dataset, reel: Reel) -> xr.Dataset:
    """Return the instants of a film, and those next to them, between which it glides."""
    time = np.asarray(data["time"].values, float)
    begin = max(0, int(np.searchsorted(time, reel.times[0], "right")) - 1)
    end = int(np.searchsorted(time, reel.times[-1], "left")) + 1
    return data.isel(time=slice(min(begin, time.size - 1), max(end, begin + 1)))
