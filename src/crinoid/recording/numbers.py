"""Numbers of a variable: read, in SI units, without those that are marked as missing or bad."""

import math
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from crinoid.recording.texts import reason_of, short
from crinoid.scenario.errors import refusal, shown

MAX_VALUES = 20_000_000  # most values of a record; more, splines included, need gigabytes
MARKED = "Mark missing values by an empty cell, or in a netCDF file by a _FillValue."
_MAX_CHUNK = 2**30  # largest chunk of a variable that must be read as a whole (bytes)
_SIZES = [
    *(9.99, 9.999, 99.9, 99.99, 999, 999.9, 999.99, 9999, 9999.9, 9999.99, 99999, 99999.9),
    *(999999, 32.767, 32.768, 3276.7, 3276.8, 32767, 32768),
]
_MARKS = np.sort([-99, *_SIZES, *np.negative(_SIZES)])
"""Usual marks of missing values: nines, and the ends of a 16-bit counter, perhaps scaled."""
_APART = 0.1  # least distance of a mark from the other numbers, over its size
_CLOSE = 1e-6  # relative error of numbers in single precision, scaled
FLAG = re.compile(r"(.*_)?(qc|qc_agg|flags?|quality)", re.IGNORECASE)  # names of quality flags
_SHARED = re.compile(r"((vel\w*|currents?|quality|data)_)?(qc|flags?|quality)", re.IGNORECASE)
"""Names of quality flags of all components."""
_BAD_FLAGS = (4, 9)  # bad and missing, in QARTOD and OceanSITES
_BAD_WORDS = re.compile("bad|fail|missing|wrong|erroneous", re.IGNORECASE)
_NO_FLAG = -(2**62)  # flag of an entry without one: no value, and none of the bits of a mask


class Column(NamedTuple):
    """A variable of a file in a role."""

    key: str  # key in the scenario that names it
    name: str  # its name in the file
    factor_of: Callable[[str], float | None]  # factor from a unit to SI
    unit: str  # unit if the file names none
    most: float  # largest size of a value (SI); a larger one marks a missing value
    wraps: bool = False  # whether it is an angle, from which an instrument may omit whole turns
    noun: str = "numbers"  # word for its values; another one: their size is in ``unit``


def check_count(count: int, file: str, owner: str) -> None:
    """Refuse more values than a run can use, before any is read."""
    if count > MAX_VALUES:
        text = f"{short(file)} contains {count} values of {owner}"
        raise refusal("file", text, f"contain at most {MAX_VALUES}", "Cut out a shorter part.")


def quantity(
    dataset: xr.Dataset, variable: xr.DataArray, column: Column, remarks: list[str]
) -> np.ndarray:
    """Return a variable in SI units, NaN where a value is missing or flagged as bad."""
    key, name, factor_of, unit, limit, _, noun = column
    variable = without_flagged(dataset, variable, remarks)
    numbers = numbers_of(variable, key, noun).astype(float)
    factor = factor_to(variable, factor_of, key, unit, remarks)
    if comma := variable.attrs.get("comma"):
        remarks.append(f"{name}: {comma} is read as {float(comma.replace(',', '.')):g}")
    most = float(np.nanmax(np.abs(numbers), initial=0.0))
    if most * factor > limit:
        said = "" if noun == "numbers" else f" {unit}"
        scale = (factor_of(unit) if said else factor) or 1.0
        text = f"{name} reaches {most * factor / scale:g}{said}"
        raise refusal(key, text, f"reach at most {limit / scale:.4g}", MARKED)
    _check_marks(numbers, key, name)
    return factor * numbers


def values_of(variable: xr.DataArray) -> np.ndarray:
    """Return the values of a variable; only this reads them from a netCDF file."""
    size = math.prod(variable.encoding.get("chunksizes") or (0,)) * variable.dtype.itemsize
    if size > _MAX_CHUNK:
        text = f"{variable.name} is stored in chunks of {size / 2**30:.3g} GB"
        raise refusal("file", text, "be stored in chunks of at most 1 GB")
    try:
        return np.asarray(variable.values)
    except Exception as error:  # libraries raise anything on a damaged file
        raise refusal("file", f"{variable.name} cannot be read ({reason_of(error)})") from error


def numbers_of(variable: xr.DataArray, key: str, must: str) -> np.ndarray:
    """Return the values of a variable that must be numbers; NaN outside of its valid range."""
    values, attributes = values_of(variable), variable.attrs
    if values.dtype.kind not in "iuf" or "odd" in attributes:
        odd = attributes.get("odd", "no numbers")
        raise refusal(key, f"{variable.name} contains {odd}", f"contain {must}")
    ends = attributes.get("valid_range", ())
    if np.size(ends) != 2:  # such as a text
        ends = attributes.get("valid_min"), attributes.get("valid_max")
    low, high = (_unpacked(variable, np.asarray(end)) for end in ends)
    outside = (values < low) | (values > high)
    return np.where(outside, np.nan, values) if outside.any() else values


def _unpacked(variable: xr.DataArray, limit: np.ndarray) -> float:
    """Return a limit of a variable, NaN for none.

    That of a packed variable counts as packed where it is a whole number.
    """
    packing = variable.encoding
    stored = np.dtype(packing.get("dtype") or float)
    if limit.dtype.kind not in "iuf":
        return math.nan
    if limit.dtype != stored and not (limit.dtype.kind in "iu" and stored.kind in "iu"):
        return float(limit)
    return float(limit * packing.get("scale_factor", 1.0) + packing.get("add_offset", 0.0))


def finite_numbers(variable: xr.DataArray, key: str, must: str) -> np.ndarray:
    """Return the values of a variable that must be numbers without a gap."""
    values = numbers_of(variable, key, must)
    if not np.isfinite(values).all():
        raise refusal(key, f"{variable.name} has a missing or infinite entry", f"contain {must}")
    return values


def labels_of(variable: xr.DataArray) -> list[str]:
    """Return the values of a variable as texts, whole numbers without a point."""
    return [_text(each) for each in values_of(variable).ravel().tolist()]


def _text(value: Any) -> str:
    value = value.decode() if isinstance(value, bytes) else value
    return f"{value:g}" if isinstance(value, float) else str(value).strip()


def without_flagged(
    dataset: xr.Dataset, variable: xr.DataArray, remarks: list[str]
) -> xr.DataArray:
    """Return a variable without values that its quality flags call bad or missing.

    Flags are its ancillary variables (CF, QARTOD), those named after it, such as ``u_QC``, and
    those of all components, such as ``flag``. Others that belong to no variable are said.
    """
    linked = {
        str(owner): str(each.attrs.get("ancillary_variables", "")).split()
        for owner, each in dataset.variables.items()
    }
    owned = {name for names in linked.values() for name in names}
    own = linked.get(str(variable.name), [])
    for name in map(str, dataset.variables):
        flag = dataset[name]
        flag = flag.isel({d: 0 for d in set(flag.dims) - set(variable.dims) if flag.sizes[d] == 1})
        standard = str(flag.attrs.get("standard_name", ""))
        marked = bool(FLAG.fullmatch(name)) or standard.endswith("flag")
        if not (marked or "flag_meanings" in flag.attrs) or not {*flag.dims} <= {*variable.dims}:
            continue
        after = [e for e in linked if not FLAG.fullmatch(e) and name.startswith(f"{e}_")]
        named = max(after, key=len, default="") == variable.name and name not in owned
        if name not in own and not named:
            if after or name in owned or not flag.dims:
                continue
            if not _SHARED.fullmatch(name):
                text = f"{name} is a flag of no variable and is not used"
                remarks += [text] if text not in remarks else []
                continue
        if flag.dtype.kind not in "iuf":  # characters or words
            digits = [
                int(each) if each.isdecimal() else _BAD_FLAGS[0] if _is_bad(each) else -1
                for each in labels_of(flag)
            ]
            flag = flag.copy(data=np.reshape(digits, flag.shape))
        bad = _bad(flag) & variable.notnull()
        if count := int(bad.sum()):
            variable = variable.where(~bad).drop_encoding()
            remarks.append(f"{count} values of {variable.name} are flagged as bad and left out")
    return variable


def _is_bad(text: str) -> bool:
    return _BAD_WORDS.search(text) is not None


def _bad(flag: xr.DataArray) -> xr.DataArray:
    """Return where a flag is bad: equal to a value, or with a bit of a mask (CF, section 3.5)."""
    meanings = str(flag.attrs.get("flag_meanings", "")).split()
    masks, values = (_listed(flag.attrs.get(f"flag_{each}", ())) for each in ("masks", "values"))
    if not meanings or len(meanings) not in (len(masks), len(values)):
        return flag.isin(_BAD_FLAGS)
    masks = masks if len(masks) == len(meanings) else [-1] * len(meanings)
    values = values if len(values) == len(meanings) else masks
    bits = flag.fillna(_NO_FLAG).astype(np.int64)
    bad = xr.zeros_like(bits, bool)
    for mask, value, text in zip(masks, values, meanings, strict=True):
        bad |= ((bits & mask) == value) & _is_bad(text)
    return bad


def _listed(values: Any) -> list[int]:
    """Return whole numbers of an attribute, which may be a text such as ``1b, 2b``."""
    values = re.findall(r"-?\d+", values) if isinstance(values, str) else np.ravel(values)
    return [int(each) for each in values]


def _check_marks(numbers: np.ndarray, key: str, name: str) -> None:
    """Refuse a variable with a mark of missing values among its numbers.

    A mark differs from the other numbers by more than they differ from each other: 999 between
    998 and 1000 is a number.
    """
    found = numbers[np.isfinite(numbers)]
    after = np.clip(np.searchsorted(_MARKS, found), 1, _MARKS.size - 1)
    nearest = np.minimum(np.abs(found - _MARKS[after]), np.abs(found - _MARKS[after - 1]))
    marked = nearest <= _CLOSE * np.abs(found)
    marks, others = found[marked], found[~marked]
    if marks.size and others.size:
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
    units = str(variable.attrs.get("units", "")).strip()
    if not units:
        remarks.append(f"{variable.name} names no unit and is assumed to be in {unit}")
    factor = factor_of(units or unit)
    if factor is None:
        raise refusal(key, f"{variable.name} is in {shown(units)}", f"be in a unit such as {unit}")
    return factor
