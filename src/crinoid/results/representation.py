"""Text representation of a result: its status and the first rows of its closing table."""

from contextlib import suppress

from crinoid.foundation.representation import titled
from crinoid.foundation.status import Status
from crinoid.results.result import Result
from crinoid.results.table import equilibrium_summary, summary
from crinoid.scenario import counted

_ROWS = 6  # most rows of the closing table


def represent(result: Result) -> tuple[str, dict[str, str]]:
    """Return title and status of a result, and the first rows of its closing table."""
    sizes = result.dataset.sizes
    many, nodes = sizes.get("time", 0), counted(sizes.get("node", 0), "node")
    arm = f"arm {'in space' if sizes.get('axis') == 3 else 'in the plane'} of {nodes}"
    rests = many == 1 and result.ended is Status.OK
    rows = {
        "run": f"equilibrium of an {arm}" if rests else f"{counted(many, 'saved instant')}, {arm}"
    }
    with suppress(Exception):  # a broken result needs a representation too
        found = equilibrium_summary(result) if rests else summary(result)
        for name, value, *other in found.rows[:_ROWS]:
            rows[name] = f"{value}, {other[0]} without control" if any(other[:1]) else value
    if result.notes:
        rows["notes"] = f"{len(result.notes)}, in result.notes"
    return titled("Result", str(result.dataset.attrs.get("title", "")), result.status), rows
