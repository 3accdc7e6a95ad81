"""Stability margins of a control loop, before its run.

The loop is cut at the commands. Its transfer at a frequency is the product of controller, hold,
servo, arm and sensor, ``L = C M G S H e^(-i w d)``, with PID and filtered derivative ``C`` as they
are computed from samples, mapping ``M``, the tip's response ``G``
(`crinoid.simulation.frequency_response`), servos and other actuators ``S``, the hold ``H`` of a
command between two, and the age ``d`` of a reading. Images of motions above half the control
rate are left out: the servos carry hardly anything there. Motions are taken as small: no limits are
met. That an input hands over to others (`crinoid.control.Allocation`) is slow, and left out.

The loop is stable if no eigenvalue of ``L`` goes round -1 (MacFarlane and Postlethwaite 1977;
Skogestad and Postlethwaite 2005, section 4.9; Astrom and Murray 2008, section 9.3). How near they
come to it is its modulus margin. The least singular value of ``I + L`` would depend on whether
angles are in radians or degrees, the eigenvalues do not.

The response of an undamped arm is infinite at a resonance. So the contour of Nyquist's criterion
passes to the right of the imaginary axis by `INDENTED` times the frequency: poles on the axis count
as stable, and ``L`` is finite everywhere.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Inexact

from crinoid.control import Pid, Sensor
from crinoid.scenario import PidGains
from crinoid.simulation.frequency_response import Plant
from crinoid.simulation.loop import Loop

ROBUST = 0.1
"""Modulus margin below which a loop gets a note: a tenth more gain may be too much for it."""
_GRID = 120
_APART, _WIDEST = 1.3, 0.06
"""Ratio of distances from a resonance at which it is looked at, and the largest, over it."""
_TICKS = 4000
INDENTED = 1e-6
"""Growth of a motion over its angular frequency that counts as none."""
_NOTHING = 1e-3  # share of the largest integrator below which one is none

_WANTED = 0.2  # modulus margin that the gains proposed leave
_FACTORS = np.geomspace(1.0, 1e-6, 73)

Loops = Complex[np.ndarray, "*water f input input"]


class Margin(NamedTuple):
    """Stability margins of a loop."""

    stable: bool
    modulus: float  # modulus margin: distance of an eigenvalue of the open loop from -1
    gain: float  # by what all gains may be multiplied at most
    frequency: float  # where the modulus is least (Hz); 0 where an integrator has the wrong sign
    least_gain: float = 0.0
    """By what all gains must be multiplied at least; 0 where they may be as small as they like."""
    phase: float = math.inf
    """Angle by which all commands may lag or lead (rad); infinite where no gain reaches 1."""
    delay: float = math.inf  # time by which all commands may come later (s)
    gain_frequency: float = math.nan
    """Where it swings with the largest gains (Hz); not a number where it never does."""
    phase_frequency: float = math.nan  # where it swings with the largest phase (Hz)
    delay_frequency: float = math.nan  # where it swings with the largest delay (Hz)


class OpenLoop(NamedTuple):
    """The transfer of a loop that is cut at the commands of the inputs that are driven."""

    frequency: Float[np.ndarray, " f"]  # Hz
    transfer: Loops
    integrated: Float[np.ndarray, "*water input input"]
    """Gain of the integral terms on slow commands (1/s)."""
    waters: tuple[str, ...] = ("",)  # names of the waters, in which drag damps the arm differently
    stable: bool | None = None
    """Whether the closed loop is stable in all waters, where its poles are known. Else the number
    of turns round -1 decides, for a plant and a controller that are stable by themselves."""

    @staticmethod
    def of(
        plants: Mapping[str, Plant], closed: Loop, resonances: Float[np.ndarray, " mode"]
    ) -> "OpenLoop":
        """Build it from the closed loop of a PID, the arm in each water, and resonances (Hz)."""
        controller, system = closed.controller, closed.system
        assert isinstance(controller, Pid)
        period = float(controller.period)
        grid = _frequencies(resonances, 0.5 / period)
        indented = grid * (1 - INDENTED * 1j)
        gains, mapping = _controller(controller, indented), np.asarray(controller.mapping)
        driven = np.flatnonzero(np.abs(mapping).max(axis=1) > 0)
        rate = 2j * np.pi * indented
        hold = (1 - np.exp(-rate * period)) / (rate * period)
        old = np.exp(-rate * age(closed.sensors[0], period, float(system.time_step)))
        response = np.concatenate([one.response(grid) for one in system.followers], axis=1)
        response *= (hold * old)[:, None]
        loop = mapping @ np.stack([each.response(indented) for each in plants.values()])
        integrated = np.asarray(controller.ki)[:, None] * loop[:, 0].real
        loop = gains[:, :, None] * loop * response[:, None, :]
        both = np.ix_(driven, driven)
        return OpenLoop(grid, loop[..., *both], integrated[..., *both], tuple(plants))

    def scaled(self, factor: Float[np.ndarray, " input"] | float) -> "OpenLoop":
        """Return the loop with other gains."""
        factors = np.broadcast_to(factor, self.transfer.shape[-1:])
        return self._replace(
            transfer=factors[:, None] * self.transfer,
            integrated=factors[:, None] * self.integrated,
            stable=None,
        )

    def loci(self) -> Complex[np.ndarray, "f input"]:
        """Return the eigenvalues of the transfer, each one a curve over the frequency.

        Those of the first water come first.
        """
        values = np.linalg.eigvals(self.transfer).reshape(-1, *self.transfer.shape[-3:-1])
        return np.concatenate([_followed(each) for each in values], axis=1)

    @property
    def weakest(self) -> str:
        """The water in which the loop is unstable, or else has the least modulus margin."""
        if len(self.waters) == 1:
            return self.waters[0]
        each = zip(self.waters, self.transfer, self.integrated, strict=True)
        return min((OpenLoop(self.frequency, L, ki).margin(), water) for water, L, ki in each)[1]

    def margin(self) -> Margin:
        """Return the stability margins of the loop.

        Exact for changes of all commands alike: gain, phase and delay of every eigenvalue change
        together. Each is the least in all waters. Phase and delay of a loop that is not stable are
        not numbers.
        """
        values = self.loci()
        away = np.abs(1 + values).min(axis=1)
        worst = int(np.argmin(away))
        at, upward, where = _crossings(self.frequency, values)
        integrators = np.linalg.eigvals(self.integrated)
        wrong = int(np.sum(integrators.real < -_NOTHING * np.abs(integrators).max()))
        ends = np.sum(upward[at < -1]) + wrong
        stable = bool(ends == 0) if self.stable is None else self.stable
        gains = -1 / at
        more = gains > 1 if stable else np.ones(gains.shape, bool)
        # some are stable between two gains only
        gain, first = _least(gains[more], where[more])
        frequency = 0.0 if wrong else float(self.frequency[worst])
        found = Margin(stable, float(away[worst]), gain, frequency, gain_frequency=first)
        if not stable:
            return found._replace(phase=math.nan, delay=math.nan)
        circle, lag = _on_the_circle(self.frequency, values)
        phase, at_phase = _least(np.minimum(lag, 2 * np.pi - lag), circle)
        delay, at_delay = _least(lag / (2 * np.pi * circle), circle)
        return found._replace(
            least_gain=float(gains[gains < 1].max(initial=0.0)),
            phase=phase,
            delay=delay,
            phase_frequency=at_phase,
            delay_frequency=at_delay,
        )


def _least(
    values: Float[np.ndarray, " cross"], where: Float[np.ndarray, " cross"]
) -> tuple[float, float]:
    """Return the least value and where it is; infinite, and nowhere, if there is none."""
    if not values.size:
        return math.inf, math.nan
    least = int(np.argmin(values))
    return float(values[least]), float(where[least])


def _on_the_circle(
    frequency: Float[np.ndarray, " f"], values: Complex[np.ndarray, "f input"]
) -> tuple[Float[np.ndarray, " cross"], Float[np.ndarray, " cross"]]:
    """Return where eigenvalues are as large as 1 (Hz), and by which lag they would be -1 (rad)."""
    size = np.log(np.maximum(np.abs(values), np.finfo(float).tiny))
    angle = np.unwrap(np.angle(values), axis=0)
    before, curve = np.nonzero(np.diff(np.sign(size), axis=0))
    low, high = size[before, curve], size[before + 1, curve]
    share = low / (low - high)
    turned = angle[before, curve] + share * (angle[before + 1, curve] - angle[before, curve])
    where = frequency[before] * (frequency[before + 1] / frequency[before]) ** share
    return where, np.mod(turned + np.pi, 2 * np.pi)


def _crossings(
    frequency: Float[np.ndarray, " f"], values: Complex[np.ndarray, "f input"]
) -> tuple[Float[np.ndarray, " cross"], Float[np.ndarray, " cross"], Float[np.ndarray, " cross"]]:
    """Return where eigenvalues cross the negative real axis, upward (1) or down, and when (Hz).

    Beyond both ends of the frequencies they go on as their complex conjugates; what integrates
    comes from infinity at the lower end.
    """
    start, end = values[0], values[-1]
    integrates = np.abs(start.imag) > np.abs(start.real)
    before = np.where(integrates, start, start.conj())
    values = np.concatenate([before[None], values, end.conj()[None]])
    rise, crosses = np.diff(values.imag, axis=0), np.diff(np.sign(values.imag), axis=0) != 0
    share = np.where(crosses, -values.imag[:-1] / np.where(rise == 0, 1.0, rise), 0.0)
    real = values.real[:-1] + share * np.diff(values.real, axis=0)
    crosses &= real < 0
    around = np.concatenate([frequency[:1], frequency, frequency[-1:]])[:, None]
    when = around[:-1] + share * np.diff(around, axis=0)
    return real[crosses], np.sign(rise[crosses]), when[crosses]


def _followed(values: Complex[np.ndarray, "f input"]) -> Complex[np.ndarray, "f input"]:
    """Order the eigenvalues at each frequency so that each goes on from where it was."""
    from scipy.optimize import linear_sum_assignment  # slow to load

    ordered = values.copy()
    for index in range(1, values.shape[0]):
        away = np.abs(ordered[index - 1][:, None] - values[index][None, :])
        order = away.argmin(axis=1)
        if len(set(order)) < order.size:
            order = linear_sum_assignment(away)[1]
        ordered[index] = values[index][order]
    return ordered


def _frequencies(resonances: Float[np.ndarray, " mode"], highest: float) -> Float[np.ndarray, " f"]:
    """Return where to look: evenly by octaves, and closely around resonances."""
    slow = resonances[resonances > 0]
    lowest = 0.02 * min([*slow, highest])
    grid = np.geomspace(lowest, highest, _GRID)
    close = [f + around(INDENTED * f, _WIDEST * f) for f in slow if f < highest / (1 + _WIDEST)]
    return np.unique(np.concatenate([grid, *close]))


def around(width: float, widest: float) -> Float[np.ndarray, " apart"]:
    """Return distances from a resonance at which a peak of half-width ``width`` is resolved."""
    apart = np.geomspace(width / 4, widest, 2 + round(math.log(4 * widest / width, _APART)))
    return np.concatenate([-apart[::-1], [0.0], apart])


def _controller(controller: Pid, grid: Inexact[np.ndarray, " f"]) -> np.ndarray:
    """Return what each input commands for its error, as `crinoid.control.Pid` computes it."""
    period = float(controller.period)
    back = np.exp(-2j * np.pi * grid * period)[:, None]  # one command earlier
    lag = np.asarray(controller.filter_time)
    slope = (1 - back) / (lag + period - lag * back)
    integral = np.asarray(controller.ki) * period / (1 - back)
    return np.asarray(controller.kp) + integral + np.asarray(controller.kd) * slope


def age(sensor: Sensor, period: float, time_step: float) -> float:
    """Return how old the newest reading is on average when a command is given (s)."""

    def ticks(every: float, count: int) -> Float[np.ndarray, " tick"]:
        return np.ceil(np.arange(count) * every / time_step - 1e-6) * time_step

    every, delay = float(sensor.clock.period), float(sensor.delay)
    given = ticks(period, _TICKS)
    given = given[given >= min(delay + every, given[-1])]
    taken = ticks(every, math.ceil(given[-1] / every) + 2)
    newest = np.searchsorted(taken, given - delay + 1e-6 * every, side="right") - 1
    return float(np.mean(given - taken[newest]))


def loop_warnings(loop: OpenLoop, gains: dict[str, PidGains]) -> list[str]:
    """Return a sentence if a loop is unstable or close to it; ``gains`` of each driven input."""
    margin = loop.margin()
    if margin.stable and margin.modulus >= ROBUST:
        return []
    where = f" in {loop.weakest}" if len(loop.waters) > 1 else ""
    if margin.stable:
        state = (
            f"small motions near {margin.frequency:.2g} Hz hardly die down{where} (modulus margin "
            f"{margin.modulus:.2g})"
        )
        if np.isfinite(margin.gain):
            state += f", and with {margin.gain:.3g} times all gains they grow"
    elif margin.frequency:
        state = f"small motions grow by themselves{where}, near {margin.frequency:.2g} Hz"
    else:
        state = "the tip runs away from its target"
    names = list(gains)
    for name, given in gains.items():
        if min(given.kp, given.ki, given.kd) < 0:
            got = f"control.pid.{name}: got {_gains(given)}"
            return [f"{got}; {state} (by the linear loop); is the sign right?"]
    alone = {name: factor_for(loop, _WANTED, np.array(names) == name) for name in names}
    blamed, factor = max(alone.items(), key=lambda item: item[1])
    if factor:
        got = _gains(gains[blamed])
        return [
            f"control.pid.{blamed}: got {got}; {state} (by the linear loop); these three times "
            f"{factor:.2g} leave a margin"
        ]
    together = factor_for(loop, _WANTED)
    cure = "with smaller ones too"
    if together:
        cure = f"all gains times {together:.2g} leave a margin"
    got = "; ".join(f"{name} {_gains(given)}" for name, given in gains.items())
    return [f"control.pid: got {got}; {state} (by the linear loop); {cure}"]


def factor_for(
    loop: OpenLoop, modulus: float, which: Bool[np.ndarray, " input"] | bool = True
) -> float:
    """Return the largest factor on the gains of inputs ``which`` that leaves a margin; 0: none."""
    inputs = np.broadcast_to(which, loop.transfer.shape[-1:])
    for factor in _FACTORS:
        margin = loop.scaled(np.where(inputs, factor, 1.0)).margin()
        if margin.stable and margin.modulus >= modulus:
            return float(factor)
    return 0.0


def _gains(given: PidGains) -> str:
    return f"kp = {given.kp:g}, ki = {given.ki:g}, kd = {given.kd:g}"
