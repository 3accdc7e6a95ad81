"""How a run is filmed: the options, checked, and the times of the frames."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from crinoid.report.film.camera import PRESETS
from crinoid.report.run import ReportError

SPEEDS = (0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 1000.0)
FOLLOWED = ("none", "tip", "base")
OTHER = ("ghost", "beside", "none")

_SMALLEST, _LARGEST = 160, 3840  # pixels
_MOST = 20_000
"""Frames of an MP4: ten minutes and more."""
_MOST_PIXELS = 2e8
"""Pixels of all frames of a GIF, which is held in memory until it is written."""


@dataclass(frozen=True)
class Kind:
    """A kind of file, and what it takes where nothing is said."""

    fps: float
    fastest: float
    """Most frames a second."""
    size: tuple[int, int]
    longest: float
    """Seconds that a film lasts at most, if no speed is given."""


KINDS = {
    ".mp4": Kind(30.0, 120.0, (1280, 720), 40.0),
    ".gif": Kind(15.0, 50.0, (480, 360), 15.0),
}


@dataclass(frozen=True)
class Shot:
    """How a run is to be filmed; `None` where the run or the kind of file decides.

    Attributes
    ----------
    fps
        Frames a second.
    speed
        Simulated seconds in a second of the film.
    begin, until
        The simulated time between which it is filmed (s).
    size
        Width and height (pixels).
    view
        Name of a preset of the camera.
    azimuth, elevation
        Where the camera stands instead (deg): from ahead of the submarine toward port, and up.
    zoom
        How much larger all is than where everything fits.
    follow
        What the camera keeps up with: nothing, the tip or the base.
    uncontrolled
        Whether the run without control is a ghost, stands beside, or is left out.
    colour
        Quantity by which the arm is coloured, or `"none"`.
    """

    fps: float | None = None
    speed: float | None = None
    begin: float | None = None
    until: float | None = None
    size: tuple[int, int] | None = None
    view: str | None = None
    azimuth: float | None = None
    elevation: float | None = None
    zoom: float = 1.0
    follow: str | None = None
    uncontrolled: str | None = None
    colour: str | None = None

    def check(self) -> None:
        """Check everything that does not need the run."""
        _within("--speed", self.speed, 1e-4, 1e4)
        _within("--azimuth", self.azimuth, -360.0, 360.0)
        _within("--elevation", self.elevation, -90.0, 90.0)
        _within("--zoom", self.zoom, 0.1, 100.0)
        _one_of("--view", self.view, tuple(PRESETS))
        _one_of("--follow", self.follow, FOLLOWED)
        _one_of("--uncontrolled", self.uncontrolled, OTHER)
        if self.view is not None and (self.azimuth is not None or self.elevation is not None):
            raise ReportError("--view: takes no --azimuth or --elevation beside it")


@dataclass(frozen=True)
class Reel:
    """The frames of a film."""

    size: tuple[int, int]
    fps: float
    speed: float
    times: Float[np.ndarray, " frame"]
    """Simulated time of each (s)."""


def reel_of(shot: Shot, first: float, last: float, ending: str) -> Reel:
    """Return the frames of a run that lasts from a time to another."""
    kind = KINDS[ending]
    name = ending[1:].upper()
    _within("--fps", shot.fps, 1.0, kind.fastest)
    fps = kind.fps if shot.fps is None else shot.fps
    size = kind.size if shot.size is None else shot.size
    if ending == ".mp4" and (size[0] % 2 or size[1] % 2):
        even = f"{size[0] + size[0] % 2}x{size[1] + size[1] % 2}"
        raise ReportError(
            f"--size: got {size[0]}x{size[1]}, an MP4 takes even numbers, such as {even}"
        )
    if last <= first:
        raise ReportError("the result holds one instant: there is nothing that moves")
    begin = first if shot.begin is None else shot.begin
    until = last if shot.until is None else shot.until
    _within("--from", shot.begin, first, last, " s")
    _within("--until", shot.until, first, last, " s")
    if until <= begin:
        option = "--until" if shot.until is not None else "--from"
        raise ReportError(f"{option}: the film would go from {begin:g} s to {until:g} s")
    speed = _usual_speed(until - begin, kind.longest) if shot.speed is None else shot.speed
    count = (until - begin) / speed * fps
    most = int(min(_MOST, _MOST_PIXELS / (size[0] * size[1])) if ending == ".gif" else _MOST)
    if count + 1 > most:
        raise ReportError(
            f"the film would have {count + 1:.0f} frames, "
            f"{name} of {size[0]}x{size[1]} takes {most} at most: "
            "takes a larger --speed, a smaller --fps, or less between --from and --until"
        )
    if count < 1.0:
        raise ReportError(
            "the film would have one frame: takes a smaller --speed or a larger --fps"
        )
    frames = int(count + 1e-6) + 1
    times = np.minimum(begin + np.arange(frames) * speed / fps, until)
    return Reel(size, fps, speed, times)


def size_of(text: str) -> tuple[int, int]:
    """Read a size such as 640x480."""
    found = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text.strip(), re.ASCII)
    if found is None:
        raise ReportError(f"--size: got {text!r}, takes WIDTHxHEIGHT in pixels, such as 640x480")
    wide, high = int(found[1]), int(found[2])
    if not (min(wide, high) >= _SMALLEST and max(wide, high) <= _LARGEST):
        raise ReportError(f"--size: got {wide}x{high}, takes {_SMALLEST} to {_LARGEST} each way")
    return wide, high


def ending_of(path: Path) -> str:
    """Return the ending of a film's name, which says its kind."""
    ending = path.suffix.lower()
    if ending not in KINDS:
        raise ReportError(f"--to: got {path}, takes a name that ends in .mp4 or .gif")
    return ending


def _usual_speed(duration: float, longest: float) -> float:
    """Return real time, unless the film would be too long or too short: as the page begins."""
    wanted = duration / longest
    if duration < 4.0:
        return next((s for s in SPEEDS if s >= duration / 10.0), 1.0)
    return next((s for s in SPEEDS if s >= max(1.0, wanted)), wanted)


def _within(option: str, value: float | None, low: float, high: float, unit: str = "") -> None:
    if value is not None and not (math.isfinite(value) and low <= value <= high):
        text = f"got {value:g}{unit}, takes {low:g} to {high:g}{unit}"
        raise ReportError(f"{option}: {text}")


def _one_of(option: str, value: str | None, known: tuple[str, ...]) -> None:
    if value is not None and value not in known:
        names = f"{', '.join(known[:-1])} or {known[-1]}"
        raise ReportError(f"{option}: got {value!r}, takes {names}")
