"""Analyses of a scenario without a run in time: its current, vibrations and stability margins."""

from itertools import chain
from pathlib import Path

import numpy as np
import xarray as xr
from rich.table import Table

from crinoid.analysis.current import FLOW, current_statistics, sample_current
from crinoid.analysis.curve import Curve
from crinoid.analysis.equilibria import CURVE, curve_table, find_equilibria
from crinoid.analysis.margins import MARGINS, find_margins
from crinoid.analysis.vibrations import MODES, find_vibrations
from crinoid.assembly.prepared import Prepared
from crinoid.cli.command import console
from crinoid.cli.display import new_table, progress_bar, say_notes, statistics_table
from crinoid.cli.finding import finding
from crinoid.cli.interruption import Interruption
from crinoid.diagnostics.plausibility import IN_THE_WATER, plausibility_warnings
from crinoid.foundation.status import Status
from crinoid.recording import Recording
from crinoid.results.units import DEGREES, SLOWEST, no_swing, si_unit
from crinoid.scenario import Scenario
from crinoid.scenario.scenario import AT_REST


def show_current(scenario: Scenario, folder: Path, *, force: bool) -> None:
    """Sample the current of a scenario at its arm, save and draw it, and sum it up."""
    if not scenario.flow and not scenario.vary:
        console.print("still water: the scenario has no [[flow]]")
        return
    with finding(
        scenario, folder / FLOW, "a current", force=force, check=Prepared.notes, doubts=IN_THE_WATER
    ) as found:
        data = sample_current(found.prepared)
        recordings = found.prepared.recordings.items()
        lines = [f"flow.{index}: {_described(recording)}" for index, recording in recordings]
        for index, sea in found.prepared.seas.items():
            console.print(_sea_table(data[f"sea_{index}_statistics"], sea.name))
        found.show(data, _current_table(data), lines=lines)


def _current_table(data: xr.Dataset) -> Table:
    time = data["time"].values
    late = time >= data.attrs["settled"] - 1e-9
    axes, places = data["axis"].values.tolist(), data["place"].values.tolist()
    begin, end = time[late][[0, -1]]
    heads = (f"{begin:g} to {end:g} s", *(f"at the {place}" for place in places))
    velocities = (data["flow_velocity"].sel(place=place).values[late] for place in places)
    columns = [current_statistics(each, time[1] - time[0], axes) for each in velocities]
    return statistics_table(data.attrs["title"], heads, columns)


def _sea_table(statistics: xr.DataArray, name: str) -> Table:
    names, (of_file, of_sum) = statistics["statistic"].values.tolist(), statistics.values
    columns = [dict(zip(names, values, strict=True)) for values in (of_file, of_sum)]
    return statistics_table(name, ("waves", *statistics["source"].values.tolist()), columns)


def _described(recording: Recording) -> str:
    text = (
        f"{recording.name}, {recording.length:.6g} s at {1 / recording.interval:.6g} Hz, "
        f"{recording.time.size} samples"
    )
    if recording.levels is None:
        text += " at one place"
    else:
        low, high = recording.levels[[0, -1]]
        text += f" at {recording.levels.size} levels from z = {low:.4g} to {high:.4g} m"
    if recording.time_scale != 1:
        text += f"; a second of it lasts {recording.time_scale:g} s"
    text += f"; the run begins {recording.start:.4g} s into it"
    distance = float(np.linalg.norm(recording.slowness))
    if distance > 0:
        how = "is carried past the arm" if recording.carried else "travels past it"
        text += f" and it {how} at {1 / distance:.3g} m/s"
    return text


def show_modes(scenario: Scenario, folder: Path, *, count: int, in_air: bool, force: bool) -> str:
    """Find the modes of a scenario, save, draw and print them; return the failure, if any."""
    with finding(scenario, folder / MODES, "a mode", force=force, doubts=AT_REST) as found:
        with console.status("looking for equilibria and modes"):
            data, trouble = find_vibrations(found.prepared, count=count, in_air=in_air)
        if data is None:
            return trouble
        lines = [f"{medium}: {_rest(data.sel(medium=medium))}" for medium in data.medium.values]
        if "lock_in_speed" in data:
            lines += [f"vortices lock in {_lock_in(data)}"]
        return found.show(data, _modes_table(data), lines=lines)


def _modes_table(data: xr.Dataset) -> Table:
    heads = ["mode"]
    for medium in data["medium"].values:
        heads += [f"{medium}\n(Hz)", "damping\nratio"]
    # by mode, medium and quantity
    quantities = (data[name] for name in ("frequency", "damping_ratio"))
    numbers = np.stack([each.transpose("mode", "medium").values for each in quantities], axis=-1)
    rows = [
        (str(mode), *(text for found in row for text in _swing(*found)))
        for mode, row in zip(data["mode"].values, numbers, strict=True)
    ]
    table = new_table(data.attrs["title"], heads, rows)
    table.columns[0].justify = "right"
    return table


def _swing(frequency: float, ratio: float) -> tuple[str, str]:
    """Return the texts of a mode in one medium: frequency and damping ratio."""
    if np.isnan(frequency):
        return "-", "-"
    damping = "-" if np.isnan(ratio) else f"{0.0 if abs(ratio) < 1e-6 else ratio:.4g}"
    return f"{frequency:.4g}" if frequency > SLOWEST else no_swing(ratio), damping


def _lock_in(data: xr.Dataset) -> str:
    """Return the speeds of a current that lock in to each bending mode that oscillates."""
    ends = data["lock_in_speed"].transpose("mode", "end")
    swings = ends[np.isfinite(ends.isel(end=0))]
    texts = (
        f"{low:.2g} to {high:.2g} m/s (mode {mode})"
        for mode, (low, high) in zip(swings["mode"].values, swings.values, strict=True)
    )
    speeds = ", ".join(texts)
    none = "to none: no bending mode oscillates"
    return f"where the flow across the arm is {speeds}" if speeds else none


def _rest(data: xr.Dataset) -> str:
    """Return where the tip rests in a medium, and in which current."""

    def parts(vector: np.ndarray, digits: int) -> str:
        named = zip(data["axis"].values, vector + 0.0, strict=True)
        return ", ".join(f"{axis} {part:.{digits}f}" for axis, part in named)

    text = f"the tip rests at {parts(data['position'].values[-1].round(4), 4)} m"
    current = data["current"].values
    return f"{text} in water of {parts(current, 3)} m/s" if current.any() else text


def show_equilibria(scenario: Scenario, curve: Curve, folder: Path, *, force: bool) -> str:
    """Follow the equilibrium over a number, save, draw and print it; return what went wrong."""
    path, others = folder / CURVE, [_TABLE]
    with (
        finding(
            scenario, path, "a curve", force=force, others=others, check=None, doubts=None
        ) as found,
        Interruption() as interruption,
    ):
        ends = (plausibility_warnings(curve.cases[end], AT_REST) for end in (0, -1))
        say_notes(dict.fromkeys(chain(*ends)))
        with progress_bar() as bar:

            def report(done: int, total: int) -> None:
                bar.update(bar.task_ids[0], completed=done, total=total, description="equilibria")

            data = find_equilibria(curve, stop=interruption.stop, report=report)
        return found.show(data, _curve_table(data), files={_TABLE: curve_table(data)})


_TABLE = "curve.csv"
_MOST_ROWS = 26


def _curve_table(data: xr.Dataset) -> Table:
    """Return equilibria, of many some at equal distances; angles are in degrees."""
    key = data.attrs["varied"]
    unit = data[key].attrs["units"]
    count = data.sizes[key]
    chosen = [*range(0, count - 1, -(-count // _MOST_ROWS)), count - 1]
    axes = [f"tip {axis} (m)" for axis in data["axis"].values]
    heads = (f"{key} ({unit})" if unit else key, *axes, "turn (deg)", "curvature (1/m)")
    rows = []
    for branch in data["branch"].values:
        back = branch != data["branch"].values[0]
        for place in reversed(chosen) if back else chosen:
            row = data.sel(branch=branch).isel({key: place})
            turn, curvature = np.rad2deg(float(row["tip_turn"])), float(row["max_curvature"])
            numbers = [f"{each:.5f}" for each in row["tip_position"].values.round(5) + 0.0]
            numbers += [f"{round(turn, 3) + 0.0:.3f}", f"{round(curvature, 4) + 0.0:.4g}"]
            found = Status.of(row["status"].item())
            if found is Status.INTERRUPTED:
                continue
            if found is Status.FAILED:
                numbers = [*["-"] * len(axes), "-", str(found)]
            rows.append((f"{float(row[key]):.6g}" + " back" * back, *numbers))
    return new_table(data.attrs["title"], heads, rows)


def show_margins(scenario: Scenario, folder: Path, *, force: bool) -> None:
    """Find the stability margins of a scenario's loop, save, draw and print them."""
    with finding(scenario, folder / MARGINS, "a margin", force=force) as found:
        with console.status("linearising the loop"):
            data = find_margins(found.prepared)
        found.show(data, _margins_table(data))


def _margins_table(data: xr.Dataset) -> Table:
    stable = bool(data["stable"])
    gain, least = float(data["gain_margin"]), float(data["least_gain"])
    phase, delay = float(data["phase_margin"]), float(data["delay_margin"])
    seconds = si_unit(delay if np.isfinite(delay) else 1.0, "s")

    def row(name: str, text: str) -> tuple[str, str, str]:
        at = float(data[f"{name}_margin_frequency"])
        return name, text, f"{at:.3g} Hz" if np.isfinite(at) else ""

    rows = [row("gain", _decibels(gain) if stable else "none")]
    if least:
        rows.append(("least gain", _decibels(least), ""))
    rows += [
        row("phase", DEGREES.text(phase) if stable else "none"),
        row("delay", seconds.text(delay) if stable else "none"),
        row("modulus", f"{float(data['modulus_margin']):.3g}"),
    ]
    distance = np.hypot(1 + data["locus_real"], data["locus_imaginary"])
    waters = dict.fromkeys(data["water"].values.tolist())
    for water in waters if len(waters) > 1 else ():
        nearest = float(distance[:, data["water"].values == water].min())
        rows.append((f"modulus, {water}", f"{nearest:.3g}", ""))
    rows.append(("closed loop", "stable" if stable else f"unstable in {data.attrs['water']}", ""))
    return new_table(data.attrs["title"], ("", "margin", "at"), rows)


def _decibels(gain: float) -> str:
    return f"{gain:.3g} ({20 * np.log10(gain):.3g} dB)"
