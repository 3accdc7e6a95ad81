"""One picture after the other: what stands is drawn once, what moves is drawn anew over it."""

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

from crinoid.report.charts.space import Space, ranges_of
from crinoid.report.film.camera import (
    PRESETS,
    Window,
    camera_of,
    followed_by,
    path_of,
    window_of,
)
from crinoid.report.film.course import Course, between
from crinoid.report.film.encode import Image
from crinoid.report.film.frame import Frame
from crinoid.report.film.panel import TONES, Panel, Shading, pale
from crinoid.report.film.shot import Reel, Shot
from crinoid.report.run import ReportError

RAMPS = {
    False: ("#3b2a6b", "#3a5a92", "#2b8593", "#35ac80", "#8fcf4e", "#f4dd3b"),
    True: ("#1b5fa5", "#6ea3cf", "#d9dcdd", "#e59a63", "#c2500a"),
}
"""Colours along the arm where values have one sign or two, which are those of the page."""


class Picture:
    """The pictures of a film, all of one size.

    Parameters
    ----------
    space
        The run.
    shot, reel
        How it is filmed.
    title, status
        Of the run; the status is empty if nothing went wrong.
    window
        What the camera is to see; all of the run if left out.
    """

    def __init__(
        self,
        space: Space,
        shot: Shot,
        reel: Reel,
        title: str,
        status: str,
        window: Window | None = None,
    ) -> None:
        first = space.members[0]
        parts = _parts(space, shot.uncontrolled)
        shading = _shading(space, shot.colour, plain=len(parts[0]) > 1)
        frame = Frame(reel.size, title, status, len(parts))
        followed = followed_by(space, shot.follow)
        self._path, self._course = path_of(first, followed), Course(first)
        shown = [space.members[i] for part in parts for i in part]
        window = window or window_of(space, shown, self._path)
        name = shot.view or ("angle" if space.spatial else "side")
        azimuth, elevation = PRESETS[name]
        turned = shot.azimuth is not None or shot.elevation is not None
        camera = camera_of(
            window,
            azimuth if shot.azimuth is None else shot.azimuth,
            elevation if shot.elevation is None else shot.elevation,
            flat=name != "angle" and not turned,
            aspect=frame.aspect,
            zoom=shot.zoom,
        )
        point = frame.points(1.0)
        self._panels = [
            Panel(axes, space, part, camera, window, shading, point)
            for axes, part in zip(frame.axes, parts, strict=True)
        ]
        frame.say_speed(reel.speed)
        frame.look(camera)
        labels = [each.label for each in shown]
        if len(parts) > 1:
            frame.name_panels(labels)
        elif len(shown) > 1:
            inks = [TONES[0], pale(TONES[1])]
            first_named = 0 if shading is None else 1
            frame.add_key(labels[first_named:], inks[first_named:])
        if shading is not None:
            field = next(each for each in first.fields if each.name == shading.name)
            label = f"{field.label} ({field.unit})"
            frame.add_colours(label, shading.low, shading.high, shading.ramp)
        self._frame = frame
        self._digits = 3 if reel.times[-1] - reel.times[0] < 5.0 else 2
        frame.canvas.draw()
        self._background = frame.canvas.copy_from_bbox(frame.figure.bbox)

    def at(self, time: float) -> Image:
        """Draw a time (s)."""
        frame = self._frame
        frame.canvas.restore_region(self._background)
        renderer = frame.canvas.get_renderer()
        place = between(self._path, *self._course.locate(time))
        drift, along = place - self._path[0], place - self._path.mean(axis=0)
        for panel in self._panels:
            panel.draw(renderer, time, drift, along)
        frame.draw_over(f"{time:.{self._digits}f} s")
        return np.array(frame.canvas.buffer_rgba())


def _parts(space: Space, wish: str | None) -> list[list[int]]:
    """Return which runs are drawn together in each panel."""
    every = list(range(len(space.members)))
    if wish in ("ghost", "beside") and len(every) == 1:
        raise ReportError(f"--uncontrolled: got {wish!r}, but the result has no uncontrolled run")
    if wish == "beside":
        return [[i] for i in every]
    return [[0]] if wish == "none" else [every]


def _shading(space: Space, wish: str | None, *, plain: bool) -> Shading | None:
    """Return how the arm is coloured; plainly beside a ghost, where nothing is said."""
    fields = [field.name for field in space.members[0].fields]
    if wish == "none" or (wish is None and (plain or not fields)):
        return None
    if wish is not None and wish not in fields:
        *others, last = [*fields, "none"]
        known = f"{', '.join(others)} or {last}" if others else last
        raise ReportError(f"--colour: got {wish!r}, this result takes {known}")
    name = wish or fields[0]
    low, high = ranges_of(space)[name]
    ramp = LinearSegmentedColormap.from_list(name, RAMPS[low < 0.0])
    return Shading(name, low, high, ramp)
