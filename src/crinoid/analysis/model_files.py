"""Files of a linear model, by their format."""

import json
from pathlib import Path
from typing import Any

import numpy as np


def _write_npz(path: Path, values: dict[str, Any]) -> None:
    with path.open("wb") as file:
        np.savez(file, **values)


def _write_mat(path: Path, values: dict[str, Any]) -> None:
    from scipy.io import savemat  # slow to load

    cells = {
        name: np.array(value, object) if isinstance(value, tuple) else value
        for name, value in values.items()
    }
    with path.open("wb") as file:
        savemat(file, cells, oned_as="column")


def _write_json(path: Path, values: dict[str, Any]) -> None:
    plain = {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in values.items()
    }
    path.write_text(json.dumps(plain, allow_nan=False) + "\n", "utf-8")


FORMATS = {"npz": _write_npz, "mat": _write_mat, "json": _write_json}
"""Writers by the format, which is the ending of the file."""
