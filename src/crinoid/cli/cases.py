"""Cases of a plan, each checked before it is run."""

from crinoid.assembly.prepared import Prepared
from crinoid.scenario import Mistake, ScenarioError, shown
from crinoid.studies.sweep.plan import SweepDesign


def checked_case(plan: SweepDesign, run: int, key: str) -> Prepared:
    """Check a run of a plan, and return it; a mistake at ``key`` names its case."""
    try:
        prepared = Prepared(plan.case(run))
        prepared.check()
    except ScenarioError as error:
        values = plan.values(run).items()
        case = ", ".join(f"{name} = {shown(value)}" for name, value in values)
        mistakes = [Mistake(key, f"case {case}: {mistake}") for mistake in error.mistakes]
        raise ScenarioError(mistakes) from error
    return prepared
