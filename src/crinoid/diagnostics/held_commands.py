"""Load of commands that are held between two control instants, and whether steps resolve it."""

import math

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.assembly.facts import Facts
from crinoid.dynamics import System
from crinoid.foundation.axes import ANGLES
from crinoid.scenario import percent

_RESOLVED = 16  # time steps between two commands that resolve the load to 10 %
_LARGE = 0.25  # share of the force on the base above which it deserves a note


def command_jumps(dataset: xr.Dataset, system: System, facts: Facts) -> Float[np.ndarray, " time"]:
    """Return by how much the commands make the arm's acceleration jump (m/s2)."""
    turns = np.isin(dataset["channel"].values, ANGLES)
    return np.sum(_jumps(dataset, system, facts) * np.where(turns, facts.length, 1.0), axis=1)


def _jumps(dataset: xr.Dataset, system: System, facts: Facts) -> Float[np.ndarray, "time channel"]:
    """Return by how much commands make the acceleration of a servo jump (m/s2 or rad/s2).

    A servo is a second-order follower of natural frequency n: a command that changes by c makes its
    acceleration jump by ``n^2 c``. Between saved instants commands are taken to change evenly.
    """
    command, time = dataset["base_command"].values, dataset["time"].values
    if time.size < 2:
        return np.zeros_like(command)
    apart = np.diff(time, prepend=2 * time[0] - time[1])[:, None]
    changes = np.abs(np.diff(command, axis=0, prepend=command[:1]))
    changes *= np.minimum(1 / (facts.scenario.control_rate_hz * apart), 1.0)
    servo = system.base.servo
    most = 2 * np.asarray(servo.max_acceleration)
    return np.minimum(np.asarray(servo.natural) ** 2 * changes, most)


def held_commands_note(dataset: xr.Dataset, system: System, facts: Facts) -> str:
    """Return a note where time steps do not resolve the force of held commands, or none.

    Between two commands the acceleration falls as far as it jumps, so its RMS is the jump over
    sqrt(12). What follows at that rate is the arm near the root only, as far as a wave of stretch
    or of bending comes in the period: for stretch ``m c / w`` with its speed c, for bending
    ``sqrt(2) m / k`` with its wave number k, both of a damped rod. A shift moves the mean of both.
    """
    scenario, step = facts.scenario, facts.scenario.simulation.time_step
    period = 1 / scenario.control_rate_hz
    fine = step * _RESOLVED <= period * (1 + 1e-9)
    if fine or not scenario.control.acts or dataset.sizes["time"] < 2:
        return ""
    rate, length = 2 * math.pi / period, facts.length
    stiffer = abs(facts.modulus(rate))
    mass, swung = float(facts.mass[0]), float(facts.swung[0])
    deep = math.sqrt(facts.stretching * stiffer / mass) / rate
    bend = (float(facts.bending.max()) * stiffer / (swung * rate**2)) ** 0.25
    along, across = mass * min(deep, length), swung * min(math.sqrt(2) * bend, length)
    turns = np.isin(dataset["channel"].values, ANGLES)
    follows = np.where(turns, swung * min(bend, length) ** 2, 0.5 * (along + across))
    late = slice(dataset.sizes["time"] // 2, None)
    jumps = _jumps(dataset, system, facts)[late]
    # dense instants have a command in some of them only
    often = max(1.0, period / float(np.median(np.diff(dataset["time"]))))
    push = float(np.sqrt(np.mean(np.sum((follows * jumps) ** 2, axis=1)) * often / 12))
    force = float(np.sqrt(np.mean(np.sum(dataset["base_force"].values[late] ** 2, axis=1))))
    if push <= _LARGE * force or not force > 0:
        return ""
    return (
        f"the force on the base is not resolved: held for {period:g} s, commands make the base's "
        f"acceleration jump, which adds about {push:.2g} N RMS, {percent(push / force)} of the "
        f"force. Try simulation.time_step = {period / _RESOLVED:.3g}, or lower bandwidths "
        "(base.channels.*.bandwidth_hz)."
    )
