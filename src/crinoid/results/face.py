"""Face of a result: how it ended, and its main numbers, in a few lines."""

import re
from contextlib import suppress

import numpy as np

from crinoid.foundation.face import titled
from crinoid.foundation.status import Status
from crinoid.results.errors import error_word
from crinoid.results.measure_labels import unit_of
from crinoid.results.metrics import MEASURES, RunStatistics, known
from crinoid.results.result import Result
from crinoid.results.table import equilibrium_summary
from crinoid.scenario import counted

_REST_ROWS = 6


def face_of(result: Result) -> tuple[str, dict[str, str]]:
    """Return title and status of a result, and its main numbers with units.

    A number that its data do not give is left out.
    """
    sizes = result.dataset.sizes
    many, nodes = sizes.get("time", 0), counted(sizes.get("node", 0), "node")
    named = str(result.dataset.attrs.get("title", ""))
    title = titled("Result", named, result.status)
    place = "in space" if sizes.get("axis") == 3 else "in the plane"
    rows: dict[str, str] = {"run": f"{counted(many, 'saved instant')}, arm {place} of {nodes}"}
    # a notebook or a debugger shows it, whatever it holds
    with suppress(Exception), np.errstate(all="ignore"):
        if many == 1 and result.ended is Status.OK:
            rows["run"] = f"equilibrium of an arm {place} of {nodes}"
            return title, rows | dict(equilibrium_summary(result).rows[:_REST_ROWS])
        scenario, begin = result.scenario, result.scenario.judged_from
        end = float(result.dataset["time"].values[-1])
        rows["run"] = f"{end:g} of {scenario.simulation.duration:g} s, {rows['run']}"
        since = f", from {begin:g} s on" if begin > 0 else ""
        rows[error_word(scenario)] = _told(result, "RMS {rms_error}, largest {max_error}") + since
        if result.uncontrolled is not None:
            rows["without control"] = _told(
                result.uncontrolled, "RMS {rms_error}, largest {max_error}"
            )
        loads = "largest force {max_base_force}, moment {max_base_moment}"
        rows["on the base"] = _told(result, loads)
        bends = "largest curvature {max_curvature}, surface strain {max_strain}"
        rows["bending"] = _told(result, bends)
    if result.notes:
        rows["notes"] = f"{len(result.notes)}, in result.notes"
    return title, rows


def _told(result: Result, words: str) -> str:
    """Return words with measures of a run at their names; nothing where it lacks one."""
    run, told = RunStatistics(result), {}
    for name in re.findall(r"{(\w+)}", words):
        value = known(MEASURES[name].read(run))
        if value is None:
            return ""
        told[name] = unit_of(MEASURES[name].attributes, abs(value)).text(value)
    return words.format(**told)
