"""Energy balance of a run: stored energies against works, and the likely cause of a defect."""

import math
from typing import NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.elements import ENERGIES
from crinoid.results.chunks import pieces
from crinoid.scenario import Scenario
from crinoid.scenario.simulation import Simulation

Series = Float[np.ndarray, " time"]

_NOTED = 0.02  # defect over the largest energy or work that is worth a note
_FAILED = 0.5  # defect over the largest energy or work above which a run has failed
_STILL = 1e-6  # displacement over the length below which an arm is at rest
_SHORTER = (2, 5, 10, 20, 50, 100)
"""Divisors of a time step; the shorter steps still divide all times that the step divides."""


class Defect(NamedTuple):
    """Energy defect: energy gained or lost that no work accounts for."""

    energy: float
    """The largest defect (J); negative if lost."""
    scale: float
    """Largest change of one stored energy or work since the start, or what a step resolves (J)."""
    since: float
    """Time from which it deserves a note (s)."""
    failed: float | None
    """Time from which the run has failed (s)."""
    cause: str
    remedy: str

    @property
    def gained(self) -> bool:
        """Whether the arm gained energy."""
        return self.energy > 0

    @property
    def summary(self) -> str:
        """Size, share and time of the defect, in words."""
        return (
            f"the arm {'gained' if self.gained else 'lost'} {abs(self.energy):.2g} J that no force "
            f"accounts for, {abs(self.energy) / self.scale:.0%} of the largest energy or work, "
            f"from t = {self.since:.4g} s on"
        )

    @property
    def note(self) -> str:
        """A sentence for the user."""
        return f"energy balance: {self.summary}; {self.cause}. Try {self.remedy}."

    @property
    def failure(self) -> str:
        """The status of a run that failed by it."""
        assert self.failed is not None
        return f"failed at t = {self.failed:.6g} s: {self.summary}; {self.cause}; try {self.remedy}"


def find_defect(
    dataset: xr.Dataset, scenario: Scenario, floor: float, step_energy: float
) -> Defect | None:
    """Return the energy defect of a run; None if it is too small for a note.

    The defect is stored energy less works since the start. Its scale is the largest change of any
    one stored energy or work, or the energy that a step cannot resolve, ``step_energy`` (J,
    `unresolved_vibrations`). In an arm at rest the errors of the solver do not count: the final
    imbalance of the steps and the ``floor`` of round-off (N), along the paths of the nodes.
    """
    finite = np.isfinite(dataset["energy"].transpose("time", "kind").values).all(axis=1)
    if not finite.all():  # the status of the run reports it
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
    worst, first = int(np.argmax(beyond)), int(np.argmax(beyond > _NOTED * scale))
    # the defect may make the largest energy: look back by the largest energy up to each instant
    first = int(np.flatnonzero(beyond[:first] <= _NOTED * largest[:first])[-1]) + 1
    failed = time[beyond > _FAILED * scale]
    size = float(defect[worst])
    if abs(size) <= slack[worst] + rounding + _NOTED * scale:
        cause = f"steps balance the forces to simulation.tolerance = {simulation.tolerance:g} only"
        remedy = f"simulation.tolerance = {simulation.tolerance / 100:g}"
    else:
        share, angle = abs(size) / scale, vibration_angle(dataset, simulation, first)
        cause, remedy = _reason(simulation, share, size > 0, angle)
    failure = float(failed[0]) if failed.size else None
    return Defect(size, scale, float(time[first]), failure, cause, remedy)


def vibration_angle(dataset: xr.Dataset, simulation: Simulation, since: int) -> float:
    """Return the phase that vibrations advance in a time step (rad), from an instant on.

    ``h sqrt(sum a^2 / sum v^2)``: for one vibration ``h omega``, for several that of the mean
    ``omega^2`` weighted by kinetic energy.
    """
    squares = np.zeros(2)
    for piece in pieces(dataset.isel(time=slice(since, None)), ["acceleration", "velocity"]):
        squares += [np.sum(piece[name].values ** 2) for name in ("acceleration", "velocity")]
    ratio = squares[0] / squares[1] if squares[1] > 0 else 0.0
    return simulation.time_step * math.sqrt(ratio)


def shorter_step(simulation: Simulation, share: float) -> str:
    """Return the time step to try against a defect of this share of the energy scale."""
    options = simulation.integrator_options
    second = simulation.integrator != "implicit-euler" and options.get("gamma", 0.5) == 0.5
    divisor = (min(share, _FAILED) / _NOTED) ** (0.5 if second else 1.0)
    part = next((part for part in _SHORTER if part >= divisor), _SHORTER[-1])
    return f"simulation.time_step = {simulation.time_step / part:.3g}"


def _reason(simulation: Simulation, share: float, gained: bool, angle: float) -> tuple[str, str]:
    """Return the likely cause of a defect, and the remedy."""
    step, options = shorter_step(simulation, share), simulation.integrator_options
    length = f"{simulation.time_step:g} s"
    if not gained and simulation.integrator == "implicit-euler":
        return "implicit Euler damps all motion", (f'simulation.integrator = "newmark", or {step}')
    if not gained and options.get("spectral_radius", 1.0) < 1.0:
        cause = f"generalized-alpha damps vibrations that time steps of {length} do not resolve"
        return cause, step
    if not gained and options.get("gamma", 0.5) > 0.5:
        cause = f"simulation.gamma = {options['gamma']:g} adds damping"
        return cause, f"simulation.gamma = 0.5, or {step}"
    if angle <= 1.0:
        return f"time steps of {length} are too long for this motion", step
    period = 2 * math.pi * simulation.time_step / angle
    cause = f"vibrations of periods near {period:.2g} s are too fast for time steps of {length}"
    return cause, step + simulation.or_damping


def _slack(dataset: xr.Dataset, floor: float) -> tuple[Series, float, float]:
    """Return the work of imbalances and the round-off of energies (J), and the displacement (m)."""
    first, paths, moved, tension = dataset["position"].isel(time=0).values, [], 0.0, 0.0
    for piece in pieces(dataset, ["position", "velocity", "tension"], overlap=True):
        position, speed = piece["position"].values, np.abs(piece["velocity"].values)
        step = np.diff(piece["time"].values)[:, None, None]
        fastest = np.maximum(speed[1:], speed[:-1]) * step
        paths.append(np.maximum(np.abs(np.diff(position, axis=0)), fastest).sum(axis=(1, 2)))
        moved = max(moved, float(np.abs(position - first).max()))
        tension = max(tension, float(np.abs(piece["tension"].values).max()))
    slack = np.cumsum((dataset["residual"].values[1:] + floor) * np.concatenate(paths))
    energies = float(np.abs(dataset["energy"].values).max(axis=0).sum())
    rounded = energies + float(dataset["arc_length"][-1]) * tension
    rounding = dataset.sizes["node"] * np.finfo(float).eps * rounded
    return np.concatenate([[0.0], slack]), rounding, moved
