"""Pictures of an episode, drawn as films are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import UInt8

from crinoid.compilation import ONCE, compiled
from crinoid.learning.environment.draws import EpisodeDraw
from crinoid.results.chunks import join
from crinoid.results.dataset import describe
from crinoid.results.result import Result
from crinoid.results.scene.data import Points
from crinoid.results.scene.scene import Scene, build_scene
from crinoid.simulation import LoopState
from crinoid.simulation.chunk import one_instant, record
from crinoid.simulation.conclusion import dataset_builder
from crinoid.view.film.camera import FilmSettings, cloud_of
from crinoid.view.film.picture import Picture
from crinoid.view.film.settings import CameraSettings

SIZE = (640, 480)  # width and height (pixels)
_NODES = 81
_TIMES = 25  # number of target positions that the window contains
_ROOM = 0.3  # margin around the arm at the start and its target, over the length

_keep = compiled(**ONCE)(record)


class EpisodePainter:
    """Painter of one episode with a fixed camera; ``start`` is the state at its beginning."""

    def __init__(self, drawn: EpisodeDraw, start: LoopState) -> None:
        self._drawn = drawn
        self._build = dataset_builder(drawn.setup)
        self._about = describe(drawn.scenario)
        duration = drawn.scenario.simulation.duration
        later = [
            eqx.tree_at(lambda now: now.state.motion.time, start, jnp.asarray(time))
            for time in np.linspace(0.0, duration, _TIMES)
        ]
        space = self._space(later)
        self._cloud, self._water = _cloud(space), space.members[0].water

    def at(self, now: LoopState, rate: float) -> UInt8[np.ndarray, "height width 3"]:
        """Draw an instant; ``rate`` is the rate of the pictures (1/s)."""
        time = float(now.state.time)
        shot, reel = CameraSettings(colour="none"), FilmSettings(SIZE, rate, 1.0, np.array([time]))
        title = str(self._about["title"])
        picture = Picture(self._at_one_scale(now), shot, reel, title, "", self._cloud)
        return np.ascontiguousarray(picture.at(time)[..., :3])

    def _at_one_scale(self, now: LoopState) -> Scene:
        """Return an instant, its arrows of the water at the scale of the whole episode."""
        space = self._space([now])
        (member,) = space.members
        if member.water is None or self._water is None:
            return space
        water = replace(member.water, scale=self._water.scale)
        return replace(space, members=(replace(member, water=water),))

    def _space(self, instants: Sequence[LoopState]) -> Scene:
        loop = self._drawn.case.loop
        parts = [self._build(one_instant(_keep(loop, now)), None) for now in instants]
        data: xr.Dataset = join(parts).assign_attrs(self._about)
        return build_scene(Result(data), len(instants), _NODES)


def _cloud(space: Scene) -> Points:
    """Return points of a window around the arm at the start and its target."""
    cloud = cloud_of(space, space.members, np.zeros((space.members[0].time.size, 3)))
    room = _ROOM * space.length * np.array([1.0, float(space.spatial), 1.0])
    return np.concatenate([cloud - room, cloud + room])
