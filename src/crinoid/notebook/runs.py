"""A result as the figures see it."""

from crinoid.report import run
from crinoid.result import Result


def run_of(result: Result) -> run.Run:
    """Return a result and the one without control, as far as their shapes are finite."""
    results = {"result": result.dataset}
    if result.uncontrolled is not None:
        results["result without control"] = result.uncontrolled.dataset
    return run.run_of(results)
