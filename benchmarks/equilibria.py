"""Equilibria of the default arm in turbulence: none may fail, and each must balance.

Draws base tilts from -60 to 20 degrees, four kinds of turbulence and many seeds. All draws have
the same structure, so that the search is compiled once.
"""

import argparse

import equinox as eqx
import numpy as np
from rich.console import Console
from rich.table import Table

import crinoid
from crinoid.dynamics import System

KINDS = ((0.2, 0.2, 0.3), (0.4, 0.2, 0.3), (0.2, 0.4, 0.3), (0.3, 0.3, 0.1))
"""Mean (m/s), intensity and length scale (m)."""
TILTS = (-60.0, 20.0)
"""Least and largest tilt of the base (degrees)."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=50, help="draws of each kind")
    parser.add_argument("--dimension", type=int, default=2, choices=(2, 3), help="of the arm")
    options = parser.parse_args()
    console = Console(highlight=False, markup=False, width=100)
    # compiled as `crinoid run` does what runs once
    find = eqx.filter_jit(
        System.find_equilibrium, compiler_options={"xla_backend_optimization_level": 0}
    )

    table = Table(title="Equilibria in turbulence", title_justify="left")
    for name in ("mean", "intensity", "scale", "draws", "failed", "iterations", "most"):
        table.add_column(name, justify="right")
    for kind in KINDS:
        outcomes = []
        for seed, tilt in enumerate(np.linspace(*TILTS, options.draws)):
            _, outcome = find(draw(options.dimension, kind, float(tilt), seed), 0.0)
            outcomes.append((bool(outcome.converged), int(outcome.iterations)))
            if not outcome.converged:
                console.print(f"no equilibrium: {kind}, tilt {tilt:.1f} degrees, seed {seed}")
        found, iterations = np.array(outcomes).T
        mean, intensity, scale = kind
        table.add_row(
            f"{mean} m/s",
            str(intensity),
            f"{scale} m",
            str(options.draws),
            str(int(np.sum(found == 0))),
            f"{np.median(iterations):.0f}",
            str(iterations.max()),
        )
    console.print(table)


def draw(dimension: int, kind: tuple[float, float, float], tilt: float, seed: int) -> System:
    """Return the default arm in turbulence of a kind."""
    mean, intensity, scale = kind
    flow = {
        "kind": "turbulence",
        "mean": [mean] + [0.0] * (dimension - 1),
        "intensity": intensity,
        "length_scale": scale,
    }
    scenario = crinoid.Scenario(
        arm={"dimension": dimension}, base={"tilt_deg": tilt}, flow=[flow], seed=seed
    )
    return crinoid.system(scenario)


if __name__ == "__main__":
    main()
