"""The folder of a sweep: its plan, a file for each finished batch, and the study made of them."""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import netCDF4
import numpy as np
import xarray as xr

from crinoid.cases import CASES, write_rows
from crinoid.replacement import remove_unfinished, replacing
from crinoid.scenario import Mistake, ScenarioError
from crinoid.sweep.plan import Batch, Plan
from crinoid.sweep.table import assemble, case_rows, tabulate
from crinoid.sweep.work import Row

__all__ = ["PLAN", "SweepStore", "has_zarr"]

PLAN, _BATCHES = "plan.toml", "batches"
_ZARR, _NETCDF = "study.zarr", "study.nc"
_DIGITS = 5


def has_zarr() -> bool:
    """Tell whether Zarr is installed."""
    try:
        import zarr  # noqa: F401
    except ImportError:
        return False
    return True


class SweepStore:
    """Files of a sweep.

    Every one but the study itself is written under another name and renamed once it is complete:
    what is there is whole. All methods raise `OSError` if a file cannot be read or written.

    Parameters
    ----------
    folder
        Where they are.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def holds(self) -> list[str]:
        """Return the names of what is there of a sweep or of another study."""
        names = (PLAN, _BATCHES, _ZARR, _NETCDF, CASES)
        return [name for name in names if (self.folder / name).exists()]

    def read_plan(self) -> Plan:
        """Read the plan."""
        path = self.folder / PLAN
        try:
            return Plan.from_toml(path.read_text("utf-8"))
        except FileNotFoundError:
            text = "there is none; takes the folder of a sweep"
        except ScenarioError as error:
            text = error.lines[0]
        except (UnicodeDecodeError, KeyError, TypeError, AttributeError) as error:
            text = f"not the plan of a sweep ({error})"
        raise ScenarioError([Mistake(str(path), text)])

    def begin(self, plan: Plan) -> None:
        """Write the plan, in place of all that there is of a sweep."""
        self.clear()
        (self.folder / _BATCHES).mkdir(exist_ok=True)
        with replacing(self.folder / PLAN) as temporary:
            temporary.write_text(plan.to_toml(), "utf-8")

    def clear(self) -> None:
        """Remove all that there is of a sweep."""
        self._remove_study()
        for path in (self.folder / _BATCHES).glob("*.nc"):
            path.unlink()
        (self.folder / PLAN).unlink(missing_ok=True)

    def tidy(self) -> None:
        """Remove what a sweep that was killed had begun to write."""
        for name in (PLAN, CASES, _NETCDF, f"{_BATCHES}/*.nc"):
            remove_unfinished(self.folder / name)
        for path in self.folder.glob(f".{_ZARR}.*"):
            shutil.rmtree(path, ignore_errors=True)

    def finished(self, plan: Plan) -> set[int]:
        """Return the numbers of the batches that are there, complete and of these runs."""
        found = set()
        for number, batch in enumerate(plan.batches):
            with suppress(OSError, IndexError), netCDF4.Dataset(self._path(number)) as file:
                if np.array_equal(file["run"][:], batch.runs):
                    found.add(number)
        return found

    def save(self, number: int, batch: Batch, rows: Sequence[Row]) -> None:
        """Write a batch."""
        with replacing(self._path(number)) as temporary:
            tabulate(batch.runs, rows).to_netcdf(temporary, engine="netcdf4")

    def collect(self, plan: Plan) -> tuple[xr.Dataset, list[Path]]:
        """Make the study of all batches: a dataset, and its files."""
        data = assemble(plan, self._parts(plan))
        self._remove_study()
        path = self.folder / (_ZARR if has_zarr() else _NETCDF)
        if has_zarr():
            temporary = Path(tempfile.mkdtemp(prefix=f".{_ZARR}.", dir=self.folder))
            data.to_zarr(temporary, mode="w", zarr_format=3, consolidated=False)
            temporary.chmod(self.folder.stat().st_mode & 0o777)
            temporary.rename(path)
        else:
            with replacing(path) as temporary:
                data.to_netcdf(temporary, engine="netcdf4")
        write_rows(self.folder / CASES, case_rows(plan, data))
        return data, [path, self.folder / CASES]

    def _parts(self, plan: Plan) -> Iterator[xr.Dataset]:
        for number in range(len(plan.batches)):
            yield xr.load_dataset(self._path(number), engine="netcdf4")

    def _remove_study(self) -> None:
        if (self.folder / _ZARR).is_dir():
            shutil.rmtree(self.folder / _ZARR)
        for name in (_NETCDF, CASES):
            (self.folder / name).unlink(missing_ok=True)

    def _path(self, number: int) -> Path:
        return self.folder / _BATCHES / f"{number:0{_DIGITS}d}.nc"
