"""The static equilibrium of a scenario: a result with one instant."""

from __future__ import annotations

import time

from crinoid.assembly.prepared import Prepared, at_rest, require_one_case
from crinoid.compilation import ONCE, compiled
from crinoid.diagnostics.plausibility import plausibility_warnings
from crinoid.dynamics.resting import stand
from crinoid.results.result import Result
from crinoid.scenario.library import Source, scenario_of
from crinoid.scenario.scenario import AT_REST
from crinoid.simulation.chunk import one_instant
from crinoid.simulation.conclusion import conclude, dataset_builder, start_failure
from crinoid.simulation.run import SimulationError, begin
from crinoid.simulation.setup import set_up


def equilibrium(scenario: Source) -> Result:
    """Find the static equilibrium of a scenario at time zero: a result with one instant.

    Parameters
    ----------
    scenario : Scenario, str or path
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.

    Returns
    -------
    Result

    Raises
    ------
    SimulationError
        If none was found.
    ScenarioError
        If a file that the scenario names is not valid.
    ValueError
        If the scenario describes several cases (`crinoid.Scenario.cases`).

    Examples
    --------
    >>> scenario = crinoid.load("still-water", ["arm.nodes=5", "simulation.duration=0.2"])
    >>> rest = crinoid.equilibrium(scenario)
    >>> rest.dataset.tip_position[-1].round(2).values.tolist()  # x, z (m)
    [0.46, -9.83]
    """
    described = scenario_of(scenario)
    require_one_case(described)
    return settle(Prepared(at_rest(described)))


def settle(prepared: Prepared, *, notes: bool = True) -> Result:
    """Find the static equilibrium of a scenario that `at_rest` gave; judge it with ``notes``."""
    started = time.perf_counter()
    warnings = plausibility_warnings(prepared, AT_REST) if notes else []
    setup = set_up(prepared, notes=False)._replace(warnings=warnings)
    carry, first = begin(setup.loop, _stand(setup.loop.system, setup.state))
    wall_time = time.perf_counter() - started
    dataset = dataset_builder(setup)(one_instant(first), None)
    result = conclude(setup, carry, dataset, start_failure(setup), None, wall_time)
    if result.failure:
        raise SimulationError(result)
    return result


_stand = compiled(**ONCE)(stand)
