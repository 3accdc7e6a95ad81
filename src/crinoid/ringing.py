"""Vibrations that time steps do not resolve: their energy, and their part of the base's force."""

import jax.numpy as jnp
import numpy as np
import xarray as xr

from crinoid.dynamics import System
from crinoid.elements import AddedMass
from crinoid.pieces import pieces

_LARGE, _SEEN = 0.25, 0.05
"""Shares of the force on the base, as it is and at most, from which on vibrations that are not
resolved get a note."""


def unresolved(dataset: xr.Dataset, system: System) -> tuple[float, str]:
    """Return the energy that one time step cannot resolve (J), and a note where vibrations ring on.

    The energy is that of a free arm which the loads drive for one step, ``(h P)^2 / 2 m``. The
    loads P are the force on the base plus mass times mean acceleration, with or without added mass,
    the smaller sum; less contacts, by the median over the run. A vibration is not resolved where
    accelerations change by more than their size in a step. The note compares medians of the second
    half of a run: a hit, or a load that jumps, makes none.
    """
    own, step = float(system.forces.mass), float(system.time_step)
    waters = [each for each in system.forces.elements if isinstance(each, AddedMass)]
    swung = own + sum(float(each.normal @ each.displaced.sum(axis=(1, 2))) for each in waters)
    share = np.convolve(np.diff(dataset["arc_length"]), [0.5, 0.5])
    touched = [name for name in ("contact_force",) if name in dataset]
    parts = []
    for piece in pieces(dataset, ["acceleration", "base_force", *touched]):
        acceleration, base = piece["acceleration"].values, piece["base_force"].values
        moved = np.einsum("k,n,tna->kta", [own, swung], share / share.sum(), acceleration)
        pushed = base - sum(piece[name].values.sum(axis=1) for name in touched) + moved
        loads, inertia = np.linalg.norm(pushed, axis=2), np.linalg.norm(moved, axis=2)
        inertia = np.where(loads[0] < loads[1], *inertia)
        fastest = np.linalg.norm(acceleration - acceleration[:, :1], axis=2).max(axis=1)
        parts.append([loads.min(axis=0), inertia, np.linalg.norm(base, axis=1), fastest])
    loads, inertia, force, fastest = np.concatenate(parts, axis=1)
    by_change = system.integrator.error(jnp.zeros((1, 1)), jnp.ones((1, 1)), system.time_step)
    change = dataset["step_error"].values / max(abs(float(by_change[0, 0])), 1e-300)
    late = slice(len(loads) // 2, None)
    rings, whole = np.median([np.where(change > fastest, inertia, 0.0)[late], force[late]], axis=1)
    note = ""
    if rings > _LARGE * whole > 0 and rings > _SEEN * force.max():
        note = (
            f"vibrations that time steps of {step:g} s do not resolve make up "
            f"{rings / whole:.0%} of the force on the base (medians of the second half): try "
            f"simulation.time_step = {step / 10:.3g}, "
            'simulation.integrator = "generalized-alpha", a larger arm.damping_time or a smaller '
            "arm.section.EA"
        )
    return (step * float(np.median(loads))) ** 2 / (2 * own), note
