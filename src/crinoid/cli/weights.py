"""Shares of time of the cases of a sweep, from a table such as a histogram or a scatter diagram."""

import csv
from pathlib import Path

import numpy as np
from jaxtyping import Float

from crinoid.results.own_files import SHARE
from crinoid.scenario import refusal, shown
from crinoid.scenario.document import value_of


def read_weights(file: Path) -> tuple[dict[str, list[float]], Float[np.ndarray, " case"]]:
    """Return the values of cases by key, and their shares of time, without those of share 0.

    A `ScenarioError` says what is wrong with the file.
    """
    keys: list[str] = []
    try:
        text = file.read_text(encoding="utf-8-sig")
        if ";" in text:  # of a spreadsheet with decimal commas
            text = text.replace(",", ".").replace(";", ",")
        table = csv.DictReader(text.splitlines())
        keys = [name for name in table.fieldnames or () if name != SHARE]
        rows = [[value_of(row[name]) for name in (*keys, SHARE)] for row in table]
        if not (keys and rows and np.isfinite(rows).all()):
            raise ValueError
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        text = f"{file} must have finite numbers in a column {shown(SHARE)} and in one for each key"
        raise refusal("--weights", f"{text}, such as flow.0.velocity.0") from error
    shares = np.array([row[-1] for row in rows], float)
    if not ((shares >= 0).all() and abs(shares.sum() - 1) < 0.01):
        text = f"{file} has shares of time of {shares.min():.4g} or more that add up to "
        text += f"{shares.sum():.4g}"
        raise refusal("--weights", f"{text}; must be 0 or more, and add up to 1")
    cases = [row for row in rows if row[-1] > 0]
    return {key: [row[at] for row in cases] for at, key in enumerate(keys)}, shares[shares > 0]
