"""Write the tables of `docs/turbulence.md`: how well station-keeping holds in turbulence.

    python docs/make_turbulence_table.py [plane | space]

Runs the built-in scenarios in turbulence of several kinds, ten seeds each, with and without
control: some minutes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np

import crinoid
from crinoid.metrics import tip_error

PAGE = Path(__file__).with_name("turbulence.md")

SEEDS = range(10)
MEANS, INTENSITIES, LENGTH_SCALES = (0.1, 0.25, 0.5), (0.1, 0.2, 0.3), (0.2, 0.5, 2.0)
DIRECTIONS = (
    (0.25, -0.15, 0.05),
    (0.3, 0.0, 0.0),
    (-0.3, 0.0, 0.0),
    (0.0, 0.3, 0.0),
    (0.0, -0.3, 0.0),
    (0.0, 0.0, 0.3),
)
OBLIQUE = (
    ((0.08, -0.05, 0.02), 0.2, 0.5),
    (DIRECTIONS[0], 0.3, 0.2),
    (DIRECTIONS[0], 0.3, 2.0),
    ((0.42, -0.25, 0.08), 0.2, 0.5),
    ((0.42, -0.25, 0.08), 0.3, 0.2),
)

Kind = tuple[tuple[float, ...], float, float]
"""Mean velocity (m/s), intensity and length scale (m)."""


def errors(name: str, kind: Kind, seed: int) -> tuple[float, float]:
    """Return the RMS tip errors (m) with and without control."""
    mean, intensity, length_scale = kind
    keys = {"mean": list(mean), "intensity": intensity, "length_scale": length_scale}
    scenario = crinoid.load(name).with_values(
        {f"flow.0.{key}": value for key, value in keys.items()} | {"seed": seed}
    )
    result = crinoid.simulate(scenario)
    assert result.uncontrolled is not None
    return tip_error(result).rms, tip_error(result.uncontrolled).rms


def plane() -> tuple[str, Iterator[tuple[str, Kind]]]:
    """Return the scenario and the kinds of turbulence in the plane, each with its name."""
    kinds = product(MEANS, INTENSITIES, LENGTH_SCALES)
    return "station-keeping", ((f"{mean:g}", ((mean, 0.0), *rest)) for mean, *rest in kinds)


def space() -> tuple[str, Iterator[tuple[str, Kind]]]:
    """Return the scenario and the kinds of turbulence in space, each with its name."""
    kinds = [*((mean, 0.2, 0.5) for mean in DIRECTIONS), *OBLIQUE]
    return "station-keeping-3d", ((", ".join(f"{u:g}" for u in k[0]), k) for k in kinds)


def table(scenario: str, kinds: Iterator[tuple[str, Kind]]) -> str:
    """Return a row for each kind of turbulence."""
    rows = [
        "| Mean (m/s) | Intensity | Length scale (m) | Controlled (mm) | Uncontrolled (mm) "
        "| Ratio | Worst seed |",
        "|---|---|---|---|---|---|---|",
    ]
    for mean, kind in kinds:
        held, free = 1e3 * np.array([errors(scenario, kind, seed) for seed in SEEDS]).T
        ratio = held / free
        rows.append(
            f"| {mean} | {kind[1]:.0%} | {kind[2]:g} | {held.mean():.2f} "
            f"| {free.mean():.1f} | {ratio.mean():.1%} | {ratio.max():.1%} |"
        )
        print(rows[-1], flush=True)
    return "\n".join(rows)


if __name__ == "__main__":
    tables = {"plane": plane, "space": space}
    for name in sys.argv[1:] or tables:
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        before, rest = PAGE.read_text(encoding="utf-8").split(begin)
        _, after = rest.split(end)
        text = f"{before}{begin}\n\n{table(*tables[name]())}\n\n{end}{after}"
        PAGE.write_text(text, encoding="utf-8")
