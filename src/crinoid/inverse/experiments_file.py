"""Files that describe several recorded experiments and the markers on the arm."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import Field

from crinoid.assembly.prepared import Prepared
from crinoid.inverse.experiment_record import ExperimentRecord, read_record
from crinoid.inverse.marker import Marker
from crinoid.inverse.unknowns import Unknowns
from crinoid.scenario import Mistake, Scenario, ScenarioError, got, refusal
from crinoid.scenario.document import RecordFile, anchor, parse
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import ListOf, dimension_conflicts


class ExperimentTable(Model):
    """A recorded experiment."""

    file: RecordFile
    name: str = entry("", "Its name in results; by default that of the file.")
    set: dict[str, Any] = entry({}, "Values of the scenario in this experiment, by key.")

    @property
    def called(self) -> str:
        """Its name in results."""
        return self.name or Path(self.file).stem


class Experiments(Model):
    """A file of experiments."""

    marker: ListOf[Marker] = entry((), "Markers on the arm.")
    experiment: ListOf[ExperimentTable] = Field(min_length=1, description="Recorded experiments.")

    def _conflicts(self) -> Iterator[Mistake]:
        for key, names in (
            ("marker", [each.name for each in self.marker]),
            ("experiment", [each.called for each in self.experiment]),
        ):
            for name, count in Counter(names).items():
                if count > 1:
                    index = len(names) - 1 - names[::-1].index(name)
                    yield Mistake(f"{key}.{index}.name", got(name, "differ from the others"))


def read_experiments(path: Path, prepared: Prepared, unknowns: Unknowns) -> list[ExperimentRecord]:
    """Read the records of a file of experiments (TOML), or a single record.

    Raises
    ------
    ScenarioError
        If a file is not valid or does not fit the scenario, with one line per mistake.
    """
    scenario = prepared.scenario
    if path.suffix.lower() != ".toml":
        return [read_record(path, scenario, prepared.system.inputs)]
    described = _read(path, scenario)
    several = len(described.experiment) > 1
    found: list[ExperimentRecord] = []
    for index, each in enumerate(described.experiment):
        settings, key = _flat(each.set), f"experiment.{index}"
        for name in settings:
            if name in unknowns.values(0 * unknowns.given):
                text = "is a number to find. Leave it out, or out of --of."
                raise refusal(f"{key}.set.{name}", text)
        try:
            case = Prepared(scenario.with_values(settings)) if settings else prepared
            case.check()
        except ScenarioError as error:
            raise ScenarioError(mistake.under(f"{key}.set") for mistake in error.mistakes) from None
        inputs = case.system.inputs
        try:
            record = read_record(Path(each.file), case.scenario, inputs, described.marker)
        except ScenarioError as error:
            mistakes = [Mistake(f"{key}.file", mistake.text) for mistake in error.mistakes]
            raise ScenarioError(mistakes) from None
        found.append(replace(record, name=each.called if several else "", settings=settings))
    return found


def _read(path: Path, scenario: Scenario) -> Experiments:
    try:
        document = parse(path.read_text("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise refusal("RECORD", f"{path}: byte {error.start} is not UTF-8") from None
    except OSError as error:
        raise refusal("RECORD", f"{path}: {error.strerror}") from None
    except ScenarioError as error:
        raise ScenarioError(mistake.under(path.name) for mistake in error.mistakes) from None
    anchor(document, path.absolute().parent)
    described, length = Experiments(**document), scenario.arm.length
    mistakes = list(dimension_conflicts(described, scenario.arm.dimension))
    for index, marker in enumerate(described.marker):
        if marker.s > length:
            text = got(marker.s, f"be at most {length:g} (m), arm.length")
            mistakes.append(Mistake(f"marker.{index}.s", text))
    if mistakes:
        raise ScenarioError(mistakes)
    return described


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return tables within tables by dotted key."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        key = f"{prefix}{name}"
        found |= _flat(value, f"{key}.") if isinstance(value, dict) else {key: value}
    return found
