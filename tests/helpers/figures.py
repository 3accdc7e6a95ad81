"""Figures: that they show something."""

import json
from collections.abc import Iterable
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image, ImageChops

from crinoid.view.figures import write_report
from crinoid.view.figures.style import STYLE
from crinoid.view.page.parts import PAGE

FIGURES = [
    *("shape.png", "tip_error.png", "tip_path.png"),
    *("commands.png", "energy.png", "bending.png"),
]
WHERE_IT_MOVES = ["loads.png", "cycles.png"]


def assert_is_a_page(path: Path):
    text = path.read_text("utf-8")
    assert text.endswith("</html>\n")
    assert len(text) < 3e6
    for part in ("table", "document"):
        begun = text.index(f'<script type="application/json" id="{part}">')
        json.loads(text[text.index(">", begun) + 1 : text.index("</script>", begun)])


def assert_shows_something(path: Path):
    if path.suffix == ".html":
        assert_is_a_page(path)
        return
    with Image.open(path) as opened:
        wide, high = np.divide(opened.size, opened.info["dpi"])
        pixels = opened.convert("RGB")
    assert 2.5 < wide < 20, path  # inches
    assert 1.5 < high < 30, path
    assert pixels.getcolors(50) is None, f"{path} holds no more than 50 colours"
    # of each pixel the darkest of red, green and blue
    darkest = ImageChops.darker(ImageChops.darker(*pixels.split()[:2]), pixels.split()[2])
    ink = sum(darkest.histogram()[:230]) / (pixels.width * pixels.height)
    assert 0.003 < ink < 0.6, f"{path}: {ink:.1%} of the paper is covered"


def assert_report(folder: Path, *more: str, out: Path | None = None) -> list[Path]:
    """Write all figures and the page of a run, and fail unless each shows something."""
    written = write_report(folder, out=out)
    names = [path.name for path in written if path.name not in WHERE_IT_MOVES]
    assert sorted(names) == sorted([*FIGURES, *more, PAGE])
    for path in written:
        assert_shows_something(path)
    return written


def assert_drawn(run, folder: Path, *draws):
    """Fail unless each of some figures of a run shows something."""
    for draw in draws:
        with mpl.rc_context(STYLE):
            draw(run).savefig(folder / "figure.png")
        assert_shows_something(folder / "figure.png")


def quick_and_release(names: Iterable[str], *, quick: int):
    """Return names to parametrize a test by: those after the first few wait for a release."""
    return [
        name if k < quick else pytest.param(name, marks=pytest.mark.release)
        for k, name in enumerate(names)
    ]
