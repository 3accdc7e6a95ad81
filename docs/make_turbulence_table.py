"""Write the table of `docs/turbulence.md`: how well station-keeping holds in turbulence.

    python docs/make_turbulence_table.py

Runs the built-in scenario in turbulence of several kinds, ten seeds each, with and without control:
some minutes.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np

import crinoid
from crinoid.metrics import tip_error

PAGE = Path(__file__).with_name("turbulence.md")
BEGIN, END = "<!-- table: begin -->", "<!-- table: end -->"

SEEDS = range(10)
MEANS, INTENSITIES, LENGTH_SCALES = (0.1, 0.25, 0.5), (0.1, 0.2, 0.3), (0.2, 0.5, 2.0)


def errors(mean: float, intensity: float, length_scale: float, seed: int) -> tuple[float, float]:
    """Return the RMS tip errors (m) with and without control."""
    keys = {"mean": [mean, 0.0], "intensity": intensity, "length_scale": length_scale}
    scenario = crinoid.load("station-keeping").with_values(
        {f"flow.0.{key}": value for key, value in keys.items()} | {"seed": seed}
    )
    result = crinoid.simulate(scenario)
    assert result.uncontrolled is not None
    return tip_error(result).rms, tip_error(result.uncontrolled).rms


def table() -> str:
    """Return a row for each kind of turbulence."""
    rows = [
        "| Mean (m/s) | Intensity | Length scale (m) | Controlled (mm) | Uncontrolled (mm) "
        "| Ratio | Worst seed |",
        "|---|---|---|---|---|---|---|",
    ]
    for kind in product(MEANS, INTENSITIES, LENGTH_SCALES):
        held, free = 1e3 * np.array([errors(*kind, seed) for seed in SEEDS]).T
        ratio = held / free
        mean, intensity, length_scale = kind
        rows.append(
            f"| {mean:g} | {intensity:.0%} | {length_scale:g} | {held.mean():.2f} "
            f"| {free.mean():.1f} | {ratio.mean():.1%} | {ratio.max():.1%} |"
        )
        print(rows[-1], flush=True)
    return "\n".join(rows)


if __name__ == "__main__":
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    _, after = rest.split(END)
    PAGE.write_text(f"{before}{BEGIN}\n\n{table()}\n\n{END}{after}", encoding="utf-8")
