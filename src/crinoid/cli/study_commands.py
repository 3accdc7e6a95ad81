"""The commands of many runs: comparison, tuning, identification, optimisation, sweep, training."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from crinoid.cli.command import (
    Force,
    ScenarioName,
    Settings,
    at_least,
    complete_key,
    end,
    folder_for,
    load_scenario,
    load_text,
    one_line_errors,
    option,
    out_option,
    resume_option,
    stop,
)
from crinoid.cli.interruption import Loading


@one_line_errors()
def compare(
    scenario: ScenarioName,
    controllers: Annotated[
        str, option("Kinds of controllers, with commas between them.", "KINDS")
    ] = "none,pid",
    seeds: Annotated[int, option("Number of seeds.")] = 10,
    first_seed: Annotated[int, option("The first one of them.")] = 0,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-compare")] = None,
    force: Force = False,
) -> None:
    """Run a scenario under several controllers over several seeds, and compare them."""
    kinds, every = _kinds_of(controllers), range(first_seed, first_seed + seeds)
    at_least(1, {"--seeds": seeds})
    at_least(0, {"--first-seed": first_seed})
    described = load_scenario(scenario, settings)
    folder = folder_for(out, scenario, "-compare", settings)
    with Loading():
        from crinoid.cli.compare import compare_controllers

    end(compare_controllers(described, kinds, every, folder, force=force))


def _kinds_of(text: str) -> list[str]:
    """Return the kinds of controllers in a list with commas."""
    from crinoid.scenario.control import KINDS
    from crinoid.scenario.errors import got, one_of, refusal, shown
    from crinoid.scenario.kinds import installed

    kinds = [kind.strip() for kind in text.split(",")]
    known = [kind for kind in (*KINDS, *installed("controllers")) if kind != "custom"]
    for kind in kinds:
        if kind not in known:
            text = got(kind, f"be {one_of(known)}, separated by commas")
            raise refusal("--controllers", text)
        if kinds.count(kind) > 1:
            text = f"got {shown(kind)} twice; must name each controller once"
            raise refusal("--controllers", text)
    return kinds


@one_line_errors()
def tune(
    scenario: ScenarioName,
    seeds: Annotated[int, option("Number of seeds that it is tuned for.")] = 4,
    iterations: Annotated[int, option("Largest number of trials from each start.")] = 25,
    margin: Annotated[float, option("Modulus margin that the loop is to keep; 0: none.")] = 0.5,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-tune")] = None,
    force: Force = False,
) -> None:
    """Tune a PID, LQG or MPC by gradient, over several seeds: each number by up to 1000 times."""
    from crinoid.scenario.errors import got, refusal

    if not 0 <= margin < 1:
        raise refusal("--margin", got(margin, "be at least 0 (no margin) and below 1"))
    at_least(1, {"--seeds": seeds, "--iterations": iterations})
    text = load_text(scenario, settings)
    folder = folder_for(out, scenario, "-tune", settings)
    with Loading():
        from crinoid.cli.inverse import tune_controller

    end(tune_controller(text, seeds, iterations, margin, folder, force=force))


@one_line_errors()
def identify(
    scenario: ScenarioName,
    record: Annotated[
        Path,
        typer.Argument(
            metavar="RECORD",
            show_default=False,
            help="What was measured: a CSV or netCDF file with times or holds and places of the "
            "tip, a log of ROS, a result, or a TOML file of markers and experiments.",
        ),
    ],
    of: Annotated[
        str,
        option(
            "Keys of numbers to find, each within a factor of 10000: arm.length,arm.density.",
            "KEY,KEY",
            default=False,
        ),
    ],
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-identify")] = None,
    force: Force = False,
) -> None:
    """Find stiffness, damping, drag and other numbers from recorded motions and holds."""
    from crinoid.scenario.errors import refusal

    keys = [each for each in (part.strip() for part in of.split(",")) if each]
    if not keys:
        hint = "Name keys of numbers, such as arm.youngs_modulus,water.drag_normal."
        raise refusal("--of", f"got no key. {hint}")
    _require_record(record)
    text = load_text(scenario, settings)
    folder = folder_for(out, scenario, "-identify", settings)
    with Loading():
        from crinoid.inverse.unknowns import Unknowns

    unknowns = Unknowns(text.scenario, keys)
    with Loading():
        from crinoid.cli.inverse import identify_numbers

    end(*identify_numbers(text, record, unknowns, folder, force=force))


def _require_record(record: Path) -> None:
    from crinoid.scenario.errors import refusal

    if not record.exists():
        raise refusal("RECORD", f"{record}: no such file")


@one_line_errors()
def estimate(
    scenario: ScenarioName,
    record: Annotated[
        Path,
        typer.Argument(
            metavar="RECORD",
            show_default=False,
            help="What was measured: a CSV or netCDF file with times, readings of the sensors and "
            "commands, a log of ROS, or a result.",
        ),
    ],
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-estimate")] = None,
    force: Force = False,
) -> None:
    """Estimate tip, shape and current from a log, with their standard deviations."""
    _require_record(record)
    described = load_scenario(scenario, settings)
    folder = folder_for(out, scenario, "-estimate", settings)
    with Loading():
        from crinoid.cli.estimate import estimate_states

    estimate_states(described, record, folder, force=force)


@one_line_errors()
def optimise(
    scenario: ScenarioName,
    over: Annotated[
        list[str],
        option(
            "Number to choose, and its range; with :log equal steps are equal ratios.",
            "KEY=FROM:TO",
            default=False,
            complete=complete_key,
        ),
    ],
    measure: Annotated[
        str, option("Measure to make least.", "MEASURE", name="--for", default=False)
    ],
    keep: Annotated[
        list[str] | None,
        option("Limit of a measure, in SI units.", "MEASURE<VALUE", default=False),
    ] = None,
    seeds: Annotated[int, option("How many seeds each trial is run with.", "N")] = 1,
    trials: Annotated[int, option("Largest number of trials.", "N")] = 160,
    rest: Annotated[
        bool, option("Judge the equilibrium at t = 0 instead of a run.", name="--at-rest")
    ] = False,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-optimise")] = None,
    force: Force = False,
) -> None:
    """Find the best numbers of arm, actuators, base or gains for a measure, within limits."""
    at_least(1, {"--seeds": seeds, "--trials": trials})
    text = load_text(scenario, settings)
    folder = folder_for(out, scenario, "-optimise", settings)
    with Loading():
        from crinoid.inverse.goal import Goal
        from crinoid.inverse.ranges import Ranges

    ranges, goal = Ranges(text.scenario, over), Goal(text.scenario, measure, keep or ())
    with Loading():
        from crinoid.cli.optimise import optimise_numbers

    end(*optimise_numbers(text, ranges, goal, seeds, trials, folder, rest=rest, force=force))


@one_line_errors()
def sweep(
    scenario: ScenarioName,
    vary: Annotated[
        list[str] | None,
        option(
            "What varies: FROM:TO:COUNT, FROM:TO:COUNT:log or A,B,C; with --sample also "
            "FROM:TO and FROM:TO:log. One component of a vector: flow.0.mean.1=0.05:0.3:6.",
            "KEY=VALUES",
            complete=complete_key,
        ),
    ] = None,
    sample: Annotated[
        str, option("How ranges without a count are filled: lhs, sobol or saltelli.", "KIND")
    ] = "grid",
    count: Annotated[
        int | None,
        option(
            "How many points to sample; of saltelli, blocks of as many as keys and two.",
            "N",
            default=False,
        ),
    ] = None,
    seeds: Annotated[int, option("How many seeds to run each with, from seed on.", "N")] = 1,
    batch: Annotated[
        int | None,
        option("Runs that are sent and saved together.", "N", default="up to 100, in 200 batches"),
    ] = None,
    workers: Annotated[
        int | None, option("Workers on this machine.", "N", default="one a core")
    ] = None,
    scheduler: Annotated[
        str | None,
        option(
            "Scheduler of dask.distributed whose workers are to run it.",
            "ADDRESS",
            default="this machine",
        ),
    ] = None,
    weights: Annotated[
        Path | None,
        option(
            "Histogram of speed of crinoid flow: the values of one key then have shares of time.",
            "FILE",
            default=False,
        ),
    ] = None,
    dry_run: Annotated[
        bool, option("Estimate the cost, and write nothing.", name="--dry-run")
    ] = False,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-sweep")] = None,
    resume: Annotated[bool, resume_option("sweep")] = False,
    force: Force = False,
) -> None:
    """Run a scenario with many values and seeds, on all cores or on a cluster."""
    at_least(1, {"--workers": workers})
    if workers is not None and scheduler is not None:
        stop("--workers: excludes --scheduler. Leave it out; the scheduler has its own workers.")
    if dry_run and (resume or force or weights is not None):
        text = "excludes --resume, --force and --weights. Leave them out; it writes nothing."
        stop(f"--dry-run: {text}")
    described = load_scenario(scenario, settings)
    folder = folder_for(out, scenario, "-sweep", settings)
    with Loading():
        from crinoid.studies.sweep.plan import SweepDesign

    plan = SweepDesign.of(
        described, vary or (), sampling=sample, count=count, seeds=seeds, batch=batch
    )
    with Loading():
        from crinoid.cli.sweep import WorkerOptions, estimate_sweep, run_sweep

    options = WorkerOptions(workers, scheduler)
    if dry_run:
        estimate_sweep(plan, options)
        return
    run = partial(run_sweep, sized=batch is not None, resume=resume, force=force)
    end(run(plan, folder, options, weights=weights))


@one_line_errors()
def train(
    scenario: ScenarioName,
    method: Annotated[str, option("Improvement: gradient.", "KIND")] = "gradient",
    teacher: Annotated[
        str, option("Teacher of the imitation: lqg, mpc, pid or none.", "KIND")
    ] = "lqg",
    draw: Annotated[
        list[str] | None,
        option(
            "Key that each episode draws.",
            "KEY=LOW:HIGH",
            default="stiffness, currents, sensor, tool",
            complete=complete_key,
        ),
    ] = None,
    arms: Annotated[int, option("Arms that are run at a time.", "N")] = 16,
    updates: Annotated[int, option("Largest number of updates.", "N")] = 1500,
    seed: Annotated[int, option("Seed of everything random.", "N")] = 0,
    settings: Settings = None,
    out: Annotated[Path | None, out_option("results/SCENARIO-train")] = None,
    resume: Annotated[bool, resume_option("training")] = False,
    force: Force = False,
) -> None:
    """Train a neural policy in simulation."""
    with Loading():
        from crinoid.learning.settings import TrainingSettings, drawn_keys

    how = TrainingSettings(method, teacher, arms, updates, seed)
    described = load_scenario(scenario, settings)
    folder = folder_for(out, scenario, "-train", settings)
    how = replace(how, draw=drawn_keys(described, draw))
    try:
        with Loading():
            from crinoid.cli.train import train_policy
    except ImportError as error:
        stop(f'training needs {error.name or "Gymnasium"}: pip install "crinoid[learn]"')

    end(train_policy(described, how, folder, resume=resume, force=force))
