"""How to repeat a run: the command of a built-in scenario with its changes, or of a file."""

import shlex

from crinoid.foundation.status import Status
from crinoid.results.result import Result
from crinoid.scenario import Scenario, ScenarioError
from crinoid.scenario.document import flat
from crinoid.scenario.library import builtin_names, builtin_text, load

SAVED = "scenario.toml"
"""Name of the file that the page saves the scenario as."""
_MOST = 12  # most changes of a command


def repeat_command(run: Result) -> tuple[str, bool]:
    """Return the command that repeats a run, and whether it needs the scenario as a file."""
    rests = run.dataset.sizes["time"] == 1 and run.ended is Status.OK
    words = ["crinoid", "equilibrium" if rests else "run"]
    scenario, reason = run.readable
    settings = None if scenario is None or reason else _changes(scenario)
    if settings is None:
        return shlex.join([*words, SAVED]), True
    return shlex.join([*words, *settings]), False


def _changes(scenario: Scenario) -> list[str] | None:
    """Return the name of a built-in scenario and options that give a scenario; None without."""
    wanted = dict(flat(scenario.to_dict()))
    for name in builtin_names():
        if scenario.title not in builtin_text(name):
            continue
        known = dict(flat(load(name).to_dict()))
        changed = {key: value for key, value in wanted.items() if known.get(key) != value}
        settings = [f"{key}={_toml(value)}" for key, value in changed.items()]
        try:
            if len(settings) <= _MOST and load(name, settings) == scenario:
                return [name, *(word for each in settings for word in ("--set", each))]
        except ScenarioError:
            continue
    return None


def _toml(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
