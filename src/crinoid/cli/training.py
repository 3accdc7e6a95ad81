"""Training a policy: progress, its files, and a table."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from crinoid.assembly.description import POLICY, is_policy
from crinoid.cli.finding import place_of, prepare_one, save_finding
from crinoid.cli.folder import check_own
from crinoid.cli.interruption import Interruption
from crinoid.cli.lines import say_notes, say_written
from crinoid.cli.progress import progress_bar
from crinoid.export.files import exports_in
from crinoid.learning.settings import Settings
from crinoid.learning.training import LOOKS, Training, about_in, trained
from crinoid.learning.usual import usual_draws
from crinoid.result import TRAINING
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.status import Status

CHECKPOINT = "training.npz"


def drawn_keys(scenario: Scenario, given: Sequence[str] | None) -> dict[str, tuple[float, float]]:
    """Return the keys that episodes draw, with the smallest and the largest value of each."""
    if not given:
        return usual_draws(scenario)
    found = {}
    for each in given:
        key, _, pair = each.partition("=")
        try:
            low, high = map(float, pair.split(":"))
        except ValueError:
            text = f"got {each!r}, takes KEY=LOW:HIGH, such as arm.youngs_modulus=3e6:5e6"
            raise ScenarioError([Mistake("--draw", text)]) from None
        if low > high or key.strip() in found:
            text = "the smaller one first" if low > high else "each key once"
            raise ScenarioError([Mistake("--draw", f"got {each!r}, takes {text}")])
        found[key.strip()] = low, high
    return found


def train_policy(
    scenario: Scenario,
    settings: Settings,
    folder: Path,
    *,
    resume: bool,
    force: bool,
    console: Console,
) -> str:
    """Train, save and draw how it went, and sum it up; return what went wrong."""
    prepare_one(scenario, "a training").check()
    checkpoint = folder / CHECKPOINT
    if resume and not checkpoint.exists():
        text = f"there is no {checkpoint} to go on from; takes a training that was interrupted"
        raise ScenarioError([Mistake("--resume", text)])
    # what is gone on with is replaced
    with place_of(folder / TRAINING, force=force or resume), Interruption() as interruption:
        if not (force or resume):
            check_own(folder / POLICY, is_policy)
            check_own(checkpoint, about_in)
        with progress_bar(console) as bar:
            (task,) = bar.task_ids
            bar.update(task, total=settings.updates, completed=0, description="imitating")
            try:
                training = Training(scenario, settings)
                if checkpoint.exists() and not (force or resume):
                    training.check_same(checkpoint, "--force")
                if resume:
                    training.restore(checkpoint)
                else:
                    training.begin()
            except RuntimeError as error:
                raise ScenarioError([Mistake("", str(error))]) from error

            def report(training: Training) -> None:
                words = f"best {training.least:.3g}, error {1e3 * training.rows[-1][2]:.3g} mm"
                bar.update(task, completed=training.updates, description="training", reached=words)
                if training.updates % LOOKS == 0:
                    training.save(checkpoint)

            stopped = trained(training, report, interruption.stop)
        training.save(checkpoint)
        training.write(folder / POLICY)
        clear_exports(folder)
        wrong = "" if np.isfinite(training.least) else f"{Status.FAILED}: no policy could be run"
        if stopped:
            wrong = f"{Status.INTERRUPTED} after {training.updates} updates"
        files = save_finding(training.dataset(wrong or Status.OK.value), folder / TRAINING)
        console.print(training_table(training))
        if training.lost:
            say_notes(console, [f"{training.lost} stretches could not be run to their end"])
        say_written(console, [folder / POLICY, *files])
    return f"{wrong}; go on with --resume" if stopped else wrong


def clear_exports(folder: Path) -> None:
    """Remove what was exported of an earlier policy: no vehicle is to take it for the new one."""
    for path in exports_in(folder, Path(POLICY).stem):
        path.unlink(missing_ok=True)


def training_table(training: Training) -> Table:
    """Sum up a training: the imitation beside the policy that was kept."""
    first, best = training.rows[0], training.rows[training.kept]
    table = Table(title=training.scenario.title, title_justify="left")
    for name in ("", "imitation", "policy"):
        table.add_column(name, justify="right" if name else "left")
    table.add_row("updates", "0", f"{best[0]:.0f} of {training.updates}")
    table.add_row("cost, held out", *(f"{row[1]:.4g}" for row in (first, best)))
    table.add_row("tip error, RMS, held out", *(f"{1e3 * row[2]:.4g} mm" for row in (first, best)))
    return table
