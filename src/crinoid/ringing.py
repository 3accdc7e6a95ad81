"""Vibrations that time steps do not resolve: their energy, and their part of the base's force."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import xarray as xr

from crinoid.dynamics import System
from crinoid.elements import AddedMass
from crinoid.pieces import pieces

_LARGE = 0.25
"""Share of the force on the base from which on vibrations that are not resolved get a note."""


def unresolved(dataset: xr.Dataset, system: System) -> tuple[float, str]:
    """Return the energy that one time step cannot resolve (J), and a note where vibrations ring on.

    The energy is that of a free arm which the loads drive for one step, ``(h P)^2 / 2 m``. The
    loads P are the force on the base plus mass times mean acceleration, with or without the added
    mass: the smaller sum, and its median over the run. A vibration is not resolved where accelerations change by more than their
    size in a step. The note compares medians of the second half of a run: a hit, or a load that
    jumps, makes none.
    """
    own, step, swung = float(system.forces.mass), float(system.time_step), 0.0
    for water in (each for each in system.forces.elements if isinstance(each, AddedMass)):
        swung += float((water.normal * water.displaced.sum(axis=(1, 2))).sum())
    share = np.convolve(np.diff(dataset["arc_length"]), [0.5, 0.5])
    half, forces = dataset.sizes["time"] // 2, []
    pushed, inertia, largest = [], [], []
    for piece in pieces(dataset, ["acceleration", "base_force"]):
        acceleration, base = piece["acceleration"].values, piece["base_force"].values
        forces.append(np.linalg.norm(base, axis=1))
        mean = np.einsum("n,tna->ta", share / share.sum(), acceleration)
        moved = np.array([own, own + swung])[:, None, None] * mean
        loads = np.linalg.norm(base + moved, axis=2)
        pushed.append(loads.min(axis=0))
        inertia.append(np.linalg.norm(moved, axis=2)[loads.argmin(axis=0), range(len(mean))])
        largest.append(np.linalg.norm(acceleration - acceleration[:, :1], axis=2).max(axis=1))
    by_change = system.integrator.error(jnp.zeros((1, 1)), jnp.ones((1, 1)), system.time_step)
    change = dataset["step_error"].values / max(abs(float(by_change[0, 0])), 1e-300)
    ringing = np.where(change > np.concatenate(largest), np.concatenate(inertia), 0.0)[half:]
    part = np.median(ringing) / max(np.median(np.concatenate(forces)[half:]), 1e-300)
    note = ""
    if part > _LARGE:
        note = (
            f"vibrations that time steps of {step:g} s do not resolve make up {part:.0%} of the "
            "force on the base (medians of the second half): try simulation.time_step = "
            f'{step / 10:.3g}, simulation.integrator = "generalized-alpha", a larger '
            "arm.damping_time or a smaller arm.section.EA"
        )
    return (step * float(np.median(np.concatenate(pushed)))) ** 2 / (2 * own), note
