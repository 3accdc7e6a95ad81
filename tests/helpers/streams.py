"""Files of runs that grow, made without a run."""

from pathlib import Path

import numpy as np
import xarray as xr

from crinoid.results.stream import Stream


def instants(start: int, stop: int) -> xr.Dataset:
    """Make instants whose numbers tell which they are."""
    time = np.arange(start, stop, dtype=float)
    position = time[:, None, None] + np.arange(8.0).reshape(4, 2) / 10
    return xr.Dataset(
        {
            "position": (("time", "node", "axis"), position, {"units": "m"}),
            "tip_angle": ("time", -time),
            "steps": ("time", np.arange(start, stop)),
            "channel_upper": ("channel", np.ones(3)),
        },
        {"time": time, "axis": ["x", "z"], "kind": ["kinetic"]},
        {"scenario": "[arm]\n", "crinoid_version": "1", "status": "unfinished"},
    )


def state(number: int) -> dict[str, np.ndarray]:
    return {"state.steps": np.asarray(number), "state.motion.position": np.full((3, 2), number)}


def grown(path: Path, sizes: tuple[int, ...] = (1, 3, 200)) -> Stream:
    stream = Stream(path, instants(0, 1), [instants(1, 5)], state(5), 0.5)
    count = 5
    for size in sizes:
        stream.append(instants(count, count + size))
        stream.keep(state(count + size), count / 10)
        count += size
    return stream
