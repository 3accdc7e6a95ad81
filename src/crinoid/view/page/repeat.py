"""How to repeat a run: the command of a built-in scenario with its changes, or of a file."""

import shlex

from crinoid.foundation.status import Status
from crinoid.results.result import Result
from crinoid.scenario import ScenarioError
from crinoid.scenario.document import flat
from crinoid.scenario.library import builtin_names, builtin_text, load

SAVED = "scenario.toml"  # name of the file that the page saves the scenario as
_MOST = 12  # most changes of a command


def repeat_command(run: Result) -> str:
    """Return the command that repeats a run; `SAVED` is its last word where it needs that file."""
    rests = run.dataset.sizes["time"] == 1 and run.ended is Status.OK
    words = ["crinoid", "equilibrium" if rests else "run"]
    scenario, reason = run.readable
    if scenario is None or reason:
        return shlex.join([*words, SAVED])
    wanted = dict(flat(scenario.to_dict()))
    for name in builtin_names():
        if scenario.title not in builtin_text(name):
            continue
        known = dict(flat(load(name).to_dict()))
        changed = {key: value for key, value in wanted.items() if known.get(key) != value}
        settings = [
            f"{key}={str(value).lower() if isinstance(value, bool) else value}"
            for key, value in changed.items()
        ]
        try:
            if len(settings) <= _MOST and load(name, settings) == scenario:
                options = (word for each in settings for word in ("--set", each))
                return shlex.join([*words, name, *options])
        except ScenarioError:
            continue
    return shlex.join([*words, SAVED])
