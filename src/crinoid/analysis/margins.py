"""The margins of a scenario's control loop, and the curves that show them, as a dataset."""

import numpy as np
import xarray as xr

from crinoid.analysis.linear_loop import LinearLoop, linear_loop
from crinoid.assembly.prepared import Prepared
from crinoid.foundation.status import Status
from crinoid.results.dataset import describe, described
from crinoid.simulation.loop_margin import ROBUST, Margin

MARGINS = "margins.nc"

_SHARE = 0.05  # command over the largest that counts as a part of a motion
_LEAST_SWING = 0.01  # angle by which a pole turns while it grows e-fold, below which it runs away


def find_margins(prepared: Prepared) -> xr.Dataset:
    """Return gain, phase, delay and modulus margin of a scenario's loop, and its eigenvalues.

    The loop of `crinoid.analysis.linear_loop`, cut at the commands. Each margin is the least in
    all waters. A margin that nothing bounds is infinite; phase and delay margin of a loop that is
    not stable are NaN.
    """
    loop = linear_loop(prepared)
    margin, loci, names = loop.open.margin(), loop.open.loci(), list(loop.inputs)
    waters = loop.open.waters
    parts = [
        ("locus", "frequency locus", loci, "eigenvalue of the open loop"),
        ("transfer", "frequency output input", loop.open.transfer[waters.index(loop.water)],
         "command that comes back, reversed, over one that is given where the loop is cut"),
    ]  # fmt: skip
    rows = [
        ("gain_margin", "", "1", margin.gain, "by what all gains may be multiplied at most"),
        ("gain_margin_frequency", "", "Hz", margin.gain_frequency, "frequency of the gain margin"),
        ("least_gain", "", "1", margin.least_gain,
         "by what all gains must be multiplied at least to keep the loop stable"),
        ("phase_margin", "", "rad", margin.phase, "angle by which all commands may lag or lead"),
        ("phase_margin_frequency", "", "Hz", margin.phase_frequency,
         "frequency of the phase margin"),
        ("delay_margin", "", "s", margin.delay, "time by which all commands may come later"),
        ("delay_margin_frequency", "", "Hz", margin.delay_frequency,
         "frequency of the delay margin"),
        ("modulus_margin", "", "1", margin.modulus,
         "least distance of an eigenvalue of the open loop from -1"),
        ("modulus_margin_frequency", "", "Hz", margin.frequency,
         "frequency at which an eigenvalue comes nearest to -1"),
        ("stable", "", "1", int(margin.stable), "whether the closed loop is stable: 1, else 0"),
        # netCDF has no complex numbers
        *((f"{name}_{part}", dims, "1", number, f"{meaning}, {part} part")
          for name, dims, values, meaning in parts
          for part, number in (("real", values.real), ("imaginary", values.imag))),
    ]  # fmt: skip
    coords = [
        ("frequency", "frequency", "Hz", loop.open.frequency, "frequency"),
        ("locus", "locus", "", np.arange(1, loci.shape[1] + 1), "eigenvalue"),
        ("water", "locus", "", np.repeat(waters, len(names)), "water in which drag damps the arm"),
        ("input", "input", "", names, "input that is driven"),
        ("output", "output", "", names, "input that is commanded"),
    ]
    notes = _nearly_free(loop, margin) if margin.stable else _growth(loop)
    return xr.Dataset(
        described(rows),
        described(coords),
        describe(prepared.scenario)
        | {"status": Status.OK.value, "notes": notes, "water": loop.water},
    )


def _nearly_free(loop: LinearLoop, margin: Margin) -> str:
    """Name the commands that hardly come back to rest, where the modulus margin is that small."""
    if margin.modulus >= ROBUST:
        return ""
    at = int(np.argmin(np.abs(loop.open.frequency - margin.frequency)))
    values, vectors = np.linalg.eig(loop.open.transfer[loop.open.waters.index(loop.water), at])
    along = vectors[:, np.argmin(np.abs(1 + values))]
    shares = (along / along[np.argmax(np.abs(along))]).real
    words = [
        f"{share:.2g} {name}"
        for share, name in zip(shares, loop.inputs, strict=True)
        if abs(share) > _SHARE
    ]
    return (
        f"the modulus margin is below {ROBUST:g} near {margin.frequency:.2g} Hz, where the inputs "
        f"move together by {', '.join(words)}"
    )


def _growth(loop: LinearLoop) -> str:
    """Say how small motions of an unstable loop grow."""
    pole = loop.poles[0]
    time, unstable = 1 / pole.real, f"the closed loop is unstable in {loop.water}"
    if abs(pole.imag) < _LEAST_SWING * pole.real:
        return f"{unstable}: the tip runs away, e-fold in {time:.3g} s"
    frequency = abs(pole.imag) / (2 * np.pi)
    return f"{unstable}: small motions grow near {frequency:.3g} Hz, e-fold in {time:.3g} s"
