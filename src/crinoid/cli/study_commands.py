"""Commands of many runs, up to where JAX is loaded."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from crinoid.cli.command import stop
from crinoid.cli.interruption import Loading
from crinoid.foundation.cores import cores
from crinoid.scenario import Scenario, ScenarioText, refusal


def identify(
    text: ScenarioText, record: Path, of: str, folder: Path, *, force: bool
) -> tuple[str, int]:
    """Identify numbers of a scenario from a record."""
    keys = [each for each in (part.strip() for part in of.split(",")) if each]
    if not keys:
        hint = "Name keys of numbers, such as arm.youngs_modulus,water.drag_normal."
        raise refusal("--of", f"got no key. {hint}")
    with Loading():
        from crinoid.inverse.unknowns import Unknowns

    unknowns = Unknowns(text.scenario, keys)
    with Loading():
        from crinoid.cli.identify import identify_numbers

    return identify_numbers(text, record, unknowns, folder, force=force)


def optimise(
    text: ScenarioText, over: list[str], measure: str, keep: list[str] | None, **search: Any
) -> tuple[str, int]:
    """Optimise numbers of a scenario; ``search`` are the other values of `optimise_numbers`."""
    with Loading():
        from crinoid.inverse.goal import Goal
        from crinoid.inverse.ranges import Ranges

    ranges, goal = Ranges(text.scenario, over), Goal(text.scenario, measure, keep or ())
    with Loading():
        from crinoid.cli.optimise import optimise_numbers

    return optimise_numbers(text, ranges, goal, **search)


def sweep(
    scenario: Scenario,
    vary: list[str] | None,
    workers: int | None,
    scheduler: str | None,
    folder: Path,
    *,
    weights: Path | None,
    dry_run: bool,
    resume: bool,
    force: bool,
    **design: Any,
) -> str:
    """Run a sweep, or estimate its cost; ``design`` is that of `SweepDesign.of`."""
    if workers is not None and scheduler is not None:
        stop("--workers: excludes --scheduler. Leave it out; the scheduler has its own workers.")
    if dry_run and (resume or force):
        stop("--dry-run: excludes --resume and --force. Leave them out; it writes nothing.")
    with Loading():
        from crinoid.cli.weights import read_weights
        from crinoid.studies.sweep.plan import SweepDesign

    rows, shares = read_weights(weights) if weights else (None, None)
    plan = SweepDesign.of(scenario, vary or (), rows=rows, **design)
    with Loading():
        from crinoid.cli.sweep import estimate_sweep, run_sweep

    count = workers or cores()
    if dry_run:
        estimate_sweep(plan, count, scheduler)
        return ""
    run = partial(run_sweep, sized=design["batch"] is not None, resume=resume, force=force)
    return run(plan, folder, count, scheduler, shares=shares)


def train(
    scenario: Scenario,
    draw: list[str] | None,
    folder: Path,
    *,
    resume: bool,
    force: bool,
    **settings: Any,
) -> str:
    """Train a policy; ``settings`` are those of `TrainingSettings`."""
    with Loading():
        from crinoid.learning.settings import TrainingSettings, drawn_keys

    how = replace(TrainingSettings(**settings), draw=drawn_keys(scenario, draw))
    try:
        with Loading():
            from crinoid.cli.train import train_policy
    except ImportError as error:
        stop(f'training needs {error.name or "Gymnasium"}: pip install "crinoid[learn]"')

    return train_policy(scenario, how, folder, resume=resume, force=force)
