"""Camera and settings of a film: its view, its region, and the times of its frames."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.results.report_error import ReportError
from crinoid.results.scene.data import Point, Points, even_indices
from crinoid.results.scene.mount import Path
from crinoid.results.scene.projection import View
from crinoid.results.scene.scene import NEAR, Keyframes, Scene
from crinoid.view.film.settings import FORMATS, SPEEDS, CameraSettings, require_within

_MARGIN = 1.12
_FAR = 2.2  # the eye's distance, of the diagonal of the window
_INSTANTS = 100


class Camera(NamedTuple):
    """A view, and the part of its paper that is the picture."""

    view: View
    middle: Float[np.ndarray, " axis=2"]
    half: float  # half of the picture's height (m)
    flat: bool
    low: Point  # of the box around everything (m)
    high: Point

    @property
    def size(self) -> float:
        """Longest side of the box (m)."""
        return float((self.high - self.low).max())


def camera_of(
    cloud: Points, azimuth: float, elevation: float, *, flat: bool, aspect: float, zoom: float
) -> Camera:
    """Return the camera that shows a cloud of points, or with a zoom the middle of it."""
    bottom, top = cloud.min(axis=0), cloud.max(axis=0)
    x, y, z = map(float, (bottom + top) / 2)
    far = math.inf if flat else _FAR * float(np.linalg.norm(top - bottom))
    view = View.at("of the film", azimuth, elevation, (x, y, z), far)
    paper = view.paper(cloud)
    low, high = paper.min(axis=0), paper.max(axis=0)
    wide, tall = (high - low) / 2
    half = _MARGIN * max(float(tall), float(wide) / aspect, 1e-6) / zoom
    return Camera(view, (low + high) / 2, half, flat, bottom, top)


def followed_path(scene: Scene, wish: str | None) -> Path:
    """Return the path that the camera follows, by default of a base that moves far; or zero."""
    run = scene.members[0]
    wish = wish or ("base" if run.travels(scene.length) else "none")
    position = run.position
    still = np.zeros((len(position), 3))
    return {"base": position[:, 0], "tip": position[:, -1], "none": still}[wish]


def cloud_of(scene: Scene, members: Sequence[Keyframes], path: Path) -> Points:
    """Return points that a picture of runs contains, while the camera follows a path.

    The path is one of the first run; points are relative to the motion of the camera.
    """
    length, clouds = scene.length, []
    for run in members:
        some = even_indices(run.time.size, _INSTANTS)
        places = [np.interp(run.time[some], members[0].time, path[:, axis]) for axis in range(3)]
        drift = np.stack(places, axis=1) - path[0]
        arm, anchor = run.position[some] - drift[:, None], run.mount.anchor[some] - drift
        thick, wide = run.diameter[:, None] / 2, 0.05 * length
        around = [arm - thick, arm + thick, anchor - wide, anchor + wide, run.target[some] - drift]
        clouds += [each.reshape(-1, 3) for each in around]
    shapes = np.concatenate(clouds)
    low, high = shapes.min(axis=0) - NEAR * length, shapes.max(axis=0) + NEAR * length
    for body in (body for run in members for body in run.obstacles):
        points = np.concatenate([body.path - body.radius, body.path + body.radius])
        if body.solid is not None:
            points = body.corners_within(low, high)
        elif body.kind == "plane":
            points = body.nearest(np.s_[:, None], (low + high)[None, None] / 2)[:, 0]
        clouds.append(np.clip(points, low, high))
    if members[0].water is not None:
        start, ends = members[0].water.start - (path.mean(axis=0) - path[0]), 0.06 * length
        clouds += [start - ends, start + ends]
    return np.concatenate(clouds)


_MOST = 20_000  # frames of an MP4: ten minutes and more
_MOST_PIXELS = 2e8  # most pixels of all frames of a GIF, which stay in memory until it is written


class FilmSettings(NamedTuple):
    """The frames of a film."""

    size: tuple[int, int]
    fps: float
    speed: float
    times: Float[np.ndarray, " frame"]  # simulated time of each (s)


def film_settings(settings: CameraSettings, first: float, last: float, ending: str) -> FilmSettings:
    """Return the frames of a run between its first and last time (s)."""
    kind = FORMATS[ending]
    require_within("--fps", settings.fps, 1.0, kind.highest_fps)
    fps = kind.fps if settings.fps is None else settings.fps
    size = kind.size if settings.size is None else settings.size
    if ending == ".mp4" and (size[0] % 2 or size[1] % 2):
        even = f"{size[0] + size[0] % 2}x{size[1] + size[1] % 2}"
        must = f"must be even numbers for an MP4, such as {even}"
        raise ReportError(f"--size: got {size[0]}x{size[1]}; {must}")
    if last <= first:
        raise ReportError("the result contains one instant, so that nothing moves")
    begin = first if settings.begin is None else settings.begin
    until = last if settings.until is None else settings.until
    require_within("--from", settings.begin, first, last, " s")
    require_within("--until", settings.until, first, last, " s")
    if until <= begin:
        option = "--until" if settings.until is not None else "--from"
        text = f"the film would start at {begin:g} s and end at {until:g} s"
        raise ReportError(f"{option}: {text}")
    speed = settings.speed
    if speed is None:  # the first of the page: real time unless the film is too long or too short
        duration, least = until - begin, (until - begin) / kind.longest
        if duration < 4.0:
            speed = next((s for s in SPEEDS if s >= duration / 10.0), 1.0)
        else:
            speed = next((s for s in SPEEDS if s >= max(1.0, least)), least)
    count = (until - begin) / speed * fps
    most = int(min(_MOST, _MOST_PIXELS / (size[0] * size[1])) if ending == ".gif" else _MOST)
    if count + 1 > most:
        kind_and_size = f"{ending[1:].upper()} of {size[0]}x{size[1]}"
        raise ReportError(
            f"the film would have {count + 1:.0f} frames, but {kind_and_size} has at most {most}. "
            "Raise --speed, lower --fps, or shorten the time between --from and --until."
        )
    if count < 1.0:
        raise ReportError("the film would have a single frame. Lower --speed or raise --fps.")
    frames = int(count + 1e-6) + 1
    times = np.minimum(begin + np.arange(frames) * speed / fps, until)
    return FilmSettings(size, fps, speed, times)
