"""A page that is small: the animation of a run by itself, to stand within another page."""

from string import Template

import numpy as np

from crinoid.report.charts.space import space_of
from crinoid.report.page.parts import framed, json_of, part, run_script
from crinoid.report.page.scene import scene_of
from crinoid.report.page.still import still_of
from crinoid.report.run import ReportError, Run

LARGEST = 800_000
"""Most characters."""
_NODES = 61
_FRAMES = (301, 151, 76, 31)
"""Most instants: of what is too large so many are shown as fit."""


def small_page_of(run: Run) -> tuple[str, list[str]]:
    """Return the animation of a run as a page, and what is left out of it, in words.

    What a user wrote is text in it, as in the large page.
    """
    for frames in _FRAMES:
        page, left_out = _page(run, frames)
        if len(page) <= LARGEST:
            return page, [*run.left_out, *left_out]
    raise ReportError("there is too much about the arm for a small animation")


def _page(run: Run, frames: int) -> tuple[str, list[str]]:
    space = space_of(run.members, frames, _NODES)
    scene, numbers, left_out = scene_of(space)
    time = np.asarray(run.result["time"].values, float)
    table = {
        "span": [float(time[0]), float(time[-1])],
        "times": scene["members"][0]["time"],
        "scene": scene,
        "charts": [],
    }
    body = Template(part("scene.html")).substitute(
        stage=Template(part("stage.html")).substitute(still=still_of(space)),
        table=json_of(table),
        numbers=numbers,
    )
    version = run.result.attrs.get("crinoid_version", "")
    page = framed(body, [run_script()], title=run.title, version=version, kind="small")
    return page, left_out
