"""Readers of the files of surface waves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from crinoid.recording.elevation import read_elevation
from crinoid.recording.sea import Sea
from crinoid.recording.wave_spectrum import read_spectrum
from crinoid.scenario.errors import gathered, got, refusal
from crinoid.scenario.waves import WavesFlow


def sea_readers(waves: Mapping[int, WavesFlow], duration: float) -> dict[str, Callable[[], Sea]]:
    """Return a reader of the file of each flow, by the key of its table; ``duration`` in s."""
    return {f"flow.{index}": partial(_read, flow, duration) for index, flow in waves.items()}


def _read(flow: WavesFlow, duration: float) -> Sea:
    if flow.elevation is not None:
        reader = {"elevation": partial(read_elevation, flow.elevation, duration)}
    else:
        assert flow.spectrum is not None
        reader = {"spectrum": partial(read_spectrum, flow.spectrum)}
    (sea,) = gathered(reader).values()
    for key in ("direction_deg", "spreading") if "direction" in sea.given else ():
        if (value := getattr(flow, key)) is not None:
            raise refusal(key, got(value, f"be left out: {sea.name} has directions"))
    return sea
