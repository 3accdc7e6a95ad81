"""The file of a policy: a line of JSON that describes it, then its numbers.

The numbers are the arrays as `equinox.tree_serialise_leaves` writes them: nothing in the file is
ever executed.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import equinox as eqx
import jax
import jax.numpy as jnp

from crinoid.assembly.observables import Observables
from crinoid.control.policy import Dense, Policy
from crinoid.replacement import replacing
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.version import __version__

KEY = "control.neural.weights"
"""The key of a scenario that names such a file."""
FORMAT = "crinoid-policy"
VERSION = 1
_LONGEST = 1_000_000
"""Bytes that the first line may have."""


class Description(NamedTuple):
    """Purpose and origin of a policy."""

    observations: list[list[str]]
    """Name and unit of each number that it observes."""
    actions: list[list[str]]
    """Name and unit of each number that it commands."""
    rate_hz: float
    """Commands a second."""
    trained_on: str
    """Title of the scenario that it was trained on."""
    draw: dict[str, list[float]]
    """Keys that each episode of its training drew, with the smallest and the largest value."""

    @staticmethod
    def of(
        observables: Observables, scenario: Scenario, draw: dict[str, tuple[float, float]]
    ) -> Description:
        """Describe a policy of a scenario."""
        names = [
            [[each.name, each.unit] for each in some]
            for some in (observables.entries, observables.actions)
        ]
        ranges = {key: list(pair) for key, pair in draw.items()}
        return Description(names[0], names[1], scenario.control_rate_hz, scenario.title, ranges)


def write_policy(path: Path, policy: Policy, description: Description) -> None:
    """Write a policy to a file, whole or not at all."""
    sizes = [layer.weight.shape[0] for layer in policy.layers]
    head = {
        "format": FORMAT,
        "version": VERSION,
        "crinoid": __version__,
        "averages": policy.kept.size,
        "layers": sizes,
        **description._asdict(),
    }
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(json.dumps(head).encode() + b"\n")
        eqx.tree_serialise_leaves(file, policy)


def read_policy(path: Path) -> tuple[Policy, Description]:
    """Read a policy.

    Raises
    ------
    ScenarioError
        If there is no such file, or it holds no policy that this version can read.
    """
    try:
        with path.open("rb") as file:
            head = _head(file.readline(_LONGEST))
            told = Description(*(head[key] for key in Description._fields))
            policy = eqx.tree_deserialise_leaves(file, _blank(head))
            rest = file.read(1)
    except OSError as error:
        _refuse(path, f"{error.strerror or error}, takes a file that crinoid train wrote")
    except ScenarioError as error:
        _refuse(path, error.mistakes[0].text)
    except Exception:  # Equinox and NumPy tell of damage in many ways
        _refuse(path, "is damaged: its numbers are not those that its first line tells of")
    if rest or not all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(policy)):
        _refuse(path, "is damaged: it holds more than its numbers, or some that are none")
    return policy, told


def _head(line: bytes) -> dict[str, Any]:
    """Return what the first line tells."""
    try:
        head = json.loads(line)
        form, version = head["format"], head["version"]
    except (ValueError, KeyError, TypeError):  # ValueError: of the JSON and of its text
        form, version = None, None
    if form != FORMAT:
        raise ScenarioError([Mistake("", "is no policy, takes a file that crinoid train wrote")])
    if version != VERSION:
        text = f"is of version {version} of the format, takes {VERSION}; train it again"
        raise ScenarioError([Mistake("", text)])
    return head


def _blank(head: dict[str, Any]) -> Policy:
    """Return a policy of the sizes that the first line tells of."""
    entries, averages, driven = len(head["observations"]), head["averages"], len(head["actions"])
    features = entries * (averages + 1)
    sizes = [features, *head["layers"]]
    return Policy(
        centre=jnp.zeros(entries),
        usual=jnp.zeros(features),
        kept=jnp.zeros(averages),
        linear=jnp.zeros((driven, features)),
        layers=tuple(
            Dense(jnp.zeros((after, before)), jnp.zeros(after)) for before, after in pairwise(sizes)
        ),
        swing=jnp.zeros(driven),
        fastest=jnp.zeros(driven),
    )


def _refuse(path: Path, text: str) -> NoReturn:
    raise ScenarioError([Mistake(KEY, f"{path}: {text}")])
