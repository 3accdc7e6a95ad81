"""The linear model of a scenario: its file, the response of the tip, and a summary."""

from pathlib import Path

import numpy as np
from rich.table import Table

from crinoid.analysis.linearisation import find_state_space
from crinoid.analysis.model_files import FORMATS
from crinoid.analysis.sampled_plant import GROWS
from crinoid.analysis.state_space import RESPONSE, SWINGS, StateSpaceModel
from crinoid.cli.command import console
from crinoid.cli.display import new_table
from crinoid.cli.finding import finding
from crinoid.cli.folder import clear_own
from crinoid.foundation.representation import with_units
from crinoid.scenario import Scenario, ScenarioError, refusal

_MOST_POLES = 8


def show_linearisation(
    scenario: Scenario, folder: Path, *, to: str, order: int | None, force: bool
) -> None:
    """Linearise a scenario, save and draw the model, and sum it up."""
    place, name = folder / RESPONSE, f"linear-model.{to}"
    with finding(scenario, place, "a linear model", force=force, others=[name]) as found:
        with console.status("linearising"):
            full = find_state_space(found.prepared)
            try:
                model = full if order is None else full.reduced(order)
            except ScenarioError as error:
                raise refusal("--order", error.mistakes[0].text) from error
            response = model.tip_response()
        table, lines, files = _poles_table(model), _lines(model, full), {name: model.save}
        found.show(response, table, lines=lines, notes=model.notes, files=files)
        # another model
        clear_own(folder, [f"linear-model.{form}" for form in FORMATS if form != to])


def _lines(model: StateSpaceModel, full: StateSpaceModel) -> list[str]:
    lines = [
        model.words,
        f"inputs: {', '.join(with_units(model.inputs, model.input_units))}",
        f"outputs: {', '.join(with_units(model.outputs, model.output_units))}",
    ]
    if model is not full:
        lines.append(f"error bound {model.error_bound:.3g} of {full.order} states, scaled")
    elif full.usual_order < full.order:
        lines.append(f"--order {full.usual_order} keeps all that matters to 1e-5, as LQG does")
    return lines


def _poles_table(model: StateSpaceModel) -> Table:
    found: dict[tuple[str, str, str], None] = {}  # equal ones once
    for pole in model.poles[model.poles.imag >= 0]:
        swings = pole.imag > SWINGS * abs(pole)
        frequency = f"{pole.imag / (2 * np.pi):.4g}" if swings else "-"
        damping = f"{-pole.real / abs(pole):.3g}" if swings else "-"
        lasts = f"{-1 / pole.real:.3g}" if pole.real < 0 else "grows"
        if abs(pole.real) * model.period <= GROWS:
            lasts = "lasts"
        found[frequency, damping, lasts] = None
    rows = [(str(number), *each) for number, each in enumerate([*found][:_MOST_POLES], 1)]
    heads = ("slowest\npole", "frequency\n(Hz)", "damping\nratio", "time\nconstant (s)")
    return new_table(model.title, heads, rows)
