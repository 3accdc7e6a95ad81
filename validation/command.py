"""The command: the chosen cases, their files, and a table of their checks."""

from collections.abc import Sequence
from pathlib import Path

import typer
from rich import box
from rich.table import Table

from crinoid.cli.command import MISSED, console, folder_for
from crinoid.cli.declaration import Command, Option, out
from crinoid.cli.display import listed, new_table, progress_bar, say_notes, show
from crinoid.cli.folder import claimed
from crinoid.cli.interruption import Interrupted, Interruption
from crinoid.foundation.status import Status
from crinoid.scenario import got, one_of, refusal
from validation.attempt import VALIDATION, Attempt, attempt, clear_record, write_record
from validation.case import Case, Check
from validation.cases import all_cases

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
_HEADS = ("case, quantity", "reference", "crinoid", "error", "tolerance", "holds")


Command(
    "validate",
    "validation.command:validate",
    "Run cases with a known answer, and compare; exit code 1 where one does not hold.",
    Option(
        "[CASE ...]",
        list[str],
        "Names of cases, as --list shows them.",
        False,
        name="cases",
        required=False,
    ),
    Option("--list", False, "List the cases, and run none.", name="show_list"),
    Option("--all", False, "Run the long cases too.", name="every"),
    Option("--peers", False, "Run the cases that need other programs too."),
    out("results/validation"),
    Option("--force", False, "Replace an earlier validation."),
    interrupted="interrupted",
).add_to(app)


def validate(
    cases: list[str] | None,
    out: Path | None,
    *,
    show_list: bool,
    every: bool,
    peers: bool,
    force: bool,
) -> tuple[str, int]:
    """Run the chosen cases, or list all."""
    folder, known = folder_for(out, "-".join(["validation", *(cases or ())])), all_cases()
    if show_list:
        list_cases(known)
        return "", 0
    wanted = chosen(known, cases or (), every=every, peers=peers)
    required = peers or bool(cases)
    return validate_cases(wanted, folder, required=required, force=force), MISSED


def chosen(cases: Sequence[Case], names: Sequence[str], *, every: bool, peers: bool) -> list[Case]:
    """Return the cases of some names, or without names the short ones that need no peer.

    ``every`` adds long ones, ``peers`` those that need other programs.
    """
    known = [case.name for case in cases]
    for name in names:
        if name not in known:
            raise refusal("CASE", got(name, f"be {one_of(known)}"))
    if names:
        return [case for case in cases if case.name in names]
    return [case for case in cases if (every or not case.long) and (peers or not case.needs)]


def list_cases(cases: Sequence[Case]) -> None:
    """Print name, kind and statement of cases."""
    width = max(len(case.name) for case in cases) + 2
    for case in cases:
        marks = ", ".join([case.kind, *["long"] * case.long, *case.needs])
        console.print(f"{case.name:{width}}{case.title} ({marks})", soft_wrap=True)


def validate_cases(cases: Sequence[Case], folder: Path, *, required: bool, force: bool) -> str:
    """Run cases, and save and show them; return what does not hold or went wrong.

    ``required`` says whether a case whose peer is not installed is wrong.
    """
    attempts: list[Attempt] = []
    with claimed(folder), Interruption() as interruption:
        if (folder / VALIDATION).exists() and not force:
            text = f"{folder} contains a validation. Choose another folder, or use --force to "
            raise refusal("--out", f"{text}replace it.")
        clear_record(folder)
        with progress_bar() as bar:
            bar.reset(bar.task_ids[0], total=len(cases), description="validating")
            for case in cases:
                bar.update(bar.task_ids[0], completed=len(attempts), reached=case.name)
                if interruption.release():
                    break
                try:
                    found = attempt(case)
                    interruption.stop()  # where a library has turned the request into an error
                except Interrupted:
                    if attempts:
                        break
                    raise
                attempts.append(found.save(folder))
                write_record(folder, attempts)
        say_notes(f"{each.case.name}: {each.trouble}" for each in attempts if each.trouble)
        files = [VALIDATION, *(name for each in attempts for name in each.files)]
        show(checks_table(attempts), (), [folder / name for name in files])
    failed = (each for each in attempts if not each.holds)
    wrong = [_wrong(each) for each in failed if required or not each.left_out]
    text = listed(wrong, VALIDATION)
    if len(attempts) < len(cases):
        stopped = f"{Status.INTERRUPTED} after {len(attempts)} of {len(cases)} cases, and saved"
        return f"{stopped}; {text}" if text else stopped
    return text


def checks_table(attempts: Sequence[Attempt]) -> Table:
    """Return a row for each case, and below it one for each of its checks."""
    rows: list[tuple[str, ...]] = []
    for each in attempts:
        if each.evidence is None:
            rows.append((each.case.name, *[""] * 4, "not run" if each.left_out else "failed"))
            continue
        order = "" if each.evidence.order is None else f"order {each.evidence.order:.2f}"
        rows.append((each.case.name, order, *[""] * 3, _yes(each.holds)))
        rows += [check_cells(check) for check in each.evidence.checks]
    return new_table(None, _HEADS, rows, box=box.SIMPLE, padding=(0, 1, 0, 0))


def check_cells(check: Check) -> tuple[str, ...]:
    """Return the row of a check."""
    unit = "" if check.unit == "1" else f" ({check.unit})"
    share = "%" if check.relative else ""
    error, tolerance = (
        f"{each * (100 if check.relative else 1):.2g}{share}"
        for each in (check.error, check.tolerance)
    )
    numbers = (f"{each:.5g}" for each in (check.reference, check.value))
    return (f"  {check.quantity}{unit}", *numbers, error, tolerance, _yes(check.holds))


def _yes(holds: bool) -> str:
    return "yes" if holds else "no"


def _wrong(each: Attempt) -> str:
    """Return the name of a case that does not hold, and what does not."""
    if each.evidence is None:
        return f"{each.case.name}{f': {each.trouble}' if each.left_out else ' failed'}"
    missed = [check.quantity for check in each.evidence.checks if not check.holds]
    return f"{each.case.name} does not hold: {listed(missed, VALIDATION)}"
