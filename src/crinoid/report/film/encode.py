"""Pictures into a file: H.264 in MP4 by PyAV, or GIF by Pillow."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image as Still

from crinoid.report.run import ReportError

_COLOURS = 255
"""Colours of a GIF; one more says that a pixel stays as it was."""
_BT709 = 1

Image = UInt8[np.ndarray, "high wide colour=4"]


def write_mp4(
    path: Path,
    pictures: Iterable[Image],
    *,
    size: tuple[int, int],
    fps: float,
    title: str,
    comment: str,
) -> None:
    """Write pictures as an MP4 that browsers and slides play: H.264, 4:2:0, its index in front."""
    import av

    try:
        with av.open(path, "w", format="mp4", options={"movflags": "+faststart"}) as container:
            container.metadata.update(title=title, comment=comment)
            rate = Fraction(fps).limit_denominator(1001)
            stream = container.add_stream("libx264", rate=rate, options={"crf": "20"})
            stream.width, stream.height = size
            stream.pix_fmt = "yuv420p"
            context = stream.codec_context
            context.colorspace = context.color_primaries = context.color_trc = _BT709
            context.color_range = av.video.reformatter.ColorRange.MPEG
            for picture in pictures:
                frame = av.VideoFrame.from_ndarray(picture, format="rgba")
                container.mux(
                    stream.encode(frame.reformat(format="yuv420p", dst_colorspace=_BT709))
                )
            container.mux(stream.encode())
    except OSError:  # such as a full disk, for which there are better words elsewhere
        raise
    except (av.FFmpegError, ValueError) as error:
        raise ReportError(f"PyAV cannot write the film ({error})") from error


def write_gif(
    path: Path,
    pictures: Iterator[Image],
    *,
    fps: float,
    count: int,
    few: list[Image],
    comment: str,
) -> None:
    """Write a number of pictures as a GIF that goes round, in the colours of a few of them.

    Pixels that stay as they were are left out, and all pictures have one palette.
    """
    chosen = _still(np.concatenate(few)).quantize(_COLOURS, Still.Quantize.FASTOCTREE)
    colours = (chosen.getpalette() or [])[: 3 * _COLOURS]
    palette = Still.new("P", (1, 1))
    palette.putpalette(colours)
    flat = (
        _still(picture).quantize(palette=palette, dither=Still.Dither.NONE) for picture in pictures
    )
    # GIF counts hundredths of seconds: rounded so that they do not add up
    ends = np.round(100.0 / fps * np.arange(count + 1))
    next(flat).save(
        path,
        format="GIF",
        save_all=True,
        append_images=flat,
        duration=[int(10 * each) for each in np.diff(ends)],
        loop=0,
        palette=bytes(colours),
        transparency=_COLOURS,
        optimize=True,
        disposal=1,
        comment=comment.encode(),
    )


def _still(picture: Image) -> Still.Image:
    return Still.fromarray(picture).convert("RGB")
