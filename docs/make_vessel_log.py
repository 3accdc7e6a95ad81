"""Write the log of a vessel that the built-in scenario `ship-motion` plays.

    python docs/make_vessel_log.py

It is synthetic: long waves of a JONSWAP spectrum (significant height 0.9 m, peak period 7 s) from
30 degrees off the bow, and the response of a small vessel of 24 m that follows long waves and is
too long for short ones. Columns and units are those of a motion sensor: heave upward, pitch with
the bow up, roll with the port side up, compass heading.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import crinoid.scenario

LOG = Path(crinoid.scenario.__file__).parent / "library" / "ship-motion.csv"
LENGTH, HEIGHT, PERIOD, AHEAD, SEED = 24.0, 0.9, 7.0, np.deg2rad(30.0), 11
TIME = np.arange(0.0, 64.01, 0.2)


def log() -> str:
    """Return the text of the file."""
    frequency = np.linspace(0.07, 0.4, 60)
    ratio = 1 / (PERIOD * frequency)
    peak = np.exp(-0.5 * ((frequency * PERIOD - 1) / np.where(ratio > 1, 0.07, 0.09)) ** 2)
    density = ratio**5 * np.exp(-1.25 * ratio**4) * 3.3**peak
    amplitude = np.sqrt(2 * density * (HEIGHT / 4) ** 2 / density.sum())
    random = np.random.default_rng(SEED)
    phase = 2 * np.pi * random.random(frequency.size)
    number = (2 * np.pi * frequency) ** 2 / 9.81
    along = number * np.cos(AHEAD)
    # the mean of a wave along the hull
    follows = np.sinc(along * LENGTH / (2 * np.pi))
    angle = 2 * np.pi * frequency * TIME[:, None] + phase
    elevation, slope = amplitude * follows * np.cos(angle), amplitude * follows * np.sin(angle)
    columns = {
        "time (s)": TIME,
        "surge (m)": -0.5 * (np.cos(AHEAD) * slope).sum(axis=1),
        "sway (m)": -0.6 * (np.sin(AHEAD) * slope).sum(axis=1),
        "heave (m)": elevation.sum(axis=1),
        "roll (deg)": np.rad2deg((1.5 * number * np.sin(AHEAD) * slope).sum(axis=1)),
        "pitch (deg)": np.rad2deg((along * slope).sum(axis=1)),
        "heading (deg)": 243.0 + np.rad2deg((0.2 * along * elevation).sum(axis=1)),
    }
    rows = np.stack([*columns.values()], axis=1).tolist()
    lines = [",".join(columns), *(",".join(f"{value:.4f}" for value in row) for row in rows)]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    LOG.write_text(log(), encoding="utf-8")
