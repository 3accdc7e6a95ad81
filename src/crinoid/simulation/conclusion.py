"""The end of a run: from its instants to its result, with what is told of it."""

import numpy as np
import xarray as xr

from crinoid.assembly.prepared import Prepared
from crinoid.dataset import Instants, build_dataset, describe
from crinoid.dimensionless import dimensionless, with_swings
from crinoid.dynamics import Outcome
from crinoid.ledger import find_defect
from crinoid.notes import notes, tool_notes, torn
from crinoid.record import Record
from crinoid.result import Result, named_leaves
from crinoid.ringing import unresolved
from crinoid.signals import signals
from crinoid.simulation.failure import command_failure, step_failure
from crinoid.simulation.loop import LoopState
from crinoid.simulation.setup import Setup
from crinoid.simulation.sink import Build
from crinoid.status import Status

__all__ = ["attributes_of", "builder", "conclude"]


def builder(prepared: Prepared, setup: Setup) -> Build:
    """Return what makes data of the instants of a run."""
    loop, scenario = setup.loop, prepared.scenario

    def build(kept: Record, before: float | None) -> xr.Dataset:
        system, diameters = loop.system, scenario.arm.diameters
        run, modes = Instants(system, kept, before), setup.modes
        return build_dataset(
            run,
            diameters,
            signals(kept, setup.plan.inputs, loop.readings, system.forces.lines),
            dimensionless(run.relative_flow, run.tangent, np.array(diameters), scenario, modes),
        )

    return build


def conclude(
    prepared: Prepared,
    setup: Setup,
    carry: LoopState,
    dataset: xr.Dataset,
    trouble: str,
    failed: Outcome | None,
    wall_time: float,
    *,
    with_ledger: bool = True,
) -> Result:
    """Return the result of a run that is over, from all its instants.

    Parameters
    ----------
    prepared, setup
        What was run.
    carry
        The state at its end.
    dataset
        Its instants.
    trouble
        What ended it early, other than a step that failed; empty if nothing did.
    failed
        The outcome of a step that failed.
    wall_time
        What it took (s).
    with_ledger
        Whether its energies are to balance: not where numbers of the arm were changed meanwhile.
    """
    scenario, system = prepared.scenario, setup.loop.system
    dataset = with_swings(dataset)
    defect = None
    step_energy, rings = unresolved(dataset, system)
    if with_ledger:
        defect = find_defect(dataset, scenario, float(system.settings.floor), step_energy)
    if failed is not None:
        time = float(carry.state.time)
        trouble = command_failure(system.inputs, np.asarray(carry.command).tolist(), time)
        if not trouble:
            trouble = step_failure(scenario, system, carry.state, failed, dataset, defect)
    elif not trouble:
        trouble = torn(dataset)
        if defect is not None and defect.failed is not None:
            trouble = defect.failure
    told = [*prepared.notes(), *setup.doubts, *setup.loop_doubts, *notes(dataset, scenario)]
    told += [*tool_notes(scenario.tool, carry.state.grip), *([rings] if rings else [])]
    if defect is not None and defect.told not in trouble:
        told.append(defect.note)
    dataset.attrs = attributes_of(prepared, trouble or Status.OK.value, wall_time, told)
    return Result(dataset, named_leaves(carry))


def attributes_of(
    prepared: Prepared, status: str, wall_time: float, told: list[str]
) -> dict[str, object]:
    """Return the attributes of a result."""
    return describe(prepared.scenario) | {
        "status": status,
        "wall_time": wall_time,
        "notes": "\n".join(told),
        # as sha256sum writes and checks it
        "files": "\n".join(f"{digest}  {file}" for file, digest in prepared.digests.items()),
    }
