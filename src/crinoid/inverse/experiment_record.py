"""Records of experiments: motions of tip and markers with commands, holds, and their checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from crinoid.actuation import Input
from crinoid.foundation.axes import AXES, POSE
from crinoid.inverse import logs
from crinoid.inverse.marker import TIP, Marker
from crinoid.recording.numbers import Column, labels_of
from crinoid.recording.readers import read_dataset
from crinoid.recording.series import values_in
from crinoid.recording.texts import listed
from crinoid.results.result import Result
from crinoid.scenario import Scenario, counted, got, one_of, refusal
from crinoid.scenario.actuator import Tendon

LOST = 0.25  # largest share of the rows that may be set aside as lost markers
_REACH = 1.25  # largest distance of a record from the root, over the arm's length in the run
_STUCK = 0.02
"""Path of the tip in the run, over the arm's length, along which a resting marker is stuck."""
_CLEARLY = 0.2
"""Largest distance of another reading from the run, over that of the record and the length."""

Places = Float[np.ndarray, "time axis"]


class Holds(NamedTuple):
    """Static holds: the arm at rest, each under constant shares of its threads."""

    names: tuple[str, ...]
    of_row: Int[np.ndarray, " time"]  # hold of each row
    threads: tuple[int, ...]  # chambers and tendons of given shares; the others have those of t = 0
    shares: Float[np.ndarray, "hold thread"]


@dataclass(frozen=True)
class ExperimentRecord:
    """Measured motion of the tip and of markers, or their places in static holds."""

    time: Float[np.ndarray, " time"]
    """Times (s) since the start of the run, increasing for each marker; 0 of a hold."""
    names: tuple[str, ...]  # measured coordinates (`crinoid.foundation.axes.POSE`)
    values: Float[np.ndarray, "time quantity"]
    """Values of the coordinates in the world (m; rad; components of a unit vector)."""
    commands: logs.Commands | None
    """Commands of all inputs (m, rad, or in their units); None without recorded ones."""
    notes: tuple[str, ...] = ()  # notes on assumptions and omitted rows
    markers: tuple[Marker, ...] = ()
    of_row: Int[np.ndarray, " time"] | None = None
    """Marker of each row, counted from 1; 0 is the tip, as in all rows with None."""
    holds: Holds | None = None
    name: str = ""  # name of the experiment, if there are several
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Values of the scenario in this experiment, by key."""

    @property
    def marker(self) -> Int[np.ndarray, " time"]:
        """Marker of each row, counted from 1; 0 is the tip."""
        return np.zeros(self.time.size, int) if self.of_row is None else self.of_row

    def rows(self, chosen: Bool[np.ndarray, " time"]) -> ExperimentRecord:
        """Return the record of some of its rows."""
        holds = self.holds and self.holds._replace(of_row=self.holds.of_row[chosen])
        cut = {"time": self.time[chosen], "of_row": self.marker[chosen]}
        return replace(self, values=self.values[chosen], holds=holds, **cut)


def read_record(
    path: Path, scenario: Scenario, inputs: Sequence[Input], markers: tuple[Marker, ...] = ()
) -> ExperimentRecord:
    """Read a record: a table, or the sensor readings in a result.

    A table is a CSV or netCDF file with a column ``time`` or ``hold``, some of
    `crinoid.foundation.axes.POSE`, and some of the names of the inputs. A column ``marker`` names
    the tip or one of the ``markers``. A result is given by its folder or its ``result.nc``.
    """
    with logs.record_errors():
        if folder := logs.result_folder(path):
            return _of_result(folder, scenario, inputs)
        return _of_table(str(path), scenario, inputs, markers)


def _of_table(
    file: str, scenario: Scenario, inputs: Sequence[Input], markers: tuple[Marker, ...]
) -> ExperimentRecord:
    axes = scenario.arm.dimension
    columns = [
        logs.column_of(name, "rad" if name == "angle" else "m") for name in POSE[axes][:axes]
    ]
    columns += [logs.column_of(name, "rad" if axes == 2 else "1") for name in POSE[axes][axes:]]
    log = logs.LogTable(file, columns, inputs, of_marker=len(AXES[axes]), holds=True)
    places = {TIP: 0} | {marker.name: k for k, marker in enumerate(markers, start=1)}
    for label in log.labels or ():
        if label not in places:
            must = f"be {one_of(places)}"
            raise refusal(logs.MARKER, got(label, must, "A [[marker]] describes another one."))
    if log.along == logs.HOLD:
        return replace(_of_holds(log, scenario, places), markers=markers)
    tracks = {None: 0} if log.labels is None else {label: places[label] for label in log.labels}
    motions = [log.series(log.measured, label) for label in tracks]
    time = np.concatenate([motion.time for motion in motions])
    order = np.argsort(time, kind="stable")
    values = np.concatenate([motion.values for motion in motions])[order]
    of_row = np.repeat(list(tracks.values()), [motion.time.size for motion in motions])[order]
    commands, parts = log.commands([*tracks])
    notes = dict.fromkeys(note for each in (*motions, *parts) for note in each.notes)
    names, every = tuple(column.name for column in log.measured), (*notes, *log.not_read(()))
    return _after_start(
        ExperimentRecord(time[order], names, values, commands, every, markers, of_row)
    )


def _of_holds(
    log: logs.LogTable, scenario: Scenario, places: Mapping[str, int]
) -> ExperimentRecord:
    """Return the holds in a table, with a row for each marker in each hold."""
    driven = {}
    for name, thread in scenario.threads.items():
        unit = "N" if isinstance(thread, Tendon) else "Pa"
        factors = {"1": 1.0} if thread.lined else {"1": 1.0, unit: 1 / thread.largest}
        driven[name] = Column(name, name, factors.get, "1", logs.LARGEST)
    known = (logs.HOLD, logs.MARKER, *(column.name for column in log.measured), *driven)
    with read_dataset(log.file) as dataset:
        for name in log.names:
            if name not in known and name not in dataset.dims:
                others = listed([*POSE[scenario.arm.dimension], *driven])
                must = f"be {logs.HOLD}, {logs.MARKER} or one of {others}"
                raise refusal("file", f"has a column {name}", must)
        played = [column for name, column in driven.items() if name in log.names]
        remarks: list[str] = []
        clock = dataset[logs.HOLD]
        values = values_in(dataset, log.measured, clock, log.file, remarks)
        shares = values_in(dataset, played, clock, log.file, remarks)
        labels = np.array(labels_of(clock))
    _, first, holds = np.unique(labels, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))  # in the order of the file
    first, holds = np.sort(first), order[holds]
    for row, column in np.argwhere(~(shares == shares[first][holds])):  # nor is a gap equal
        one, other = shares[row, column], shares[first[holds[row]], column]
        text = f"{played[column].name} is {one:.6g} and {other:.6g} in hold {labels[row]}"
        raise refusal(logs.HOLD, text, "be the same number in all rows of a hold")
    there = np.isfinite(values).all(axis=1)
    if not there.all():
        remarks.append(f"{counted(int((~there).sum()), 'row')} without a value are left out")
    found = Holds(
        tuple(map(str, labels[first])),
        holds,
        tuple(list(driven).index(column.name) for column in played),
        shares[first],
    )
    names, rows = tuple(column.name for column in log.measured), [0] * holds.size
    of_row = np.array(rows if log.labels is None else [places[label] for label in log.labels])
    record = ExperimentRecord(
        np.zeros(holds.size), names, values, None, tuple(remarks), of_row=of_row, holds=found
    )
    return record.rows(there)


def _after_start(record: ExperimentRecord) -> ExperimentRecord:
    """Remove rows before the start of the run, and refuse a record without later rows."""
    if record.time[-1] <= 0:
        text = f"ends at {record.time[-1]:.6g} s of the run; must have times after 0"
        raise refusal("file", text)
    after = record.time >= 0
    if after.all():
        return record
    note = f"{int((~after).sum())} rows before the start of the run are left out"
    return replace(record.rows(after), notes=(*record.notes, note))


def _of_result(folder: Path, scenario: Scenario, inputs: Sequence[Input]) -> ExperimentRecord:
    """Return the readings of the tip in a result, at the times of their measurement."""
    result = Result.load(folder)
    data, axes = result.dataset, result.scenario.arm.dimension
    if axes != scenario.arm.dimension:
        text = f"{folder}: the arm has {axes} axes; must have {scenario.arm.dimension}"
        raise refusal("file", text)
    scenario = result.scenario
    there = {str(name) for name in data["reading"].values}
    names = tuple(name for name in POSE[axes] if f"tip.{name}" in there)
    times, values = logs.readings_of(result, scenario.sensor, [f"tip.{name}" for name in names])
    if times.size < 2:
        text = f"{folder}: the run has {times.size} readings of the tip; must have at least 2"
        raise refusal("file", text)
    return ExperimentRecord(times, names, values, logs.commands_of(result, inputs))


def within_reach(
    subject: str, names: Sequence[str], measured: Places, root: Places, tip: Places, length: float
) -> tuple[Bool[np.ndarray, " time"], list[str]]:
    """Return the rows that the arm can reach, and a note if the record fits in another reading.

    Places (m) of the ``subject`` have the axes ``names``. Root and ``tip`` are those of a run whose
    arm is at most ``length`` (m) long.
    """
    inside = np.linalg.norm(measured - root, axis=1) <= _REACH * length
    turned = np.where(np.array(names) == "z", -1.0, 1.0) * measured
    frames: list[tuple[str, Places, Places | float]] = [
        ("all else is right", measured, 0.0),
        ("positions are measured from the base", measured, root),
        ("heights are positive down", turned, 0.0),
        ("positions are measured from the base, positive down", turned, root),
        ("axes are swapped", np.hstack([measured[:, :-2], measured[:, :-3:-1]]), 0.0),
    ]
    frames += [(f"lengths are in mm; {words}", 1e-3 * each, at) for words, each, at in frames]
    distances = [np.median(np.linalg.norm(at + each - tip, axis=1)) for _, each, at in frames]
    best = int(np.argmin(distances))
    near = distances[best] < _CLEARLY * min(distances[0], length)
    hint = f"Likely cause: {frames[best][0]}." if near else ""
    where = _ranges(names, measured)
    if inside.mean() < 1 - LOST:
        must = f"lie within {_REACH * length:.3g} m of the root at {_ranges(names, root)}"
        hint = hint or "Check units, origin, axes and the sign of z."
        raise refusal("RECORD", f"got {subject} at {where}", must, hint)
    note = f"the record has {subject} at {where}, the run at {_ranges(names, tip)}. {hint}"
    return inside, [note] if hint and distances[0] > _STUCK * length else []


def stuck(measured: Places, tip: Places, length: float) -> Bool[np.ndarray, " time"]:
    """Return the rows of a marker that rests while the tip (m) of the fit moves.

    ``length`` (m) is that of the arm.
    """
    same = np.all(np.diff(measured, axis=0) == 0, axis=1)
    starts = np.flatnonzero(np.append(True, ~same))
    path = np.maximum.reduceat(tip, starts) - np.minimum.reduceat(tip, starts)
    return np.repeat(path.max(axis=1) > _STUCK * length, np.diff(starts, append=len(tip)))


def _ranges(names: Sequence[str], places: Places) -> str:
    ends = zip(names, places.min(axis=0), places.max(axis=0), strict=True)
    return ", ".join(f"{name} = {low:.4g} to {high:.4g} m" for name, low, high in ends)
