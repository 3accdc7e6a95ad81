"""Encoding of films: H.264 in MP4 by PyAV, or GIF by Pillow."""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image as Still

from crinoid.results.own_files import is_own
from crinoid.results.report_error import ReportError
from crinoid.scenario.errors import got
from crinoid.view.film.camera import FilmSettings

FILMS = ("film.mp4", "film.gif")  # default names of films, next to their results

NO_ENCODER = 'an MP4 needs PyAV: pip install "crinoid[film]"'


def has_encoder() -> bool:
    """Whether PyAV is installed, which an MP4 needs."""
    return find_spec("av") is not None


def check_place(path: Path, ending: str, *, force: bool) -> None:
    """Refuse a file that cannot be written, or that is not a film of crinoid's."""
    if ending == ".mp4" and not has_encoder():
        raise ReportError(f"--to: {NO_ENCODER}; a GIF does not")
    if path.is_dir():
        raise ReportError(f"--to: {got(path, 'be the name of a file, not a folder')}")
    if not path.parent.is_dir():
        raise ReportError(f"--to: there is no folder {path.parent}")
    if path.exists() and not force and not is_own(path):
        hint = "Choose another name, or replace it with --force."
        raise ReportError(f"--to: {path} was not made by crinoid. {hint}")


_COLOURS = 255  # colours of a GIF; one more marks a pixel that does not change
_BT709 = 1
# half the time of a medium speed at a crf of 20: as near to the pictures within 0.4 dB, 20% larger
_QUALITY = {"preset": "veryfast", "crf": "18"}

Image = UInt8[np.ndarray, "high wide colour=4"]


def write_mp4(
    path: Path, pictures: Iterable[Image], frames: FilmSettings, *, title: str, comment: str
) -> None:
    """Write pictures as an MP4 that browsers play: H.264, 4:2:0, its index in front."""
    import av

    try:
        with av.open(path, "w", format="mp4", options={"movflags": "+faststart"}) as container:
            container.metadata.update(title=title, comment=comment)
            rate = Fraction(frames.fps).limit_denominator(1001)
            stream = container.add_stream("libx264", rate=rate, options=_QUALITY)
            stream.width, stream.height = frames.size
            stream.pix_fmt = "yuv420p"
            context = stream.codec_context
            context.colorspace = context.color_primaries = context.color_trc = _BT709
            context.color_range = av.video.reformatter.ColorRange.MPEG
            for picture in pictures:
                frame = av.VideoFrame.from_ndarray(picture, format="rgba")
                frame = frame.reformat(format="yuv420p", dst_colorspace=_BT709)
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
    except (OSError, ReportError):  # such as a full disk, which the caller reports
        raise
    except (av.FFmpegError, ValueError) as error:
        raise ReportError(f"PyAV cannot write the film ({error})") from error


def write_gif(
    path: Path, pictures: Iterator[Image], frames: FilmSettings, *, few: list[Image], comment: str
) -> None:
    """Write a repeating GIF in the palette of a ``few``, without pixels that do not change."""
    chosen = _still(np.concatenate(few)).quantize(_COLOURS, Still.Quantize.FASTOCTREE)
    colours = (chosen.getpalette() or [])[: 3 * _COLOURS]
    palette = Still.new("P", (1, 1))
    palette.putpalette(colours)
    plain: Any = {"palette": palette, "dither": Still.Dither.NONE}
    flat = (_still(picture).quantize(**plain) for picture in pictures)
    # GIF counts hundredths of seconds: rounded so that they do not add up
    ends = np.round(100.0 / frames.fps * np.arange(frames.times.size + 1))
    times = [int(10 * each) for each in np.diff(ends)]
    look: Any = {"palette": bytes(colours), "transparency": _COLOURS, "optimize": True}
    look |= {"loop": 0, "disposal": 1, "duration": times, "comment": comment.encode()}
    with path.open("wb") as file:  # which Pillow would not close after an interruption
        next(flat).save(file, format="GIF", save_all=True, append_images=flat, **look)


def _still(picture: Image) -> Still.Image:
    return Still.fromarray(picture).convert("RGB")
