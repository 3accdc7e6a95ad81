"""The scenario in the file of a result, as far as this version can read it."""

from contextlib import suppress
from functools import lru_cache
from typing import Any

from crinoid.scenario import Scenario, ScenarioError
from crinoid.scenario.document import parse


@lru_cache(maxsize=8)
def readable(text: str) -> tuple[Scenario | None, str]:
    """Return a scenario without its unknown keys, and why it is not the whole; empty if it is.

    None where more than unknown keys is wrong.
    """
    reason = ""
    try:
        document = parse(text)
    except ScenarioError as error:
        return None, error.lines[0]
    for _ in range(2):
        try:
            return Scenario(**document), reason
        except ScenarioError as error:
            reason = reason or error.lines[0]
            for mistake in error.mistakes:
                if mistake.text.startswith("unknown key"):
                    _remove(document, mistake.key)
    return None, reason


def _remove(document: Any, key: str) -> None:
    *path, last = key.split(".")
    with suppress(LookupError, ValueError, TypeError):
        for part in path:
            document = document[int(part) if isinstance(document, list) else part]
        del document[last]
