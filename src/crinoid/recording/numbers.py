"""Numbers of a variable: read, decoded, without those that are marked as missing or bad."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np
import xarray as xr

from crinoid.recording.texts import MARKED, reason_of, short
from crinoid.scenario.errors import refusal, shown

MAX_VALUES = 20_000_000
"""Most values of a record; more, splines included, need gigabytes."""
_MAX_CHUNK = 2**30
"""Largest chunk of a variable that must be read as a whole (bytes)."""
_NINES = (
    *(9.99, 9.999, 99.9, 99.99, 999, 999.9, 999.99, 9999, 9999.9, 9999.99, 99999, 99999.9),
    999999,
)
_ENDS = (32.767, 32.768, 3276.7, 3276.8, 32767, 32768)
_MARKS = np.sort([-99, *_NINES, *_ENDS, *np.negative(_NINES), *np.negative(_ENDS)])
"""Usual marks of missing values: nines, and the ends of a 16-bit counter, perhaps scaled."""
_APART = 0.1
"""Least distance of a mark from the other numbers, over its size."""
_CLOSE = 1e-6
"""Relative error of numbers in single precision."""
_BAD_FLAGS = (4, 9)
"""Bad and missing, in QARTOD and OceanSITES."""
_BAD_WORDS = ("bad", "fail", "missing", "wrong", "erroneous")


def check_count(count: int, file: str, owner: str) -> None:
    """Refuse more values than a run can use, before any is read."""
    if count > MAX_VALUES:
        text = f"{short(file)} contains {count} values of {owner}"
        raise refusal("file", text, f"contain at most {MAX_VALUES}", "Cut out a shorter part.")


def values_of(variable: xr.DataArray) -> np.ndarray:
    """Return the values of a variable; only this reads them from a netCDF file."""
    chunks = variable.encoding.get("chunksizes") or ()
    size = math.prod(chunks) * variable.dtype.itemsize
    if size > _MAX_CHUNK:
        text = f"{variable.name} is stored in chunks of {size / 2**30:.3g} GB"
        raise refusal("file", text, "be stored in chunks of at most 1 GB")
    try:
        return np.asarray(variable.values)
    except Exception as error:  # libraries raise anything on a damaged file
        text = f"{variable.name} cannot be read ({reason_of(error)})"
        raise refusal("file", text) from error


def numbers_of(variable: xr.DataArray, key: str, must: str) -> np.ndarray:
    """Return the values of a variable that must be numbers; NaN outside of its valid range."""
    values = values_of(variable)
    if values.dtype.kind not in "iuf":
        odd = variable.attrs.get("odd", "no numbers")
        raise refusal(key, f"{variable.name} contains {odd}", f"contain {must}")
    ends = (variable.attrs.get("valid_min"), variable.attrs.get("valid_max"))
    both = variable.attrs.get("valid_range")
    low, high = ends if both is None or np.size(both) != 2 else both  # a text is no range
    for end, sign in ((low, 1), (high, -1)):
        if (
            np.asarray(end).dtype.kind in "iuf"
            and (outside := sign * values < sign * _unpacked(variable, end)).any()
        ):
            values = np.where(outside, np.nan, values)
    return values


def _unpacked(variable: xr.DataArray, limit: object) -> float:
    """Return a limit of a packed variable, which counts as packed where it is a whole number."""
    packing = variable.encoding
    stored = np.dtype(packing.get("dtype") or float)
    if np.asarray(limit).dtype != stored and not (
        np.asarray(limit).dtype.kind in "iu" and stored.kind in "iu"
    ):
        return float(np.asarray(limit))
    scale, offset = packing.get("scale_factor", 1.0), packing.get("add_offset", 0.0)
    return float(np.asarray(limit) * scale + offset)


def finite_numbers(variable: xr.DataArray, key: str, must: str) -> np.ndarray:
    """Return the values of a variable that must be numbers without a gap."""
    values = numbers_of(variable, key, must)
    if not np.isfinite(values).all():
        raise refusal(key, f"{variable.name} has a missing or infinite entry", f"contain {must}")
    return values


def labels_of(variable: xr.DataArray) -> list[str]:
    """Return the values of a variable as texts, whole numbers without a point."""
    return [_text(each) for each in values_of(variable).tolist()]


def _text(value: object) -> str:
    value = value.decode() if isinstance(value, bytes) else value
    return f"{value:g}" if isinstance(value, float) else str(value).strip()


def without_flagged(
    dataset: xr.Dataset, variable: xr.DataArray, remarks: list[str]
) -> xr.DataArray:
    """Return a variable without values that its quality flags call bad or missing.

    Flags are its ancillary variables (CF, QARTOD) and those named after it, such as ``u_QC``.
    """
    own = str(variable.attrs.get("ancillary_variables", "")).split()
    usual = [f"{variable.name}_{ending}" for ending in ("QC", "qc", "qc_agg", "flag")]
    for name in dict.fromkeys([*own, *usual]):
        if name not in dataset.variables:
            continue
        flag = dataset[name]
        flag = flag.isel({d: 0 for d in set(flag.dims) - set(variable.dims) if flag.sizes[d] == 1})
        standard = str(flag.attrs.get("standard_name", ""))
        marked = standard.endswith("flag") or "flag_meanings" in flag.attrs
        if name in own and name not in usual and not marked:
            continue
        if flag.dtype.kind not in "iuf":  # characters or words
            digits = [
                int(each) if each.isdecimal() else _BAD_FLAGS[0] if _is_bad(each) else -1
                for each in map(_text, flag.values.flat)
            ]
            flag = flag.copy(data=np.reshape(digits, flag.shape))
        bad = _bad(flag) & variable.notnull()
        if bad.dims and set(bad.dims) <= set(variable.dims) and (count := int(bad.sum())):
            kept = variable.where(~bad)
            kept.encoding, variable = {}, kept
            remarks.append(f"{count} values of {variable.name} are flagged as bad and left out")
    return variable


def _is_bad(text: str) -> bool:
    return any(word in text.lower() for word in _BAD_WORDS)


def _bad(flag: xr.DataArray) -> xr.DataArray:
    """Return where a flag is bad: equal to a value, or with a bit of a mask (CF, section 3.5)."""
    meanings = str(flag.attrs.get("flag_meanings", "")).split()
    values, masks = (_listed(flag.attrs.get(f"flag_{each}", ())) for each in ("values", "masks"))
    if meanings and len(masks) == len(meanings):
        bits = flag.fillna(0).astype(np.int64)
        values = values if len(values) == len(masks) else masks
        bad = xr.zeros_like(bits, bool)
        for mask, value, text in zip(masks, values, meanings, strict=True):
            bad |= ((bits & mask) == value) & _is_bad(text)
        return bad
    if not meanings or len(values) != len(meanings):
        return flag.isin(_BAD_FLAGS)
    pairs = zip(values, meanings, strict=True)
    return flag.isin([value for value, text in pairs if _is_bad(text)])


def _listed(values: object) -> list[int]:
    """Return whole numbers of an attribute, which may be a text such as ``1b, 2b``."""
    if isinstance(values, str):
        values = [int(each) for each in re.findall(r"-?\d+", values)]
    return [int(each) for each in np.atleast_1d(np.asarray(values)).tolist()]


def check_marks(numbers: np.ndarray, key: str, name: str) -> None:
    """Refuse a variable with a mark of missing values among its numbers.

    A mark differs from the other numbers by more than they differ from each other: 999 between
    998 and 1000 is a number.
    """
    found = numbers[np.isfinite(numbers)].astype(float)
    after = np.clip(np.searchsorted(_MARKS, found), 1, _MARKS.size - 1)
    nearest = np.minimum(np.abs(found - _MARKS[after]), np.abs(found - _MARKS[after - 1]))
    marked = nearest <= _CLOSE * np.abs(found)
    if not marked.any():
        return
    others, marks = found[~marked], found[marked]
    if others.size:
        low, high = others.min(), others.max()
        apart = np.maximum(high - low, _APART * np.abs(marks))
        marks = marks[np.maximum(low - marks, marks - high) > apart]
    if marks.size:
        text = f"{name} contains {marks[0]:g}, far from its other numbers"
        raise refusal(key, text, "contain measured values only", MARKED)


def factor_to(
    variable: xr.DataArray,
    factor_of: Callable[[str], float | None],
    key: str,
    unit: str,
    remarks: list[str],
) -> float:
    """Return the factor from a variable to SI units; a missing unit becomes a remark."""
    units = variable.attrs.get("units")
    if units is None or not str(units).strip():
        remarks.append(f"{variable.name} names no unit and is assumed to be in {unit}")
        units = unit
    factor = factor_of(str(units).strip())
    if factor is None:
        text = f"{variable.name} is in {shown(str(units))}"
        raise refusal(key, text, f"be in a unit such as {unit}")
    return factor
