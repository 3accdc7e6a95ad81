"""How a file is refused, and what it holds instead."""

from crinoid.scenario.errors import Mistake, ScenarioError

_NAMED = 12


def refusal(key: str, text: str) -> ScenarioError:
    """Return what says what is wrong with a file or with what is asked of it."""
    return ScenarioError([Mistake(key, text)])


def listed(names: list[str]) -> str:
    """Return names in a row, the first dozen of them."""
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")
