"""Damaged files: a small valid file with other bytes or fields (strategies of Hypothesis)."""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import numpy as np
import xarray as xr
from hypothesis import reject
from hypothesis import strategies as st

_ODD = (
    *(0, -1, 1, 2, 10**6, 2**31, 2**63, 10**30, 0.0, -0.5, 1e-300, 1e300),
    *(float("nan"), float("inf"), -float("inf"), True, False),
    *("", " ", "0", "nan", "\x00", "a.b", "../../x", "é€😀", "x" * 1000, "=", "[", "none"),
    *([], [[]], [0.0], [1, "a"], {}, {"": 0}, {"kind": "none"}),
    *(datetime.date(2024, 2, 29), datetime.time(12)),
)
"""Values that a field hardly ever has."""
_PIECES = (
    b"",
    b"\x00",
    b"\xff" * 4,
    b"\x7f\xff\xff\xff",
    b"\n",
    b"nan",
    b"1e999",
    b"-",
    b",",
    b"]",
)
_ATTRIBUTES = ("units", "scale_factor", "flag_values", "valid_range", "_FillValue", "calendar")


@st.composite
def other_bytes(draw: st.DrawFn, content: bytes) -> bytes:
    """Return content with a few pieces replaced, repeated, or cut off."""
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(content)))
        length = draw(st.sampled_from((0, 1, 4, 8, 60, 1000)))
        before, piece, after = content[:at], content[at : at + length], content[at + length :]
        match draw(st.integers(0, 3)):
            case 0:
                after = b""
            case 1:
                piece += piece
            case 2:
                piece = bytes(each ^ draw(st.integers(1, 255)) for each in piece[:8]) + piece[8:]
            case _:
                piece = draw(st.sampled_from(_PIECES) | st.binary(max_size=8))
        content = before + piece + after
    return content


@st.composite
def other_document(draw: st.DrawFn, document: dict[str, Any]) -> dict[str, Any]:
    """Return a document with a few values replaced, left out, or added."""
    found = deepcopy(document)
    for _ in range(draw(st.integers(1, 3))):
        if not found:
            break
        *outer, key = draw(st.sampled_from(list(_places(found))))
        holder: Any = found
        for part in outer:
            holder = holder[part]
        match draw(st.integers(0, 3)):
            case 0:
                del holder[key]
            case 1 if isinstance(holder, dict):
                holder[draw(st.sampled_from(("x", "kind", "", "file", "a b")))] = holder[key]
            case _:
                holder[key] = deepcopy(draw(st.sampled_from(_ODD)))
    return found


@st.composite
def other_dataset(draw: st.DrawFn, dataset: xr.Dataset) -> xr.Dataset:
    """Return a dataset with a few variables or attributes replaced or left out."""
    for _ in range(draw(st.integers(1, 3))):
        parts = {str(name): dataset[name].variable for name in dataset.variables}
        if not parts:
            break
        name, attributes = draw(st.sampled_from(list(parts))), dict(dataset.attrs)
        match draw(st.integers(0, 6)):
            case 0:
                del parts[name]
            case 1:
                key = draw(st.sampled_from([*attributes, "title"]))
                attributes[key] = draw(st.sampled_from(("", "= =", "[arm]\nnodes = -1", 3, "é")))
            case _ as kind:
                parts[name] = draw(_other_variable(parts[name], kind))
        try:
            dataset = xr.Dataset(parts, attrs=attributes)
        except ValueError:  # dimensions of two sizes
            reject()
    return dataset


@st.composite
def _other_variable(draw: st.DrawFn, variable: xr.Variable, kind: int) -> xr.Variable:
    dims, values = variable.dims, variable.values
    if kind == 2:
        number = draw(st.sampled_from((np.nan, np.inf, -1e300, 0.0)))
        return variable.copy(data=np.full(variable.shape, number))
    if kind == 3:
        kinds = ("U", "i4", "f4") if variable.dtype.kind in "iuf" else ("S",)
        with np.errstate(all="ignore"):
            try:
                return variable.copy(data=values.astype(draw(st.sampled_from(kinds))))
            except UnicodeError:
                reject()
    if kind == 4 and variable.size:
        first = slice(0, 1) if draw(st.booleans()) else 0
        return variable.isel(dict.fromkeys(dims[:1], first))
    if kind == 5 and dims:
        return xr.Variable((f"other_{dims[0]}", *dims[1:]), values)
    key = draw(st.sampled_from(_ATTRIBUTES))
    value = draw(st.sampled_from(("", "cm", "x", 3, 1e300)))
    return xr.Variable(dims, values, variable.attrs | {key: value})


def _places(value: Any, outer: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path to each value of a document."""
    for key, each in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*outer, key)
        if isinstance(each, (dict, list)):
            yield from _places(each, (*outer, key))
