"""Write `docs/reference/scenario.md` and the pages below it from the schema of a scenario.

    python docs/make_scenario_reference.py

Run it after a change to what a scenario takes; `tests/project/test_docs.py` asks for it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from crinoid.scenario import Scenario
from crinoid.scenario.model import allowed
from crinoid.scenario.quantity import unit_of

PAGE = Path(__file__).with_name("reference") / "scenario.md"
BEGIN, END = "<!-- tables: begin -->", "<!-- tables: end -->"
PARTS = {
    "arm": ("Arm", "arm"),
    "base": ("Base and vehicle", "base vehicle"),
    "water": ("Water and flows", "water flow"),
    "surroundings": ("Loads, obstacles and contact", "load obstacle contact tool"),
    "actuators": ("Actuators", "chamber tendon actuator"),
    "control": ("Target, sensors and control", "target sensor sensors control"),
    "run": ("Simulation and output", "simulation output vary"),
}
"""Title of each page, and its tables."""

_WHERE = {None: "", 2: " In the plane only.", 3: " In space only."}

Schema = dict[str, Any]


def pages() -> dict[Path, str]:
    """Return the texts of all pages."""
    schema = Scenario.model_json_schema()
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    listed = "\n".join(f"scenario/{name}" for name in PARTS)
    made = f"{_table(_rows(schema['properties']))}\n\n```{{toctree}}\n:maxdepth: 2\n\n{listed}\n```"
    texts = {PAGE: f"{before}{BEGIN}\n\n{made}\n\n{END}{rest.partition(END)[2]}"}
    entries = dict(schema["properties"])
    for name, (title, tables) in PARTS.items():
        part = {"properties": {table: entries.pop(table) for table in tables.split()}}
        sections = "\n\n".join([f"# {title}", *_sections("", part, schema["$defs"])])
        # links of descriptions are seen from the page above
        deeper = sections.replace("](", "](../").replace("](../#", "](#")
        texts[PAGE.with_suffix("") / f"{name}.md"] = f"{deeper}\n"
    left = [name for name, entry in entries.items() if _is_table(entry)]
    assert not left, f"PARTS lacks {left}"
    return texts


def _is_table(entry: Schema) -> bool:
    """Return whether an entry is a table or a list of tables."""
    listed = entry.get("items", {}).get("$ref")
    return listed is not None or _kinds(entry) is not None or _reference(entry) is not None


def _sections(prefix: str, schema: Schema, definitions: Schema) -> Iterator[str]:
    """Yield the section of each table below one, those that are alike under one heading."""
    entries = schema["properties"]
    alike: dict[str, list[tuple[str, Schema]]] = {}
    for name, entry in entries.items():
        if (found := _reference(entry)) is not None:
            alike.setdefault(found, []).append((f"{prefix}{name}", entry))
    for name, entry in entries.items():
        if (plain := entry.get("items", {}).get("$ref")) is not None:
            inner = _definition(plain, definitions)
            yield _section(f"`[[{prefix}{name}]]`", inner)
            yield from _sections(f"{prefix}{name}.", inner, definitions)
        elif (kinds := _kinds(entry)) is not None:
            inner = {kind: _definition(found, definitions) for kind, found in kinds.items()}
            first, *others = (_rows(each["properties"]) for each in inner.values())
            common = [row for row in first if all(row in rows for rows in others)]
            if common:
                yield f"## `[[{prefix}{name}]]` of any kind\n\n{_table(common)}"
            for kind, each in inner.items():
                yield _section(f'`[[{prefix}{name}]]` with `kind = "{kind}"`', each, common)
                yield from _sections(f"{prefix}{name}.", each, definitions)
        elif name == "vary":
            yield f"## `[vary]`\n\n{entry['description']}"
        elif (found := _reference(entry)) in alike:
            tables = alike.pop(found)
            inner = _definition(found, definitions)
            # a table of tables only has no keys of its own to show
            if any(_reference(part) is None for part in inner["properties"].values()):
                yield _section(_title(tables), inner)
            yield from _sections(f"{tables[0][0]}.", inner, definitions)


def _title(tables: list[tuple[str, Schema]]) -> str:
    """Return the keys of tables that are alike, those that are there in space only at the end."""
    always = [f"`[{key}]`" for key, entry in tables if "only_in" not in entry]
    in_space = [f"`[{key}]`" for key, entry in tables if "only_in" in entry]
    return ", ".join(always) + (f"; in space {', '.join(in_space)}" if in_space else "")


def _section(title: str, schema: Schema, elsewhere: Sequence[str] = ()) -> str:
    """Return the section of a table, without rows that are elsewhere."""
    words = " ".join(schema["description"].split()).replace("``", "`")
    rows = [row for row in _rows(schema["properties"]) if row not in elsewhere]
    return f"## {title}\n\n{words}\n\n{_table(rows)}" if rows else f"## {title}\n\n{words}"


def _table(rows: Iterable[str]) -> str:
    head = ["| Key | Value | Unit | Default | Meaning |", "|---|---|---|---|---|"]
    return "\n".join([*head, *rows])


def _rows(properties: Schema) -> list[str]:
    """Return the rows of the keys of a table, except its kind and the tables in it."""
    rows = []
    for name, entry in properties.items():
        if _is_table(entry) or name == "vary" or "const" in entry:
            continue
        unit = unit_of(entry)
        plane, space = (
            allowed(entry, in_space=in_space).removesuffix(f" ({unit})")
            for in_space in (False, True)
        )
        cells = (
            f"`{name}`",
            plane if plane == space else f"{plane}; in space {space}",
            unit,
            _default(entry),
            entry["description"] + _WHERE[entry.get("only_in")],
        )
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return rows


def _default(entry: Schema) -> str:
    if "default" not in entry:
        return "must be given"
    if entry["default"] is None:
        return "none"
    values = [entry[key] for key in ("default", "default_in_space") if key in entry]
    return "; in space ".join(f"`{json.dumps(value)}`" for value in values)


def _reference(entry: Schema) -> str | None:
    """Return the definition that an entry is, if it is a table."""
    for member in (entry, *entry.get("anyOf", ()), *entry.get("allOf", ())):
        if "$ref" in member:
            return str(member["$ref"])
    return None


def _kinds(entry: Schema) -> dict[str, str] | None:
    """Return the definitions of a list of tables by their kind, if an entry is one."""
    discriminator = entry.get("items", {}).get("discriminator")
    return None if discriminator is None else discriminator["mapping"]


def _definition(found: str, definitions: Schema) -> Schema:
    return definitions[found.rpartition("/")[2]]


if __name__ == "__main__":
    for path, text in pages().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
