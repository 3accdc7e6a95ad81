"""Control-loop diagnostics: saturation, growth, limit cycles, and disturbance rejection."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Bool, Float, Int

from crinoid.compilation import ONCE, compiled
from crinoid.dynamics import System
from crinoid.elements import AddedMass
from crinoid.foundation.axes import CHANNELS
from crinoid.numerics.signals_and_systems import periodograms
from crinoid.results.chunks import pieces
from crinoid.results.errors import judged, rms
from crinoid.results.result import Result
from crinoid.results.saturation import controlled, limit_shares
from crinoid.scenario import Scenario, SineFlow, SurfaceWaves, percent

_LARGE, _SEEN_RINGING = 0.25, 0.05
"""Shares of the median and of the largest force on the base above which unresolved vibrations
deserve a note."""
_STILL = 1e-6  # accelerations below this are round-off (m/s2)


def unresolved_vibrations(
    dataset: xr.Dataset, system: System, jumps: Float[np.ndarray, " time"], damped: str
) -> tuple[float, str]:
    """Return the energy that one time step cannot resolve (J), and a note on ringing vibrations.

    ``damped`` are words for another integrator (`crinoid.scenario.Simulation.or_damping`).
    The energy is that of a free arm under the loads for one step, ``(h P)^2 / 2 m``. The loads P
    are the force on the base plus mass times mean acceleration, with or without added mass (the
    smaller sum), less contacts: the median over the run. A vibration is unresolved where
    accelerations change by more than their size in a step, and more than by the ``jumps`` of
    commands (m/s2). The note compares medians of the second half of a run, which ignore a hit or a
    load that jumps.
    """
    own, swung, by_change = map(float, _inertia(system))
    step = float(system.time_step)
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
    change = dataset["step_error"].values / max(abs(by_change), 1e-300)
    late = slice(len(loads) // 2, None)
    rung = np.where(change > fastest + 2 * jumps, inertia, 0.0)
    rings, whole = np.median([rung[late], force[late]], axis=1)
    note = ""
    if rings > max(_LARGE * whole, _SEEN_RINGING * force.max(), _STILL * own):
        note = (
            f"vibrations that time steps of {step:g} s do not resolve make up "
            f"{percent(rings / whole)} of the force on the base (medians of the second half). Try "
            "a larger arm.damping_time, a smaller arm.section.EA, "
            f"simulation.time_step = {step / 10:.3g}{damped}."
        )
    return (step * float(np.median(loads))) ** 2 / (2 * own), note


@compiled(**ONCE)
def _inertia(system: System) -> tuple[Array, Array, Array]:
    """Return the mass, that with added mass, and the error of a step per change of acceleration."""
    own = system.forces.mass
    waters = [each for each in system.forces.elements if isinstance(each, AddedMass)]
    swung = own + sum(each.normal @ each.displaced.sum(axis=(1, 2)) for each in waters)
    error = system.integrator.error(jnp.zeros((1, 1)), jnp.ones((1, 1)), system.time_step)
    return own, swung, error[0, 0]


_OFTEN = {"range": 0.02, "speed": 0.1, "acceleration": 0.1}
"""Share of the time in saturation that deserves a note."""

_WINDOWS = 6
_RISE, _GROWN = 1.25, 3.0
"""Growth of the error from one window to the next, and over the last four."""

_NARROW = 0.6  # share of the variance in one line of the spectrum that makes it an oscillation
_LOBE = 2  # half-width of a spectral line through a Hann window, in lines
_CYCLES = 8
_LASTING = 0.7
_OVER_UNCONTROLLED = 2.0  # amplitude of the oscillation over that without control
_SEEN = 1e-3  # smallest amplitude of an oscillation over the length of the arm
_WORSE = 1.01  # error over that without control that deserves a note
_NOTHING = 1e-4  # error over the length of the arm below which errors are not compared


class LimitCycle(NamedTuple):
    """Limit cycle of a control loop."""

    frequency: float  # Hz
    amplitude: float  # RMS of the tip's error (m)


def growth(result: Result) -> float | None:
    """Return the growth of the tip's error from the middle of a run to its end; None without any.

    The error grows if its RMS over sixths of the controlled time rises three times in a row, each
    time by a quarter or more, and at least twice as much as without control.
    """
    windows = _windows(result, controlled(result))
    if windows is None:
        return None
    late = windows[-4:]
    rise = float(late[-1] / max(late[0], np.finfo(float).tiny))
    small = late[-1] < _NOTHING * result.scenario.arm.length
    if small or rise < _GROWN or np.any(late[1:] < _RISE * late[:-1]):
        return None
    if result.uncontrolled is not None:
        other = _windows(result.uncontrolled, controlled(result))
        if other is not None and other[-1] > 0.5 * rise * other[-4]:
            return None
    return rise


def limit_cycle(result: Result) -> LimitCycle | None:
    """Return the limit cycle of the loop; None without one.

    A limit cycle is a narrow band with most of the variance of the tip's error in the last half of
    the controlled time. It does not decay and is absent without control; if no run without control
    exists, nothing else may oscillate.
    """
    scenario, other = result.scenario, result.uncontrolled
    which = np.flatnonzero(controlled(result))
    which = which[which.size // 2 :]
    if which.size < 4 * _CYCLES or (other is None and _driven(scenario)):
        return None
    frequency, variance = _spectrum(result.dataset, which)
    line = int(np.argmax(variance))

    def in_band(data: xr.Dataset, part: Int[np.ndarray, " time"]) -> float:
        lines, found = _spectrum(data, part)
        return float(found[np.abs(lines - frequency[line]) < (_LOBE + 0.5) * lines[0]].sum())

    own = in_band(result.dataset, which)
    first, second = (in_band(result.dataset, half) for half in np.array_split(which, 2))
    narrow = line + 1 >= _CYCLES and own >= _NARROW * variance.sum()
    seen = own >= (_SEEN * scenario.arm.length) ** 2
    if not (narrow and seen and second >= _LASTING**2 * first):
        return None
    if other is not None and (
        other.dataset.sizes["time"] <= which[-1]
        or own < _OVER_UNCONTROLLED**2 * in_band(other.dataset, which)
    ):
        return None
    return LimitCycle(float(frequency[line]), own**0.5)


def comparison(result: Result) -> tuple[float, float] | None:
    """Return the RMS tip error with control and without (m), from when it is on and errors count.

    None unless both runs exist and control is on for the arm's first period or longer.
    """
    if result.uncontrolled is None:
        return None
    which = controlled(result) & judged(result)
    on = float(np.ptp(result.dataset["time"].values[which])) if which.any() else 0.0
    if "natural_frequency" in result.dataset:
        first = float(result.dataset["natural_frequency"][0])
        if on * first < 1 and first > 0:
            return None
    runs = (result.dataset, result.uncontrolled.dataset)
    count = min(which.size, *(data.sizes["time"] for data in runs))
    which = which[:count]
    if not which.any():
        return None
    with_, without = (rms(data["tip_error"].values[:count][which]) for data in runs)
    return with_, without


def loop_notes(result: Result) -> list[str]:
    """Return the notes on the loop of a run, a sentence each; none without feedback of the tip."""
    scenario = result.scenario
    if not scenario.control.settings.feeds_back:
        return []
    found = []
    for name, met in limit_shares(result).items():
        shares = {kind: share for kind, share in met._asdict().items() if share >= _OFTEN[kind]}
        if shares:
            times = " and ".join(f"{kind} for {share:.1%}" for kind, share in shares.items())
            key = f"base.channels.{name}" if name in CHANNELS[3] else name
            found.append(f"{key}: at its limit of {times} of the time. The loop demands more.")
    grown, cycle, compared = growth(result), limit_cycle(result), comparison(result)
    if grown is not None:
        alone = ", more than without control" * (result.uncontrolled is not None)
        found.append(
            f"the tip's error grows by a factor of {grown:.3g} from the middle of the run to its "
            f"end{alone}. The loop may be unstable, or a channel at its limit."
        )
    elif cycle is not None:
        found.append(
            f"the loop is in a limit cycle: the tip oscillates at {cycle.frequency:.2g} Hz with "
            f"{1e3 * cycle.amplitude:.2g} mm RMS. Lower the gains."
        )
    if compared is not None and compared[0] > max(
        _WORSE * compared[1], _NOTHING * scenario.arm.length
    ):
        hint = '. Try control.kind = "lqg", other inputs, or crinoid tune.'
        found.append(
            f"control increases the tip's error: {1e3 * compared[0]:.3g} mm RMS with control, "
            f"{1e3 * compared[1]:.3g} mm without{hint if scenario.control.gains else ''}"
        )
    return found


def _windows(
    result: Result, which: Bool[np.ndarray, " time"]
) -> Float[np.ndarray, " window"] | None:
    """Return the RMS tip error over equal parts of a run; None if the run is too short."""
    error = result.dataset["tip_error"].values
    error = error[which[: error.size]] if which.size >= error.size else error[: which.size][which]
    if error.size < 4 * _WINDOWS:
        return None
    return np.array([*map(rms, np.array_split(error, _WINDOWS))])


def _spectrum(
    data: xr.Dataset, which: Int[np.ndarray, " time"]
) -> tuple[Float[np.ndarray, " line"], Float[np.ndarray, " line"]]:
    """Return frequencies (Hz) and the variance of the tip's error, without its trend, at each."""
    error = (data["tip_position"] - data["tip_target"]).values[which]
    time, share = data["time"].values[which], np.linspace(0.0, 1.0, which.size)
    even = time[0] + share * np.ptp(time)
    error = np.stack([np.interp(even, time, column) for column in error.T], axis=1)
    slope, start = np.polyfit(share, error, 1)
    error -= np.outer(share, slope) + start
    density = periodograms(error[:, None], even[1] - even[0], which.size)[0].sum(axis=(1, 2))[1:]
    frequency = np.fft.rfftfreq(which.size, even[1] - even[0])[1:]
    return frequency, density * frequency[0]


def _driven(scenario: Scenario) -> bool:
    """Return whether waves, the base or the target make the tip oscillate."""
    waves = any(isinstance(flow, SineFlow | SurfaceWaves) for flow in scenario.flow)
    return waves or bool(scenario.base.motion) or scenario.target.moves
