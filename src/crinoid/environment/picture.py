"""A picture of an episode at one instant, drawn as films are."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import xarray as xr
from jaxtyping import UInt8

from crinoid.dataset import describe
from crinoid.environment.draws import Drawn
from crinoid.pieces import join
from crinoid.programs import ONCE, compiled
from crinoid.report.charts.space import Space, space_of
from crinoid.report.film.camera import Window, window_of
from crinoid.report.film.picture import Picture
from crinoid.report.film.shot import Reel, Shot
from crinoid.report.style import STYLE
from crinoid.simulation import LoopState
from crinoid.simulation.conclusion import builder
from crinoid.simulation.stretch import one_instant, record

SIZE = (640, 480)
"""Width and height (pixels)."""
_NODES = 81
_TIMES = 25
"""Times at which it is looked where the target will be."""
_ROOM = 0.3
"""Room about the arm as it begins and its target, over its length."""

_keep = compiled(**ONCE)(record)


class Painter:
    """Draws one episode, from a camera that stands still.

    Parameters
    ----------
    drawn
        The episode.
    start
        The loop at its beginning.
    """

    def __init__(self, drawn: Drawn, start: LoopState) -> None:
        self._drawn = drawn
        self._build = builder(drawn.prepared, drawn.setup)
        self._about = describe(drawn.scenario)
        duration = drawn.scenario.simulation.duration
        later = [
            eqx.tree_at(lambda now: now.state.motion.time, start, jnp.asarray(time))
            for time in np.linspace(0.0, duration, _TIMES)
        ]
        self._window = _window(self._space(later))

    def at(self, now: LoopState, rate: float) -> UInt8[np.ndarray, "height width 3"]:
        """Draw an instant; ``rate`` is that of the pictures (1/s)."""
        time = float(now.state.time)
        shot, reel = Shot(colour="none"), Reel(SIZE, rate, 1.0, np.array([time]))
        with mpl.rc_context(STYLE), warnings.catch_warnings():
            # a title in letters that no font here has is drawn with boxes for them
            warnings.filterwarnings("ignore", message="Glyph")
            title = str(self._about["title"])
            picture = Picture(self._space([now]), shot, reel, title, "", self._window)
            return np.ascontiguousarray(picture.at(time)[..., :3])

    def _space(self, instants: Sequence[LoopState]) -> Space:
        loop = self._drawn.case.loop
        parts = [self._build(one_instant(_keep(loop, now)), None) for now in instants]
        data: xr.Dataset = join(parts).assign_attrs(self._about)
        return space_of([("", data)], len(instants), _NODES)


def _window(space: Space) -> Window:
    """Return what the camera is to see: the arm as it begins, its target, and room about them."""
    path = np.zeros((space.members[0].time.size, 3))
    window = window_of(space, list(space.members), path)
    room = _ROOM * space.length * np.array([1.0, float(space.spatial), 1.0])
    cloud = np.concatenate([window.cloud - room, window.cloud + room])
    return Window(window.low - room, window.high + room, cloud)
