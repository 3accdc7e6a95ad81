"""Write the tables of variables of `docs/reference/result.md` from the list of them.

    python docs/make_result_reference.py

Run it after a change to `crinoid.foundation.result_variables`; `tests/project/test_docs.py` asks
for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from crinoid.foundation.result_variables import VARIABLES, Variable

PAGE = Path(__file__).with_name("reference") / "result.md"
BEGIN, END = "<!-- tables: begin -->", "<!-- tables: end -->"

_GROUPS = {
    ("", "plane"): "",
    ("space",): "With `arm.dimension = 3` every `axis` has three labels. There is no "
    "`tip_angle_target`, and these variables are new or of another shape.",
    ("vehicle", "vehicle plane", "vehicle space"): "With `vehicle.mass` there are also",
    ("estimate", "estimate plane", "estimate space", "estimate shape", "estimate current"): "With "
    '`control.kind = "lqg"` or `"mpc"` there are also the estimates of the observer '
    "([Estimate the state from a log](../how-to/estimate.md)), and of each but `estimate_time` its "
    "standard deviation, `NAME_std`.",
    ("obstacles",): "With `[[obstacle]]` there are also",
    ("bodies", "bodies plane", "bodies space"): "With a free obstacle, one with a `mass`, there "
    "are also, of all obstacles,",
    ("solids",): "With an `[[obstacle]]` from a file, of kind `mesh` or `seabed`, there are also",
    ("self",): "With `contact.self = true` there are also",
    ("hull",): "With `vehicle.hull` there are also",
    ("tool",): "With `[tool]` there is also",
    ("actuators",): "With actuators in addition to the base's channels there are also",
    (
        "lines",
    ): 'With `drive = "length"` of a tendon or `drive = "volume"` of a chamber there is also',
}


def reference() -> str:
    """Return the tables, those of an arm in space and of obstacles apart."""
    return "\n\n".join(
        "\n\n".join(filter(None, [text, _table(_listed(where))])) for where, text in _GROUPS.items()
    )


def updated(text: str) -> str:
    """Return a page with its tables renewed."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n\n{reference()}\n\n{END}{after}"


def _listed(where: Iterable[str]) -> Iterator[Variable]:
    """Yield the variables of a group except the standard deviations of others."""
    for each in VARIABLES:
        if each.where in where and not each.name.endswith("_std"):
            yield each


def _table(variables: Iterable[Variable]) -> str:
    rows = ["| Name | Dimensions | Unit | Meaning |", "|---|---|---|---|", *map(_row, variables)]
    return "\n".join(rows)


def _row(variable: Variable) -> str:
    unit = variable.unit or f"by `{variable.dims[-1]}_unit`"
    meaning = f"{variable.meaning}; {variable.more}" if variable.more else variable.meaning
    return f"| `{variable.name}` | {', '.join(variable.dims)} | {unit} | {meaning} |"


if __name__ == "__main__":
    PAGE.write_text(updated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
