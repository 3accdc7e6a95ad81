"""A table of a scenario: strict, frozen, and clear about mistakes."""

import math
from collections.abc import Iterator
from difflib import get_close_matches
from functools import cache
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from crinoid.scenario.errors import Mistake, ScenarioError, join, one_of, shown

__all__ = ["Model", "unknown_key"]


class Model(BaseModel):
    """A table of a scenario.

    Raises
    ------
    ScenarioError
        From the constructor, naming every key at fault.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    # A model with its own constructor is built through it wherever it is nested, so each
    # table speaks about its own keys, and the table around it only puts its name in front.
    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise ScenarioError(_mistakes(type(self), data, error)) from None

    def model_post_init(self, context: Any, /) -> None:
        """Refuse keys that are each fine alone but not together."""
        mistakes = list(self._conflicts())
        if mistakes:
            raise ScenarioError(mistakes)

    def refused(self, name: str) -> Mistake:
        """Say what a key got and what it takes."""
        return _taking(name, f"got {shown(getattr(self, name))}", _properties(type(self))[name])

    def _conflicts(self) -> Iterator[Mistake]:
        """Yield what is wrong between keys that are each fine alone."""
        yield from ()


def unknown_key(table: type[Model], name: str) -> Mistake:
    """Say that a table has no such key, and which it has."""
    return _unknown(name, _properties(table))


@cache
def _properties(table: type[Model]) -> dict[str, Any]:
    """Return the JSON schema of each key; it needs far more time than the table."""
    return dict(table.model_json_schema()["properties"])


def _mistakes(model: type[Model], data: dict[str, Any], error: ValidationError) -> list[Mistake]:
    properties = _properties(model)
    found = (
        mistake
        for detail in error.errors(include_url=False)
        for mistake in _translated(detail, properties, data)
    )
    # Every alternative of a union complains; they end up as the same line.
    return list(dict.fromkeys(found))


def _translated(detail: Any, properties: dict[str, Any], data: dict[str, Any]) -> list[Mistake]:
    kind, place = detail["type"], detail["loc"]
    cause = detail.get("ctx", {}).get("error")
    if not place:
        known = isinstance(cause, ScenarioError)
        return list(cause.mistakes) if known else [Mistake("", detail["msg"])]
    name = str(place[0])
    if kind == "extra_forbidden":
        return [_unknown(name, properties)]
    if name not in properties:  # of a table that takes names of its own
        if isinstance(cause, ScenarioError):
            return [mistake.under(name) for mistake in cause.mistakes]
        return [Mistake(name, f"got {shown(data[name])}, takes a table")]
    schema = properties[name]
    if kind == "missing" and len(place) == 1:
        return [_taking(name, "missing", schema)]

    if "additionalProperties" in schema and len(place) > 1:  # a table of any keys
        key, value = f"{name}.{place[1]}", data[name][place[1]]
        return [_taking(key, f"got {shown(value)}", schema["additionalProperties"])]
    key, value = name, data[name]
    for index in (part for part in place[1:] if isinstance(part, int)):
        # Of a union, or of a list that is too short, the whole is at fault.
        if _alternatives(schema) or index >= len(value):
            break
        key, value, schema = f"{key}.{index}", value[index], _item(schema, index)
    if isinstance(cause, ScenarioError):
        return [mistake.under(key) for mistake in cause.mistakes]
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        takes = one_of(schema["discriminator"]["mapping"])
        tag = detail["ctx"].get("tag")
        got = "missing" if tag is None else f"got {shown(tag)}"
        return [Mistake(join(key, "kind"), f"{got}, takes {takes}")]
    if not _finite(value):
        takes = "a finite number" if isinstance(value, float) else "finite numbers"
        return [Mistake(key, f"got {shown(value)}, takes {takes}")]
    return [_taking(key, f"got {shown(value)}", schema)]


def _taking(key: str, got: str, schema: dict[str, Any]) -> Mistake:
    planar, spatial = _takes(schema), _takes(schema, in_space=True)
    in_space = f"{got}, takes {spatial}: arm.dimension = 3" if spatial != planar else ""
    return Mistake(key, f"{got}, takes {planar}", in_space=in_space)


def _finite(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return all(map(_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def _unknown(name: str, properties: dict[str, Any]) -> Mistake:
    by_lower = {key.lower(): key for key in properties}
    near = get_close_matches(name.lower(), by_lower, n=1)
    if near:
        return Mistake(name, "unknown key", by_lower[near[0]])
    return Mistake(name, f"unknown key, takes {', '.join(properties)}")


def _alternatives(schema: dict[str, Any]) -> bool:
    return len(_present(schema)) > 1


def _present(schema: dict[str, Any]) -> list[dict[str, Any]]:
    return [member for member in schema.get("anyOf", ()) if member.get("type") != "null"]


def _item(schema: dict[str, Any], index: int) -> dict[str, Any]:
    found = _array(schema)
    item = found["prefixItems"][index] if "prefixItems" in found else found["items"]
    return {"unit": found["unit"], **item} if "unit" in found else item


def _array(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the first alternative that is a list, with what is said of all alternatives."""
    if "prefixItems" in schema or "items" in schema:
        return schema
    below = (_array({**member, **_shared(schema)}) for member in _present(schema))
    return next((found for found in below if found), {})


def _shared(schema: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in schema.items() if key != "anyOf"}


def _takes(schema: dict[str, Any], *, in_space: bool = False) -> str:
    """Say in words what a JSON schema takes, for a planar or a spatial arm."""
    present = _present(schema)
    if len(present) == 1:
        schema = {**present[0], **schema}
    words = schema.get("takes") or _words(schema)
    if in_space:
        words = schema.get("takes_in_space", words)
    return f"{words} ({schema['unit']})" if "unit" in schema else words


def _words(schema: dict[str, Any]) -> str:
    if "enum" in schema or "const" in schema:
        return one_of(schema.get("enum") or [schema["const"]])
    match schema.get("type"):
        case "number" | "integer" as kind:
            noun = "a number" if kind == "number" else "a whole number"
            return f"{noun}{_bounds(schema)}"
        case "string":
            return "text in quotes"
        case "boolean":
            return "true or false"
        case "array":
            items = schema.get("items", {})
            tables = "$ref" in items or "oneOf" in items
            return "a list of tables, each under [[ ]]" if tables else "a list"
        case _:
            return "a table"


def _bounds(schema: dict[str, Any]) -> str:
    # Whole numbers without ".0", however pydantic writes a bound.
    limits = ("minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum")
    least, above, most, below = (
        int(bound) if isinstance(bound, float) and bound.is_integer() else bound
        for bound in map(schema.get, limits)
    )
    if least is not None and most is not None:
        return f" from {least} to {most}"
    lower = f" of {least} or more" if least is not None else ""
    lower = f" above {above}" if above is not None else lower
    upper = f" up to {most}" if most is not None else ""
    upper = f" below {below}" if below is not None else upper
    return f"{lower},{upper}" if lower and upper else lower + upper
