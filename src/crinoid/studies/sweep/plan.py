"""The plan of a sweep: its runs, and the batches that they are run in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w
from jaxtyping import Float, Int

from crinoid.foundation.version import __version__
from crinoid.scenario import Scenario, ScenarioError, got, one_of, refusal, shown
from crinoid.scenario.document import digests, parse, value_at
from crinoid.scenario.errors import mistakes_at
from crinoid.scenario.library import Source, scenario_of
from crinoid.scenario.variation import Levels, Span, case_words, read_variation
from crinoid.studies.design import SEED, Design
from crinoid.studies.sweep.sampling import SAMPLINGS, points_of, sample

PLAN = "plan.toml"  # name of the file of a plan
MOST_RUNS, _MOST_FILES = 10_000_000, 100_000
_MOST_BATCHES, _MOST_IN_A_BATCH = 200, 100
ROWS = "rows"  # sampling by rows, each with the values at one place of all lists; its axis
_SAMPLE = "\0sample"  # name of the axis of all keys that are sampled together
_FIRST = 100  # most cases that are checked before anything slow is loaded
_FIXED = ("simulation", "output")  # tables whose numbers change the compiled programs
_NUMBERS = dict.fromkeys(("count", "seeds", "batch"), int)
_KINDS = {"sampling": str, **_NUMBERS, **dict.fromkeys(("files", "varied", "scenario"), dict)}
"""Keys of the file of a plan, and the types of their values."""


class Batch(NamedTuple):
    """Runs that one worker runs together."""

    runs: Int[np.ndarray, " run"]  # their numbers, from 1
    structure: int  # index of their structure


@dataclass(frozen=True)
class SweepDesign(Design):
    """All runs of a sweep: every combination of values, or of rows or samples, and seeds.

    The ``seed`` of the scenario is the first of the seeds, and draws the samples.
    """

    axes: Mapping[str, Levels] = field(init=False, repr=False, compare=False)
    varied: Mapping[str, Span | list[Any]] = field(default_factory=dict)
    """Values of each key that varies: a list, or a `Span`, which without a count is sampled."""
    sampling: str = "grid"
    """``grid`` of all combinations, ``rows`` of values, ``lhs``, ``sobol`` or ``saltelli``."""
    count: int = 1  # number of sampled points, or of blocks of points (`sample`)
    seeds: int = 1  # number of seeds of each combination
    batch: int = 1  # largest number of runs in a batch
    files: Mapping[str, str] = field(default_factory=dict)  # digest of each file of the scenario

    def __post_init__(self) -> None:
        """Set the axes: values of keys, samples, seeds."""
        axes: dict[str, Levels] = {
            key: Levels.of(key, values.values() if isinstance(values, Span) else values)
            for key, values in self.varied.items()
            if key not in self._spans
        }
        if self.sampling == ROWS:
            axes = {ROWS: Levels.together([*axes.values()])}
        if self._spans:
            points = points_of(self.sampling, self.count, len(self._spans))
            axes[_SAMPLE] = Levels(points, self._sampled)
        if self.seeds > 1:
            axes[SEED] = Levels.of(SEED, range(self.scenario.seed, self.scenario.seed + self.seeds))
        object.__setattr__(self, "axes", axes)

    @staticmethod
    def of(
        scenario: Source,
        variations: Sequence[str],
        *,
        sampling: str = "grid",
        count: int | None = None,
        seeds: int = 1,
        batch: int | None = None,
        rows: Mapping[str, list[Any]] | None = None,
    ) -> SweepDesign:
        """Return the plan of a scenario, its ``vary`` and ``--vary``, or ``rows`` by key."""
        described = scenario_of(scenario)
        varied: dict[str, Span | list[Any]] = dict(described.vary)
        known = set()
        for text in variations:
            key, values = read_variation(text)
            if key in known:
                raise refusal("--vary", f"got {key} twice; must name each key once")
            known.add(key)
            varied[key] = values
        if rows:
            if sampling != "grid" or varied.keys() - rows.keys():
                hint = "Leave them out: its rows are all cases."
                raise refusal("--weights", f"excludes --vary of other keys and --sample. {hint}")
            for key in known:
                given = varied[key]
                values = given if isinstance(given, list) else given.values() if given.count else []
                there = {f"{each:.6g}" for each in values if isinstance(each, int | float)}
                if lacking := {f"{each:.6g}" for each in rows[key]} - there:
                    text = f"{key} lacks {min(lacking)}, which the table of --weights has"
                    raise refusal("--vary", f"{text}. Leave it out: its rows are all cases.")
            varied, sampling = dict(rows), ROWS
        elif sampling == ROWS:
            raise refusal("--sample", "rows needs --weights FILE, which has them")
        alone = described.with_values({})
        found = {
            key: values if isinstance(values, Span) else _settled(alone, key, values)
            for key, values in varied.items()
        }
        _check(found, sampling, count, seeds, batch)
        read = digests({**alone.to_dict(), "vary": found})
        plan = SweepDesign(alone, found, sampling, count or 1, seeds, files=read)
        plan = replace(plan, batch=batch or min(_MOST_IN_A_BATCH, -(-plan.runs // _MOST_BATCHES)))
        plan._check_runs()
        for run in plan.examples(_FIRST)[:_FIRST]:
            with mistakes_at(plan.option, case_words(plan.values(run))):
                plan.case(run)
        return plan

    @property
    def option(self) -> str:
        """The option of the command that gives the values."""
        return "--weights" if self.sampling == ROWS else "--vary"

    @property
    def steps(self) -> int:
        """Time steps of all runs, as many each as the scenario has."""
        return self.runs * self.scenario.simulation.steps

    @property
    def keys(self) -> list[str]:
        """Keys that differ between runs; ``seed``, where there are several, is the last one."""
        return [*self.varied, *([SEED] if self.seeds > 1 else [])]

    def values(self, run: int) -> dict[str, Any]:
        """Return the values of a run by key, numbered from 1; the last key changes fastest."""
        found = super().values(run)
        return {key: found[key] for key in self.keys}

    @property
    def sampled(self) -> list[str]:
        """Keys that are sampled."""
        return list(self._spans)

    def by_point(self, values: Float[np.ndarray, " run"]) -> Float[np.ndarray, "point other"]:
        """Return a number of each run by the sampled point, and by all else that varies."""
        sizes = {name: levels.count for name, levels in self.axes.items()}
        found = np.moveaxis(values.reshape(*sizes.values()), list(sizes).index(_SAMPLE), 0)
        return found.reshape(sizes[_SAMPLE], -1)

    @cached_property
    def batches(self) -> list[Batch]:
        """Batches of at most ``batch`` runs, each of one structure."""
        return [
            Batch(runs, structure)
            for structure, all_runs in enumerate(self.structures)
            for runs in np.split(all_runs, range(self.batch, all_runs.size, self.batch))
        ]

    @cached_property
    def structures(self) -> list[Int[np.ndarray, " run"]]:
        """The runs that share their compiled programs, judged by their values."""
        sizes = [levels.count for levels in self.axes.values()]
        places = np.unravel_index(np.arange(self.runs), sizes) if sizes else ()
        structure = np.zeros(self.runs, np.int64)
        for name, place in zip(self.axes, places, strict=True):
            if name in self._structural:
                kinds = self._kinds[name]
                structure = structure * (kinds.max() + 1) + kinds[place]
        order = np.argsort(structure, kind="stable")
        return np.split(order + 1, np.flatnonzero(np.diff(structure[order])) + 1)

    def examples(self, most: int) -> list[int]:
        """Return representative runs: of each structure, each value, and the ends of samples.

        Of a key with more than ``most`` values there are as many, its ends among them.
        """
        found, firsts, stride = set[int](), np.ones(1, int), 1
        for name, levels in reversed([*self.axes.items()]):
            if name == _SAMPLE:
                samples = self._samples
                places = np.concatenate((samples.argmin(axis=0), samples.argmax(axis=0)))
            else:
                places = np.linspace(0, levels.count - 1, min(most, levels.count)).astype(int)
            found.update(int(place) * stride + 1 for place in places)
            if name in self._structural:  # their runs are not counted out, which is slow
                _, first = np.unique(self._kinds[name], return_index=True)
                firsts = (firsts + stride * first[:, None]).ravel()
            stride *= levels.count
        return sorted(found.union(firsts.tolist()))

    def to_toml(self) -> str:
        """Return all of it as TOML; `from_toml` gives it back."""
        return tomli_w.dumps(self.to_dict())

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as tables."""
        return {
            "version": __version__,
            "sampling": self.sampling,
            "count": self.count,
            "seeds": self.seeds,
            "batch": self.batch,
            "files": dict(self.files),
            "varied": {k: str(v) if isinstance(v, Span) else v for k, v in self.varied.items()},
            "scenario": self.scenario.to_dict(),
        }

    @staticmethod
    def from_toml(text: str) -> SweepDesign:
        """Read a plan that `to_toml` wrote; a `ScenarioError` if it is none of this version."""
        found = parse(text)
        if (version := found.pop("version", None)) != __version__:
            raise refusal("version", got(version, f"be {shown(__version__)}"))
        for name, kind in _KINDS.items():
            if type(found.get(name)) is not kind:
                raise refusal(name, got(found.get(name), f"be of type {kind.__name__}"))
        varied = {
            key: read_variation(f"{key}={values}")[1] if isinstance(values, str) else values
            for key, values in found.pop("varied").items()
        }
        for key, values in varied.items():
            if not values or not isinstance(values, (Span, list)):
                raise refusal(f"varied.{key}", got(values, "be a list of values"))
        scenario = Scenario.from_dict(found.pop("scenario"))
        count = None if found["sampling"] in ("grid", ROWS) else found["count"]
        _check(varied, found["sampling"], count, found["seeds"], found["batch"])
        plan = SweepDesign(scenario, varied, **found)
        plan._check_runs()
        return plan

    def _check_runs(self) -> None:
        if self.runs > MOST_RUNS:
            raise refusal(self.option, f"makes {self.runs} runs; must make at most {MOST_RUNS}")
        structures = prod(self.axes[key].count for key in self._structural)
        batches = max(structures, -(-self.runs // self.batch))
        if batches > _MOST_FILES:
            text = f"makes {batches} batches, a file each; must make at most {_MOST_FILES}. "
            raise refusal(
                "--batch", text + "Raise it, or give keys such as arm.nodes fewer values."
            )

    @cached_property
    def _structural(self) -> set[str]:
        """Keys whose values change the compiled programs."""
        return {
            key
            for key, levels in self.axes.items()
            if key not in (_SAMPLE, SEED)
            and not all(_is_number(self.scenario, *each) for each in levels.at(0).items())
        }

    @cached_property
    def _kinds(self) -> dict[str, Int[np.ndarray, " level"]]:
        """The kind of each level of structural keys: equal ones share their compiled programs."""
        found = {}
        for key in self._structural:
            kinds: dict[str, int] = {}
            words = (repr(self.axes[key].at(level)) for level in range(self.axes[key].count))
            found[key] = np.array([kinds.setdefault(each, len(kinds)) for each in words])
        return found

    @cached_property
    def _spans(self) -> dict[str, Span]:
        return {k: v for k, v in self.varied.items() if isinstance(v, Span) and v.count is None}

    @cached_property
    def _samples(self) -> Float[np.ndarray, "point key"]:
        return sample(self.sampling, self.count, len(self._spans), self.scenario.seed)

    def _sampled(self, place: int) -> dict[str, Any]:
        parts = zip(self._spans.items(), self._samples[place], strict=True)
        return {key: span.at(float(part)) for (key, span), part in parts}


def read_plan(folder: Path) -> SweepDesign:
    """Read the plan of a sweep in a folder."""
    path = folder / PLAN
    try:
        return SweepDesign.from_toml(path.read_text("utf-8"))
    except FileNotFoundError:
        text = "does not exist. Name the folder of a sweep."
    except ScenarioError as error:
        text = error.lines[0]
    except (UnicodeDecodeError, KeyError, TypeError, AttributeError) as error:
        text = f"not the plan of a sweep ({' '.join(str(error).split())})"
    raise refusal(str(path), text)


def _check(
    varied: Mapping[str, Span | list[Any]],
    sampling: str,
    count: int | None,
    seeds: int,
    batch: int | None,
) -> None:
    known = ("grid", *SAMPLINGS, ROWS)
    if sampling not in known:
        raise refusal("--sample", got(sampling, f"be {one_of(known[:-1])}"))
    for option, number in {"--count": count, "--seeds": seeds, "--batch": batch}.items():
        if number is not None and number < 1:
            raise refusal(option, got(number, "be at least 1"))
    if count is not None and count > MOST_RUNS:
        raise refusal("--count", got(count, f"be at most {MOST_RUNS}"))
    spans = [key for key, values in varied.items() if isinstance(values, Span)]
    sizes = [(v.count or 1) if isinstance(v, Span) else len(v) for v in varied.values()]
    if sampling == ROWS and len(set(sizes)) != 1:
        raise refusal("varied", f"got {sizes} values in rows; must be as many of each key")
    sizes = sizes[:1] if sampling == ROWS else sizes
    if (runs := prod(sizes) * seeds) > MOST_RUNS:
        raise refusal("--vary", f"makes {runs} runs; must make at most {MOST_RUNS}")
    without = [key for key in spans if varied[key].count is None]
    if sampling in ("grid", ROWS):
        if without:
            text = f"got {without[0]}={varied[without[0]]}; must have a count (FROM:TO:COUNT)"
            raise refusal("--vary", f"{text}. Add it, or use --sample {one_of(SAMPLINGS)}.")
        if count is not None:
            raise refusal("--count", f"needs --sample {one_of(SAMPLINGS)}")
    elif not without:
        raise refusal("--sample", "needs a range to sample, such as --vary arm.length=0.3:0.6")
    elif count is None:
        raise refusal("--sample", "needs --count N, the number of points")
    if seeds > 1 and SEED in varied:
        raise refusal("--seeds", "excludes other values of seed. Leave one of them out.")


def _settled(scenario: Scenario, key: str, values: list[Any]) -> list[Any]:
    """Return values as the scenario stores them, such as absolute paths, if they are valid."""
    found = []
    for value in values:
        try:
            held = value_at(scenario.with_values({key: value}).to_dict(), key)
        except ScenarioError:  # wrong, or only alone: checked in the runs
            held = None
        found.append(value if held is None else held)
    return found


def _is_number(scenario: Scenario, key: str, value: Any) -> bool:
    """Return whether values of a key are numbers or vectors that change no compiled program."""
    (held,) = _settled(scenario, key, [value])
    parts = held if isinstance(held, list) and held else [held]
    return key.partition(".")[0] not in _FIXED and all(isinstance(each, float) for each in parts)
