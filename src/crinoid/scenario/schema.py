"""JSON schema of a scenario, for editors."""

from typing import Any

from crinoid.scenario.actuator import ActuatorTable
from crinoid.scenario.controller import ControllerTable
from crinoid.scenario.flow_table import FlowTable
from crinoid.scenario.kinds import installed, installed_table
from crinoid.scenario.load import LoadTable
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import unit_of
from crinoid.scenario.scenario import Scenario
from crinoid.scenario.sensor import SensorTable

_LISTS: dict[str, tuple[str, type[Model]]] = {
    "load": ("loads", LoadTable),
    "flow": ("flows", FlowTable),
    "sensors": ("sensors", SensorTable),
    "actuator": ("actuators", ActuatorTable),
}
"""Keys of lists of tables, with the group of kinds that packages bring for each."""


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scenario, with the kinds that installed packages bring.

    Editors show descriptions and no key of ours, so units stand in the descriptions as well.
    """
    schema = Scenario.model_json_schema()
    tables = schema["$defs"]
    for key, (group, base) in _LISTS.items():
        items = schema["properties"][key]["items"]
        for kind in installed(group):
            table = installed_table(group, kind, base)
            reference = _added(tables, table)
            items.pop("$ref", None)  # of the base, which has no kind
            items.setdefault("oneOf", []).append({"$ref": reference})
            if "discriminator" in items:
                items["discriminator"]["mapping"][kind] = reference
    for kind in installed("controllers"):
        table = installed_table("controllers", kind, ControllerTable)
        tables["Control"]["properties"][kind] = {
            "$ref": _added(tables, table),
            "description": f"Settings of kind {kind}.",
        }
    for each in (schema, *tables.values()):
        for key in each["properties"].values():
            unit = unit_of(key)
            if unit and "description" in key:
                key["description"] += f" Unit: {unit}."
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _added(tables: dict[str, Any], table: type[Model]) -> str:
    """Add the schema of a table, and return the reference to it."""
    schema = table.model_json_schema()
    tables.update(schema.pop("$defs", {}))
    tables[table.__name__] = schema
    return f"#/$defs/{table.__name__}"
