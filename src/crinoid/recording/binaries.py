"""Reading of binary files of current meters and profilers, by the package mhkit."""

import logging
import warnings
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import xarray as xr

from crinoid.recording.texts import short
from crinoid.scenario.errors import refusal

_SUFFIXES = (".ad2cp", ".vec", ".wpr", ".000", ".pd0", ".enx", ".enr", ".ens")
_PD0 = b"\x7f\x7f"  # first bytes of a file of RD Instruments


def reads(file: str, head: bytes) -> bool:
    """Return whether a file is a binary one of Nortek or of RD Instruments."""
    return Path(file).suffix.lower() in _SUFFIXES or head.startswith(_PD0)


def read(file: str) -> xr.Dataset:
    """Read a binary file, with the velocity toward east, north and up if it has a heading."""
    handler = logging.NullHandler()  # else the logging of mhkit adds one that prints
    logging.root.addHandler(handler)
    try:
        with warnings.catch_warnings(), redirect_stdout(StringIO()):
            warnings.simplefilter("ignore")
            from mhkit import dolfyn  # an extra, and slow to load

            dataset: xr.Dataset = dolfyn.read(file)
            if dataset.attrs["coord_sys"] != "earth" and "heading" in dataset:
                dolfyn.rotate2(dataset, "earth")
    except ImportError as error:
        text = f"{short(file)} is a binary file of an instrument, and reading it needs mhkit"
        raise refusal("file", f'{text}: pip install "crinoid[instruments]"') from error
    finally:
        logging.root.removeHandler(handler)
    return dataset
