"""A file of findings about one case of a scenario: its folder, its figures, what is said of it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.cli.folder import check_own, claimed
from crinoid.programs import keep_programs
from crinoid.replacement import replacing
from crinoid.report import write_report
from crinoid.scenario import Mistake, Scenario, ScenarioError


def prepare_one(scenario: Scenario, finding: str) -> Prepared:
    """Prepare a scenario of which something is to be found, such as `"a tuning"`."""
    if scenario.vary:
        text = f"{finding} is of one case; give its values with --set and leave out vary"
        raise ScenarioError([Mistake("vary", text)])
    keep_programs()
    return Prepared(scenario)


@contextmanager
def place_of(path: Path, *, force: bool) -> Iterator[None]:
    """Claim the folder of a file that may be written."""
    with claimed(path.parent):
        if not force:
            check_own(path)
        yield


def save_finding(dataset: xr.Dataset, path: Path) -> list[Path]:
    """Save what was found, draw it, and return the files."""
    with replacing(path) as temporary:
        dataset.to_netcdf(temporary, engine="netcdf4")
    return [path, *write_report(path)]
