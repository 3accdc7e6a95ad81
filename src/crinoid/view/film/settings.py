"""Options of a film, and what refuses them before anything slow is loaded."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

from crinoid.results.report_error import ReportError
from crinoid.scenario.errors import got, one_of

PRESETS = {
    "side": (-90.0, 0.0),
    "above": (-90.0, 90.0),
    "ahead": (0.0, 0.0),
    "angle": (-58.0, 27.0),
}
"""Azimuth and elevation (deg) of the presets of the camera."""
SPEEDS = (0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 1000.0)
"""Simulated seconds in a second."""
RAMPS = {
    "one": ("#3b2a6b", "#3a5a92", "#2b8593", "#35ac80", "#8fcf4e", "#f4dd3b"),
    "two": ("#5e2b8a", "#a98bc6", "#d9dcdd", "#86bf7d", "#1d6b32"),
}
"""Colours along the arm of values with one sign, and with two: neither of them those of a run."""
FOLLOWED = ("none", "tip", "base")
OTHER = ("ghost", "beside", "none")  # places of the run without control in a film

_SMALLEST, _LARGEST = 160, 3840  # pixels


@dataclass(frozen=True)
class FilmFormat:
    """Defaults and limits of a kind of file."""

    fps: float
    highest_fps: float
    size: tuple[int, int]
    longest: float  # longest duration of a film without a given speed (s)


FORMATS = {
    ".mp4": FilmFormat(30.0, 120.0, (1280, 720), 40.0),
    ".gif": FilmFormat(15.0, 50.0, (480, 360), 15.0),
}


@dataclass(frozen=True)
class CameraSettings:
    """Options of a film; `None` leaves a choice to the run or the kind of file."""

    fps: float | None = None  # frames a second
    speed: float | None = None  # simulated seconds in a second of the film
    begin: float | None = None  # first simulated time (s)
    until: float | None = None  # last simulated time (s)
    size: tuple[int, int] | None = None  # width and height (pixels)
    view: str | None = None  # name of a preset of the camera
    azimuth: float | None = None  # of the camera instead, from the bow toward port (deg)
    elevation: float | None = None  # of the camera, up (deg)
    zoom: float = 1.0  # magnification of the picture in which everything fits
    follow: str | None = None  # point that stays in place: `"none"`, `"tip"` or `"base"`
    uncontrolled: str | None = None  # the run without control: `"ghost"`, `"beside"` or `"none"`
    colour: str | None = None  # quantity by which the arm is coloured, or `"none"`

    def __post_init__(self) -> None:
        require_within("--speed", self.speed, 1e-4, 1e4)
        require_within("--azimuth", self.azimuth, -360.0, 360.0)
        require_within("--elevation", self.elevation, -90.0, 90.0)
        require_within("--zoom", self.zoom, 0.1, 100.0)
        _one_of("--view", self.view, tuple(PRESETS))
        _one_of("--follow", self.follow, FOLLOWED)
        _one_of("--uncontrolled", self.uncontrolled, OTHER)
        if self.view is not None and (self.azimuth is not None or self.elevation is not None):
            hint = "Omit it where --azimuth or --elevation is given."
            raise ReportError(f"--view: got {self.view} and an angle. {hint}")


def size_of(text: str) -> tuple[int, int]:
    """Read a size such as 640x480."""
    found = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text.strip(), re.ASCII)
    if found is None:
        raise ReportError(f"--size: {got(text, 'be WIDTHxHEIGHT in pixels, such as 640x480')}")
    wide, high = int(found[1]), int(found[2])
    if not (min(wide, high) >= _SMALLEST and max(wide, high) <= _LARGEST):
        must = f"width and height must be {_SMALLEST} to {_LARGEST}"
        raise ReportError(f"--size: got {wide}x{high}; {must}")
    return wide, high


def ending_of(path: Path) -> str:
    """Return the ending of a film's name, which decides its kind."""
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise ReportError(f"--to: {got(path, 'be a name that ends in .mp4 or .gif')}")
    return ending


def require_within(
    option: str, value: float | None, low: float, high: float, unit: str = ""
) -> None:
    """Require a value between two ends, if there is one."""
    if value is not None and not (math.isfinite(value) and low <= value <= high):
        text = f"got {value:g}{unit}; must be {low:g} to {high:g}{unit}"
        raise ReportError(f"{option}: {text}")


def _one_of(option: str, value: str | None, known: tuple[str, ...]) -> None:
    if value is not None and value not in known:
        raise ReportError(f"{option}: {got(value, f'be {one_of(known)}')}")
