"""One run: what there is of it already, the rest of it, and what went wrong."""

from collections.abc import Callable
from pathlib import Path

from crinoid.assembly.prepared import Prepared
from crinoid.result import RESULT, Result, ResultError
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.simulation import Progress, Tell, play
from crinoid.status import Status


def find_earlier(prepared: Prepared, folder: Path) -> Result | None:
    """Find the result to go on from; none where there is nothing yet."""
    scenario = prepared.scenario
    if not (folder / RESULT).exists():
        return None
    try:
        earlier = Result.load(folder, lazily=True)
        described = [run.scenario for run in (earlier, earlier.uncontrolled) if run is not None]
    except ResultError as error:
        raise ScenarioError([Mistake("--resume", str(error))]) from error
    except ScenarioError as error:
        text = f"the scenario in {folder / RESULT} cannot be read: {error.lines[0]}"
        raise ScenarioError([Mistake("--resume", text)]) from error
    duration = scenario.simulation.duration
    for each in described:
        try:
            same = each.with_values({"simulation.duration": duration}) == scenario
        except ScenarioError:  # such as a table of motion that ends before that
            same = False
        if not same:
            text = f"the run in {folder} is of another scenario; only its duration may be changed"
            raise ScenarioError([Mistake("--resume", text)])
        if duration < each.simulation.duration:
            text = f"the run in {folder} is of {each.simulation.duration} s already"
            raise ScenarioError([Mistake("--resume", text)])
    changed = [
        file
        for file, digest in earlier.digests.items()
        if prepared.digests.get(file, digest) != digest
    ]
    if changed:
        text = f"since the run in {folder} was begun {' and '.join(changed)} changed; takes what "
        text += "there was then, or a run from the start"
        raise ScenarioError([Mistake("--resume", text)])
    return earlier


def is_complete(earlier: Result, scenario: Scenario) -> bool:
    """Tell whether an earlier result has all that a scenario is to give."""
    runs = [earlier]
    if scenario.control.kind != "none" and scenario.control.compare:
        if earlier.uncontrolled is None:
            return False
        runs.append(earlier.uncontrolled)
    end = scenario.simulation.duration - 0.5 * scenario.simulation.time_step
    return all(run.ended is Status.OK and float(run.dataset["time"][-1]) > end for run in runs)


def attempt(
    prepared: Prepared,
    earlier: Result | None,
    folder: Path,
    report: Callable[[Progress], None],
    stop: Callable[[], bool],
    tell: Tell | None = None,
    into: Path | None = None,
) -> Result:
    """Run a scenario, or the rest of it."""
    try:
        return play(prepared, report=report, resume=earlier, stop=stop, tell=tell, into=into)
    except ResultError as error:
        raise ScenarioError([Mistake("--resume", f"the run in {folder}: {error}")]) from error


def trouble(result: Result, folder: Path, paths: list[Path]) -> str:
    """Say what went wrong, and which other folder it is in; nothing where all is well."""
    aside = ""
    if paths and paths[0].parent != folder:
        aside = f"saved in {paths[0].parent}, the finished result in {folder} stays"
    if result.failure:
        return f"{result.failure}; {aside}" if aside else result.failure
    if result.interrupted:
        stopped = result if result.ended is Status.INTERRUPTED else result.uncontrolled
        assert stopped is not None
        if aside:
            return f"{stopped.status}; {aside}"
        return f"{stopped.status}; what there is has been saved, --resume goes on from there"
    return ""
