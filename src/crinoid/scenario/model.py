"""Strict, frozen tables of a scenario, with plain messages for mistakes."""

import math
from collections.abc import Callable, Iterator
from difflib import get_close_matches
from functools import cache, partial
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from crinoid.scenario.errors import Mistake, ScenarioError, got, join, missing, one_of

Schema = dict[str, Any]

_Value = TypeVar("_Value")


class Model(BaseModel):
    """A table of a scenario.

    Raises
    ------
    ScenarioError
        From the constructor, with every mistake.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    # A model with its own constructor is built through it wherever it is nested, so each
    # table speaks about its own keys, and the table around it only puts its name in front.
    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            properties = properties_of(type(self))
            found = (
                mistake
                for detail in error.errors(include_url=False)
                for mistake in _translated(detail, properties, data)
            )
            # Every alternative of a union complains; they end up as the same line.
            raise ScenarioError(dict.fromkeys(found)) from None

    def model_post_init(self, context: Any, /) -> None:
        """Refuse keys that are valid alone but not together."""
        mistakes = list(self._conflicts())
        if mistakes:
            raise ScenarioError(mistakes)

    def mistake(self, name: str, must: str = "", hint: str = "") -> Mistake:
        """Return the mistake of the value at a dotted key; by default it breaks the schema.

        None is a missing value.
        """
        value: Any = self
        for part in name.split("."):
            value = value[int(part)] if isinstance(value, tuple) else getattr(value, part)
        say = partial(missing, hint=hint) if value is None else partial(got, value, hint=hint)
        if must:
            return Mistake(name, say(must))
        return _refused(name, properties_of(type(self))[name], say)

    def _conflicts(self) -> Iterator[Mistake]:
        """Yield the mistakes between keys that are valid alone."""
        yield from ()


def entry(default: _Value, description: str, **rules: Any) -> _Value:
    """Return the field of a key that may be left out, with the rules of pydantic's ``Field``."""
    value: _Value = Field(default=default, description=description, **rules)
    return value


def unknown_key(table: type[Model], name: str) -> Mistake:
    """Return the mistake for a key that a table does not have."""
    return _unknown(name, properties_of(table))


@cache
def properties_of(table: type[Model]) -> Schema:
    """Return the JSON schema of each key; it needs far more time than the table."""
    return dict(table.model_json_schema()["properties"])


def _translated(detail: Any, properties: Schema, data: dict[str, Any]) -> list[Mistake]:
    """Return one error of pydantic as mistakes."""
    kind, place = detail["type"], detail["loc"]
    if kind == "default_factory_not_called":  # because of another mistake
        return []
    cause = detail.get("ctx", {}).get("error")
    inner = cause.mistakes if isinstance(cause, ScenarioError) else None
    if not place:
        return [Mistake("", detail["msg"])] if inner is None else list(inner)
    key = str(place[0])
    if kind == "extra_forbidden":
        return [_unknown(key, properties)]
    if key not in properties:  # of a table with keys of any name
        if inner is None:
            return [Mistake(key, got(data[key], "be a table"))]
        return [mistake.under(key) for mistake in inner]
    schema = properties[key]
    if kind == "missing" and len(place) == 1:
        return [_refused(key, schema, missing)]

    value = data[key]
    if "additionalProperties" in schema and len(place) > 1:  # a table of any keys
        key, value = f"{key}.{place[1]}", value[place[1]]
        return [_refused(key, schema["additionalProperties"], partial(got, value))]
    for index in (part for part in place[1:] if isinstance(part, int)):
        # Of a union, or of a list that is too short, the whole is at fault.
        if len(_present(schema)) > 1 or index >= len(value):
            break
        key, value, schema = f"{key}.{index}", value[index], _item(schema, index)
    if inner is not None:
        return [mistake.under(key) for mistake in inner]
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        must = f"be {one_of(schema['discriminator']['mapping'])}"
        tag = detail["ctx"].get("tag")
        return [Mistake(join(key, "kind"), missing(must) if tag is None else got(tag, must))]
    if not _finite(value):
        must = "be a finite number" if isinstance(value, float) else "be finite numbers"
        return [Mistake(key, got(value, must))]
    return [_refused(key, schema, partial(got, value))]


def _refused(key: str, schema: Schema, say: Callable[[str], str]) -> Mistake:
    planar, spatial = allowed(schema), allowed(schema, in_space=True)
    in_space = say(f"be {spatial} with arm.dimension = 3") if spatial != planar else ""
    return Mistake(key, say(f"be {planar}"), in_space=in_space)


def _finite(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return all(map(_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def _unknown(name: str, properties: Schema) -> Mistake:
    by_lower = {key.lower(): key for key in properties}
    near = get_close_matches(name.lower(), by_lower, n=1)
    if near:
        return Mistake(name, "unknown key", by_lower[near[0]])
    return Mistake(name, f"unknown key; must be one of {', '.join(properties)}")


def _present(schema: Schema) -> list[Schema]:
    return [member for member in schema.get("anyOf", ()) if member.get("type") != "null"]


def _item(schema: Schema, index: int) -> Schema:
    found = _array(schema)
    item = found["prefixItems"][index] if "prefixItems" in found else found["items"]
    return {"unit": found["unit"], **item} if "unit" in found else item


def _array(schema: Schema) -> Schema:
    """Return the first alternative that is a list, with the keys of the whole."""
    if "prefixItems" in schema or "items" in schema:
        return schema
    shared = {key: value for key, value in schema.items() if key != "anyOf"}
    below = (_array({**member, **shared}) for member in _present(schema))
    return next((found for found in below if found), {})


def allowed(schema: Schema, *, in_space: bool = False) -> str:
    """Return the values that a JSON schema allows, in words, for a planar or a spatial arm."""
    present = _present(schema)
    if len(present) == 1:
        schema = {**present[0], **schema}
    words = schema.get("expects") or _words(schema)
    if in_space:
        words = schema.get("expects_in_space", words)
    return f"{words} ({schema['unit']})" if "unit" in schema else words


def _words(schema: Schema) -> str:
    if "enum" in schema or "const" in schema:
        return one_of(schema.get("enum") or [schema["const"]])
    match schema.get("type"):
        case "number":
            return f"a number{_bounds(schema)}"
        case "integer":
            return f"a whole number{_bounds(schema)}"
        case "string":
            return "text in quotes"
        case "boolean":
            return "true or false"
        case "array":
            items = schema.get("items", {})
            tables = "$ref" in items or "oneOf" in items
            return "a list of tables, each under [[ ]]" if tables else "a list"
        case _:
            return "a table, under single [ ]"


def _bounds(schema: Schema) -> str:
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
