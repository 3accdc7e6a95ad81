"""The balance of energy of a run: stored energies against works, and what a defect tells."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.elements import ENERGIES
from crinoid.pieces import pieces
from crinoid.scenario import Scenario
from crinoid.scenario.simulation import Simulation

Series = Float[np.ndarray, " time"]

_NOTED = 0.02
"""Defect over the largest energy or work that is worth a note."""
_FAILED = 0.5
"""Defect over the largest energy or work past which a run tells nothing of the arm."""
_STILL = 1e-6
"""Displacement over the length up to which an arm hardly moves."""
_SHORTER = (2, 5, 10, 20, 50, 100)
"""Shares of a time step that divide whatever times the step divides."""


class Defect(NamedTuple):
    """Energy that the arm gained without work, or lost."""

    energy: float
    """Where it is largest (J); negative if lost."""
    scale: float
    """Largest change of one stored energy or work since the start, or what a step resolves (J)."""
    since: float
    """When it began to be worth a note (s)."""
    failed: float | None
    """When it first exceeded the share past which a run has failed (s)."""
    cause: str
    remedy: str

    @property
    def gained(self) -> bool:
        """Whether there was energy that no work gave."""
        return self.energy > 0

    @property
    def told(self) -> str:
        """How much it is, of what, and since when."""
        size, share = f"{abs(self.energy):.2g} J", f"{abs(self.energy) / self.scale:.0%}"
        how = (
            f"gained {size} that no work gave" if self.gained else f"lost {size} that no work took"
        )
        return (
            f"the arm {how}, {share} of the largest energy or work, from t = {self.since:.4g} s on"
        )

    @property
    def note(self) -> str:
        """A sentence for the user."""
        return f"the energy ledger does not balance: {self.told}; {self.cause}: try {self.remedy}"

    @property
    def failure(self) -> str:
        """The status of a run that tells nothing of the arm."""
        assert self.failed is not None
        return f"failed at t = {self.failed:.6g} s: {self.told}; {self.cause}: try {self.remedy}"


def find_defect(
    dataset: xr.Dataset, scenario: Scenario, floor: float, step_energy: float
) -> Defect | None:
    """Return what the ledger of a run misses, if it is worth a note.

    That is stored energy less works since the start, as a share of the largest change of any one
    stored energy or work, or of the energy that a step cannot resolve, ``step_energy`` (J,
    `crinoid.ringing`). What the solver lets pass in an arm that hardly moves does not count: the
    imbalance that steps ended with, and the ``floor`` of round-off (N,
    `crinoid.dynamics.Settings.floor`), along the path that the nodes went.
    """
    finite = np.isfinite(dataset["energy"].transpose("time", "kind").values).all(axis=1)
    if not finite.all():  # what comes after that tells nothing, and the run says so
        dataset = dataset.isel(time=slice(0, int(np.argmin(finite))))
    if dataset.sizes["time"] < 2:
        return None
    energy, time = dataset["energy"].transpose("time", "kind").values, dataset["time"].values
    change = energy - energy[0]
    stored = np.isin(dataset["kind"].values, ENERGIES)
    defect = change[:, stored].sum(axis=1) - change[:, ~stored].sum(axis=1)
    largest = np.maximum.accumulate(np.abs(change).max(axis=1))
    scale, simulation = max(float(largest[-1]), step_energy), scenario.simulation
    slack, rounding, moved = _slack(dataset, floor)
    still = moved <= _STILL * float(dataset["arc_length"][-1])
    beyond = np.abs(defect) - still * slack - rounding
    if beyond.max() <= _NOTED * scale:
        return None
    worst, begun = int(np.argmax(beyond)), int(np.argmax(beyond > _NOTED * scale))
    # the largest energy may come of what went wrong: look back by what was large before
    begun = int(np.flatnonzero(beyond[:begun] <= _NOTED * largest[:begun])[-1]) + 1
    failed = time[beyond > _FAILED * scale]
    size = float(defect[worst])
    if abs(size) <= slack[worst] + rounding + _NOTED * scale:
        cause = f"steps balance the forces to simulation.tolerance = {simulation.tolerance:g} only"
        remedy = f"simulation.tolerance = {simulation.tolerance / 100:g}"
    else:
        share, angle = abs(size) / scale, turned(dataset, simulation, begun)
        cause, remedy = _reason(simulation, share, size > 0, angle)
    first = float(failed[0]) if failed.size else None
    return Defect(size, scale, float(time[begun]), first, cause, remedy)


def turned(dataset: xr.Dataset, simulation: Simulation, since: int) -> float:
    """Return by what angle vibrations turn in a time step (rad), from an instant on.

    That is ``h sqrt(sum a^2 / sum v^2)``: of one vibration ``h omega``, of many that of the mean of
    ``omega^2`` with the kinetic energy as its weight.
    """
    lately = dataset.isel(time=slice(since, None))
    squares = np.zeros(2)
    for piece in pieces(lately, ["acceleration", "velocity"]):
        squares += [np.sum(piece[name].values ** 2) for name in ("acceleration", "velocity")]
    ratio = squares[0] / squares[1] if squares[1] > 0 else 0.0
    return simulation.time_step * math.sqrt(ratio)


def shorter(simulation: Simulation, share: float) -> str:
    """Return the time step to try where a defect is a share of what happens."""
    options = simulation.integrator_options
    second = simulation.integrator != "implicit-euler" and options.get("gamma", 0.5) == 0.5
    wanted = (min(share, _FAILED) / _NOTED) ** (0.5 if second else 1.0)
    part = next((part for part in _SHORTER if part >= wanted), _SHORTER[-1])
    return f"simulation.time_step = {simulation.time_step / part:.3g}"


def _reason(simulation: Simulation, share: float, gained: bool, angle: float) -> tuple[str, str]:
    """Return the likely cause of a defect and what to try."""
    step, options = shorter(simulation, share), simulation.integrator_options
    length = f"{simulation.time_step:g} s"
    if not gained and simulation.integrator == "implicit-euler":
        return "implicit Euler damps all motion by itself", (
            f'simulation.integrator = "newmark", or {step}'
        )
    if not gained and options.get("spectral_radius", 1.0) < 1.0:
        return f"generalized-alpha damps what time steps of {length} do not resolve", step
    if not gained and options.get("gamma", 0.5) > 0.5:
        return f"simulation.gamma = {options['gamma']:g} damps by itself", (
            f"simulation.gamma = 0.5, or {step}"
        )
    if angle <= 1.0:
        return f"time steps of {length} are too long for this motion", step
    period = 2 * math.pi * simulation.time_step / angle
    cause = f"vibrations of periods near {period:.2g} s are too fast for time steps of {length}"
    damped = ', or simulation.integrator = "generalized-alpha"'
    return cause, step + damped * (simulation.integrator == "newmark")


def _slack(dataset: xr.Dataset, floor: float) -> tuple[Series, float, float]:
    """Return what tells a defect from what the solver lets pass.

    That is the work that imbalances may have done, by how much energies are rounded (J), and how
    far a node has moved along an axis (m).
    """
    first, paths, moved, tension = dataset["position"].isel(time=0).values, [], 0.0, 0.0
    for piece in pieces(dataset, ["position", "velocity", "tension"], overlap=True):
        position, speed = piece["position"].values, np.abs(piece["velocity"].values)
        step = np.diff(piece["time"].values)[:, None, None]
        fastest = np.maximum(speed[1:], speed[:-1]) * step
        paths.append(np.maximum(np.abs(np.diff(position, axis=0)), fastest).sum(axis=(1, 2)))
        moved = max(moved, float(np.abs(position - first).max()))
        tension = max(tension, float(np.abs(piece["tension"].values).max()))
    slack = np.cumsum((dataset["residual"].values[1:] + floor) * np.concatenate(paths))
    kept = float(np.abs(dataset["energy"].values).max(axis=0).sum())
    rounded = kept + float(dataset["arc_length"][-1]) * tension
    rounding = dataset.sizes["node"] * np.finfo(float).eps * rounded
    return np.concatenate([[0.0], slack]), rounding, moved
