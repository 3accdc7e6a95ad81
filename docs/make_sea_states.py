"""Write a year of sea states in the layout of a buoy of NDBC, for `docs/how-to/year.md`.

    python docs/make_sea_states.py buoy.txt

It is synthetic, so that nothing needs to be downloaded: a significant height every three hours with
a Weibull distribution and storms of some days, and a peak period that grows with its root.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy import signal, stats

STEP, DAYS, STORM = 3.0, 366, 48.0  # h, day, h
SHAPE, SCALE, CALM = 1.4, 0.75, 0.1  # of the Weibull distribution; m, m
PERIOD, GROWTH, SPREAD = 3.8, 2.2, 0.5  # s, s per root of a metre, s
NAMES = "#YY  MM DD hh mm  WVHT   DPD   APD MWD"
UNITS = "#yr  mo dy hr mn     m   sec   sec degT"
MARK = "99.00 99.00 99.00 999"
"""Sea state of a row in which the buoy measured none."""


def sea_states(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return significant heights (m) and peak periods (s) of a year."""
    random = np.random.default_rng(seed)
    count, kept = int(24 * DAYS / STEP), np.exp(-STEP / STORM)
    noise = np.sqrt(1 - kept**2) * random.normal(size=count)
    rank = stats.norm.cdf(signal.lfilter([1.0], [1.0, -kept], noise))
    height = CALM + stats.weibull_min.ppf(rank, SHAPE, scale=SCALE)
    return height, PERIOD + GROWTH * np.sqrt(height) + SPREAD * random.normal(size=count)


def text(height: np.ndarray, period: np.ndarray) -> str:
    """Return the file of a buoy, with a mark in each hundredth row."""
    start, lines = np.datetime64("2024-01-01T00:40"), [NAMES, UNITS]
    for row, (high, long) in enumerate(zip(height, period, strict=True)):
        time = str(start + np.timedelta64(int(60 * STEP) * row, "m"))
        state = f"{high:5.2f} {long:5.2f} {long / 1.286:5.2f} 999" if row % 100 else MARK
        lines.append(f"{time.translate(str.maketrans('-T:', '   '))} {state}")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(text(*sea_states()), "utf-8")
    print(f"wrote {sys.argv[1]}")
