"""Reader of the file of surface waves."""

from functools import partial

from crinoid.recording.elevation import read_elevation
from crinoid.recording.sea import Sea
from crinoid.recording.wave_spectrum import read_spectrum
from crinoid.scenario.errors import gathered, got, refusal
from crinoid.scenario.waves import WavesFlow


def read_sea(flow: WavesFlow, duration: float) -> Sea:
    """Read the file of a flow for a run of ``duration`` (s)."""
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
