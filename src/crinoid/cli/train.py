"""Training of a policy: progress, its files, and a table."""

from contextlib import suppress
from pathlib import Path

import numpy as np
from rich.table import Table

from crinoid.assembly.description import POLICY, is_policy
from crinoid.cli.display import new_table, progress_bar
from crinoid.cli.finding import finding, solvable
from crinoid.cli.folder import check_own, clear_own
from crinoid.cli.interruption import Interruption
from crinoid.foundation.status import Status
from crinoid.learning.settings import TrainingSettings
from crinoid.learning.training import EVALUATION_INTERVAL, Training, checkpoint_header
from crinoid.results.result import TRAINING
from crinoid.scenario import Scenario, refusal
from crinoid.view.export.formats import exports_of

CHECKPOINT = "training.npz"


def train_policy(
    scenario: Scenario, settings: TrainingSettings, folder: Path, *, resume: bool, force: bool
) -> str:
    """Train, save and draw how it went, and sum it up; return what went wrong."""
    checkpoint = folder / CHECKPOINT
    if resume and not checkpoint.exists():
        text = f"{checkpoint} does not exist. Name the folder of an interrupted training."
        raise refusal("--resume", text)
    replace = force or resume  # a continued training replaces its files
    with (
        finding(scenario, folder / TRAINING, "a training", force=replace, doubts=None) as found,
        Interruption() as interruption,
    ):
        if not replace:
            check_own(folder / POLICY, is_policy)
            check_own(checkpoint, checkpoint_header)
        with progress_bar() as bar:
            (task,) = bar.task_ids
            bar.update(task, total=settings.updates, completed=0, description="imitating")
            with solvable():
                training = Training(scenario, settings)
                if checkpoint.exists() and not replace:
                    training.check_same(checkpoint, "use --force")
                if resume:
                    training.restore(checkpoint)
                else:
                    training.begin()

            def report(training: Training) -> None:
                words = f"best {training.least:.3g}, error {1e3 * training.rows[-1][2]:.3g} mm"
                bar.update(task, completed=training.updates, description="training", reached=words)
                if training.updates % EVALUATION_INTERVAL == 0:
                    with suppress(OSError):  # such as a full disk: it may have room at the end
                        training.save(checkpoint)

            stopped = training.run(report, interruption.stop)
        clear_own(folder, exports_of(POLICY))  # an old export must not pass for the new policy
        wrong = "" if np.isfinite(training.least) else f"{Status.FAILED}: no policy could be run"
        if stopped:
            wrong = f"{Status.INTERRUPTED} after {training.updates} updates"
        notes = [f"{training.lost} stretches could not be run to their end"] * bool(training.lost)
        data = training.dataset(wrong or Status.OK.value)
        files = {CHECKPOINT: training.save, POLICY: training.write}
        found.show(data, training_table(training), notes=notes, files=files)
    return f"{wrong}; go on with --resume" if stopped else wrong


def training_table(training: Training) -> Table:
    """Return the numbers of the imitation and of the best policy."""
    first, best = training.rows[0], training.rows[training.best_row]
    rows = (
        ("updates", "0", f"{best[0]:.0f} of {training.updates}"),
        ("cost, held out", f"{first[1]:.4g}", f"{best[1]:.4g}"),
        ("tip error, RMS, held out", f"{1e3 * first[2]:.4g} mm", f"{1e3 * best[2]:.4g} mm"),
    )
    return new_table(training.scenario.title, ("", "imitation", "policy"), rows)
