"""Datasets in place of files: each is written once, and the scenario names that file."""

import hashlib
import os
from pathlib import Path
from typing import Any

from crinoid.foundation.atomic_file import atomic_write
from crinoid.scenario.errors import mistake_text, refusal


def as_file(value: Any) -> Any:
    """Return the path of a netCDF file with the content of an ``xarray.Dataset``.

    The file is in crinoid's cache folder, under a name made from its content. Another value is
    returned as it is.

    Raises
    ------
    ScenarioError
        If the dataset cannot be written.
    """
    if not hasattr(value, "to_netcdf"):
        return value
    try:
        content = bytes(_writable(value).to_netcdf(engine="netcdf4"))
    except Exception as error:  # libraries raise anything
        text = f"the dataset cannot be written as netCDF ({' '.join(str(error).split())[:200]})"
        raise refusal("", mistake_text(text, "be one that to_netcdf accepts")) from error
    try:
        return str(_stored(content))
    except OSError as error:
        raise refusal("", f"the dataset cannot be written: {error}") from error


def _stored(content: bytes) -> Path:
    from crinoid.foundation.cache_folder import cache_folder  # only here: few scenarios need it

    folder = cache_folder(os.environ.get("JAX_COMPILATION_CACHE_DIR")) / "records"
    path = folder / f"{_digest(content)[:32]}.nc"
    if not path.exists():
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            temporary.write_bytes(content)
    return path


def _digest(content: bytes) -> str:
    """Return a digest of what a netCDF file says; its bytes also have the second of its writing."""
    import netCDF4

    found = hashlib.sha256()
    with netCDF4.Dataset("dataset", memory=content) as file:
        file.set_auto_maskandscale(False)
        found.update(repr({name: file.getncattr(name) for name in file.ncattrs()}).encode())
        for each in file.variables.values():
            about = {name: each.getncattr(name) for name in each.ncattrs()}
            values = each[...]
            known = each.name, each.dimensions, values.shape, values.dtype.str, about
            said = repr(values.tolist()).encode() if values.dtype == object else values.tobytes()
            found.update(repr(known).encode() + said)
    return found.hexdigest()


def _writable(dataset: Any) -> Any:
    """Return a dataset whose dates have no attribute ``units``, as mhkit's have: it has no file."""
    copied = dataset.copy()
    for variable in copied.variables.values():
        if variable.dtype.kind == "M":
            variable.attrs.pop("units", None)
    return copied
