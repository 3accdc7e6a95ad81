"""Write the elevation of the sea that the built-in scenario `buoy-sea` plays.

    python docs/make_buoy_record.py

It is synthetic: 600 waves of a JONSWAP spectrum (Hasselmann et al. 1973; significant height 1.2 m,
peak period 6 s), sampled at 2 Hz as by a buoy. The components have no common period.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import crinoid.scenario

RECORD = Path(crinoid.scenario.__file__).parent / "library" / "buoy-sea.csv"
HEIGHT, PERIOD, SEED = 1.2, 6.0, 2
TIME = np.arange(0.0, 200.01, 0.5)


def record() -> str:
    """Return the text of the file."""
    random = np.random.default_rng(SEED)
    relative = 0.5 + 3.5 * (np.arange(600) + random.random(600)) / 600
    width = np.where(relative <= 1, 0.07, 0.09)
    peak = 3.3 ** np.exp(-0.5 * ((relative - 1) / width) ** 2)
    density = relative**-5 * np.exp(-1.25 * relative**-4) * peak
    amplitude = np.sqrt(2 * density * (HEIGHT / 4) ** 2 / density.sum())
    angle = 2 * np.pi * (random.random(600) - relative * TIME[:, None] / PERIOD)
    elevation = (amplitude * np.cos(angle)).sum(axis=1)
    rows = (f"{time:.1f},{height:.4f}" for time, height in zip(TIME, elevation, strict=True))
    return "\n".join(["time (s),elevation (m)", *rows]) + "\n"


if __name__ == "__main__":
    RECORD.write_text(record(), encoding="utf-8")
