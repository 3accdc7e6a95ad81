"""TOML documents: reading them, and setting single keys by their dotted name."""

import hashlib
import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from crinoid.scenario.dataset_file import as_file
from crinoid.scenario.errors import got, one_of, refusal, shown
from crinoid.scenario.quantity import Quantity

_KEYS = ("file", "weights")  # keys that name a file
_UNSAFE = re.compile(r"[^A-Za-z0-9_.,=+-]+")
"""Characters of a name that a shell or a file system may treat in some other way."""
_REMEDIES = (
    (r"[^=]*=\s*[-+\d.eE]+\s*[^\W\d]", "Write the number only, in the unit of the key."),
    (r"[^=]*=\s*[-+]?\d+,\d", "Write a point in a number, not a comma."),
    (r"[^=]*=\s*[-+]?\.\d", "Write 0 before the point."),
    (r"[^=]*=\s*(True|False)", "Write true or false in small letters."),
    (r"[^=]*=\s*\(", "Write a list in [ ]."),
    (r"[^=]*=\s*[^\W\d]", "Write text in quotes."),
    (r"\s*[\w.]+\s*:", "Write = between a key and its value."),
    (r"\s*\[\w+\]", "Write [[ ]] around the name of each of several tables."),
)
"""Lines that are not valid TOML, and how to mend them."""
_LONGEST = 72  # characters of a name of changes

# absolute, so that a scenario that is stored means the same file wherever it is read again
FileName = Annotated[
    str, Field(min_length=1), AfterValidator(lambda path: os.path.abspath(os.path.expanduser(path)))
]
RecordFile = Annotated[
    FileName,
    Quantity(expects="the path of a CSV or netCDF file"),
    BeforeValidator(as_file),
    Field(
        description="CSV or netCDF file; a relative path starts from the scenario file, with "
        "--set and in Python from the working directory."
    ),
]


def flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of tables by dotted key."""
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in items:
            yield from flat(inner, f"{name}.{key}" if name else str(key))
    else:
        yield name, value


def anchor(document: dict[str, Any], folder: Path) -> None:
    """Resolve the relative paths of a document from a folder, in place."""
    for holder, key in _places(document):
        holder[key] = str(folder / os.path.expanduser(holder[key]))


def named_files(document: dict[str, Any]) -> list[str]:
    """Return the files that a document names, each once."""
    return list(dict.fromkeys(holder[key] for holder, key in _places(document)))


def rename_files(document: dict[str, Any], names: Mapping[str, str]) -> None:
    """Replace the names of files in a document, in place."""
    for holder, key in _places(document):
        holder[key] = names[holder[key]]


def digests(document: dict[str, Any]) -> dict[str, str]:
    """Return the SHA-256 digest of each file that a document names, if it can be read."""
    found = {}
    for name in named_files(document):
        with suppress(OSError, ValueError):  # ValueError: a name that no file can have
            if Path(name).is_file():  # a pipe would never end
                with Path(name).open("rb") as file:
                    found[name] = hashlib.file_digest(file, "sha256").hexdigest()
    return found


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the container and the key or index of each file name, also in ``vary``."""
    # an empty name is no folder; the scenario refuses it
    if isinstance(value, dict):
        for name, item in value.items():
            if name in _KEYS and item and isinstance(item, str):
                yield value, name
            elif name.endswith(tuple(f".{key}" for key in _KEYS)) and isinstance(item, list):
                yield from ((item, i) for i, each in enumerate(item) if each and type(each) is str)
            else:
                yield from _places(item)
    elif isinstance(value, list):
        for item in value:
            yield from _places(item)


def parse(text: str) -> dict[str, Any]:
    """Read a TOML document."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        reason = "nested too deeply"
    except ValueError as error:  # broken, or a number of thousands of digits
        lines = text.split("\n")
        end = f"(at line {len(lines)}, column {len(lines[-1]) + 1})"
        reason = str(error).replace("(at end of document)", end)
        line = lines[int(at[1]) - 1] if (at := re.search(r"at line (\d+)", reason)) else ""
        hints = (hint for pattern, hint in _REMEDIES if re.match(pattern, line))
        reason += f": {line.strip()[:60]}. {next(hints, '')}".rstrip() if line.strip() else ""
    raise refusal("", f"not valid TOML: {reason}")


def override(document: dict[str, Any], setting: str) -> None:
    """Change a document by one ``key=value``, in place; see `value_of`."""
    key, equals, text = setting.partition("=")
    if not equals or not key.strip():
        raise refusal("", got(setting, "be key=value, such as arm.length=0.6"))
    key, text = key.strip(), text.strip()
    value = value_of(text)
    if value == text and text[:1] in ("[", "{", '"', "'"):
        hint = "Close each quote and bracket."
        if "\\" in text:
            hint = "Write \\\\ or / for a backslash in it."
        raise refusal(key, got(text, "be valid TOML", hint))
    assign(document, key, value)


def name_of_changes(settings: Sequence[str]) -> str:
    """Return a name for changes ``key=value`` that file systems and shells accept as it is.

    It depends neither on their order nor on the way in which a number is written. A long one, or
    one with other characters, ends in a digest.
    """
    changes = (setting.partition("=") for setting in settings)
    found = {key.strip(): value_of(text.strip()) for key, _, text in changes}
    whole = ",".join(f"{key}={_word(value)}" for key, value in sorted(found.items()))
    name = _UNSAFE.sub("_", whole)
    if name == whole and len(name) <= _LONGEST:
        return name
    digest = hashlib.sha256(repr(sorted(found.items())).encode()).hexdigest()[:8]
    return f"{name[: _LONGEST - 9]}-{digest}"


def _word(value: Any) -> str:
    if isinstance(value, list):
        return "_".join(map(_word, value))
    return str(value).lower() if isinstance(value, bool) else str(value).removesuffix(".0")


def assign(document: dict[str, Any], key: str, value: Any) -> tuple[Any, ...]:
    """Set a dotted key of a document, in place, and return its parts; missing tables are created.

    A number is an index into a list, and the index after the last one adds an entry. The ``name``
    of a table in a list is its index too: ``chamber.left.area``.
    """
    *outer, last = _parts(key)
    table: Any = document
    found: list[Any] = []
    for depth, part in enumerate(outer):
        index = _index(table, part, key, outer[:depth])
        found.append(index)
        entry = table.get(index) if isinstance(table, dict) else table[index]
        if entry is None:
            following = [*outer, last][depth + 1]
            entry = table[index] = [] if following.isdecimal() else {}
        table = entry
    # a later key may change a part of a table that was given here
    index = _index(table, last, key, outer)
    table[index] = deepcopy(value)
    return *found, index


def value_of(text: str) -> Any:
    """Return a TOML value, or the text itself if it is not TOML, so that words need no quotes."""
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return table["value"] if len(table) == 1 else text


def value_at(document: dict[str, Any], key: str) -> Any:
    """Return the value at a dotted key of a document, or None without one."""
    found: Any = document
    for part in _parts(key):
        if isinstance(found, list):
            part = str(_names(found).get(part, part))
            found = found[int(part)] if part.isdecimal() and int(part) < len(found) else None
        elif isinstance(found, dict):
            found = found.get(part)
        else:
            return None
    return found


def _index(table: Any, part: str, key: str, outer: list[str]) -> Any:
    """Return a part of a key as the index into a table or list; the list may get a new entry."""
    here = ".".join(outer)
    if isinstance(table, dict):
        return part
    if not isinstance(table, list):
        raise refusal(key, f"unknown key; {here} is {shown(table)} and not a table")
    names = _names(table)
    if part in names:
        return names[part]
    if not part.isdecimal() or len(part) > 9 or int(part) > len(table):
        text = f"unknown key; must be an index into {here} from 0 to {len(table)}"
        text += f", or {one_of(names)}" if names else ""
        raise refusal(key, f"{text}. Use {len(table)} to add an entry.")
    if int(part) == len(table):
        table.append(None)
    return int(part)


def _names(tables: list[Any]) -> dict[str, int]:
    """Return the indices of the tables in a list that have a name."""
    named = [each.get("name") if isinstance(each, dict) else None for each in tables]
    return {name: index for index, name in enumerate(named) if isinstance(name, str)}


def _parts(key: str) -> list[str]:
    try:
        if set(key) & set("#[]\n"):
            raise ValueError(key)
        table: Any = tomllib.loads(f"{key} = 0")
    except ValueError:
        text = "not a key; must be names joined by dots, such as arm.length"
        raise refusal(key.replace("\n", " "), text) from None
    parts = []
    while isinstance(table, dict):
        part, table = next(iter(table.items()))
        parts.append(part)
    return parts


def plain(value: Any) -> Any:
    """Return a value with the types that TOML has, as `from_toml` would read it."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if not isinstance(value, (bool, int, float, str)):
        raise ValueError(f"{value!r} is not a TOML value")
    return value


def without_empty(table: dict[str, Any]) -> dict[str, Any]:
    """Return a document without empty tables and lists."""
    full = {
        key: without_empty(value) if isinstance(value, dict) else value
        for key, value in table.items()
    }
    return {key: value for key, value in full.items() if value not in ({}, [])}
