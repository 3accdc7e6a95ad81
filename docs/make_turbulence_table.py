"""Write the tables of `docs/explanation/turbulence.md`: how well the tip is held.

    python docs/make_turbulence_table.py [alone | plane | space]

Runs the built-in scenarios in water of several kinds, five draws each, with and without control:
some minutes.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

import crinoid
from crinoid.results.effort import input_use
from crinoid.results.errors import angle_error, tip_error

PAGE = Path(__file__).with_name("explanation") / "turbulence.md"

SEEDS = range(5)
DRIFT = (0.06, 0.8, 1.0)
"""Drift (m/s), intensity and length scale (m) of the turbulence in both scenarios."""
KINDS = (
    (0.25, *DRIFT),
    (0.15, *DRIFT),
    (0.35, *DRIFT),
    (0.25, 0.06, 0.4, 1.0),
    (0.25, 0.06, 0.8, 0.3),
    (0.25, 0.15, 0.5, 1.0),
    (0.0, 0.3, 0.2, 0.5),
    (0.0, 0.3, 0.3, 0.2),
)
"""Velocity of the swell (m/s), and the turbulence."""
KINDS_IN_SPACE = KINDS[:3]

ALONE: dict[str, dict[str, Any]] = {
    "slide and tilt, for x and angle": {},
    "tilt alone, for x": {
        "control.controlled": ["x"],
        "control.pid": {"tilt": {"kp": 0.5, "ki": 5.0, "kd": 0.04, "derivative_filter_hz": 0.7}},
    },
    "tilt alone, for the angle": {
        "control.controlled": ["angle"],
        "control.pid": {"tilt": {"kp": 0.2, "ki": 2.0, "kd": 0.02, "derivative_filter_hz": 0.7}},
    },
    "slide alone, for x": {
        "control.controlled": ["x"],
        "control.pid": {"slide": {"kp": 0.05, "ki": 2.0}},
    },
}
"""Channels that drive, and what they are to hold; each with gains that suit it."""


def alone() -> str:
    """Return what each channel does alone, and the commands."""
    rows = ["| | Position (mm) | Angle (deg) | Slide (mm) | Tilt (deg) |", "|---|---|---|---|---|"]
    commands = []
    for name, values in ALONE.items():
        result = simulate("station-keeping", values)
        use = {key: each.rms for key, each in input_use(result).items()}
        slide = f"{1e3 * use['slide']:.1f}" if "slide" in use else "0"
        tilt = f"{np.rad2deg(use['tilt']):.1f}" if "tilt" in use else "0"
        rows.append(f"| {name} | {_errors(result)} | {slide} | {tilt} |")
        print(rows[-1], flush=True)
        sets = "".join(f" \\\n    --set '{key}={_toml(value)}'" for key, value in values.items())
        commands.append(f"crinoid run station-keeping --set target.judged_from=0{sets}")
    rows.append(f"| none | {_errors(simulate('station-keeping', {}).uncontrolled)} | 0 | 0 |")
    return "\n".join([*rows, "", "```", *commands, "```"])


def plane() -> str:
    """Return a row for each kind of water in the plane."""
    rows = []
    for kind in KINDS:
        swell, drift, intensity, length_scale = kind
        values = {
            "flow.0.amplitude": [swell, 0.0],
            "flow.1.mean": [drift, 0.0],
            "flow.1.intensity": intensity,
            "flow.1.length_scale": length_scale,
        }
        rows.append(_row("station-keeping", kind, values))
    return "\n".join([*HEADING, *rows])


def space() -> str:
    """Return a row for each kind of water in space."""
    rows = []
    for kind in KINDS_IN_SPACE:
        swell, drift, intensity, length_scale = kind
        values = {
            "flow.0.amplitude": [0.0, swell, 0.0],
            "flow.1.amplitude": [0.0, 0.0, 0.24 * swell],
            "flow.2.mean": [0.0, drift, 0.0],
            "flow.2.intensity": intensity,
            "flow.2.length_scale": length_scale,
        }
        rows.append(_row("station-keeping-3d", kind, values))
    return "\n".join([*HEADING, *rows])


def simulate(name: str, values: dict[str, Any]) -> crinoid.Result:
    """Run a built-in scenario with some of its values changed; errors count from the start."""
    return crinoid.simulate(crinoid.load(name).with_values(values | {"target.judged_from": 0.0}))


HEADING = (
    "| Swell (m/s) | Drift (m/s) | Intensity | Length scale (m) | Position (mm) | of error "
    "| of fluctuation | worst | Angle (deg) | of error | of fluctuation | worst |",
    "|---|---|---|---|---|---|---|---|---|---|---|---|",
)


def _row(name: str, kind: tuple[float, ...], values: dict[str, Any]) -> str:
    """Return means over the draws, and the worst ratio to the uncontrolled error."""
    cells = []
    sums: list[list[tuple[float, float, float]]] = [[], []]
    for seed in SEEDS:
        result = simulate(name, values | {"seed": seed})
        assert result.uncontrolled is not None
        for some, error in zip(sums, (tip_error, angle_error), strict=True):
            held, free = error(result), error(result.uncontrolled)
            some.append((held.rms, free.rms, free.fluctuation))
    for some, factor in zip(sums, (1e3, 180 / np.pi), strict=True):
        held, free, fluctuation = np.array(some).T
        cells += [
            f"{factor * held.mean():.2f}",
            f"{np.mean(held / free):.1%}",
            f"{np.mean(held / fluctuation):.1%}",
            f"{np.max(held / free):.1%}",
        ]
    swell, drift, intensity, length_scale = kind
    cells = [f"{swell:g}", f"{drift:g}", f"{intensity:.0%}", f"{length_scale:g}", *cells]
    row = f"| {' | '.join(cells)} |"
    print(row, flush=True)
    return row


def _errors(result: crinoid.Result) -> str:
    return f"{1e3 * tip_error(result).rms:.1f} | {np.rad2deg(angle_error(result).rms):.2f}"


def _toml(value: Any) -> str:
    """Write a value as an inline TOML table, or as JSON, which lists of words have in common."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {_toml(item)}' for key, item in value.items())}}}"
    return json.dumps(value)


if __name__ == "__main__":
    tables = {"alone": alone, "plane": plane, "space": space}
    for name in sys.argv[1:] or tables:
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        before, rest = PAGE.read_text(encoding="utf-8").split(begin)
        _, after = rest.split(end)
        text = f"{before}{begin}\n\n{tables[name]()}\n\n{end}{after}"
        PAGE.write_text(text, encoding="utf-8")
