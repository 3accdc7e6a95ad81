"""The folder of a sweep: its plan, a file for each finished batch, and the study of all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float, Int

from crinoid.foundation.atomic_file import atomic_write, remove_unfinished
from crinoid.foundation.text_variables import text_encoding
from crinoid.results.dataset import describe
from crinoid.results.metrics import CASES, Measures, measures_of, write_rows
from crinoid.simulation.batch import Arm
from crinoid.studies.design import SEED
from crinoid.studies.measures import measures_dataset, tabulated
from crinoid.studies.statistics import MEANS, records
from crinoid.studies.sweep.long_term import EXTREMES, extremes_of, over_all_time
from crinoid.studies.sweep.plan import PLAN, Batch, SweepDesign


def _numbered(runs: Int[np.ndarray, " run"]) -> tuple[str, np.ndarray, dict[str, str]]:
    return "run", runs, {"long_name": "number of the run"}


def _tables(
    part: xr.Dataset, registry: Iterable[str]
) -> tuple[pd.DataFrame, pd.DataFrame, dict[str, str]]:
    """Return measures and status of each run of a batch, its effort, and the units of inputs."""
    units = dict(zip(part["input"].values, part["input_unit"].values, strict=True))
    return part[[*registry, "status"]].to_dataframe(), part["effort"].to_pandas(), units


def _assemble(plan: SweepDesign, parts: Iterator[xr.Dataset]) -> xr.Dataset:
    """Return all runs of a plan in order, with their values, from the datasets of its batches."""
    registry = measures_of(plan.scenario)
    tables, speeds, of_inputs = zip(*(_tables(part, registry) for part in parts), strict=True)
    units = {name: unit for found in of_inputs for name, unit in found.items()}
    table, speed = pd.concat(tables).sort_index(), pd.concat(speeds).sort_index()
    inputs = sorted(units, key=lambda name: (speed[name].first_valid_index(), name))
    data = measures_dataset(
        ("run",),
        {name: table[name].to_numpy() for name in registry},
        registry,
        speed[inputs].to_numpy(float),
        {name: units[name] for name in inputs},
        table["status"].to_numpy(object),
    )
    found = plan.coordinates() | {"run": _numbered(table.index.to_numpy())}
    ordered = {name: found[name] for name in dict.fromkeys((*plan.keys, "run", SEED))}
    about = describe(plan.scenario) | {"plan": plan.to_toml()}
    return data.assign_coords(ordered).assign_attrs(about)


def _write(path: Path, data: xr.Dataset) -> None:
    with atomic_write(path) as temporary:
        data.to_netcdf(temporary, engine="netcdf4", encoding=text_encoding(data))


_BATCHES = "batches"
_STUDY = "study.nc"


class SweepStore:
    """Files of a sweep in its folder.

    Each is written under another name and renamed once it is complete. All methods
    raise `OSError` if a file cannot be read or written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def files(self) -> list[str]:
        """Return the names of the files of a sweep or of another study that are there."""
        names = (PLAN, _BATCHES, _STUDY, CASES, MEANS, EXTREMES)
        return [name for name in names if (self.folder / name).exists()]

    def start(self, plan: SweepDesign) -> None:
        """Write the plan, and remove all files of another sweep."""
        self._remove_study()
        for path in (self.folder / _BATCHES).glob("*.nc"):
            path.unlink()
        (self.folder / PLAN).unlink(missing_ok=True)
        (self.folder / _BATCHES).mkdir(exist_ok=True)
        with atomic_write(self.folder / PLAN) as temporary:
            temporary.write_text(plan.to_toml(), "utf-8")

    def tidy(self) -> None:
        """Remove unfinished files of a sweep that was killed."""
        for name in (PLAN, CASES, MEANS, EXTREMES, _STUDY, f"{_BATCHES}/*.nc"):
            remove_unfinished(self.folder / name)

    def finished(self, plan: SweepDesign) -> set[int]:
        """Return the numbers of the batches whose files are complete and of these runs."""
        found, registry = set(), measures_of(plan.scenario)
        for number, batch in enumerate(plan.batches):
            if not self._path(number).exists():
                continue
            with suppress(Exception):  # a file that is damaged makes its readers raise anything
                part = xr.load_dataset(self._path(number), engine="netcdf4")
                table, effort, _ = _tables(part, registry)
                kinds = {each.kind for each in (*table[[*registry]].dtypes, *effort.dtypes)}
                if np.array_equal(table.index, batch.runs) and kinds <= {"f"}:
                    found.add(number)
        return found

    def save(
        self, plan: SweepDesign, number: int, batch: Batch, arms: Sequence[Arm[Measures]]
    ) -> None:
        """Write a batch."""
        status, found = np.array([arm.status for arm in arms], object), [arm.taken for arm in arms]
        data = tabulated(("run",), found, status, measures_of(plan.scenario))
        data = data.assign_coords(run=_numbered(batch.runs))
        _write(self._path(number), data)

    def collect(
        self, plan: SweepDesign, shares: Float[np.ndarray, " run"] | None = None
    ) -> tuple[xr.Dataset, list[Path]]:
        """Write the study of all batches; return its dataset and files.

        With the ``shares`` of time of the runs it has statistics `over_all_time`.
        """
        paths = map(self._path, range(len(plan.batches)))
        data = _assemble(plan, (xr.load_dataset(path, engine="netcdf4") for path in paths))
        if shares is not None:
            data = over_all_time(data, plan, shares)
        self._remove_study()
        path = self.folder / _STUDY
        _write(path, data)
        registry = measures_of(plan.scenario)
        columns = data[[*registry, "status"]].reset_coords(drop=True)
        rows = enumerate(records(columns.to_dataframe()), start=1)
        cases = (plan.row(run, row, row.pop("status"), plan.name(run)) for run, row in rows)
        write_rows(self.folder / CASES, cases)
        written = [path, self.folder / CASES]
        if extremes := extremes_of(data):
            table = extremes.to_array("measure").to_dataset("estimate").to_dataframe().reset_index()
            table.insert(1, "units", [registry[name].unit for name in table["measure"]])
            written.append(self.folder / EXTREMES)
            write_rows(written[-1], records(table))
        return data, written

    def _remove_study(self) -> None:
        for name in (_STUDY, CASES, MEANS, EXTREMES):
            (self.folder / name).unlink(missing_ok=True)

    def _path(self, number: int) -> Path:
        return self.folder / _BATCHES / f"{number:05d}.nc"
