"""Write the RAOs of the vessel that carries the arm of the built-in scenario `ship-rao`.

    python docs/make_vessel_rao.py

Heave and pitch are those of a box of 24 m at rest in deep water, by the closed-form expressions of
Jensen, Mansour and Olsen (2004, Ocean Engineering 31). Surge is that of the water, averaged over
the hull. Phases are lags behind the crest at midship, turns have the bow up, and headings are
directions of travel: 180 degrees is head seas.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import crinoid.scenario

TABLE = Path(crinoid.scenario.__file__).parent / "library" / "ship-rao.csv"
LENGTH, BREADTH, DRAUGHT, GRAVITY = 24.0, 7.0, 2.2, 9.81
FREQUENCY, HEADING = np.arange(0.3, 3.6, 0.1), np.arange(0.0, 181.0, 30.0)


def motions(frequency: np.ndarray, heading: np.ndarray) -> dict[str, np.ndarray]:
    """Return surge, heave (m/m) and pitch (rad/m) for frequencies (rad/s) and headings (rad).

    Of the elevation ``Re a exp(i (k x - omega t))`` they are factors of ``a exp(-i omega t)``.
    """
    number = frequency**2 / GRAVITY
    along = number * np.cos(heading)
    half = np.maximum(np.abs(along) * LENGTH / 2, 1e-6)
    # radiated over incident amplitude; its square is the damping
    radiated = 2 * np.sin(number * BREADTH / 2) * np.exp(-number * DRAUGHT)
    damping = radiated**2 / (number * BREADTH)
    smith = np.exp(-number * DRAUGHT)
    force = smith * np.hypot(1 - number * DRAUGHT, damping)
    mean = np.sin(half) / half
    tilting = np.sign(along) * 6 / (half**2 * LENGTH) * (np.sin(half) - half * np.cos(half))
    resistance = 1 - 2 * number * DRAUGHT - 1j * damping
    return {
        "surge": 1j * np.cos(heading) * smith * mean,
        "heave": force * mean / resistance,
        "pitch": 1j * force * tilting / resistance,
    }


def table() -> str:
    """Return the text of the file."""
    frequency, heading = (each.ravel() for each in np.meshgrid(FREQUENCY, HEADING, indexing="ij"))
    columns = {"frequency (rad/s)": frequency, "heading (deg)": heading}
    for name, motion in motions(frequency, np.deg2rad(heading)).items():
        turns = name == "pitch"
        columns[f"{name} ({'deg/m' if turns else 'm/m'})"] = np.abs(motion) * (
            np.rad2deg(1.0) if turns else 1.0
        )
        columns[f"{name} phase (deg)"] = np.rad2deg(np.angle(motion))
    rows = np.stack([*columns.values()], axis=1).tolist()
    lines = [",".join(columns), *(",".join(f"{value:.5g}" for value in row) for row in rows)]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    TABLE.write_text(table(), encoding="utf-8")
